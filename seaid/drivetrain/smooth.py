"""Columns of a drive's regressor with their slopes: what a search with gradients needs of (10)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp

from seaid.arrays import Array, FrozenMapping
from seaid.drivetrain.regressor import DriveRegressor, flat_names
from seaid.drivetrain.symbols import SYMBOLS, known_values

SIGNALS = ("theta_M", "theta_M_dot", "theta_M_ddot", "theta_L", "theta_L_dot", "theta_L_ddot")
"""What the columns are differentiated by, in this order."""

_WIDTH = sp.Symbol("sign_width", positive=True)


@dataclass(frozen=True)
class SmoothColumns:
    """The columns of a drive's regressor as expressions of `SIGNALS` and `known` values.

    Plain data, which can be sent to other processes.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    row: tuple[sp.Expr, ...]
    known: FrozenMapping[float]

    def evaluate(
        self, signals: Mapping[str, Array], sign_width_rad_s: float
    ) -> tuple[Array, Array]:
        """Return the columns (T, p) and their slopes (T, p, 6) by `SIGNALS`, each (T,).

        As `DriveRegressor.evaluate`, with sign(x) as tanh(x / sign_width_rad_s), so that friction
        has a slope.
        """
        function, names = _compiled(self.row)
        known = {**self.known, str(_WIDTH): sign_width_rad_s}
        arguments = [known[name] if name in known else signals[name] for name in names]
        p, length = len(self.row), len(next(iter(signals.values())))
        table = np.empty((p * (1 + len(SIGNALS)), length))
        for line, entry in zip(table, function(*arguments), strict=True):
            line[:] = entry
        return table[:p].T, table[p:].reshape(p, len(SIGNALS), length).transpose(2, 0, 1)


def smooth_columns(regressor: DriveRegressor) -> SmoothColumns:
    """Return the columns of a drive's regressor with slopes."""
    row = tuple(map(flat_names, regressor.row))
    known = {str(SYMBOLS[name]): value for name, value in regressor.drive.values.items()}
    known |= {str(symbol): value for symbol, value in known_values(regressor.drive).items()}
    return SmoothColumns(regressor.names, regressor.units, row, FrozenMapping(known))


@cache
def _compiled(row: tuple[sp.Expr, ...]):  # type: ignore[no-untyped-def]
    smooth = [entry.replace(sp.sign, lambda x: sp.tanh(x / _WIDTH)) for entry in row]
    slopes = [entry.diff(sp.Symbol(signal)) for entry in smooth for signal in SIGNALS]
    entries = [*smooth, *slopes]
    names = sorted({str(symbol) for entry in entries for symbol in entry.free_symbols})
    return sp.lambdify([sp.Symbol(name) for name in names], entries, modules="numpy"), names
