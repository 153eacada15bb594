"""refine: drives with springs and friction beyond the plain ones, on known truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives.drives import Drive
from seaid.identification.identification import identify
from seaid.identification.output_error import refine
from seaid.identification.result import Identification
from seaid.log.motion import Motion
from seaid.log.reading import Log
from seaid.robot.robot import Robot
from seaid.simulation.simulation import measure, simulate_motion
from tests.experiments import perfect_log, wiggle, with_named_friction
from tests.identification.test_output_error import REACH, SENSORS, SPRINGS
from tests.identification.test_output_error import robot as arm
from tests.standard_errors import check_scores
from tests.terms import with_terms

Case = tuple[Mapping[str, tuple[str, ...]], Mapping[str, float]]

CASES: dict[str, Case] = {
    "cubic": ({"spring": ("linear", "cubic")}, {"cubic_stiffness": 5e4, "deflection_zero": 0.01}),
    "damping": ({"spring": ("linear", "damping")}, {"spring_damping": 1.25}),
    "dead zone": ({"spring": ("linear", "dead_zone")}, {"dead_zone": 5e-3, "deflection_zero": 0.0}),
    "smooth": ({"friction": ("viscous", "smooth_coulomb")}, {"coulomb_width": 3.0}),
    "stribeck": (
        {"friction": ("viscous", "coulomb", "stribeck")},
        {"stribeck_friction": 0.012, "stribeck_speed": 20.0},
    ),
    "presliding": ({"friction": ("viscous", "dahl")}, {"presliding_angle": 0.4}),
    "load": ({"friction": ("viscous", "coulomb", "load")}, {"load_friction": 0.1}),
    "beside": (
        {"joint_friction": ("viscous",), "parallel_spring": ("linear", "preload")},
        {"joint_viscous_friction": 0.3, "parallel_stiffness": 5.0, "parallel_preload": 1.0},
    ),
    "spring, dahl": (
        {"spring": ("linear", "dahl")},
        {"hysteresis_force": 1.0, "hysteresis_deflection": 4e-3},
    ),
    "dry joint": ({"joint_friction": ("coulomb",)}, {"joint_coulomb_friction": 0.3}),
}
"""{case: terms of the shoulder's drive, and the values that they bring}."""

ENCODERS = replace(SENSORS, motor_offset_rad=0.0)
"""The sensors without offsets of the motor encoders, which the springs' zeros would absorb."""


def with_drive(truth: Robot, joint: str, terms: Mapping[str, object], values: object) -> Robot:
    drive: Drive = with_terms(truth.drives[joint], terms, values)  # type: ignore[arg-type]
    return truth.with_drives({joint: drive})


@cache
def robot(case: str) -> Robot:
    """Return two joints with springs, the shoulder with the terms of the case."""
    return with_drive(SPRINGS, "shoulder", *CASES[case])


def motion_of(truth: Robot, seed: int) -> Motion:
    """Return the motion of four seconds of a seed."""
    middle, reach = zip(*(REACH[joint] for joint in truth.joint_names), strict=True)
    plan = wiggle(truth, 4.0, middle, reach, seed=seed)
    return simulate_motion(truth, plan, rate_hz=500.0)


def log_of(truth: Robot, seed: int | None) -> Log:
    """Return the log of a motion and the noise of a seed; None: without noise."""
    if seed is None:
        return perfect_log(truth, motion_of(truth, 1))
    return measure(truth, motion_of(truth, seed + 10), ENCODERS, seed)


def scores(found: Identification, truth: Robot) -> Array:
    """Return all errors over their standard errors."""
    load = found.load.values - found.base.project(truth.parameters)
    parts = [load / found.load.standard_errors]
    for joint, estimate in found.drives.items():
        values = truth.drives[joint].values
        wanted = np.array([values.get(name, 0.0) for name in estimate.names])
        parts.append((estimate.values - wanted) / estimate.standard_errors)
    return np.concatenate(parts)


def errors(found: Identification, truth: Robot, joint: str) -> dict[str, float]:
    """Return the relative errors of a drive's parameters that are not zero."""
    values, estimate = truth.drives[joint].values, found.drives[joint]
    return {
        name: abs(estimate.value(name) / values[name] - 1)
        for name in estimate.names
        if values.get(name)
    }


QUICK = ("cubic", "beside")


@pytest.mark.slow  # a refinement of a joint with other terms
@pytest.mark.parametrize(
    "case",
    [case if case in QUICK else pytest.param(case, marks=pytest.mark.slow) for case in CASES],
)
@pytest.mark.usefixtures("estimates_only")
def test_perfect_sensors_lead_to_the_truth(case: str) -> None:
    truth = robot(case)
    log = log_of(truth, None)
    refined = refine(identify(truth.without_nominal(), log), log)
    far = errors(refined, truth, "shoulder")
    assert {name for name, value in CASES[case][1].items() if value} <= far.keys()
    # block averages of motions near a reversal: see the widths of friction
    assert far.pop("stiffness") < 2e-4
    assert max(far.values()) < 3e-2
    true = refined.base.project(truth.parameters)
    assert np.linalg.norm(refined.load.values - true) < 2e-4 * np.linalg.norm(true)


@pytest.mark.slow  # 60 refinements
@pytest.mark.usefixtures("estimates_only")
def test_errors_are_as_large_as_the_standard_errors_say() -> None:
    """Three draws of noise on each of two motions, which show all parameters.

    The loads cross the dead zone, and no joint rests. On other motions, as that of seed 11, the
    search of a width of friction may end in a minimum far from the truth.
    """
    draws = []
    for number, case in enumerate(CASES):
        truth = robot(case)
        motions = [motion_of(truth, seed) for seed in (10, 12)]
        known = with_named_friction(truth.without_nominal())
        for draw, motion in enumerate(3 * motions):
            log = measure(truth, motion, ENCODERS, seed=6 * number + draw)
            draws.append(scores(refine(identify(known, log), log), truth))
    check_scores(draws, band=1.2)


@pytest.mark.slow  # a refinement of a joint with other terms
def test_a_dead_zone_that_the_load_does_not_cross_is_a_doubt() -> None:
    """The load of seed 3 stays on one side: only the sum of centre and half width is right.

    Which of the two is held at the value of the search is a matter of rounding.
    """
    truth = robot("dead zone")
    found = identify(truth.without_nominal(), log_of(truth, 3))
    values = found.known.drives["shoulder"].values
    true = truth.drives["shoulder"].values
    assert abs(values["dead_zone"] - true["dead_zone"]) > 1e-3
    shoulder = found.drives["shoulder"]
    (free,) = {"dead_zone", "deflection_zero"} & {*shoulder.names}
    (held,) = {"dead_zone", "deflection_zero"} - {free}
    value, error = (of(free) for of in (shoulder.value, shoulder.standard_error))
    assert abs(value) > 10 * error
    assert values[held] + value == pytest.approx(true["dead_zone"], abs=4 * error)
    (doubt,) = [one for one in found.warnings if one.code == "unidentifiable"]
    assert (doubt.joint, doubt.severity) == ("shoulder", "doubtful")
    assert "load the spring in both directions" in doubt.remedy
    assert "unidentifiable (shoulder)" in found.verdict.sentence
    crossed = identify(truth.without_nominal(), log_of(truth, 0))
    assert [one for one in crossed.warnings if one.code == "unidentifiable"] == []


@pytest.mark.slow  # a refinement of a joint with other terms
@pytest.mark.usefixtures("estimates_only")
def test_a_stiff_joint_with_a_width_of_friction_is_linearised_again() -> None:
    truth = with_drive(
        arm("rail", "shoulder"),
        "rail",
        {"friction": ("viscous", "smooth_coulomb")},
        {"coulomb_width": 3.0},
    )
    log = log_of(truth, None)
    found = identify(truth.without_nominal(), log, cutoff_hz=12.0)
    refined = refine(found, log)
    width = refined.known.drives["rail"].values["coulomb_width"]
    assert width == refined.drives["rail"].value("coulomb_width")
    assert max(errors(refined, truth, "rail").values()) < 2e-2
    assert max(errors(refined, truth, "shoulder").values()) < 2e-3


@pytest.mark.slow  # a refinement of a joint with other terms
@pytest.mark.usefixtures("estimates_only")
def test_errors_of_the_gear_are_refined() -> None:
    wrong = {"motor": {1: (1e-3, 5e-4)}, "joint": {3: (0.0, 2e-3)}}
    truth = with_drive(SPRINGS, "shoulder", {"transmission_error": wrong}, {})
    log = log_of(truth, None)
    refined = refine(identify(truth.without_nominal(), log), log).drives["shoulder"]
    for place, names in wrong.items():
        for order, amplitudes in names.items():
            for kind, amplitude in zip(("cos", "sin"), amplitudes, strict=True):
                name = f"transmission_error_{place}_{order}_{kind}"
                assert refined.value(name) == pytest.approx(amplitude, abs=2e-6)


@pytest.mark.slow  # a refinement of a joint with other terms
def test_a_speed_without_its_friction_is_fixed() -> None:
    truth = with_drive(SPRINGS, "shoulder", *CASES["stribeck"])
    plain = log_of(SPRINGS, 0)
    refined = refine(identify(truth.without_nominal(), plain), plain)
    codes = [one.code for one in refined.warnings if one.joint == "shoulder"]
    assert {"unidentifiable", "poorly-identified"} & {*codes}
    assert np.isfinite(refined.drives["shoulder"].standard_errors).all()
