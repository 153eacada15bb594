"""comparison_of: a change that is there is significant, one that is not there is not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from seaid.drives import ParameterName
from seaid.errors import IdentificationError
from seaid.estimation import Estimate
from seaid.identification import Identification, identify
from seaid.report import comparison_of
from tests.experiments import arm, arm_found, arm_log, arm_motion

WARM = 0.3
"""Part of the viscous friction that the warm shoulder lacks."""


@cache
def warm() -> Identification:
    """Return the arm identified from the same motion with a warm shoulder."""
    log, friction = arm_log(7), np.zeros(4)
    friction[1] = WARM * arm().drives["shoulder"].values["viscous_friction"]
    torque = log.motor_torque - friction * arm_motion().motor_velocity
    return identify(arm().without_nominal(), replace(log, motor_torque=torque))


def made(values: list[float], errors: list[float], freedom: float) -> Estimate:
    names = tuple(ParameterName(f"m_{k}") for k in range(len(values)))
    return Estimate(
        names,
        np.array(values),
        np.diag(np.square(errors)),
        ("kg",) * len(values),
        0.1,
        3.0,
        degrees_of_freedom=np.full(len(values), freedom),
    )


def of_loads(one: Estimate, other: Estimate) -> tuple[Identification, Identification]:
    nothing = replace(arm_found(), drive_side={}, gears={})
    return replace(nothing, load=one), replace(nothing, load=other, motions=())


def test_numbers_are_those_of_welch_and_of_chi_square() -> None:
    """Independent route: scipy's test of two means with the same variances of the means."""
    from scipy import stats

    first, second = made([1.0, 5.0], [0.3, 0.1], 9.0), made([2.0, 5.0], [0.4, 0.2], 9.0)
    result = comparison_of(*of_loads(first, second))
    scale = np.sqrt(10.0)
    expected = stats.ttest_ind_from_stats(
        1.0, 0.3 * scale, 10, 2.0, 0.4 * scale, 10, equal_var=False
    )
    one, same = result.differences
    assert one.p_value == pytest.approx(expected.pvalue)
    assert (one.change, one.error, one.significance) == pytest.approx((1.0, 0.5, 2.0))
    assert same.p_value == pytest.approx(1.0)
    assert result.groups["load"].chi_square == pytest.approx(4.0)
    assert result.groups["load"].p_value == pytest.approx(stats.chi2.sf(4.0, 2))


def test_parameters_of_one_alone_are_named_and_none_in_common_is_refused() -> None:
    first = made([1.0, 2.0], [0.1, 0.1], np.inf)
    result = comparison_of(*of_loads(first, first.part([1], ["m_1"])))
    assert result.only == (("m_0",), ())
    assert [one.name for one in result.differences] == ["m_1"]
    with pytest.raises(IdentificationError, match="have no parameter in common: compare"):
        comparison_of(*of_loads(first.part([0], ["a"]), first.part([0], ["b"])))


def test_what_changed_is_significant_and_the_table_says_what_the_errors_assume() -> None:
    result = comparison_of(arm_found(), warm(), names=("cold", "warm"))
    (changed,) = [one for one in result.differences if one.is_significant]
    assert (changed.text, changed.joint) == ("viscous friction of shoulder", "shoulder")
    assert changed.relative_change == pytest.approx(-WARM, abs=4 * changed.error / changed.first)
    assert result.groups["shoulder"].p_value < 1e-6 < 1e-3 < result.groups["telescope"].p_value
    # A drive without named friction may have a term in one of both logs alone.
    cold, warmed = ({**found.drives, "": found.load} for found in (arm_found(), warm()))
    both = {(joint, x) for joint in cold for x in {*cold[joint].names} & {*warmed[joint].names}}
    assert {(one.joint, one.name) for one in result.differences} == both
    assert repr(result).startswith("Comparison(cold, warm: 1 of ")
    text = result.summary()
    (line,) = [x for x in text.splitlines() if " differs " in x]
    assert "viscous friction" in line
    assert line.endswith("N m s/rad")
    for words in (
        "assume independent estimates",
        "drive of shoulder as a whole: chi-square",
    ):
        assert words in text
