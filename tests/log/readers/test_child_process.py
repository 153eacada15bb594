"""Functions in a child process: their answers, and in words how they died."""

import os
import signal
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from seaid.errors import LogError
from seaid.log.readers.child_process import Answer, ChildError, doing, run_in_child


def twice(values: list[float]) -> Answer:
    array = np.array(values)
    return {"count": len(values)}, {"file": 2 * array, "a/b[0]": array > 1}


def failing(kind: str) -> Answer:
    doing("mesh 'x.ply'")
    if kind == "own":
        raise LogError("column 'a' is empty")
    if kind == "memory":
        return None, {"a": np.ones(10**12)}
    if kind == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if kind == "loop":
        while True:
            pass
    if kind == "exit":
        os._exit(3)
    raise ValueError("first line\nsecond line " + "x" * 10_000)


def test_facts_and_arrays_come_back_to_each_thread() -> None:
    """Each child answers the call that started it, with arrays of any name and type."""
    with ThreadPoolExecutor(2) as pool:
        calls = [{"values": [1.0 * k, 2.0]} for k in (1, 2)]
        answers = [pool.submit(run_in_child, twice, call, seconds=20) for call in calls]
    for k, answer in zip((1, 2), answers, strict=True):
        facts, arrays = answer.result()
        assert facts == {"count": 2}
        assert arrays["file"].tolist() == [2.0 * k, 4.0]
        assert arrays["a/b[0]"].tolist() == [k > 1, True]


def test_own_errors_and_a_lack_of_room_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error of a reader passes as it is; a child without a folder is none of the file."""
    with pytest.raises(LogError, match=r"^column 'a' is empty$"):
        run_in_child(failing, {"kind": "own"}, seconds=20)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(ChildError, match="a child process cannot be run: No such file"):
        run_in_child(twice, {"values": [1.0]}, seconds=20)


@pytest.mark.slow  # 5.0 s
@pytest.mark.parametrize(
    ("kind", "seconds", "words"),
    [
        ("value", 20, "first line"),
        ("memory", 20, "it requests more memory than is available"),
        ("crash", 20, r"the process that read it crashed \(SIGSEGV\) at mesh 'x.ply'"),
        ("loop", 1, "the process that read it did not end within [16] s at mesh 'x.ply'"),
        ("exit", 20, "the process that read it ended with code 3"),
    ],
)
def test_what_goes_wrong_is_said(
    kind: str, seconds: float, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A child that crashes, hangs or ends is named with what it did, and leaves no file."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(ChildError, match=f"^{words}") as caught:
        run_in_child(failing, {"kind": kind}, seconds=seconds)
    assert len(str(caught.value)) < 400
    assert os.listdir(tmp_path) == []


@pytest.mark.slow  # 0.6 s
def test_a_script_needs_no_guard(tmp_path: Path) -> None:
    """The script of the user is not run again by the child."""
    script = tmp_path / "script.py"
    script.write_text(
        "import sys; print('once')\n"
        "from seaid.log.readers.child_process import run_in_child\n"
        "from test_child_process import twice\n"
        "print(run_in_child(twice, {'values': [2.0]}, seconds=20)[1]['file'])\n"
    )
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, script],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert done.stdout == "once\n[4.]\n"
