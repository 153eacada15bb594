"""The exact engine: any Euler-Lagrange system to its regressor form and its base parameters.

`equations_of_motion` makes equations from a Lagrangian, `separate` brings them (or any others) to
zeta = R theta (9) by Algorithm 1 on exact polynomials, `reduce` finds the base form (11)-(14).
"""

from seaid.symbolic.lagrange import equations_of_motion
from seaid.symbolic.reduction import BaseForm, Column, reduce
from seaid.symbolic.separation import RegressorForm, separate

__all__ = [
    "BaseForm",
    "Column",
    "RegressorForm",
    "equations_of_motion",
    "reduce",
    "separate",
]
