"""The numbers on which checks decide, each with its unit, its meaning and where it comes from.

No number is chosen on the log of one robot: it follows from statistics, from physics, or from a
study over simulated robots that its line names. A check has no number of its own elsewhere.
"""

SIGNIFICANT = 5.0
"""Standard errors beyond which a difference is no chance: among 50 parameters whose covariance
rests on some 100 correlated instants, right set-ups have at most 4.5
(`scripts/benchmarks/sensitivity.py`)."""

MATERIAL = 2.0
"""Stated standard errors of a parameter above which its change matters: below, it is within the
interval."""

NEGLIGIBLE = 0.003
"""Error of a torque over its size below which what a model lacks does not matter."""

NOTHING, PART = 0.9, 0.5
"""Error of excluded blocks, over that of a constant torque, from which a model is of no use;
if it is below the second one in the own logs, it fits these only. Where both errors are between
them, the model lacks much. A motor equation whose error is below the second one holds. What
explains more than the second one of a squared residual is its cause."""

HALF_POWER = 0.7
"""Error over another from which its square is half of that."""

POOR = 0.1
"""Relative error from which it matters: of a parameter, or of the torque of a joint."""

SURE = 3.0
"""Standard errors from which a value is not zero: of twenty parameters that are zero, one is two
standard errors below it in four of ten logs. Of windows of a residual, a multiple of the median."""

BURST, WINDOW_S, RARE, SLIGHT = 6.0, 0.25, 0.2, 0.05
"""A contact is where the residual of a window [s] exceeds so many times that of the median window
(rms), unless it does so in more than a part of the windows, or is a small part of the torque."""

CORRELATED_ROWS = 4.0
"""Rows of a regression per independent one. A window has at least one."""
