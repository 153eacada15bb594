"""The notebook as a page: its text, its code, and what the cells printed and drew."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from scripts.notebook import pictures_of, printed_by, read

MARK = re.compile(r"<!-- notebook (\S+) -->")


def markdown(path: Path) -> str:
    """Return a notebook in Markdown below the title of a page, with its pictures."""
    return "\n\n".join(_blocks(path))


def _blocks(path: Path) -> Iterator[str]:
    for cell in read(path)["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            yield re.sub(r"\A# .*\n+", "", source)  # the page has a title
            continue
        yield f"```python\n{source}\n```"
        if text := printed_by(cell).strip("\n"):
            yield f"```text\n{text}\n```"
        for picture in pictures_of(cell):
            yield f"![Figure that the code above draws](data:image/png;base64,{picture})"
