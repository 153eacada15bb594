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

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
