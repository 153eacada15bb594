"""Torque offsets of drives on springs, which the load side tells from spring offsets."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from seaid.estimation.qr_factor import qr_factor_of
from seaid.identification.identification import identify, validate
from seaid.identification.problem import Method
from seaid.identification.result import Identification
from seaid.identification.stacked_fits import TORQUE_OFFSET, identifiable_offsets
from seaid.log.log import Log
from seaid.regressor.regression import Regression
from seaid.simulation.simulation import measure
from tests.experiments import ELASTIC, LEG_SENSORS, TEST_MASS, leg, leg_motion
from tests.representatives import quick_first

OFFSETS = {"hip_pitch": 2e-3, "knee_pitch": -2e-3, "ankle_pitch": 5e-4}


@cache
def log(with_offsets: bool) -> Log:
    truth = leg(TEST_MASS)
    plain = measure(truth, leg_motion(TEST_MASS), LEG_SENSORS, 3)
    offsets = [OFFSETS.get(joint, 0.0) * with_offsets for joint in plain.joint_names]
    return replace(plain, motor_torque=plain.motor_torque + offsets)


@cache
def found(with_offsets: bool, method: Method = "two-step") -> Identification:
    known = leg(TEST_MASS).without_nominal()
    return identify(known, log(with_offsets), cutoff_hz=4.0, method=method)


@pytest.mark.parametrize("method", quick_first(["two-step", "simultaneous"]))
def test_an_offset_moves_nothing_but_itself(method: Method) -> None:
    """The equations are linear: the constant is in one column, whatever the data are."""
    plain, off = found(False, method), found(True, method)
    assert off.load.values == pytest.approx(plain.load.values, rel=1e-3, abs=1e-4)
    for joint, offset in OFFSETS.items():
        before, after = plain.drives[joint], off.drives[joint]
        assert after.value(TORQUE_OFFSET) - before.value(TORQUE_OFFSET) == pytest.approx(
            offset, rel=1e-3
        )
        for name in ("stiffness", "viscous_friction", "coulomb_friction", "spring_offset"):
            change = after.value(name) - before.value(name)
            assert abs(change) < 1e-2 * before.standard_error(name)
        error = before.value(TORQUE_OFFSET) / before.standard_error(TORQUE_OFFSET)
        assert abs(error) < 3.0  # no offset in truth


@pytest.mark.slow  # 1 s
def test_a_large_offset_is_a_finding_and_none_is_not() -> None:
    codes = [(one.code, one.joint) for one in found(True).warnings]
    assert ("torque-offset", "knee_pitch") in codes
    assert "torque-offset" not in {one.code for one in found(False).warnings}
    finding = next(one for one in found(True).warnings if one.joint == "knee_pitch")
    assert finding.evidence["offset_Nm"] == pytest.approx(-2e-3, rel=0.3)


def test_the_motor_side_is_predicted_with_its_offset() -> None:
    with_offset = validate(found(True), log(True)).actuator.rms_error
    without = validate(found(False), log(False)).actuator.rms_error
    elastic = [leg().index(joint) for joint in ELASTIC]
    assert with_offset[elastic] == pytest.approx(without[elastic], rel=1e-2)


def test_a_constant_that_gravity_explains_is_not_identifiable() -> None:
    angle = np.random.default_rng(0).normal(size=400)
    for reach, expected in ((1.0, ("a",)), (0.05, ())):
        columns = np.column_stack([np.cos(reach * angle), np.ones(400)])
        zeros = np.zeros(400)
        rows = Regression(
            ("gravity", "offset"), ("", ""), columns, angle, zeros, zeros, zeros, 0, columns[:, :0]
        )
        assert identifiable_offsets(qr_factor_of(rows), ["a"]) == expected
