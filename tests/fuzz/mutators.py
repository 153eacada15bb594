"""Mutators: each takes a random generator and something valid, and returns it damaged.

They know formats (bytes, texts, trees of JSON and TOML, XML, columns of samples), and nothing of
seaid. The same generator gives the same damage on every machine.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from random import Random
from typing import Any, TypeVar

import numpy as np
from lxml import etree

T = TypeVar("T")
Way = Callable[[Random, T], T]
Columns = dict[str, Any]

NUMBERS = (
    *("0", "-0.0", "-1", "1", "3", "1e-320", "1e-12", "1e12", "1e155", "-1e200", "1e308", "1e309"),
    *(
        "nan",
        "NaN",
        "inf",
        "-Infinity",
        "9" * 400,
        "9" * 5000,
        "0x10",
        "1_0",
        "١",
        "1,5",
        "",
        "true",
    ),
)
NAMES = (
    *("", " ", ".", "..", "a.b", "a[0]", "a[-1]", "q[99999999999999999999]", "time_s", "type"),
    *("θ", "关节", "τ_motor", "\u202eabc", "e\u0301", "\ufeff", "🤖", "𝐞val", "a\nb", "a\tb"),
    *("a\x00b", "\x1b[31m", "\ud800", "<b>x</b>", "<script>alert(1)</script>", "--><x/>", "&amp;"),
    *("x*/ #error", "*/ int main(){} /*", '"; import os', "%s%n", "{0}", "$(id)", "{{7*7}}"),
    *("../../etc/passwd", "/dev/zero", "file:///etc/passwd", "package://x/y", "CON", "a" * 70_000),
)
EXPRESSIONS = (
    *("theta_M_dot**3", "c*sin(q)", "1/0", "9**9**9**9", "10**(10**9)", "x" * 3000, "(" * 500),
    *("+".join("abcdefgh") * 300, "-" * 4000 + "a", "a if b else c", "[x for x in y]", "lambda: 0"),
    *("__import__('os').mkdir('pwned')", "𝐞val(\"__import__('os').mkdir('pwned')\")"),
    *("().__class__.__mro__", "c*theta_M_dot.diff()", "c*Symbol('x')", "c;d", "c #", "f'{c}'"),
    *("factorial(10**7)*c", "zoo", "oo*c", "nan", "I*c", "c*theta_M_dot**1e999", "0*c", "True"),
)
VALUES: tuple[Any, ...] = (
    *(0, -1, 1, 3, 0.5, -0.0, 1e-320, 1e155, -1e200, 1e308, float("nan"), float("inf"), 10**400),
    *(True, False, None, "", [], {}, [[]], [0.0] * 3, [1e308, -1e308], ["a", 1, None], {"a": {}}),
    *(2**63, -(2**63) - 1, 2**31, "0", "1.0", "linear", "viscous", [[1, 2], [3]], {"": 0}),
)
INTEGERS = (
    0,
    1,
    2,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63,
    2**64 - 1,
)


def damaged(rng: Random, value: T, ways: tuple[Way[T], ...]) -> T:
    """Return a value damaged in one way, or in several after another."""
    for _ in range(1 + min(int(rng.expovariate(1.5)), 5)):
        value = rng.choice(ways)(rng, value)
    return value


# Bytes


def _stretch(rng: Random, data: bytes) -> tuple[int, int]:
    start = rng.randrange(len(data) + 1)
    return start, min(len(data), start + int(rng.expovariate(1 / 40)) + 1)


def _flip(rng: Random, data: bytes) -> bytes:
    found = bytearray(data)
    for _ in range(rng.randint(1, 6) if found else 0):
        found[rng.randrange(len(found))] = rng.randrange(256)
    return bytes(found)


def _flip_at_the_ends(rng: Random, data: bytes) -> bytes:
    """Change bytes near the begin or the end, where formats have their headers."""
    size = min(len(data), 400)
    if rng.random() < 0.5:
        return _flip(rng, data[:size]) + data[size:]
    return data[: len(data) - size] + _flip(rng, data[len(data) - size :])


def _integer(rng: Random, data: bytes) -> bytes:
    size = rng.choice((1, 2, 4, 8))
    value = rng.choice(INTEGERS) % 2 ** (8 * size)
    start, _ = _stretch(rng, data)
    return data[:start] + value.to_bytes(size, rng.choice(("little", "big"))) + data[start + size :]


def _cut_off(rng: Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _without(rng: Random, data: bytes) -> bytes:
    start, end = _stretch(rng, data)
    return data[:start] + data[end:]


def _repeated(rng: Random, data: bytes) -> bytes:
    start, end = _stretch(rng, data)
    return data[:end] + data[start:end] * rng.choice((1, 2, 300)) + data[end:]


def _moved(rng: Random, data: bytes) -> bytes:
    start, end = _stretch(rng, data)
    other, _ = _stretch(rng, data)
    return data[:other] + data[start:end] + data[other:]


def _zeros(rng: Random, data: bytes) -> bytes:
    start, end = _stretch(rng, data)
    return data[:start] + bytes(end - start) + data[end:]


BYTES: tuple[Way[bytes], ...] = (
    *(_flip, _flip, _flip_at_the_ends, _flip_at_the_ends, _integer, _integer),
    *(_cut_off, _without, _repeated, _moved, _zeros),
)


def damaged_bytes(rng: Random, data: bytes) -> bytes:
    """Return a binary file damaged."""
    return damaged(rng, data, BYTES)


# Texts


def _replaced(pattern: str, words: tuple[str, ...]) -> Way[str]:
    """Return a way that puts one of the words in the place of a match."""

    def way(rng: Random, text: str) -> str:
        found = list(re.finditer(pattern, text))
        if not found:
            return text
        one = rng.choice(found)
        return text[: one.start()] + rng.choice(words) + text[one.end() :]

    return way


def _lines(rng: Random, text: str) -> str:
    lines = text.splitlines(keepends=True) or [""]
    start, end = sorted((rng.randrange(len(lines)), rng.randrange(len(lines))))
    end = min(end, start + 5)
    return "".join(
        rng.choice(
            (
                lines[:start] + lines[end:],
                lines[:end] + lines[start:],
                lines[end:] + lines[:end],
                lines[:start] + lines[start:end] * 200 + lines[end:],
            )
        )
    )


def _inserted(rng: Random, text: str) -> str:
    place = rng.randrange(len(text) + 1)
    marks = (
        "[" * 3000,
        "{" * 3000,
        '{"a":' * 3000,
        '"',
        "'",
        "\x00",
        "\n",
        ",",
        "=",
        "]",
        "\ufeff",
    )
    return text[:place] + rng.choice((*marks, *NUMBERS)) + text[place:]


_number = _replaced(r"-?\d+(\.\d*)?([eE][-+]?\d+)?", NUMBERS)
_word = _replaced(r"[A-Za-z_]{2,}", NAMES)
TEXTS: tuple[Way[str], ...] = (_number, _number, _word, _lines, _inserted)
_CODINGS = ("utf-8",) * 40 + ("utf-16", "latin-1", "utf-8-sig")


def damaged_text(rng: Random, text: str) -> bytes:
    """Return a text file damaged: in its words and numbers, its lines, or as bytes."""
    if rng.random() < 0.1:
        return damaged_bytes(rng, text.encode())
    return encoded(rng, damaged(rng, text, TEXTS))


def encoded(rng: Random, text: str) -> bytes:
    """Return the bytes of a text, now and then in another encoding."""
    coding = rng.choice(_CODINGS)
    return text.encode(coding, "surrogatepass" if coding.startswith("utf") else "replace")


# Trees of JSON and TOML


def _places(tree: Any) -> list[tuple[Any, Any]]:
    """Return all (mapping, key) and (list, index) of a tree."""
    own = (
        list(tree) if isinstance(tree, dict) else range(len(tree) if isinstance(tree, list) else 0)
    )
    return [pair for key in own for pair in ((tree, key), *_places(tree[key]))]


def damaged_tree(rng: Random, tree: Any, more: tuple[Any, ...] = ()) -> Any:
    """Return a tree of plain data with other values, keys and shapes; `more` are values to put."""
    tree = copy.deepcopy(tree)
    for _ in range(1 + min(int(rng.expovariate(1.5)), 5)):
        if not (places := _places(tree)):
            return tree
        place, key = rng.choice(places)
        alike = [one for one in places if type(one[0][one[1]]) is type(place[key])]
        other, other_key = rng.choice(rng.choice((places, alike, alike)))
        way = rng.randrange(10)
        if way == 0:
            del place[key]
        elif way == 1 and isinstance(place, dict):
            place[rng.choice((*NAMES, str(other_key)))] = place.pop(key)
        elif way in (2, 3):
            place[key] = copy.deepcopy(other[other_key])
        elif way == 4:
            place[key] = rng.choice(([place[key]], [place[key]] * 3, {"a": place[key]}))
        elif way >= 6 and isinstance(place[key], float):
            place[key] *= rng.choice((-1.0, 0.0, 1e-300, 1e-9, 1e-3, 0.3, 3.0, 1e3, 1e9, 1e150))
        else:
            place[key] = copy.deepcopy(rng.choice(rng.choice((VALUES, NAMES, more or VALUES))))
    return tree


# XML


def damaged_xml(rng: Random, text: str) -> bytes:
    """Return an XML file with other attributes, and elements lost, doubled or moved."""
    if rng.random() < 0.15:
        return damaged_text(rng, text)
    root = etree.fromstring(text.encode())
    for _ in range(1 + min(int(rng.expovariate(1.5)), 5)):
        elements = [one for one in root.iter() if isinstance(one.tag, str)]
        one, other = rng.choice(elements), rng.choice(elements)
        way, parent = rng.randrange(8), one.getparent()
        if way == 0 and parent is not None:
            parent.remove(one)
        elif way == 1 and parent is not None:
            parent.append(copy.deepcopy(one))
        elif way == 2:
            other.append(copy.deepcopy(one))
        elif way == 3:
            one.tag = other.tag
        elif one.attrib:
            key = rng.choice(sorted(one.attrib))
            _set(rng, one, key, other)
    return encoded(rng, etree.tostring(root, encoding="unicode"))


def _set(rng: Random, element: Any, key: str, other: Any) -> None:
    """Set an attribute to another value: of one number in it, or the whole."""
    words = element.get(key).split() or [""]
    words[rng.randrange(len(words))] = rng.choice(NUMBERS)
    others = [str(value) for value in other.attrib.values()]
    value = rng.choice((" ".join(words), " ".join(words), rng.choice(NAMES), *others))
    try:
        element.set(key, value)
    except ValueError:  # characters that XML does not allow: the text mutators write them
        del element.attrib[key]


# Columns of samples


def _times(rng: Random, values: Any) -> Any:
    """Return samples with some of them other numbers."""
    found = np.array(values, dtype=np.float64)
    start, end = sorted(rng.randrange(len(found) + 1) for _ in range(2))
    rows = slice(start, rng.choice((start + 1, end, None)))
    number = rng.choice((np.nan, np.inf, -np.inf, 0.0, 1e155, -1e300, 1e-300, 1e18, 1e6))
    found[rows] = rng.choice((number, number, found[:1].sum()))
    return found


def _scaled(rng: Random, values: Any) -> Any:
    factor = rng.choice((-1.0, 0.0, 57.3, 1e-9, 1e9, 1e-160, 1e160, 1e300))
    return np.array(values, dtype=np.float64) * factor + rng.choice((0.0, 0.0, 1e9, 1e15))


def _other_type(rng: Random, values: Any) -> Any:
    kinds = ("i1", "u8", "i8", "f2", "f4", "?", "c16", "U8", "S4", "O", "M8[ns]", "m8[ms]", ">f8")
    with np.errstate(all="ignore"):
        return np.array(values).astype(rng.choice(kinds))


def _other_shape(rng: Random, values: Any) -> Any:
    count = len(values)
    shapes = [values[:0], values[:1], values[: count // 2], np.repeat(values, 2), values[::-1]]
    shapes += [
        values[:, None],
        np.stack([values] * 3, axis=1),
        np.array(1.0),
        values[None, :, None],
    ]
    return rng.choice(shapes)


def _shuffled(rng: Random, values: Any) -> Any:
    order = list(range(len(values)))
    rng.shuffle(order)
    return values[order]


def damaged_samples(rng: Random, columns: Columns) -> Columns:
    """Return columns with other numbers, holes, repeats and disorder; as long as each other."""
    found = dict(columns)
    for _ in range(1 + min(int(rng.expovariate(1.5)), 5)):
        name, count = rng.choice(list(found)), len(next(iter(found.values())))
        start, end = sorted(rng.randrange(count + 1) for _ in range(2))
        way = rng.randrange(8)
        if way == 0 and end - start < count - 1:  # a hole
            found = {key: np.delete(values, slice(start, end)) for key, values in found.items()}
        elif way == 1:  # samples that are there twice
            rows = np.r_[:end, start:count]
            found = {key: values[rows] for key, values in found.items()}
        elif way == 2:
            found = {key: values[: max(2, start)] for key, values in found.items()}
        elif way == 3:
            found[name] = _shuffled(rng, found[name])
        elif way == 4:
            found[name] = _scaled(rng, found[name])
        elif way == 5:
            found[name] = found[rng.choice(list(found))]
        else:
            found[name] = _times(rng, found[name])
    return found


def damaged_columns(rng: Random, columns: Columns) -> Columns:
    """Return columns damaged as a file may have them: also names, types, shapes and numbers."""
    found = damaged_samples(rng, columns) if rng.random() < 0.5 else dict(columns)
    for _ in range(1 + min(int(rng.expovariate(1.5)), 3)):
        name = rng.choice(list(found))
        way = rng.randrange(6)
        if way == 0 and len(found) > 1:
            del found[name]
        elif way == 1:
            found[rng.choice((*NAMES, rng.choice(list(found))))] = found.pop(name)
        elif way == 2 and rng.random() < 0.1:
            found |= {f"{name}_{index}": found[name][:3] for index in range(3000)}
        elif getattr(found[name], "ndim", 0) == 1 and len(found[name]):
            found[name] = rng.choice((_other_type, _other_shape))(rng, found[name])
    return found
