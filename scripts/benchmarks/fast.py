"""Processor time of what users wait for, and the figure to reach: the median of five runs.

    python scripts/benchmarks/fast.py
    python scripts/benchmarks/fast.py --only regressor --only simulation --against ../main
    python scripts/benchmarks/fast.py --long

Work within a process is measured after one run that fills caches; where it has a peer, such as the
bare calls of Pinocchio, both alternate and the figure is their ratio. Commands are measured as
whole processes. With `--against TREE` the runs of this code and of another checkout alternate, and
the last column is the time here over the time there. With `--long` the rows are those that take
minutes, each run once as a process of its own, with its peak memory; one that takes more than
`MOST_GB` or `MOST_S` is stopped, and its row says so.

The row of the checks is a share of one identification: the processor time of checks over that of
all else in the same run (`checks_and_fit`).
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import seaid
    from seaid._arrays import Array

sys.path.append(str(Path(__file__).resolve().parents[2]))  # after the code that is measured

from scripts.short_form import OPTION, add_quick, is_quick, sized

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"
LEG = (f"{MODELS}/tulip_leg.urdf", "--drives", f"{MODELS}/tulip_leg.toml")
HEBI = (
    *(f"{MODELS}/hebi_arm_2.urdf", f"{MODELS}/logs/hebi_arms/virtual_spring.npz"),
    *("--drives", f"{MODELS}/hebi_arm_2.toml"),
    *("--description", f"{MODELS}/logs/hebi_csv_2.toml", "--force"),
)
RUNS = sized(5, 1)

Work = Callable[[], object]


@dataclass(frozen=True)
class Row:
    """Work to measure: a command, or a function that returns the work and its peer."""

    title: str
    target: float
    how: str
    command: Callable[[Path], tuple[str, ...]] | None = None
    prepare: Callable[[], tuple[Work, Work | None]] | None = None
    units: float = 1.0
    needs: str | None = None
    prints: Callable[[Path], tuple[str, ...]] | None = None
    """The arguments of a process of Python that prints the times of the work and its peer."""


def hebi_project(folder: Path, name: str = "arm") -> tuple[str, ...]:
    """Return the command that runs the project of a HEBI arm, made by `seaid init`."""
    robot = str(MODELS / "hebi_arm_2.urdf"), str(MODELS / "logs/hebi_arms/grav_comp_bad.npz")
    if not (folder / name).exists():
        command = [sys.executable, "-m", "seaid", "init", *robot, "--folder", name]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
    return "run", name


def of_identification(lines: str) -> tuple[str, ...]:
    """Return a process that runs lines with `work`, the identification of the leg."""
    return (
        "-c",
        "import warnings; warnings.simplefilter('ignore')\n"
        f"import sys; sys.path.append({str(ROOT)!r})\n"
        "from scripts.benchmarks.fast import checks_and_fit, identification, seconds\n"
        f"work, _ = identification()\n{lines}",
    )


def two_identifications(_: Path) -> tuple[str, ...]:
    """Return a process that prints the times of its first and its second identification."""
    return of_identification("print(seconds(work), seconds(work))")


def checks_in_one_run(_: Path) -> tuple[str, ...]:
    """Return a process that prints the times of the checks and of the fit of one identification."""
    return of_identification("work(); print(*checks_and_fit(work))")


OF_CHECKS = ("/seaid/checks/", "/identification/checking.py", "/identification/sensitivity.py")
"""Files of the checks: the package, and what of the identification serves nothing else."""

EVERY_S = 0.001
"""Processor time between two looks at the stack."""


def checks_and_fit(work: Work) -> tuple[float, float]:
    """Return the processor times [s] of a call within the checks, and of all else of it.

    Each look at the stack counts the time since the last one for the checks if a function of theirs
    is on it. A long call of a library is looked at when it returns, and counts as a whole.
    """
    times = {True: 0.0, False: 0.0}
    last = time.process_time()

    def look(_: int, frame: FrameType | None) -> None:
        nonlocal last
        is_check = False
        while frame is not None and not is_check:
            is_check = any(part in frame.f_code.co_filename for part in OF_CHECKS)
            frame = frame.f_back
        now = time.process_time()
        times[is_check] += now - last
        last = now

    before = signal.signal(signal.SIGPROF, look)
    signal.setitimer(signal.ITIMER_PROF, EVERY_S, EVERY_S)
    try:
        last = time.process_time()
        work()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    return times[True], times[False]


def two_projects(folder: Path) -> tuple[str, ...]:
    """Return a process that prints the times of two projects on two cores and on one."""
    for name in ("robots/arm0", "robots/arm1"):
        hebi_project(folder, name)
    return "-c", f"import sys; sys.path.append({str(ROOT)!r})\n{_BY_CORES}"


_BY_CORES = """
import os, subprocess, time
from pathlib import Path

from scripts.benchmarks.fast import results

cores, times, files = sorted(os.sched_getaffinity(0))[:2], [], []
for used in (cores, cores[:1]):
    os.sched_setaffinity(0, used)
    begin = time.monotonic()
    command = [sys.executable, "-m", "seaid", "run", "robots"]
    subprocess.run(command, check=True, capture_output=True)
    times.append(time.monotonic() - begin)
    files.append(results(Path("robots")))
assert files[0] == files[1] and files[0], "the results of two workers differ from those of one"
print(*times)
"""


def results(projects: Path) -> dict[str, bytes]:
    """Return the bytes of the estimates of projects, {project and name: contents}."""
    return {
        f"{path.parents[2].name}/{path.name}": path.read_bytes()
        for pattern in ("parameters.json", "summary.txt", "*.urdf", "*.toml")
        for path in sorted(projects.glob(f"*/runs/latest/{pattern}"))
    }


def regressor() -> tuple[Work, Work]:
    """Return the stacked regressor of an arm, and the calls of Pinocchio alone."""
    import seaid
    from scripts.example_robots import example_urdf
    from seaid.regressor import rigid_body_regressor

    robot = seaid.load_robot(example_urdf("xarm7.urdf"))
    q, v, a = np.random.default_rng(0).uniform(-1, 1, (3, sized(10_000, 500), robot.n))
    return lambda: rigid_body_regressor(robot, q, v, a), bare_calls(robot, q, v, a)


def bare_calls(robot: seaid.Robot, q: Array, v: Array, a: Array) -> Work:
    """Return the calls of Pinocchio alone, one per sample (T, n) of a motion."""
    import pinocchio as pin

    data = robot.model.createData()

    def calls() -> None:
        for t in range(len(q)):
            pin.computeJointTorqueRegressor(robot.model, data, q[t], v[t], a[t])

    return calls


def least_squares() -> tuple[Work, Work]:
    """Return the estimate with covariance from 60,000 rows, and that of figaroh without."""
    from scripts.benchmarks.peer_least_squares import ours, peers

    return ours, peers


def estimate() -> tuple[Work, None]:
    """Return an estimate with covariance from rows of six joints and 51 parameters."""
    from scripts.benchmarks.long_log import random_rows
    from seaid.estimation.least_squares import ordinary

    rows = random_rows(sized(10_000, 200), 6, 51)
    return lambda: ordinary(rows), None


MOTION_S = sized(2.0, 0.05)


class _Beginning:
    """The first seconds of a plan."""

    def __init__(self, plan: object) -> None:
        self.joint_names, self.duration = plan.joint_names, MOTION_S  # type: ignore[attr-defined]
        self.sample = plan.sample  # type: ignore[attr-defined]


def simulation() -> tuple[Work, None]:
    """Return a simulation of the leg, of `MOTION_S` after one second at rest."""
    import seaid
    from seaid.simulation.simulation import simulate_motion

    robot = seaid.load_robot(MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml")
    plan = seaid.load_trajectory(MODELS / "tulip_plan.json")
    return lambda: simulate_motion(robot, _Beginning(plan)), None  # type: ignore[arg-type]


def identification() -> tuple[Work, None]:
    """Return the identification of the leg from the experiment of the paper."""
    import seaid
    from scripts import identify_tulip_leg as tulip
    from scripts.short_form import leg_plan

    known = tulip.load_leg((tulip.TEST_MASS,)).without_nominal()
    log = tulip.experiment((tulip.TEST_MASS,), leg_plan(), tulip.sensors(0), 0)
    return lambda: seaid.identify(known, log), None


def planning() -> tuple[Work, Work]:
    """Return value and gradient of a plan of an arm, and the value alone."""
    from scripts.benchmarks.excitation import SAMPLES, load_robots, make
    from seaid.excitation.problem import random_start, value_and_gradient, value_of

    robot, limits = next(iter(load_robots().values()))
    problem = make(robot, limits, "condition_number", 32, SAMPLES[0])
    x = random_start(problem, np.random.default_rng(0))
    return lambda: value_and_gradient(problem, x), lambda: value_of(problem, x)


def samples() -> tuple[Work, Work]:
    """Return the estimate of seven joints from a file in pieces, and a bare call per sample."""
    from scripts.benchmarks.long_log import estimate, robot, write_log

    count, arm = sized(100_000, 4_000), robot()
    folder = tempfile.TemporaryDirectory()  # removed with the work that refers to it
    path = Path(folder.name) / "log.npz"
    write_log(path, count)
    states = np.random.default_rng(0).uniform(-1, 1, (3, count, arm.n))

    def streamed() -> None:
        estimate(Path(folder.name) / "log.npz", "streamed")

    return streamed, bare_calls(arm, *states)


def exact_base() -> tuple[Work, None]:
    """Return the exact base parameters of a humanoid."""
    import seaid
    from scripts.example_robots import example_urdf

    name = sized("romeo.urdf", "ur5_robot.urdf")
    robot = seaid.load_robot(example_urdf(name))
    return lambda: seaid.symbolic.base_parameters(robot), None


def identifiability() -> tuple[Work, None]:
    """Return the identifiability of a chain of which all joints have springs."""
    import seaid

    with tempfile.TemporaryDirectory() as folder:
        urdf, drives = chain(sized(60, 3), Path(folder))
        robot = seaid.load_robot(urdf, drives)
    return lambda: seaid.identifiability(robot), None


JOINT = """<link name="l{i}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0"
ixz="0" iyz="0"/></inertial></link><joint name="j{i}" type="continuous"><parent link="l{before}"/>
<child link="l{i}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/></joint>"""
DRIVE = """[j{i}]
type = "series_elastic"
friction = ["viscous", "coulomb"]
gear_ratio = 100.0
motor_inertia_kg_m2 = 1e-5
stiffness_Nm_per_rad = 200.0
"""


def chain(joints: int, folder: Path) -> tuple[Path, Path]:
    """Write a chain with random axes and offsets, every third link tilted by 0.3 rad."""
    rng = np.random.default_rng(0)
    text = '<robot name="chain"><link name="l0"/>'
    for i in range(1, joints + 1):
        axis = ("1 0 0", "0 1 0", "0 0 1")[rng.integers(3)]
        xyz = " ".join(f"{x:.3f}" for x in rng.uniform(-0.3, 0.3, 3))
        rpy = ("0 0 0", "1.5707963267948966 0 0", "0 0.3 0")[rng.integers(3)]
        text += JOINT.format(i=i, before=i - 1, xyz=xyz, rpy=rpy, axis=axis)
    urdf, drives = folder / f"chain{joints}.urdf", folder / f"chain{joints}.toml"
    urdf.write_text(text + "</robot>")
    drives.write_text("".join(DRIVE.format(i=i) for i in range(1, joints + 1)))
    return urdf, drives


def inspected(joints: int) -> Callable[[Path], tuple[str, ...]]:
    """Return the command that inspects a chain, which is written into the folder."""

    def command(folder: Path) -> tuple[str, ...]:
        urdf, drives = chain(sized(joints, 3), folder)
        return "inspect", str(urdf), "--drives", str(drives)

    return command


def identified(joints: int, samples: int) -> Callable[[Path], list[str]]:
    """Return the command that identifies a chain with springs from a short log."""

    def command(folder: Path) -> list[str]:
        from scripts.benchmarks.long_log import RATE_HZ

        urdf, drives = chain(joints, folder)
        rng, log = np.random.default_rng(1), folder / "log.npz"
        at = np.arange(samples) / RATE_HZ * 10
        columns = {"time_s": at}
        for number in range(1, joints + 1):
            phase, torque = rng.uniform(0, 2 * np.pi), rng.normal(0, 1, samples)
            angle = 0.3 * np.sin(2 * np.pi * rng.uniform(0.2, 1.0) * at + phase)
            columns[f"j{number}.joint_position_rad"] = angle
            columns[f"j{number}.motor_position_rad"] = 100 * angle + torque
            columns[f"j{number}.motor_torque_Nm"] = torque
        np.savez(log, **columns)  # type: ignore[arg-type]
        return ["-m", "seaid", "identify", str(urdf), str(log), "--drives", str(drives)]

    return command


def estimated(samples: int, way: str, ending: str = ".npz") -> Callable[[Path], list[str]]:
    """Return the command that estimates an arm from a long log, streamed or in memory."""

    def command(folder: Path) -> list[str]:
        from scripts.benchmarks.long_log import write_log

        path = folder / "log.npz"
        write_log(path, samples)
        if ending == ".parquet":
            from pyarrow import parquet, table

            with np.load(path) as archive:
                columns = table({name: archive[name] for name in archive})
            path = folder / "log.parquet"
            parquet.write_table(columns, path)
        imports = "from pathlib import Path; from scripts.benchmarks.long_log import estimate"
        return ["-c", f"{imports}; estimate(Path({str(path)!r}), {way!r})"]

    return command


def many_logs(count: int, samples: int) -> Callable[[Path], list[str]]:
    """Return the command that runs a project of many small logs."""

    def command(folder: Path) -> list[str]:
        import seaid
        from scripts.benchmarks.long_log import robot, write_log
        from scripts.example_robots import example_urdf

        seaid.write_drives(robot().drives, folder / "drives.toml")
        text = f'urdf = "{example_urdf("xarm7.urdf")}"\ndrives = "drives.toml"\n'
        write_log(folder / "0.npz", count * samples)
        with np.load(folder / "0.npz") as archive:
            whole = {name: archive[name] for name in archive}
        for number in range(count):
            part = slice(number * samples, (number + 1) * samples)
            np.savez(folder / f"{number}.npz", **{name: x[part] for name, x in whole.items()})
            text += f'[[log]]\nfile = "{number}.npz"\n'
        (folder / "seaid.toml").write_text(text + '[run]\nwrite = ["parameters"]\n')
        return ["-m", "seaid", "run", str(folder)]

    return command


def inspected_once(joints: int) -> Callable[[Path], list[str]]:
    """Return the command of `inspected`, as words of Python."""
    return lambda folder: ["-m", "seaid", *inspected(joints)(folder)]


@dataclass(frozen=True)
class LongRow:
    """A command that takes minutes, run once, with the time and the peak memory to reach."""

    title: str
    target_s: float | None
    target_GB: float | None
    command: Callable[[Path], list[str]]


_MILLION = sized(1_000_000, 4_000)
LONG = {
    "chain80": LongRow("seaid inspect, 80 springs", 2.0, None, inspected_once(80)),
    "chain300": LongRow("seaid inspect, 300 springs", 10.0, 1.9, inspected_once(300)),
    "identify300": LongRow(
        "seaid identify, 300 springs x 300", 30.0, 1.0, identified(sized(300, 3), 300)
    ),
    "logs200": LongRow("seaid run, 200 small logs", 25.0, 0.4, many_logs(sized(200, 3), 1_500)),
    "memory": LongRow("million samples in memory", None, 0.8, estimated(_MILLION, "in memory")),
    "pieces": LongRow("3 million in pieces, NPZ", None, 0.4, estimated(3 * _MILLION, "streamed")),
    "parquet": LongRow(
        "3 million in pieces, Parquet", None, 0.4, estimated(3 * _MILLION, "streamed", ".parquet")
    ),
    "tulip": LongRow(
        "make tulip, warm", 8.0, None, lambda _: [str(ROOT / "scripts/identify_tulip_leg.py")]
    ),
}

MOST_GB, MOST_S = 2.0, 600.0


def measured_once(row: LongRow) -> str:
    """Return processor time and peak memory of a command, or why it was stopped or refused."""
    with tempfile.TemporaryDirectory() as folder:
        words = row.command(Path(folder))
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        process = subprocess.Popen(
            [sys.executable, *words],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
            stdout=subprocess.DEVNULL,
            stderr=(errors := (Path(folder) / "errors").open("w+", encoding="utf-8")),
        )
        begin, peak, end = time.monotonic(), 0.0, ""
        try:
            while process.poll() is None and not end:
                peak = max(peak, peak_GB(process.pid))
                if peak > MOST_GB or time.monotonic() - begin > MOST_S:
                    end = " stopped"
                time.sleep(0.05)
        finally:
            process.kill()  # also if this one is stopped; nothing happens to one that has ended
            code = process.wait()
        with errors:
            errors.seek(0)
            refusal = next((x for x in errors if "error" in x.lower()), f"exit code {code}")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    end = end or (f": {refusal.strip()}" if code else "")
    return f"{used:7.1f} s of {row.target_s or '-'}, {peak:5.2f} GB of {row.target_GB or '-'}{end}"


def peak_GB(pid: int) -> float:
    """Return the largest resident memory of a process so far, zero for one that has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return max((int(x.split()[1]) / 1e6 for x in lines if x.startswith("VmHWM")), default=0.0)


PROCESS, INSIDE = "whole process, s", "within a process, s"
ROWS = {
    "regressor": Row("stacked regressor, xArm7", 1.08, "over bare calls", prepare=regressor),
    "peer": Row(
        *("OLS of 60,000 x 36 with covariance", 0.2, "over figaroh without"),
        prepare=least_squares,
        needs="figaroh",
    ),
    "estimate": Row("estimate and covariance, 60,000 x 51", 0.05, INSIDE, prepare=estimate),
    "help": Row("seaid --help", 0.1, PROCESS, lambda _: ("--help",)),
    "identify_help": Row("seaid identify --help", 0.15, PROCESS, lambda _: ("identify", "--help")),
    "inspect": Row("seaid inspect, leg", 0.7, PROCESS, lambda _: ("inspect", *LEG)),
    "hebi": Row("seaid identify, HEBI log of 25 s", 2.0, PROCESS, lambda _: ("identify", *HEBI)),
    "run": Row("seaid run, project of a HEBI arm", 2.0, PROCESS, hebi_project),
    "identify": Row("identify, leg", 0.4, INSIDE, prepare=identification),
    "checks": Row("checks of identify, leg", 0.33, "over the fit", prints=checks_in_one_run),
    "first": Row("first identify, leg", 1.2, "over the second", prints=two_identifications),
    "robots": Row(
        *("seaid run of two projects, two workers", 0.55, "time on the clock over one worker"),
        prints=two_projects,
    ),
    "simulation": Row(
        *("simulation of the leg", 0.08, "within a process, s per s of motion"),
        prepare=simulation,
        units=MOTION_S + 1.0,
    ),
    "planning": Row("value and gradient of a plan", 5.0, "over the value", prepare=planning),
    "samples": Row("samples of 7 joints from a file", 2.5, "over bare calls", prepare=samples),
    "identifiability": Row("identifiability, 60 springs", 3.0, INSIDE, prepare=identifiability),
    "exact_base": Row("exact base parameters, romeo", 0.3, INSIDE, prepare=exact_base),
    "chain40": Row("seaid inspect, 40 springs", 1.0, PROCESS, inspected(40)),
}


SHORT = [name for name in ROWS if name not in {"identify_help", "hebi", "run", "robots"}]
"""The rows of the short form; the others are made in the same way as one of these."""


def seconds(work: Work) -> float:
    """Return the processor time of a call."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def serve() -> None:
    """Print the processor times of the work and the peer of each row that a line names."""
    warnings.simplefilter("ignore")
    ready: dict[str, tuple[Work, Work | None]] = {}
    for line in sys.stdin:
        name = line.strip()
        row = ROWS[name]
        assert row.prepare is not None
        if name not in ready:
            ready[name] = row.prepare()
            ready[name][0]()
        work, peer = ready[name]
        print(seconds(work) / row.units, 1.0 if peer is None else seconds(peer), flush=True)


class Tree:
    """A checkout whose code is measured, with a process of its own for work within a process."""

    def __init__(self, code: Path) -> None:
        self._environment = {**os.environ, "PYTHONPATH": str(code), "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, __file__, "--serve", *([OPTION] if is_quick() else [])]
        self._server = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=self._environment,
        )

    def close(self) -> None:
        """End the process."""
        self._server.communicate()

    def measure(self, name: str, folder: Path) -> tuple[float, float]:
        """Return the processor time of a row and of its peer, one if it has none."""
        row = ROWS[name]
        if row.command is not None:
            return self._process(row.command(folder), folder), 1.0
        if row.prints is not None:
            figures = self._output(row.prints(folder), folder).split()
            return float(figures[0]), float(figures[1])
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        print(name, file=self._server.stdin, flush=True)
        work, peer = self._server.stdout.readline().split()
        return float(work), float(peer)

    def _output(self, arguments: tuple[str, ...], folder: Path) -> str:
        done = subprocess.run(
            [sys.executable, *arguments],
            cwd=folder,  # Python imports from there first
            env=self._environment,
            check=True,
            capture_output=True,
            text=True,
        )
        return done.stdout

    def _process(self, arguments: tuple[str, ...], folder: Path) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        self._output(("-m", "seaid", *arguments), folder)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measured(names: list[str], trees: list[Tree]) -> Iterator[str]:
    """Yield a line of the table per row."""
    for name in names:
        row = ROWS[name]
        if row.needs is not None and find_spec(row.needs) is None:
            yield f"{name:16} {row.title:38} {'-':>8} {row.target:8g}   {row.needs} is missing"
            continue
        with tempfile.TemporaryDirectory() as folder:
            rounds = [
                [tree.measure(name, Path(folder)) for tree in trees]
                for _ in range(sized(RUNS + 1, 1))
            ]
        # the first run of a command may compile what it imports
        rounds = rounds[-RUNS:]
        figure = statistics.median(here[0] / here[1] for here, *_ in rounds)
        line = f"{name:16} {row.title:38} {figure:8.3g} {row.target:8g}   {row.how}"
        if len(trees) > 1:
            ratio = statistics.median(here[0] / there[0] for here, there in rounds)
            line += f"; here / there {ratio:.2f}"
        yield line


def main(names: list[str], against: Path | None) -> None:
    """Print the table."""
    places = [ROOT] if against is None else [ROOT, against.resolve()]
    trees = [Tree(place) for place in places]
    print(f"{'row':16} {'work':38} {'today':>8} {'to reach':>8}   measured, median of {RUNS}")
    try:
        for line in measured(names, trees):
            print(line, flush=True)
    finally:
        for tree in trees:
            tree.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", action="append", choices=list(ROWS), help="may be repeated")
    parser.add_argument("--against", type=Path, metavar="TREE", help="another checkout")
    parser.add_argument("--long", action="append", nargs="?", choices=["", *LONG], const="")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    add_quick(parser)
    arguments = parser.parse_args()
    if arguments.serve:
        serve()
    elif arguments.long:
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # ends the child as Ctrl+C does
        for name in list(LONG) if "" in arguments.long else arguments.long:
            print(f"{name:12} {LONG[name].title:34} {measured_once(LONG[name])}", flush=True)
    else:
        main(arguments.only or sized(list(ROWS), SHORT), arguments.against)
