"""Numbers of a page: no digit that the standard error does not let stand."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid.report.formats import (
    Measured,
    number,
    percent,
    powers_of_ten,
    probability,
    seconds,
    share,
    short,
)


@pytest.mark.parametrize(
    ("value", "error", "texts"),
    [
        (83097.04, 95.7, ("83097", "96")),
        (0.0241512, 0.0015861, ("0.0242", "0.0016")),
        (0.0041512, 0.0015861, ("4.2·10⁻³", "1.6·10⁻³")),
        (8.079e-5, 8.711e-7, ("8.079·10⁻⁵", "0.087·10⁻⁵")),
        (-0.1447, 0.005479, ("−0.1447", "0.0055")),
        (-0.0001548, 0.001133, ("−0.15·10⁻³", "1.13·10⁻³")),
        (0.0, 0.012, ("0.000", "0.012")),
        (3.0, 0.0, ("3.00000", "0.00000")),
        (math.nan, 1.0, ("–", "–")),
        (2.5, math.inf, ("2.50000", "–")),
    ],
)
def test_values_end_where_their_error_does(
    value: float, error: float, texts: tuple[str, str]
) -> None:
    found = Measured(value, error, value - 2 * error, value + 2 * error)
    assert (found.text("value"), found.text("error")) == texts


finite = st.floats(-1e9, 1e9, allow_nan=False).filter(lambda x: x == 0 or abs(x) > 1e-9)


@given(value=finite, relative=st.floats(1e-6, 1e3))
def test_text_says_the_number_to_a_tenth_of_its_error(value: float, relative: float) -> None:
    error = relative * (abs(value) or 1.0)
    found = Measured(value, error, value - error, value + error)
    assert abs(read(found.text("value")) - value) <= 0.051 * error * (1 + 1e-9)
    assert abs(read(found.text("error")) - error) <= 0.051 * error * (1 + 1e-9)


def read(text: str) -> float:
    """Return the number that a text such as 8.1·10⁻⁵ says."""
    raised = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")
    return float(text.replace("·10", "e").translate(raised))


@pytest.mark.parametrize(
    ("shown", "value", "text"),
    [
        *((share, 0.0123, "1.2 %"), (share, 0.00073, "0.073 %"), (share, 0.996, "100 %")),
        *((share, 3.28, "328 %"), (share, 0.0, "0 %"), (share, 2.1e-6, "0.00021 %")),
        *((share, 3e-7, "3·10⁻⁵ %"), (share, math.nan, "–"), (share, 1e6, "1·10⁸ %")),
        *((short, math.inf, "–"), (short, -0.00012345, "−0.000123")),
        *((short, -1.2345e-7, "−1.23·10⁻⁷"), (probability, 0.0, "< 10⁻¹⁶")),
        *((probability, 0.034, "0.034"), (seconds, 10.0, "10 s"), (seconds, 600.0, "10 min")),
        *((percent, 0.0123, "1.2 %"), (percent, -0.004, "-0.4 %"), (percent, 1.5, "150 %")),
        *((percent, math.nan, "-"), (number, 0.0, "0"), (number, 83008.4, "8.301e+04")),
        *((number, 0.00456, "0.00456"), (number, math.inf, "-")),
        *((powers_of_ten, "1.2e-05", "1.2·10⁻⁵"), (powers_of_ten, "-3e+10", "−3·10¹⁰")),
        (powers_of_ten, "0.5", "0.5"),
    ],
)
def test_numbers_have_as_many_digits_as_their_kind(
    shown: Callable[[object], str], value: object, text: str
) -> None:
    """Two digits of shares, four of numbers in a terminal, and signs of a page or a terminal."""
    assert shown(value).replace("\N{NO-BREAK SPACE}", " ") == text
