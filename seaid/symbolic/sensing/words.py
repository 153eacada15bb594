"""Which equations of a joint its sensors leave to be used, and why not the others, in words."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from seaid.symbolic.sensing.drives import INPUTS
from seaid.symbolic.sensing.equations import Equation, System

_TITLES = {"motor": "(7) of its motor", "spring": "(4b) of its spring", "load": "(8) of its load"}

_TORQUES = {
    "stiffness": "spring torque",
    "torque_constant": "motor torque",
    "voltage_constant": "motor torque",
}


def words_of(system: System, scaled: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return {joint: sentences} of all joints; `scaled` are names known only up to a factor."""
    return {
        joint: (*_sentences(system, index), *_scales(joint, scaled))
        for index, joint in enumerate(system.robot.joint_names)
    }


def _scales(joint: str, scaled: Collection[str]) -> Iterator[str]:
    """Say which torque of a joint has no scale of its own."""
    for name, torque in _TORQUES.items():
        if f"{name} of {joint}" in scaled:
            yield f"its {torque} is known only up to the scale of its {name.replace('_', ' ')}"


def _sentences(system: System, index: int) -> Iterator[str]:
    own = [(e, one) for e, one in enumerate(system.equations) if one.index == index]
    inputs = [one for _, one in own if one.kind == "input" and not one.missing]
    for e, equation in own:
        if equation.kind not in _TITLES:
            continue
        title = _TITLES[equation.kind]
        if e in system.used:
            yield f"{title} is used{_by(system, equation)}"
        elif equation.missing:
            yield f"{title} cannot be used: {'; '.join(equation.missing)}"
        elif equation.kind == "motor" and not inputs:
            yield f"{title} cannot be used: no motor torque, current or voltage"
        else:
            yield f"{title} cannot be used: nothing tells the torque on its load"


def _by(system: System, equation: Equation) -> str:
    """Say by what sensor a motor balance is used."""
    if equation.kind != "motor":
        return ""
    terms = system.terms[equation.index]
    constant = {"motor_current": "torque constant", "motor_voltage": "voltage constant"}
    text = f", by motor {INPUTS[terms.driver]}"
    name = constant.get(terms.driver)
    unknown = name is not None and name.replace(" ", "_") in terms.names
    return f"{text} times an unknown {name}" if unknown else text
