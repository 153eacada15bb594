"""Exact symbolic regressors: equations of motion -> regressor form (9) -> base form (14).

sympy equations of any Euler-Lagrange system come in; regressor matrices and base parameters go
out, computed on polynomials over the rationals, so that no tolerance decides a rank:

- `equations_of_motion`: the Euler-Lagrange equations (5) of a Lagrangian;
- `separate`: Algorithm 1, which brings equations to zeta = R theta (9);
- `reduce`: the base regressor form zeta = R_0 theta_0, (11)-(14), by Gauss-Jordan elimination.

This package knows no robot and no drive. `base_parameters`, `rigid_body` and `complete_model`
do the same for a Robot; they live in `seaid.regressor.exact` and are reachable here too.

>>> from sympy import Eq, Function, symbols
>>> from seaid.symbolic import reduce, separate
>>> t, m, b, c = symbols("t m b c")
>>> x, F = Function("x")(t), Function("F")(t)
>>> balance = Eq(m * x.diff(t, 2) + (b + c) * x.diff(t), F)
>>> reduce(separate(balance, motion=[x, F], unknowns=[m, b, c])).parameters
Matrix([
[    m],
[b + c]])
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
    """Import a name of `seaid.regressor.exact` on first use, to keep robots out of this package."""
    if name not in __all__:
        raise AttributeError(f"module 'seaid.symbolic' has no attribute '{name}'")
    from seaid.regressor import exact

    return getattr(exact, name)


def __dir__() -> list[str]:
    return sorted(__all__)
