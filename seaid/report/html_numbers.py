"""Numbers for a reader: as many digits as the standard error lets stand, errors with two."""

from __future__ import annotations

import math
from dataclasses import dataclass

_ERROR_DIGITS, _VALUE_DIGITS, _WITHOUT_ERROR = 2, 2, 6
_FIXED = (-4, 6)
"""Powers of ten between which a number is written without an exponent."""

_TINY = 1e-16

NONE = "–"


@dataclass(frozen=True)
class Rounded:
    """A value with its standard errors and 95 % interval as text, all with the same last digit."""

    value: str
    error: str
    lower: str
    upper: str
    white: str


def rounded(
    value: float, error: float, lower: float, upper: float, white: float = math.nan
) -> Rounded:
    """Return numbers rounded at the second digit of the standard error, of the value if finer.

    `white` is the standard error for white noise, NaN where there is none.
    """
    if not math.isfinite(value):
        return Rounded(NONE, NONE, NONE, NONE, NONE)
    last = _last_place(value, error)
    size = max(abs(value), error if math.isfinite(error) else 0.0)
    top = _power(size) if size > 0 else 0
    shift = 0 if _FIXED[0] <= top < _FIXED[1] else top
    texts = (_fixed(one, last, shift) for one in (value, error, lower, upper, white))
    return Rounded(*texts)


def short(value: float, digits: int = 3) -> str:
    """Return a number with so many digits, a dash where there is none."""
    return f"{value:.{digits}g}".replace("-", "−") if math.isfinite(value) else NONE


def probability(value: float) -> str:
    """Return a probability with two digits, tiny ones as such."""
    return short(value, 2) if not value < _TINY else "< 1e−16"


def share(value: float) -> str:
    """Return a ratio in percent with two digits, from 100 % on whole, a dash for none."""
    if not math.isfinite(value):
        return NONE
    per_cent = 100 * value
    if abs(per_cent) >= 99.5:
        return (
            f"{per_cent:.0f}\N{NO-BREAK SPACE}%"
            if abs(per_cent) < 1e4
            else "> 10⁴\N{NO-BREAK SPACE}%"
        )
    decimals = 0 if per_cent == 0 else max(0, 1 - _power(abs(per_cent)))
    return f"{per_cent:.{min(decimals, 6)}f}\N{NO-BREAK SPACE}%"


def seconds(value: float) -> str:
    """Return a duration in s, from two minutes on in min."""
    return f"{value:.4g} s" if value < 120 else f"{value / 60:.3g} min"


def _last_place(value: float, error: float) -> int:
    """Return the power of ten of the last digit that is written."""
    if not math.isfinite(error) or error <= 0:
        return _power(abs(value)) - _WITHOUT_ERROR + 1 if value else 0
    by_error = _power(error) - _ERROR_DIGITS + 1
    by_value = _power(abs(value)) - _VALUE_DIGITS + 1 if value else by_error
    return max(min(by_error, by_value), by_error - 2)


def _power(size: float) -> int:
    return math.floor(math.log10(size) + 1e-12) if size > 0 else 0


def _fixed(value: float, last: int, shift: int) -> str:
    if not math.isfinite(value):
        return NONE
    decimals = max(shift - last, 0)
    text = f"{value / 10.0**shift:.{decimals}f}"
    text = text.removeprefix("-") if float(text) == 0 else text
    return text.replace("-", "−") + (f"e{shift:+d}".replace("-", "−") if shift else "")
