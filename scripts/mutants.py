"""What the quick tests hold of the code: changes of an operator or number that they do not notice.

    python scripts/mutants.py --count 400 --workers 2
    python scripts/mutants.py --count 20 --only estimation

A mutant is the package with one change: a comparison or an arithmetic operator by its opposite, a
number by another, a condition by its negation. In a copy of the project it runs the quick tests
that execute the changed line, until one fails: short ones first, those of its own folder before
others, and at the end all else in their files, which may share what they computed. Which tests
execute a line is measured once for a commit. That and the results are kept in out/mutants: a run
that was stopped goes on where it was. Survivors are listed: each is a test that lacks, code that
does nothing, or a change without an effect (`<` and `<=` of two floats).
"""

from __future__ import annotations

import argparse
import ast
import copy
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import cache_from_source
from multiprocessing import get_context
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]

MUTATED = ("seaid/estimation", "seaid/regressor", "seaid/checks/engine.py")
"""What is mutated: the code that decides what every estimate and finding is."""

OWN_TESTS = {
    "seaid/estimation": ("tests/estimation/",),
    "seaid/regressor": ("tests/regressor/", "tests/symbolic/", "tests/robot/"),
    "seaid/checks": ("tests/checks/",),
}
"""{folder: tests that run before others, and all of them where none executes the line}."""

QUICK = ("-q", "-p", "no:cacheprovider", "-m", "not slow and not browser")

SHORT_S, FIRST_BATCH_S, COLLECTED_S = 0.5, 4.0, 0.3
"""Tests that take longer run last; how long the first of them take, and to collect a file."""

LONGEST_S = 30.0
"""Processor time that a mutant may take besides thrice that of its tests: it is killed then."""

LOADED = ("numpy", "scipy.optimize", "scipy.signal", "sympy", "pinocchio", "flint")
"""What is imported once for all mutants."""

OPPOSITE: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
}


Line = tuple[str, int]
"""The path of a file and a number."""

Row = dict[str, Any]
"""What is kept of a file of tests, or of a mutant: its name is `of`."""


@dataclass(frozen=True)
class Mutant:
    """A change of a file: its place, the code there before and after, and the whole text after."""

    file: str
    line: int
    column: int
    before: str
    after: str
    text: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}: {self.before}  ->  {self.after}"


def mutated(node: ast.AST) -> ast.AST | None:
    """Return the mutant of an expression, None for one that has none."""
    changed = copy.deepcopy(node)
    match changed:
        case ast.Compare(ops=[operator]) if type(operator) in OPPOSITE:
            changed.ops = [OPPOSITE[type(operator)]()]  # type: ignore[list-item]
        case ast.BinOp() | ast.BoolOp() if type(changed.op) in OPPOSITE:
            changed.op = OPPOSITE[type(changed.op)]()  # type: ignore[assignment]
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            return changed.operand
        case ast.IfExp():
            changed.body, changed.orelse = changed.orelse, changed.body
        case ast.Constant(value=bool()):
            changed.value = not changed.value
        case ast.Constant(value=int() | float() as number):
            changed.value = number + 1
        case _:
            return None
    return changed


def mutants(file: str) -> Iterator[Mutant]:
    """Yield all mutants of a file, but for texts and annotations."""
    text = (ROOT / file).read_text()
    lines = text.splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line.encode()))
    encoded = text.encode()
    for node in expressions(ast.parse(text)):
        changed = mutated(node)
        if changed is None:
            continue
        assert isinstance(node, ast.expr)
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        before, after = encoded[start:end].decode(), f"({ast.unparse(changed)})"
        whole = (encoded[:start] + after.encode() + encoded[end:]).decode()
        yield Mutant(file, node.lineno, node.col_offset, " ".join(before.split()), after, whole)


def expressions(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes below one without annotations, and without the parts of formatted texts."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list") or isinstance(node, ast.JoinedStr):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield child
                yield from expressions(child)


def lines_of(mutant: Mutant) -> set[Line]:
    """Return the lines whose tests may notice a mutant: those of its statement.

    What is executed when a module is imported is executed by no test. For the default of an
    argument these are the lines of its function, for a constant or a field those with its name.
    """
    around = [
        statement
        for statement in ast.walk(ast.parse((ROOT / mutant.file).read_text()))
        if isinstance(statement, ast.stmt)
        and statement.lineno <= mutant.line <= (statement.end_lineno or mutant.line)
    ]
    innermost = max(around, key=lambda statement: statement.lineno)
    first, last = innermost.lineno, innermost.end_lineno or mutant.line
    if not any(isinstance(statement, ast.FunctionDef) for statement in around):
        names = {name.id for name in ast.walk(innermost) if isinstance(name, ast.Name)}
        words = re.compile(rf"\b({'|'.join(names)})\b")
        return {
            (file, number)
            for file in files_of(MUTATED)
            for number, text in enumerate((ROOT / file).read_text().splitlines(), 1)
            if words.search(text)
        }
    if isinstance(innermost, ast.FunctionDef):
        first = innermost.body[0].lineno
    elif body := getattr(innermost, "body", None):
        last = max(mutant.line, body[0].lineno - 1)
    return {(mutant.file, number) for number in range(first, last + 1)}


def files_of(places: Iterable[str], part: str = "") -> list[str]:
    """Return the Python files of files and folders whose path has a part."""
    paths = [
        path
        for place in places
        for path in ([ROOT / place] if place.endswith(".py") else (ROOT / place).rglob("*.py"))
    ]
    return sorted(str(path.relative_to(ROOT)) for path in paths if part in str(path))


@cache
def own_copy(folder: str) -> Path:
    """Make the copy of the project of this process, which works in it from then on."""
    tree = Path(folder) / str(os.getpid())
    skipped = shutil.ignore_patterns(".git", ".venv", "out", "__pycache__", ".*_cache")
    shutil.copytree(ROOT, tree, ignore=skipped)
    os.chdir(tree)
    os.environ |= {"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
    original = {str(ROOT), str(ROOT / "scripts")}
    sys.path[:] = [str(tree), *(path for path in sys.path if path not in original)]
    for name in LOADED:
        import_module(name)
    return tree


def in_child(work: Callable[[], int], longest_s: float) -> int:
    """Return the exit code of a process that does some work, in so much processor time at most.

    It leads a group of processes: what it started ends with it.
    """
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_CPU, (int(longest_s), int(longest_s) + 5))
            nowhere = os.open(os.devnull, os.O_RDWR)
            for stream in range(3):
                os.dup2(nowhere, stream)
            code = int(work())
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(status)


class Recorder:
    """A plugin of pytest that measures which lines each test executes, and its seconds."""

    def __init__(self, tree: Path) -> None:
        self.files = {str(tree / file): file for file in files_of(MUTATED)}
        self.lines: set[Line] = set()
        self.tests: dict[str, dict[str, Any]] = {}

    def trace(self, frame: FrameType, *_: object) -> Callable[..., Any] | None:
        """Note a line of the mutated files; all other functions run at their full speed."""
        file = self.files.get(frame.f_code.co_filename)
        if file is None:
            return None
        self.lines.add((file, frame.f_lineno))
        return self.trace

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Measure one test, and forget one that is skipped or fails without a change."""
        begin, self.lines, self.passed = sum(os.times()[:4]), set(), True
        sys.settrace(self.trace)
        result = yield
        sys.settrace(None)
        seconds = round(sum(os.times()[:4]) - begin, 2)
        if self.passed:
            self.tests[item.nodeid] = {"seconds": seconds, "lines": sorted(self.lines)}
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note whether set-up, test and end pass."""
        self.passed &= report.passed


@dataclass
class Chosen:
    """A plugin of pytest that runs some of the tests, in their order, and notes which one fails."""

    tests: Sequence[str]
    failed: str = ""

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep the tests that are to run."""
        ranks = {test: rank for rank, test in enumerate(self.tests)}
        items[:] = [item for item in items if item.nodeid in ranks]
        items.sort(key=lambda item: ranks[item.nodeid])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note the test that fails."""
        if report.failed:
            self.failed = report.nodeid


def measured(job: tuple[str, str]) -> Row:
    """Return what the recorder measures of a file of tests, in the copy in a folder."""
    folder, file = job
    tree = own_copy(folder)
    shutil.rmtree(tree / ".pytest_cache", ignore_errors=True)  # simulations of other files
    result = tree / "measured.json"
    result.write_text("{}")

    def work() -> int:
        recorder = Recorder(tree)
        code = pytest.main([file, *QUICK], plugins=[recorder])
        result.write_text(json.dumps(recorder.tests))
        return code

    in_child(work, 1200.0)
    return {"of": file, "tests": json.loads(result.read_text())}


class Coverage:
    """Which tests execute a line, and their seconds."""

    def __init__(self, measurements: Iterable[Row]) -> None:
        self.seconds: dict[str, float] = {}
        self.tests: dict[Line, set[str]] = defaultdict(set)
        for measurement in measurements:
            for test, values in measurement["tests"].items():
                self.seconds[test] = values["seconds"]
                for file, line in values["lines"]:
                    self.tests[file, line].add(test)

    def batches(self, mutant: Mutant) -> list[tuple[float, list[str]]]:
        """Return the tests that may notice a mutant in their order, after the seconds they take.

        Each batch is four times as long as the one before. What is computed once in a process, in
        a fixture or for `kept`, is executed by the first test only: the last batch has the others
        of its file.
        """
        own = next(tests for place, tests in OWN_TESTS.items() if mutant.file.startswith(place))
        tests = {test for line in lines_of(mutant) for test in self.tests[line]}
        if not any(test.startswith(own) for test in tests):  # what runs once, at an import
            tests |= {test for test in self.seconds if test.startswith(own)}
        cost: dict[str, float] = defaultdict(float)
        for test in tests:
            cost[file_of(test)] += self.seconds[test]

        def rank(test: str) -> tuple[bool, bool, float, str]:
            file = file_of(test)
            return self.seconds[test] > SHORT_S, not test.startswith(own), cost[file], file

        batches: list[list[str]] = [[]]
        longest, total, files = FIRST_BATCH_S, 0.0, set[str]()
        for test in sorted(tests, key=rank):
            total += self.seconds[test] + COLLECTED_S * (file_of(test) not in files)
            if batches[-1] and total > longest:
                batches.append([])
                longest, total, files = 4 * longest, 0.0, set()
            batches[-1].append(test)
            files.add(file_of(test))
        rest = [test for test in self.seconds if test not in tests and file_of(test) in cost]
        batches.append(rest)
        return [(sum(map(self.seconds.__getitem__, batch)), batch) for batch in batches if batch]


def file_of(test: str) -> str:
    """Return the file of a test."""
    return test.partition("::")[0]


def result_of(job: tuple[str, tuple[Mutant, list[tuple[float, list[str]]]]]) -> Row:
    """Return what kills a mutant ("": nothing), how many tests were tried, and how long it took."""
    folder, (mutant, batches) = job
    tree = own_copy(folder)
    begin, count, killer = time.monotonic(), 0, ""
    file, failed = tree / mutant.file, tree / "failed.txt"
    original = file.read_text()
    file.write_text(mutant.text)
    for seconds, batch in batches:
        failed.write_text("")

        def work(batch: list[str] = batch) -> int:
            plugin = Chosen(batch)
            code = pytest.main(
                [*dict.fromkeys(map(file_of, batch)), "-x", *QUICK], plugins=[plugin]
            )
            failed.write_text(plugin.failed)
            return code

        count += len(batch)
        code = in_child(work, LONGEST_S + 3.0 * seconds)
        if code not in (0, 5):  # 5: no test
            killer = failed.read_text() or f"exit code {code}"
            break
    file.write_text(original)
    # The next one has a cache of simulations of its own, and bytecode is known by its second only.
    shutil.rmtree(tree / ".pytest_cache", ignore_errors=True)
    Path(cache_from_source(str(file))).unlink(missing_ok=True)
    took = round(time.monotonic() - begin, 1)
    return {"of": str(mutant), "killer": killer, "tests": count, "seconds": took}


def main() -> None:
    """Print the survivors of random mutants, and the shares that the tests kill."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", default="", help="part of the path of the mutated files")
    parser.add_argument("--tests", default="", help="part of the path of the tests that run")
    parser.add_argument("--output", type=Path, help="folder of results (out/mutants/COMMIT)")
    options = parser.parse_args()
    files = files_of(MUTATED, options.only)
    every = [mutant for file in files for mutant in mutants(file)]
    chosen = random.Random(options.seed).sample(every, min(options.count, len(every)))
    print(f"{len(chosen)} of {len(every)} mutants of {len(files)} files, seed {options.seed}")
    kept = options.output or ROOT / "out" / "mutants" / commit()
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, get_context("fork").Pool(options.workers) as pool:

        def all_of(name: str, work: Callable[[Any], Row], jobs: dict[str, Any]) -> dict[str, Row]:
            """Return the rows of a kept file, {job: row}, after those that lack were made."""
            path = kept / name
            path.touch()
            rows = {row["of"]: row for row in map(json.loads, path.read_text().splitlines())}
            lacking = ((folder, job) for key, job in jobs.items() if key not in rows)
            with path.open("a") as stream:
                for row in pool.imap_unordered(work, lacking):
                    print(json.dumps(row), file=stream, flush=True)
                    rows[row["of"]] = row
            return rows

        tests = {file: file for file in files_of(["tests"], options.tests) if "/test_" in file}
        coverage = Coverage(all_of("tests.jsonl", measured, tests).values())
        jobs = {str(mutant): (mutant, coverage.batches(mutant)) for mutant in chosen}
        rows = all_of("results.jsonl", result_of, jobs)
    survivors = [mutant for mutant in chosen if not rows[str(mutant)]["killer"]]
    for mutant in survivors:
        print(f"survived: {mutant}")
    for place in (*MUTATED, ""):
        count = sum(mutant.file.startswith(place) for mutant in chosen)
        killed = count - sum(mutant.file.startswith(place) for mutant in survivors)
        print(f"{place or 'all'}: {killed} of {count} killed, {killed / max(count, 1):.1%}")


def commit() -> str:
    """Return the short name of the commit whose code is mutated."""
    command = ["git", "rev-parse", "--short", "HEAD"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return run.stdout.strip()


if __name__ == "__main__":
    main()
