"""Functions in a child process: their answers, and in words how they died."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log.readers.child_process import ChildError, child


def twice(values: list[float]) -> tuple[int, Array]:
    return len(values), 2 * np.array(values)


def failing(kind: str) -> Array:
    if kind == "own":
        raise LogError("column 'a' is empty", "columns=")
    if kind == "memory":
        return np.ones(10**12)
    if kind == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if kind == "loop":
        while True:
            pass
    if kind == "exit":
        os._exit(3)
    raise ValueError("first line\nsecond line " + "x" * 10_000)


def test_answers_come_back_to_each_thread() -> None:
    """Each child answers the calls that started it, and an error of a reader passes as it is."""

    def answer(number: float) -> tuple[int, Array]:
        with child(20) as call:
            with pytest.raises(LogError, match=r"^column 'a' is empty$") as caught:
                call(failing, "own")
            assert caught.value.arguments == ("columns=",)
            count, values = call(twice, [number, 2.0])
        return count, values

    with ThreadPoolExecutor(2) as pool:
        answers = [*pool.map(answer, (1.0, 2.0))]
    for number, (count, values) in zip((1.0, 2.0), answers, strict=True):
        assert (count, values.tolist()) == (2, [2 * number, 4.0])


@pytest.mark.slow  # 5.0 s
@pytest.mark.parametrize(
    ("kind", "seconds", "words"),
    [
        ("value", 20, "first line"),
        ("memory", 20, "it requests more memory than is available"),
        ("crash", 20, r"the process that read it crashed \(SIGSEGV\(-11\)\)$"),
        ("loop", 1, "the process that read it did not end within 1 s"),
        ("exit", 20, r"the process that read it crashed \(EXIT\(3\)\)"),
    ],
)
def test_what_goes_wrong_is_said(kind: str, seconds: float, words: str) -> None:
    with pytest.raises(ChildError, match=f"^{words}") as caught, child(seconds) as call:
        call(failing, kind)
    assert len(str(caught.value)) < 400


@pytest.mark.slow  # 0.6 s
def test_a_script_needs_no_guard(tmp_path: Path) -> None:
    """The script of the user is not run again by the child."""
    script = tmp_path / "script.py"
    script.write_text(
        "import sys; print('once')\n"
        "from seaid.log.readers.child_process import child\n"
        "from test_child_process import twice\n"
        "with child(20) as call: print(call(twice, [2.0])[1])\n"
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
