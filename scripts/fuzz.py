"""Fuzz all inputs of seaid with damaged files and requests, in supervised child processes.

    python scripts/fuzz.py --cases 50000                      # all targets, the long run
    python scripts/fuzz.py --target npz --seed 123 --cases 1  # one case again, with its traceback

A case is a target and a seed, and is the same on every machine. It runs in a child process within
4 GB and 20 s. A child that ends, or must be ended, is counted and replaced. Findings stay in the
output folder, each with its files and its output. Targets and mutators are in `tests/fuzz`.
"""

from __future__ import annotations

import argparse
import faulthandler
import multiprocessing
import os
import queue
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

if TYPE_CHECKING:
    from tests.fuzz.targets import Outcome

MEMORY_BYTES = 4 * 10**9
SECONDS = 20.0
KINDS = {
    "accepted": "accepted",
    "refused": "refused by SeaidError",
    "exception": "other exception",
    "crash": "crash",
    "time": "over 20 s",
    "memory": "over 4 GB",
}
FINDINGS = ("exception", "crash", "time", "memory")
SHARES = {"mesh": 0.2, "bag": 0.2, "hebilog": 0.2, "command": 0.3, "identify": 0.6}
"""Number of cases of the slow targets for one case of the others."""
KEPT = 3
"""Number of cases per cause whose files are kept."""

_START_SECONDS = 200.0
Case = tuple[str, int]


@dataclass(frozen=True)
class Result:
    """The end of a case, one of KINDS. `cause` of a finding has exception and place."""

    kind: str
    cause: str
    seconds: float


_TOO_LONG = Result("time", "", SECONDS)
Work = Callable[[Connection, Path], None]


def work(pipe: Connection, folder: Path) -> None:
    """Run the cases from the pipe, each in the empty folder `case` (child process)."""
    os.setsid()
    said = os.open(folder / "said.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
    for stream in (1, 2):  # readers in C++ write there
        os.dup2(said, stream)
    faulthandler.enable()
    from tests.fuzz import seeds
    from tests.fuzz.targets import run_case

    seeds.make_all()
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEMORY_BYTES,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    pipe.send("ready")
    while True:
        name, seed = pipe.recv()
        os.ftruncate(said, 0)
        shutil.rmtree(folder / "case", ignore_errors=True)
        (folder / "case").mkdir()
        start = time.perf_counter()
        outcome = run_case(name, seed, folder / "case")
        seconds = time.perf_counter() - start
        if outcome.problem is not None:
            traceback.print_exception(outcome.problem)
        pipe.send(Result(outcome.kind, cause_of(outcome), seconds))


def cause_of(outcome: Outcome) -> str:
    """Return the type of an exception and the innermost line of seaid in its traceback."""
    if outcome.kind not in FINDINGS:
        return ""
    frames = traceback.extract_tb(outcome.problem.__traceback__ if outcome.problem else None)
    own = [one for one in frames if "/seaid/" in one.filename] or frames
    place = f" at {Path(own[-1].filename).name}:{own[-1].lineno}" if own else ""
    name = type(outcome.problem).__name__
    return f"{name}{f' ({outcome.problem})' if name == 'LawError' else ''}{place}"


class Child:
    """A child process that runs one case after another, and is replaced when it ends."""

    def __init__(self, folder: Path, output: Path, work: Work = work, seconds: float = SECONDS):
        self.folder, self.output, self.work, self.seconds = folder, output, work, seconds
        self.folder.mkdir(parents=True)
        self.seen: Counter[tuple[str, str, str]] = Counter()
        self.start()

    def start(self) -> None:
        """Start the process, and wait until it is ready."""
        self.pipe, theirs = multiprocessing.Pipe()
        spawn = multiprocessing.get_context("spawn")
        self.process = spawn.Process(target=self.work, args=(theirs, self.folder))
        self.process.start()
        theirs.close()
        if not self.pipe.poll(_START_SECONDS):
            raise SystemExit("error: a child process does not start")
        self.pipe.recv()

    def end(self, sign: int = 0) -> int | None:
        """End the process and all its children; return its exit code."""
        self.pipe.close()
        with suppress(ProcessLookupError):
            os.kill(self.process.pid or 0, sign)
        self.process.join(1.0)
        code = self.process.exitcode
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid or 0, signal.SIGKILL)
        self.process.join()
        return code

    def run(self, case: Case) -> Result:
        """Run a case under supervision, and keep its files if it is a finding."""
        self.pipe.send(case)
        try:
            found: Result = self.pipe.recv() if self.pipe.poll(self.seconds) else _TOO_LONG
        except (EOFError, ConnectionResetError):
            found = Result("crash", f"ended with {self.end()}", 0.0)
        if found.kind == "time":
            self.end(signal.SIGABRT)  # faulthandler then prints where it was
        alike = (case[0], found.kind, found.cause)
        self.seen[alike] += 1
        if found.kind in FINDINGS and self.seen[alike] <= KEPT:
            there = self.output / f"{case[0]}-{case[1]}"
            shutil.rmtree(there, ignore_errors=True)
            shutil.copytree(self.folder / "case", there, symlinks=True)
            shutil.copy(self.folder / "said.txt", there)
        if found.kind in ("crash", "time"):
            self.start()
        return found


def run_all(cases: Sequence[Case], workers: int, output: Path) -> list[Result]:
    """Run cases in `workers` child processes, and return their results."""
    from seaid._progress import track

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as pool:
        places = [Path(folder) / f"{index}" for index in range(workers)]
        children = list(pool.map(lambda place: Child(place, output), places))
        idle: queue.Queue[Child] = queue.Queue()
        for one in children:
            idle.put(one)

        def run(case: Case) -> Result:
            child = idle.get()
            try:
                return child.run(case)
            finally:
                idle.put(child)

        try:
            pending = [pool.submit(run, case) for case in cases]
            return [done.result() for done in track(pending, "fuzzing", sys.stderr.isatty())]
        finally:
            pool.shutdown(cancel_futures=True)
            for one in children:
                one.end()


def cases_of(targets: Sequence[str], count: int, first: int) -> list[Case]:
    """Return `count` cases, the targets in turns, each with consecutive seeds from `first` on."""
    total = sum(SHARES.get(name, 1.0) for name in targets)
    found = []
    for name in targets:
        own = max(1, round(count * SHARES.get(name, 1.0) / total))
        found += [(place / own, name, first + place) for place in range(own)]
    return [(name, seed) for _, name, seed in sorted(found)]


def report(cases: Sequence[Case], results: Sequence[Result]) -> str:
    """Return the table of results, and a line per cause of findings."""
    ended: dict[str, Counter[str]] = defaultdict(Counter)
    slowest: dict[str, float] = defaultdict(float)
    causes: dict[tuple[str, str, str], list[int]] = defaultdict(list)
    for (name, seed), result in zip(cases, results, strict=True):
        for key in (name, "all"):
            ended[key][result.kind] += 1
            slowest[key] = max(slowest[key], result.seconds)
        if result.kind in FINDINGS:
            causes[name, result.kind, result.cause].append(seed)
    lines = ["| target | cases | " + " | ".join(KINDS.values()) + " | slowest [s] |"]
    lines.append("|---|" + "---:|" * (len(KINDS) + 2))
    for name in [*(one for one in ended if one != "all"), "all"]:
        numbers = [ended[name].total(), *(ended[name][kind] for kind in KINDS)]
        cells = [name, *(f"{one:,}" for one in numbers), f"{slowest[name]:.1f}"]
        lines.append("| " + " | ".join(cells) + " |")
    lines += [
        f"{name}: {kind} {cause}: {len(seeds)} cases, first seeds {', '.join(map(str, seeds[:5]))}"
        for (name, kind, cause), seeds in sorted(causes.items())
    ]
    return "\n".join(lines)


def main() -> None:
    """Run the requested cases; the exit code is 1 if there are findings."""
    from seaid._files import result_folder
    from tests.fuzz.targets import TARGETS

    able = [name for name in TARGETS if name != "hebilog" or find_spec("hebi") is not None]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--target", action="append", choices=TARGETS, help="may be repeated")
    parser.add_argument("--cases", type=int, default=2000, help="in all (default: 2000)")
    parser.add_argument("--seed", type=int, default=0, help="the first of each target (default: 0)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--output", type=Path, default=Path("out/fuzz"), help="for findings")
    given = parser.parse_args()
    output = result_folder(given.output)
    cases = cases_of(given.target or able, given.cases, given.seed)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    begin = time.monotonic()
    results = run_all(cases, min(given.workers, len(cases)), output)
    text = report(cases, results)
    (output / "report.md").write_text(text + "\n", encoding="utf-8")
    print(text)
    print(f"{len(cases):,} cases in {(time.monotonic() - begin) / 60:.1f} minutes")
    if len(cases) == 1 and results[0].kind in FINDINGS:
        print((output / f"{cases[0][0]}-{cases[0][1]}" / "said.txt").read_text(errors="replace"))
    print(f"Results: {output}/")
    sys.exit(any(result.kind in FINDINGS for result in results))


if __name__ == "__main__":
    main()
