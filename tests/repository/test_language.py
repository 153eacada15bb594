"""The project speaks the field's words: those of its first years' dialect do not come back."""

import ast
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

from scripts.sources import tree_of

ROOT = Path(__file__).resolve().parents[2]

INSTEAD = {
    r"\b(?:un|re)?told\b|\btells\b": "identifiable, determined by; excites; says",
    r"\bbent\b|\bbends?\b|\bbending\b": "nonlinear in the parameters",
    r"\bstraighten(?:ed|ing|s)?\b": "linearised, linearisation",
    r"--sides\b|\bsides=": "method=",
    r"--rows\b": "--torque-joints",
    r"\bimpossible\b|\bpossible bod(?:y|ies)\b|\bpossible_bod\w+": "physically consistent",
    r"\bprogrammes?\b": "semidefinite program",
    r"\bdrivetrains?\b": "drives",
    r"\bjoint[_ ]zeros?\b|\bjoint_zero\w*": "encoder offsets",
    r"\bdeflection_offset\b": "spring_offset",
    r"\binformation_of\b": "QR factor",
    r"\bcarried\b": "propagated (uncertainty)",
    r"\bworth having\b|\bnested\b": "supported by the data; model comparison",
    r"\bmend(?:s|ed|ing)?\b": "repair",
    r"\bleft (?:out|away)\b|\bleav(?:e|es|ing) (?:out|away)\b": "excluded",
    r"\btrim(?:s|med|ming)?\b|\bsw[iu]ng in\b": "filter transient",
    r"\bpass bands?\b": "cutoff, bandwidth of the motion",
    r"\bgap of the decision\b": "singular-value gap",
    r"\bup to one factor\b": "up to scale",
    r"\bgo(?:es)? on from row to row\b": "is autocorrelated",
    r"\bregressed both ways\b": "direct and reverse regression",
    r"\bh[eo]ld(?:s|ing)? (?:[\w`]+ )?against\b": "compare, check",
    r"\bfree ends?\b": "start and end in motion",
    r"\bdrive columns\b": "drive parameters included",
    r"\brecorded=|--recorded\b": "previous_logs=",
    r"\bmust not be trusted\b": "warnings",
    r"\bidentified from what\b": "data and settings",
    r"\bforeign\b": "with custom columns",
    r"\borange lines\b": "compare with",
    r"\b(?:one|number|columns?|rows?|table) a (?:joint|body|drive|row|motor)\b": "per joint",
    r"\bparameters a (?:joint|body|drive)\b": "per joint",
    r"\b(?:coefficients|values?|equation) a (?:joint|body|drive|row|motor)\b": "per joint",
    r"\bbeside\b": "parallel, next to, besides",
}
"""Words of HOUSE.md's left column, and what stands instead."""

PLAIN = {
    "seaid/cli/commands.py": ('    "--sides": "', '    "--rows": "', '    "--allow-impossible": "'),
    "seaid/drives/toml.py": ("_OLD_KEYS = ",),
    "docs/conventions.md": (
        "| encoder offset |",
    ),  # the glossary has the synonyms that people look for
}
"""Files in which such a word has its plain meaning, with the lines' text: {file: (text, ...)}."""

PLACES = ("seaid/**/*", "docs/**/*.md", "README.md", "scripts/**/*.py")


def files() -> list[Path]:
    found = [path for place in PLACES for path in ROOT.glob(place)]
    return sorted(path for path in found if path.suffix in (".py", ".pyi", ".md", ".js", ".j2"))


@cache
def texts() -> dict[str, tuple[str, str]]:
    """Return the texts by the names of their files, as they are and in lower case."""
    found = {path.relative_to(ROOT).as_posix(): path.read_text("utf-8") for path in files()}
    return {name: (text, text.lower()) for name, text in found.items()}


def dialect(words: Iterable[str] = tuple(INSTEAD)) -> list[str]:
    """Return the lines that have one of the words, with their places."""
    joined = "|".join(words)
    pattern, found = re.compile(joined, re.IGNORECASE), []
    # A search that begins with a letter takes a twentieth of the time, and finds more.
    rough = re.compile(joined.replace(r"\b", ""))
    for name, (text, lower) in texts().items():
        if not rough.search(lower):
            continue
        for number, line in enumerate(text.splitlines(), 1):
            if pattern.search(line) and not any(one in line for one in PLAIN.get(name, ())):
                found.append(f"{name}:{number}: {line.strip()}")
    return found


VAGUE = {"one", "found", "own", "given", "other", "here", "there", "left", "mine"}
"""Names that say nothing of what a variable is: a robot, a residual, a finding, ..."""

MOST_VAGUE = 0.005
"""Part of the variables and arguments of seaid with such a name (HOUSE.md)."""


def vague_names() -> tuple[int, int]:
    """Return how many variables and arguments of seaid have a vague name, and how many there are.

    Each place counts at which a variable stands.
    """
    names = [
        node.arg if isinstance(node, ast.arg) else node.id
        for path in sorted((ROOT / "seaid").rglob("*.py"))
        for node in ast.walk(tree_of(path.read_text("utf-8")))
        if isinstance(node, ast.arg | ast.Name)
    ]
    return sum(name in VAGUE for name in names), len(names)


def test_few_variables_have_a_vague_name() -> None:
    vague, count = vague_names()
    assert vague <= MOST_VAGUE * count, f"{vague} of {count} variables are called one, found, own"


@pytest.mark.parametrize("word", INSTEAD)
def test_the_dialect_does_not_come_back(word: str) -> None:
    assert dialect([word]) == [], f"write: {INSTEAD[word]}"
