"""Write the table of all codes into `docs/warnings.md`, from `seaid.checks.CODES`.

python -m scripts.warnings_page
"""

from __future__ import annotations

import re
from pathlib import Path

from seaid.checks import CODES

PAGE = Path(__file__).resolve().parents[1] / "docs/warnings.md"

_TABLE = re.compile(
    r"(?<=\| code \| meaning \| usual cause \| what to do \|\n)(\|(---\|)+\n)(\|.*\n)+"
)


def page_with_table(page: str) -> str:
    """Return the text of the page with the table of all codes."""
    rows = [
        f"| `{code.name}` | {code.meaning} | {code.cause} | {code.advice} |\n"
        for code in CODES.values()
    ]
    return _TABLE.sub(lambda found: found[1] + "".join(rows), page)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page_with_table(PAGE.read_text("utf-8")), "utf-8")


if __name__ == "__main__":
    main()
