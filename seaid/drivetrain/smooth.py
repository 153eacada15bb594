"""Columns of a drive's regressor with their slopes: what a search with gradients needs of (10)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import sympy as sp

from seaid.arrays import Array
from seaid.drivetrain.equations import known_values
from seaid.drivetrain.regressor import DriveRegressor, flat_names

SIGNALS = ("theta_M", "theta_M_dot", "theta_M_ddot", "theta_L", "theta_L_dot", "theta_L_ddot")
"""What the columns are differentiated by, in this order."""

_WIDTH = sp.Symbol("sign_width", positive=True)


def smooth_columns(
    regressor: DriveRegressor, signals: Mapping[str, Array], sign_width_rad_s: float
) -> tuple[Array, Array]:
    """Return the columns (T, p) of a drive's regressor and their slopes (T, p, 6) by `SIGNALS`.

    As `DriveRegressor.evaluate`, with sign(x) as tanh(x / sign_width_rad_s), so that friction has a
    slope.
    """
    row = tuple(regressor.form.regressor)[: len(regressor.names)]
    function, names = _compiled(row)
    known = {str(symbol): value for symbol, value in known_values(regressor.drive).items()}
    known[str(_WIDTH)] = sign_width_rad_s
    arguments = [known[name] if name in known else signals[name] for name in names]
    length = len(next(iter(signals.values())))
    entries = [np.broadcast_to(entry, (length,)) for entry in function(*arguments)]
    p = len(row)
    slopes = np.stack([*entries[p:], *[np.zeros(length)] * (not p)], axis=1)
    return (
        np.stack(entries[:p], axis=1) if p else np.empty((length, 0)),
        slopes[:, : 6 * p].reshape(length, p, len(SIGNALS)),
    )


@cache
def _compiled(row: tuple[sp.Expr, ...]):  # type: ignore[no-untyped-def]
    smooth = [flat_names(entry).replace(sp.sign, lambda x: sp.tanh(x / _WIDTH)) for entry in row]
    slopes = [entry.diff(sp.Symbol(signal)) for entry in smooth for signal in SIGNALS]
    entries = [*smooth, *slopes]
    names = sorted({str(symbol) for entry in entries for symbol in entry.free_symbols})
    return sp.lambdify([sp.Symbol(name) for name in names], entries, modules="numpy"), names
