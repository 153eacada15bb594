"""Pages of Markdown whose code runs: their blocks in order, in a folder, with one namespace.

A `python` block runs in this interpreter, an `sh` block in bash with the commands of this
environment, and so do the lines behind `$` of a `console` block. A `text` block right behind one is
what it prints; a line `...` there stands for any lines. A `toml` block whose first line names a
file (`# arm.toml`) is written as that file.

`python tests/pages.py docs/tutorial.md` runs a page and writes what it prints into its text blocks
(but for those with a line `...`).
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
SHARED = ("models", "scripts", "docs")
"""Folders of the project that a page may name."""

SHELLS = ("sh", "console")

_BLOCK = re.compile(r"^```([a-z]*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")
_NOT_RUN = re.compile(r"^(make|pip install|python -m pip install|git clone|cd|source|\.) ?")
RELATIVE, ABSOLUTE = 0.1, 1e-9


@dataclass(frozen=True)
class Block:
    """Code of a page: its language, text, line, and what it prints (start, end, text) or None."""

    language: str
    code: str
    line: int
    printed: tuple[int, int, str] | None = None


def pages() -> list[Path]:
    """Return the README and all documents."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(text: str) -> Iterator[Block]:
    """Return the blocks of a page, text blocks behind the code that prints them."""
    found = list(_BLOCK.finditer(text))
    for one, after in zip_longest(found, found[1:]):
        printed = None
        if after and after[1] == "text" and not text[one.end() : after.start()].strip():
            printed = (after.start(2), after.end(2), after[2])
        yield Block(one[1], one[2], text.count("\n", 0, one.start()) + 2, printed)


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
        where = f"{path.relative_to(ROOT)}:{block.line}"
        if block.language == "python":
            yield block, _python(block, where, names, folder)
        elif block.language in SHELLS:
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


def same(said: str, printed: str) -> bool:
    """Return whether a page says what was printed: words exactly, numbers to a few percent."""
    pieces = re.split(r"^\.\.\.$", said, flags=re.MULTILINE)
    if len(pieces) == 1:
        return _alike(said, printed)
    return all(_within(piece.strip("\n"), printed) for piece in pieces)


def _within(piece: str, printed: str) -> bool:
    wanted, lines = piece.splitlines(), printed.splitlines()
    places = range(len(lines) - len(wanted) + 1)
    return any(_alike(piece, "\n".join(lines[at : at + len(wanted)])) for at in places)


def _alike(wanted: str, printed: str) -> bool:
    words = [re.sub("─+", "─", _NUMBER.sub("#", text)).split() for text in (wanted, printed)]
    numbers = [[float(one) for one in _NUMBER.findall(text)] for text in (wanted, printed)]
    return words[0] == words[1] and all(
        abs(one - other) <= ABSOLUTE + RELATIVE * abs(one)
        for one, other in zip(*numbers, strict=True)
    )


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


def _shell(block: Block, where: str, folder: Path) -> str:
    lines = [_ending(line) for line in commands(block) if is_run(line)]
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "OPENBLAS_NUM_THREADS": "1",
        "COLUMNS": "110",
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
                if block.printed and not same(block.printed[2], printed):
                    print(f"line {block.line} prints:\n{printed}")
                continue
            start, end, _ = block.printed
            new = "\n".join(line.rstrip() for line in printed.strip("\n").splitlines()) + "\n"
            text = text[: start + shift] + new + text[end + shift :]
            shift += len(new) - (end - start)
    path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write_what_is_printed(Path(sys.argv[1]).resolve())
