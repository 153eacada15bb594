"""Pages of Markdown whose code runs: their blocks in order, in a folder, with one namespace.

A `python` block runs in this interpreter, an `sh` block in bash with the commands of this
environment, and so do the lines behind `$` of a `console` block; lines that are all plain commands
of seaid run in this interpreter too, which saves its start for each. A `text` block right behind
one is what it prints. There `...` stands for anything, as a line of its own for any lines. A `toml`
block whose first line names a file (`# arm.toml`) is written as that file.

Figures have to be right to the last digit shown, on every processor. Where they cannot be, since a
search ends elsewhere after other rounding, the page says so to its readers, and the figures have to
be right within that: a paragraph right behind the block, `*Within 5 % on any processor: ...*`.

`python scripts/pages.py docs/paper.md` runs a page and writes what it prints into its text blocks
(but for those with a line `...`).
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from click.testing import CliRunner

from seaid.cli.commands import app

ROOT = Path(__file__).parents[1]
SHARED = ("models", "scripts", "docs")
"""Folders of the project that a page may name."""

SHELLS = ("sh", "console")

COLUMNS = "110"
"""Width of the terminal in which commands print."""

RUN_BY_CI = ROOT / "README.md"
"""The page whose commands `.ci/run` runs as they stand; here only those whose output it shows."""

_BLOCK = re.compile(r"^```([a-z]*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"[-+]?\d+(?:\.(\d+))?(?:e([-+]?\d+))?")
_WITHIN = re.compile(r"\s*\*Within (\d+(?:\.\d+)?) % on any processor[^*]*\*")
_NOT_RUN = re.compile(r"^(make|pip install|python -m pip install|git clone|cd|source|\.) ?")


@dataclass(frozen=True)
class Block:
    """Code of a page: its language, text, line, and what it prints (start, end, text) or None.

    `within` [%] is how far figures may be off by what the page says, None: to the last digit.
    """

    language: str
    code: str
    line: int
    printed: tuple[int, int, str] | None = None
    within: float | None = None


def pages() -> list[Path]:
    """Return the README and all documents."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(text: str) -> Iterator[Block]:
    """Return the blocks of a page, text blocks behind the code that prints them."""
    found = list(_BLOCK.finditer(text))
    for one, after in zip_longest(found, found[1:]):
        printed, end = None, one.end()
        if after and after[1] == "text" and not text[end : after.start()].strip():
            printed, end = (after.start(2), after.end(2), after[2]), after.end()
        stated = _WITHIN.match(text, end)
        within = float(stated[1]) if stated else None
        yield Block(one[1], one[2], text.count("\n", 0, one.start()) + 2, printed, within)


def prepare(folder: Path, files: tuple[Path, ...] = ()) -> None:
    """Put the project's folders and some files within reach of a page that runs in `folder`."""
    for name in SHARED:
        (folder / name).symlink_to(ROOT / name)
    for path in files:
        (folder / path.name).symlink_to(path)


def run_page(path: Path, folder: Path) -> Iterator[tuple[Block, str]]:
    """Run the blocks of a page in a folder; return each with what it printed."""
    names: dict[str, Any] = {"__name__": "page"}
    for block in blocks(path.read_text(encoding="utf-8")):
        where = f"{os.path.relpath(path, ROOT)}:{block.line}"
        if block.language == "python":
            yield block, _python(block, where, names, folder)
        elif block.language in SHELLS and (path != RUN_BY_CI or block.printed):
            yield block, _shell(block, where, folder)
        elif block.language == "toml" and (name := re.match(r"# (\S+\.toml)\n", block.code)):
            (folder / name[1]).write_text(block.code, encoding="utf-8")


def commands(block: Block) -> list[str]:
    """Return the commands of a shell's block, without comments; continued lines are one."""
    lines = block.code.replace("\\\n", " ").splitlines()
    if block.language == "console":
        lines = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
    return [line for line in lines if line.strip() and not line.startswith("#")]


def is_run(command: str) -> bool:
    """Return whether a command is run, and not one that installs or needs minutes."""
    return _NOT_RUN.match(command) is None


def same(said: str, printed: str, within: float | None = None) -> bool:
    """Return whether a page says what was printed: words exactly, numbers to the last digit.

    Or within so many percent; `...` stands for anything. Pieces between lines `...` come one behind
    the other.
    """
    lines, begin = printed.strip("\n").splitlines(), 0
    pieces = re.split(r"^\.\.\.$", said.strip("\n"), flags=re.MULTILINE)
    for number, piece in enumerate(pieces):
        wanted = piece.strip("\n").splitlines()
        end = len(lines) - len(wanted)
        places = range(begin, end + 1) if number else range(1)
        if number == len(pieces) - 1 and (wanted or number == 0):
            places = range(end, end + 1) if end in places else range(0)
        found = (at for at in places if _alike(wanted, lines[at : at + len(wanted)], within))
        if (place := next(found, None)) is None:
            return False
        begin = place + len(wanted)
    return True


def _alike(wanted: list[str], lines: list[str], within: float | None) -> bool:
    return len(wanted) == len(lines) and all(
        _same_line(one, other, within) for one, other in zip(wanted, lines, strict=True)
    )


def _same_line(wanted: str, line: str, within: float | None) -> bool:
    begin, said = 0, list(_NUMBER.finditer(wanted.strip()))
    pattern = ""
    for number in said:
        pattern += _pattern(wanted.strip()[begin : number.start()]) + f"({_NUMBER.pattern})"
        begin = number.end()
    found = re.fullmatch(pattern + _pattern(wanted.strip()[begin:]), line.strip())
    if found is None:
        return False
    printed = (_NUMBER.fullmatch(one) for one in found.groups()[:: 1 + _NUMBER.groups])
    return all(
        other is not None and _same_number(one, other, within)
        for one, other in zip(said, printed, strict=True)
    )


def _pattern(words: str) -> str:
    """Return the pattern of words between numbers, spaces and lines of a table of any length."""
    pattern = re.sub(r"(\\ )+", r"\\s+", re.escape(words))
    return re.sub("─+", "─+", pattern).replace(re.escape("..."), ".*")


def _same_number(said: re.Match[str], printed: re.Match[str], within: float | None) -> bool:
    """Return whether a number is the one that was printed.

    Whole numbers are counts: the same ones. Others may be off by one in the last digit of the one
    with more digits, since a value at the edge of two roundings may fall to either side.
    """
    off = abs(float(said[0]) - float(printed[0]))
    if within is not None:
        return off <= within / 100 * abs(float(said[0]))
    unit = min(_unit(said), _unit(printed))
    return off <= 1.001 * unit if unit < 1 or "e" in said[0] + printed[0] else off == 0


def _unit(number: re.Match[str]) -> float:
    """Return what one in the last digit shown of a number is worth."""
    return float(10.0 ** (int(number[2] or 0) - len(number[1] or "")))


def _python(block: Block, where: str, names: dict[str, Any], folder: Path) -> str:
    printed = io.StringIO()
    code = compile("\n" * (block.line - 1) + block.code, where, "exec")
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        exec(code, names)
    return printed.getvalue()


def _ending(command: str) -> str:
    """Return a command that ends by itself: a window is open for a moment, on any free port."""
    endless = command.startswith("seaid view ") and "--seconds" not in command
    return f"{command} --port 0 --seconds 0.1" if endless else command


_PLAIN = re.compile(r"seaid [^$`|&;<>*?~#(){}!]*")
"""A command of seaid in which the shell replaces nothing."""


def _plain_commands(lines: list[str], where: str, folder: Path) -> str:
    printed = ""
    for line in lines:
        with contextlib.chdir(folder), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            done = CliRunner(env={"COLUMNS": COLUMNS}).invoke(app, shlex.split(line)[1:])
        if done.exit_code:
            raise RuntimeError(f"{where}: {done.stderr.strip()}") from done.exception
        printed += done.stdout
    return printed


def _shell(block: Block, where: str, folder: Path) -> str:
    lines = [_ending(line) for line in commands(block) if is_run(line)]
    if all(map(_PLAIN.fullmatch, lines)):
        return _plain_commands(lines, where, folder)
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "OPENBLAS_NUM_THREADS": "1",
        "COLUMNS": COLUMNS,
    }
    done = subprocess.run(
        ["bash", "-e", "-c", "\n".join(lines)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{where}: exit code {done.returncode}: {done.stderr.strip()}")
    return done.stdout


def write_what_is_printed(path: Path) -> None:
    """Run a page and write what its blocks print into it."""
    text, shift = path.read_text(encoding="utf-8"), 0
    with tempfile.TemporaryDirectory() as folder:
        prepare(Path(folder), tuple(Path(name).resolve() for name in sys.argv[2:]))
        for block, printed in run_page(path, Path(folder)):
            if block.printed is None or "..." in block.printed[2].splitlines():
                if block.printed and not same(block.printed[2], printed, block.within):
                    print(f"line {block.line} prints:\n{printed}")
                continue
            start, end, _ = block.printed
            new = "\n".join(line.rstrip() for line in printed.strip("\n").splitlines()) + "\n"
            text = text[: start + shift] + new + text[end + shift :]
            shift += len(new) - (end - start)
    path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write_what_is_printed(Path(sys.argv[1]).resolve())
