"""The errors and warnings of seaid, and the functions that put user input into messages.

Every message states the problem, the place, the value found, the values allowed and the remedy. A
`Finding` is a warning that belongs to a result: it has a code, the evidence and a remedy.
`checked` compares the arguments of a public function with its annotations.
"""

from __future__ import annotations

import difflib
import inspect
import os
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, wraps
from itertools import chain, islice
from types import NoneType, SimpleNamespace, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    ParamSpec,
    Self,
    SupportsFloat,
    SupportsIndex,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

LONGEST_MESSAGE = 2000
"""Characters of an error message: longer ones lose their middle."""

_LISTED, _ALLOWED, _LONGEST_NAME, _COMPARED = 20, 60, 100, 1000
"""Names listed in a message; allowed names listed; length and number of the names that a misspelled
name is compared with."""

_LONGEST_REASON = 300
"""Characters of the message of another library."""


class SeaidError(Exception):
    """Base of all errors that seaid raises on purpose; their messages have a bounded length.

    `arguments` are those that the message names, as it does: "joints=" or 'method="two-step"'. The
    command line names its options in their place. An error has an `advice` of its own, which its
    message has behind the `reason`, if those who catch it have a better one.
    """

    def __init__(self, message: object = "", *arguments: str, advice: str = "") -> None:
        self.reason, self.advice, self.arguments = str(message), advice, arguments
        message = f"{message}; {advice}" if advice else self.reason
        if len(message) > LONGEST_MESSAGE:
            half = LONGEST_MESSAGE // 2
            message = f"{message[:half]} ... {message[-half:]}"
        super().__init__(visible(message))

    def at(self, place: object, *more: str) -> Self:
        """Return the error with the place of its cause, which may name arguments, in front."""
        return type(self)(f"{place}: {self.reason}", *self.arguments, *more, advice=self.advice)


class RobotError(SeaidError):
    """A robot file, a drive table or a payload that cannot be used."""


class LogError(SeaidError):
    """A log that cannot be read or does not fit the robot."""


class ExcitationError(SeaidError):
    """A motion, or a request for one, that does not excite the parameters asked for."""


class SymbolicError(SeaidError):
    """Equations that Algorithm 1 cannot bring to regressor form."""


class IdentificationError(SeaidError):
    """An estimation problem without a unique or meaningful solution."""


class UnknownNameError(SeaidError, KeyError):
    """A name that a mapping of seaid does not have."""

    __str__ = Exception.__str__  # that of KeyError is the repr


class SeaidWarning(UserWarning):
    """Something was changed or excluded; the result is still valid."""


Severity = Literal["wrong", "doubtful", "note"]
"""What a finding says of a result: do not use it; use it with care; for information."""

SEVERITIES: tuple[Severity, ...] = get_args(Severity)
"""From the worst to the mildest."""

Certainty = Literal["certain", "likely", "possible"]
"""How sure a finding is of its cause: nothing else explains the evidence; best of several; one of
several that the data cannot tell apart."""


@dataclass(frozen=True)
class Finding:
    """A warning about an experiment, its log or its result.

    Attributes
    ----------
    code : str
        One of `seaid.checks.CODES`, such as "delay".
    message : str
        What was found, in a sentence with the joint, the numbers and the likely cause.
    joint : str
        The joint concerned; "" for the whole robot or log.
    severity : {"wrong", "doubtful", "note"}
        "wrong": do not use the result; "doubtful": use it with care; "note": for information.
    evidence : mapping {str: float}
        The numbers on which the finding rests.
    remedy : str
        The one change that repairs it. A change of a file is TOML behind a first line that names
        the file: "in the description of the log:" or "in the drives file:".
    certainty : {"certain", "likely", "possible"}
        How sure the cause is.
    joints : tuple of str
        The joints concerned, where they are several that one cause has.

    Examples
    --------
    >>> for finding in seaid.identify(robot, log).warnings:
    ...     print(finding.code, finding.joint, finding.severity, finding.message, finding.remedy)
    """

    code: str
    message: str
    joint: str = ""
    severity: Severity = "doubtful"
    evidence: Mapping[str, float] = field(default_factory=dict, hash=False)
    remedy: str = ""
    certainty: Certainty = "likely"
    joints: tuple[str, ...] = ()

    def __str__(self) -> str:
        return self.message


def by_severity(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings from the worst to the mildest, without repetitions, else in their order."""
    return tuple(sorted(dict.fromkeys(findings), key=lambda x: SEVERITIES.index(x.severity)))


def visible(text: str) -> str:
    """Return a text with control characters escaped, except line breaks."""
    return "".join(
        c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode("ascii")
        for c in text
    )


def shown(value: object, most: int = 80) -> str:
    """Return the repr of a user's value for a message, at most `most` characters long."""
    try:
        return shortened(repr(value), most)
    except (ValueError, RecursionError):  # an integer of thousands of digits, or endless lists
        return f"a {type(value).__name__} too long to show"


def shortened(text: object, most: int = 80) -> str:
    """Return a user's text for a message, truncated and escaped; other values as `shown` does."""
    if not isinstance(text, str):
        return shown(text, most)
    return in_one_line(text if len(text) <= most else f"{text[: most - 2]} …")


def abridged(sentence: str, most: int = 400) -> str:
    """Return a sentence without the middle of a long list at its start: its end says what it is."""
    start = most // 3
    short = len(sentence) <= most
    return in_one_line(sentence if short else f"{sentence[:start]} ... {sentence[start - most :]}")


def in_one_line(text: str) -> str:
    """Return a text with control characters escaped, including line breaks."""
    return visible(text).replace("\n", "\\n")


def reason_of(problem: BaseException) -> str:
    """Return the message of another library's exception in one line of bounded length."""
    if isinstance(problem, MemoryError):
        return "it requests more memory than is available"
    text = problem.strerror if isinstance(problem, OSError) and problem.strerror else str(problem)
    lines = text.strip().splitlines()
    return shortened(lines[0] if lines else type(problem).__name__, _LONGEST_REASON)


def listed(names: Iterable[object], most: int = _LISTED) -> str:
    """Return names as "a, b, c and 97 more": at most `most` names, long names shortened."""
    entries = list(names)
    first = ", ".join(shortened(str(name)) for name in entries[:most])
    more = len(entries) - most
    return f"{first} and {more:,} more" if more > 0 else first


def unknown_name(kind: str, name: object, allowed: Iterable[str]) -> str:
    """Return the message for a name that is not allowed, with the most similar allowed name."""
    names = list(allowed)
    name = shortened(name)
    comparable = (candidate for candidate in names if len(candidate) <= _LONGEST_NAME)
    lower = {candidate.lower(): candidate for candidate in islice(comparable, _COMPARED)}
    near = difflib.get_close_matches(name.lower(), lower, n=1, cutoff=0.5)
    hint = f"did you mean '{lower[near[0]]}'? " if near else ""
    return f"no {kind} is named '{name}'; {hint}allowed: {listed(names, _ALLOWED) or 'none'}"


def check_name(
    kind: str, name: str, allowed: Collection[str], error: type[SeaidError], *where: str
) -> None:
    """Raise `error` for a name that is not allowed, in front of it `where` the name stands.

    An argument of the function that a place names, as "joints=", is given after it, too.
    """
    if not isinstance(name, str) or name not in allowed:
        raise error(": ".join((*where[:1], unknown_name(kind, name, allowed))), *where[1:])


_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def checked(
    error: type[SeaidError],
) -> Callable[[Callable[_Parameters, _Result]], Callable[_Parameters, _Result]]:
    """Return a decorator: the function raises `error` for arguments that its annotations exclude.

    Missing and unknown arguments, wrong types, unknown values of a `Literal` and numbers below
    their `Least` are refused before the function begins, in mappings too. Names within lists and
    the contents of tuples are left to the function.
    """

    def decorate(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
        signature = inspect.signature(function)
        hints = cache(lambda name: hints_of(function, only=name))

        @wraps(function)
        def call(*values: _Parameters.args, **named: _Parameters.kwargs) -> _Result:
            try:
                arguments = signature.bind(*values, **named).arguments
            except TypeError as problem:
                raise error(_wrong_call(function.__name__, signature, named, problem)) from None
            for name, value in arguments.items():
                if not _fits(value, hints(name).get(name, Any)):
                    raise error(_mismatch(name, value, hints(name)[name]), f"{name}=")
            return function(*values, **named)

        return call

    return decorate


def hints_of(function: Any, only: str = "") -> dict[str, Any]:
    """Return the annotations of a function or a class, with the limits of `Annotated`.

    Names that its module imports for types only are those of `seaid`, or of the own package, which
    are imported: `only` those of one parameter, if it is named.
    """
    package = sys.modules.get(".".join(function.__module__.split(".")[:2]))
    known: dict[str, Any] = {}
    if only:
        part = {only: function.__annotations__.get(only, Any)}
        function = SimpleNamespace(__annotations__=part, __globals__=function.__globals__)
    while True:
        try:
            return get_type_hints(function, localns=known, include_extras=True)
        except NameError as problem:
            # One unknown name per round, each imported by the module for type checkers only.
            name = str(problem.name)
            known[name] = getattr(sys.modules["seaid"], name, getattr(package, name, Any))


def _wrong_call(
    function: str, signature: inspect.Signature, named: Iterable[str], problem: TypeError
) -> str:
    """Return the message for arguments that are missing, unknown or too many."""
    parameters = signature.parameters
    for name in named:
        if name not in parameters:
            return f"{function}: {unknown_name('argument', name, parameters)}"
    call = ", ".join(n if p.default is p.empty else f"{n}=..." for n, p in parameters.items())
    return f"{function}: {problem}; write {function}({call})"


def _mismatch(name: str, value: Any, hint: Any) -> str:
    """Return the message for a value of a wrong type: what is expected, found, and to do."""
    kinds = _kinds(hint)
    choices = [*chain(*(kind.choices for kind in kinds))]
    if choices and isinstance(value, str):
        return f"{name}=: {unknown_name(name, value, choices)}"
    text = f"{name}= must be {_described(hint)}, found {_described_value(value)}"
    misfits = ((entry, kind.entry) for kind in kinds for entry in kind.misfits(value))
    for entry, allowed in islice(misfits, 1):
        text += f" with {_described_value(entry)}, which must be {_described(allowed)}"
    is_listed = any(kind.fits([value]) for kind in kinds)
    return f"{text}; put it into a list: {name}=[...]" if is_listed else text


@dataclass(frozen=True)
class Least:
    """The least number that an annotation allows, as `Annotated[int, Least(6)]`."""

    number: float


Seed = Annotated[int, Least(0)]
"""A seed of random numbers."""

Hertz = Annotated[float, Least(1e-3)]
"""A sampling rate or a cutoff [Hz]; 1 mHz is far below those of a robot's motion."""


@dataclass(frozen=True)
class _Kind:
    """One of the alternatives of an annotation: what it is called, and whether a value is one.

    `entry` is the annotation of what is in a list or a mapping, Any if that is not compared; a text
    is one of the `choices` of a `Literal`. What is not checked has no words.
    """

    words: str
    is_one: Callable[[Any], bool]
    entry: Any = Any
    choices: tuple[str, ...] = ()

    def fits(self, value: Any) -> bool:
        """Return whether a value is of this kind, and so is what is in it."""
        return self.is_one(value) and not any(True for _ in self.misfits(value))

    def misfits(self, value: Any) -> Iterator[Any]:
        """Yield what is in a value of this kind and does not fit; iterators would be used up."""
        is_held = isinstance(value, Mapping | list | tuple) and self.is_one(value)
        if self.entry is not Any and is_held:
            entries = value.values() if isinstance(value, Mapping) else value
            yield from (entry for entry in entries if not _fits(entry, self.entry))


_UNCHECKED = _Kind("", lambda _: True)
"""Any, type variables and protocols."""

_UNIONS = (Union, UnionType)
_NAMED: dict[str, tuple[Any, str]] = {
    "int": (SupportsIndex, "a whole number"),
    "float": (SupportsFloat, "a number"),
    "bool": (SupportsFloat, "True or False"),
    "str": (str, "a name"),
    "NoneType": (NoneType, "None"),
    "Path": (os.PathLike, "a path"),
    "ndarray": (Iterable | SupportsFloat, "an array"),
    "Mapping": (Mapping, "a mapping"),
    "dict": (dict, "a dict"),
}
"""{name of a type in an annotation: (what a value may be, its words)}; others are their own.

Numbers of NumPy are allowed, and 1 for True."""

_ENTRIES = {str: "names", int: "numbers", float: "numbers", **dict.fromkeys(_UNIONS, "these")}
"""{annotation of what is in a list: its words}."""


@cache
def _kinds(hint: Any) -> tuple[_Kind, ...]:
    """Return the alternatives of an annotation."""
    kind, inner = get_origin(hint) or hint, get_args(hint)
    if kind in _UNIONS:
        return tuple(chain(*map(_kinds, inner)))
    if kind is Annotated:
        (number,), least = _kinds(inner[0]), inner[1].number
        words = f"{number.words} of {least:g} or more"
        return (_Kind(words, lambda value: number.is_one(value) and value >= least),)
    if kind is Literal:
        words = ", ".join(f"'{choice}'" for choice in inner)
        return (_Kind(words, lambda value: isinstance(value, str) and value in inner, Any, inner),)
    is_type = isinstance(kind, type) and not getattr(kind, "_is_protocol", kind is Any)
    return (_kind_of(kind, inner) if is_type else _UNCHECKED,)


def _kind_of(kind: type, inner: Sequence[Any]) -> _Kind:
    """Return the values of a type, which has annotations of what is in it in its brackets."""
    allowed, words = _NAMED.get(kind.__name__, (kind, _with_article(kind.__name__)))
    is_general = kind.__module__ in ("builtins", "collections.abc") and hasattr(kind, "__iter__")
    if not is_general or kind.__name__ in _NAMED:
        # The contents of tuples are left to the function.
        entry = inner[-1] if issubclass(kind, Mapping) and inner else Any
        entry = Any if get_origin(entry) is tuple else entry
        return _Kind(words, lambda value: isinstance(value, allowed), entry)
    # Which names a list may have, and lists within lists, are left to it as well.
    entry = str if get_origin(inner[0]) is Literal else inner[0]
    noun = get_origin(entry) or entry
    words = f"a list of {_ENTRIES.get(noun, f'{noun.__name__}s')}"
    return _Kind(words, _is_list, entry if get_origin(entry) in (None, *_UNIONS) else Any)


def _is_list(value: Any) -> bool:
    return hasattr(value, "__iter__") and not isinstance(value, str | bytes | Mapping)


def _fits(value: Any, hint: Any) -> bool:
    """Return whether a value is one that an annotation allows."""
    return any(kind.fits(value) for kind in _kinds(hint))


def _described(hint: Any) -> str:
    """Return the alternatives of an annotation in words."""
    words = dict.fromkeys(kind.words for kind in _kinds(hint))
    hidden = {"", "None", _NAMED["str"][1]} if "a path" in words else {"", "None"}
    text = ", ".join(word for word in words if word not in hidden)
    return " or ".join(filter(None, text.rpartition(", ")[::2]))


def _described_value(value: Any) -> str:
    """Return what an argument is, in words."""
    if isinstance(value, str):
        return f"the text {shown(value)}"
    if isinstance(value, os.PathLike):
        return f"the path '{shortened(os.fspath(value))}'"
    if value is None or isinstance(value, int | float):
        return shown(value)
    return _with_article(type(value).__name__)


def _with_article(noun: str) -> str:
    return f"{'an' if noun[:1].lower() in 'aeiou' else 'a'} {noun}"
