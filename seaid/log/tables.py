"""Tables of TOML, JSON and Python as the types of their keys, with messages that name the place.

The types are annotations, such as those of the fields of a dataclass: texts, numbers, paths,
`Literal`, lists as tuples, mappings and dataclasses. `Annotated[..., Within(...)]` has limits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, TypeVar, Union, get_args, get_origin

from seaid._arrays import FrozenMapping
from seaid.errors import SeaidError, hints_of, shown, unknown_name

_Instance = TypeVar("_Instance")


@dataclass(frozen=True)
class Within:
    """The limits of a value in an annotation: what a message calls it, and if it keeps them.

    `whole` numbers may stand for a text, as those of columns without names.
    """

    words: str
    holds: Callable[[Any], bool] = field(repr=False)
    whole: bool = False


Interval = Annotated[
    tuple[float, float],
    Within("an interval [start, end] in seconds, start before end", lambda x: [*x] == sorted({*x})),
]


_SCALARS: Mapping[Any, tuple[str, Callable[[Any], bool]]] = {
    str: ("a text", lambda value: isinstance(value, str)),
    Path: ("a text", lambda value: isinstance(value, str) and value != ""),
    **dict.fromkeys(
        (int, float),
        ("a number", lambda value: type(value) is not bool and isinstance(value, int | float)),
    ),
    bool: ("true or false", lambda value: isinstance(value, bool)),
}
"""{type: (what a message calls a value of it, whether a value is one)}."""


@dataclass(frozen=True)
class Reader:
    """A reader of tables, which raises `error`; relative paths are those of `folder`.

    A text or a number stands for a table with the key of its type in `short`, as "t" for a clock.
    """

    error: type[SeaidError]
    folder: Path = Path()
    short: Mapping[type, str] = field(default_factory=dict)

    def table(
        self, types: Mapping[str, Any], table: Any, where: str, needed: Iterable[str] = ()
    ) -> dict[str, Any]:
        """Return {key: value} of the keys that are there, each as its type.

        Raises `error` for what is no table, for a key without a type, and for a `needed` one that
        is not there.
        """
        if not isinstance(table, Mapping):
            raise self.error(f"{where} must be a table, found {shown(table)}")
        for key in table:
            if key not in types:
                raise self.error(f"{where}: {unknown_name('key', key, types)}")
        for key in needed:
            if key not in table:
                raise self.error(f"{where}: key '{key}' is missing")
        return {key: self.value(types[key], value, key, where) for key, value in table.items()}

    def instance(self, kind: type[_Instance], table: Any, where: str) -> _Instance:
        """Return the object of a dataclass whose fields are the keys of a table."""
        entries: Any = fields(kind)  # type: ignore[arg-type]
        needed = [x.name for x in entries if x.default is x.default_factory is MISSING]
        values = self.table(types_of(kind), table, where, needed)
        try:
            return kind(**values)
        except self.error as problem:
            raise self.error(f"{where}: {problem}") from None

    def refusal(self, value: Any, wanted: str, key: str, where: str) -> SeaidError:
        """Return the error of a value that is not what is wanted."""
        return self.error(f"{where}: '{key}' must be {wanted}, found {shown(value)}")

    def value(self, hint: Any, value: Any, key: str, where: str) -> Any:
        """Return the value of a key as an annotation has it."""
        if hint is Any or (value is None and NoneType in get_args(hint)):
            return value
        kind = get_origin(hint) or hint
        other = Reader._object if is_dataclass(kind) else Reader._scalar
        return _READERS.get(kind, other)(self, hint, value, key, where)

    def _scalar(self, kind: Any, value: Any, key: str, where: str) -> Any:
        words, is_right = _SCALARS[kind]
        if not is_right(value):
            raise self.refusal(value, words, key, where)
        return self.folder / value if kind is Path else value

    def _object(self, kind: Any, value: Any, key: str, where: str) -> Any:
        if kind in self.short and isinstance(value, str | int):
            value = {self.short[kind]: value}
        return value if isinstance(value, kind) else self.instance(kind, value, f"{where} [{key}]")

    def _mapping(self, hint: Any, value: Any, key: str, where: str) -> FrozenMapping[Any]:
        names = value if isinstance(value, Mapping) else ()
        types = dict.fromkeys(names, get_args(hint)[1])
        return FrozenMapping(self.table(types, value, f"{where} [{key}]"))

    def _choice(self, hint: Any, value: Any, key: str, where: str) -> Any:
        if value not in get_args(hint):
            raise self.error(f"{where}: '{key}': {unknown_name('value', value, get_args(hint))}")
        return value

    def _within(self, hint: Any, value: Any, key: str, where: str) -> Any:
        kind, limits = get_args(hint)
        value = str(value) if limits.whole and type(value) is int else value
        try:
            read = self.value(kind, value, key, where)
        except self.error:
            raise self.refusal(value, limits.words, key, where) from None
        if not limits.holds(read):
            raise self.refusal(value, limits.words, key, where)
        return read

    def _alternative(self, hint: Any, value: Any, key: str, where: str) -> Any:
        """Return the value as the first of several annotations that it fits, all with limits."""
        hints = [kind for kind in get_args(hint) if kind is not NoneType]
        if len(hints) == 1:
            return self.value(hints[0], value, key, where)
        for kind in hints:
            with suppress(self.error):
                return self.value(kind, value, key, where)
        words = (get_args(kind)[1].words for kind in hints)
        raise self.refusal(value, " or ".join(words), key, where)

    def _listed(self, hint: Any, value: Any, key: str, where: str) -> tuple[Any, ...]:
        """Return a list of any length, or one of so many numbers, as a tuple."""
        kinds, is_list = get_args(hint), isinstance(value, list | tuple)
        if kinds[-1] is not ... and not (is_list and len(value) == len(kinds)):
            raise self.refusal(value, f"a list of {len(kinds)} numbers", key, where)
        if not is_list:
            raise self.refusal(value, f'a list, as {key} = ["a", "b"]', key, where)
        return tuple(
            self.value(kinds[0], entry, f"{key}[{place}]", where)
            for place, entry in enumerate(value)
        )


_READERS: dict[Any, Callable[[Reader, Any, Any, str, str], Any]] = {
    **{Annotated: Reader._within, Literal: Reader._choice, Mapping: Reader._mapping},
    **{Union: Reader._alternative, UnionType: Reader._alternative, tuple: Reader._listed},
}
"""{kind of an annotation: what reads a value of it}."""


def types_of(kind: type) -> dict[str, Any]:
    """Return {field: annotation} of a dataclass, with their limits."""
    return {name: hint for name, hint in hints_of(kind).items() if get_origin(hint) is not ClassVar}
