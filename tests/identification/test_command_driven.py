"""Logs with position commands and no torque: the controller is known, its delay perhaps not."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import seaid
from scripts.benchmarks import commanded_arms
from seaid._arrays import Array
from seaid.checks.values import drive_findings
from seaid.drives import ParameterName
from seaid.errors import IdentificationError, LogError, RobotError
from seaid.estimation import Estimate
from seaid.estimation.parameters import check_buses
from seaid.identification.command_driven import commanded_point
from seaid.log.commands import commanded_torque
from seaid.regressor.regression import signals
from seaid.simulation.replaying import rollout
from tests.commanded_joint import (
    CHIRP,
    GAINS,
    HARD,
    SOFT,
    TIME,
    TRUTH,
    URDF,
    driven,
    log_of,
    mujoco_log,
    robot_of,
    stepped,
    values_of,
)
from tests.plants import log_with
from tests.representatives import quick_only

pytestmark = pytest.mark.usefixtures("estimates_only")


@pytest.mark.slow  # 0.6 s
def test_two_gain_sets_separate_the_bias_of_an_encoder_from_an_offset(urdf: Path) -> None:
    """The drive's own encoder reads 0.01 rad too much: its torques are K_p times that smaller."""
    bias, conditions = 0.01, {}
    for seed, (name, gains) in enumerate({"soft": SOFT, "hard": HARD}.items()):
        log = mujoco_log(gains, 0.005, 1e-4, seed)
        assert log.position_command is not None
        # commands in the coordinate of that encoder; the plant has none of it
        conditions[name] = (
            robot_of(urdf, gains),
            replace(log, position_command=log.position_command + bias),
        )
    found = seaid.identify_conditions(conditions, condition_specific=("friction_offset",))
    offsets = [values_of(one)["friction_offset"][0] for one in found.identifications.values()]
    assert (offsets[0] - offsets[1]) / (SOFT[0] - HARD[0]) == pytest.approx(bias, rel=0.01)


def two_joints(
    tmp_path: Path,
    nominal_s: tuple[float | None, float | None],
    gains: tuple[float, float] = SOFT,
) -> seaid.Robot:
    """Return two arms side by side, with their gains and nominal delays."""
    path = tmp_path / "two.urdf"
    arm = URDF[URDF.index('<link name="arm">') : URDF.index("</robot>")]
    arms = [arm.replace('"arm"', f'"arm{k}"').replace('"j"', f'"j{k}"') for k in (0, 1)]
    path.write_text(f'<robot name="two"><link name="base"/>{"".join(arms)}</robot>')
    drives = {
        f"j{k}": seaid.StiffDrive(
            motor_input="position_command",
            controller=seaid.Controller(
                position_gain_Nm_per_rad=gains[0], velocity_gain_Nms_per_rad=gains[1]
            ),
            command_delay_s=delay,
        )
        for k, delay in enumerate(nominal_s)
    }
    return seaid.load_robot(path, drives, known_bodies=["arm0", "arm1"])


def slowly_off(log: seaid.Log, noise: float = 2e-3) -> seaid.Log:
    """Return a log whose encoders are off by a wave of 1.3 Hz and by noise: no delay is seen."""
    errors = np.random.default_rng(3).normal(size=log.joint_position.shape) * noise
    errors += 3e-2 * np.sin(2 * np.pi * 1.3 * log.time)[:, None]
    return replace(log, joint_position=log.joint_position + errors)


def joined(logs: list[seaid.Log]) -> seaid.Log:
    """Return one log of two joints."""
    positions = np.hstack([one.joint_position for one in logs])
    commands = np.column_stack([CHIRP, CHIRP])
    return log_with(("j0", "j1"), TIME, joint_position=positions, position_command=commands)


@pytest.mark.slow  # 1.4 s
def test_drives_with_one_nominal_delay_share_their_delay(tmp_path: Path) -> None:
    """The delay of two joints is between those of each alone, and its error less than either's."""
    logs = [mujoco_log(SOFT, 0.008, 5e-4, seed) for seed in (1, 2)]
    both = joined(logs)
    found = seaid.identify(two_joints(tmp_path, (None, None)), both)
    shared = found.load_side
    own = seaid.identify(two_joints(tmp_path, (0.007, 0.0075)), both).load_side
    delays = [f"command_delay of j{k}" for k in (0, 1)]
    value, error = shared.value(delays[0]), shared.standard_error(delays[0])
    assert shared.value(delays[1]) == pytest.approx(value, abs=1e-9)
    assert min(map(own.value, delays)) <= value <= max(map(own.value, delays))
    assert error < 0.95 * min(map(own.standard_error, delays))
    assert own.value(delays[0]) != own.value(delays[1])
    # solvers give the equal delays with other rounding
    assert len({drive.command_delay_s for drive in found.robot.drives.values()}) == 1


def test_directions_are_those_of_drives_with_position_commands(tmp_path: Path) -> None:
    """Others keep the sign of the speed at the samples."""
    robot = two_joints(tmp_path, (0.0, 0.0)).with_drives({"j1": seaid.StiffDrive()})
    unknown, both = np.full_like(CHIRP, np.nan), np.column_stack([CHIRP, CHIRP])
    columns = {"motor_torque": np.column_stack([unknown, CHIRP])}
    columns["position_command"] = np.column_stack([CHIRP, unknown])
    log = log_with(("j0", "j1"), TIME, joint_position=both, **columns)
    motion = seaid.reconstruct_motion(robot, log)
    own, other = (signals(robot, motion, index)["theta_M_sign"] for index in (0, 1))
    np.testing.assert_array_equal(other, np.sign(motion.motor_velocity[:, 1]))
    assert motion.friction_known is not None
    assert np.all(np.isnan(motion.friction_known[:, 1]))
    known = motion.friction_known[:, 0] == 1
    assert 0 < np.sum(~known) < 20 * np.sum(np.diff(other) != 0)
    np.testing.assert_allclose(own[known], other[known], atol=0.05)


@pytest.mark.slow  # 0.8 s
@pytest.mark.findings
def test_a_delay_that_the_log_does_not_determine_is_as_stated(urdf: Path) -> None:
    """The interval of the armature holds what every delay in the stated range gives."""
    log = slowly_off(mujoco_log(HARD, 0.006, 0.0, 0))
    found = seaid.identify(robot_of(urdf, HARD), log)
    values = values_of(found)
    assert values["command_delay"] == pytest.approx((0.0, 0.0125 / 1.96), rel=1e-3, abs=1e-9)
    names = list(map(str, found.load_side.names))
    lower, upper = found.load_side.interval()[names.index("motor_inertia of j")]
    for delay_s in (-0.0125, 0.0125):
        known = values_of(seaid.identify(robot_of(urdf, HARD, delay_s), log))
        assert lower <= known["motor_inertia"][0] <= upper
    (finding,) = (one for one in found.warnings if one.code == "command-delay")
    ((text, value),) = (x for x in finding.evidence.items() if x[0].startswith("armature"))
    assert "armature and" in text
    assert value == pytest.approx(values["motor_inertia"][0])
    lines = tomllib.loads(finding.remedy.partition("in the drives file:\n")[2])
    assert lines == {"j": {"command_delay_s": 0.004, "known": ["command_delay"]}}
    narrow = seaid.identify(robot_of(urdf, HARD, None, 1e-3), log)
    assert values_of(narrow)["command_delay"][1] == pytest.approx(1e-3, rel=1e-3)


def test_a_stated_delay_stays_in_a_physically_consistent_fit(tmp_path: Path) -> None:
    """A friction that would be negative moves to zero, and no delay of the bus with it."""
    both = slowly_off(joined([mujoco_log(HARD, 0.0, 0.0, seed) for seed in (1, 2)]))
    found = seaid.identify(two_joints(tmp_path, (0.015, 0.015), HARD), both, feasible=True)
    side = found.load_side
    assert side.value("viscous_friction of j0") < 0
    for joint, drive in found.robot.drives.items():
        assert drive.values["viscous_friction"] >= 0
        assert drive.command_delay_s == pytest.approx(0.015, abs=1e-7)
        assert side.value(f"command_delay of {joint}") == pytest.approx(0.015, abs=1e-9)
        assert side.standard_error(f"command_delay of {joint}") == pytest.approx(
            0.0125 / 1.96, rel=1e-3
        )


def test_an_unknown_delay_is_in_the_error_of_the_armature(urdf: Path) -> None:
    """To first order a delay T adds (K_d + F_v) T to the armature."""
    log = mujoco_log(SOFT, 0.0, 1e-4, 0)
    exact = values_of(seaid.identify(robot_of(urdf, SOFT, 0.0), log))
    late = values_of(seaid.identify(robot_of(urdf, SOFT, 1e-3), log))
    unsure = values_of(seaid.identify(robot_of(urdf, SOFT, 0.0, std_s=1e-3), log))
    change = late["motor_inertia"][0] - exact["motor_inertia"][0]
    assert change == pytest.approx(-(SOFT[1] + TRUTH["viscous_friction"]) * 1e-3, rel=0.1)
    for name in ("viscous_friction", "motor_inertia"):
        change = late[name][0] - exact[name][0]
        added = np.sqrt(unsure[name][1] ** 2 - exact[name][1] ** 2)
        assert added == pytest.approx(abs(change), rel=0.05), name
        assert unsure[name][0] == pytest.approx(exact[name][0], rel=1e-6)


@pytest.mark.slow  # 1.9 s
@pytest.mark.findings
def test_a_residual_that_follows_the_position_is_said(urdf: Path) -> None:
    """The finding names the term and the reference position; with it, the slope is the true one."""
    log = mujoco_log(SOFT, 0.004, 2e-4, 0, slope=0.25)
    robot = robot_of(urdf, SOFT, 0.004)
    (finding,) = (x for x in seaid.identify(robot, log).warnings if x.code == "missing-term")
    assert finding.severity == "doubtful"
    middle = f"{0.5 * (log.joint_position.min() + log.joint_position.max()):.2g}"
    assert f'"coulomb_position"]\nreference_position_rad = {middle}' in finding.remedy
    selection = seaid.compare_terms(robot, log)
    assert selection.recommended == {"j": (("friction", "coulomb_position"),)}
    assert selection.robot.drives["j"].reference_position_rad == float(middle)
    found = seaid.identify(selection.robot, log)
    assert not [x for x in found.warnings if x.code == "missing-term"]
    values = values_of(found)
    level = TRUTH["coulomb_friction"] + 0.25 * float(middle)
    assert values["coulomb_friction"][0] == pytest.approx(level, rel=0.02)
    assert values["coulomb_position_slope"][0] == pytest.approx(0.25, rel=0.03)
    assert abs(values["coulomb_position_curvature"][0]) < 0.03
    spring = mujoco_log(SOFT, 0.004, 2e-4, 0, stiffness=2.0)
    (finding,) = (x for x in seaid.identify(robot, spring).warnings if x.code == "missing-term")
    assert 'parallel_spring = ["linear"]' in finding.remedy
    plain = seaid.identify(robot, mujoco_log(SOFT, 0.004, 2e-4, 0))
    assert not [x for x in plain.warnings if x.code == "missing-term"]


@pytest.mark.slow  # simulations of 4 to 8 s
@pytest.mark.parametrize(
    ("truth", "factor"),
    [
        ({"command_delay": 0.01}, dict.fromkeys(TRUTH, 1.1)),
        # a regression may find a negative armature, with which nothing can be simulated
        ({"command_delay": 0.004}, {"motor_inertia": -40.0}),
        ({"command_delay": 0.004, "parallel_stiffness": 2.0}, {"parallel_stiffness": 1.2}),
    ],
    ids=["all wrong", "negative", "parallel spring"],
)
def test_refine_closes_the_loop(
    urdf: Path, truth: dict[str, float], factor: dict[str, float]
) -> None:
    """From wrong values the output error ends at the truth, within its intervals."""
    stiffness = truth.get("parallel_stiffness", 0.0)
    log = mujoco_log(HARD, truth["command_delay"], 5e-4, 0, stiffness=stiffness)
    robot = robot_of(urdf, HARD)
    drive = replace(robot.drives["j"], parallel_spring=("linear",) if stiffness else ())
    start = seaid.identify(robot.with_drives({"j": drive}), log.between(1.0, 9.0))
    factors = [factor.get(str(name).removesuffix(" of j"), 1.0) for name in start.load_side.names]
    side = replace(start.load_side, values=np.array(factors) * start.load_side.values)
    found = seaid.refine(replace(start, load_side=side), log.between(1.0, 9.0))
    values = values_of(found)
    for name, true in {**TRUTH, **truth}.items():
        value, error = values[name]
        assert abs(value - true) < 3 * error + 0.004 * true, name
        assert error < 0.05 * true, name
    other = mujoco_log(HARD, truth["command_delay"], 0.0, 1, stiffness=stiffness)
    other = other.between(9.0, 11.0)
    left = seaid.replay(found.robot, other).joint_position - other.joint_position
    assert np.std(left) < 2e-3 * np.std(other.joint_position)
    assert found.drives["j"].value("motor_inertia") == values["motor_inertia"][0]


def test_positions_over_a_gap_are_not_residuals(urdf: Path) -> None:
    """Positions on the line between the ends of a gap once counted as measured."""
    log = mujoco_log(HARD, 0.01, 5e-4, 0).between(1.0, 5.0)
    log = log.at((log.time < 3.0) | (log.time > 3.05))
    start = seaid.identify(robot_of(urdf, HARD), log)
    (log_residuals,) = commanded_point(start, [log]).logs
    residuals = log_residuals.residuals
    over = (residuals.time > 3.0) & (residuals.time < 3.05)
    assert np.any(over)
    assert not np.any(residuals.kept[over])
    later = residuals.time > 3.1
    assert np.all(residuals.kept[later])


@pytest.mark.slow  # 1.1 s
@pytest.mark.findings
def test_refine_returns_its_start_where_the_search_stops_far_from_an_optimum(
    urdf: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The covariance of a point that is no optimum would be that of the noise alone."""
    log = mujoco_log(HARD, 0.01, 5e-4, 0).between(1.0, 5.0)
    right = seaid.identify(robot_of(urdf, HARD), log)
    side = replace(right.load_side, values=1.1 * right.load_side.values)
    monkeypatch.setattr("seaid.estimation.nonlinear_least_squares._improved", lambda *_: None)
    found = seaid.refine(replace(right, load_side=side), log)
    np.testing.assert_array_equal(found.load_side.values, side.values)
    np.testing.assert_array_equal(found.load_side.covariance, right.load_side.covariance)
    (finding,) = (x for x in found.warnings if x.code == "worse-than-start")
    assert finding.evidence["standard errors"] > 3.0
    near = seaid.refine(right, log)  # a search may end where the regression is right
    assert "worse-than-start" not in {x.code for x in near.warnings}


@pytest.mark.parametrize("delay_s", [0.0, 0.0025, 0.0041, 0.007])
def test_commands_between_samples_are_those_of_straight_lines(urdf: Path, delay_s: float) -> None:
    """The lines through samples of a sinusoid have the gain sinc(f dt)^2 at its frequency."""
    robot, frequency_hz = robot_of(urdf, SOFT, delay_s), 4.0
    wave = np.sin(2 * np.pi * frequency_hz * TIME)
    log = replace(log_of(np.zeros(len(TIME))), position_command=wave[:, None])
    torque, _ = commanded_torque(robot, log.time, dict(log.sensors()), 80.0)
    inner = slice(1000, 3000)  # 40 periods
    turning = np.exp(-2j * np.pi * frequency_hz * (TIME[inner] - delay_s))
    gain = 2j * np.mean(torque[inner, 0] * turning) / SOFT[0]
    assert gain == pytest.approx(np.sinc(frequency_hz * 0.005) ** 2, abs=2e-5)


@pytest.mark.slow  # 0.8 s
def test_the_ends_of_a_moving_log_have_no_weight(urdf: Path) -> None:
    """Without noise and dry friction nothing but rounding is left, wherever the log is cut."""
    robot = robot_of(urdf, SOFT, 0.0025)
    drive = replace(robot.drives["j"], friction=("viscous",))
    truth = replace(drive, motor_inertia_kg_m2=0.0243, viscous_friction_Nms_per_rad=0.12)
    plan = replace(log_of(CHIRP), position_command=CHIRP[:, None]).between(12.0, 17.9)
    log = replace(
        rollout(robot.with_drives({"j": truth}), plan, longest_closed_s=1.25e-3),
        position_command=plan.position_command,
        motor_position=plan.motor_position,
        motor_torque=plan.motor_torque,
    )
    values = values_of(seaid.identify(robot.with_drives({"j": drive}), log))
    assert values["viscous_friction"][0] == pytest.approx(0.12, rel=2e-4)
    assert values["motor_inertia"][0] == pytest.approx(0.0243, rel=2e-4)


@pytest.mark.slow  # 10 simulations of 4 s
def test_refine_keeps_a_delay_that_is_as_stated(urdf: Path) -> None:
    """Its range is in the error of the armature, as it is in that of `identify`."""
    log = slowly_off(mujoco_log(HARD, 0.006, 0.0, 0).between(1.0, 5.0), 0.0)
    start = seaid.identify(robot_of(urdf, HARD), log)
    found = seaid.refine(start, log)
    before, after = values_of(start), values_of(found)
    assert after["command_delay"] == pytest.approx(before["command_delay"], abs=1e-9)
    slope = (HARD[1] + after["viscous_friction"][0]) * 0.0125 / 1.96
    assert after["motor_inertia"][1] > 0.8 * slope


def test_refine_needs_stiff_drives_with_commands(urdf: Path) -> None:
    robot, log = robot_of(urdf, SOFT), mujoco_log(SOFT, 0.0, 0.0, 0)
    found = seaid.identify(robot, log)
    elastic = seaid.SeriesElasticDrive(
        gear_ratio=9.0, motor_input="position_command", controller=robot.drives["j"].controller
    )
    with pytest.raises(IdentificationError, match="all drives have to be stiff, with a position"):
        seaid.refine(replace(found, known=robot.with_drives({"j": elastic})), log)


@pytest.mark.slow  # 0.9 s
def test_a_spring_behind_a_position_controller(urdf: Path) -> None:
    """Its stiffness and the delay come from positions and commands alone."""
    controller = seaid.Controller(
        position_gain_Nm_per_rad=60.0, velocity_gain_Nms_per_rad=2.0, torque_limit_Nm=50.0
    )
    given = seaid.SeriesElasticDrive(
        gear_ratio=50.0,
        motor_inertia_kg_m2=2e-5,
        stiffness_Nm_per_rad=150.0,
        viscous_friction_Nms_per_rad=2e-4,
        coulomb_friction_Nm=4e-3,
        motor_input="position_command",
        controller=controller,
        command_delay_s=0.004,
        nominal={"spring_offset": 0.0},
    )
    true = seaid.load_robot(urdf, {"j": given}, known_bodies=["arm"])
    plan = log_of(np.zeros(len(TIME)))
    plan = replace(plan, motor_position=np.zeros((len(TIME), 1))).between(0.0, 5.0)
    log = replace(
        seaid.replay(true, plan),
        position_command=plan.position_command,
        motor_torque=np.full_like(plan.motor_torque, np.nan),
    )
    found = seaid.identify(true.without_nominal(), log)
    assert found.drives["j"].value("stiffness") == pytest.approx(150.0, rel=0.01)
    assert found.drives["j"].value("command_delay") == pytest.approx(0.004, abs=2e-4)


LIMIT = 3.3
"""Torque limit of the models in MuJoCo [N m], which their motion hits; the arm weighs 2.9 N m."""


@pytest.mark.slow  # 3.5 s
@pytest.mark.parametrize(
    ("kind", "speed", "delay_s"),
    [
        *(
            (kind, *case)
            for kind in ("stiff", "elastic")
            for case in ((np.inf, 0.01), (np.inf, 0.0), (4.0, 0.01))
        ),
        ("velocity", np.inf, 0.0),
    ],
)
def test_mujoco_moves_the_exported_model_as_the_replay(
    urdf: Path, tmp_path: Path, kind: str, speed: float, delay_s: float
) -> None:
    """Controller, torque limit, that of a motor too, delay and friction offset are in the model.

    The actuator of a velocity controller takes the velocity that the log has as a command.
    """
    is_elastic, of_velocity = kind == "elastic", kind == "velocity"
    law: dict[str, Any] = {**(RATES if of_velocity else dict(zip(GAINS, SOFT, strict=True)))}
    values: dict[str, Any] = {
        "gear_ratio": 9.0,
        "motor_inertia_kg_m2": 3e-4,
        "viscous_friction_Nms_per_rad": 1.5e-3,
        "coulomb_friction_Nm": 1e-4,
        "motor_input": "velocity_command" if of_velocity else "position_command",
        "command_delay_s": delay_s,
        "controller": seaid.Controller(**law, torque_limit_Nm=LIMIT, no_load_speed_rad_per_s=speed),
    }
    drive: seaid.StiffDrive | seaid.SeriesElasticDrive = seaid.StiffDrive(
        friction=("viscous", "coulomb", "offset"), nominal={"friction_offset": 0.02}, **values
    )
    if is_elastic:
        drive = seaid.SeriesElasticDrive(stiffness_Nm_per_rad=80.0, **values)
    robot = seaid.load_robot(urdf, {"j": drive})
    sent = {"velocity_command": np.gradient(CHIRP, TIME)} if of_velocity else {}
    log = log_of(np.zeros(len(TIME)), **sent).between(0.0, 3.0)
    log = replace(log, motor_position=np.zeros((len(log.time), 1)))
    expected = seaid.replay(robot, log).joint_position[:, 0]
    written = seaid.write_mjcf(robot, tmp_path / "one.xml")
    late = ", with a delay of 10 ms" if delay_s else "; MuJoCo holds it for a step: give that of "
    name = "velocity" if of_velocity else "position"
    assert any(f"the control of j is the commanded {name}{late}" in x for x in written.notes)
    text = (tmp_path / "one.xml").read_text()
    assert ("<dcmotor" in text) == np.isfinite(speed)
    assert ("a dcmotor, as MuJoCo has it since 3.12" in text) == np.isfinite(speed)
    model = mujoco.MjModel.from_xml_string(text)
    assert model.nu == 1
    parts = round(0.005 / model.opt.timestep)
    assert parts * model.opt.timestep == pytest.approx(0.005)
    ticks = (np.arange(parts * len(log.time)) + 0.5 * (delay_s == 0)) * model.opt.timestep
    sizes = np.empty(len(ticks))

    def measure(tick: int, data: mujoco.MjData) -> None:
        """Note the force of the step before, in parts of its limit."""
        force, joint_speed = data.actuator_force[0], data.qvel[0]
        most = LIMIT * min(1.0, 1 - math.copysign(1.0, force) * joint_speed / speed)
        sizes[tick] = abs(force) * (9.0 if is_elastic and np.isinf(speed) else 1.0) / most

    commands = np.interp(ticks, TIME, sent.get("velocity_command", CHIRP))
    error = stepped(model, commands, parts, measure) - expected
    assert of_velocity or np.sum(sizes > 0.95) > 0.02 * len(ticks)
    assert np.max(np.abs(error)) < 5e-3 * np.ptp(expected)


def test_what_a_motor_of_mujoco_cannot_be_is_said(urdf: Path, tmp_path: Path) -> None:
    """It has no constant torque, and an early command is none; 1e-13 s are rounding."""
    law = seaid.Controller(
        position_gain_Nm_per_rad=40.0,
        torque_limit_Nm=6.0,
        no_load_speed_rad_per_s=5.0,
        feedforward_Nm=1.0,
    )
    truth = robot_of(urdf, SOFT).drives["j"].with_values({**TRUTH, "friction_offset": 0.0})
    for delay_s, words in ((-0.002, "it would act 2 ms early, which no model can"), (1e-13, "")):
        drive = replace(truth, controller=law, command_delay_s=delay_s)
        robot = seaid.load_robot(urdf, {"j": drive})
        notes = " ".join(seaid.write_mjcf(robot, tmp_path / "one.xml").notes)
        assert "excluded: its torque limit falls with the speed, to zero at 5, and is con" in notes
        assert ("early" in notes) == bool(words)
        assert words in notes
        assert "dcmotor" not in (tmp_path / "one.xml").read_text().partition("<mujoco")[2]


def test_identifiability_says_what_a_gain_set_determines(urdf: Path) -> None:
    soft, hard = robot_of(urdf, SOFT), robot_of(urdf, HARD)
    (text,) = seaid.identifiability(soft).commands
    assert "armature + 1 T and viscous friction + 40 T" in text
    assert "uncertain by 0.013 and 0.5 for T within 12.5 ms" in text
    assert "another gain set separates them" in text
    assert text in " ".join(str(seaid.identifiability(soft)).split())
    (both,) = seaid.identifiability(soft, conditions=[hard]).commands
    assert "these 2 gain sets separate them" in both
    assert "armature + 3 T and viscous friction + 20 T" in both
    assert seaid.identifiability(robot_of(urdf, SOFT, 0.004)).commands == ()
    (known,) = seaid.identifiability(robot_of(urdf, SOFT, 0.004, 0.002)).commands
    assert "within 3.92 ms" in known


SHORT = TIME[:2000]
REFERENCE = 0.4 * np.sin(2 * np.pi * (0.1 * SHORT + 0.12 * SHORT**2)) + 0.2 * np.sin(2.3 * SHORT)
RATE = 2.5 * np.cos(2 * np.pi * (0.1 * SHORT + 0.12 * SHORT**2)) + 0.8 * np.cos(2.3 * SHORT)
GRAVITY = -1.5 * 9.81 * 0.2 * np.cos(REFERENCE)
"""Feed-forward torque [N m] of a controller that compensates gravity about the y axis."""
SUPPLY = 24.0 - 3.0 * SHORT / SHORT[-1] - 1.5 * np.abs(np.sin(1.1 * SHORT))
"""Voltage [V] of a battery that sags."""
DELAY_S = 0.006
PLAIN = {"position_gain_Nm_per_rad": 40.0, "velocity_gain_Nms_per_rad": 1.0}
FED = {**PLAIN, "command_velocity_gain_Nms_per_rad": 1.0}
RATES = {"velocity_gain_Nms_per_rad": 6.0, "command_velocity_gain_Nms_per_rad": 6.0}
REFERENCES = {"position_command": REFERENCE}
ALL = {**REFERENCES, "velocity_command": np.gradient(REFERENCE, SHORT), "torque_command": GRAVITY}

LAWS: dict[str, tuple[dict[str, Any], dict[str, Array]]] = {
    "held": ({**PLAIN, "is_held": True}, REFERENCES),
    "velocity of the command": (FED, REFERENCES),
    "constant": ({**PLAIN, "feedforward_Nm": 2.5}, REFERENCES),
    "speed": ({**PLAIN, "torque_limit_Nm": 7.0, "no_load_speed_rad_per_s": 9.0}, REFERENCES),
    "all commands": (FED, ALL),
    "velocity alone": (RATES, {"velocity_command": RATE}),
    "supply": (
        {**FED, "nominal_supply_V": 24.0, "is_duty": True},
        {**ALL, "supply_voltage": SUPPLY},
    ),
}
"""{law: its gains, and what the log has}."""


def driven_log(law: str) -> seaid.Log:
    """Return the log of MuJoCo's plant under a law, with noise of the encoder."""
    gains, sent = LAWS[law]
    position = driven(seaid.Controller(**gains), sent, SHORT, DELAY_S, sent.get("supply_voltage"))
    noise = 5e-5 * np.random.default_rng(1).normal(size=len(SHORT))
    return log_of(position + noise, SHORT, **sent)


@pytest.mark.parametrize("law", quick_only(LAWS, ["held"]))  # 1 s each
def test_parameters_behind_any_law_of_a_controller(urdf: Path, law: str) -> None:
    """The plant is MuJoCo's; without the terms of the law the values are others."""
    robot, log = robot_of(urdf, LAWS[law][0]), driven_log(law)
    found = seaid.identify(robot, log)
    truths = {**TRUTH, "command_delay": DELAY_S}

    def errors(estimated: seaid.Identification) -> list[float]:
        values = values_of(estimated)
        far = [abs(values[name][0] / truth - 1) for name, truth in truths.items()]
        return [*far, abs(values["friction_offset"][0])]

    assert max(errors(found)[:-2]) < 0.02
    assert errors(found)[-2] * DELAY_S < 3e-4
    assert errors(found)[-1] < 0.02
    if law != "velocity alone":
        plain = log_of(log.joint_position[:, 0], SHORT, **REFERENCES)
        assert max(errors(seaid.identify(robot_of(urdf, PLAIN), plain))) > 0.06
    short = log.between(0, 4)
    error = seaid.replay(found.robot, short).joint_position - short.joint_position
    assert np.sqrt(np.mean(error**2)) < {"velocity alone": 5e-3, "all commands": 2e-4}.get(
        law, 1.5e-3
    )


@pytest.mark.parametrize(
    ("supply_V", "words"),
    [
        (None, r"has nominal_supply_V, and the log has no column 'j\.supp"),
        (
            np.where(np.arange(len(SHORT)) == 100, -1.0, SUPPLY),
            r"is -1 V at 0\.5 s: it must be more than zero",
        ),
    ],
)
def test_a_supply_that_cannot_be_is_refused(urdf: Path, supply_V: Array | None, words: str) -> None:
    """A duty cycle is a torque by the voltage of the supply alone."""
    sent = ALL if supply_V is None else {**ALL, "supply_voltage": supply_V}
    with pytest.raises(LogError, match=words):
        seaid.identify(robot_of(urdf, LAWS["supply"][0]), log_of(REFERENCE, SHORT, **sent))


def test_the_limit_of_a_motor_falls_with_supply_and_speed(urdf: Path) -> None:
    """The torque is limit (supply over nominal - speed over no-load speed), by its formula."""
    gains = {"position_gain_Nm_per_rad": 100.0, "torque_limit_Nm": 4.0, "nominal_supply_V": 24.0}
    robot = robot_of(urdf, {**gains, "no_load_speed_rad_per_s": 10.0})
    sent = {"position_command": np.sin(SHORT) + 1.0, "supply_voltage": np.full_like(SHORT, 18.0)}
    log = log_of(np.sin(SHORT), SHORT, **sent)
    torque = commanded_torque(robot, SHORT, log.sensors())[0][:, 0]
    expected = 4.0 * np.clip(0.75 - np.cos(SHORT) / 10.0, 0.0, 0.75)
    np.testing.assert_allclose(torque[5:-5], expected[5:-5], atol=1e-4)


@pytest.mark.slow  # 0.7 s
@pytest.mark.findings
def test_a_velocity_command_that_the_law_does_not_use_is_named(urdf: Path) -> None:
    """The remedy has the gain of the plant."""
    sent = {name: ALL[name] for name in ("position_command", "velocity_command")}
    log = log_of(driven_log("all commands").joint_position[:, 0], SHORT, **sent)
    checks = seaid.check(robot_of(urdf, PLAIN), log).warnings
    (finding,) = (one for one in checks if one.code == "unused-command")
    assert "command_velocity_gain_Nms_per_rad = 1" in finding.remedy


SCALE = 0.4
"""N m per unit of the drive."""


def in_units_of_the_drive(robot: seaid.Robot, **changes: Any) -> seaid.Robot:
    """Return a robot whose gains are in units of the drive, of SCALE N m each."""
    drive = robot.drives["j"]
    assert drive.controller is not None
    law = replace(drive.controller.times(1 / SCALE), is_up_to_scale=True)
    return robot.with_drives({"j": replace(drive, controller=law, **changes)})


@pytest.mark.slow  # 1.2 s
@pytest.mark.findings
def test_gains_in_units_of_the_drive(urdf: Path) -> None:
    """A known arm gives their scale, a rotor inertia does not; all are multiples without it."""
    log = mujoco_log(SOFT, 0.012, 2e-4, 0)
    robot = robot_of(urdf, SOFT)
    found = seaid.identify(in_units_of_the_drive(robot), log)
    values = values_of(found)
    assert values["gain_scale"][0] == pytest.approx(SCALE, rel=5e-3)
    assert values["command_delay"][0] == pytest.approx(0.012, abs=1e-4)
    for name, truth in TRUTH.items():
        assert values[name][0] == pytest.approx(truth, rel=0.01), name
    assert not [x for x in found.warnings if x.code == "gain-scale"]
    law = found.robot.drives["j"].law
    assert law is not None
    assert law.position_gain_Nm_per_rad == pytest.approx(SOFT[0], rel=5e-3)
    assert not law.is_up_to_scale
    moved = seaid.replay(found.robot, log.between(2.0, 4.0)).joint_position
    error = moved - log.between(2.0, 4.0).joint_position
    assert np.std(error) < 3e-3 * np.std(moved)
    bare = seaid.load_robot(urdf, robot.drives)
    rotor = in_units_of_the_drive(bare, motor_inertia_kg_m2=TRUTH["motor_inertia"])
    assert "gain_scale of j" in sum(seaid.identifiability(rotor).ratios, ())
    assert "gain_scale of j" in seaid.identifiability(in_units_of_the_drive(robot)).identifiable
    free = seaid.identify(in_units_of_the_drive(bare), log)
    (finding,) = (x for x in free.warnings if x.code == "gain-scale")
    assert finding.severity == "doubtful"
    for name in ("viscous_friction", "coulomb_friction"):
        multiple = values_of(free)[name][0] * SCALE
        assert multiple == pytest.approx(TRUTH[name], rel=0.01), name
    assert values_of(free)["command_delay"][0] == pytest.approx(0.012, abs=1e-4)
    assert "gain_scale" not in free.robot.drives["j"].known


@pytest.mark.slow  # 40 s of two joints that stick, in MuJoCo
@pytest.mark.filterwarnings("ignore:.*rounded angles")  # of a file that is not used
@pytest.mark.parametrize("friction", [0.1, 1.0])
def test_friction_that_holds_joints_at_reversals_does_not_bias_a_delay(
    tmp_path: Path, friction: float
) -> None:
    """Its direction at rest is not known: equations there are not in any row.

    With the sign of the speed the delay was 9.5 ms, and the viscous friction a sixth of the truth.
    """
    true, robot = commanded_arms.robots_of(tmp_path, friction)["two arms"]
    log = commanded_arms.log_of(true, 40.0, 1, tmp_path)
    found = seaid.identify(robot, log, cutoff_hz=3.5).robot
    for joint, drive in found.drives.items():
        truth = true.drives[joint].values
        assert {name: drive.values[name] for name in truth} == pytest.approx(truth, rel=0.01)


@pytest.mark.parametrize(
    ("inertia", "severity", "remedy"),
    [
        (0.06, "doubtful", "state the delay of the commands (command_delay_s"),
        (0.0295, "note", "zero is within three standard errors: state it as zero (known)"),
    ],
)
def test_a_negative_armature_has_a_remedy(inertia: float, severity: str, remedy: str) -> None:
    """The inertia of the link in the robot file exceeds that of link and rotor."""
    names = ("viscous_friction", "motor_inertia", "command_delay")
    values = np.array([0.1, TRUTH["motor_inertia"] - inertia, 0.0])
    side = Estimate(
        ParameterName.all_of(names), values, np.diag([1e-2, 2e-3, 1e-3]) ** 2, ("",) * 3, 1.0, 1.0
    )
    (finding,) = [x for x in drive_findings("j", side, None) if x.code == "negative-parameter"]
    assert finding.severity == severity
    assert finding.remedy.startswith(remedy)


def test_a_stated_delay_that_the_log_contradicts_is_said_and_estimated(urdf: Path) -> None:
    """It is off by 300 of its standard deviations, and these are none of the estimate."""
    drive = robot_of(urdf, SOFT, 0.003, std_s=1e-5).drives["j"]
    robot = robot_of(urdf, SOFT).with_drives({"j": replace(drive, known=())})
    found = seaid.identify(robot, mujoco_log(SOFT, 0.006, 1e-4, 0))
    value, error = values_of(found)["command_delay"]
    assert abs(value - 0.006) < 3 * error
    (finding,) = (x for x in found.findings if x.code == "delay")
    assert finding.severity == "doubtful"
    assert "act 6" in finding.message
    assert finding.message.endswith("command_delay_s states 3 +- 0.02 ms")
    (line,) = (x for x in finding.remedy.splitlines() if x.startswith("command_delay_s"))
    assert float(line.partition("=")[2]) == pytest.approx(value, rel=1e-3)
    assert not found.robot.drives["j"].std


def test_the_delay_of_a_bus_is_said_to_be_shared(tmp_path: Path) -> None:
    both = joined([mujoco_log(SOFT, 0.004, 1e-4, seed) for seed in (1, 2)])
    (delay,) = seaid.identify(two_joints(tmp_path, (None, None)), both).shared
    assert (delay.name, delay.joints) == ("command_delay of bus of j0", ("j0", "j1"))
    np.testing.assert_allclose(delay.values, 0.004, atol=3e-4)


def test_drives_of_a_bus_that_state_different_deviations_are_refused(tmp_path: Path) -> None:
    """Both may be of one delay, with one deviation, or of two."""
    robot, both = two_joints(tmp_path, (None, None)), joined([log_of(CHIRP), log_of(CHIRP)])
    wide = replace(robot.drives["j1"], std={"command_delay_s": 1e-3})
    with pytest.raises(RobotError, match=r"\[j0\] and \[j1\].* 0.00638 and 0.001 s"):
        seaid.identify(robot.with_drives({"j1": wide}), both)
    check_buses({**robot.drives, "j1": replace(wide, command_delay_s=0.002)})
