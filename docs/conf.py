"""How the documents become a site: `make docs`. Nothing is fetched while it is built."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

from docutils.utils.math.latex2mathml import tex2mathml

sys.path.insert(0, str(Path(__file__).parent))

import commands
import notebooks

import seaid

project = "seaid"
author = "The seaid authors"
project_copyright = author
version = release = seaid.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"seaid {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
copybutton_exclude = ".linenos, .gp, .go"

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

# Docstrings are in NumPy style, with `names` in backticks; their types are prose, not links.
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
default_role = "code"
python_maximum_signature_line_length = 88
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
PACKAGES = [name for name in seaid.__all__ if isinstance(getattr(seaid, name), ModuleType)]
autodoc_type_aliases = {  # types that are only returned are in their packages
    **{
        name: f"seaid.{package}.{name}"
        for package in PACKAGES
        for name in getattr(getattr(seaid, package), "__all__", ())
        if name[0].isupper()
    },
    **{name: f"seaid.{name}" for name in seaid.__all__},
}
smartquotes = False
nitpicky = True
nitpick_ignore_regex = [
    ("py:class", r"(?!seaid\.[A-Z]).*"),  # types of other packages, and our own that are not public
    ("py:exc", r".*"),
    ("py:obj", r"typing\.(Literal|Annotated).*"),  # values and limits of an option in a signature
]

_SPACE = "{http://www.w3.org/1998/Math/MathML}"
_ACCENTS = ("\u02d9", "\u00a8")  # of time derivatives
_NUMBER = re.compile(r"\\tag\{(.*?)\}")


def _mathml(text: str, block: bool) -> str:
    """Return TeX as MathML, with the index of a dotted symbol to its right and not below."""
    ElementTree.register_namespace("", _SPACE[1:-1])
    math = ElementTree.fromstring(tex2mathml(text, as_block=block))
    for both in list(math.iter(f"{_SPACE}munderover")):
        symbol, index, accent = both
        if accent.text in _ACCENTS:
            both.tag, dotted = f"{_SPACE}msub", ElementTree.Element(f"{_SPACE}mover")
            dotted.extend((symbol, accent))
            both[:] = (dotted, index)
    for dotted in math.iter(f"{_SPACE}mover"):
        dotted.set("accent", "false")  # as an accent the dot falls into short letters
    return ElementTree.tostring(math, encoding="unicode")


def _inline(self: Any, node: Any) -> None:
    self.body.append(_mathml(node.astext(), block=False))


def _block(self: Any, node: Any) -> None:
    r"""Write an equation as MathML, which browsers show by themselves; \tag is its number."""
    number = _NUMBER.search(node.astext())
    equation = _mathml(_NUMBER.sub("", node.astext()).strip(), block=True)
    tag = f'<span class="eqno">({number[1]})</span>' if number else ""
    self.body.append(f'<div class="equation">{equation}{tag}</div>\n')


def _leave(self: Any, node: Any) -> None:
    pass


def _skip_children(visit: Any) -> Any:
    from docutils.nodes import SkipNode

    def visit_and_skip(self: Any, node: Any) -> None:
        visit(self, node)
        raise SkipNode

    return visit_and_skip


def _fill(app: Any, name: str, source: list[str]) -> None:
    """Put what the command line says of itself, and the notebook, in the place of their marks."""
    if commands.MARK in source[0]:
        source[0] = source[0].replace(commands.MARK, commands.markdown())
    if mark := notebooks.MARK.search(source[0]):
        page = notebooks.markdown(Path(__file__).parent / mark[1])
        source[0] = source[0].replace(mark[0], page)


_ARRAY = re.compile(
    r"~?numpy\.ndarray\[tuple\[~?typing\.Any, \.\.\.\], ~?numpy\.dtype\[[~.\w]+\]\]"
)
_OURS = re.compile(r"TypeAliasForwardRef\('([^']+)'\)|(?<![~\w.])(seaid\.(?:\w+\.)?[A-Z]\w*)")


def _shorten(
    app: Any, what: str, name: str, thing: Any, options: Any, signature: str | None, returns: Any
) -> tuple[str | None, str | None]:
    """Let public types of ours stand with their name alone, and link to their place."""

    def short(text: str | None) -> str | None:
        text = text and _ARRAY.sub("Array", text)
        return text and _OURS.sub(lambda found: "~" + (found[1] or found[2]), text)

    return short(signature), short(returns)


def setup(app: Any) -> None:
    """Register the equations and the commands."""
    inline, block = (_skip_children(_inline), _leave), (_skip_children(_block), _leave)
    app.add_html_math_renderer("mathml", inline, block)
    app.connect("source-read", _fill)
    app.connect("autodoc-process-signature", _shorten)


html_math_renderer = "mathml"
