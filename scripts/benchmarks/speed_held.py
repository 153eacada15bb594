"""Whether the code is as fast as before: rows of `fast.py`, here and in an earlier commit.

    make bench
    python -m scripts.benchmarks.speed_held --against v0.1 --only identify --only hebi
    python -m scripts.benchmarks.speed_held --claims

The earlier commit is the last tag, or without a tag the newest commit that is a day older than this
one; if that does not start with the packages of this environment, it is the one half as old that
does. Runs of both alternate in one process each. A row that takes more than 1.15 times as long is
measured again, up to three times; it fails if it does so twice. The exit code is then 1.

With `--claims` nothing earlier is measured: the figures of `docs/claims.toml` that are ratios to a
peer in the same process are measured again, and fail if the least of three tries is more than 1.15
times the claim. It takes less than two minutes; a busy machine slows both sides.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2]))

from scripts.benchmarks.fast import ROOT, ROWS, RUNS, SHORT, Tree
from scripts.claims import CLAIMS, runs_of
from scripts.short_form import add_quick, sized

LIMIT, TRIES, FAILURES = 1.15, 3, 2
DAY_S = 86_400


def git(*arguments: str) -> str:
    """Return what a command of git prints, without the last line break."""
    done = subprocess.run(
        ["git", "-C", str(ROOT), *arguments], check=True, capture_output=True, text=True
    )
    return done.stdout.strip()


def earlier_commit() -> str:
    """Return the last tag, or the newest commit that is a day older, if it starts here.

    Otherwise it is the newest one that is half as old, and so on. Exits with what to do if none
    does.
    """
    tags = git("tag", "--merged", "HEAD~1", "--sort=-creatordate").splitlines()
    date = int(git("show", "--no-patch", "--format=%ct", "HEAD"))
    ages = [DAY_S / 2**k for k in range(12)]
    dated = ["rev-list", "-1", "--abbrev-commit"]
    commits = [git(*dated, f"--before={date - age:.0f}", "HEAD~1") for age in ages]
    for commit in dict.fromkeys(filter(None, [*tags[:1], *commits])):
        reason = refusal(commit)
        if not reason:
            return commit
        print(f"{commit} is not compared, because it does not start here: {reason}", flush=True)
    sys.exit(
        "no earlier commit starts with the packages of this environment: install what it needs, or "
        "name one that does, as with make bench BENCH='--against COMMIT'"
    )


def refusal(commit: str) -> str:
    """Return the last line of the error with which the program of a commit ends, "" for none."""
    with checkout(commit) as place:
        done = subprocess.run(
            [sys.executable, "-m", "seaid", "identify", "--help"],
            cwd=place,
            env={**os.environ, "PYTHONPATH": str(place)},
            capture_output=True,
            text=True,
            check=False,
        )
    return (done.stderr.strip().splitlines() or ["no reason"])[-1] if done.returncode else ""


@contextmanager
def checkout(commit: str) -> Iterator[Path]:
    """Check a commit out into a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "seaid"
        git("worktree", "add", "--detach", str(place), commit)
        try:
            yield place
        finally:
            git("worktree", "remove", "--force", str(place))


def ratio(name: str, here: Tree, before: Tree, folder: Path) -> float:
    """Return the median of the times here over those before, after one round that fills caches."""
    rounds = [
        (here.measure(name, folder)[0], before.measure(name, folder)[0])
        for _ in range(sized(RUNS + 1, 1))
    ]
    return statistics.median(now / then for now, then in rounds[-RUNS:])


def ratios(name: str, here: Tree, before: Tree) -> list[float]:
    """Return the ratio of a row, measured again while the answer is open."""
    found: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        while len(found) < TRIES:
            found.append(ratio(name, here, before, Path(folder)))
            slow = sum(value > LIMIT for value in found)
            if slow in (FAILURES, 0) or len(found) - slow > TRIES - FAILURES:
                break
    return found


def main(names: list[str], against: str) -> int:
    """Print a line per row, and return the number of rows that became slower."""
    slower = 0
    with checkout(against) as place:
        trees = Tree(ROOT), Tree(place)
        print(f"{'row':16} {'work':38} time here over time at {against}")
        try:
            for name in names:
                values = ratios(name, *trees)
                failed = sum(value > LIMIT for value in values) >= FAILURES
                slower += failed
                shown = ", ".join(f"{value:.2f}" for value in values)
                print(f"{name:16} {ROWS[name].title:38} {shown}{'  slower' * failed}", flush=True)
        finally:
            for tree in trees:
                tree.close()
    return slower


def claimed() -> dict[str, float]:
    """Return the claims that are ratios to a peer in one process, {row of `fast.py`: figure}."""
    figures = dict[str, float]()
    for run in runs_of((ROOT / CLAIMS).read_text("utf-8")):
        ratios = [claim for claim in run.claims if claim.name == f"{run.name}.ratio"]
        only = re.fullmatch(r"python scripts/benchmarks/fast\.py --only (\w+)", run.command)
        row = ROWS.get(only[1]) if only else None
        if only and row and row.prepare is not None and "over" in row.how and ratios:
            figures[only[1]] = float(ratios[0].figure)
    return figures


def claims_held() -> int:
    """Print each claimed ratio, measured again, and return the number of those that are larger."""
    tree, larger = Tree(ROOT), 0
    print(f"{'row':16} {'work':38} claimed   measured, least of at most {TRIES}")
    try:
        for name, figure in claimed().items():
            ratio, tries = math.inf, 0
            while tries < TRIES and ratio > LIMIT * figure:
                # Times of work and peer each at its best: what else runs makes them only longer.
                rounds = [tree.measure(name, ROOT) for _ in range(RUNS)]
                work, peer = (min(times) for times in zip(*rounds, strict=True))
                ratio, tries = min(ratio, work / peer), tries + 1
            failed = ratio > LIMIT * figure
            larger += failed
            text = f"{name:16} {ROWS[name].title:38} {figure:7g}   {ratio:.3g}"
            print(text + "  larger" * failed, flush=True)
    finally:
        tree.close()
    return larger


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", action="append", choices=list(ROWS), help="may be repeated")
    parser.add_argument("--against", metavar="COMMIT", help="a tag or a commit")
    parser.add_argument("--claims", action="store_true", help="the claimed ratios, in one process")
    add_quick(parser)
    options = parser.parse_args()
    if options.claims:
        sys.exit(claims_held() > 0 and not options.quick)
    chosen = options.only or sized([name for name in ROWS if ROWS[name].needs is None], SHORT[:1])
    failures = main(chosen, options.against or earlier_commit())
    sys.exit(failures > 0 and not options.quick)  # figures of the short form mean nothing
