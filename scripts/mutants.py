"""What the quick tests hold of the code: changes of an operator or number that they do not notice.

    python scripts/mutants.py --count 400 --workers 2
    python scripts/mutants.py --count 20 --only estimation

A mutant is the package with one change: a comparison or an arithmetic operator by its opposite, a
number by another, a condition by its negation. Each runs the quick tests, those of its own folder
first, until one fails, in a copy of the project. Survivors are listed: each is a test that lacks,
code that does nothing, or a change without an effect (`<` and `<=` of two floats).
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

ROOT = Path(__file__).resolve().parents[1]

MUTATED = ("seaid/estimation", "seaid/regressor", "seaid/checks/engine.py")
"""What is mutated: the code that decides what every estimate and finding is."""

OWN_TESTS = {
    "seaid/estimation": ("tests/estimation",),
    "seaid/regressor": ("tests/regressor", "tests/symbolic"),
    "seaid/checks": ("tests/checks",),
}
"""{folder: tests that run first}; all others follow."""

LONGEST_S = 1200.0
"""A mutant that runs longer is killed: an endless loop is noticed by everybody."""

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


@dataclass(frozen=True)
class Mutant:
    """A change of a file: its line, the code there before and after, and the whole text after."""

    file: Path
    line: int
    before: str
    after: str
    text: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.before}  ->  {self.after}"


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


def mutants(file: Path) -> Iterator[Mutant]:
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
        yield Mutant(file, node.lineno, " ".join(before.split()), after, whole)


def expressions(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes below one without annotations, and without the parts of formatted texts."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list") or isinstance(node, ast.JoinedStr):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield child
                yield from expressions(child)


def is_killed(mutant: Mutant, tree: Path) -> bool:
    """Whether a test fails in a copy of the project that has the mutant."""
    target = tree / mutant.file
    original = target.read_text()
    target.write_text(mutant.text)
    first = next(
        tests for folder, tests in OWN_TESTS.items() if str(mutant.file).startswith(folder)
    )
    others = sorted(f"tests/{path.name}" for path in (tree / "tests").iterdir() if is_tests(path))
    environment = {**os.environ, "PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
    options = ("-x", "-q", "-p", "no:cacheprovider", "-m", "not slow and not browser")
    try:
        for tests in (first, [path for path in others if path not in first]):
            command = [sys.executable, "-m", "pytest", *options, *tests]
            run = subprocess.run(
                command, cwd=tree, env=environment, capture_output=True, timeout=LONGEST_S
            )
            if run.returncode != 0:
                return True
    except subprocess.TimeoutExpired:
        return True
    finally:
        target.write_text(original)
    return False


def is_tests(path: Path) -> bool:
    """Whether a path is a folder of tests, or a file of them."""
    if path.is_dir():
        return any(path.rglob("test_*.py"))
    return path.name.startswith("test_") and path.suffix == ".py"


def main() -> None:
    """Print the survivors of random mutants, and the share that the tests kill."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", default="", help="part of the path of the mutated files")
    options = parser.parse_args()
    files = [
        path.relative_to(ROOT)
        for place in MUTATED
        for path in sorted(
            [ROOT / place] if place.endswith(".py") else (ROOT / place).rglob("*.py")
        )
        if options.only in str(path)
    ]
    every = [mutant for file in files for mutant in mutants(file)]
    chosen = random.Random(options.seed).sample(every, min(options.count, len(every)))
    print(f"{len(chosen)} of {len(every)} mutants of {len(files)} files, seed {options.seed}")
    with tempfile.TemporaryDirectory() as folder:
        trees: Queue[Path] = Queue()
        for place in range(options.workers):
            tree = Path(folder) / str(place)
            skipped = shutil.ignore_patterns(".git", ".venv", "out", "__pycache__", ".*_cache")
            shutil.copytree(ROOT, tree, ignore=skipped)
            trees.put(tree)

        def tried(mutant: Mutant) -> bool:
            tree = trees.get()
            try:
                return is_killed(mutant, tree)
            finally:
                trees.put(tree)

        killed = 0
        with ThreadPoolExecutor(options.workers) as pool:
            for mutant, is_dead in zip(chosen, pool.map(tried, chosen), strict=True):
                killed += is_dead
                if not is_dead:
                    print(f"survived: {mutant}", flush=True)
    print(f"{killed} of {len(chosen)} killed, {killed / max(len(chosen), 1):.0%}")


if __name__ == "__main__":
    main()
