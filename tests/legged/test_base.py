"""A whole quadruped on the ground: bodies from joint torques, an IMU and contact flags."""

import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import seaid
from scripts.benchmarks.legged import noisy, quadruped
from scripts.example_robots import example_urdf
from scripts.legged_plant import GO2, changed_bodies, plan, plant, simulate
from seaid._arrays import Array, FrozenMapping
from seaid.errors import Finding, IdentificationError, LogError, SeaidError
from seaid.legged import FloatingRobot, LeggedValidation
from seaid.legged.base import _Axes, _limits, _significant
from seaid.legged.floating import contact_map, floating, floating_regressor
from seaid.log import BaseLog, reconstruct_motion
from seaid.log.base_log import moving_base
from seaid.regressor import rigid_body_regressor
from seaid.robot import BASE_ROWS, Robot
from tests.plants import kept
from tests.representatives import quick_first


def base_of(log: seaid.Log) -> BaseLog:
    """Return the log of the base, which all logs of this module have."""
    assert log.base is not None
    return log.base


def with_base(log: seaid.Log, **changed: Any) -> seaid.Log:
    """Return the log with other signals of the base."""
    return replace(log, base=replace(base_of(log), **changed))


def fitted(robot: Robot, *logs: seaid.Log, **options: Any) -> seaid.Identification:
    """Return the identification from smooth logs, below 4 Hz."""
    return seaid.identify(robot, list(logs), cutoff_hz=4.0, **options)


def largest_error(found: seaid.Identification, least: float = 0.01) -> float:
    """Return the largest error of a base parameter, relative to its size or the `least`."""
    truth = found.base.project(STANDING.parameters)
    return float(np.max(np.abs(found.load.values - truth) / np.maximum(np.abs(truth), least)))


@cache
def go2() -> FloatingRobot:
    file = example_urdf("go2.urdf")
    return floating(seaid.load_robot(file, base="floating", contacts=GO2.contacts))


def validated(identification: seaid.Identification, log: seaid.Log) -> LeggedValidation:
    """Return the validation with its contact forces."""
    result = seaid.validate(identification, log)
    assert isinstance(result, LeggedValidation)
    return result


@kept
def walked() -> seaid.Log:
    return simulate(go2(), plant(go2()), 24.0)


@kept
def found_walking() -> seaid.Identification:
    return seaid.identify(go2().without_nominal(), noisy(walked(), 1))


@cache
def swayed() -> seaid.Log:
    """Twelve seconds of smooth motion in the air and on four feet, exact up to rounding."""
    rng, time = np.random.default_rng(3), np.arange(0, 12, 0.01)

    def waves(count: int, size: float) -> tuple[Array, Array, Array]:
        turn = 2 * np.pi * rng.uniform(0.2, 1.0, count)
        angle = np.outer(time, turn) + rng.uniform(0, 6, count)
        return size * np.sin(angle), size * turn * np.cos(angle), -size * turn**2 * np.sin(angle)

    joints, (w, e, _), (f, _, _) = waves(12, 0.5), waves(3, 0.8), waves(3, 2.0)
    f = f + np.array([0, 0, 9.81])
    rows = floating_regressor(STANDING, *joints, (w, e, f)) @ STANDING.parameters
    A = contact_map(STANDING, joints[0], moving_base(STANDING).contacts)
    # the least contact forces that hold the base
    forces = np.einsum("tkr,tr->tk", np.linalg.pinv(A[:, :6]), rows[:, :6])
    torque = rows - np.einsum("trk,tk->tr", A, forces)
    assert np.max(np.abs(torque[:, :6])) < 1e-9
    return seaid.Log(
        time=time,
        joint_names=STANDING.joint_names,
        joint_position=joints[0],
        motor_position=np.full((len(time), 12), np.nan),
        motor_torque=torque[:, 6:],
        base=BaseLog(
            angular_velocity=w,
            specific_force=f,
            contacts=dict.fromkeys(GO2.feet, np.ones(len(time))),
        ),
    )


STANDING = seaid.load_robot(example_urdf("go2.urdf"), base="floating", contacts=GO2.feet)
GO2_JOINTS = STANDING.joint_names


def ahead(log: seaid.Log, values: Array, late_s: float) -> Array:
    """Return samples as they are logged by a clock that is late."""
    at = np.clip(log.time - late_s, log.time[0], log.time[-1])
    return np.asarray(CubicSpline(log.time, values)(at))


IMU = ("angular_velocity", "specific_force")


def late_base(log: seaid.Log, late_s: float) -> seaid.Log:
    return with_base(log, **{x: ahead(log, getattr(log.base, x), late_s) for x in IMU})


def late_torques(log: seaid.Log, late_s: float) -> seaid.Log:
    return replace(log, motor_torque=ahead(log, log.motor_torque, late_s))


LATE = {
    "base": (late_base, "angular velocity, specific force of the base are"),
    "torques": (late_torques, "the motor torques of FL_hip_joint"),
}


def doubtful_delays(found: seaid.Identification) -> list[Finding]:
    return [x for x in found.warnings if x.code == "delay" and x.severity != "note"]


@pytest.mark.slow  # two fits of a whole quadruped each
@pytest.mark.parametrize("late_s", [0.005, -0.01, 0.02])
@pytest.mark.parametrize("what", LATE)
def test_what_is_late_as_a_whole_is_named_with_the_line_that_repairs_it(
    tmp_path: Path, what: str, late_s: float
) -> None:
    """The torque of a joint acts on all equations without contact forces, not on its own alone."""
    (change, words), robot = LATE[what], STANDING.without_nominal()
    log = change(noisy(swayed(), 5), late_s)
    (finding,) = doubtful_delays(fitted(robot, log))
    assert finding.message.startswith(words)
    delay_s, error_s = (finding.evidence[x] for x in ("delay [s]", "standard error [s]"))
    assert abs(delay_s - late_s) < 3 * error_s < 0.002
    seaid.write_log(log, tmp_path / "late.csv")
    (tmp_path / "repair.toml").write_text(finding.remedy.split("\n", 1)[1])
    repaired = seaid.read_log(tmp_path / "late.csv", robot, description=tmp_path / "repair.toml")
    assert not doubtful_delays(fitted(robot, repaired))


@cache
def found_standing() -> seaid.Identification:
    return fitted(STANDING.without_nominal(), swayed())


@pytest.mark.slow  # a fit of a whole quadruped
def test_bodies_of_an_exact_log_are_recovered() -> None:
    found = found_standing()
    assert len(found.load.values) == 90
    assert largest_error(found) < 2e-3
    # its feet move at random under the forces: only that contradicts the flags
    assert {one.code for one in found.warnings if one.severity != "note"} == {"contact-flags"}


def with_known_trunk() -> Robot:
    return seaid.load_robot(
        example_urdf("go2.urdf"), base="floating", contacts=GO2.feet, known_bodies=["base"]
    )


@cache
def found_swaying() -> seaid.Identification:
    return fitted(with_known_trunk().without_nominal(), swayed(), estimator="ols")


@pytest.mark.slow  # fits of a whole quadruped
@pytest.mark.usefixtures("estimates_only")
@pytest.mark.parametrize("name", ["torque", "bodies"])
def test_errors_of_known_constants_are_those_of_whole_identifications(name: str) -> None:
    """Contact forces are eliminated from the derivatives as from the equations."""
    robot, log, std, step = with_known_trunk().without_nominal(), swayed(), 0.01, 1e-4
    heavier = np.where(robot.is_known, 1 + step, 1.0) * robot.parameters
    changed = {
        "torque": (robot, replace(log, motor_torque=(1 + step) * log.motor_torque)),
        "bodies": (robot.with_values(heavier, robot.drives), log),
    }
    plain, other = found_swaying(), fitted(*changed[name], estimator="ols")
    stated = fitted(robot, log, known_std={name: std}, estimator="ols")
    variance = np.diag(stated.load.covariance - plain.load.covariance)
    moved = std / step * np.abs(other.load.values - plain.load.values)
    assert np.max(moved / plain.load.standard_errors) > 100
    np.testing.assert_allclose(np.sqrt(np.maximum(variance, 0.0)), moved, rtol=1e-3, atol=1e-9)


@cache
def measured() -> seaid.Log:
    """The motion of `swayed` with force sensors at its feet, and torques that belong to them."""
    log = swayed()
    A = contact_map(STANDING, log.joint_position, moving_base(STANDING).contacts, own_frame=True)
    motion = seaid.reconstruct_motion(STANDING, log, cutoff_hz=4.0)
    assert motion.base is not None
    rows = floating_regressor(STANDING, *motion.joint_states, motion.base.states)
    held = (rows @ STANDING.parameters)[:, :6]
    forces = np.einsum("tkr,tr->tk", np.linalg.pinv(A[:, :6]), held)
    wrenches = {x: forces[:, 3 * k : 3 * k + 3] for k, x in enumerate(GO2.feet)}
    torque = rows @ STANDING.parameters - np.einsum("trk,tk->tr", A, forces)
    return with_base(replace(log, motor_torque=torque[:, 6:]), contacts={}, wrenches=wrenches)


def without_torques(log: seaid.Log, joints: Iterable[str] = GO2_JOINTS) -> seaid.Log:
    """Return the log without the torques of joints."""
    torque = np.array(log.motor_torque)
    torque[:, [STANDING.index(joint) for joint in joints]] = np.nan
    return replace(log, motor_torque=torque)


def felt() -> seaid.Log:
    """The same without torques."""
    return without_torques(measured())


@pytest.mark.slow  # fits of a whole quadruped
def test_forces_on_the_base_determine_its_bodies_with_any_torques() -> None:
    """What is determined in flight: of all joints, of one, or of none."""
    robot, one = STANDING.without_nominal(), ["FL_hip_joint"]
    assert largest_error(fitted(robot, measured())) < 2e-3
    assert len(fitted(robot, measured(), torque_joints=one).load.values) == 94
    found = fitted(STANDING, felt())
    assert found.model.torque_joints == ()
    assert len(found.load.values) == 94
    assert largest_error(found) < 2e-3
    assert [*found.joint_fits] == [*found.checks["load"].whiteness] == [*BASE_ROWS]
    assert all(fit.own < 0.01 for fit in found.joint_fits.values())
    assert found.verdict.level == "good"
    assert "94 base parameters from the forces on the base" in found.summary()
    again = seaid.validate(found, felt())
    assert "no joint has a torque that could be compared" in again.summary()


def zeroed(log: seaid.Log, zero: Array) -> seaid.Log:
    """Return the log of force sensors that show a zero at all feet but one."""
    wrenches = base_of(log).wrenches.items()
    return with_base(log, wrenches={x: y + zero * (x != "RR_foot") for x, y in wrenches})


BIAS, ZERO = np.array([0.1, -0.07, 0.05]), np.array([3.0, -2.0, 4.0])

SENSORS = ("accelerometer", "force sensors", "force sensors alone")


@pytest.mark.slow  # fits of a whole quadruped
@pytest.mark.parametrize("name", quick_first(SENSORS))
def test_offsets_of_sensors_are_identified_with_the_bodies(name: str) -> None:
    """0.1 of 9.81 m/s^2 moves the centre of mass; zeros alone made the robot 2 kg too heavy."""
    if name == "accelerometer":
        force = base_of(swayed()).specific_force
        assert force is not None
        log, code, offsets = with_base(swayed(), specific_force=force + BIAS), "base-bias", BIAS
    else:
        log, code = zeroed(felt() if name.endswith("alone") else measured(), ZERO), "sensor-zero"
        offsets = np.concatenate([*3 * [ZERO], np.zeros(3)])
    found = fitted(STANDING.without_nominal(), log)
    (finding,) = (x for x in found.warnings if x.code == code)
    np.testing.assert_allclose([*finding.evidence.values()], offsets, atol=4e-3)
    truth = found.base.project(STANDING.parameters)
    assert np.max(np.abs(found.load.values - truth)) < 1e-3
    assert "base-bias" not in {x.code for x in found_standing().warnings}


def test_zeros_are_estimated_only_where_they_are_determined_and_significant() -> None:
    """Those of sensors that are always loaded would be told from the mass by small accelerations.

    Without a bias of the accelerometer, what it took goes to the zeros.
    """
    base = reconstruct_motion(STANDING, measured(), cutoff_hz=4.0).base
    assert base is not None
    assert {link for link, _ in _limits([base])} - {""} == set(base.wrenches)
    loaded = {x: np.where(np.arange(y.shape[1]) == 2, 400.0, y) for x, y in base.wrenches.items()}
    still = replace(base, wrenches=FrozenMapping(loaded, "link"))
    assert {link for link, _ in _limits([still])} == {""}
    places = [("", 0), ("foot", 0), ("foot", 1)]
    value, covariance = np.array([0.03, 0.5, 0.001]), np.diag([1e-3, 1e-4, 1e-4])
    axes = _Axes(places, np.zeros((1, 3)), np.array([0.02, 0.2, 0.2]), np.array([1.0, 20.0, 20.0]))
    for scale, chosen in ((1.0, [1, 2]), (1e-3, [0, 1, 2]), (1e4, [])):
        assert _significant(axes, value, scale * covariance, 50.0) == chosen
    # an error that is correlated with that of the accelerometer is smaller without a bias of it
    std, alone = np.sqrt([1e-3, 0.0625, 0.0625]), np.array([0.0, 0.5, 0.001])
    for correlation, chosen in ((0.95, [1, 2]), (0.0, [])):
        correlated = np.eye(3)
        correlated[0, 1] = correlated[1, 0] = correlation
        assert _significant(axes, alone, correlated * np.outer(std, std), 50.0) == chosen
    # beyond the largest zero: another unit, or exchanged sensors
    smaller = replace(axes, most=0.4 * axes.least)
    assert _significant(smaller, value, covariance, 50.0) == []


def with_forces(change: Callable[[Array], Array], order: int = 1) -> seaid.Log:
    """Return the log without torques whose force sensors are changed, or in another order."""
    links, forces = zip(*base_of(felt()).wrenches.items(), strict=True)
    changed = zip(links, map(change, forces[::order]), strict=True)
    return with_base(felt(), wrenches=dict(changed))


FOUND: dict[str, tuple[Callable[[], seaid.Log], str, str]] = {
    "the mass of the whole robot is negative, -16.1 kg": (
        lambda: with_forces(np.negative),
        "total-mass",
        "wrong",
    ),
    "is 1.64 kg, 0.1 of that of the robot file, 16.1 kg": (
        lambda: with_forces(lambda force: force / 9.81),
        "total-mass",
        "doubtful",
    ),
    "the model explains nothing of the base force x": (
        lambda: with_forces(np.positive, -1),
        "no-fit",
        "wrong",
    ),
    "the log has no torque of RL_calf_joint: ": (
        lambda: without_torques(measured(), ["RL_calf_joint"]),
        "no-torque",
        "note",
    ),
    "base alone": (felt, "no-torque", "note"),
}
"""{a part of the message: the log, the code and the severity}"""


@pytest.mark.slow  # a fit of a whole quadruped each
@pytest.mark.parametrize("words", FOUND)
def test_what_is_wrong_or_missing_of_forces_is_named(words: str) -> None:
    log, *kind = FOUND[words]
    found = fitted(STANDING, log())
    (finding,) = (x for x in found.warnings if [x.code, x.severity] == kind)
    assert words in finding.message
    assert (found.verdict.level == "good") == (finding.severity == "note")


@pytest.mark.slow  # 2.4 s
@pytest.mark.parametrize("touching", [0.0, 1.0])
@pytest.mark.parametrize("given", [None, []])
def test_a_log_without_any_force_is_refused(touching: float, given: list[str] | None) -> None:
    flags = dict.fromkeys(GO2.feet, np.full(len(felt().time), touching))
    silent = with_base(felt(), contacts=flags, wrenches={})
    with pytest.raises(IdentificationError, match="no joint has a torque and no contact a measur"):
        fitted(STANDING, silent, torque_joints=given)


@pytest.mark.slow  # fits of a whole quadruped
def test_logs_of_a_robot_that_hangs_and_that_stands_are_one_fit() -> None:
    trunk = seaid.robot.Contact("base", is_flat=True)
    robot = seaid.load_robot(example_urdf("go2.urdf"), base="floating", contacts=[*GO2.feet, trunk])
    log, held = swayed(), seaid.load_robot(example_urdf("go2.urdf"))
    rng, time = np.random.default_rng(8), log.time
    turn, angle = 2 * np.pi * rng.uniform(0.2, 1.0, 12), rng.uniform(0, 6, 12)
    waves = np.outer(time, turn) + angle
    joints = 0.5 * np.sin(waves), 0.5 * turn * np.cos(waves), -0.5 * turn**2 * np.sin(waves)
    torque = np.einsum("tjk,k->tj", rigid_body_regressor(held, *joints), held.parameters)
    base = BaseLog.hanging(robot, len(time))
    hanging = replace(log, joint_position=joints[0], motor_torque=torque, base=base)
    free = with_base(log, contacts={**base_of(log).contacts, "base": np.zeros(len(time))})
    found = fitted(robot.without_nominal(), hanging, free)
    assert len(found.load.values) == 94  # 68 by hanging, 90 by standing
    assert largest_error(found) < 5e-3
    assert {one.code for one in found.warnings if one.severity != "note"} <= {"contact-flags"}
    message = (
        "load it with base='floating' and, among contacts=, seaid.robot.Contact('base', is_flat=T"
    )
    with pytest.raises(SeaidError, match=re.escape(message)):
        BaseLog.hanging(STANDING, 10)


@pytest.mark.slow  # fits of a whole quadruped
def test_forces_of_feet_are_predicted_with_what_they_rest_on() -> None:
    """The identified parameters lack the mass at a foot that always stands."""
    log = measured()
    for robot, sensed, basis in (
        (STANDING, swayed(), "robot file"),
        (STANDING.without_nominal(), swayed(), "none"),
        (STANDING.without_nominal(), log, "identified"),
    ):
        found = fitted(robot, sensed)
        validation = validated(found, log)
        contacts = validation.contacts
        assert contacts is not None
        assert contacts.basis == (basis,) * 4
        assert (basis == "none") == bool(np.all(np.isnan(contacts.predicted)))
        if basis != "none":
            assert np.max(contacts.relative_error) < 2e-3
            np.testing.assert_allclose(contacts.scale, 1.0, atol=2e-3)
    # the torque is that of the joint, not what the measured force leaves of it
    inside = np.isfinite(validation.load.measured[:, 2])
    both = validation.load.measured[inside, 2], log.motor_torque[inside, 2]
    assert np.corrcoef(*both)[0, 1] > 0.9
    assert np.std(both[0]) > 0.8 * np.std(both[1])
    # a sensor with the opposite sign, and a foot that would have to pull
    turned = with_base(log, wrenches={x: -y for x, y in base_of(log).wrenches.items()})
    texts = [str(x) for x in seaid.validate(found, turned).warnings if x.code == "contact-forces"]
    assert sum("least with the measured one times -1" in text for text in texts) == 4


HELD: dict[str, Callable[[], Any]] = {
    "replay": lambda: seaid.replay(STANDING, swayed()),
    "refine": lambda: seaid.refine(found_standing(), swayed()),
    "identifiability with sensors= or conditions=": lambda: seaid.identifiability(
        STANDING, ["joint_position"]
    ),
    "design_excitation": lambda: seaid.design_excitation(STANDING, duration=2.0),
    "compare_terms": lambda: seaid.compare_terms(STANDING, swayed()),
    "base_parameters in exact arithmetic": lambda: seaid.symbolic.base_parameters(STANDING),
    'method="simultaneous"': lambda: seaid.identify(STANDING, swayed(), method="simultaneous"),
    'estimator="iv"': lambda: seaid.identify(STANDING, swayed(), estimator="iv"),
}


@pytest.mark.slow  # 4.0 s
@pytest.mark.parametrize("what", HELD)
def test_message_of_what_needs_a_fixed_base(what: str) -> None:
    message = f"{what} needs a robot with a fixed base, and that of 'go2_description' floats"
    with pytest.raises(SeaidError, match=re.escape(message)):
        HELD[what]()


@pytest.mark.slow  # 0.6 s
def test_hanging_adds_what_four_feet_lack() -> None:
    feet, held = list(GO2.feet), seaid.load_robot(example_urdf("go2.urdf"))
    for robot, stances, rank in (
        (STANDING, [feet], 90),
        (STANDING, ["hanging"], len(seaid.base_parameters(held).columns)),
        (STANDING, [feet, "hanging"], 94),
        (go2(), [feet], 90),  # noise hides the roll of a ball
    ):
        found = seaid.identifiability(robot, stances=stances)
        assert (found.rank, found.agree) == (rank, True)
        assert ("m_base" in found.unidentifiable) == (stances == ["hanging"])
    with pytest.raises(SeaidError, match="stances=: no contact is named 'FL'"):
        seaid.identifiability(STANDING, stances=[["FL"]])


def test_mjcf_has_the_mass_matrix_of_the_floating_robot(tmp_path: Path) -> None:
    seaid.write_mjcf(go2(), tmp_path / "go2.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "go2.xml"))
    data, rng = mujoco.MjData(model), np.random.default_rng(2)
    q, a = rng.uniform(-1, 1, (2, 1, 12))
    f, e = rng.normal(size=(2, 1, 3))
    places = [model.joint(name).qposadr[0] for name in go2().joint_names]
    dofs = [model.joint(name).dofadr[0] for name in go2().joint_names]
    data.qpos[:7], data.qpos[places] = [0, 0, 1, 1, 0, 0, 0], q[0]
    data.qacc[:3], data.qacc[3:6], data.qacc[dofs] = f[0] + model.opt.gravity, e[0], a[0]
    mujoco.mj_inverse(model, data)
    Y = floating_regressor(go2(), q, 0 * q, a, (0 * e, e, f))
    found = np.concatenate([data.qfrc_inverse[:6], data.qfrc_inverse[dofs]])
    np.testing.assert_allclose(found, (Y @ go2().parameters)[0], atol=1e-6)


@pytest.mark.slow  # 36 s of MuJoCo with contacts, and 94 parameters of 18 equations
def test_forces_of_feet_are_those_of_the_simulator(tmp_path: Path) -> None:
    found = found_walking()
    forces = simulate(go2(), plant(go2()), 12.0, 5, has_forces=True)
    validation = validated(found, noisy(forces, 2))
    contacts = validation.contacts
    assert contacts is not None
    assert contacts.basis == ("identified",) * 4
    assert np.max(contacts.relative_error) < 0.015  # 0.4 to 0.8 %
    assert contacts.measured_vertical == pytest.approx(contacts.vertical, rel=0.005)
    assert contacts.vertical == pytest.approx(contacts.weight, rel=0.02)
    assert validation.warnings == ()
    seaid.project.save_run(found, tmp_path / "go2.npz", validations={"other": validation})
    again = seaid.project.load_run(tmp_path / "go2.npz").validations["other"]
    assert isinstance(again, LeggedValidation)
    assert again.contacts is not None
    np.testing.assert_array_equal(again.contacts.relative_error, contacts.relative_error)


@pytest.mark.slow
def test_a_radius_left_out_shows_in_the_residual() -> None:
    robot = seaid.load_robot(example_urdf("go2.urdf"), base="floating", contacts=GO2.feet)
    every = [seaid.identify(one, walked().between(0.0, 12.0)) for one in (go2(), robot)]
    errors = [np.mean([fit.own for fit in found.joint_fits.values()]) for found in every]
    assert errors[0] < 0.003
    assert errors[1] > 3 * errors[0]
    assert "geometry" not in {one.code for one in every[0].warnings}
    (finding,) = (one for one in every[1].warnings if one.code == "geometry")
    assert finding.evidence["radius [m]"] == pytest.approx(0.02, abs=1.5e-3)
    assert "radius_m = 0.0" in finding.remedy


@pytest.mark.slow  # two motions of 8 s in MuJoCo
@pytest.mark.parametrize("seed", [106, 109])
def test_a_short_log_without_a_bias_has_none(tmp_path: Path, seed: int) -> None:
    """Chi-square is 36 and 38 of three axes with a covariance of 13 degrees of freedom."""
    robot = quadruped(GO2, changed_bodies(example_urdf(GO2.urdf), tmp_path, seed))
    targets = plan(go2(), GO2, 8.0, seed, lifted=False)
    log = noisy(simulate(robot, plant(robot, 0.001), 8.0, targets=targets), seed)
    force = base_of(log).specific_force
    assert force is not None
    for bias in (np.zeros(3), np.array([0.2, -0.14, 0.1])):
        found = seaid.identify(go2().without_nominal(), with_base(log, specific_force=force + bias))
        assert ("base-bias" in {one.code for one in found.warnings}) == bool(np.any(bias))


@pytest.mark.slow  # fits of a whole quadruped
def test_force_and_moment_on_the_base_are_validated_on_another_motion() -> None:
    """By measured wrenches of another sway; sensors with exchanged axes contradict the model."""
    robot, model = go2(), plant(go2(), 0.001)
    own, other = (
        noisy(simulate(robot, model, seconds, seed=seed, has_forces=True), seed)
        for seconds, seed in ((12.0, 1), (6.0, 2))
    )
    found = seaid.identify(robot.without_nominal(), own)
    result = validated(found, other)
    assert result.base is not None
    assert result.base.relative_error[:3].max() < 0.02
    assert result.warnings == ()
    assert result.load.whole_relative_error < 0.01
    own_residual, of_blocks = found.residual
    assert own_residual < of_blocks < 1.2 * own_residual
    turned = {link: values[:, [1, 0, 2]] for link, values in base_of(other).wrenches.items()}
    wrong = seaid.validate(found, with_base(other, wrenches=turned))
    texts = [one.message for one in wrong.warnings if one.code == "unseen-motion"]
    for kind in ("force", "moment"):
        assert any(f"does not predict the {kind} on the base" in text for text in texts)
    flagged = noisy(simulate(robot, model, 4.0, seed=3), 3)
    assert validated(found, flagged).base is None


def test_contacts_that_change_too_often_for_the_cutoff_are_an_error_of_ours() -> None:
    flags = (np.arange(len(swayed().time)) // 15 % 2).astype(float)
    flickering = with_base(swayed(), contacts=dict.fromkeys(GO2.feet, flags))
    words = r"no sample of the logs is used: .* are 0\.15 s at most.* raise cutoff_hz to 8\.7 Hz"
    with pytest.raises(LogError, match=words):
        fitted(STANDING.without_nominal(), flickering)
