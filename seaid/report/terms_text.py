"""Which terms the data support: a table, and the recommendation in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seaid.report.text import number, percent, table

if TYPE_CHECKING:
    from seaid.term_selection import TermGain, TermSelection


def terms_table(selection: TermSelection) -> str:
    """Return all terms that were asked about, step by step, and what is recommended."""
    header = ["joint: term", "step", "F", "BIC", "blocks left out", "better", "worth having"]
    rows = [_row(one) for one in selection.gains]
    notes = [f"! {_name(one)}: {one.reason}" for one in selection.gains if one.reason]
    title = "Is one more term worth having? BIC above zero, and error of blocks left out smaller"
    return "\n".join([table(title, header, rows), *notes, *_words(selection)])


def _row(one: TermGain) -> list[str]:
    if one.gain is None:
        return [_name(one), str(one.step + 1), *["-"] * 4, "not asked"]
    gain = one.gain
    left_out = f"{percent(gain.improvement)} +- {percent(gain.improvement_std)}"
    worth = "chosen" if one.chosen else "yes" if gain.is_worth_it else "no"
    blocks = f"{gain.better} of {gain.blocks}"
    return [
        _name(one),
        str(one.step + 1),
        number(gain.F),
        number(gain.bic),
        left_out,
        blocks,
        worth,
    ]


def _name(one: TermGain) -> str:
    return f"{one.joint}: {one.field.replace('_', ' ')} {one.term}"


def _words(selection: TermSelection) -> list[str]:
    if not selection.recommended:
        return ["The data support no term beyond those that the drives have."]
    return [
        f"{joint}: add "
        + ", ".join(f"'{term}' to {field}" for field, term in found)
        + "; identify(selection.robot, ...) estimates them"
        for joint, found in selection.recommended.items()
    ]
