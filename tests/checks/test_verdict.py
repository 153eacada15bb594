"""What of a log no equation uses is noted; torques that no model explains are named."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import seaid
from seaid.checks import CODES, JointFit
from seaid.checks.values import noise_findings, regression_notes, unused_findings
from seaid.checks.verdict import RobotFit, _blocks, fit_findings, verdict_of
from seaid.estimation import FittedRows
from seaid.estimation.least_squares import ordinary
from seaid.estimation.qr_factor import qr_factor_of
from seaid.export import content_of
from seaid.identification.problem import Method
from seaid.legged import load_robot
from seaid.log import Log
from seaid.simulation.simulation import measure
from tests.experiments import LEG_SENSORS, TEST_MASS, leg, leg_motion, true_value
from tests.experiments import leg_log as loaded_leg_log
from tests.mistakes import with_channels
from tests.plants import log_with, regression, write_robot
from tests.representatives import quick_first


def leg_log(seed: int = 1) -> Log:
    return measure(leg(), leg_motion(), LEG_SENSORS, seed)


def with_sensed_torque(joint: str, *, only: bool) -> Log:
    """Return the leg's log with the measured torque of a joint too, or `only` with this."""
    log, motion, index = leg_log(), leg_motion(), leg().index(joint)
    sensed, motor = np.full_like(log.joint_position, np.nan), log.motor_torque.copy()
    noise = 0.1 * np.random.default_rng(0).normal(size=len(log.time))
    sensed[:, index] = motion.joint_torque[:, leg().index("knee_pitch")] + noise
    if only:
        motor[:, index] = np.nan
    return replace(log, joint_torque=sensed, motor_torque=motor)


def unused(found: seaid.Identification) -> tuple[seaid.Finding, ...]:
    """Return what of the log no equation uses."""
    joints = found.model.torque_joints
    return tuple(unused_findings(found.known, found.drives, joints, found.motions))


@pytest.mark.slow  # an identification of the leg and its checks
def test_friction_that_a_log_cannot_identify_and_a_channel_in_no_equation_are_said() -> None:
    found = seaid.identify(leg(), with_sensed_torque("knee_pitch", only=True))
    assert [str(one) for one in unused(found)] == [
        "the log has the joint torque of knee_pitch and not its motor torque, which alone would "
        "identify viscous friction, coulomb friction"
    ]
    assert set(unused(found)) < set(found.warnings)
    assert found.drives["knee_pitch"].names == ("stiffness", "spring_offset")
    for log in (leg_log(), with_sensed_torque("knee_pitch", only=False)):
        assert unused(seaid.identify(leg(), log)) == ()
    log = with_sensed_torque("hip_roll", only=False)
    log = replace(log, motor_current=20.0 * log.motor_torque)
    findings = unused(seaid.identify(leg(), log))
    assert {x.code for x in findings} == {"unused-channel"}
    assert [(x.joint, x.message.partition(" is in")[0]) for x in findings] == [
        ("", "the motor current of hip_yaw, hip_roll, hip_pitch, knee_pitch, ankle_pitch"),
        ("hip_roll", "the joint torque of hip_roll"),
    ]


@pytest.mark.slow  # 0.5 s
def test_a_torque_of_the_wrong_sign_is_named_where_no_spring_explains_it() -> None:
    """The stiffness of a spring that is not linear comes out negative."""
    log = with_channels(leg_log(), "knee_pitch", motor_torque=np.negative)
    drive: Any = leg().drives["knee_pitch"]
    values = {name: x for name, x in drive.nominal.items() if name != "stiffness"}
    spring = replace(drive, spring=("linear", "cubic"), nominal=values)
    robot = leg().with_drives({"knee_pitch": spring}).without_nominal()
    (worst, *_) = seaid.identify(robot, log).findings
    assert (worst.code, worst.severity, worst.joint) == ("sign", "wrong", "knee_pitch")


def pushed_log(size: float) -> Log:
    """Return the log of a leg that hands push at its knee all the time.

    The pushes are waves of `size` times the standard deviation of the torque of the joint.
    The spring carries the push too, with the angle, inertia and friction of the motor by (4), (7).
    """
    motion, j, drive = leg_motion(TEST_MASS), leg().index("knee_pitch"), leg().drives["knee_pitch"]
    waves = [np.sin(2 * np.pi * hz * motion.time + 5 * hz) for hz in (0.7, 1.1, 1.9)]
    push = size * np.std(motion.joint_torque[:, j]) * np.sum(waves, axis=0)
    gear, values = drive.motor_radius / drive.ratio, drive.values
    angle = push / (gear * values["stiffness"] * drive.load_radius)
    speed = np.gradient(angle, motion.time)
    before, after = motion.motor_velocity[:, j], motion.motor_velocity[:, j] + speed
    motor, torque = motion.motor_position.copy(), motion.motor_torque.copy()
    motor[:, j] += angle
    torque[:, j] += gear / drive.load_radius * push + values["viscous_friction"] * speed
    torque[:, j] += values["motor_inertia"] * np.gradient(speed, motion.time)
    torque[:, j] += values["coulomb_friction"] * (np.sign(after) - np.sign(before))
    pushed = replace(motion, motor_position=motor, motor_torque=torque)
    return measure(leg(TEST_MASS), pushed, LEG_SENSORS, 1)


def log_of_noise() -> Log:
    """Return the log of a leg whose torque of the hip's roll is noise."""
    rng = np.random.default_rng(0)
    return with_channels(
        loaded_leg_log(), "hip_roll", motor_torque=lambda x: np.std(x) * rng.normal(size=len(x))
    )


UNEXPLAINED: dict[str, tuple[Callable[[], Log], tuple[str, str], tuple[float, float]]] = {
    "do not use": (log_of_noise, ("hip_roll", "wrong"), (0.9, np.inf)),
    "do not use the load side of knee_pitch": (
        lambda: pushed_log(3.0),
        ("knee_pitch", "wrong"),
        (0.9, np.inf),
    ),
    "usable with care": (lambda: pushed_log(0.5), ("knee_pitch", "doubtful"), (0.5, 0.9)),
}
"""{verdict: the log, the joint that does not fit, and bounds of its error in excluded blocks}"""


@pytest.mark.slow  # an identification of the leg and its checks each
@pytest.mark.parametrize("verdict", UNEXPLAINED)
def test_torques_that_no_model_explains_are_named(verdict: str) -> None:
    """A load side that hands move is not to be used, and its drive is good."""
    log, joint, (low, high) = UNEXPLAINED[verdict]
    found = seaid.identify(leg(TEST_MASS), log())
    (finding,) = [one for one in found.warnings if one.code == "no-fit"]
    assert (finding.joint, finding.severity) == joint
    fit = found.joint_fits[finding.joint]
    assert low < fit.blocks < high
    assert found.verdict.sentence.startswith(verdict)
    assert verdict.startswith(found.verdict.level)
    if "load side" in verdict:
        knee, true = found.drives["knee_pitch"], true_value(leg(), "knee_pitch", "stiffness")
        assert abs(knee.value("stiffness") - true) < 4 * knee.standard_error("stiffness")
        assert "; its motor equation holds, with an error of " in finding.message
        assert found.verdict.sentence == f"{verdict}: no-fit; the drive of knee_pitch is good"
        assert content_of(found)["verdict"]["sentence"] in found.summary()
    if finding.severity == "doubtful":
        assert f"unexplained: {fit.own:.0%} of it in the own logs" in finding.message
        assert "a spring, the gear ratio or the rotor inertia" in finding.remedy


@pytest.mark.slow  # an identification of the leg and its checks
def test_errors_are_over_the_torque_of_all_bodies_and_not_of_the_payload_alone() -> None:
    """(8) knows the torque of the payload; in this motion the ankle carries little of it."""
    robot = leg(TEST_MASS)
    log = measure(robot, leg_motion(TEST_MASS, seed=101), LEG_SENSORS, 6)
    found = seaid.identify(robot.without_nominal(), log)
    fit = found.joint_fits["ankle_pitch"]
    assert max(fit.own, fit.blocks) < 0.04
    assert found.verdict.level == "good"


def in_currents(robot: seaid.Robot, log: Log) -> tuple[seaid.Robot, Log]:
    """Return a robot whose torque constants are unknown, and its log with currents."""
    drives = {x: replace(drive, motor_input="current") for x, drive in robot.drives.items()}
    unknown = np.full_like(log.motor_torque, np.nan)
    log = replace(log, motor_current=log.motor_torque / 0.05, motor_torque=unknown)
    return robot.with_drives(drives), log


@pytest.mark.slow  # an identification of two conditions, 2 s
def test_errors_of_currents_are_over_the_torque_of_all_bodies() -> None:
    """All that (8) knows is the torque of the payload, and nothing without it."""
    free = measure(leg(), leg_motion(), LEG_SENSORS, 1)
    logs = {
        "loaded": in_currents(leg(TEST_MASS), loaded_leg_log()),
        "free": in_currents(leg(), free),
    }
    found = seaid.identify_conditions(logs, condition_specific=()).identifications
    assert max(fit.own for fit in found["loaded"].joint_fits.values()) < 0.07
    assert max(found["free"].joint_fits[x].own for x in ("hip_yaw", "hip_roll")) < 0.13


def test_contacts_of_several_logs_have_their_own_times() -> None:
    """Of both together less than half of the windows are between the first and the last one."""
    rng, instants, starts_s = np.random.default_rng(0), 800, (4.0, 30.0)
    time = np.tile(0.05 * np.arange(instants), 2)
    run = np.repeat([0.0, 1.0], instants)
    H = rng.normal(size=(len(time), 2))
    after = time - np.array(starts_s)[run.astype(int)]
    y = H @ np.ones(2) + 0.1 * rng.normal(size=len(time)) + 3.0 * ((after > 0) & (after < 2.0))
    rows = regression(H, y, time=time, run=run)
    fit = FittedRows(ordinary(rows), qr_factor_of(rows), rows, None)
    whole = RobotFit(("knee",), fit, logs={0: 1, 1: 2})
    assert [contact.run for contact in whole.contacts] == [0, 1]
    for contact, start_s in zip(whole.contacts, starts_s, strict=True):
        assert contact.start_s <= start_s < start_s + 2.0 <= contact.end_s
        assert contact.end_s - contact.start_s < 3.0
        assert set(rows.run[contact.touches(rows)]) == {contact.run}
    remedies = [one.remedy for one in fit_findings(whole) if one.code == "contact"]
    assert [remedy.splitlines()[0] for remedy in remedies] == [
        "in the description of log 1:",
        "in the description of log 2:",
    ]
    # the law of a spring that a motor equation lacks looks like a contact
    notes = fit_findings(replace(whole, lacking={"knee"}))
    assert {(note.severity, note.remedy) for note in notes} == {("note", "")}


@pytest.mark.parametrize(("push", "times"), [(0.6, 0), (8.0, 1)])
def test_slow_motion_within_the_dry_friction_is_no_contact(push: float, times: int) -> None:
    """There the friction has any value up to that of its drive, 1 N m here."""
    rng, time = np.random.default_rng(0), np.linspace(0.0, 39.95, 800)
    is_slow = (time > 30.0) & (time < 32.0)
    speed = np.where(is_slow, 0.05, np.sin(time))
    H = np.column_stack([speed, np.sign(speed), rng.normal(size=len(time))])
    y = H @ (0.5, 1.0, 2.0) + 0.1 * rng.normal(size=len(time)) - push * is_slow
    names = ("viscous_friction of knee", "coulomb_friction of knee", "m")
    rows = regression(H, y, names=names, time=time)
    fit = FittedRows(ordinary(rows), qr_factor_of(rows), rows, None)
    assert len(RobotFit(("knee",), fit, logs={0: 1}).contacts) == times


def fitted(count: int, p: int, seed: int, alone: bool = False) -> FittedRows:
    """Return a fit of `count` independent rows, each logged 20 times; `alone`: one acts once."""
    rng = np.random.default_rng(seed)
    H = rng.normal(size=(count, p))
    if alone:
        H[:, 0] *= np.arange(count) == count // 3
        H[:, 1] = H[:, 0] + 0.02 * H[:, 1]
    y = H @ np.ones(p) + rng.normal(size=count)
    H, y = np.repeat(H, 20, axis=0), np.repeat(y, 20)
    rows = regression(H, y, time=np.arange(len(y), dtype=float))
    return FittedRows(ordinary(rows), qr_factor_of(rows), rows, None)


@pytest.mark.parametrize(("count", "p"), quick_first([(24, 16), (40, 4), (40, 16), (160, 16)], 2))
def test_independent_rows_are_counted_by_what_blocks_contradict(count: int, p: int) -> None:
    counts = [_blocks(fitted(count, p, seed))[1] for seed in range(20)]
    assert np.median(counts) == pytest.approx(count / p, rel=0.25)


def test_blocks_that_contradict_each_other_are_few_rows() -> None:
    fit = replace(fitted(24, 16, 0), rows=None)

    def findings(
        blocks: float, rows_per_parameter: float, predicted: float = 0.0
    ) -> list[seaid.Finding]:
        joints, errors = {"knee": JointFit(0.1, blocks)}, {"knee": predicted}
        given = RobotFit(
            ("knee",), fit, joints, rows_per_parameter=rows_per_parameter, predicted=errors
        )
        return [one for one in fit_findings(given) if one.code == "few-rows"]

    (few,) = findings(0.4, 1.2)
    assert few.severity == "doubtful"
    assert "only 1.2 independent rows per parameter" in few.message
    assert not findings(0.4, 7.5)
    (unclear,) = findings(0.4, 12.0, 0.3)
    assert "the torques of other motions have standard errors of 30% of them" in unclear.message
    assert not findings(0.4, 12.0, 0.05) + findings(0.4, 20.0, 0.3)
    # what an exact log leaves, and a model that does not fit, say nothing of their number
    assert not findings(1e-3, 1.2) + findings(1.5, 1.2)


def test_what_one_block_alone_determines_is_not_predicted_by_the_others() -> None:
    for seed in range(10):
        fit = fitted(160, 8, seed, alone=True)
        targets, rows_per_parameter = _blocks(fit)
        assert fit.rows is not None
        # the others have a 2500th of the information on the row that acts once
        error = np.std(fit.rows.y - targets)
        assert error < 1.3 * fit.estimate.residual_std
        assert rows_per_parameter == pytest.approx(20, rel=0.6)


def test_a_good_result_names_the_drives_with_parameters_that_are_not_determined() -> None:
    def sentence(*errors: float) -> str:
        findings = [
            CODES["poorly-identified"].finding(
                "error",
                f"joint_{place}",
                {"value": -2.0, "standard error": error, "name": "viscous", "reasons": "noise"},
            )
            for place, error in enumerate(errors)
        ]
        verdict = verdict_of(findings, {})
        assert verdict.level == "good"
        return verdict.sentence

    assert sentence(0.5) == sentence() == "good: no warning contradicts the set-up or the model"
    assert sentence(0.5, 2.0, 40.0).endswith(
        "but drives have errors of 100% and more: joint_1, joint_2"
    )


# A slow drift of motor torques

DRIFTING = ("hip_yaw", "knee_pitch")


def with_trend(trend_Nm: float, method: Method = "two-step") -> seaid.Identification:
    """Return the identification of the leg whose torques of two joints have a linear trend."""
    log = loaded_leg_log(5)
    ramp = np.linspace(-trend_Nm, trend_Nm, len(log.time))[:, None]
    drifts = np.array([joint in DRIFTING for joint in log.joint_names])
    log = replace(log, motor_torque=log.motor_torque + ramp * drifts)
    return seaid.identify(leg(TEST_MASS).without_nominal(), log, method=method)


@pytest.mark.slow  # 0.7 s
@pytest.mark.parametrize("method", quick_first(["two-step", "simultaneous"]))
def test_the_drifting_joints_are_named_and_have_its_errors(method: Method) -> None:
    drifting, steady = with_trend(2e-3, method), with_trend(0.0, method)
    assert {one.joint for one in drifting.warnings if one.code == "drift"} == set(DRIFTING)
    assert not any(one.code == "drift" for one in steady.warnings)
    for joint in (*DRIFTING, "hip_pitch") if method == "two-step" else ():
        ratio = drifting.drives[joint].standard_errors / steady.drives[joint].standard_errors
        friction = ratio[drifting.drives[joint].names.index("coulomb_friction")]
        assert friction > 1.5 if joint in DRIFTING else friction == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize(("share", "severity"), [(0.004, "note"), (0.02, "doubtful")])
def test_a_drift_of_a_small_part_of_the_torque_is_a_note(share: float, severity: str) -> None:
    """It is in the standard errors; what explains it is no more severe."""
    drift = SimpleNamespace(joint="knee", ratio=100.0, share=share, corner_hz=2.3)
    numbers = {"independent_rows": 100, "parameters": 1, "scatter": 1.0, "instruments": {}}
    diagnostics = SimpleNamespace(**numbers, growth=8.0, drifts=(drift,))
    (finding,) = noise_findings(SimpleNamespace(diagnostics=diagnostics))  # type: ignore[arg-type]
    assert (finding.code, finding.severity) == ("drift", severity)


@pytest.mark.parametrize(
    ("term", "action"),
    [("torque_offset", "seaid adds it"), ("coulomb_friction", "remove the term")],
)
def test_a_term_that_seaid_adds_itself_is_not_to_be_removed(term: str, action: str) -> None:
    checks: Any = SimpleNamespace(
        poorly_determined=(), terms=[SimpleNamespace(bic=-5.0, terms=[term])], whiteness={}
    )
    (finding,) = regression_notes("motor side of knee", "motor side", "knee", checks)
    assert finding.code == "needless-term"
    assert finding.message.endswith(f"(BIC -5); {action}")


def sprung_foot(folder: Path, one_sided: float, both_sides: float) -> seaid.Identification:
    """Return an identification of a foot of 0.9 kg that parallel springs [N m/rad] pull.

    The first one pulls beyond 0.05 rad only, and the drive declares a linear one.
    """
    m, c, inertia, g = 0.9, np.array([0.06, 0.0, -0.05]), 0.005, 9.81
    link = f'<inertial><origin xyz="0.06 0 -0.05"/><mass value="{m}"/><inertia ixx="{inertia}" '
    link += f'iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial>'
    joint = {"ankle": "revolute base foot <axis xyz='0 1 0'/>"}
    path = write_robot(folder / "foot.urdf", joint, link)
    drive = {"type": "stiff", "gear_ratio": 60.0, "parallel_spring": ["linear", "preload"]}
    robot = load_robot(path, {"ankle": {**drive, "friction": ["viscous", "coulomb"]}})
    time, rng = np.arange(0.0, 20.0, 0.004), np.random.default_rng(3)
    frequency, phase = np.linspace(0.15, 1.6, 7), rng.uniform(0, 2 * np.pi, 7)
    angle = 2 * np.pi * frequency * time[:, None] + phase
    sizes = 0.3 / frequency / np.linalg.norm(1 / frequency)
    q, a = np.sin(angle) @ sizes, -np.sin(angle) @ (sizes * (2 * np.pi * frequency) ** 2)
    speed = np.cos(angle) @ (sizes * 2 * np.pi * frequency)
    # gravity on the centre (x, z), turned about y by q
    gravity = -m * g * (c[0] * np.cos(q) + c[2] * np.sin(q))
    torque = (inertia + m * c @ c) * a + gravity + 0.1 * speed + 0.7 * np.sign(speed)
    torque += one_sided * np.maximum(q - 0.05, 0) + both_sides * q
    torque = torque / 60 + 1e-3 * rng.normal(size=len(time))
    log = log_with("ankle", time, joint_position=q, motor_position=60 * q, motor_torque=torque)
    return seaid.identify(robot, log)


@pytest.mark.parametrize("one_sided", [90.0, 0.0])
def test_bodies_and_a_spring_that_cancel_each_other_are_no_result(
    tmp_path: Path, one_sided: float
) -> None:
    """A spring that pulls on one side is near to what a heavy body and a linear spring leave."""
    found = sprung_foot(tmp_path, one_sided, 40.0)
    named = {finding.code for finding in found.findings if finding.severity != "note"}
    assert ("no-fit" in named) == (found.verdict.level != "good") == bool(one_sided)
