"""Write a section for each code into `docs/warnings.md`, from `seaid.checks.CODES`.

python -m scripts.warnings_page
"""

from __future__ import annotations

import re
from pathlib import Path

from seaid.checks import CODES

PAGE = Path(__file__).resolve().parents[1] / "docs/warnings.md"

_SECTIONS = re.compile(
    r"(?<=<!-- codes: python -m scripts.warnings_page -->\n).*(?=<!-- end -->)", re.S
)


def page_with_sections(page: str) -> str:
    """Return the text of the page with a section for each code, whose heading is its name."""
    sections = "".join(
        f"\n### {code.name}\n\n"
        f"{code.meaning[:1].upper()}{code.meaning[1:]}.\n\n"
        f"**Cause:** {code.cause}\n\n**Advice:** {code.advice}\n"
        for code in CODES.values()
    )
    return _SECTIONS.sub(lambda _: f"{sections}\n", page)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page_with_sections(PAGE.read_text("utf-8")), "utf-8")


if __name__ == "__main__":
    main()
