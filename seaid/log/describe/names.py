"""The meaning of the name of a column: quantity, side of the gear, joint and unit.

`meaning_of` reads it from the words of the name; the names of a robot's joints are looked for
first, so that their words are not taken for anything else. `place_of` and `kind_of` read the
vector and the component of a column of a base or of a contact, and `planar_meaning` a single column
of a planar base. The words of languages are in vocabulary.toml, the spellings of units in
units.toml.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain, filterfalse, pairwise, starmap
from pathlib import Path
from typing import Literal

from seaid._files import read_toml
from seaid.errors import LogError
from seaid.log.channels import UNIT_FACTORS, UNITS

Unit = tuple[str, str]
"""A quantity, and a unit of it."""

Role = Literal["measured", "estimated", "command", "derived"]

_OF_DRIVES = {("motor", "state"), ("motor", "cmd"), ("motor", "command")}
"""Words of messages about drives, as "motor_state[0].q" is: they tell no side of the gear."""

_RATE = re.compile(
    r"(?<![^\W_])(m?rad|m?deg|turns?|revs?|counts?|[mc]?m|°)"
    r"(?:_per_| ?/ ?|(?<=rad)_|(?<=deg)_)(s|sec|min)(\^?2|²|s)?(?![^\W_])"
)
"""A unit of a velocity or an acceleration: "rad/s", "deg_per_s", "m/s^2"."""

_BRACKETED = re.compile(r"(.*)([\[(])([^\[\]()]*)[\])]\s*", re.DOTALL)
_RUN = re.compile(rf"{_RATE.pattern}|(?<![^\W_])(?:[kK]_[pd]|[iI]_q)(?![^\W_])|[^\W_]+|[°%‰]")
_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^\W\d_]+|[°%‰]")
_SIGNS = str.maketrans("（）［］【】º", "()[][]°")
"""Brackets of Asian texts, and the sign that Spanish keyboards have in place of a degree."""

_GREEK = {"θ": "theta", "φ": "phi", "ω": "omega", "τ": "tau", "μ": "u"}
_DOTS = (
    (re.compile("[qθφ]\N{COMBINING DOT ABOVE}"), "velocity"),
    (re.compile("[qθφ]\N{COMBINING DIAERESIS}"), "acceleration"),
)
"""Letters with the dots of a derivative, and the quantities that they stand for."""


class Vocabulary:
    """The words of vocabulary.toml, and the spellings of units.

    Attributes
    ----------
    tables : mapping {table: mapping}
        What the file has, as it is.
    quantities : mapping {word: quantity}
    roles : mapping {role or mark: words}
        Further: "computed" are those of commands, of derived signals and of what is not at a joint;
        "understood" are those of any role or quantity; "no label" are all of them but those of a
        joint.
    units : mapping {spelling: (quantity, unit)}
    small : mapping {spelling in small letters: (quantity, unit)}
        As in "TORQUE_MNM".
    """

    def __init__(self) -> None:
        path = Path(__file__).with_name("vocabulary.toml")
        self.tables = tables = read_toml(path, "the words of column names", LogError)
        words = {
            name: frozenset(text.split())
            for table in ("roles", "marks")
            for name, text in tables[table].items()
        }
        self.quantities: Mapping[str, str] = {
            word: kind for kind, text in tables["quantities"].items() for word in text.split()
        }
        of_quantities = frozenset(self.quantities)
        of_roles = (words[x] for x in tables["roles"].keys() - {"joint"})
        not_of_joints = of_quantities.union(*of_roles)
        self.roles: Mapping[str, frozenset[str]] = words | {
            "computed": words["commanded"] | words["derived"] | words["elsewhere"],
            "understood": not_of_joints | words["joint"] | {"jnt"},
            "no label": not_of_joints,
            "generic": of_quantities.union(words["motor"], words["joint"], words["filler"]),
            "desired": of_quantities | words["desired"],
        }
        self.units: Mapping[str, Unit] = dict(_spellings())
        # The first unit of a spelling in small letters counts.
        self.small = {x.lower(): unit for x, unit in reversed(self.units.items())}


vocabulary = cache(Vocabulary)
"""Return the words of column names, which are read from their file once."""


def _spellings() -> Iterator[tuple[str, Unit]]:
    """Yield the spellings of units, with their prefixes, and what they stand for."""
    for unit, entry in UNITS["units"].items():
        symbols, names, also = (entry.get(x, "").split() for x in ("symbols", "names", "also"))
        yield from ((spelling, (entry["of"], unit)) for spelling in [*symbols, *names, *also])
        for prefix in entry.get("prefixes", "").split():
            word = UNITS["prefixes"][prefix]["name"]
            spelled = [prefix + x for x in symbols] + [word + x for x in names]
            yield from ((spelling, (entry["of"], prefix + unit)) for spelling in spelled)


def _has(texts: Sequence[str], role: str) -> bool:
    """Return whether a word has a role, or a mark."""
    return not vocabulary().roles[role].isdisjoint(texts)


@dataclass(frozen=True)
class Meaning:
    """The meaning of the name of a column.

    Attributes
    ----------
    quantity, side : str
        "position", ... and "motor" or "joint"; empty texts if the name does not say them.
    joint : str
        The robot's joint, or what remains of the name.
    unit : str or None
    role : {"measured", "estimated", "command", "derived"}
        Estimated is what the drive computes, as a torque from its current.
    unknown : tuple of str
        The words that are not in the vocabulary, if the joints of a robot are known.
    is_said : bool
        Whether the name says that the column is measured.
    """

    quantity: str
    side: str
    joint: str
    unit: str | None
    role: Role = "measured"
    unknown: tuple[str, ...] = ()
    is_said: bool = False

    @property
    def is_raw(self) -> bool:
        """Whether it is a measurement."""
        return self.role == "measured"


@dataclass(frozen=True)
class _Word:
    """A word in small letters, and the unit that it may be.

    `is_glued`: a number that follows the word before without a separator, as in "arm1".
    """

    text: str
    unit: Unit | None = None
    is_glued: bool = False

    @property
    def is_letter(self) -> bool:
        """Whether it is a single letter."""
        return len(self.text) == 1 and self.text.isalpha()


def meaning_of(name: str, joints: Sequence[str] = ()) -> Meaning:
    """Return the meaning of a name: "mpos_0", "/joint_states/position[elbow]", "tau_meas1".

    The words of one of the `joints` of a robot are its name, and nothing else.
    """
    parts = _Parts(name, joints)
    quantity, joint = _quantity_and_joint(parts, joints)
    side = _side_of(parts)
    unit, joint = _unit_and_joint(parts, quantity, side, joint)
    if quantity == "time" and _has(parts.texts, "computed"):  # "T_des" is a torque
        quantity = "torque"
    texts = [*parts.texts, *chain.from_iterable(parts.topic)]  # "/state/desired/q[0]"
    of_unit, spelling = unit or ("", None)
    return Meaning(
        quantity=quantity or of_unit,
        side=side,
        joint=joint,
        unit=spelling,
        role=_role(texts, quantity),
        unknown=_unknown(parts.words, joints, unit),
        is_said=_has(texts, "said"),
    )


def _role(texts: Sequence[str], quantity: str) -> Role:
    """Return whether the words are those of a measurement, of a command, or of something else."""
    # External torques are estimates of a contact, while an external encoder measures the joint.
    is_outside = quantity == "torque" and _has(texts, "outside")
    if not (_has(texts, "computed") or is_outside):
        return "estimated" if _has(texts, "estimated") else "measured"
    is_signal = not (_has(texts, "derived") or _has(texts, "elsewhere"))
    return "command" if is_signal and _has(texts, "commanded") else "derived"


class _Parts:
    """The parts of a name: a topic, the field behind it, and what stands in its brackets.

    `topic` has the texts of the words of each part, the last one first, and `of_topic` the joint or
    the label that they name. `words` are those of the field without its joint, with the quantity
    for a unit that stands for it, and `texts` are the words as written; `joint` is that of the
    brackets, or of the robot.
    """

    def __init__(self, name: str, joints: Sequence[str]) -> None:
        head, self.label, self.unit = _without_brackets(name.translate(_SIGNS))
        path = head.split("/") if head.startswith("/") else [head]
        self.topic, self.of_topic = _topic(path[1:-1], joints)
        self.field = _in_latin(path[-1])
        self.joint, words = joint_alone(self.label, joints) or self.label, _words(self.field)
        if not self.label:
            self.joint, words = _joint_in(words, joints)
        self.texts = [word.text for word in words]
        is_time = _is_clock(words, self.label, self.unit)
        quantity = "time" if is_time else _quantity(self.texts)
        # The unit becomes the word of its quantity, so that it does not count for the joint's
        # label.
        known = not quantity and (
            _unit_of(words, "", "", self.joint) or _counts_of(words, self.unit)
        )
        if known:
            quantity = known[0]
            words = [replace(x, text=quantity) if x.unit == known else x for x in words]
        self.words, self.quantity = words, quantity


def _topic(path: Sequence[str], joints: Sequence[str]) -> tuple[list[list[str]], str]:
    """Return the words of each part of a topic, and the joint or the label that they name."""
    parts = [_topic_part(part, joints) for part in reversed(path)]
    owners = [x[0] for x in parts] + [x for _, x, _ in parts if len(parts) > 1 or x.isdigit()]
    return [texts for *_, texts in parts], next(filter(None, owners), "")


def _topic_part(text: str, joints: Sequence[str]) -> tuple[str, str, list[str]]:
    """Return the robot's joint that a part of a topic is, its label, and its words."""
    head, label, _ = _without_brackets(text)
    if joint := joint_alone(head, joints):
        return joint, "", []
    joint, words = _joint_in(_words(_in_latin(head)), joints)
    words = [word for word in words if word.text not in vocabulary().roles["topic"]]
    return joint, label or _label(words, None), [word.text for word in words]


def _quantity_and_joint(parts: _Parts, joints: Sequence[str]) -> tuple[str, str]:
    """Return the quantity of a field, else of its topic: "/effort_controller/commands/data[0]"."""
    if parts.quantity:
        return parts.quantity, parts.joint
    # A length alone names a position of a prismatic joint; a slide is "x_axis", in mm.
    if joint := _joint_with_length(parts, joints):
        return "position", joint
    is_in_words = parts.joint and not parts.label  # "/state/positions/elbow"
    if not (
        is_in_words
        or vocabulary().roles["filler"].issuperset(parts.texts)
        or parts.texts[-1].isdigit()
    ):
        return "", parts.joint
    return next(filter(None, map(_quantity, parts.topic)), ""), parts.joint


def _joint_with_length(parts: _Parts, joints: Sequence[str]) -> str:
    """Return the joint of a name with only a unit of its position: "x_axis [mm]", "x_axis_mm"."""
    if parts.unit is not None:
        alone = joint_alone(parts.field, joints) if parts.unit[0] == "position" else ""
        return alone and (parts.joint or alone)
    word = parts.words[0] if len(parts.words) == 1 else _Word("")
    is_length = word.unit is not None and word.unit[0] == "position" and word.text != "m"
    return parts.joint if is_length else ""


def _side_of(parts: _Parts) -> str:
    """Return the side of the gear of a field; that of a numbered drive is not known."""
    is_of_drive = not _OF_DRIVES.isdisjoint(pairwise(parts.texts))
    is_numbered = any(map(str.isdigit, (parts.label, *parts.texts)))
    return "" if is_of_drive and is_numbered else _side(parts.words)


def _unit_and_joint(parts: _Parts, quantity: str, side: str, joint: str) -> tuple[Unit | None, str]:
    """Return the unit in brackets if the quantity has it, else that of the words; and the joint."""
    unit = parts.unit
    if quantity == "temperature" and unit == ("position", "deg"):
        unit = ("temperature", "degC")
    if unit is None or not _fits(unit, quantity):
        label = unit[1] if unit else ""
        # Brackets with a unit that the quantity cannot have are the label of a joint: "tau[m]".
        unit, joint = _unit_of(parts.words, quantity, side, joint), joint or label
    joint = joint or _label(parts.words, unit)
    return unit, joint or parts.of_topic


def in_file(meaning: Meaning, file: str) -> Meaning:
    """Return a meaning in one of several files: "run.control.csv" has the commands of a run."""
    if not meaning.is_raw or meaning.quantity == "time" or not is_of_commands(file):
        return meaning
    return replace(meaning, role="command")


def is_of_commands(file: str) -> bool:
    """Return whether the name of a file says that it has commands."""
    texts = _texts(Path(file).name)
    return "control" in texts or _has(texts, "commanded")


def _unknown(words: Sequence[_Word], joints: Sequence[str], unit: Unit | None) -> tuple[str, ...]:
    """Return the words that are no numbers, units or words of joints, and in no table.

    They are of interest only if the joints of a robot are known.
    """
    if not joints:
        return ()
    named = (word.text for word in words if not (_is_unit_of(word, unit) or word.text.isdigit()))
    of_joints = {text for known, _ in _known(tuple(joints)) for text in known}
    return tuple(x for x in named if x not in vocabulary().roles["understood"] | of_joints)


def joint_alone(name: str, joints: Sequence[str]) -> str:
    """Return the joint of a name with nothing else but words without meaning, or an empty text."""
    texts = _texts(name)
    bare = tuple(text for text in texts if text not in vocabulary().roles["filler"])
    numbered = ("joint", *bare[1:]) if bare[:1] == ("j",) else bare  # "J1" is joint_1
    spelled = (texts, bare, numbered)
    return next((joint for known, joint in _known(tuple(joints)) if known in spelled), "")


def is_of_another_part(name: str) -> bool:
    """Return whether a name is no command, but of a tool, a foot, an IMU or a battery."""
    texts = _texts(name)
    is_signal = _has(texts, "commanded") or _has(texts, "derived")
    return _has(texts, "elsewhere") and not is_signal


def _without_brackets(name: str) -> tuple[str, str, Unit | None]:
    """Return a name without brackets, and the label and the unit in them: "q[1] (rad)"."""
    label, unit = "", None
    while match := _BRACKETED.fullmatch(name):
        head, bracket, inside = match.groups()
        known = known_unit(_in_latin(inside).strip(" ."))
        share, _, whole = inside.strip().partition(" ")
        if known is not None:
            name, unit = head, known
        elif (part := known_unit(share)) and part[0] == "share":  # "torque [% of rated]"
            name, unit = f"{head} {whole}", part
        # Square brackets index, round ones explain: words in these are words of the name.
        elif bracket == "[" or inside.isdigit():
            name, label = head, inside
        else:
            name = f"{head} {inside}"
    return name, label, unit


def known_unit(text: str) -> Unit | None:
    """Return the unit that a text is, in the spelling of the table or in that of small letters."""
    if not (match := _RATE.fullmatch(text)):
        return vocabulary().units.get(text, vocabulary().small.get(text.lower()))
    length, time, square = match.groups()
    _, length = known_unit(length) or ("", length)
    if square:
        return "acceleration", f"{length}/s^2"
    return "velocity", f"{length}/{'min' if time == 'min' else 's'}"


def _texts(name: str) -> tuple[str, ...]:
    """Return the words of a name in small letters."""
    return tuple(word.text for word in _words(_in_latin(name)))


def _words(text: str) -> list[_Word]:
    """Return the words of a name; a unit such as mA is one word."""
    words: list[_Word] = []
    for run in _RUN.finditer(text):
        head, unit = _without_unit(run[0])
        for number, part in enumerate(_parts_of_run(head)):
            glued = number > 0 and part.isdigit()
            words += [_Word(piece, known_unit(part), glued) for piece in _split(part.lower())]
        if unit:
            words.append(_Word(unit.lower(), known_unit(unit)))
    # The d of "q_d", "tau_J_d" and "theta_md".
    for place, (before, word) in enumerate(pairwise(words), 1):
        if word.text == "d" and before.text in vocabulary().roles["desired"]:
            words[place] = replace(word, text="desired")
    return words


def _parts_of_run(run: str) -> list[str]:
    """Return the parts of letters and numbers by their case, but those of a quantity as one."""
    parts, quantities = _SPLIT.findall(run), vocabulary().quantities
    if run.lower() in quantities:  # "qD"
        return [run]
    start = "".join(parts[:-1])
    return [start, parts[-1]] if start.lower() in quantities else parts  # "dQ1"


def _without_unit(run: str) -> tuple[str, str]:
    """Return letters and numbers without the unit at their end: "currentmA", "torque1mNm"."""
    if known_unit(run):
        return "", run
    known = vocabulary()
    for start in range(1, len(run) - 1):
        if run[start:] not in known.units:
            continue
        before = (_SPLIT.findall(run[:start]) or [""])[-1].lower()
        # Behind a number or a quantity only, and in the unit's spelling: the m of "arm" is no
        # metre.
        if before.isdigit() or before in known.quantities:
            return run[:start], run[start:]
    return run, ""


def _split(word: str) -> list[str]:
    """Split a word into known words: "mpos" into m and pos, "wcur" into w and cur."""
    if word in vocabulary().quantities or word in vocabulary().small:
        return [word]
    match = _halves().fullmatch(word)
    return [*filter(None, match.groups())] if match else [word]


@cache
def _halves() -> re.Pattern[str]:
    """Return the pattern of two known words without a separator, the shortest first word first.

    Words of three letters and more are known in front of a quantity, and those of a role behind it:
    "motorpos", "istposition", "stromistwert". Of single letters only m, l, w and j are: for motor,
    link, winding and joint.
    """
    roles, quantities = vocabulary().roles, "|".join(map(re.escape, vocabulary().quantities))
    behind = roles["said"] | roles["commanded"] | roles["derived"] | roles["estimated"]
    first, last = (
        "|".join(sorted((re.escape(word) for word in words if len(word) > 2), key=len))
        for words in (roles["understood"], behind)
    )
    long = f"(?=...)(?:{quantities})"
    return re.compile(
        rf"([mlwj])({quantities}|d)|({quantities})([ml])|({first})({long})|({long})({last})"
    )


def _quantity(texts: Sequence[str]) -> str:
    """Return the quantity; "current" before another one means the present: current_position.

    Before q it is that of an axis in a drive. Words behind "from" say what it was computed from:
    "torques_from_current".
    """
    known = vocabulary()
    texts = texts[: texts.index("from")] if "from" in texts[1:] else texts
    kinds = {}
    for word, following in pairwise([*texts, ""]):
        kind = known.quantities.get(word)
        is_present = word == "current" and following not in known.roles["axis"]
        if kind and not (is_present and known.quantities.get(following, kind) != kind):
            kinds[word] = kind
    strong = [kind for word, kind in kinds.items() if word not in known.roles["weak"]]
    # `min` returns the first of equal rank: "position" before "torque" in the name is a position.
    ranks = known.tables["ranks"]
    return min(strong or kinds.values(), key=ranks.__getitem__, default="")


def _is_clock(words: Sequence[_Word], label: str, unit: Unit | None) -> bool:
    """Return whether a word of two meanings is the time, alone or with a unit: "temps (s)"."""
    units = [*(word.unit for word in words[1:]), *filter(None, [unit])]
    is_of_time = all(x is not None and x[0] == "time" for x in units)
    return is_of_time and not label and _has([word.text for word in words[:1]], "clock")


def _fits(unit: Unit, quantity: str) -> bool:
    """Return whether a quantity may have a unit; without a quantity only what is unmistakable."""
    if not quantity:
        return unit[1] in vocabulary().roles["telling"]
    return quantity == unit[0] or (quantity, unit[0]) in _ALSO


_ALSO = {("torque", "current"), ("deflection", "position")}
_ALSO |= {("torque", "share"), ("current", "share"), ("duty", "share")}
"""Quantities that may have the units of others: a torque in amperes is that of a drive."""


def _unit_of(words: Sequence[_Word], quantity: str, side: str, joint: str) -> Unit | None:
    """Return the unit: the last word that is one. One of a single letter is the very last word."""
    named = [word for word in words if not word.text.isdigit()]
    for place, word in enumerate(reversed(named)):
        # A single letter is a unit at the end only, as in "joint_pos_m", else a side or a label:
        # "m_pos".
        is_last = place == 0 and (len(named) > 1 or joint != "")
        is_placed = is_last or (quantity != "" and not word.is_letter)
        if is_placed and _is_unit(word, quantity, side):
            return word.unit
    return None


def _is_unit(word: _Word, quantity: str, side: str) -> bool:
    """Return whether a word is a unit that a quantity may have; "pos_m" is at the motor."""
    is_of_motor = word.text == "m" and side != "joint"
    is_syllable = word.is_letter and not word.text.isascii()  # of a longer word, as 度 of 角度
    is_other = is_of_motor or is_syllable
    return word.unit is not None and not is_other and _fits(word.unit, quantity)


def _counts_of(words: Sequence[_Word], bracketed: Unit | None) -> Unit | None:
    """Return the unit of counts or turns on a side of a gear: "motor_counts", "hip motor [rev]"."""
    of_encoders, of_words = vocabulary().roles["encoders"], (word.unit for word in words)
    units = (unit for unit in (*of_words, bracketed) if unit and unit[1] in of_encoders)
    return next(units, None) if _side(words) else None


def _side(words: Sequence[_Word]) -> str:
    """Return the side: "joint_position_m" is in metres, "motor_elbow_joint" at the motor."""
    texts = [word.text for word in words]
    at_joint = _is_at_joint(words)
    if _has(texts, "motor") and not (at_joint and texts[-1] == "m"):
        return "motor"
    return "joint" if at_joint else ""


def _is_at_joint(words: Sequence[_Word]) -> bool:
    """Return True for a side ("joint_position", "pos_link"), False for a name ("elbow_joint")."""
    roles = vocabulary().roles
    named = [x for x in words if x.unit is None or x.text in roles["generic"]]
    texts = [word.text for word in named if not word.text.isdigit()]
    if any(starmap(_is_side, pairwise(texts))):
        return True
    return roles["generic"].issuperset(texts) and not roles["joint"].isdisjoint(texts)


def _is_side(word: str, following: str) -> bool:
    """Return whether two words are a side and a quantity: "joint position", "position sensor"."""
    known = vocabulary()
    is_sensor = following == "sensor" and word in known.quantities
    return is_sensor or (word in known.roles["joint"] and following in known.quantities)


def _label(words: Sequence[_Word], unit: Unit | None) -> str:
    """Return the words of a joint's name, or its number if the other words are generic."""
    following = [*words[1:], _Word("")]
    places = [n for n, word in enumerate(words) if _is_of_label(word, following[n].text, unit)]
    texts = [words[place].text for place in places]
    if vocabulary().roles["joint"].issuperset([*filterfalse(str.isdigit, texts)]):
        return "_".join(filter(str.isdigit, texts))
    is_glued = [words[place].is_glued and place - 1 in places for place in places]
    pieces = zip(is_glued, texts, strict=True)
    return "".join(text if glued else f"_{text}" for glued, text in pieces).removeprefix("_")


def _is_of_label(word: _Word, following: str, unit: Unit | None) -> bool:
    """Return whether a word is of the label of a joint: neither its unit nor what a column is."""
    is_known = word.text in vocabulary().roles["no label"]
    return not (_is_unit_of(word, unit) or is_known or _is_side(word.text, following))


def _is_unit_of(word: _Word, unit: Unit | None) -> bool:
    """Return whether a word is a unit; a single letter is one only as that of its column."""
    return word.unit is not None and (not word.is_letter or word.unit == unit)


def _joint_in(words: list[_Word], joints: Sequence[str]) -> tuple[str, list[_Word]]:
    """Return the joint whose words are in a name, "" if none, and the other words."""
    texts = tuple(word.text for word in words)
    for known, joint in _known(tuple(joints)):
        for start in range(len(texts) - len(known) + 1):
            end = start + len(known)
            others = texts[:start] + texts[end:]
            if texts[start:end] != known or not others:
                continue
            # A joint named "position" or "q" must not take the only word for a quantity.
            quantities = vocabulary().quantities.keys()
            if quantities.isdisjoint(known) or not quantities.isdisjoint(others):
                return joint, words[:start] + words[end:]
    return "", words


@cache
def _known(joints: tuple[str, ...]) -> list[tuple[tuple[str, ...], str]]:
    """Return the words of each joint, whole and without "joint", the longest first."""
    names: dict[tuple[str, ...], str] = {}
    for joint in joints:
        texts = _texts(joint)
        short = tuple(text for text in texts if text not in vocabulary().roles["any_joint"])
        is_name = any(not text.isdigit() and len(text) > 1 for text in short) or len(short) > 1
        # "elbow" for elbow_joint, but not "1" for joint_1, which would be any number.
        if is_name and short not in names:
            names[short] = joint
        names[texts] = joint
    # The longest first: "left_knee" before "knee".
    return sorted(names.items(), key=lambda item: -len(item[0]))


def _in_latin(name: str) -> str:
    """Return a name with Greek letters spelled out and without accents: θ is theta.

    Words that the vocabulary has in other letters stand between blanks.
    """
    if name.isascii():
        return name
    text = unicodedata.normalize("NFKD", name)
    for dotted, word in _DOTS:
        text = dotted.sub(f" {word} ", text)
    for letter, word in _GREEK.items():
        text = text.replace(letter, f" {word} " if len(word) > 1 else word)
    # The marks of Latin letters only: those of kana distinguish words.
    text = re.sub("[\u0300-\u036f]", "", text)
    return _without_blanks().sub(r" \g<0> ", unicodedata.normalize("NFC", text))


@cache
def _without_blanks() -> re.Pattern[str]:
    """Return the pattern of words of languages that write no blanks, "关节1角度", longest first."""
    words = (word for word in vocabulary().roles["understood"] if not word.isascii())
    return re.compile("|".join(sorted(words, key=len, reverse=True)))


_TURNING_ABOUT = {"x": "roll", "y": "pitch", "z": "yaw"}

_OF_UNITS = {"m": "position", "m_per_s": "velocity", "rad_per_s": "angular_velocity"}
_OF_UNITS |= {"m_per_s2": "specific_force", "N": "", "Nm": "", "rad": ""}
"""{SI unit of a component: the quantity of its vector, if no word says it}."""

_AXIS = re.compile(r"(?:^|[._/ ]|(?<=[a-z])(?=[WXYZ]))([qpvwaftmFMT]?)([wxyzWXYZ])(?=[._/ \[(]|$)")
"""A component in a name, with the letter of its vector: "acc_x", "GyroX", "pelvis_tx"."""

_INDEXED = re.compile(r"(.*)\[(\d+)\]")
_NUMBERED = re.compile(r"(.*[A-Za-z])_?(\d+)")
_GLUED = re.compile(r"(root|d{1,2}|[vapwq])?([xyz]|pitch|roll|yaw)(d{1,2}ot|dot|d)?")
"""A coordinate with its rate in one word: "dx", "vx", "xdot", "rootz", "dpitch"."""


@cache
def _phrases(table: str, entry: str) -> tuple[str, ...]:
    """Return the words and the phrases of an entry of the vocabulary."""
    words, *phrases = vocabulary().tables[table][entry].split(", ")
    return (*words.split(), *phrases)


def _says(words: Sequence[str], table: str, entry: str) -> bool:
    """Return whether words have one of the phrases of an entry of the vocabulary."""
    text = f" {' '.join(words)} "
    return any(f" {phrase} " in text for phrase in _phrases(table, entry))


def words_of(name: str) -> list[str]:
    """Return the words of a name in small letters, glued coordinates and rates apart."""
    words: list[str] = []
    for word in re.findall(r"[a-z]+|\d+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()):
        before, axis, after = (
            glued.groups() if (glued := _GLUED.fullmatch(word)) else ("", word, "")
        )
        if before == "root":  # a hinge about y, slides along the others
            words += ["root", "pitch" if axis == "y" else axis]
            continue
        rates = (before or "").count("d") + (after or "").count("d")
        rate = ["vel" if rates == 1 else "acc"] if rates else [before] if before else []
        words += [axis, *rate]
    return words


def nearest(name: str, owners: Sequence[str]) -> tuple[str, int]:
    """Return the only joint or contact that shares the most words with a name, and how many.

    Without one the name is empty.
    """
    words = {*words_of(name)}
    shared = {owner: len(words & {*words_of(owner)}) for owner in owners}
    most = max(shared.values(), default=0)
    best = [owner for owner, count in shared.items() if count == most > 0]
    return (best[0], most) if len(best) == 1 else ("", 0)


def kind_of(name: str) -> str:
    """Return the quantity of the base that a name says, an empty text if none."""
    words = words_of(name)
    if words[-1:] == ["t"] and _says(words, "base_words", "body"):  # a translation: "trunk.t"
        return "position"
    kinds = vocabulary().tables["base"]
    return next((kind for kind in kinds if _says(words, "base", kind)), "")


def is_commanded(name: str) -> bool:
    """Return whether a name is that of a command."""
    return _has(words_of(name), "commanded")


def is_of_base(name: str, entry: str) -> bool:
    """Return whether a name has a word of "contact", or of "no_vector" of a base."""
    return _says(words_of(name), "base_words", entry)


def _unit(tail: str) -> tuple[str, float] | None:
    """Return quantity and factor to SI of the unit behind a component, None if it is none."""
    text = tail.strip(" _.[]()")
    _, unit = known_unit(text) or ("", "")
    units = ((of, UNIT_FACTORS[si].get(unit)) for si, of in _OF_UNITS.items())
    return next(((of, x) for of, x in units if x is not None), None) if text else ("", 1.0)


def place_of(bare: str, file: str) -> tuple[str, str, str, float]:
    """Return form, stem, place and factor of a column as that of a vector.

    The form is "array" of q[3] and of the numbered columns of a file, "axis" of a component with
    the factor of its unit, "number" of a name that ends in one, or an empty text.
    """
    if part := _INDEXED.fullmatch(bare):
        return "array", part[1], part[2], 1.0
    if bare.isdecimal() and file:
        return "array", file.rsplit(".", 1)[0], bare, 1.0
    if component := _component(bare):
        return "axis", *component
    number = _NUMBERED.fullmatch(bare)
    return ("number", number[1], number[2], 1.0) if number else ("", "", "", 1.0)


def _component(bare: str) -> tuple[str, str, float] | None:
    """Return the name of a vector, the axis of a column and its factor: "GyroX [deg/s]"."""
    for match in _AXIS.finditer(bare):
        stem, unit = bare[: match.start()], _unit(bare[match.end() :])
        if unit is None or not (stem or match[1]):
            continue
        quantity, factor = unit
        stem += f"_{match[1]}" if match[1] else ""
        if quantity and not kind_of(stem) and _says(words_of(stem), "base_words", "body"):
            stem = f"{stem}.{quantity}"
        return stem, match[2].lower(), factor
    return None


def planar_meaning(bare: str, normal: str) -> tuple[str, str]:
    """Return (quantity, axis) of a name, empty texts if it is not that of a planar base."""
    words, known = {*words_of(bare)}, _planar_words()
    rest = words - known["body"] - known["filler"]
    axes, angles = rest & {*"xyz"}, rest & {*_phrases("base_words", _TURNING_ABOUT[normal])}
    if words & known["body"] and not axes:
        angles |= rest & known["angle"]
    rest -= axes | angles
    is_angle = bool(angles) and not axes
    kind = _planar_kind(rest - {"pos"} if is_angle else rest, is_angle)
    if kind in ("angle", "angular_velocity"):  # it may lack its axis: "gyro"
        return (kind, normal) if axes <= {normal} else ("", "")
    is_in_plane = len(axes) == 1 and axes != {normal}
    return (kind, axes.pop()) if kind and is_in_plane else ("", "")


def _planar_kind(words: set[str], is_angle: bool) -> str:
    """Return the quantity of words without axes; an unknown word makes it another column.

    "base_pos_pitch_dot" is a rate.
    """
    kinds = {"position": "angle", "angular_velocity": "angular_velocity"} if is_angle else {}
    known = _planar_words()
    return next((kinds.get(x, x) for x in kinds or PLANAR if words <= known[x]), "")


PLANAR = ("position", "velocity", "specific_force", "angular_velocity")
"""Quantities of a planar base, but its angle."""


@cache
def _planar_words() -> dict[str, set[str]]:
    """Return the words of a planar base by what they say; a rate may be that of an angle."""
    tables = vocabulary().tables["planar_words"]
    words = {x: {*_phrases("base_words", x)} for x in ("body", "filler", "angle")}
    words |= {x: {*_phrases("base", x), *tables.get(x, "").split()} for x in PLANAR}
    words["angular_velocity"] |= words["velocity"]
    return words
