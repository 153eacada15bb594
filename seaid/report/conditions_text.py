"""What several conditions told together, as a table in text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seaid.report.text import number, table

if TYPE_CHECKING:
    from seaid.conditions import Conditions
    from seaid.identification import Identification


def conditions_table(together: Conditions) -> str:
    """Return the own parameters of all conditions beside each other, and whether they differ.

    They differ where the Bayesian information criterion is for a value of each condition's own.
    """
    rows = []
    for name, test in together.differences.items():
        values = [_text(found, name) for found in together.found.values()]
        differ = "yes" if test.bic > 0 else "no"
        rows.append([name, *values, number(test.F), number(test.bic), differ])
    count = len(together.found)
    title = f"{count} conditions together: what each has of its own (value +- standard error)"
    return table(title, ["parameter", *together.found, "F", "BIC", "differ"], rows)


def _text(found: Identification, name: str) -> str:
    if name in found.load_side.names:
        estimate, key = found.load_side, name
    else:
        key, joint = name.split(" of ", 1)
        estimate = found.drivetrains[joint]
    return f"{number(estimate.value(key))} +- {estimate.standard_error(key):.2g}"
