"""The exact engine: any Euler-Lagrange system to its regressor form and its base parameters.

`separate` brings equations of motion to zeta = R theta (9), by Algorithm 1 on exact polynomials.
"""

from seaid.symbolic.separation import RegressorForm, separate

__all__ = ["RegressorForm", "separate"]
