"""The golden results: what seaid finds today, and what a change of the code makes of it.

    python scripts/golden.py                                   writes out/golden.json.gz
    python scripts/golden.py --against tests/data/golden.json.gz
    python scripts/golden.py --against tests/data/golden.json.gz --move

The cases are those of `scripts/golden_cases.py`, and what is kept of each is in
`scripts/golden_records.py`. With `--against` a table of differences by group is printed. After a
re-derivation (the default) values may differ by 0.02 standard errors and standard errors by 3 %;
code lists are equal. After a `--move` everything is equal to 1e-9. The script ends with 1 if there
are differences other than those of records that are known to be wrong.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
import os
import sys
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatchcase
from multiprocessing import get_context
from pathlib import Path

# sums of several threads are rounded in another order
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.golden_cases import GROUPS, KNOWN_WRONG, cases
from scripts.golden_records import Case, KnownWrong, Record, Records, number, of_error
from seaid._files import write_whole
from seaid.errors import SeaidError, SeaidWarning
from seaid.report import table

FORMAT, VERSION = "seaid golden", 1
WRONG = "known wrong"


@dataclass(frozen=True)
class Tolerance:
    """What two results may differ by: `shift` in standard errors, the others relative."""

    shift: float
    spread: float
    number: float


MOVE = Tolerance(shift=1e-9, spread=1e-9, number=1e-9)
REDERIVATION = Tolerance(shift=0.02, spread=0.03, number=1e-3)
"""0.1 % of numbers without a standard error: cutoffs, errors of predictions, numbers in files."""

_ROUNDING, _TINY = 1e-9, 1e-12
"""Relative difference that is always allowed, and the size of numbers that are zero."""


@dataclass(frozen=True)
class CaseResult:
    """The records of a case, its group, and its processor time [s]."""

    group: str
    records: Records
    seconds: float = 0.0


@dataclass(frozen=True)
class Golden:
    """All results, with the list of records that are known to be wrong."""

    cases: Mapping[str, CaseResult]
    known_wrong: tuple[KnownWrong, ...] = KNOWN_WRONG


@dataclass(frozen=True)
class Difference:
    """One difference; the group of records known to be wrong is `WRONG`."""

    group: str
    case: str
    record: str
    kind: str
    before: str = ""
    now: str = ""
    reason: str = ""


def results_of(case: Case) -> CaseResult:
    """Return the records of a case; an exception becomes a record."""
    begin = time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            records = dict(case.records())
        except Exception as problem:
            records = of_error(problem)
    own = [issubclass(warning.category, SeaidWarning) for warning in caught]
    for name, count in (("warnings of seaid", sum(own)), ("other warnings", own.count(False))):
        records |= {name: number(count)} if count else {}
    return CaseResult(case.group, records, time.process_time() - begin)


def _batch_results(names: Sequence[str]) -> dict[str, CaseResult]:
    known = {case.name: case for case in cases()}
    return {name: results_of(known[name]) for name in names}


def run(chosen: Sequence[Case], workers: int = 2) -> Golden:
    """Return the results of cases, computed in several processes, one batch per task."""
    batches: dict[str, list[str]] = {}
    for case in chosen:
        batches.setdefault(case.batch or case.name, []).append(case.name)
    found: dict[str, CaseResult] = {}
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        tasks = {pool.submit(_batch_results, names): names for names in batches.values()}
        for done, task in enumerate(as_completed(tasks), 1):
            problem = task.exception()  # the process died
            if problem is None:
                found |= task.result()
            else:
                groups = {case.name: case.group for case in chosen}
                found |= {x: CaseResult(groups[x], of_error(problem)) for x in tasks[task]}
            if sys.stderr.isatty():
                print(f"\r{done} of {len(tasks)} batches", end="", file=sys.stderr)
    return Golden({case.name: found[case.name] for case in chosen})


def write_golden(path: str | Path, golden: Golden) -> None:
    """Write results as compressed JSON; the same results are the same bytes."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "known_wrong": [asdict(wrong) for wrong in golden.known_wrong],
        "cases": {
            name: {"group": one.group, "records": one.records}
            for name, one in sorted(golden.cases.items())
        },
    }
    data = json.dumps(content, separators=(",", ":"), sort_keys=True).encode()
    write_whole(path, gzip.compress(data, 9, mtime=0))


def read_golden(path: str | Path) -> Golden:
    """Read results. Raises SeaidError for a file that is not one of this version."""
    try:
        content = json.loads(gzip.decompress(Path(path).read_bytes()))
    except (OSError, EOFError, zlib.error, ValueError) as problem:
        raise SeaidError(
            f"'{path}' cannot be read as a golden file ({problem}): write it anew with "
            "scripts/golden.py"
        ) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise SeaidError(
            f"'{path}' is no golden file (its format is not '{FORMAT}'): write it anew with "
            "scripts/golden.py"
        )
    if content.get("version") != VERSION:
        raise SeaidError(
            f"'{path}' is a golden file of version {content.get('version')}, and this script "
            f"reads version {VERSION}: write it anew with scripts/golden.py"
        )
    try:
        return Golden(
            {name: CaseResult(**one) for name, one in content["cases"].items()},
            tuple(KnownWrong(**wrong) for wrong in content["known_wrong"]),
        )
    except (KeyError, TypeError, AttributeError):
        raise SeaidError(f"'{path}' is damaged: write it anew with scripts/golden.py") from None


def differences(before: Golden, now: Golden, tolerance: Tolerance) -> list[Difference]:
    """Return what differs between two golden results."""
    found = []
    for name in [*before.cases, *(name for name in now.cases if name not in before.cases)]:
        old, new = before.cases.get(name), now.cases.get(name)
        if old is None or new is None:
            group = (old or new or CaseResult("", {})).group
            found.append(Difference(group, name, "", "missing" if new is None else "additional"))
        else:
            found += _of_case(name, old, new, tolerance)
    return [_with_reason(one, before.known_wrong) for one in found]


def _with_reason(difference: Difference, known: Iterable[KnownWrong]) -> Difference:
    for wrong in known:
        names = (difference.case, wrong.case), (difference.record, wrong.record)
        if all(fnmatchcase(name, pattern) for name, pattern in names):
            return replace(difference, group=WRONG, reason=wrong.reason)
    return difference


def _of_case(
    name: str, old: CaseResult, new: CaseResult, tolerance: Tolerance
) -> Iterator[Difference]:
    for key in [*old.records, *(key for key in new.records if key not in old.records)]:
        before, now = old.records.get(key), new.records.get(key)
        for kind, *shown in _of_record(before, now, tolerance):
            yield Difference(old.group, name, key, kind, *shown)


def _of_record(
    before: Record | None, now: Record | None, tolerance: Tolerance
) -> Iterator[tuple[str, str, str]]:
    """Yield kind, old and new text of the differences of a record."""
    if before is None or now is None:
        kind = "missing" if now is None else "additional"
        is_code = (before or now or [""])[0] == "codes"
        yield "codes" if is_code else kind, _shown(before), _shown(now)
    elif before[0] != now[0]:
        yield "kind", _shown(before), _shown(now)
    else:
        for kind in _COMPARED[before[0]](before, now, tolerance):
            shown = _worst_number if kind == "number in a file" else _both_shown
            yield kind, *shown(before, now)


def _both_shown(before: Record, now: Record) -> tuple[str, str]:
    return _shown(before), _shown(now)


def _values(before: Record, now: Record, tolerance: Tolerance) -> Iterator[str]:
    (_, x, s), (_, y, r) = before, now
    if not _close(x, y, _ROUNDING, tolerance.shift * abs(s)):
        yield "value"
    if not _close(s, r, tolerance.spread, _ROUNDING * _ROUNDING * abs(x)):
        yield "standard error"


def _close(x: float, y: float, relative: float, absolute: float) -> bool:
    if not (math.isfinite(x) and math.isfinite(y)):
        return x == y or (math.isnan(x) and math.isnan(y))
    allowed = absolute if math.isfinite(absolute) else 0.0
    return abs(x - y) <= max(relative * max(abs(x), abs(y)), allowed)


def _numbers(before: Record, now: Record, tolerance: Tolerance) -> Iterator[str]:
    if not _close(before[1], now[1], tolerance.number, _TINY):
        yield "number"


def _texts(before: Record, now: Record, tolerance: Tolerance) -> Iterator[str]:
    if before[1] != now[1]:
        yield before[0]


def _files(before: Record, now: Record, tolerance: Tolerance) -> Iterator[str]:
    (_, sha, form, numbers), (_, new_sha, new_form, new_numbers) = before, now
    if form != new_form or len(numbers) != len(new_numbers):
        yield "text of a file"
    elif not all(
        _close(x, y, tolerance.number, _TINY) for x, y in zip(numbers, new_numbers, strict=True)
    ):
        yield "number in a file"
    elif sha != new_sha and numbers == new_numbers:
        yield "formatting"


_COMPARED = {
    "value": _values,
    "number": _numbers,
    "text": _texts,
    "codes": _texts,
    "file": _files,
}


def _shown(record: Record | None) -> str:
    """Return a record in a few words."""
    if record is None:
        return "-"
    kind, *content = record
    if kind == "value":
        return f"{content[0]:.6g} +- {content[1]:.3g}"
    if kind == "number":
        return f"{content[0]:.9g}"
    if kind == "codes":
        return ", ".join(content[0]) or "none"
    if kind == "file":
        return f"{content[0][:8]}, {len(content[2])} numbers"
    return str(content[0])


def _worst_number(before: Record, now: Record) -> tuple[str, str]:
    """Return the number of two files that differs most, relative to its size."""
    pairs = list(zip(before[3], now[3], strict=True))
    off = [abs(x - y) / max(abs(x), abs(y), _TINY) for x, y in pairs]
    place = off.index(max(off))
    return f"number {place}: {pairs[place][0]:.9g}", f"{pairs[place][1]:.9g}"


def table_of(found: Collection[Difference], most: int = 10) -> str:
    """Return the table of differences by group, and the first ones of each group in full."""
    if not found:
        return "No differences."
    kinds = sorted({one.kind for one in found})
    counts = Counter((one.group, one.kind) for one in found)
    groups = sorted({one.group for one in found}, key=lambda group: (group == WRONG, group))
    rows = [[group, *(str(counts[group, kind] or "") for kind in kinds)] for group in groups]
    lines = [str(table("Differences", ["group", *kinds], rows))]
    for group in groups:
        members = [one for one in found if one.group == group]
        lines += [f"\n{group}:", *map(_line, members[:most])]
        lines += [f"  ... and {len(members) - most} more (--all)"] * (len(members) > most)
    return "\n".join(lines)


def _line(one: Difference) -> str:
    record = f", {one.record}" if one.record else ""
    values = f": {one.before} -> {one.now}" if one.before or one.now else ""
    reason = f" [known wrong: {one.reason}]" if one.reason else ""
    return f"  {one.case}{record}: {one.kind}{values}{reason}"


def chosen_cases(only: Sequence[str], quick: bool) -> list[Case]:
    """Return the cases of some groups (default: all), or the quick ones."""
    return [
        case for case in cases() if (not only or case.group in only) and (case.quick or not quick)
    ]


def _restricted(golden: Golden, only: Sequence[str], names: Collection[str] | None) -> Golden:
    kept = {
        name: one
        for name, one in golden.cases.items()
        if (not only or one.group in only) and (names is None or name in names)
    }
    return replace(golden, cases=kept)


def main(arguments: argparse.Namespace) -> int:
    """Run the cases, write them, and compare them with a file."""
    only = arguments.only or []
    before = read_golden(arguments.against) if arguments.against else None
    begin = time.perf_counter()
    if arguments.results:
        golden = _restricted(read_golden(arguments.results), only, None)
    else:
        golden = run(chosen_cases(only, arguments.quick), arguments.workers)
        spent = Counter[str]()
        for one in golden.cases.values():
            spent[one.group] += one.seconds  # type: ignore[assignment]
        write_golden(arguments.output, golden)
        rows = [[group, f"{seconds:.0f}"] for group, seconds in spent.most_common()]
        rows.append(["all", f"{sum(spent.values()):.0f}"])
        print(table("Processor time [s]", ["group", "time"], rows))
        print(f"{time.perf_counter() - begin:.0f} s. Results: {arguments.output}")
    if before is None:
        return 0
    names = set(golden.cases) if arguments.quick else None
    found = differences(
        _restricted(before, only, names), golden, MOVE if arguments.move else REDERIVATION
    )
    print(table_of(found, sys.maxsize if arguments.all else 10))
    return int(any(one.group != WRONG for one in found))


def arguments_of(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--against", type=Path, help="golden file to compare with")
    parser.add_argument("--move", action="store_true", help="compare to 1e-9")
    parser.add_argument("--only", nargs="+", choices=GROUPS, help="groups")
    parser.add_argument("--quick", action="store_true", help="a cheap case or two per group")
    parser.add_argument("--all", action="store_true", help="print all differences")
    parser.add_argument("--results", type=Path, help="compare this golden file, and run nothing")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--output", type=Path, default=Path("out/golden.json.gz"), help="file")
    return parser.parse_args(words)


if __name__ == "__main__":
    try:
        sys.exit(main(arguments_of()))
    except SeaidError as error:
        sys.exit(f"error: {error}")
