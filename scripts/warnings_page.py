"""Write the index and a section for each code into `docs/warnings.md`, from `seaid.checks.CODES`.

python -m scripts.warnings_page

A section says what the checks of its code need of a log, if all that find it need something.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from seaid.checks import CODES, channels, columns, commands, model, setup, values, verdict
from seaid.checks.codes import Code
from seaid.errors import listed
from seaid.legged import base, contacts, extension, feet

CHECKS: tuple[Any, ...] = (
    *(*setup.OF_LOGS, *setup.OF_MOTION, *setup.MISTAKES, *setup.OF_COMMANDS, *setup.OF_REST),
    *(channels.strength_findings, channels.stop_findings, channels.limit_findings),
    *(*model.COLUMN_CHECKS, columns.unknown_scales, commands.delay_estimate_findings),
    *(*verdict.OF_FIT, values.noise_findings, values.drive_findings, values.fixed_findings),
    *(values.offset_findings, values.shared_findings, values.gear_findings),
    values.unused_findings,
    *(*base.RECORD_CHECKS, *feet.MOTION_CHECKS, *feet.LIFT_CHECKS, *contacts.FEET_CHECKS),
    *extension.LATE_CHECKS,
)
"""All checks that are declared: of logs, of motions, of equations, of values, of legged robots."""

PAGE = Path(__file__).resolve().parents[1] / "docs/warnings.md"

_MADE = "python -m scripts.warnings_page -->\n"
_INDEX = re.compile(rf"(?<=<!-- index: {_MADE}).*(?=<!-- end of the index -->)", re.S)
_SECTIONS = re.compile(rf"(?<=<!-- codes: {_MADE}).*(?=<!-- end -->)", re.S)


def needs_of(code: Code) -> str:
    """Return what a log needs for a code to be found, as a sentence; "" if nothing."""
    checks = [check for check in CHECKS if check.code is code]
    needs = dict.fromkeys(listed(need.words for need in check.needs) for check in checks)
    return f"**Looked for with:** {'; or with '.join(needs)}.\n\n" if needs and all(needs) else ""


def page_with_sections(page: str) -> str:
    """Return the text of the page with its index, and a section for each code named after it."""
    index = " · ".join(f"[{name}](#{name})" for name in sorted(CODES))
    sections = "".join(
        f"\n### {code.name}\n\n"
        f"`{code.name}` names {code.meaning}.\n\n"
        f"{needs_of(code)}**Cause:** {code.cause}\n\n**Advice:** {code.advice}\n"
        for code in CODES.values()
    )
    page = _INDEX.sub(lambda _: f"\n{index}\n\n", page)
    return _SECTIONS.sub(lambda _: f"{sections}\n", page)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page_with_sections(PAGE.read_text("utf-8")), "utf-8")


if __name__ == "__main__":
    main()
