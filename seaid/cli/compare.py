"""Command compare: two identifications side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument

from seaid.cli.messages import show
from seaid.cli.options import AsJson

_FILE = Argument(help="Parameters of seaid identify.", metavar="PARAMETERS")


def compare(
    first: Annotated[Path, _FILE],
    second: Annotated[Path, _FILE],
    *,
    as_json: AsJson = False,
) -> None:
    """Compare two identifications: which parameters differ significantly.

    For instance cold and warm, or before and after a repair. A difference is significant if it
    would be rare without one, in any of all parameters.

    seaid compare cold.json warm.json
    """
    from seaid.export import parameters_content
    from seaid.report import comparison_of_parameters

    names = (first.stem, second.stem) if first.stem != second.stem else (str(first), str(second))
    found = comparison_of_parameters(first, second, names=names)
    keys = (
        *("joint", "name", "unit", "first", "second", "first_error", "second_error"),
        *("change", "error", "significance", "p_value", "is_significant"),
    )
    content = {
        "names": found.names,
        "differences": [{key: getattr(one, key) for key in keys} for one in found.differences],
        "only": found.only,
    }
    show(found.summary(), content, as_json, robot=parameters_content(first)["robot"])
