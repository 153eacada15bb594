"""The exact engine: any Euler-Lagrange system to its regressor form and its base parameters.

`equations_of_motion` makes equations from a Lagrangian, `separate` brings them (or any others) to
zeta = R theta (9) by Algorithm 1 on exact polynomials, `reduce` finds the base form (11)-(14).
`base_parameters` does the same for a Robot, through its geometry as exact rationals.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from seaid.symbolic.lagrange import equations_of_motion
from seaid.symbolic.reduction import BaseForm, Column, reduce
from seaid.symbolic.separation import RegressorForm, separate

if TYPE_CHECKING:
    from seaid.symbolic.exact_base import base_parameters
    from seaid.symbolic.grouping import ExactBaseParameters
    from seaid.symbolic.regressor_form import RigidBodyForm, rigid_body
    from seaid.symbolic.source import export_c, export_numpy
    from seaid.symbolic.whole_model import CompleteModel, complete_model

_OF_ROBOTS = {
    "CompleteModel": "whole_model",
    "ExactBaseParameters": "grouping",
    "RigidBodyForm": "regressor_form",
    "base_parameters": "exact_base",
    "complete_model": "whole_model",
    "export_c": "source",
    "export_numpy": "source",
    "rigid_body": "regressor_form",
}
"""What reads a Robot, and so Pinocchio: imported when it is first used."""

__all__ = [
    "BaseForm",
    "Column",
    "CompleteModel",
    "ExactBaseParameters",
    "RegressorForm",
    "RigidBodyForm",
    "base_parameters",
    "complete_model",
    "equations_of_motion",
    "export_c",
    "export_numpy",
    "reduce",
    "rigid_body",
    "separate",
]


def __getattr__(name: str) -> Any:
    """Import what reads a Robot when it is first used."""
    if name not in _OF_ROBOTS:
        raise AttributeError(f"module 'seaid.symbolic' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"seaid.symbolic.{_OF_ROBOTS[name]}"), name)
    globals()[name] = value
    return value
