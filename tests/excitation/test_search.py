"""Who runs the starts: the same motion from threads, processes and a cluster; Ctrl-C anywhere."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import ExcitationError
from seaid.excitation import Excitation
from seaid.excitation.search import run_all
from seaid.robot import Robot
from tests.excitation.robots import plan

MODELS = Path(__file__).parents[2] / "models"


QUICK: dict[str, Any] = {"starts": 3, "seed": 7}


@contextmanager
def dask_cluster() -> Any:
    dask: Any = import_module("distributed")
    with (
        dask.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        dask.Client(cluster) as client,
    ):
        yield client.get_executor()


def spawned() -> AbstractContextManager[Executor]:
    return ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn"))


@pytest.fixture(scope="module")
def by_default(slider_arm: Robot) -> Excitation:
    return plan(slider_arm, **QUICK)


@pytest.mark.slow  # 0.5 s
@pytest.mark.parametrize(
    "executors",
    [
        pytest.param(lambda: nullcontext(ThreadPoolExecutor(1)), id="thread"),
        # processes that import seaid
        pytest.param(spawned, id="processes", marks=pytest.mark.slow),
        pytest.param(dask_cluster, id="dask", marks=pytest.mark.slow),
    ],
)
def test_the_same_seed_gives_the_same_motion_whoever_computes(
    slider_arm: Robot,
    by_default: Excitation,
    executors: Callable[[], AbstractContextManager[Executor]],
) -> None:
    with executors() as executor:
        found = plan(slider_arm, **QUICK, executor=executor)
    np.testing.assert_array_equal(found.trajectory.coefficients, by_default.trajectory.coefficients)
    assert found.condition_number == by_default.condition_number


def test_another_seed_gives_another_motion(slider_arm: Robot, by_default: Excitation) -> None:
    changed = plan(slider_arm, starts=3, seed=8)
    assert np.any(changed.trajectory.coefficients != by_default.trajectory.coefficients)


SCRIPT = """
import seaid
robot = seaid.load_robot({urdf!r})
print("planning", flush=True)
plan = seaid.design_excitation(robot, 10.0, starts=2, iterations=3000, coefficients=40)
print(plan.condition_number, plan.margins.position.min() > -1e-9, flush=True)
"""


def searching(group: int) -> int:
    """Return how many processes of a group, but for its first one, have computed for 4 s.

    They need less than that to import seaid.
    """
    count = 0
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            fields = (place / "stat").read_text().rpartition(")")[2].split()
            ticks = int(fields[11]) + int(fields[12])
            busy = ticks > 4 * os.sysconf("SC_CLK_TCK")
            count += int(fields[2]) == group and int(place.name) != group and busy
    return count


@pytest.mark.slow  # searches until it is interrupted
def test_ctrl_c_ends_the_search_of_a_plain_script(tmp_path: Path) -> None:
    """A script without a main guard, interrupted as by a terminal: the whole process group."""
    script = tmp_path / "plan.py"
    script.write_text(SCRIPT.format(urdf=str(MODELS / "tulip_leg.urdf")))
    process = subprocess.Popen(
        [sys.executable, "-W", "always", str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # a shell's background job ignores the signal, and so would the script
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        cwd=Path(__file__).parents[2],
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "planning\n"
    until = time.monotonic() + 60.0
    while searching(process.pid) < min(2, os.cpu_count() or 1) and time.monotonic() < until:
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    kappa, kept = output.split()
    assert np.isfinite(float(kappa))
    assert kept == "True"
    assert "ended early: interrupted" in errors


def killed(path: str, times: int, value: int) -> int:
    """Kill the process that runs this, as often as asked; then return a value."""
    count = Path(path).stat().st_size
    if value == 1 and count < times:
        with Path(path).open("a") as file:
            file.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    return value


def never(number: int, value: int) -> None:
    """Take what is told of the tasks that are done."""


@pytest.mark.slow  # processes that import seaid, some again
def test_a_killed_process_is_replaced_once_and_after_that_said(tmp_path: Path) -> None:
    """One of the user's own executor is not replaced."""
    path = tmp_path / "deaths"
    path.touch()
    tasks = [(str(path), 1, value) for value in range(3)]
    assert run_all(killed, tasks, None, never) == ([0, 1, 2], False)
    assert path.read_text() == "x"
    tasks = [(str(path), 9, value) for value in range(2)]
    with pytest.raises(ExcitationError, match=r"was ended from outside \(killed, or out of memory"):
        run_all(killed, tasks, None, never)
    assert path.read_text() == "xxx"
    assert run_all(killed, [(str(path), 0, 1)], None, never) == ([1], False)
    with spawned() as executor, pytest.raises(ExcitationError, match="BrokenProcessPool"):
        run_all(killed, [(str(path), 4, 1)], executor, never)
    assert path.read_text() == "xxxx"


SLEEPING = """
import os, sys, time
from seaid.excitation.search import run_all
def sleep(seconds):
    time.sleep(seconds)
    return os.getpid()
found, _ = run_all(sleep, [(0.2,), (0.2,)], None, lambda number, pid: None)
print(*sorted(set(found)), flush=True)
if sys.argv[1] == "busy":
    run_all(sleep, [(100.0,), (100.0,)], None, lambda number, pid: None)
time.sleep(100.0)
"""


@pytest.mark.slow  # three processes that import seaid
@pytest.mark.parametrize(("what", "end"), [("busy", signal.SIGTERM), ("idle", signal.SIGKILL)])
def test_processes_end_with_the_one_that_began_them(what: str, end: int) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", SLEEPING, what],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        cwd=Path(__file__).parents[2],
    ) as process:
        assert process.stdout is not None
        pids = [int(word) for word in process.stdout.readline().split()]
        os.kill(process.pid, end)
    assert pids
    until = time.monotonic() + 20
    while any(map(is_running, pids)) and time.monotonic() < until:
        time.sleep(0.1)
    assert not any(map(is_running, pids))


def is_running(pid: int) -> bool:
    """Tell whether a process is there and no zombie."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
