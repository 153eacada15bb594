"""Springs and loads from motor angle and motor torque alone, on plants integrated by others."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from scripts.benchmarks.motor_side import (
    ANYDRIVE,
    Joint,
    errors,
    random_joint,
    robot_of,
    simulated,
    simulated_together,
)
from seaid.checks.predictions import motor_side_findings, noisy_springs
from seaid.checks.setup import OF_LOGS, log_findings
from seaid.errors import Finding, IdentificationError, LogError
from seaid.identification import Identification, identify, refine
from seaid.identification.unseen_springs import (
    joints_sensed_by_motor_only,
    with_angles,
    with_motor_side_findings,
    with_rigid_angles,
)
from seaid.log import Log, reconstruct_motion
from seaid.robot import Robot
from tests.experiments import with_drive
from tests.mistakes import unlogged
from tests.plants import kept, log_with
from tests.standard_errors import scores

HEAVIER = replace(ANYDRIVE, mass=1.5 * ANYDRIVE.mass, k=0.5 * ANYDRIVE.k)
DAMPED = replace(ANYDRIVE, damping=0.04 * float(np.sqrt(ANYDRIVE.k * ANYDRIVE.load)))
"""A spring with a damping ratio of 2 % at the antiresonance."""
PERFECT = replace(DAMPED, counts=10**9, torque_std=1e-9)
WIDE = replace(ANYDRIVE, highest_hz=2 * ANYDRIVE.antiresonance_hz)
THREE = replace(WIDE, link_k=9 * WIDE.k * WIDE.share)
"""The same with an elastic link, whose resonance is three times the antiresonance of the joint."""
ONCE_WRONG = (4, 5, 6)


OF_QUICK_TESTS = ((ANYDRIVE, 0), (ANYDRIVE, 1), (HEAVIER, 1))


@kept
def together(of_quick_tests: bool) -> dict[tuple[Joint, int], Log]:
    """Return the logs of the quick tests, or of most others, which are integrated at once."""
    cases = [(DAMPED, 0), (PERFECT, 0), (WIDE, 0), (THREE, 0)]
    cases += [(random_joint(number), number) for number in ONCE_WRONG]
    cases = [*OF_QUICK_TESTS] if of_quick_tests else cases
    joints, seeds = zip(*cases, strict=True)
    return dict(zip(cases, simulated_together(joints, seeds), strict=True))


def log_of(joint: Joint, seed: int = 0) -> Log:
    return together((joint, seed) in OF_QUICK_TESTS)[joint, seed]


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return robot_of(ANYDRIVE, tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def found(robot: Robot) -> Identification:
    return identify(robot, log_of(ANYDRIVE))


def test_the_reason_for_two_steps_is_stated(found: Identification) -> None:
    summary = found.summary()
    assert "two-step: the springs, then the load, by the least output error" in summary
    assert "since no sensor is behind the springs of arm, whose motors are simulated" in summary


def test_simulated_angles_are_not_judged_as_those_of_a_log(
    robot: Robot, found: Identification
) -> None:
    """They jump between their windows, as where samples were lost."""
    of_logs, recorded = (
        {check.code.name for check in OF_LOGS},
        log_findings(robot, [log_of(ANYDRIVE)]),
    )
    shown = {x.code for x in found.findings if x.severity != "note"}
    assert shown & of_logs <= {x.code for x in recorded}


@pytest.mark.slow  # a motor side
@pytest.mark.parametrize("joint", [ANYDRIVE, HEAVIER])
def test_an_unknown_rotor_inertia_is_within_its_interval(joint: Joint, robot: Robot) -> None:
    """Encoder noise in the wider band of refinements made it 1.4 % too small, by 8 errors."""
    unknown = with_drive(robot, "arm", motor_inertia_kg_m2=None)
    result = identify(unknown, log_of(joint, 0 if joint is ANYDRIVE else 1))
    far = scores(result.drives["arm"], {"motor_inertia": joint.rotor, "stiffness": joint.k})
    assert np.max(np.abs([*far, *scores(result.load, {"Iyy_body": joint.load})])) < 3.0


@pytest.mark.slow  # two motor sides
def test_an_uncertain_rotor_inertia_is_in_all_errors(robot: Robot, found: Identification) -> None:
    """The refinement had lost the standard deviation of what was given as known."""
    std, part, log = 0.01, 1e-3, log_of(ANYDRIVE)
    heavier = (1 + part) * robot.drives["arm"].values["motor_inertia"]
    stated = identify(robot, log, known_std={"motor_inertia_kg_m2": std})
    changed = with_drive(robot, "arm", motor_inertia_kg_m2=heavier)
    other = identify(changed, log, cutoff_hz=found.cutoff_hz)
    for before, with_std, after in (
        (found.drives["arm"], stated.drives["arm"], other.drives["arm"]),
        (found.load, stated.load, other.load),
    ):
        np.testing.assert_allclose(with_std.values, before.values)
        added = np.sqrt(np.maximum(np.diag(with_std.covariance - before.covariance), 0.0))
        moved = std / part * np.abs(after.values - before.values)
        np.testing.assert_allclose(added, moved, rtol=0.02, atol=1e-9)
    # An error of 1 % is five times that of the noise.
    ratio = stated.drives["arm"].standard_error("stiffness")
    assert ratio > 4 * found.drives["arm"].standard_error("stiffness")


@pytest.mark.slow  # 6.9 s
def test_joints_without_a_sensor_behind_the_spring_are_found(robot: Robot) -> None:
    log = log_of(ANYDRIVE)
    assert joints_sensed_by_motor_only(robot, [log]) == ("arm",)
    seen = replace(log, joint_position=np.zeros_like(log.joint_position))
    assert joints_sensed_by_motor_only(robot, [log, seen]) == ()
    assert joints_sensed_by_motor_only(robot, [replace(log, deflection=log.motor_position)]) == ()
    assert joints_sensed_by_motor_only(robot, [unlogged(log, "motor_torque")]) == ()


@pytest.mark.slow  # a plant of 10 s in Python
def test_a_right_motor_side_has_a_note_with_a_bound_and_changes_no_more(
    found: Identification,
) -> None:
    """A second refinement changes nothing; an error of the model widens the bound."""
    assert [one for one in found.warnings if one.severity != "note"] == []
    again = refine(found, log_of(ANYDRIVE)).drives["arm"]
    error = again.values - found.drives["arm"].values
    assert np.all(np.abs(error) <= 0.1 * found.drives["arm"].standard_errors + 1e-12)
    (note,) = named(found, "note")
    (hidden,) = note.evidence.values()
    assert 0.02 < hidden < 0.15
    assert "by output error" in note.message
    assert f"up to {hidden:.1%} at arm" in note.message
    # a value of the term that no elastic load has
    terms = {"arm": {2: np.array([-1.0, 0.01])}}
    (wider,) = named(with_motor_side_findings(found, terms, found.motions[0]), "note")
    assert next(iter(wider.evidence.values())) > hidden
    # a torque that is mostly noise is doubted
    fit = found.joint_fits["arm"]
    assert fit.own < 0.01
    assert list(noisy_springs({"arm": fit.own})) == []
    (finding,) = noisy_springs({"arm": 0.62})
    assert (finding.code, finding.joint, finding.severity) == ("motor-side", "arm", "doubtful")


UNUSED: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "parallel spring or joint friction": ({"joint_friction": ("viscous",)}, {}),
    "or angle_ratio, and no sensor behind; log the": ({"angle_ratio": {"cos": [0.2]}}, {}),
    # they once gave the result of two steps and of "wls" without a word
    'remove method="simultaneous"': ({}, {"method": "simultaneous"}),
    'remove estimator="iv"': ({}, {"estimator": "iv"}),
}
"""{words of the error: changes of the drive, and options}."""


@pytest.mark.parametrize("words", UNUSED)
def test_what_such_a_refinement_does_not_use_is_refused(robot: Robot, words: str) -> None:
    """Before the log is looked at for long."""
    change, options = UNUSED[words]
    time = np.arange(0.0, 4.0, 1e-3)
    log = log_with("arm", time, motor_position=np.sin(9.0 * time), motor_torque=np.sin(9.0 * time))
    with pytest.raises(IdentificationError, match=words):
        identify(with_drive(robot, "arm", **change), log, **options)


def named(result: Identification, severity: str = "doubtful") -> list[Finding]:
    findings = [one for one in result.warnings if one.code == "motor-side"]
    return [one for one in findings if one.severity == severity]


def with_damping(joint: Joint, folder: Path, **nominal: float) -> Robot:
    """Return the robot of a joint whose spring may have damping."""
    return with_drive(robot_of(joint, folder, ("linear", "damping")), "arm", nominal=nominal)


@pytest.mark.slow  # a search for a stiffness behind a motor
def test_spring_damping_from_the_motor_alone_is_exact_without_noise(tmp_path: Path) -> None:
    drive = identify(with_damping(PERFECT, tmp_path), log_of(PERFECT)).drives["arm"]
    assert drive.value("stiffness") == pytest.approx(PERFECT.k, rel=5e-5)
    assert drive.value("spring_damping") == pytest.approx(PERFECT.damping, rel=1e-3)


@pytest.mark.slow  # a search for a stiffness behind a motor
def test_spring_damping_with_noise_is_inside_its_interval(tmp_path: Path) -> None:
    """From four times the true damping."""
    robot = with_damping(DAMPED, tmp_path, spring_damping=4 * DAMPED.damping)
    result = identify(robot, log_of(DAMPED))
    drive, error = result.drives["arm"], errors(DAMPED, result)
    std = drive.standard_error("spring_damping")
    assert abs(drive.value("spring_damping") - DAMPED.damping) < 3 * std < 0.06 * DAMPED.damping
    assert abs(error["k"]) < 3 * error["std"] < 0.01
    assert [one for one in result.warnings if one.severity != "note"] == []


@pytest.mark.slow  # a search for a stiffness behind a motor
def test_damping_that_the_drive_lacks_is_named(robot: Robot) -> None:
    (finding,) = named(identify(robot, log_of(DAMPED)))
    assert finding.joint == "arm"
    assert finding.evidence["damping ratio"] == pytest.approx(0.02, rel=0.05)
    assert finding.remedy == 'in the drives file:\n[arm]\nspring = ["linear", "damping"]'


@pytest.mark.slow  # a search for a stiffness behind a motor
def test_an_elastic_link_behind_the_spring_is_named(tmp_path: Path) -> None:
    robot = robot_of(WIDE, tmp_path)
    assert named(identify(robot, log_of(WIDE))) == []
    result = identify(robot, log_of(THREE))
    bias = errors(THREE, result)["k"]
    assert bias < -0.03
    (finding,) = named(result)
    assert "something behind the spring is elastic too" in finding.message
    fall = finding.evidence["fall at the antiresonance"]
    assert finding.evidence["standard error"] < fall / 5
    share = THREE.share  # the bias that the finding gives for the true share
    assert np.sqrt(fall * share / (1 - share)) == pytest.approx(-bias, rel=0.3)
    assert "usable with care: motor-side (arm)" in result.verdict.sentence


@pytest.mark.parametrize(
    ("damping", "fall", "is_link"),
    [(5e-4, 0.004, True), (0.04, 0.004, False), (5e-4, 1e-4, False)],
)
def test_damping_that_no_spring_has_is_that_of_a_link(
    damping: float, fall: float, is_link: bool
) -> None:
    """A link behind the spring is damped too: a line of damping left k 25 % too low."""
    tests = {"arm": {1: (damping, 1.2e-4), 2: (fall, 1.9e-4)}}
    finding, _ = motor_side_findings(tests, {"arm": 4.6})
    assert ("something behind the spring is elastic too" in finding.message) == is_link
    assert ('spring = ["linear", "damping"]' in finding.remedy) == (not is_link)
    assert f"damping ratio of {damping / 2:.2%}" in finding.message


@pytest.mark.slow  # no start ends at the noise, so that all are tried
def test_a_spring_that_the_motor_does_not_show_is_said(robot: Robot) -> None:
    stiff = replace(ANYDRIVE, k=20 * ANYDRIVE.k, highest_hz=2.0)
    result = identify(robot, simulated(stiff, 5.0))
    (finding,) = [one for one in result.warnings if one.code == "hidden-resonance"]
    assert finding.severity == "doubtful"
    assert "Hz" in finding.remedy
    assert "amplitude" in finding.remedy
    stiff = replace(ANYDRIVE, k=200 * ANYDRIVE.k, highest_hz=2.0)
    message = r"does not determine the stiffness of arm \(the refinement did not converge .*\)\."
    with pytest.raises(IdentificationError, match=message):
        identify(robot, simulated(stiff, 5.0))


def test_windows_have_more_rows_than_initial_states(robot: Robot) -> None:
    """Below a low cutoff a row is longer than the short windows of the first estimates."""
    slow = replace(ANYDRIVE, highest_hz=0.8)
    result = identify(robot, simulated(slow, 12.0), cutoff_hz=0.95)
    (finding,) = [one for one in result.warnings if one.code == "hidden-resonance"]
    assert finding.severity != "note"


def test_simulated_angles_that_diverge_are_no_fault_of_a_column(robot: Robot) -> None:
    log = simulated(replace(ANYDRIVE, highest_hz=0.8), 12.0)
    motion = reconstruct_motion(robot, with_rigid_angles(robot, log, ["arm"]), 2.0)
    far = replace(motion, joint_position=1e14 + motion.joint_position)
    with pytest.raises(IdentificationError, match=r"simulated angles .* diverge"):
        with_angles(robot, log, [far], ["arm"])


@pytest.mark.slow  # a search for a stiffness behind a motor
def test_a_file_without_joint_position_is_read(robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    seaid.write_log(log_of(ANYDRIVE), path)
    log = seaid.read_log(path, robot)
    assert joints_sensed_by_motor_only(robot, [log]) == ("arm",)
    with pytest.raises(LogError, match="identify needs the log in memory, of read_log"):
        reconstruct_motion(robot, log)
    with pytest.raises(LogError, match="not in pieces"):
        identify(robot, path)


@pytest.mark.slow  # a search for a stiffness behind a motor
def test_bodies_are_physically_consistent_if_wanted(robot: Robot, tmp_path: Path) -> None:
    result = identify(robot, log_of(ANYDRIVE), feasible=True)
    assert result.feasible is not None
    seaid.write_urdf(result, tmp_path / "found.urdf")  # which refuses inconsistent bodies
    written = seaid.load_robot(tmp_path / "found.urdf")
    base = result.base.project(written.parameters)
    assert np.all(np.abs(base - result.load.values) < 3 * result.load.standard_errors)


@pytest.mark.slow  # a plant of 10 s in Python
def test_other_logs_are_predicted_by_their_motor_torque_or_named(found: Identification) -> None:
    result = seaid.validate(found, log_of(ANYDRIVE, seed=1))
    assert result.actuator.relative_error[0] < 0.01
    assert np.isnan(result.load.relative_error[0])
    assert np.all(np.isnan(result.load.measured))
    (note,) = result.warnings
    assert "no measured torque on its load" in note.message
    assert note.severity == "note"
    assert "motor-side" in str(result.summary())
    result = seaid.validate(found, log_of(HEAVIER, seed=1))
    (finding,) = [one for one in result.warnings if one.code == "unseen-motion"]
    assert "torque of the motor of arm" in finding.message
    assert finding.severity in ("wrong", "doubtful")


@pytest.mark.slow  # a search for a stiffness behind a motor
@pytest.mark.parametrize("number", ONCE_WRONG)
def test_random_joints_whose_search_once_ended_elsewhere(number: int, tmp_path: Path) -> None:
    """From the antiresonance of a rigid robot these ended in wrong minima, or nowhere."""
    joint = random_joint(number)
    error = errors(joint, identify(robot_of(joint, tmp_path), log_of(joint, seed=number)))
    assert abs(error["k"]) < 0.01
    assert abs(error["resonance"]) < 0.005
