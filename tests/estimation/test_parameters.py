"""Parameters as data: equal by what they are, with priors and bounds that make sense."""

from __future__ import annotations

import math

import numpy as np
import pytest

from seaid.drives import ParameterName
from seaid.errors import IdentificationError
from seaid.estimation import Parameter, Prior
from seaid.estimation.parameters import bounds_of, priors_of


def test_parameters_are_the_same_by_quantity_owner_and_condition() -> None:
    knee = Parameter("stiffness", "knee", unit="N m/rad", prior=Prior(100.0, 5.0), lower=0.0)
    assert knee == Parameter("stiffness", "knee")
    assert {knee: 3}[Parameter("stiffness", "knee")] == 3
    assert knee != Parameter("stiffness", "ankle")
    assert knee != Parameter("stiffness", "knee", "warm")


def test_a_column_of_a_joint_has_quantity_and_owner() -> None:
    column = ParameterName("stiffness", "knee")
    assert Parameter.of_column(column) == Parameter("stiffness", "knee")
    assert Parameter.of_column(column).name == column
    assert Parameter.of_column("m of shank").owner == ""
    assert Parameter("stiffness", "knee", "warm").name == "stiffness of knee [warm]"


def test_priors_and_bounds_are_those_of_the_columns() -> None:
    parameters = [Parameter("mass"), Parameter("stiffness", prior=Prior(2.0, 0.5), lower=0.0)]
    expected, stds = priors_of(parameters)
    np.testing.assert_array_equal(expected, [0.0, 2.0])
    np.testing.assert_array_equal(stds, [math.inf, 0.5])
    lower, upper = bounds_of(parameters)
    np.testing.assert_array_equal(lower, [-math.inf, 0.0])
    np.testing.assert_array_equal(upper, [math.inf, math.inf])


@pytest.mark.parametrize(
    ("value", "std"), [(math.nan, 1.0), (0.0, -1.0), (0.0, 0.0), (0.0, math.inf)]
)
def test_priors_and_bounds_without_a_meaning_are_refused(value: float, std: float) -> None:
    """A standard deviation that is not above zero, and bounds that leave no value."""
    with pytest.raises(IdentificationError, match="a standard deviation above zero, found"):
        Prior(value, std)
    with pytest.raises(IdentificationError, match="speed of knee leave no value"):
        Parameter("speed", "knee", lower=2.0, upper=1.0)
