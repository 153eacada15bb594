"""Unknown motor constants: by the mass that a spring moves, or behind a locked output."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import seaid
from seaid._arrays import Array
from seaid.drives import SeriesElasticDrive, total_ratio
from seaid.errors import IdentificationError
from seaid.identification import identify
from seaid.legged import load_robot
from seaid.log import Log
from seaid.project import load_project, write_first_project
from seaid.project.first_project import _drives_text, filled, inferred_drives
from seaid.robot import Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure
from tests.experiments import arm, arm_motion, leg
from tests.mistakes import in_currents
from tests.plants import log_with, write_columns, write_robot
from tests.standard_errors import scores


@pytest.mark.usefixtures("estimates_only")
def test_the_rotor_inertias_of_other_joints_give_no_scale_to_noisy_currents() -> None:
    """An equation without a known torque gets a larger weight the closer all of it is to zero."""
    robot = arm().without_nominal()
    drives = {
        joint: replace(
            drive,
            motor_input="current",
            motor_inertia_kg_m2=None if drive.is_elastic else drive.motor_inertia_kg_m2,
        )
        for joint, drive in robot.drives.items()
    }
    noise = Noise(motor_resolution_rad=1e-3, joint_resolution_rad=1e-4, torque_std_Nm=0.01)
    log = measure(arm(), arm_motion(), noise, seed=0)
    log = in_currents(log, 0.05)
    words = "torque constant of shoulder is unidentifiable: only the current"
    with pytest.raises(IdentificationError, match=words):
        identify(robot.with_drives(drives), log)


# A horizontal axis: a motor with a current, a screw, and a spring in front of the carriage.


INERTIA = '<inertia ixx="{0}" iyy="{1}" izz="{1}" ixy="0" ixz="0" iyz="0"/>'
MASS_KG, SCREW_RAD_PER_M = 12.0, 2 * np.pi / 0.01
TRUTH = {
    "viscous_friction": 2e-4,
    "coulomb_friction": 0.05,
    "stiffness": 4e3,
    "motor_inertia": 6e-5,
    "torque_constant": 0.11,
}
TIME = np.arange(0, 40, 0.004)


@pytest.fixture(scope="module")
def urdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    body = f'<inertial><mass value="{MASS_KG}"/>{INERTIA.format(0.1, 0.1)}</inertial>'
    limit = '<limit lower="-0.5" upper="0.5" effort="800" velocity="2"/>'
    joint = f'prismatic frame carriage <axis xyz="1 0 0"/>{limit}'
    return write_robot(tmp_path_factory.mktemp("axis") / "axis.urdf", {"x_axis": joint}, body)


def robot_of(urdf: Path, ratio: float = 1.0) -> seaid.Robot:
    drive = seaid.SeriesElasticDrive(
        gear_ratio=ratio, motor_pulley_radius_m=1 / SCREW_RAD_PER_M, motor_input="current"
    )
    return seaid.load_robot(urdf, {"x_axis": drive}, known_bodies="all")


def signals(seed: int, noise: float) -> tuple[Array, Array, Array]:
    """Return motor angle, position and current of a multisine, from its analytic derivatives."""
    rng = np.random.default_rng(seed)
    q = np.zeros((5, len(TIME)))  # the position and its derivatives
    for k in range(1, 11):
        w, phase = 2 * np.pi * k / 10, rng.uniform(0, 2 * np.pi)
        for order in range(5):
            q[order] += 0.03 * w**order * np.sin(w * TIME + phase + order * np.pi / 2)
    stiffness, N = TRUTH["stiffness"], SCREW_RAD_PER_M
    force = MASS_KG * q[2]
    angle, speed, rate = (N * (q[i] + MASS_KG * q[i + 2] / stiffness) for i in range(3))
    torque = TRUTH["motor_inertia"] * rate + TRUTH["viscous_friction"] * speed + force / N
    current = (torque + TRUTH["coulomb_friction"] * np.sign(speed)) / TRUTH["torque_constant"]
    encoder, scale, sensor = rng.normal(size=(3, len(TIME))) * noise
    return angle + 1e-3 * encoder, q[0] + 1e-6 * scale, current + 0.02 * sensor


def log_of(seed: int, noise: float) -> seaid.Log:
    angle, position, current = signals(seed, noise)
    columns = {"joint_position": position, "motor_position": angle, "motor_current": current}
    return replace(log_with("x_axis", TIME, **columns), is_prismatic=(True,))


@pytest.mark.slow  # 1.7 s
@pytest.mark.usefixtures("estimates_only")
def test_the_constant_has_the_error_of_the_spring_that_it_is_found_with(urdf: Path) -> None:
    """Scores of all values; without the error of the spring in (7) that of the constant is 2500."""
    found = [seaid.identify(robot_of(urdf), log_of(seed, 1.0)) for seed in range(12)]
    draws = [scores(one.drives["x_axis"], TRUTH) for one in found]
    sizes = np.sqrt(np.mean(np.square(draws), axis=0))
    assert np.max(sizes) < 1.5
    assert np.min(sizes) > 0.35


@pytest.mark.parametrize("ratio", [1.0, 1.002])
def test_the_ratio_of_a_spring_comes_from_an_unscaled_current(urdf: Path, ratio: float) -> None:
    one = seaid.check(robot_of(urdf, ratio), log_of(1, 1.0)).joints["x_axis"]
    assert abs(one.gear_ratio - 1) < 3 * one.gear_ratio_error < 1.2e-3


def test_the_first_project_of_an_axis_with_a_screw_and_a_spring(urdf: Path, tmp_path: Path) -> None:
    angle, position, current = signals(2, 1.0)
    columns = {
        "Timestamp (s)": TIME,
        "x_axis motor pos [rev]": angle / (2 * np.pi),
        "x_axis scale [mm]": 1e3 * position,
        "x_axis motor current [A]": current,
    }
    write_columns(tmp_path / "run.csv", columns, "%.9g")
    made = write_first_project(urdf, [tmp_path / "run.csv"], folder=tmp_path / "p")
    assert any(one.startswith("x_axis: motor_pulley_radius_m = 0.0015") for one in made.doubts)
    drive = load_project(tmp_path / "p").robot().drives["x_axis"]
    assert isinstance(drive, seaid.SeriesElasticDrive)
    radius, error = drive.motor_pulley_radius_m, drive.std["motor_pulley_radius_m"]
    assert radius is not None
    assert abs(radius - 1 / SCREW_RAD_PER_M) < 3 * error < 1.5e-3 * radius


def bench_urdf(folder: Path, kind: str = "revolute") -> Path:
    body = '<inertial><origin xyz="0.2 0 0"/><mass value="1.0"/>'
    body += f"{INERTIA.format(0.001, 0.02)}</inertial>"
    limit = '<limit lower="-2" upper="2" effort="100" velocity="5"/>'
    joints = {"elbow": f'{kind} base arm <axis xyz="0 1 0"/>{limit}'}
    return write_robot(folder / "bench.urdf", joints, body)


K, N, ROTOR, VISCOUS, COULOMB, K_T = 300.0, 100.0, 5e-5, 1e-4, 0.02, 0.05
TRUE = {
    "stiffness": K,
    "motor_inertia": ROTOR,
    "viscous_friction": VISCOUS,
    "coulomb_friction": COULOMB,
}
RATE_HZ, STEPS = 1000, 4


@cache
def bench_log() -> Log:
    """Return a bench under a position controller, integrated here, at the rate of its encoder."""
    time = np.arange(0.0, 10.0, 1 / RATE_HZ)
    tones = ((0.3, 0.0), (0.9, 1.0), (1.7, 2.0), (3.1, 0.4))
    goal = 4.0 * np.sum([np.sin(2 * np.pi * hz * time + phase) for hz, phase in tones], axis=0)
    angle = speed = 0.0
    dt, found = 1 / RATE_HZ / STEPS, []
    for one in goal.tolist():
        current = (0.02 * (one - angle) - 0.001 * speed) / K_T
        found.append((angle, current))
        for _ in range(STEPS):
            friction = VISCOUS * speed + COULOMB * np.tanh(speed / 0.2)
            speed += dt * (K_T * current - friction - K * angle / N**2) / ROTOR
            angle += dt * speed
    motor, current = np.array(found).T
    random, step = np.random.default_rng(1), 2 * np.pi / 2048
    return log_with(
        "elbow",
        time,
        motor_position=step * np.round(motor / step),
        joint_position=np.zeros_like(motor),
        motor_torque=K_T * current + 5e-4 * random.normal(size=motor.shape),
        joint_torque=K * motor / N + 0.05 * random.normal(size=motor.shape),
    )


def bench(tmp_path: Path, **options: object) -> Robot:
    drive = replace(SeriesElasticDrive(gear_ratio=N), **options)  # type: ignore[arg-type]
    return load_robot(bench_urdf(tmp_path), {"elbow": drive})


@pytest.mark.parametrize("is_current", [False, True])
def test_the_drive_of_a_locked_output_is_identified(tmp_path: Path, is_current: bool) -> None:
    input_of = "current" if is_current else "torque"
    log = in_currents(bench_log(), K_T) if is_current else bench_log()
    found = identify(bench(tmp_path, motor_input=input_of), log)
    true = TRUE | ({"torque_constant": K_T} if is_current else {})
    drive = found.drives["elbow"]
    for name, value in true.items():  # friction near standstill is that of tanh
        assert drive.value(name) == pytest.approx(value, rel=0.035), name
    assert drive.value("stiffness") == pytest.approx(K, rel=2e-3)
    assert found.verdict.level == "good", found.summary()
    (note,) = [one for one in found.warnings if one.code == "locked-output"]
    assert (note.joint, note.severity) == ("elbow", "note")
    assert np.isnan(found.joint_fits["elbow"].own)
    assert found.joint_fits["elbow"].motor < 0.05
    assert seaid.check(bench(tmp_path, motor_input=input_of), log).warnings[0].code == note.code


def test_what_holds_an_output_may_yield(tmp_path: Path) -> None:
    log = bench_log()
    yields = replace(log, joint_position=0.01 * log.motor_position / N)
    found = identify(bench(tmp_path), yields)
    codes = {one.code for one in found.warnings} - {"gear-compliance"}
    assert codes == {"locked-output"}
    assert found.drives["elbow"].value("stiffness") == pytest.approx(K / 0.99, rel=2e-3)


@pytest.mark.usefixtures("estimates_only")
def test_a_current_alone_gives_no_scale(tmp_path: Path) -> None:
    alone = replace(in_currents(bench_log(), 1.0), joint_torque=None)
    message = "the torque constant of elbow is unidentifiable: .* and its output is locked"
    with pytest.raises(IdentificationError, match=message):
        identify(bench(tmp_path, motor_input="current"), alone)
    known = {"stiffness_Nm_per_rad": K, "known": ("stiffness",), "motor_input": "current"}
    drive = identify(bench(tmp_path, **known), alone).drives["elbow"]
    assert drive.value("torque_constant") == pytest.approx(1.0, rel=2e-3)


@pytest.mark.parametrize(
    ("kind", "key"), [("revolute", "gear_ratio"), ("prismatic", "motor_pulley_radius_m")]
)
def test_a_first_project_asks_for_what_is_not_shown(tmp_path: Path, kind: str, key: str) -> None:
    """The drive of a sliding one can be read all the same."""
    urdf = bench_urdf(tmp_path, kind)
    robot = load_robot(urdf)
    log = replace(bench_log(), is_prismatic=(kind == "prismatic",))
    tables, (doubt,) = inferred_drives(robot, [log])
    assert f"does not show its {key}" in doubt
    assert tables["elbow"]["type"] == "series_elastic"
    if kind == "prismatic":
        assert load_robot(urdf, filled(tables)).drives["elbow"].is_elastic
    else:
        assert 'gear_ratio = "?"' in _drives_text(tables, [doubt], tmp_path / "drives.toml")


def test_a_joint_whose_output_is_held_leaves_the_others_identifiable() -> None:
    """The bodies behind it stand in one place, though its motor deflects its spring."""
    truth, held = leg(), "hip_pitch"
    time = np.arange(0, 12, 0.002)
    rates = 2 * np.pi * np.array([[0.31, 0.42, 0.0, 0.53, 0.67], [0.93, 1.1, 0.0, 0.77, 1.21]])
    reach = np.array([[0.4, 0.3, 0.0, 0.5, 0.5], [0.15, 0.1, 0.0, 0.2, 0.2]])
    phases = rates[:, None] * time[:, None]
    middle = np.array([0.0, 0.0, -0.2, 0.7, 0.0])
    q = middle + np.sum(reach[:, None] * np.sin(phases), axis=0)
    v = np.sum((reach * rates)[:, None] * np.cos(phases), axis=0)
    a = -np.sum((reach * rates**2)[:, None] * np.sin(phases), axis=0)
    load = seaid.regressor.joint_torques(truth, q, v, a)
    motor, torque = q.copy(), load.copy()
    for j, drive in enumerate(truth.drives.values()):
        ratio, x = total_ratio(drive), {"stiffness": np.inf} | dict(drive.values)
        motor[:, j] = ratio * (q[:, j] + load[:, j] / (x["stiffness"] * drive.load_radius**2))
        speed = np.gradient(motor[:, j], time)
        torque[:, j] = load[:, j] / ratio + x["motor_inertia"] * np.gradient(speed, time)
        torque[:, j] += x["viscous_friction"] * speed
        torque[:, j] += x.get("coulomb_friction", 0.0) * np.sign(speed)
    log = log_with(
        truth.joint_names, time, joint_position=q, motor_position=motor, motor_torque=torque
    )
    found = identify(truth.without_nominal(), log)
    assert found.known.at_rest == {held: pytest.approx(-0.2)}
    assert "locked-output" in {note.code for note in found.warnings}
    for joint in truth.elastic_joints:
        stiffness = truth.drives[joint].values["stiffness"]
        assert found.drives[joint].value("stiffness") == pytest.approx(stiffness, rel=2e-3)
    assert all(fit.own < 1e-3 for joint, fit in found.joint_fits.items() if joint != held)
