"""The exact engine: any Euler-Lagrange system to its regressor form and its base parameters.

`equations_of_motion` makes equations from a Lagrangian, `separate` brings them (or any others) to
zeta = R theta (9) by Algorithm 1 on exact polynomials, `reduce` finds the base form (11)-(14).
`base_parameters` does the same for a Robot, through its geometry as exact rationals.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from seaid.symbolic.expression_text import expression_of as expression_of
from seaid.symbolic.lagrange import equations_of_motion
from seaid.symbolic.polynomial import MAX_TERMS as MAX_TERMS
from seaid.symbolic.reduction import BaseForm, Column, reduce
from seaid.symbolic.separation import RegressorForm, separate

if TYPE_CHECKING:
    from seaid.regressor.exact import (
        CompleteModel,
        ExactBaseParameters,
        RigidBodyForm,
        base_parameters,
        complete_model,
        export_c,
        export_numpy,
        rigid_body,
    )

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
    """Import what derives the equations of a Robot when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module 'seaid.symbolic' has no attribute '{name}'")
    from seaid.regressor import exact

    return getattr(exact, name)


def __dir__() -> list[str]:
    return sorted(__all__)
