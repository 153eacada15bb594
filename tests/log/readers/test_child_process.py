"""Functions in a child process: their answers, and in words how they died."""

import os
import signal
import subprocess
import sys
import tempfile
import time
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
    if kind == "abort":
        os.abort()
    if kind == "loop":
        while True:
            pass
    if kind == "sleep":
        time.sleep(60)
    if kind == "exit":
        os._exit(3)
    raise ValueError("first line\nsecond line " + "x" * 10_000)


def test_facts_and_arrays_come_back() -> None:
    facts, arrays = run_in_child(twice, {"values": [1.0, 2.0]}, seconds=20)
    assert facts == {"count": 2}
    assert arrays["file"].tolist() == [2.0, 4.0]
    assert arrays["a/b[0]"].tolist() == [False, True]


@pytest.mark.slow  # 5.0 s
@pytest.mark.parametrize(
    ("kind", "seconds", "words"),
    [
        ("value", 20, "first line"),
        ("memory", 20, "it requests more memory than is available"),
        ("crash", 20, r"the process that read it crashed \(SIGSEGV\) at mesh 'x.ply'"),
        ("abort", 20, r"the process that read it crashed \(SIGABRT\) at mesh 'x.ply'"),
        ("loop", 1, "the process that read it did not end within [16] s at mesh 'x.ply'"),
        ("sleep", 0.5, "the process that read it did not end within 3 s"),
        ("exit", 20, "the process that read it ended with code 3"),
    ],
)
def test_what_goes_wrong_is_said(
    kind: str, seconds: float, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(ChildError, match=f"^{words}") as caught:
        run_in_child(failing, {"kind": kind}, seconds=seconds)
    assert len(str(caught.value)) < 400
    assert os.listdir(tmp_path) == []


def test_own_errors_pass_as_they_are() -> None:
    with pytest.raises(LogError, match=r"^column 'a' is empty$"):
        run_in_child(failing, {"kind": "own"}, seconds=20)


@pytest.mark.slow  # 0.5 s
def test_threads_have_children_too() -> None:
    with ThreadPoolExecutor(2) as pool:
        answers = [
            pool.submit(run_in_child, twice, {"values": [1.0 * k]}, seconds=20) for k in (3, 4)
        ]
        assert [one.result()[1]["file"][0] for one in answers] == [6.0, 8.0]


@pytest.mark.slow  # 0.6 s
def test_a_script_needs_no_guard(tmp_path: Path) -> None:
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


def test_no_room_for_the_answer_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(ChildError, match="a child process cannot be run: No such file"):
        run_in_child(twice, {"values": [1.0]}, seconds=20)
