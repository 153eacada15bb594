"""Pages and pictures by the templates of `seaid/report/page`: content goes in, markup comes out."""

from __future__ import annotations

import json
import math
from functools import cache
from importlib.resources import files
from typing import Any

from seaid._arrays import Array
from seaid._files import plain
from seaid.report.formats import explained_as, is_partial, share


def rendered(template: str, **content: Any) -> Any:
    """Return a page or a picture as markup; texts in the content are escaped."""
    from markupsafe import Markup

    return Markup(_environment().get_template(template).render(content))


@cache
def _environment() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("seaid.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["asset"] = _asset
    environment.filters |= {
        "in_script": _in_script,
        "svg_path": svg_path,
        "share": share,
        "explained": explained_as,
    }
    environment.tests |= {"finite": math.isfinite, "partial": is_partial}
    return environment


def _asset(name: str) -> Any:
    """Return a file of the page verbatim: style, script, or the chart library."""
    from markupsafe import Markup

    return Markup((files("seaid.report") / "page" / name).read_text(encoding="utf-8"))


def _in_script(content: Any) -> Any:
    """Return JSON that is safe inside a <script>: without '<', '>', '&' and NaN."""
    from markupsafe import Markup

    text = json.dumps(plain(content), allow_nan=False, separators=(",", ":"))
    # "</script>" inside a text would end the script.
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)


def svg_path(points: Array) -> str:
    """Return the path of an SVG through points (P, 2)."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
