"""What the panel of a view says, as HTML: the colour scale, and the numbers of all joints."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from seaid.arrays import Array
from seaid.robot import Robot
from seaid.view.colors import NEUTRAL, gradient, hexadecimal
from seaid.view.shapes import Color

_TEXT = "font-size:0.8em;line-height:1.45;margin:0 0.6em 0.5em"


def legend(robot: Robot, limits: Array) -> str:
    """Return the colour scale of deflections that end at `limits` (n,) [rad or m]."""
    bars = [
        _bar(limit, unit)
        for limit, unit in zip(_ends(robot, limits), ("mrad", "mm"), strict=True)
        if limit > 0
    ]
    if not bars:
        reason = "no deflection is known" if robot.elastic_joints else "no joint has a spring"
        return f'<div style="{_TEXT}">Joints are grey: {reason}.</div>'
    return (
        f'<div style="{_TEXT}"><b>Spring deflection about its mean</b>{"".join(bars)}'
        "motor side, through the gear, minus joint side. The zeros of encoders are not known, so "
        f"each mean is taken off. {_chip(NEUTRAL)} no spring</div>"
    )


def table(robot: Robot, position: Array, deflection: Array, colors: Sequence[Color]) -> str:
    """Return the numbers of all joints: position [rad or m], deflection [mrad or mm] of springs."""
    springs = bool(robot.elastic_joints)
    rows = []
    for index, (joint, slides) in enumerate(
        zip(robot.joint_names, robot.is_prismatic, strict=True)
    ):
        cells = [_number(position[index], ".3f", "m" if slides else "rad")]
        if springs:
            cells.append(_number(1e3 * deflection[index], ".2f", "mm" if slides else "mrad"))
        name = f"<td>{_chip(colors[index])} {escape(joint)}</td>"
        rows.append(f"<tr>{name}{''.join(map(_cell, cells))}</tr>")
    heads = ["position", "deflection"] if springs else ["position"]
    head = "".join(f'<th style="text-align:right">{word}</th>' for word in heads)
    return (
        f'<div style="{_TEXT}"><table style="width:100%;font-variant-numeric:tabular-nums">'
        f'<tr><th style="text-align:left">joint</th>{head}</tr>{"".join(rows)}</table></div>'
    )


def words(lines: Sequence[str]) -> str:
    """Return lines of plain text."""
    return f'<div style="{_TEXT}">{"<br>".join(escape(line) for line in lines)}</div>'


def _ends(robot: Robot, limits: Array) -> tuple[float, float]:
    """Return the end of the scale of turning joints [mrad] and of sliding ones [mm]."""
    sliding = np.array(robot.is_prismatic)
    turning, slid = (1e3 * np.max(limits[kind], initial=0.0) for kind in (~sliding, sliding))
    return float(turning), float(slid)


def _bar(limit: float, unit: str) -> str:
    ends = "".join(
        f"<span>{text}</span>" for text in (f"−{limit:.3g}", "0", f"+{limit:.3g} {unit}")
    )
    return (
        f'<div style="background:{gradient()};height:0.9em;border-radius:3px;margin-top:0.4em">'
        f'</div><div style="display:flex;justify-content:space-between">{ends}</div>'
    )


def _chip(color: Color) -> str:
    return (
        f'<span style="display:inline-block;width:0.8em;height:0.8em;border-radius:2px;'
        f'border:1px solid #888;vertical-align:-0.05em;background:{hexadecimal(color)}"></span>'
    )


def _cell(text: str) -> str:
    return f'<td style="text-align:right">{text}</td>'


def _number(value: float, form: str, unit: str) -> str:
    return f"{value:+{form}} {unit}".replace("-", "−") if np.isfinite(value) else ""
