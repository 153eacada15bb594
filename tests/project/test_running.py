"""Several projects at once: as one by one, with processes that die, and on a cluster."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import SeaidError
from seaid.project import find_projects, run_project, run_projects
from tests.experiments import MODELS
from tests.measured import LOGS

PROJECT = f"""urdf = "{MODELS}/hebi_arm_2.urdf"
drives = "{MODELS}/hebi_arm_2.toml"

[[log]]
file = "{LOGS}/hebi_arms/grav_comp_bad.npz"
description = "{LOGS}/hebi_csv_2.toml"
between_s = [%d, %d]

[run]
write = ["parameters", "urdf"]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three projects that can be run, and one without its robot."""
    for number, name in enumerate(("a", "b", "deeper/c")):
        write(tmp_path / name, PROJECT % (number, number + 6))
    write(tmp_path / "broken", 'urdf = "nothing.urdf"\n[[log]]\nfile = "run.csv"\n')
    return tmp_path


def write(place: Path, text: str) -> None:
    place.mkdir(parents=True)
    (place / "seaid.toml").write_text(text)


def test_projects_are_those_below_a_folder(folder: Path) -> None:
    copies = (".hidden", "a/within", "results/2026/inputs")
    for place in copies:
        write(folder / place, PROJECT)
    (folder / "results/2026/identification.npz").touch()
    assert find_projects(folder) == tuple(folder / x for x in ("a", "b", "broken", "deeper/c"))
    assert find_projects(folder / "a") == ()
    assert find_projects(folder / "a/seaid.toml") == ()
    (folder / "nothing").mkdir()
    with pytest.raises(SeaidError, match=r"no folder below '.*nothing' has a seaid\.toml"):
        run_projects(folder / "nothing")


def results(run: Path) -> dict[str, bytes]:
    """Return what is in the files of a run but the origin of each: its time and command."""
    content = {x.name: x.read_bytes() for x in run.iterdir() if x.is_file()}
    with np.load(run / "identification.npz") as saved:
        content |= {name: saved[name].tobytes() for name in saved if name.startswith("a")}
    del content["identification.npz"], content["provenance.json"]
    return content


def check_outcomes(folder: Path, outcomes: Iterable[Any], most: int = 1) -> None:
    """Compare the outcome of each project with its run alone, and count its runs."""
    by_name = {str(x.project.relative_to(folder)): x for x in outcomes}
    assert [*by_name] == ["a", "b", "broken", "deeper/c"]
    broken = by_name.pop("broken")
    assert (broken.verdict, broken.place) == ("failed", None)
    assert "there is no log" in broken.error
    for name, outcome in by_name.items():
        assert outcome.error == ""
        runs = [x for x in (folder / name / "runs").iterdir() if not x.is_symlink()]
        assert len(runs) <= most
        assert outcome.place == max(runs)
        alone = run_project(folder / name)
        assert outcome.verdict == alone.runs[""].identification.verdict.level
        assert outcome.warnings == alone.warnings
        for run in runs:
            assert results(run) == results(alone.folder)


@pytest.mark.slow  # six identifications
def test_results_are_those_of_runs_one_by_one(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    check_outcomes(folder, run_projects(folder, progress=True))
    assert "4 of 4: " in capsys.readouterr().err


@contextmanager
def killing(pids: Callable[[], Iterable[int]]) -> Iterator[list[int]]:
    """Kill the first of some processes that has computed for a second since it was seen."""
    killed: list[int] = []
    is_over, began = threading.Event(), dict[int, float]()

    def watch() -> None:
        while not killed and not is_over.wait(0.05):
            for pid in pids():
                with suppress(OSError):
                    used = seconds_of(pid)
                    if used > began.setdefault(pid, used) + 1.0 and not killed:
                        os.kill(pid, signal.SIGKILL)
                        killed.append(pid)

    thread = threading.Thread(target=watch)
    thread.start()
    yield killed
    is_over.set()
    thread.join()


def seconds_of(pid: int) -> float:
    """Return the processor time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def cluster(threads: int = 1) -> Iterator[Any]:
    distributed: Any = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=threads, dashboard_address=None
    ) as workers:
        yield workers


@pytest.mark.slow  # six identifications and a repeated one
@pytest.mark.parametrize("on_cluster", [False, True])
def test_a_project_whose_process_is_killed_is_run_again(folder: Path, on_cluster: bool) -> None:
    """On a cluster too, which gives the same and loses nothing with a worker."""
    if on_cluster:
        with cluster() as workers:
            pids = [nanny.pid for nanny in workers.workers.values()]
            with killing(lambda: pids) as killed:
                outcomes = run_projects(folder, executor=f"dask:{workers.scheduler_address}")
    else:
        tasks = Path(f"/proc/{os.getpid()}/task")
        with killing(
            lambda: [int(x) for file in tasks.glob("*/children") for x in file.read_text().split()]
        ) as killed:
            outcomes = run_projects(folder)
    assert killed
    # A process may have ended a run whose outcome nobody has read when it is killed.
    check_outcomes(folder, outcomes, most=2)


@pytest.mark.slow  # processes that import seaid, and a wait of 5 s
def test_clusters_that_cannot_be_used_are_refused_within_seconds(folder: Path) -> None:
    words = "each worker needs one thread, so that projects do not mix"
    with cluster(threads=2) as workers, pytest.raises(SeaidError, match=words):
        run_projects(folder, executor=f"dask:{workers.scheduler_address}")
    begin = time.monotonic()
    with pytest.raises(SeaidError, match=r"no scheduler answers at '127\.0\.0\.1:1' within 5 s"):
        run_projects(folder, executor="dask:127.0.0.1:1")
    assert time.monotonic() - begin < 30


def test_other_executors_and_a_cluster_without_its_package_are_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for executor in ("dask:", "processes", "ray:127.0.0.1"):
        words = f"executor= must be dask:ADDRESS.*found '{executor}'"
        with pytest.raises(SeaidError, match=words):
            run_projects(folder, executor=executor)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SeaidError, match=r"pip install 'seaid\[dask\]'"):
        run_projects(folder, executor="dask:127.0.0.1:8786")


WRITING = """
import sys
from pathlib import Path
from seaid._files import owned_folder, point_latest
from seaid.project.running import _renamed
for number in range(40):
    with owned_folder(Path("runs")) as folder:
        (folder / sys.argv[1]).write_text(str(number))
        point_latest(_renamed(folder, Path("runs")))
"""


@pytest.mark.slow  # processes that import seaid
def test_two_processes_write_into_one_folder_of_runs(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    root = str(Path(__file__).parents[2])
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", WRITING, name],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": root},
        )
        for name in ("one", "two")
    ]
    assert [process.wait() for process in processes] == [0, 0]
    runs = [x for x in (tmp_path / "runs").iterdir() if not x.is_symlink()]
    written = sorted((x.name, int(x.read_text())) for run in runs for x in run.iterdir())
    assert written == [(name, number) for name in ("one", "two") for number in range(40)]
    assert (tmp_path / "runs/latest").resolve() in [run.resolve() for run in runs]
