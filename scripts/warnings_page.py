"""Write the index and a section for each code into `docs/warnings.md`, from `seaid.checks.CODES`.

python -m scripts.warnings_page
"""

from __future__ import annotations

import re
from pathlib import Path

from seaid.checks import CODES

PAGE = Path(__file__).resolve().parents[1] / "docs/warnings.md"

_MADE = "python -m scripts.warnings_page -->\n"
_INDEX = re.compile(rf"(?<=<!-- index: {_MADE}).*(?=<!-- end of the index -->)", re.S)
_SECTIONS = re.compile(rf"(?<=<!-- codes: {_MADE}).*(?=<!-- end -->)", re.S)


def page_with_sections(page: str) -> str:
    """Return the text of the page with its index, and a section for each code named after it."""
    index = " · ".join(f"[{name}](#{name})" for name in sorted(CODES))
    sections = "".join(
        f"\n### {code.name}\n\n"
        f"`{code.name}` names {code.meaning}.\n\n"
        f"**Cause:** {code.cause}\n\n**Advice:** {code.advice}\n"
        for code in CODES.values()
    )
    page = _INDEX.sub(lambda _: f"\n{index}\n\n", page)
    return _SECTIONS.sub(lambda _: f"{sections}\n", page)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page_with_sections(PAGE.read_text("utf-8")), "utf-8")


if __name__ == "__main__":
    main()
