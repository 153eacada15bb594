"""An XML file as text with places: some attributes and elements change, all else stays as it was.

Comments, order, quotes, line ends, entities and encoding are no matter of taste in a file that
others wrote; so the text itself is changed, where expat says that an element stands.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.parsers import expat

Edit = tuple[int, int, bytes]
"""First byte, byte after the last one, and what stands there instead."""

_START_TAG = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=/>]+\s*=\s*(?:"[^"]*"|'[^']*'))*\s*/?>""")


@dataclass(eq=False)
class Element:
    """Where an element stands: `start` to `end`, its content from `inside` on."""

    tag: str
    attributes: Mapping[str, str]
    start: int
    inside: int
    end: int
    children: list[Element]

    def find(self, tag: str) -> Element | None:
        """Return the first child of a tag, None if there is none."""
        return next((one for one in self.children if one.tag == tag), None)

    def named(self, tag: str) -> dict[str, Element]:
        """Return {name: child} of all children of a tag that have a name."""
        found = (one for one in self.children if one.tag == tag)
        return {one.attributes["name"]: one for one in found if "name" in one.attributes}

    def all(self) -> Iterable[Element]:
        """Yield the element and all inside it."""
        yield self
        for child in self.children:
            yield from child.all()


def read_places(text: bytes) -> Element:
    """Return the root element of an XML text and all inside it.

    A tag in a namespace begins with that and a space, so it is none of those without.
    Raises ValueError for what is not well-formed, or not in an encoding that has ASCII in it.
    """
    parser = expat.ParserCreate(namespace_separator=" ")
    top = Element("", {}, 0, 0, 0, [])
    waiting = [top]

    def begin(tag: str, attributes: Mapping[str, str]) -> None:
        at = parser.CurrentByteIndex
        found = _START_TAG.match(text, at)
        if found is None:
            raise ValueError("its encoding is not one of single bytes or UTF-8")
        element = Element(tag, attributes, at, found.end(), found.end(), [])
        waiting[-1].children.append(element)
        waiting.append(element)

    def finish(_: str) -> None:
        element = waiting.pop()
        if not is_empty(text, element):
            element.end = text.index(b">", parser.CurrentByteIndex) + 1

    parser.StartElementHandler, parser.EndElementHandler = begin, finish
    try:
        parser.Parse(text, True)
    except expat.ExpatError as problem:
        raise ValueError(str(problem)) from None
    return top.children[0]


def is_empty(text: bytes, element: Element) -> bool:
    """Tell whether an element is one tag, <a/>."""
    return text.endswith(b"/>", element.start, element.inside)


def with_children(
    text: bytes, parent: Element, children: Mapping[str, Mapping[str, str]]
) -> list[Edit]:
    """Return the edits that give an element children with attributes, made where missing."""
    edits, missing = [], {}
    for tag, attributes in children.items():
        child = parent.find(tag)
        if child is None:
            missing[tag] = attributes
        else:
            old = text[child.start : child.inside]
            edits.append((child.start, child.inside, _with_attributes(old, attributes)))
    if missing:
        edits.append(with_content(text, parent, [_tag(*one) for one in missing.items()]))
    return edits


def new_element(tag: str, children: Mapping[str, Mapping[str, str]]) -> bytes:
    """Return an element in one line."""
    content = b"".join(_tag(*one) for one in children.items())
    return b"<%b>%b</%b>" % (tag.encode(), content, tag.encode())


def with_content(text: bytes, parent: Element, elements: Iterable[bytes]) -> Edit:
    """Return the edit that puts elements first into another one, indented as what follows."""
    outer = _indent(text, parent.start)
    if not is_empty(text, parent):
        follows = re.compile(rb"\r?\n[ \t]*(?=<(?!/))").match(text, parent.inside)
        indent = follows.group() if follows is not None else outer and outer + b"  "
        return parent.inside, parent.inside, b"".join(indent + one for one in elements)
    content = b"".join((outer and outer + b"  ") + one for one in elements)
    opened = text[parent.start : parent.inside].removesuffix(b"/>").rstrip() + b">"
    close = b"%b</%b>" % (outer, parent.tag.encode())
    return parent.start, parent.inside, opened + content + close


def without(text: bytes, element: Element) -> Edit:
    """Return the edit that takes an element away, with the space before it."""
    start = element.start
    while start and text[start - 1 : start].isspace():
        start -= 1
    return start, element.end, b""


def edited(text: bytes, edits: Iterable[Edit]) -> bytes:
    """Return a text with edits made, which do not overlap."""
    parts, done = [], 0
    for start, end, new in sorted(edits):
        parts += [text[done:start], new]
        done = end
    return b"".join([*parts, text[done:]])


def _indent(text: bytes, start: int) -> bytes:
    """Return the end of line and the spaces before a place, nothing if something else is there."""
    line = text.rfind(b"\n", 0, start)
    if line < 0 or text[line + 1 : start].strip(b" \t"):
        return b""
    return text[line - (text[line - 1 : line] == b"\r") : start]


def _tag(tag: str, attributes: Mapping[str, str]) -> bytes:
    return _with_attributes(b"<%b/>" % tag.encode(), attributes)


def _with_attributes(tag: bytes, attributes: Mapping[str, str]) -> bytes:
    """Return a start tag with attributes set, those that are there in their places."""
    for name, value in attributes.items():
        key, quoted = name.encode(), b'"%b"' % value.encode()
        there = re.search(rb"""\s%b\s*=\s*("[^"]*"|'[^']*')""" % re.escape(key), tag)
        if there is not None:
            tag = tag[: there.start(1)] + quoted + tag[there.end(1) :]
            continue
        close = re.search(rb"\s*/?>\Z", tag)
        assert close is not None  # it matched as a start tag
        tag = tag[: close.start()] + b" %b=%b" % (key, quoted) + tag[close.start() :]
    return tag
