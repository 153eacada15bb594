"""The XML of a URDF as elements, counted while it is read: a file too large is refused early."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from seaid.errors import RobotError

LARGEST_BYTES = 64_000_000
"""Of a URDF file."""

MOST_JOINTS, MOST_ELEMENTS = 5_000, 500_000
"""Of a URDF: joints, links as many and one more, and elements of all kinds.

Pinocchio keeps for each joint all that are before and behind it: 5,000 in a row take 1 GB.
"""

_PIECE_BYTES = 65_536


def parse_urdf(path: Path, text: bytes) -> Any:
    """Return the <robot> element of a URDF's text, without comments; `path` names it.

    Raises RobotError for what is not well-formed, for another root, and for more joints, links or
    elements than allowed, as soon as they are counted.
    """
    from lxml import etree

    parser = etree.XMLPullParser(events=("start",), remove_comments=True, remove_pis=True)
    counts = {"joint": 0, "link": 0}
    elements = 0
    try:
        for start in range(0, max(len(text), 1), _PIECE_BYTES):
            parser.feed(text[start : start + _PIECE_BYTES])
            for _, element in parser.read_events():
                elements += 1
                if element.tag in counts:
                    counts[element.tag] += 1
            _check_counts(path, counts, elements)
        root = parser.close()
    except etree.XMLSyntaxError as problem:
        raise RobotError(f"URDF '{path}' is not well-formed XML: {problem.msg}") from None
    if root.tag != "robot":
        raise RobotError(f"'{path}' is not a URDF: its root tag is <{root.tag}>, not <robot>")
    return root


def _check_counts(path: Path, counts: dict[str, int], elements: int) -> None:
    for what, found, most in (
        ("joints", counts["joint"], MOST_JOINTS),
        ("links", counts["link"], MOST_JOINTS + 1),
        ("elements", elements, MOST_ELEMENTS),
    ):
        if found > most:
            raise RobotError(f"URDF '{path}' has more than the {most:,} {what} that are allowed")
