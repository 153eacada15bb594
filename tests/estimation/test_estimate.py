"""Estimate: intervals, parts, names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seaid.errors import SeaidError
from seaid.estimation.estimate import Estimate

COVARIANCE = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 2.0], [0.0, 2.0, 1.0]])
FOUND = Estimate(
    names=("a", "b", "c"),
    values=np.array([10.0, -3.0, 0.0]),
    covariance=COVARIANCE,
    units=("kg", "m", "s"),
    residual_std=0.1,
    condition_number=3.0,
)


def test_standard_errors_are_roots_of_the_diagonal() -> None:
    assert FOUND.standard_errors == pytest.approx([2.0, 3.0, 1.0])
    assert FOUND.relative_standard_errors == pytest.approx([0.2, 1.0, np.inf])


@pytest.mark.parametrize(("level", "half_width"), [(0.95, 1.959964), (0.5, 0.674490)])
def test_intervals_are_those_of_the_normal_distribution(level: float, half_width: float) -> None:
    interval = FOUND.interval(level)
    assert interval.shape == (3, 2)
    assert interval.mean(axis=1) == pytest.approx(FOUND.values)
    assert interval[:, 1] - FOUND.values == pytest.approx(half_width * FOUND.standard_errors)


def test_few_degrees_of_freedom_make_intervals_wider_and_errors_not() -> None:
    few = replace(FOUND, degrees_of_freedom=np.array([4.0, 30.0, np.inf]))
    half = few.interval()[:, 1] - few.values
    assert half / few.standard_errors == pytest.approx([2.7764, 2.0423, 1.9600], abs=1e-4)
    assert few.part([2, 0], ["c", "a"]).degrees_of_freedom == pytest.approx([np.inf, 4.0])
    assert few.standard_errors == pytest.approx(FOUND.standard_errors)


@pytest.mark.parametrize("level", [0.0, 1.0, -0.5, 95.0])
def test_impossible_level_is_refused(level: float) -> None:
    with pytest.raises(SeaidError, match="level must be between 0 and 1"):
        FOUND.interval(level)


def test_part_keeps_values_units_and_their_covariance() -> None:
    part = FOUND.part([2, 1], ["z", "y"])
    assert part.names == ("z", "y")
    assert part.units == ("s", "m")
    assert part.values.tolist() == [0.0, -3.0]
    assert part.covariance.tolist() == [[1.0, 2.0], [2.0, 9.0]]


def test_value_and_standard_error_by_name() -> None:
    assert FOUND.value("b") == -3.0
    assert FOUND.standard_error("b") == 3.0


def test_unknown_name_lists_what_is_there() -> None:
    with pytest.raises(SeaidError, match="no parameter is named 'd'; allowed: a, b, c"):
        FOUND.value("d")


def test_shapes_are_checked_and_arrays_read_only() -> None:
    with pytest.raises(SeaidError, match="values must have shape"):
        Estimate(("a",), np.zeros(2), np.eye(1), ("kg",), 0.0, 1.0)
    with pytest.raises(SeaidError, match="covariance must have shape"):
        Estimate(("a",), np.zeros(1), np.eye(2), ("kg",), 0.0, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        FOUND.values[0] = 1.0
