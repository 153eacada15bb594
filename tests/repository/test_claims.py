"""Figures of pages are those of their runs: what differs, is missing or ends badly is a problem."""

import re
import subprocess
import sys
from dataclasses import replace
from datetime import date

import pytest
from PIL import Image

from scripts import claims
from scripts.claims import Claim, ClaimError, Run

ROOT = claims.ROOT
FILE = (ROOT / claims.CLAIMS).read_text("utf-8")
RUNS, STATED = claims.runs_of(FILE), claims.stated_of(FILE)
TEXTS = claims.texts_of(RUNS)
CONTENTS = {str(page.relative_to(ROOT)): page.read_text("utf-8") for page in claims.pages()}
JOINTS = ("hip", "knee", "ankle")
EXAMPLE = """\
[leg]
command = "echo k = 12.5 N m/rad"
seconds = 1
date = 2026-01-02
stiffness = { figure = "12.0", within = "5 %", prints = 'k = (\\S+)', claim = "a [stiffness]" }

[arm]
command = "echo k = 7"
seconds = 1
date = 2026-01-02
stiffness = { figure = "12.0", within = "0", prints = 'k = (\\S+)', claim = "another one" }
"""


def problems(contents: dict[str, str]) -> list[str]:
    pages = {**CONTENTS, **contents}
    unmarked = claims.problems_of_figures(pages, STATED)
    return [*claims.problems_of_pages(TEXTS, pages), *unmarked]


def test_pages_have_the_figures_of_the_claims() -> None:
    """Each page has those it names and each claim has a page."""
    assert problems({}) == []
    page = "one\n<!--=leg.colour-->3<!--=-->\n"
    unknown = "docs/page.md:2: no claim is called 'leg.colour' in docs/claims.toml"
    assert problems({"docs/page.md": page}) == [unknown]
    without = claims.problems_of_pages({**TEXTS, "leg.colour": "3"}, CONTENTS)
    assert list(without) == ["docs/claims.toml: no page has leg.colour"]
    command = [sys.executable, "-m", "scripts.claims"]
    for words, code in (("--pages", 0), ("legs", 1)):
        done = subprocess.run([*command, words], cwd=ROOT, capture_output=True, check=False)
        assert done.returncode == code


@pytest.mark.parametrize("side", ["actuator", "load"])
def test_the_titles_of_figures_3_and_4_have_the_figures_of_the_claims(side: str) -> None:
    """As `make pictures` drew them; the description of the picture has its titles."""
    with Image.open(ROOT / f"docs/{side}_side.png") as picture:
        titles = str(picture.info["Description"])
    short = {"hip_yaw": "yaw", "hip_roll": "roll"} | {f"{x}_pitch": x for x in JOINTS}
    kind = {"actuator": "motor", "load": "load"}[side]
    pattern = r"(\w+)[\w, ]*: relative error ([\d.]+)%.*?(?:the (\d+)% of the samples|\()"
    shown = re.findall(pattern, titles)
    assert len(shown) == {"actuator": 2, "load": 5}[side]
    for joint, error, share in shown:
        name = f"tulip.{short[joint]}_{kind}"
        assert float(error) == round(float(TEXTS[name]), 1)
        assert (share or "100") == TEXTS[f"{name}_share"]


def test_the_pictures_of_reports_have_the_figures_of_the_claims() -> None:
    """As `make pictures` drew them; the description of a picture has its words."""
    shown = {}
    for name in ("report.png", "_static/report_dark.png", "report_hebi.png"):
        with Image.open(ROOT / "docs" / name) as picture:
            shown[name] = str(picture.info["Description"]).replace("\N{NO-BREAK SPACE}", " ")
    for words in [*shown.values()][:2]:
        for joint in JOINTS:
            side = words.partition("Torque on the load")[2].partition(f"{joint}_pitch")[2]
            assert side.partition("%")[2].startswith(f"{TEXTS[f'tulip.{joint}_load']} %")
    assert "Usable with care" in shown["report_hebi.png"]
    assert "weak-spring (joint_1)" in shown["report_hebi.png"]


@pytest.mark.parametrize("page", [name for name, text in CONTENTS.items() if "<!--=" in text])
def test_a_false_number_in_a_page_is_a_problem(page: str) -> None:
    """It is named with its line; no mark begins a line, which would make it a block."""
    mark = re.search(r"<!--=(\w+\.\w+)-->([\d.]+)", CONTENTS[page])
    assert mark is not None
    planted = CONTENTS[page].replace(mark[0], f"<!--={mark[1]}-->{mark[2]}1", 1)
    (problem,) = problems({page: planted})
    line = planted[: mark.start()].count("\n") + 1
    assert problem.startswith(f"{page}:{line}: the page has ")
    assert mark[1] in problem
    assert not re.findall(r"^<!--=(?!capabilities|-->$).*", CONTENTS[page], re.MULTILINE)


@pytest.mark.parametrize(
    "mark",
    [
        *("<!--=hebi-stiffness-->99<!--=-->", "<!--=hebi.stiffness-->99", "99<!--=-->"),
        *("<!-- =hebi.stiffness-->99", "<!--=hebi.stiffness -->99<!--=-->", "<!--= -->99"),
    ],
)
def test_a_mark_that_is_misspelt_or_not_closed_is_a_problem(mark: str) -> None:
    """It takes no other mark with it."""
    figure = TEXTS["hebi.stiffness"]
    page = f"one\n{mark} and\n<!--=hebi.stiffness-->{figure}<!--=-->\n"
    found = problems({"docs/page.md": page})
    assert all(problem.startswith("docs/page.md:2: no mark of a claim") for problem in found)
    assert found
    assert claims.with_figures(page, TEXTS) == page


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("seconds = 1", 'seconds = "two"', "leg: seconds has to be a positive number, 'two'"),
        ("seconds = 1", "seconds = -1", "leg: seconds has to be a positive number, -1"),
        ("seconds = 1", "seconds = 0", "leg: a command has its seconds"),
        ("date = 2026-01-02", 'date = "today"', "leg: date has to be a day"),
        ('"12.0"', "12.0", "leg.stiffness: figure, within, prints and claim have to be text"),
        ('"5 %"', '"five"', "could not convert"),
        ("prints = 'k = (\\S+)', ", "", "leg: claims of a command"),
        ("[leg]", "arms = 2\n[leg]", "arms has to be a table"),
        ('command = "echo k = 12.5 N m/rad"', 'command = ""', "leg: a command has its seconds"),
        ("[leg]", '[leg]\nsource = "a data sheet"', "leg: claims have a command or a source"),
    ],
)
def test_a_run_that_cannot_be_is_refused(old: str, new: str, message: str) -> None:
    with pytest.raises(ClaimError, match=re.escape(f"{claims.CLAIMS}: {message}")):
        claims.runs_of(EXAMPLE.replace(old, new, 1))


def test_a_figure_from_outside_has_a_source_and_is_not_run() -> None:
    sheet = '[sheet]\nsource = "a data sheet"\ndate = 2026-01-02\n'
    (run,) = claims.runs_of(sheet + 'ratio = { figure = "762.222", claim = "a gear ratio" }')
    assert (run.command, claims.texts_of([run])["sheet.ratio"]) == ("", "762.222")
    assert claims.main(["firmware"], only_pages=False, quick=False, write=False) == []


@pytest.mark.parametrize(
    ("command", "seconds", "message"),
    [
        ("echo first; echo 'no robot' >&2; exit 3", 1, "leg: exit code 3: no robot"),
        ("exit 1 | cat", 1, "leg: exit code 1: no message"),
        ("sleep 60", 0.02, "leg: not ready after 0.2 s"),
        ("echo k = 1; echo k = 2", 1, "leg.stiffness: the command prints 2 figures, not one"),
        ("echo c = 12", 1, "leg.stiffness: the command prints 0 figures, not one"),
        ("echo k = 12.7", 1, "leg.stiffness: the command prints 12.7, not 12.0 within 5 %"),
        ("echo k = 12.5", 1, ""),
    ],
)
def test_a_run_without_its_figure_is_a_problem(command: str, seconds: float, message: str) -> None:
    """A run that ends has the figures that it printed, and its date."""
    claim = Claim("leg.stiffness", "a stiffness", "12.0", "5 %", r"k = (\S+)")
    run = Run("leg", command, seconds, date(2026, 1, 2), (claim,))
    if not message or "within" in message:
        measured, found = claims.measured(run)
        assert found == [message] * bool(message)
        assert (measured.claims[0].figure, measured.date) == (command[-4:], date.today())
        return
    with pytest.raises(ClaimError, match=re.escape(message)):
        claims.measured(run)
    shown = replace(run, command="echo no", claims=(), shows="yes")
    with pytest.raises(ClaimError, match="leg: the command does not print"):
        claims.measured(shown)


@pytest.mark.parametrize(
    ("figure", "within", "printed", "agrees"),
    [
        *(("-0.17", "0.02", "-0.19", True), ("-0.17", "0.02", "-0.2", False)),
        *(("83090", "0.5 %", "83500", True), ("83090", "0.5 %", "83600", False)),
        *(("good", "0", "good", True), ("good", "0", "usable", False), ("12", "5 %", "nan", False)),
    ],
)
def test_tolerances_are_shares_or_numbers(
    figure: str, within: str, printed: str, agrees: bool
) -> None:
    assert Claim("leg.k", "", figure, within, "k = (.*)").agrees(printed) is agrees


def test_new_figures_are_written_into_the_file_and_the_pages() -> None:
    leg, _ = claims.measured(claims.runs_of(EXAMPLE)[0])
    text = claims.with_runs(EXAMPLE, [leg])
    first, second = claims.runs_of(text)
    assert (first.claims[0].figure, first.date) == ("12.5", date.today())
    assert second == claims.runs_of(EXAMPLE)[1]
    page = "k = <!--=leg.stiffness-->12.0<!--=-->, <!--=arm.stiffness-->12.0<!--=-->"
    filled = claims.with_figures(page, claims.texts_of([first, second]))
    assert filled == "k = <!--=leg.stiffness-->12.5<!--=-->, <!--=arm.stiffness-->12.0<!--=-->"


def test_a_yes_of_the_table_of_capabilities_has_its_command() -> None:
    rows = [run for run in RUNS if run.capability]
    assert len(rows) >= 10
    for run in rows:
        own = "yes" if run.command else "no"
        assert f"\n| {run.capability} | {own} |" in TEXTS[claims.TABLE]
        assert (f"- {run.capability}: `{run.command}`," in TEXTS[claims.TABLE]) == (own == "yes")
        assert bool(run.shows) == (own == "yes")
        assert run.seconds <= claims.QUICK_S  # the page says that --quick runs it


ANY_NUMBER = re.compile(r"(?<![\w^.,-])\d(?:[\d.,]*\d)?")
"""A number that is no part of a name such as X5 or F_v3."""
ROW = {"README.md": r"^\| [^|]+ \| .*<!--=.*", "docs/results.md": r"^- \*\*.*:.*<!--=.*\\\n.*"}
"""Claims are rows of a table, or points of a list whose second line has the command."""


def unmarked(row: str) -> list[str]:
    """Return the numbers of a claim without a mark, but for those of its words and commands.

    The words may have conditions of the experiment: they stand in the command or the claim.
    """
    runs = {run.name: run for run in RUNS}
    used = [runs[mark[1].split(".")[0]] for mark in claims.MARK.finditer(row)]
    stated = [text for run in used for text in (run.command, *(x.claim for x in run.claims))]
    parts = re.split(r" \| |\*\*: ", row)
    first, *rest = (ANY_NUMBER.findall(claims.NO_FIGURES.sub("", part)) for part in parts)
    conditions = set(ANY_NUMBER.findall(" ".join(stated).replace(",", "")))
    numbers = [number for number in first if number.replace(",", "") not in conditions]
    return [*numbers, *(number for cell in rest for number in cell)]


@pytest.mark.parametrize("page", ROW)
def test_a_row_with_a_figure_has_claims_and_the_command_of_one_of_them(page: str) -> None:
    """No part has a number without a mark, with a unit or without, and commands are as claimed."""
    commands = {run.name: run.command for run in RUNS}
    rows = re.findall(ROW[page], CONTENTS[page], re.MULTILINE)
    assert len(rows) >= {"README.md": 4, "docs/results.md": 59}[page]
    for row in rows:
        assert unmarked(row) == [], row
        assert page == "README.md" or "  *Not shown:* " in row, row
        names = {mark[1].split(".")[0] for mark in claims.MARK.finditer(row)}
        programs = re.findall(r"`(python [^`]+)`", row)
        wanted = " ".join(commands[name] for name in names)
        assert all(program in wanted for program in programs), row


def test_a_number_without_a_mark_is_found() -> None:
    """Also one without a unit; a condition of the experiment is in its claim or command."""
    figure = "<!--=unseen.alarms-->0<!--=-->"
    assert unmarked(f"| No alarm | {figure} of 28 | X5-4 of F_v3 |") == ["28"]
    assert unmarked(f"- **Within 1.5 times the error**: {figure} of 3.\\\n  By") == ["3"]
    assert unmarked(f"| Within 1.6 times the error | {figure} | `seed 7` |") == ["1.6"]


@pytest.mark.parametrize("page", [name for name in CONTENTS if claims.PAGES.fullmatch(name)])
def test_a_figure_of_a_page_is_a_claim_or_stated(page: str) -> None:
    """Code, names such as X5, and other numbers without a unit are none."""
    text = CONTENTS[page] + "```sh\necho 77 s\n```\n`77 s` X5 s 77 joints\nor 77\nmrad"
    (problem,) = problems({page: text})
    assert problem.startswith(f"{page}:{text.count(chr(10))}: '77 mrad' is no claim")
    (problem,) = claims.problems_of_figures({page: ""}, [f"{page}: 77 %"])
    assert problem == f"docs/claims.toml: no page has the stated '{page}: 77 %'"
