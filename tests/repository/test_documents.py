"""Documents keep their word: code runs and prints what they say, links lead somewhere."""

import json
import pkgutil
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import seaid
from docs import commands as reference
from scripts import design_table, notebook
from scripts.architecture import PICTURE, picture
from scripts.pages import (
    ROOT,
    RUN_BY_CI,
    SHELLS,
    Block,
    blocks,
    commands,
    is_run,
    pages,
    prepare,
    run_page,
    same,
)
from scripts.warnings_page import page_with_sections
from seaid.checks import CODES
from seaid.cli.commands import COMMANDS, command_of
from seaid.drives import PARAMETERS_OF
from seaid.drives.toml import drives_from_mapping
from seaid.export import content_of
from seaid.log.description import description_for
from seaid.log.readers.opening import READERS
from tests.experiments import arm_found
from tests.plants import kept

LEG_LOGS = {
    **{"run.csv": "run.csv", "other.csv": "other.csv"},
    **{"cold.csv": "run.csv", "warm.csv": "other.csv"},
}
"""Logs that pages begin with, and which of those that docs/first_result.md makes they are."""

MAKES_ITS_FILES = ("README.md", "docs/first_result.md", "docs/paper.md")
MAKES_THE_LOGS = "docs/first_result.md"
LINK = re.compile(r"(?<!`)!?\[[^\]]*\]\(([^)\s]+)\)")
TITLE = re.compile(r"^#{1,4} (.+)$", re.MULTILINE)
PLACE = re.compile(r"`(seaid(?:\.[A-Za-z_]\w*)+)`")
REFERENCE = re.compile(r"^\.\. auto\w+:: seaid\.(\S+)$", re.MULTILINE)


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


PAGES = {name_of(page): page for page in pages()}
WITH_CODE = [
    name
    for name, page in PAGES.items()
    if any(block.language in ("python", *SHELLS) for block in blocks(page.read_text("utf-8")))
]
ALL_BLOCKS = [
    (f"{name}:{block.line}", block)
    for name, page in PAGES.items()
    for block in blocks(page.read_text("utf-8"))
]


def test_what_is_generated_is_what_stands_in_the_pages() -> None:
    """`python -m scripts.warnings_page` and `python -m scripts.architecture` write it."""
    text = (ROOT / "docs/warnings.md").read_text("utf-8")
    assert text == page_with_sections(text)
    assert PICTURE.read_text("utf-8") == picture()
    for title, (field, benches) in design_table.TABLES.items():
        assert list(design_rows(title)) == [f"{getattr(bench, field):g}" for bench in benches]


def test_the_page_of_warnings_begins_with_its_index_and_has_a_sentence_per_code() -> None:
    """An installed user has no file of the documents: no text of a code names one."""
    index, sections = (ROOT / "docs/warnings.md").read_text("utf-8").split("\n## How to read them")
    assert re.findall(r"\[([\w-]+)\]\(#\1\)", index)[1:] == sorted(CODES)
    for code in CODES.values():
        assert f"\n### {code.name}\n\n`{code.name}` names {code.meaning}.\n" in sections
        assert not re.search(r"docs/|\.md\b", code.cause + code.advice)


def of_language(*languages: str) -> list[object]:
    """Return the blocks of some languages, as parameters of a test."""
    chosen = [(name, block) for name, block in ALL_BLOCKS if block.language in languages]
    return [pytest.param(block, id=name) for name, block in chosen]


@kept
def leg_content(text: str) -> dict[str, bytes]:
    """Return what is in the files that pages begin with: made as the text of a page says."""
    with TemporaryDirectory() as place:
        folder = Path(place)
        prepare(folder)
        page = folder / "page.md"
        page.write_text(text, encoding="utf-8")
        for _ in run_page(page, folder):
            if (folder / "other.csv").exists():
                break
        leg = seaid.load_robot(ROOT / "models/tulip_leg.urdf", ROOT / "models/tulip_leg.toml")
        found = seaid.identify(leg, seaid.read_log(folder / "run.csv", leg), feasible=True)
        seaid.write_parameters(found, folder / "parameters.json")
        made = {name: name for name in ("plan.json", "parameters.json")} | LEG_LOGS
        return {name: (folder / file).read_bytes() for name, file in made.items()}


@pytest.fixture(scope="session")
def leg_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the files that pages begin with by their names."""
    folder = tmp_path_factory.mktemp("logs")
    content = leg_content(PAGES[MAKES_THE_LOGS].read_text("utf-8"))
    for name, of_file in content.items():
        (folder / name).write_bytes(of_file)
    return {name: folder / name for name in content}


@pytest.mark.slow  # pages simulate the leg with its springs, or begin with logs of it
@pytest.mark.page
@pytest.mark.parametrize("name", WITH_CODE)
def test_code_of_a_page_runs_and_prints_what_the_page_says(
    name: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    text = PAGES[name].read_text("utf-8")
    named = name not in MAKES_ITS_FILES and any(file in text for file in LEG_LOGS)
    files = request.getfixturevalue("leg_files") if named else {}
    prepare(tmp_path, tuple(path for file, path in files.items() if file in text))
    for block, printed in run_page(PAGES[name], tmp_path):
        if block.printed is not None:
            said = block.printed[2]
            right = same(said, printed, block.within)
            assert right, f"{name}:{block.line} prints\n{printed}\nand not\n{said}"


def test_commands_of_the_readme_are_run_by_ci_as_they_stand() -> None:
    script = (ROOT / ".ci/run").read_text("utf-8")
    assert 'python3 .ci/readme_commands.py README.md >"$stranger/commands"\n' in script
    assert 'step bash -euxo pipefail "$stranger/commands"\n' in script
    command = [sys.executable, str(ROOT / ".ci/readme_commands.py"), str(RUN_BY_CI)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    shells = [block for block in blocks(RUN_BY_CI.read_text("utf-8")) if block.language in SHELLS]
    assert len(shells) >= 5
    assert printed == "".join(block.code for block in shells)


@pytest.mark.parametrize("block", of_language(*SHELLS))
def test_commands_that_are_not_run_exist(block: Block) -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    for command in commands(block):
        if is_run(command):
            assert command.split()[0] in ("seaid", "python"), command
        for target in re.findall(r"^make (\w+)", command):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), command
        for extras in re.findall(r"pip install '?\S*\[([\w,]+)\]", command):
            assert set(extras.split(",")) <= set(project["optional-dependencies"]), command


@pytest.mark.parametrize("block", of_language("toml"))
def test_toml_is_a_project_drives_or_a_log_description(block: Block, tmp_path: Path) -> None:
    table = tomllib.loads(block.code)
    if "urdf" in table:
        (tmp_path / "seaid.toml").write_text(block.code)
        assert seaid.load_project(tmp_path).logs
    elif all("type" in value for value in table.values() if isinstance(value, dict)) and table:
        assert drives_from_mapping(table)
    else:
        table.setdefault("joints", {"elbow": {"joint_position": "q"}})
        description = description_for(ROOT / "run.csv", table)
        assert description is not None
        assert description.joints


@pytest.mark.parametrize("block", of_language("json"))
def test_json_has_the_keys_of_parameters_json(block: Block) -> None:
    """Of the file, of a base parameter and of a value of a drive."""
    found, example = content_of(arm_found()), json.loads(block.code)
    assert {*example} <= {*found}
    assert {*example["load"][0]} == {*found["load"][0]}
    for drive in example["drives"].values():
        for value in drive.values():
            assert {*value} == {*found["load"][0]} - {"expression"}


def anchors(page: Path) -> set[str]:
    """Return what a link into a page may name, as GitHub and the site make it of titles."""
    text = page.read_text("utf-8")
    plain = (re.sub(r"[^\w\- ]", "", title.lower()) for title in TITLE.findall(text))
    targets = (label.replace("_", "-") for label in re.findall(r"^\((\S+)\)=$", text, re.MULTILINE))
    return {title.replace(" ", "-") for title in plain} | set(targets)


def test_documents_are_at_most_25_pages() -> None:
    assert sum(name.startswith("docs/") for name in PAGES) <= 25


TABLE = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)
SHOWN = re.compile(r"<!--.*?-->|(?<=\])\([^)]*\)|[`*\[\]]")
TWO_LINES, BETWEEN = 180, 6
"""Letters of two lines of a page, which columns share by need, and those that a column costs."""


@pytest.mark.parametrize("name", PAGES)
def test_tables_have_few_columns_and_about_two_lines_a_cell(name: str) -> None:
    text = re.sub(r"```.*?```", "", PAGES[name].read_text("utf-8"), flags=re.DOTALL)
    for table in TABLE.findall(text):
        rows = [re.split(r"(?<!\\)\|", row[1:-1]) for row in table.splitlines()]
        cells = ([len(SHOWN.sub("", cell).strip()) for cell in row] for row in rows)
        widths = [max(column) for column in zip(*cells, strict=True)]
        assert len(widths) <= 5, rows[0]
        assert sum(widths) + BETWEEN * len(widths) <= TWO_LINES, (rows[0], widths)


@pytest.mark.parametrize("name", PAGES)
def test_links_and_pictures_are_there(name: str) -> None:
    page = PAGES[name]
    for target in LINK.findall(page.read_text("utf-8")):
        if re.match(r"https?://", target):
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f"{name}: {target}"
        if anchor:
            assert anchor in anchors(there), f"{name}: {target}"


def test_places_in_the_code_that_pages_name_exist() -> None:
    """`seaid.drives.drives.deflection` is an attribute of a module, or of a type in one."""
    texts = [page.read_text("utf-8") for page in (*PAGES.values(), ROOT / "CONTRIBUTING.md")]
    named = {name for text in texts for name in PLACE.findall(text)} - {"seaid.toml"}
    for name in named:
        pkgutil.resolve_name(name)


def test_everything_public_is_in_the_reference() -> None:
    """Names, commands with their options, formats of logs, and terms of drives."""
    named = {
        name
        for page in (ROOT / "docs/reference").glob("*.md")
        for name in REFERENCE.findall(page.read_text("utf-8"))
    }
    modules = {path.stem for path in Path(seaid.__file__).parent.iterdir()}
    inner = {"MAX_TERMS", "expression_of"}  # for other packages
    symbolic = {f"symbolic.{name}" for name in set(dir(seaid.symbolic)) - inner}
    assert set(seaid.__all__) - modules | symbolic | {"regressor.rigid_body_regressor"} <= named
    text = reference.markdown()
    for name in COMMANDS:
        assert f"## seaid {name}\n" in text
        for option in (option for one in command_of(name).params for option in one.opts):
            assert option in text or not option.startswith("-")
    terms = [term for field in PARAMETERS_OF.values() for term in field if term != "torque"]
    for page, names in (("docs/logs.md", [*READERS]), ("docs/drives.md", terms)):
        text = PAGES[page].read_text("utf-8")
        assert [name for name in names if f"`{name}`" not in text] == []


@pytest.mark.slow  # 4.4 s, as the code of the pages
def test_notebook_runs_and_prints_what_it_shows(tmp_path: Path) -> None:
    prepare(tmp_path)
    for cell, printed, figures in notebook.run(
        notebook.read(ROOT / "docs/first_result.ipynb"), tmp_path
    ):
        said = notebook.printed_by(cell)
        assert same(said, printed), f"{''.join(cell['source'])}\nprints\n{printed}\nnot\n{said}"
        assert len(figures) == len(notebook.pictures_of(cell))
    assert (tmp_path / "out/hebi_arm_2.html").is_file()


def design_rows(title: str) -> dict[str, list[float]]:
    """Return {value: numbers} of a table of the page on the design of experiments."""
    text = PAGES["docs/experiment_design.md"].read_text("utf-8")
    table = text.split(f"| {title} |")[1].split("\n\n")[0].splitlines()[2:]
    cells = ([cell.strip() for cell in row.strip("| ").split("|")] for row in table)
    return {
        one: [float(x) for x in re.findall(r"[\d.e+]+", " ".join(rest))] for one, *rest in cells
    }


@pytest.mark.slow  # plans a motion and identifies twelve logs
@pytest.mark.filterwarnings("ignore::seaid.SeaidWarning")  # a short search
def test_a_row_of_the_design_tables_is_found_again() -> None:
    """Errors as stated and as they are, within what twelve logs determine."""
    bench = design_table.TABLES["duration [s]"][1][0]
    steps, stated, true = design_table.errors_of(bench, 12)
    rms = np.sqrt(np.mean(true**2, axis=0))
    wanted = design_rows("duration [s]")["3"]
    assert steps == pytest.approx(wanted[0], rel=0.2)  # where a search ends depends on rounding
    assert 100 * np.median(stated, axis=0) == pytest.approx(wanted[1::2], rel=0.3)
    assert 100 * rms == pytest.approx(wanted[2::2], rel=0.6)


@pytest.mark.parametrize(
    ("said", "printed", "is_same"),
    [
        ("k = 51390 N/m", "k = 51390 N/m\n", True),
        ("1 %", "1.1 %", True),
        ("─────\n 2", "───\n 2", True),
        ("one\n...\nfour 4.0\n", "one\ntwo\nthree\nfour 4.1\n", True),
        ("...\nfour\n...", "one\nfour\nfive", True),
        ("a gap of ... and 5.0", "a gap of 1e+15 and 5.1", True),
        ("k = 51390 N/m", "K = 51390 N/m", False),
        ("k = 51390 N/m", "k = 51391 N/m", False),
        ("k = 5.139e+04 N/m", "k = 5.141e+04 N/m", False),
        ("off by -0.012 %", "off by 0.012 %", False),
        ("1.2 %", "1.4 %", False),
        ("one\ntwo", "one\ntwo\nthree", False),
        ("one\n...\nfive\n", "one\ntwo\n", False),
        ("one\n...\nthree\n...\ntwo\n...", "one\ntwo\nthree\n", False),
        ("a gap of ... and 5", "a gap of 1e+15 and 6", False),
    ],
)
def test_words_are_the_same_and_figures_to_the_last_digit(
    said: str, printed: str, is_same: bool
) -> None:
    """Dots stand for anything, and spaces for any spaces."""
    assert same(said, printed) == is_same


def test_a_tolerance_that_a_page_states_holds_for_its_figures() -> None:
    """It stands right behind the block."""
    page = "```sh\nseaid\n```\n\n```text\n{0}\n```\n\n*Within 5 % on any processor: a search.*\n"
    (block, _) = blocks(page.format("condition number 20.5"))
    assert block.within == 5.0
    assert block.printed is not None
    assert same(block.printed[2], "condition number 21.2", block.within)
    assert not same(block.printed[2], "condition number 22", block.within)
    (block, _) = blocks(page.format("20.5").replace("*Within", "Within"))
    assert block.within is None
