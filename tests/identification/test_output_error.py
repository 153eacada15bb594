"""refine: the maximum-likelihood estimate by output error, on known truth."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array, FrozenMapping
from seaid.drives import Drive
from seaid.drives.drives import DefaultTerms
from seaid.errors import Finding, IdentificationError, LogError
from seaid.estimation import Estimate
from seaid.identification import Identification, identify, motor_driven, output_error, refine
from seaid.identification.motor_driven import MotorDriven, Run, _near_reversals, runs_of
from seaid.identification.refined_parameters import Layout, LogPoint, layout_of
from seaid.legged import load_robot
from seaid.log import Log, Motion
from seaid.robot import Payload, Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure, simulate_motion
from tests.experiments import (
    DATA,
    all_scores,
    drive_errors,
    load_scores,
    perfect_log,
    wiggle,
    with_named_friction,
)
from tests.mistakes import unlogged
from tests.representatives import quick_first
from tests.standard_errors import check_scores
from tests.terms import ELASTIC, STIFF, Case, arm, exact_motion, friction, spring, with_terms

DRIVE = ("stiffness", "viscous_friction", "coulomb_friction")
REACH = {"rail": (0.0, 0.4), "shoulder": (0.3, 0.8), "telescope": (0.15, 0.2), "wrist": (0.0, 0.9)}
SENSORS = Noise(
    motor_resolution_rad=2 * np.pi / 2000,
    joint_resolution_rad=(2 * np.pi / 2**14, 2e-5),
    motor_offset_rad=(1.0, -2.0),
    torque_std_Nm=0.003,
)


@cache
def robot(*joints: str, load: float = 0.0) -> Robot:
    """Return some joints of the mixed arm, the others locked, with a load on the tool."""
    payloads = [Payload("tool", load, (0.05, 0.0, 0.0))] if load else []
    return load_robot(
        DATA / "mixed_arm.urdf", DATA / "mixed_arm.toml", joints=joints, payloads=payloads
    )


SPRINGS = robot("shoulder", "telescope")


@cache
def motion(truth: Robot = SPRINGS, seed: int = 1) -> Motion:
    """Return four seconds of true motion at 500 Hz."""
    middle, reach = zip(*(REACH[joint] for joint in truth.joint_names), strict=True)
    return simulate_motion(truth, wiggle(truth, 4.0, middle, reach, seed=seed), rate_hz=500.0)


@cache
def log(truth: Robot = SPRINGS) -> Log:
    return perfect_log(truth, motion(truth))


@cache
def found(truth: Robot = SPRINGS) -> Identification:
    # stiff joints keep the low pass of identify, which shortens peaks: wide for perfect sensors
    cutoff_hz = None if len(truth.elastic_joints) == truth.n else 12.0
    return identify(truth.without_nominal(), log(truth), cutoff_hz=cutoff_hz)


@cache
def refined(truth: Robot = SPRINGS) -> Identification:
    return refine(found(truth), log(truth))


def base_error(one: Identification, truth: Robot) -> float:
    true = one.base.project(truth.parameters)
    return float(np.linalg.norm(one.load.values - true) / np.linalg.norm(true))


def perturbed(one: Identification, size: float, seed: int = 0) -> Identification:
    """Return an identification with every value wrong by up to `size` of itself."""
    rng = np.random.default_rng(seed)

    def wrong(estimate: Estimate) -> Estimate:
        factor = 1 + size * rng.uniform(-1, 1, len(estimate.values))
        return replace(estimate, values=estimate.values * factor)

    drives = {joint: wrong(estimate) for joint, estimate in one.drives.items()}
    return replace(one, drive_side=FrozenMapping(drives), load_side=wrong(one.load_side))


def assert_same(one: Identification, other: Identification, rel: float) -> None:
    pairs = [(one.load_side, other.load_side)]
    pairs += [(estimate, other.drives[joint]) for joint, estimate in one.drives.items()]
    for first, second in pairs:
        assert second.values == pytest.approx(first.values, rel=rel, abs=rel)


def added(one: Identification, start: Identification) -> list[Finding]:
    """Return the findings that the refinement adds to those of its start."""
    codes = {(finding.code, finding.joint) for finding in start.warnings}
    return [finding for finding in one.warnings if (finding.code, finding.joint) not in codes]


# Without noise: the truth.


TRUTHS = SPRINGS, robot("telescope", "shoulder", load=0.8), robot("rail", "shoulder")


@pytest.mark.parametrize(
    "truth", quick_first(TRUTHS), ids=["springs", "reordered with payload", "mixed"]
)
def test_perfect_sensors_lead_to_the_truth(truth: Robot) -> None:
    one = refined(truth)
    errors = drive_errors(one, truth, *DRIVE)
    assert max(map(abs, errors.values())) < 2e-3
    assert base_error(one, truth) < 2e-4
    assert added(one, found(truth)) == []


@pytest.mark.slow  # a refinement of two joints, simulated several times
def test_wrong_start_comes_back() -> None:
    noisy = measure(SPRINGS, motion(), SENSORS, seed=1)
    one = refine(identify(SPRINGS.without_nominal(), noisy), noisy)
    other = refine(perturbed(one, 0.2), noisy)
    pairs = [(one.load, other.load), *((x, other.drives[j]) for j, x in one.drives.items())]
    for first, second in pairs:
        assert np.all(np.abs(second.values - first.values) < 1e-3 * first.standard_errors)


@pytest.mark.slow  # a refinement of two joints, simulated several times
def test_spring_torque_of_a_sensor_leaves_nothing_to_simulate() -> None:
    sensed = replace(log(), joint_torque=motion().joint_torque)
    start = identify(SPRINGS.without_nominal(), sensed)
    assert not start.springs
    one = refine(start, sensed)
    assert_same(start, one, rel=0.0)
    assert [finding.code for finding in added(one, start)] == ["nothing-to-simulate"]
    zeros = refine(start, sensed, encoder_offset_std=1e-3)
    assert base_error(zeros, SPRINGS) < 1e-3


@pytest.mark.slow  # a refinement of two joints, simulated several times
def test_start_that_predicts_better_is_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    def spoiled(start: LogPoint, *_: object) -> tuple[LogPoint, bool]:
        x = start.x.copy()
        x[start.logs[0].layout.load] *= 0.7
        end = replace(start, x=x)
        end.__dict__["step"] = replace(start.step, change=np.zeros_like(x))
        return end, False

    noisy = measure(SPRINGS, motion(), SENSORS, 0)
    start = identify(SPRINGS.without_nominal(), noisy)
    monkeypatch.setattr(output_error, "gauss_newton_search", spoiled)
    one = refine(start, noisy)
    assert_same(start, one, rel=0.0)
    (finding,) = [warning for warning in one.warnings if warning.code == "worse-than-start"]
    assert finding.message.startswith("refine returns the values of its start, because the error")
    assert finding.evidence["error after"] > 1.5 * finding.evidence["error before"]


@pytest.mark.parametrize(
    ("zero_std", "unseen"),
    quick_first([(0.002, ("shoulder",)), (0.0, ()), (0.002, ()), (0.0, ("shoulder",))]),
)
def test_sensitivities_are_those_of_differences(zero_std: float, unseen: tuple[str, ...]) -> None:
    """Where no encoder is behind the spring, the torque of the stiff rail follows the joint."""
    truth = robot("rail", "shoulder")
    layout = layout_of(found(truth), zero_std, unseen)
    (first,) = runs_of(layout, log(truth).between(0.0, 1.5))
    run = settled(layout, first, layout.start)
    here = MotorDriven(layout, layout.start, run).residuals
    assert here.channels == range(3 if unseen else 2)
    scale = np.maximum(np.abs(layout.start[: layout.zeros.start]), 1e-3)
    scale = np.append(scale, np.full(len(layout.start) - len(scale), 0.1))
    for column, size in enumerate(1e-4 * scale):
        change = np.zeros(len(layout.start))
        change[column] = size
        x = layout.start + change
        moved = settled(layout, shifted(layout, run, change), x)
        there = MotorDriven(layout, x, moved).residuals
        difference = (there.residual - here.residual) / size
        expected = here.jacobian[..., column]
        for channel in range(expected.shape[2]):
            largest = np.max(np.abs(expected[..., channel]))
            gap = np.max(np.abs(difference - expected)[..., channel])
            assert gap <= 5e-3 * largest + 1e-12 / size


def test_samples_over_a_gap_are_not_residuals() -> None:
    """Positions and torques that a spline put there once counted as measured."""
    whole = log()
    kept = (whole.time < 2.0) | (whole.time > 2.05)
    layout = layout_of(found(), 0.0)
    (run,) = runs_of(layout, whole.at(kept))
    residuals = MotorDriven(layout, layout.start, run).residuals
    half = 0.5 * run.block / run.motion.rate_hz
    over = (residuals.time > 2.0 - half) & (residuals.time < 2.05 + half)
    assert np.any(over)
    assert not np.any(residuals.kept[over])
    (run,) = runs_of(layout, whole)
    assert np.all(MotorDriven(layout, layout.start, run).residuals.kept[..., :2])


def shifted(layout: Layout, run: Run, change: Array) -> Run:
    """Return a run with the joints without a spring where a change of encoder zeros puts them."""
    position = run.motion.joint_position.copy()
    if change[layout.zeros].size:
        position[:, 0] -= change[layout.zeros][0]
    return replace(run, motion=replace(run.motion, joint_position=position))


def settled(layout: Layout, run: Run, x: Array) -> Run:
    """Return a run whose simulated joint obeys (8), from the same initial states."""
    for _ in range(3):
        states = np.zeros((run.windows, 2 * len(layout.simulated)))
        run = MotorDriven(layout, x, run).moved(x, 1.0, states).run
    return run


@pytest.mark.slow  # a refinement of two joints, simulated several times
def test_memory_is_that_of_a_part_of_the_log(monkeypatch: pytest.MonkeyPatch) -> None:
    """The result does not depend on the size of the parts."""
    one = refine(found(), log())
    monkeypatch.setattr(motor_driven, "_MOST_ENTRIES", 1)
    layout = layout_of(found(), 0.0)
    runs = runs_of(layout, log())
    assert [run.windows for run in runs] == [1] * len(runs)
    assert len(runs) > 1
    assert_same(one, refine(found(), log()), rel=1e-6)


@pytest.mark.slow  # a refinement of two joints, simulated several times
def test_uncertain_encoder_offsets_of_stiff_joints_converge() -> None:
    truth = robot("rail", "shoulder")
    one = measure(truth, motion(truth), replace(SENSORS, joint_offset_rad=(2e-3, -2e-3)), 2)
    start = identify(truth.without_nominal(), one, encoder_offset_std=2e-3)
    refined = refine(start, one, encoder_offset_std=2e-3)
    assert np.max(np.abs(load_scores(refined, truth))) < 4


@pytest.mark.slow  # a refinement of two joints, simulated several times
def test_joint_zeros_are_estimated_where_they_are_uncertain() -> None:
    sensors = Noise(joint_offset_rad=(0.01, 0.0), torque_std_Nm=0.002)
    shifted_log = measure(SPRINGS, motion(), sensors)
    start = identify(SPRINGS.without_nominal(), shifted_log)
    trusting, doubting = (refine(start, shifted_log, encoder_offset_std=std) for std in (0.0, 0.01))
    assert base_error(doubting, SPRINGS) < 0.5 * base_error(trusting, SPRINGS)
    assert np.max(np.abs(load_scores(doubting, SPRINGS))) < 4


def heavy() -> Identification:
    """Return an identification whose bodies are as heavy as none."""
    side = found().load_side
    return replace(found(), load_side=replace(side, values=np.full_like(side.values, 1e200)))


def with_shoulder(value: float, name: str = "stiffness") -> Identification:
    """Return an identification whose shoulder has another value."""
    shoulder = found().drives["shoulder"]
    values = np.where(np.array(shoulder.names) == name, value, shoulder.values)
    drives = {**found().drives, "shoulder": replace(shoulder, values=values)}
    return replace(found(), drive_side=FrozenMapping(drives))


HYSTERETIC = spring("dahl", hysteresis_force=1.0, hysteresis_deflection=4e-3)


@pytest.mark.parametrize(
    ("start", "logs", "options", "words"),
    [
        (found, lambda: [], {}, "refine needs a log, found none"),
        (found, log, {"encoder_offset_std": -0.1}, r"from 0 to 1000 rad or m, found -0\.1"),
        (
            lambda: perturbed(refined(), 0.2),
            log,
            {"iterations": 0},
            "did not converge in 0 iterations: its next st",
        ),
        (lambda: with_shoulder(-1.0), log, {}, "stiffness of shoulder is -1"),
        (heavy, log, {}, "diverges at this estimate: check"),
        (
            found,
            lambda: replace(unlogged(log(), "motor_torque"), joint_torque=motion().joint_torque),
            {},
            "same torque sensors needed",
        ),
        (found, lambda: log(robot("rail", "shoulder")), {}, "the log has no joint telescope"),
        (
            lambda: replace(found(), known=with_drive(found().known, "shoulder", *HYSTERETIC)),
            log,
            {},
            "drive of shoulder, whose spring has hysteresis",
        ),
    ],
)
def test_what_cannot_be_refined_is_said(
    start: Callable[[], Identification], logs: Callable[[], Any], options: Any, words: str
) -> None:
    """The error names the option, the joint or the sensor."""
    with pytest.raises((IdentificationError, LogError), match=words):
        refine(start(), logs(), **options)


@pytest.mark.parametrize(
    ("friction", "is_excluded"),
    [
        (("stribeck",), True),
        (("load",), True),
        (("coulomb",), True),
        (("smooth_coulomb",), False),
        (DefaultTerms(("smooth_coulomb",)), True),  # `identify` selected the width
    ],
)
def test_rows_where_dry_friction_turns_back_are_excluded(
    tmp_path: Path, friction: tuple[str, ...], is_excluded: bool
) -> None:
    moved = exact_motion(arm(tmp_path, STIFF, ELASTIC))
    other = arm(tmp_path, STIFF, replace(ELASTIC, friction=friction, nominal={}))
    assert np.any(_near_reversals(other, moved, "two")) == is_excluded


# refine: drives with springs and friction beyond the plain ones, on known truth.


CASES: dict[str, Case] = {
    "plain": ({}, {}),
    "cubic": spring("cubic", cubic_stiffness=5e4, deflection_zero=0.01),
    "damping": spring("damping", spring_damping=1.25),
    "dead zone": spring("dead_zone", dead_zone=5e-3, deflection_zero=0.0),
    "smooth": friction("smooth_coulomb", coulomb_width=3.0),
    "stribeck": friction("coulomb", "stribeck", stribeck_friction=0.012, stribeck_speed=20.0),
    "presliding": friction("dahl", presliding_angle=0.4),
    "load": friction("coulomb", "load", load_friction=0.1),
    "beside": (
        {"joint_friction": ("viscous",), "parallel_spring": ("linear", "preload")},
        {"joint_viscous_friction": 0.3, "parallel_stiffness": 5.0, "parallel_preload": 1.0},
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
def with_terms_of(case: str) -> Robot:
    """Return two joints with springs, the shoulder with the terms of the case."""
    return with_drive(SPRINGS, "shoulder", *CASES[case])


def measured(truth: Robot, seed: int) -> Log:
    """Return the log of another motion with the noise of a seed."""
    return measure(truth, motion(truth, seed + 10), ENCODERS, seed)


def errors(found: Identification, truth: Robot, joint: str) -> dict[str, float]:
    """Return the relative errors of a drive's parameters that are not zero."""
    values, estimate = truth.drives[joint].values, found.drives[joint]
    return {
        name: abs(estimate.value(name) / values[name] - 1)
        for name in estimate.names
        if values.get(name)
    }


@pytest.mark.slow  # a refinement of a joint with other terms
@pytest.mark.parametrize("case", CASES)
@pytest.mark.usefixtures("estimates_only")
def test_a_term_of_any_drive_is_refined_to_the_truth(case: str) -> None:
    truth = with_terms_of(case)
    refined = refine(identify(truth.without_nominal(), log(truth)), log(truth))
    far = errors(refined, truth, "shoulder")
    assert {name for name, value in CASES[case][1].items() if value} <= far.keys()
    # block averages of motions near a reversal: see the widths of friction
    assert far.pop("stiffness") < 2e-4
    assert max(far.values()) < 3e-2
    assert base_error(refined, truth) < 2e-4


@pytest.mark.slow  # 66 refinements
@pytest.mark.usefixtures("estimates_only")
def test_errors_are_as_large_as_the_standard_errors_say() -> None:
    """Six draws of noise on one of two motions, which show all parameters.

    The loads cross the dead zone, and no joint rests. On other motions, as that of seed 11, the
    search of a width of friction may end in a minimum far from the truth.
    """
    draws = []
    for number, case in enumerate(CASES):
        truth = with_terms_of(case)
        moved = motion(truth, (10, 12)[number % 2])
        known = with_named_friction(truth.without_nominal())
        for draw in range(6):
            noisy_log = measure(truth, moved, ENCODERS, seed=6 * number + draw)
            draws.append(all_scores(refine(identify(known, noisy_log), noisy_log), truth))
    check_scores(draws, band=1.2)


@pytest.mark.slow  # a refinement of a joint with other terms
def test_a_dead_zone_that_the_load_does_not_cross_is_a_doubt() -> None:
    """The load of seed 3 stays on one side: only the sum of centre and half width is right.

    Which of the two is held at the value of the search is a matter of rounding.
    """
    truth = with_terms_of("dead zone")
    found = identify(truth.without_nominal(), measured(truth, 3))
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
    crossed = identify(truth.without_nominal(), measured(truth, 0))
    assert [one for one in crossed.warnings if one.code == "unidentifiable"] == []


@pytest.mark.slow  # a refinement of a joint with other terms
@pytest.mark.usefixtures("estimates_only")
def test_a_stiff_joint_with_a_width_of_friction_is_linearised_again() -> None:
    truth = with_drive(
        robot("rail", "shoulder"),
        "rail",
        {"friction": ("viscous", "smooth_coulomb")},
        {"coulomb_width": 3.0},
    )
    refined = refine(found(truth), log(truth))
    width = refined.known.drives["rail"].values["coulomb_width"]
    assert width == refined.drives["rail"].value("coulomb_width")
    assert max(errors(refined, truth, "rail").values()) < 2e-2
    assert max(errors(refined, truth, "shoulder").values()) < 2e-3


@pytest.mark.slow  # a refinement of a joint with other terms
@pytest.mark.usefixtures("estimates_only")
def test_errors_of_the_gear_are_refined() -> None:
    wrong = {"motor_1_cos": 1e-3, "motor_1_sin": 5e-4, "joint_3_cos": 0.0, "joint_3_sin": 2e-3}
    amplitudes = {f"transmission_error_{name}": value for name, value in wrong.items()}
    nominal = {**SPRINGS.drives["shoulder"].nominal, **amplitudes}
    orders = {"motor": [1], "joint": [3]}
    truth = with_drive(SPRINGS, "shoulder", {"transmission_error": orders, "nominal": nominal}, {})
    refined = refine(identify(truth.without_nominal(), log(truth)), log(truth)).drives["shoulder"]
    for name, amplitude in amplitudes.items():
        assert refined.value(name) == pytest.approx(amplitude, abs=2e-6)
