"""identify: both sides at once, possible bodies, files, executors, checks, cross-validation."""

from __future__ import annotations

import pickle
import re
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import IdentificationError, LogError
from seaid.estimation.estimate import Estimate
from seaid.identification import Method
from seaid.identification.identification import cross_validate, identify, validate
from seaid.identification.result import Identification
from seaid.log.long_log import open_long_log
from seaid.log.reading import Log, write_log
from seaid.robot.inertia import is_physical
from seaid.simulation.simulation import measure
from tests.experiments import (
    ARM_SENSORS,
    ELASTIC,
    LEG_SENSORS,
    TEST_MASS,
    arm,
    arm_motion,
    leg_motion,
)
from tests.experiments import leg as the_leg
from tests.representatives import quick_first

TRUTH = the_leg(TEST_MASS)
KNOWN = TRUTH.without_nominal()


@cache
def log(seed: int = 1) -> Log:
    return measure(TRUTH, leg_motion(TEST_MASS), LEG_SENSORS, seed)


@cache
def found(**options: Any) -> Identification:
    return identify(KNOWN, log(), encoder_offset_std=0.002, **{"method": "two-step", **options})


def assert_same(one: Estimate, other: Estimate, tolerance: float = 1e-9) -> None:
    assert one.names == other.names
    np.testing.assert_allclose(
        one.values, other.values, rtol=tolerance, atol=tolerance * one.standard_errors.min()
    )
    np.testing.assert_allclose(one.standard_errors, other.standard_errors, rtol=1e-6)


def truth_of(identified: Identification) -> Any:
    return identified.base.project(TRUTH.parameters)


@pytest.mark.slow  # several identifications of the leg
def test_both_sides_at_once_tell_the_springs_better() -> None:
    both = found(method="simultaneous")
    for joint in ELASTIC:
        true = TRUTH.drives[joint].stiffness  # type: ignore[union-attr]
        error = both.drives[joint].standard_error("stiffness")
        assert true is not None
        assert abs(both.drives[joint].value("stiffness") - true) < 3 * error
        assert error < found().drives[joint].standard_error("stiffness")
    z = (both.load.values - truth_of(both)) / both.load.standard_errors
    assert np.sqrt(np.mean(z**2)) < 1.5
    assert both.load.names == found().load.names
    assert tuple(both.checks) == ("both",)
    assert validate(both, log(2)).load.relative_error[2:].max() < 0.02


@pytest.mark.slow  # 1.5 s
def test_possible_bodies_are_possible_and_near_the_estimate() -> None:
    possible = found(feasible=True)
    bodies = possible.robot.parameters.reshape(-1, 10)
    assert all(is_physical(body, 0.0) for body in bodies)
    assert possible.feasible is not None
    assert possible.feasible.robot is possible.robot
    projected = possible.base.project(possible.robot.parameters)
    np.testing.assert_allclose(
        projected, possible.feasible.values[: len(projected)], rtol=1e-9, atol=1e-9
    )
    off = (projected - possible.load.values) / possible.load.standard_errors
    assert np.sqrt(np.mean(off**2)) < 2.0
    assert_same(possible.load, found().load)
    assert not all(is_physical(body) for body in found().robot.parameters.reshape(-1, 10))
    text = possible.summary()
    assert "physically consistent parameters: chi-square" in text
    assert "a ball of 1 kg replaces" in text


@pytest.mark.slow  # 1.8 s
@pytest.mark.parametrize("suffix", quick_first([".csv", ".npz"]))
def test_a_file_is_identified_as_the_log_in_memory(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log{suffix}"
    write_log(log(), path)
    whole = identify(KNOWN, str(path), encoder_offset_std=0.002)
    opened = open_long_log(path, KNOWN, cutoff_hz=found().cutoff_hz, chunk_samples=3000)
    pieces = identify(KNOWN, opened, encoder_offset_std=0.002)
    for one in (whole, pieces):
        assert one.cutoff_hz == found().cutoff_hz
        assert one.excluded == found().excluded
        assert_same(one.load, found().load, 1e-7)
        for joint in ELASTIC:
            assert_same(one.drives[joint], found().drives[joint], 1e-7)
        assert not one.checks["load"].whiteness  # its rows are not kept
        assert one.warnings == found().warnings


@pytest.mark.slow  # 0.6 s
def test_a_long_log_in_another_pass_band_is_opened_anew(tmp_path: Path) -> None:
    write_log(log(), tmp_path / "log.npz")
    opened = open_long_log(tmp_path / "log.npz", KNOWN, cutoff_hz=6.0)
    assert identify(KNOWN, opened, cutoff_hz=5.0).cutoff_hz == 5.0
    assert identify(KNOWN, opened).cutoff_hz == 6.0


@pytest.mark.slow  # 1.1 s
@pytest.mark.parametrize("executor", quick_first([ThreadPoolExecutor, ProcessPoolExecutor]))
def test_an_executor_works_on_the_logs(executor: type[Executor], tmp_path: Path) -> None:
    write_log(log(2), tmp_path / "second.npz")
    cutoff_hz = found().cutoff_hz
    in_turn = partial(identify, KNOWN, cutoff_hz=cutoff_hz, method="two-step")
    here = in_turn([log(), log(2)])
    with executor(2) as pool:  # type: ignore[call-arg]
        there = in_turn([log(), tmp_path / "second.npz"], executor=pool)
    assert_same(there.load, here.load)
    for joint in ELASTIC:
        assert_same(there.drives[joint], here.drives[joint])


def test_checks_say_that_each_term_is_worth_having() -> None:
    checks = found().checks
    assert set(checks) == {*ELASTIC, "load"}
    for joint in ELASTIC:
        assert {term.terms[0] for term in checks[joint].terms} == {
            "viscous_friction",
            "coulomb_friction",
        }
        assert all(term.bic > 0 for term in checks[joint].terms)
        assert set(checks[joint].whiteness) == {joint}
    assert len(checks["load"].terms) == 4
    assert set(checks["load"].whiteness) == set(KNOWN.joint_names)
    text = found().summary()
    assert "Terms of the drives: support by the data" in text
    assert "coulomb_friction of knee_pitch" in text
    assert re.search(rf"load side +{checks['load'].condition_number:.3g} ", text)


def test_a_term_that_is_not_there_is_not_worth_having() -> None:
    robot = arm()
    known = robot.without_nominal()
    joint = known.elastic_joints[0]
    more = replace(known.drives[joint], extra_terms=("c*theta_M_dot**3",))
    known = known.with_values(known.parameters, {**known.drives, joint: more})
    identified = identify(known, measure(robot, arm_motion(), ARM_SENSORS, 3), method="two-step")
    tests = {term.terms[0]: term for term in identified.checks[joint].terms}
    assert tests["c"].bic < 0 < tests["viscous_friction"].bic


@pytest.mark.slow  # several identifications of the leg
def test_cross_validation_over_parts_and_logs() -> None:
    parts = cross_validate(KNOWN, log(), parts=2)
    assert len(parts) == 2
    assert all(one.load.relative_error[2:].max() < 0.1 for one in parts)
    logs = cross_validate(KNOWN, [log(), log(2)])
    assert len(logs) == 2
    assert max(one.load.relative_error[2:].max() for one in logs) < 0.03
    for bad, words in ((1, "at least 2, found 1"), (2.5, "whole number")):
        with pytest.raises(IdentificationError, match=words):
            cross_validate(KNOWN, log(), parts=bad)  # type: ignore[arg-type]
    with pytest.raises(LogError, match="too short"):
        cross_validate(KNOWN, log(), parts=12)


def test_an_identification_can_be_sent_to_a_process() -> None:
    again = pickle.loads(pickle.dumps(found(feasible=True)))
    assert again.load.names == found().load.names


@pytest.mark.parametrize(
    ("logs", "words"),
    [
        ([], "identify needs a log, found none"),
        ([3.0], "logs= must be a Log, a LongLog, a path or a list of these, found a list with 3.0"),
    ],
)
def test_what_is_no_log(logs: Any, words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        identify(KNOWN, logs)


@pytest.mark.parametrize(
    ("field", "joint", "words"),
    [
        ("joint_position", "knee_pitch", "joint position of 'knee_pitch' is 0.4 all the time"),
        ("joint_position", "hip_roll", "joint position of 'hip_roll' is 0.4 all the time"),
        ("motor_torque", "knee_pitch", "motor torque of 'knee_pitch' is 0.4 all the time"),
        ("motor_torque", "hip_yaw", "motor torque of 'hip_yaw' is 0.4 all the time"),
        ("motor_position", "hip_yaw", "motor position of 'hip_yaw' is 0.4 all the time"),
    ],
)
@pytest.mark.parametrize("method", ["two-step", "simultaneous"])
def test_a_dead_channel_is_named(field: str, joint: str, words: str, method: Method) -> None:
    values = getattr(log(), field).copy()
    values[:, KNOWN.index(joint)] = 0.4
    with pytest.raises(LogError, match=f"{words}, while its .* moves: a dead channel"):
        identify(KNOWN, replace(log(), **{field: values}), method=method)


@pytest.mark.parametrize("std", [-0.1, float("nan"), float("inf"), 1e200])
def test_a_standard_deviation_of_zeros_that_is_none_is_refused(std: float) -> None:
    with pytest.raises(
        IdentificationError, match="encoder_offset_std must be from 0 to 1000 rad or m"
    ):
        identify(KNOWN, log(), encoder_offset_std=std)
