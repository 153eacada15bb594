"""What the name of a foreign column says: quantity, side of the gear, joint, unit."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

_QUANTITIES = {
    "time": "t time stamp timestamp ts clock seconds sec nanosec",
    "position": "pos position angle q theta phi ang enc encoder positions qpos",
    "velocity": "vel velocity speed dq qd qdot omega dtheta velocities rpm qvel",
    "acceleration": "acc accel acceleration ddq qdd qddot",
    "deflection": "defl deflection twist",
    "torque": "tau torque eff effort trq moment force torques frc",
    "current": "cur current amps iq curr currents i",
    "voltage": "volt volts voltage u voltages",
    "duty": "pwm duty",
    "temperature": "temp temperature wtemp",
}
_WORDS = {word: kind for kind, words in _QUANTITIES.items() for word in words.split()}
_ORDER = ("acceleration", "velocity", "temperature", "duty", "voltage", "current", "deflection")
_MOTOR = {"m", "motor", "mot", "rotor", "drive", "winding"}
_JOINT = {"joint", "link", "load", "out", "output", "l", "arm", "sensor", "external"}
_ROLES = {
    "commanded": "cmd command commanded goal target des desired ref reference setpoint con",
    "derived": "filt filtered fric friction est estimated model ff error err",
    "filler": "meas measured raw state states header actual act value data of the w bus",
}
_COMMANDED, _DERIVED, _FILLER = (set(words.split()) for words in _ROLES.values())
_UNITS = {
    **dict.fromkeys(("rad", "rads", "radians"), "rad"),
    **dict.fromkeys(("deg", "degs", "degree", "degrees"), "deg"),
    **dict.fromkeys(("turn", "turns", "rev", "revs"), "turn"),
    **dict.fromkeys(("count", "counts", "ticks", "inc"), "counts"),
    **{"nm": "Nm", "mnm": "mNm", "n": "N", "a": "A", "ma": "mA", "v": "V", "mv": "mV", "mm": "mm"},
    **{"s": "s", "ms": "ms", "us": "us", "ns": "ns", "nsec": "ns", "usec": "us", "msec": "ms"},
}
_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^\W\d_]+")
_GREEK = {"θ": "theta", "φ": "phi", "ω": "omega", "τ": "tau", "μ": "u"}
_DOTS = (
    (re.compile("[qθφ]\N{COMBINING DOT ABOVE}"), "velocity"),
    (re.compile("[qθφ]\N{COMBINING DIAERESIS}"), "acceleration"),
)
"""Letters with the dots of a derivative, and the words for them."""


@dataclass(frozen=True)
class Meaning:
    """What a column name says: `quantity` ("position", ..., "" unknown), `side` ("motor", "joint",
    ""), `joint` (what is left of the name), `unit` or None; `is_raw` False for commands and what is
    filtered or computed.
    """

    quantity: str
    side: str
    joint: str
    unit: str | None
    is_raw: bool


def meaning_of(name: str) -> Meaning:
    """Read a column name: "mpos_0", "/joint_states/position[elbow]", "tau_meas1", "qd2"."""
    head, label = name, ""
    if bracket := re.fullmatch(r"(.*)\[([^\[\]]*)\]", name):
        head, label = bracket[1], bracket[2]
    if head.startswith("/"):  # a topic: the field counts
        head = head.rsplit("/", 1)[1]
    words = [word for one in _SPLIT.findall(_in_latin(head)) for word in _split(one.lower())]
    found = [_WORDS[word] for word in words if word in _WORDS]
    quantity = next((kind for kind in _ORDER if kind in found), found[0] if found else "")
    unit = next((_UNITS[word] for word in words[-1:] if word in _UNITS), None)
    if quantity == "time" and len(found) > 1:
        quantity = next((kind for kind in found if kind != "time"), "time")
    motor, joint = bool(_MOTOR & set(words)), _is_at_joint(words)
    side = "motor" if motor and not joint else "joint" if joint and not motor else ""
    if motor and joint:  # "joint_position_m" is in metres, "motor_elbow_joint" of the motor
        unit, side = ("m", "joint") if words[-1] == "m" else (unit, "motor")
    known = {*_WORDS, *_MOTOR, *_COMMANDED, *_DERIVED, *_FILLER}
    rest = [
        word
        for word, following in zip(words, [*words[1:], ""], strict=False)
        if word not in known
        and (word not in _UNITS or word.isdigit())
        and not (word in _JOINT and following in _WORDS)
    ]
    if set(rest) <= _JOINT | {"1"} and not any(word.isdigit() for word in rest):
        rest = []
    tag = label or "_".join(word for word in _named(rest))
    is_raw = not (_COMMANDED | _DERIVED) & set(words)
    return Meaning(quantity, side, tag, unit, is_raw)


def _in_latin(name: str) -> str:
    """Return a name with Greek letters as the words for them, without accents: θ is theta."""
    if name.isascii():
        return name
    text = unicodedata.normalize("NFKD", name)
    for dotted, word in _DOTS:
        text = dotted.sub(f" {word} ", text)
    for letter, word in _GREEK.items():
        text = text.replace(letter, f" {word} " if len(word) > 1 else word)
    return "".join(one for one in text if not unicodedata.combining(one))


def _is_at_joint(words: list[str]) -> bool:
    """Tell "joint_position" and "pos_link", a side of the gear, from "pos_elbow_joint", a name."""
    others = [word for word in words if not word.isdigit() and word not in _UNITS]
    for place, word in enumerate(others):
        before_quantity = others[place + 1 : place + 2]
        if word in _JOINT and before_quantity and before_quantity[0] in _WORDS:
            return True
    named = [word for word in others if word not in {*_WORDS, *_MOTOR, *_FILLER, *_JOINT}]
    return not named and bool(_JOINT & set(others))


def _named(rest: list[str]) -> list[str]:
    """Return the words of a joint's name: with a number alone, the number."""
    digits = [word for word in rest if word.isdigit()]
    return digits if digits and set(rest) <= {*digits, *_JOINT} else rest


def _split(word: str) -> list[str]:
    """Split a word into known ones: "mpos" into m and pos, "wcur" into w and cur."""
    if word in _WORDS or word in _UNITS or len(word) < 2:
        return [word]
    if word[0] in "mlw" and word[1:] in _WORDS:
        return [word[0], word[1:]]
    if word[-1] in "ml" and word[:-1] in _WORDS:
        return [word[:-1], word[-1]]
    return [word]
