"""Measure the figures of README and documents again by their commands, from `docs/claims.toml`.

    python -m scripts.claims --pages     # compare the pages with the file; nothing is run
    python -m scripts.claims --quick     # and run the commands of at most 20 s
    python -m scripts.claims [RUN ...]   # and run all commands, or those of the named runs
    python -m scripts.claims --write     # write new figures into the file, and all into the pages

In goes `docs/claims.toml`. Each of its tables is a run: a command, the time that it takes [s],
and the date of its figures. Each table inside a run is a claim: what is claimed, its
figure, how far a new run may be off, and a regular expression whose group is the figure in the
output of the command. Figures from outside, as of a data sheet, have a `source` in place of the
command. In a page a figure stands between marks,
`<!--=tulip.hip_stiffness-->83090<!--=-->`, and `tulip.date` is the date of a run. A run with a
`capability` is a row of the table of docs/comparison.md.

Out go the problems, one per line: a page that differs from the file, a name that is not there, a
figure that no page has, a run that fails, ends late, prints no figure or several, or another one.
The exit code is 1 if there is one.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import date
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CLAIMS = "docs/claims.toml"
WITHIN_REACH = ("docs", "models", "pyproject.toml", "scripts", "seaid", "tests")
"""What a command finds in its folder, which is empty otherwise."""

QUICK_S = 20.0
"""The longest run of --quick, on a quiet machine [s]."""

PATIENCE = 10.0
"""How many times longer a run may take on a busy machine, before it is ended."""

PEERS = {"figaroh": "figaroh", "mujoco_sysid": "mujoco.sysid", "FloBaRoID": "FloBaRoID"}
"""The other packages of the table of capabilities, by their keys; more columns are not readable."""

MARK = re.compile(r"<!--=([\w.]+)-->((?:(?!<!--=).)*)<!--=-->", re.DOTALL)
TABLE = "capabilities"
STATED = "stated"
"""The list of figures that no run measures; the only one of the file that is no run."""

PAGES = re.compile(r"README\.md|docs/(?:results|comparison|how_to/\w+)\.md")
"""Pages on which a figure with a unit has a mark, or a reason in the list of stated ones."""

NO_FIGURES = re.compile(
    r"^```.*?^```|<!--=[\w.]+-->.*?<!--=-->|`[^`\n]*`|\]\([^)]*\)"
    r"|95 % (?:intervals?|ranges)|^\*Within \d+ % ",
    re.DOTALL | re.MULTILINE,
)
"""Code, marks, targets of links, the name of an interval, and the tolerance of code above it."""

_WITH_UNIT = (
    r"(?<![\w^.])(?:\d(?:[\d.,]*\d)?|two|three|four|five|six|ten)[\s-]?"
    r"(?:%|(?:[kM]?Hz|[kMG]B|[mu]?s|m?rad|mm?|k?g|k?N|m?A|V|W|K|times|seconds?|minutes?|hours?)\b)"
)
_DECIMAL = r"(?<![\w^.])\d+\.\d+(?![.\w])"
WORDS = 60
"""How many letters of a text a message has, which may be a table."""


class ClaimError(Exception):
    """A claim that cannot be measured, with the reason."""


@dataclass(frozen=True)
class Claim:
    """A figure: what is claimed, how far a run may be off, and where a run prints it.

    `within` is a share of the figure, "2 %", or a number in the unit of the figure. A figure from
    outside has neither.
    """

    name: str
    claim: str
    figure: str
    within: str = "0"
    prints: str = "()"

    def __post_init__(self) -> None:
        """Refuse a tolerance that is no number, and an expression without exactly one group."""
        if not all(isinstance(value, str) for value in vars(self).values()):
            raise TypeError(f"{self.name}: figure, within, prints and claim have to be text")
        float(self.within.removesuffix("%"))
        if re.compile(self.prints).groups != 1:
            raise ValueError(f"{self.prints!r} has to have one group, the figure")

    def agrees(self, printed: str) -> bool:
        """Return whether a printed figure is within the tolerance; words have to be the same."""
        try:
            claimed, measured = float(self.figure), float(printed)
        except ValueError:
            return self.figure == printed
        share = self.within.removesuffix("%")
        allowed = float(share) / 100 * abs(claimed) if share != self.within else float(share)
        return abs(measured - claimed) <= allowed * (1 + 1e-9)

    def printed_in(self, output: str) -> str:
        """Return the figure in the output of the command: exactly one is there."""
        figures = re.findall(self.prints, output, re.MULTILINE)
        if len(figures) != 1:
            raise ClaimError(f"{self.name}: the command prints {len(figures)} figures, not one")
        return str(figures[0])


@dataclass(frozen=True)
class Run:
    """A command with its claims; with a `capability`, a row of the table of docs/comparison.md.

    `needs` is a package that the command needs and the project does not; `shows` is a regular
    expression that its output has to contain. Without a command there is the `source` of figures
    that seaid does not measure.
    """

    name: str
    command: str
    seconds: float
    date: date
    claims: tuple[Claim, ...] = ()
    source: str = ""
    needs: str = ""
    shows: str = ""
    capability: str = ""
    peers: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse a time that is none, and claims that nothing measures and no source states."""
        if not isinstance(self.date, date):
            raise TypeError(f"{self.name}: date has to be a day such as 2026-11-30")
        if not isinstance(self.seconds, int | float) or self.seconds < 0:
            raise TypeError(f"{self.name}: seconds has to be a positive number, {self.seconds!r}")
        if bool(self.command) != (self.seconds > 0):
            raise ValueError(f"{self.name}: a command has its seconds, and nothing else has any")
        if self.claims and bool(self.command) == bool(self.source):
            raise ValueError(f"{self.name}: claims have a command or a source")
        if any((claim.prints == "()") != bool(self.source) for claim in self.claims):
            raise ValueError(f"{self.name}: claims of a command, and no others, have `prints`")

    def output(self) -> str:
        """Return what the command prints in a folder with the project's files and nothing else."""
        with tempfile.TemporaryDirectory() as folder:
            for name in WITHIN_REACH:
                (Path(folder) / name).symlink_to(ROOT / name)
            return self._output_in(Path(folder))

    def _output_in(self, folder: Path) -> str:
        environment = {
            **os.environ,
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
            "PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}",
            "OPENBLAS_NUM_THREADS": "1",
            "COLUMNS": "110",
        }
        process = subprocess.Popen(
            ["bash", "-e", "-o", "pipefail", "-c", self.command],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # so that a late command ends with its children
        )
        try:
            output, errors = process.communicate(timeout=PATIENCE * self.seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            raise ClaimError(
                f"{self.name}: not ready after {PATIENCE * self.seconds:g} s"
            ) from None
        if process.returncode:
            last = (errors.strip().splitlines() or ["no message"])[-1]
            raise ClaimError(f"{self.name}: exit code {process.returncode}: {last}")
        return output


def runs_of(text: str) -> list[Run]:
    """Return the runs of a claims file."""
    try:
        tables = tomllib.loads(text)
        return [_run(name, table) for name, table in tables.items() if name != STATED]
    except (TypeError, ValueError, re.error) as error:
        raise ClaimError(f"{CLAIMS}: {error}") from None


def stated_of(text: str) -> list[str]:
    """Return the figures of a claims file that no run measures, as "page: figure"."""
    return [figure for part in tomllib.loads(text).get(STATED, ()) for figure in part["figures"]]


def _run(name: str, table: object) -> Run:
    """Return a run; its claims are the tables inside it."""
    if not isinstance(table, Mapping):
        raise TypeError(f"{name} has to be a table")
    claims = tuple(
        Claim(f"{name}.{key}", **value) for key, value in table.items() if isinstance(value, dict)
    )
    rest = {key: value for key, value in table.items() if not isinstance(value, dict)}
    if "capability" in rest:
        rest["peers"] = tuple(rest.pop(peer, "-") for peer in PEERS)
    if "source" in rest:
        rest = {"command": "", "seconds": 0, **rest}
    return Run(name, claims=claims, **rest)


def texts_of(runs: Iterable[Run]) -> dict[str, str]:
    """Return the text between the marks of a page, by the name of the mark."""
    runs = list(runs)
    texts = {f"{run.name}.date": run.date.isoformat() for run in runs}
    texts |= {claim.name: claim.figure for run in runs for claim in run.claims}
    return texts | {TABLE: capabilities(runs)}


def capabilities(runs: Iterable[Run]) -> str:
    """Return the table of what seaid and its peers can do, and the list of seaid's commands."""
    rows = [run for run in runs if run.capability]
    lines = [
        "",
        "",
        f"| | seaid | {' | '.join(PEERS.values())} |",
        "|---|" + "---|" * (1 + len(PEERS)),
    ]
    for run in rows:
        own = "yes" if run.command else "no"
        lines.append(f"| {run.capability} | {own} | {' | '.join(run.peers)} |")
    lines += ["", "The commands behind each yes of seaid:", ""]
    shown = (run for run in rows if run.command)
    lines += [f"- {run.capability}: `{run.command}`, {run.date}" for run in shown]
    return "\n".join([*lines, "", ""])


def pages() -> list[Path]:
    """Return the pages that may have figures."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def problems_of_pages(texts: Mapping[str, str], contents: Mapping[str, str]) -> Iterator[str]:
    """Yield where the pages (their texts by their names) and the file differ."""
    used = set()
    for page, content in contents.items():
        yield from _broken_marks(page, content)
        for mark in MARK.finditer(content):
            place = f"{page}:{content.count(chr(10), 0, mark.start()) + 1}"
            used.add(mark[1])
            if mark[1] not in texts:
                yield f"{place}: no claim is called {mark[1]!r} in {CLAIMS}"
            elif mark[2] != texts[mark[1]]:
                words, wanted = mark[2][:WORDS], texts[mark[1]][:WORDS]
                yield f"{place}: the page has {words!r} for {mark[1]}, {CLAIMS} {wanted!r}"
    for name in texts:
        if name not in used and not name.endswith(".date"):
            yield f"{CLAIMS}: no page has {name}"


def problems_of_figures(contents: Mapping[str, str], stated: Collection[str]) -> Iterator[str]:
    """Yield figures without a mark, and stated ones ("page: figure") of no page.

    A figure has a unit; in docs/results.md a ratio, with decimals, is one too.
    """
    used = set()
    for page, content in contents.items():
        if not PAGES.fullmatch(page):
            continue
        plain = NO_FIGURES.sub(lambda text: re.sub(r"[^\n]", "|", text[0]), content)
        of_ratios = f"|{_DECIMAL}" * page.endswith("results.md")
        for found in re.finditer(_WITH_UNIT + of_ratios, plain):
            figure = re.sub(r"\s", " ", found[0])
            used.add(f"{page}: {figure}")
            if f"{page}: {figure}" not in stated:
                line = plain.count("\n", 0, found.start()) + 1
                yield f"{page}:{line}: {figure!r} is no claim, and not stated in {CLAIMS}"
    for name in sorted({*stated} - used):
        yield f"{CLAIMS}: no page has the stated {name!r}"


def _broken_marks(page: str, content: str) -> Iterator[str]:
    """Yield the marks of a page that have no name of a claim, or that no mark closes."""
    outside = MARK.sub(lambda mark: re.sub(r"[^\n]", " ", mark[0]), content)
    for mark in re.finditer(r"<!--\s*=", outside):
        line = outside.count("\n", 0, mark.start()) + 1
        words = content[mark.start() : mark.start() + WORDS].partition("\n")[0]
        yield f"{page}:{line}: no mark of a claim, or one that is not closed: {words!r}"


def with_figures(content: str, texts: Mapping[str, str]) -> str:
    """Return a page with the figures of the file between its marks."""
    return MARK.sub(lambda mark: f"<!--={mark[1]}-->{texts.get(mark[1], mark[2])}<!--=-->", content)


def measured(run: Run) -> tuple[Run, list[str]]:
    """Return a run with its new figures, and in which claims it differs from the old ones."""
    output = run.output()
    if re.search(run.shows, output, re.MULTILINE) is None:
        raise ClaimError(f"{run.name}: the command does not print {run.shows!r}")
    new = [replace(claim, figure=claim.printed_in(output)) for claim in run.claims]
    problems = [
        f"{old.name}: the command prints {claim.figure}, not {old.figure} within {old.within}"
        for old, claim in zip(run.claims, new, strict=True)
        if not old.agrees(claim.figure)
    ]
    return replace(run, claims=tuple(new), date=date.today()), problems


def with_runs(text: str, runs: Iterable[Run]) -> str:
    """Return the text of a claims file with the figures and dates of new runs."""
    for run in runs:
        text = _with_value(text, run.name, "date = ", run.date.isoformat())
        for claim in run.claims:
            _, _, key = claim.name.partition(".")
            text = _with_value(text, run.name, f"{key} = {{ figure = ", f'"{claim.figure}"')
    return text


def _with_value(text: str, table: str, key: str, value: str) -> str:
    """Return the text with a value behind a key of a table; the rest of its line is kept."""
    before = rf"^\[{table}\]\n(?:(?!\[).*\n)*?{re.escape(key)}"
    old = r'(?:"[^"]*"|[\d-]+)'
    return re.sub(f"({before}){old}", lambda line: line[1] + value, text, count=1, flags=re.M)


def main(names: list[str], only_pages: bool, quick: bool, write: bool) -> list[str]:
    """Compare, and write if asked; return the problems."""
    text = (ROOT / CLAIMS).read_text("utf-8")
    runs = runs_of(text)
    if unknown := set(names) - {run.name for run in runs}:
        raise ClaimError(f"no run is called {', '.join(sorted(unknown))} in {CLAIMS}")
    problems, new = [], []
    for run in [] if only_pages else runs:
        is_asked = bool(run.command) and (not names or run.name in names)
        if not is_asked or (quick and run.seconds > QUICK_S):
            continue
        if run.needs and find_spec(run.needs) is None:
            print(f"{run.name}: skipped, it needs {run.needs}", flush=True)
            continue
        try:
            result, differences = measured(run)
        except ClaimError as error:
            problems.append(str(error))
        else:
            new.append(result)
            problems += [] if write else differences
        print(f"{run.name}: {run.command}", flush=True)
    if write:
        text = with_runs(text, new)
        (ROOT / CLAIMS).write_text(text, "utf-8")
    texts = texts_of(runs_of(text))
    contents = {str(page.relative_to(ROOT)): page.read_text("utf-8") for page in pages()}
    if write:
        contents = {name: with_figures(content, texts) for name, content in contents.items()}
        for name, content in contents.items():
            (ROOT / name).write_text(content, "utf-8")
    unmarked = problems_of_figures(contents, stated_of(text))
    return [*problems_of_pages(texts, contents), *unmarked, *problems]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("runs", nargs="*", help="names of runs; default: all")
    parser.add_argument("--pages", action="store_true", help="compare the pages, run nothing")
    parser.add_argument("--quick", action="store_true", help=f"runs of at most {QUICK_S:g} s only")
    parser.add_argument("--write", action="store_true", help="write new figures into the pages")
    arguments = parser.parse_args()
    try:
        found = main(arguments.runs, arguments.pages, arguments.quick, arguments.write)
    except ClaimError as error:
        found = [str(error)]
    for problem in found:
        print(problem, file=sys.stderr)
    sys.exit(1 if found else 0)
