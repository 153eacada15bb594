"""Mutators: each takes a random generator and something valid, and returns it damaged.

They know formats (bytes, texts, trees of JSON and TOML, XML, columns of samples), and nothing of
seaid. The same generator gives the same damage on every machine.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from random import Random
from typing import Any, TypeVar

import numpy as np
from lxml import etree

T = TypeVar("T")
Way = Callable[[Random, T], T]
Columns = dict[str, Any]


def words(text: str) -> tuple[str, ...]:
    """Return the words of a text."""
    return tuple(text.split())


NUMBERS = (
    *words("0 -0.0 -1 1 3 1e-320 1e-12 1e12 1e155 -1e200 1e308 1e309 nan NaN inf -Infinity"),
    *("9" * 400, "9" * 5000, *words("0x10 1_0 ١ 1,5 true"), ""),
)
NAMES = (
    *words("a.b a[0] a[-1] q[99999999999999999999] time_s type θ 关节 τ_motor 🤖 𝐞val . .. &amp;"),
    *words("<b>x</b> <script>alert(1)</script> --><x/> %s%n {0} $(id) {{7*7}} /dev/zero CON"),
    *words("../../etc/passwd file:///etc/passwd package://x/y"),
    *("", " ", "\u202eabc", "e\u0301", "\ufeff", "a\nb", "a\tb", "a\x00b", "\x1b[31m", "\ud800"),
    *("x*/ #error", "*/ int main(){} /*", '"; import os', "a" * 70_000),
)
EXPRESSIONS = (
    *words("theta_M_dot**3 c*sin(q) 1/0 9**9**9**9 10**(10**9) zoo oo*c nan I*c 0*c True c;d"),
    *words("().__class__.__mro__ c*theta_M_dot.diff() c*Symbol('x') factorial(10**7)*c c**1e999"),
    *("x" * 3000, "(" * 500, "+".join("abcdefgh") * 300, "-" * 4000 + "a", "a if b else c", "c #"),
    *("[x for x in y]", "lambda: 0", "__import__('os').mkdir('pwned')"),
    "𝐞val(\"__import__('os').mkdir('pwned')\")",
)
VALUES: tuple[Any, ...] = (
    *(0, -1, 1, 3, 0.5, -0.0, 1e-320, 1e155, -1e200, 1e308, float("nan"), float("inf"), 10**400),
    *(True, False, None, "", [], {}, [[]], [0.0] * 3, [1e308, -1e308], ["a", 1, None], {"a": {}}),
    *(2**63, -(2**63) - 1, 2**31, "0", "1.0", "linear", "viscous", [[1, 2], [3]], {"": 0}),
)
INTEGERS = (0, 1, 2, 127, 128, 255, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)


def times(rng: Random) -> range:
    """Return how often something is damaged: once mostly, six times at most."""
    return range(1 + min(int(rng.expovariate(1.5)), 5))


def damaged(rng: Random, value: T, ways: Sequence[Way[T]]) -> T:
    """Return a value damaged in one way, or in several after another."""
    for _ in times(rng):
        value = rng.choice(ways)(rng, value)
    return value


# Bytes


def _flip(rng: Random, data: bytes) -> bytes:
    """Change bytes anywhere, or near one of the ends, where formats have their headers."""
    found, size = bytearray(data), len(data)
    first, last = rng.choice(((0, size), (0, min(400, size)), (max(0, size - 400), size)))
    for _ in range(rng.randint(1, 6) if size else 0):
        found[rng.randrange(first, last)] = rng.randrange(256)
    return bytes(found)


def _integer(rng: Random, data: bytes) -> bytes:
    size, start = rng.choice((1, 2, 4, 8)), rng.randrange(len(data) + 1)
    value = rng.choice(INTEGERS) & ((1 << 8 * size) - 1)
    content = value.to_bytes(size, "little" if rng.random() < 0.5 else "big")
    return data[:start] + content + data[start + size :]


def _stretch(rng: Random, data: bytes) -> bytes:
    """Lose, repeat, move or clear some bytes, or cut the rest off."""
    start, other = rng.randrange(len(data) + 1), rng.randrange(len(data) + 1)
    end = min(len(data), start + int(rng.expovariate(1 / 40)) + 1)
    some = data[start:end]
    ways = (b"", some * rng.choice((2, 3, 300)), bytes(len(some)), some + data[other : other + 40])
    rest: bytes = rng.choice((*(way + data[end:] for way in ways), b""))
    return data[:start] + rest


def damaged_bytes(rng: Random, data: bytes) -> bytes:
    """Return a binary file damaged."""
    return damaged(rng, data, (_flip, _flip, _integer, _stretch))


# Texts

_LONGEST = 5_000_000
"""Letters up to which lines are repeated: making a case must not take as long as reading it."""

_MARKS = ("[" * 3000, "{" * 3000, '{"a":' * 3000, *"\"',=]", "\x00", "\n", "\ufeff", *NUMBERS)


def _replaced(pattern: str, others: Sequence[str]) -> Way[str]:
    """Return a way that puts one of the others in the place of a match."""

    def way(rng: Random, text: str) -> str:
        places = [one.span() for one in re.finditer(pattern, text)]
        start, end = rng.choice(places) if places else (0, 0)
        return text[:start] + rng.choice(others) + text[end:]

    return way


def _lines(rng: Random, text: str) -> str:
    """Lose, repeat or move some lines."""
    lines = text.splitlines(keepends=True)
    start = rng.randrange(len(lines) + 1)
    some, rest = lines[start : start + rng.randint(1, 5)], lines[:start] + lines[start + 1 :]
    place = rng.randrange(len(rest) + 1)
    often = rng.choice((0, 1, 2, 200))
    often = min(often, max(2, _LONGEST // max(sum(map(len, some)), 1)))
    return "".join(rest[:place] + some * often + rest[place:])


_number = _replaced(r"-?\d+(\.\d*)?([eE][-+]?\d+)?", NUMBERS)
_TEXTS = (_number, _number, _replaced(r"[A-Za-z_]{2,}", NAMES), _replaced("", _MARKS), _lines)


def damaged_text(rng: Random, text: str) -> bytes:
    """Return a text file damaged: in its words and numbers, its lines, or as bytes."""
    if rng.random() < 0.1:
        return damaged_bytes(rng, text.encode("utf-8", "surrogatepass"))
    return encoded(rng, damaged(rng, text, _TEXTS))


def encoded(rng: Random, text: str) -> bytes:
    """Return the bytes of a text, now and then in another encoding."""
    coding = rng.choice(("utf-8",) * 40 + ("utf-16", "latin-1", "utf-8-sig"))
    return text.encode(coding, "surrogatepass" if coding.startswith("utf") else "replace")


# Trees of JSON and TOML, and XML


def _places(tree: Any) -> list[tuple[Any, Any]]:
    """Return all (mapping, key) and (list, index) of a tree."""
    keys = list(tree) if isinstance(tree, dict) else range(len(tree))
    below = (tree[key] for key in keys if isinstance(tree[key], dict | list))
    return [(tree, key) for key in keys] + [place for one in below for place in _places(one)]


def damaged_tree(rng: Random, tree: Any, more: Sequence[Any] = VALUES) -> Any:
    """Return a tree of plain data with other values, keys and shapes; `more` are values to put."""
    tree = copy.deepcopy(tree)
    for _ in times(rng):
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
            place[key] = copy.deepcopy(rng.choice(rng.choice((VALUES, NAMES, more))))
    return tree


def damaged_xml(rng: Random, text: str) -> bytes:
    """Return an XML file with other attributes, and elements lost, doubled or moved."""
    if rng.random() < 0.15:
        return damaged_text(rng, text)
    root = etree.fromstring(text.encode())
    for _ in times(rng):
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
            parts = one.get(key).split() or [""]
            parts[rng.randrange(len(parts))] = rng.choice(NUMBERS)
            value = rng.choice((" ".join(parts), rng.choice(NAMES), *other.attrib.values()))
            # XML has no control characters: the text mutators write them
            one.set(key, re.sub("[\x00-\x08\x0b-\x1f\ud800-\udfff\ufffe\uffff]", "", str(value)))
    return encoded(rng, etree.tostring(root, encoding="unicode"))


# Columns of samples


def _other_samples(rng: Random, values: Any) -> Any:
    """Return samples some of which are other numbers, or all scaled, or in another order."""
    found = np.array(values, dtype=np.float64)
    start, end = sorted(rng.randrange(len(found) + 1) for _ in range(2))
    way = rng.randrange(4)
    if way == 0:
        factor = rng.choice((-1.0, 0.0, 57.3, 1e-9, 1e9, 1e-160, 1e160, 1e300))
        return found * factor + rng.choice((0.0, 0.0, 1e9, 1e15))
    if way == 1:
        return np.roll(found, start)
    number = rng.choice(
        (np.nan, np.inf, -np.inf, 0.0, 1e155, -1e300, 1e-300, 1e18, found[:1].sum())
    )
    found[start : rng.choice((start + 1, end, None))] = number
    return found


def damaged_samples(rng: Random, columns: Columns) -> Columns:
    """Return columns with other numbers, holes, repeats and disorder; as long as each other."""
    found = dict(columns)
    for _ in times(rng):
        name, count = rng.choice(list(found)), len(next(iter(found.values())))
        start, end = sorted(rng.randrange(count + 1) for _ in range(2))
        holes = (np.r_[:start, end:count], np.r_[:end, start:count], np.r_[: max(2, start)])
        way = rng.randrange(8)
        if way < len(holes) and (rows := holes[way]).size > 1:
            found = {key: values[rows] for key, values in found.items()}
        elif way == 3:
            found[name] = found[rng.choice(list(found))]
        else:
            found[name] = _other_samples(rng, found[name])
    return found


def damaged_columns(rng: Random, columns: Columns) -> Columns:
    """Return columns damaged as a file may have them: also names, types, shapes and numbers."""
    found = damaged_samples(rng, columns) if rng.random() < 0.5 else dict(columns)
    for _ in times(rng):
        name, way = rng.choice(list(found)), rng.randrange(6)
        if way == 0 and len(found) > 1:
            del found[name]
        elif way == 1:
            found[rng.choice((*NAMES, rng.choice(list(found))))] = found.pop(name)
        elif way == 2 and rng.random() < 0.1:
            few = np.atleast_1d(found[name])[:3]
            found |= {f"{name}_{index}": few for index in range(1500)}
        elif getattr(found[name], "ndim", 0) == 1 and len(found[name]):
            found[name] = rng.choice((_other_type, _other_shape))(rng, found[name])
    return found


def _other_type(rng: Random, values: Any) -> Any:
    kinds = words("i1 u8 i8 f2 f4 ? c16 U8 S4 O M8[ns] m8[ms] >f8")
    with np.errstate(all="ignore"), suppress(ValueError):  # of texts that are no numbers
        return np.array(values).astype(rng.choice(kinds))
    return values


def _other_shape(rng: Random, values: Any) -> Any:
    shapes = [values[:0], values[:1], values[: len(values) // 2], np.repeat(values, 2)]
    shapes += [values[:, None], np.stack([values] * 3, axis=1), np.array(1.0), values[None, None]]
    return rng.choice(shapes)
