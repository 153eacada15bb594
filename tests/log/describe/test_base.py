"""Custom columns of a floating base: described, inferred, and turned to the frames of BaseLog."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from scripts.example_robots import example_urdf
from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log import CHANNELS, BaseLog
from seaid.log.base_log import matrices
from seaid.log.description import Clock
from tests.plants import write_columns

FEET = ("FL_foot", "FR_foot", "RL_foot", "RR_foot")
RATE_HZ = 100.0


@cache
def go2(**more: Any) -> seaid.Robot:
    return seaid.load_robot(example_urdf("go2.urdf"), base="floating", contacts=FEET, **more)


@cache
def states() -> dict[str, Array]:
    """Ten seconds of a base that turns and moves, of joints, torques and contacts."""
    rng, time = np.random.default_rng(4), np.arange(0, 10, 1 / RATE_HZ)

    def waves(count: int, size: float) -> Array:
        turn, start = 2 * np.pi * rng.uniform(0.2, 1.0, count), rng.uniform(0, 6, count)
        return np.asarray(size * np.sin(np.outer(time, turn) + start))

    w, f = waves(3, 1.5), waves(3, 2.0)
    quaternion = np.empty((len(time), 4))
    quaternion[0] = np.array([0.5, 0.1, -0.1, 0.85]) / np.linalg.norm([0.5, 0.1, -0.1, 0.85])
    for t in range(len(time) - 1):  # exact for a constant turn between two samples
        half = 0.25 * (w[t] + w[t + 1]) / RATE_HZ
        angle = np.linalg.norm(half)
        turn = np.array([np.cos(angle), *(np.sinc(angle / np.pi) * half)])
        a, b = quaternion[t], turn
        quaternion[t + 1] = [
            a[0] * b[0] - a[1:] @ b[1:],
            *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])),
        ]
    R = matrices(quaternion)
    acceleration = np.einsum("tij,tj->ti", R, f)
    velocity = np.cumsum(acceleration, axis=0) / RATE_HZ
    velocity -= velocity.mean(axis=0)
    position = np.cumsum(velocity, axis=0) / RATE_HZ
    lifted = np.sin(np.outer(time, 2 * np.pi * np.array([0.3, 0.4, 0.5, 0.6]))) < 0.9
    return {
        "time": time,
        "position": position,
        "orientation": quaternion,
        "velocity": velocity,
        "w": w,
        "specific_force": f + R.transpose(0, 2, 1) @ [0, 0, 9.81],
        "R": R,
        "joints": waves(12, 0.5),
        "rates": waves(12, 0.5),
        "torque": waves(12, 8.0),
        "flags": lifted.astype(float),
    }


def of_joints(position: str = "{}_pos", torque: str = "{}_torque") -> dict[str, Array]:
    """Return columns of positions and torques, by patterns of their names."""
    one, columns = states(), {}
    for k, joint in enumerate(go2().joint_names):
        columns[position.format(joint)] = one["joints"][:, k]
        columns[torque.format(joint)] = one["torque"][:, k]
    return columns


def of_feet(pattern: str, factor: float = 1.0) -> dict[str, Array]:
    return {pattern.format(x): factor * y for x, y in zip(FEET, states()["flags"].T, strict=True)}


def of_axes(pattern: str, values: Array, axes: str = "wxyz") -> dict[str, Array]:
    """Return a column for each axis of vectors or of quaternions."""
    return {pattern.format(x): y for x, y in zip(axes[-values.shape[1] :], values.T, strict=True)}


def described(path: Path, robot: seaid.Robot | None = None, **more: Any) -> BaseLog:
    robot = robot or go2()
    guess = seaid.describe_log(path, robot, **more)
    log = seaid.read_log(path, robot, description=guess.description)
    again = path.with_suffix(".toml")
    again.write_text(guess.to_toml())
    written = seaid.read_log(path, robot, description=again)
    assert log.base is not None
    assert written.base is not None
    for name, values in log.base.columns().items():
        np.testing.assert_array_equal(values, written.base.columns()[name])
    np.testing.assert_allclose(log.joint_position, states()["joints"], atol=1e-9)
    np.testing.assert_allclose(log.motor_torque, states()["torque"], atol=1e-9)
    return log.base


def check(base: BaseLog, *names: str, atol: float = 1e-9) -> None:
    for name in names:
        wanted = states()["w" if name == "angular_velocity" else name]
        np.testing.assert_allclose(getattr(base, name), wanted, atol=atol, err_msg=name)
    for foot, flags in zip(FEET, states()["flags"].T, strict=True):
        np.testing.assert_array_equal(base.contacts[foot][:, 0], flags)


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
@pytest.mark.parametrize("frame", ["base", "world"])
def test_generalised_states_in_arrays_are_found(tmp_path: Path, order: str, frame: str) -> None:
    one = states()
    quaternion = one["orientation"][:, [1, 2, 3, 0]] if order == "xyzw" else one["orientation"]
    flips = np.where(np.arange(len(quaternion)) // 50 % 2, -1, 1)[:, None]  # p and -p are the same
    in_base = np.einsum("tji,tj->ti", one["R"], one["velocity"])
    w_world = np.einsum("tij,tj->ti", one["R"], one["w"])
    velocities = (in_base, one["w"]) if frame == "base" else (one["velocity"], w_world)
    np.savez(
        tmp_path / "walk.npz",
        q=np.hstack([one["position"], flips * quaternion, one["joints"]]),
        dq=np.hstack([*velocities, one["rates"]]),
        tau=np.hstack([np.zeros((len(flips), 6)), one["torque"]]),
        contact=one["flags"],
    )
    base = described(tmp_path / "walk.npz", rate_hz=RATE_HZ)
    sign = np.sign(base.orientation[:, :1] * one["orientation"][:, :1])  # type: ignore[index]
    assert np.all(sign == sign[0])
    check(base, "position", "velocity", "angular_velocity")


def test_arrays_in_files_without_names_are_found(tmp_path: Path) -> None:
    one = states()
    q = np.hstack([one["position"], one["orientation"][:, [1, 2, 3, 0]], one["joints"]])
    arrays = {"q": q, "tau": one["torque"], "contact": one["flags"]}
    for name, values in arrays.items():
        np.save(tmp_path / f"walk_{name}.npy", values)
        np.savetxt(tmp_path / f"walk_{name}.dat", values, fmt="%.12g", delimiter="\t")
    for suffix in ("npy", "dat"):
        paths = [tmp_path / f"walk_{name}.{suffix}" for name in arrays]
        guess = seaid.describe_log(paths, go2(), rate_hz=RATE_HZ)
        log = seaid.read_log(paths, go2(), description=guess.description)
        assert log.base is not None
        check(log.base, "position", "orientation")
        np.testing.assert_allclose(log.motor_torque, one["torque"], atol=1e-9)


HEADERS = {
    "ros": (
        *("/odom/pose.pose.position.", "/odom/pose.pose.orientation.", "/odom/twist.twist.linear."),
        *("/imu/angular_velocity.", "/imu/linear_acceleration.", "contact_{}"),
    ),
    "anymal": ("base_pos_", "base_quat_", "base_lin_vel_", "imu_gyro_", "imu_acc_", "{}_contact"),
    "short": ("p", "q", "v", "w", "a", "{}_stance"),
}


@pytest.mark.parametrize("style", HEADERS)
def test_named_columns_of_the_base_are_found(tmp_path: Path, style: str) -> None:
    one, heads = states(), HEADERS[style]
    parts = ("position", "orientation", "velocity", "w", "specific_force")
    columns = {"time_s": one["time"]}
    for head, name in zip(heads, parts, strict=False):
        columns |= of_axes(head + "{}", one[name])
    columns |= of_feet(heads[-1]) | of_joints()
    path = write_columns(tmp_path / "walk.csv", columns)
    check(described(path), *parts[:3], "angular_velocity", "specific_force")


UNITS = {
    "mocap in mm": (("trunk_t{} [mm]", 1e3), ("trunk_q{}", 1.0), ("Gyro{} [deg/s]", 180 / np.pi)),
    "without words": (("pelvis_{}_cm", 1e2), ("pelvis_q{}", 1.0), ("pelvis_{}_dps", 180 / np.pi)),
    "SI": (("trunk.t{}", 1.0), ("rot_{}", 1.0), ("imu_w{}_rad_s", 1.0)),
    "axes in the middle": (("body_p_{}_mm", 1e3), ("q_{}", 1.0), ("imu_w_{}_rad_s", 1.0)),
}


@pytest.mark.parametrize("style", UNITS)
def test_units_in_the_names_of_vectors_are_converted(tmp_path: Path, style: str) -> None:
    one, columns, rng = states(), {"time_s": states()["time"]}, np.random.default_rng(0)
    parts = ("position", "orientation", "w")
    for (head, factor), name in zip(UNITS[style], parts, strict=True):
        axes = "XYZ" if head.startswith("Gyro") else "wxyz"
        columns |= of_axes(head, factor * one[name], axes)
    columns |= of_axes("FL_foot_{}_mm", rng.normal(size=(len(one["time"]), 3)))  # its place
    columns |= of_feet("{}_touch") | of_joints(torque="{}_torque_Nm")
    path = write_columns(tmp_path / "sway.csv", columns)
    check(described(path), "position", "orientation", "angular_velocity", atol=1e-9)
    assert not any("how it" in one for one in seaid.describe_log(path, go2()).unsure)


def test_a_base_whose_motion_no_column_says_is_named(tmp_path: Path) -> None:
    one = states()
    arrays: dict[str, Any] = {"joint_pos": one["joints"], "joint_torque": one["torque"]}
    arrays["contact"] = one["flags"]
    np.savez(tmp_path / "walk.npz", **arrays)
    unsure = seaid.describe_log(tmp_path / "walk.npz", go2(), rate_hz=RATE_HZ).unsure
    assert any("base: no column found of how it turns: name one in [base]" in x for x in unsure)
    assert any("base: no column found of how it accelerates: name in [base]" in x for x in unsure)


SENSORS = (
    "/{}_ft/wrench/force/{} /{}_ft/wrench/torque/{}",
    "{}_foot_F_{} {}_foot_M_{}",
    "ft_{}_F{} ft_{}_M{}",
)


@pytest.mark.parametrize("style", SENSORS)
def test_force_sensors_are_those_of_the_contacts_with_their_words(
    tmp_path: Path, style: str
) -> None:
    """A log of joint positions, an IMU and force sensors needs no torque."""
    one, rng = states(), np.random.default_rng(0)
    columns = {"time_s": one["time"]} | of_axes("imu_gyro_{}", one["w"])
    columns |= of_axes("imu_acc_{}", one["specific_force"]) | of_axes("quat_{}", one["orientation"])
    wrenches = {foot: rng.normal(size=(len(one["time"]), 6)) for foot in FEET}
    for foot, wrench in wrenches.items():
        for k, (name, x) in enumerate((name, x) for name in style.split() for x in "xyz"):
            columns[name.format(foot.removesuffix("_foot"), x)] = wrench[:, k]
    for x in "xyz":  # of a wrist, which is no contact
        columns[f"/wrist_ft/wrench/force/{x}"] = rng.normal(size=len(one["time"]))
        columns[f"FL_foot_ref_{x}"] = rng.normal(size=len(one["time"]))  # a place, no force
        columns[f"FL_foot_des_force_{x}"] = rng.normal(size=len(one["time"]))  # not measured
    for k, joint in enumerate(go2().joint_names):
        columns[f"{joint}_pos"] = one["joints"][:, k]
    path = write_columns(tmp_path / "walk.csv", columns)
    guess = seaid.describe_log(path, go2())
    said = guess.to_toml()
    assert "taken for the force of the ground on FL_foot, in the axes of that link" in said
    assert "wrist_ft/wrench: a force sensor whose name is not that of one contact: not used" in said
    assert said.count("a force sensor whose name") == 1
    log = seaid.read_log(path, go2(), description=guess.description)
    assert np.all(np.isnan(log.motor_torque))
    flying = seaid.load_robot(example_urdf("go2.urdf"), base="floating")
    of_flight = seaid.describe_log(path, flying)  # without contacts no sensor is that of one
    assert of_flight.description.base.keys() == guess.description.base.keys()
    assert not of_flight.description.contacts
    assert log.base is not None
    assert not log.base.contacts
    for foot, wrench in wrenches.items():
        np.testing.assert_allclose(log.base.wrenches[foot], wrench, atol=1e-9)


def test_an_acceleration_without_gravity_becomes_a_specific_force(tmp_path: Path) -> None:
    one = states()
    in_world = np.einsum("tij,tj->ti", one["R"], one["specific_force"]) - [0, 0, 9.81]
    in_base = np.einsum("tji,tj->ti", one["R"], in_world)
    table: dict[str, Any] = {"time": {"rate_hz": RATE_HZ}}
    table["base"] = {"angular_velocity": "w[0:3]", "orientation": "p[0:4]"}
    np.savez(
        tmp_path / "a.npz",
        **{"a": in_base, "b": in_world, "w": one["w"], "p": one["orientation"]},
        torque=one["torque"],
        joint=one["joints"],
        flag=30 * one["flags"],
    )
    table["joints"] = {
        joint: {"joint_position": f"joint[{k}]", "motor_torque": f"torque[{k}]"}
        for k, joint in enumerate(go2().joint_names)
    }
    table["contacts"] = {
        foot: {"contact": {"columns": f"flag[{k}]", "above": 20}} for k, foot in enumerate(FEET)
    }
    for source in ({"columns": "a[0:3]", "frame": "base"}, "b[0:3]"):
        whole = {**table, "base": {**table["base"], "acceleration": source}}
        base = seaid.read_log(tmp_path / "a.npz", go2(), description=whole).base
        assert base is not None
        check(base, "orientation", "angular_velocity", "specific_force")
    del whole["base"]["orientation"]
    message = "the acceleration of the base in the frame of the world needs the orientation"
    with pytest.raises(LogError, match=message):
        seaid.read_log(tmp_path / "a.npz", go2(), description=whole)
    held = seaid.load_robot(example_urdf("go2.urdf"))
    with pytest.raises(LogError, match=re.escape("the description has [base] or [contacts]")):
        seaid.read_log(tmp_path / "a.npz", held, description=whole)


def test_a_velocity_alone_gives_the_acceleration() -> None:
    one = states()
    sensors: dict[str, Any] = {"joint_position": one["joints"], "motor_torque": one["torque"]}
    given: dict[str, Any] = {"contacts": dict(zip(FEET, one["flags"].T, strict=True))}
    given |= {"orientation": one["orientation"], "angular_velocity": one["w"]}
    forces = []
    for name in ("specific_force", "velocity"):
        own: Any = {name: one[name]}
        log = seaid.Log(
            time=one["time"],
            joint_names=go2().joint_names,
            motor_position=np.full_like(one["joints"], np.nan),
            base=BaseLog(**given, **own),
            **sensors,
        )
        motion = seaid.reconstruct_motion(go2(), log, cutoff_hz=4.0)
        assert motion.base is not None
        forces.append(motion.base.specific_force[100:-100])
    # the sum of the velocity is half a sample late
    np.testing.assert_allclose(forces[0], forces[1], atol=0.25)


@pytest.mark.parametrize(
    ("quantity", "source", "message"),
    [
        ("position", "q[0:2]", "[base] position: needs 3 columns, found 2"),
        ("posiion", "q[0:3]", "no key is named 'posiion'"),
        ("position", [1.5, 2, 3], "columns must be names of columns, found 1.5"),
        ("velocity", {"frame": "body"}, "'frame': no value is named 'body'; allowed: base, world"),
        ("position", {"frame": "base"}, "frame is not for position, found 'base'"),
        ("orientation", {"order": "zyxw"}, "'order': no value is named 'zyxw'; did you mean"),
        ("position", {"scale": "g"}, "that is not zero, found 'g'"),
        ("position", {"above": 1}, "above is not for position, found 1"),
        ("position", {"unknown": 0}, "unknown is not for position, found 0"),
        ("position", {"column": "q[0]"}, "no key is named 'column'; did you mean 'columns'"),
        ("position", "tau[0:3]", "no column is named 'tau[0]'"),
        ("", {"FL_fot": {"contact": "c[0]"}}, "did you mean 'FL_foot'"),
        ("", 3, "[contacts] must be a table, found 3"),
    ],
)
def test_messages_of_a_description(
    quantity: str, source: Any, message: str, tmp_path: Path
) -> None:
    if quantity and isinstance(source, dict) and "column" not in source:
        source = {"columns": "q[0:4]" if quantity == "orientation" else "q[0:3]", **source}
    table = {"base": {quantity: source}} if quantity else {"contacts": source}
    np.savez(tmp_path / "a.npz", q=np.zeros((100, 12)), c=np.zeros((100, 4)))
    joints = {joint: {"joint_position": f"q[{k}]"} for k, joint in enumerate(go2().joint_names)}
    given = {"time": {"rate_hz": 100}, "joints": joints, **table}
    with pytest.raises(LogError, match=re.escape(message)):
        seaid.read_log(tmp_path / "a.npz", go2(), description=given)


@pytest.mark.slow  # 1.2 s
def test_a_first_project_has_the_base_and_the_logs_without_time(tmp_path: Path) -> None:
    one = states()
    q = np.hstack([one["position"], one["orientation"][:, [1, 2, 3, 0]], one["joints"]])
    for name in ("walk", "other"):
        np.savez(tmp_path / f"{name}.npz", q=q, tau=one["torque"], contact=one["flags"])
    np.save(tmp_path / "q.npy", q)
    np.save(tmp_path / "tau.npy", one["torque"])
    np.save(tmp_path / "contact.npy", one["flags"])
    contacts = [seaid.Contact(foot, radius_m=0.02) for foot in FEET]
    for names, count in ((["walk.npz", "other.npz"], 2), (["q.npy", "tau.npy", "contact.npy"], 1)):
        folder = tmp_path / names[0].replace(".", "_")
        folder.mkdir()
        made = seaid.write_first_project(
            "go2",
            [tmp_path / name for name in names],
            base="floating",
            contacts=contacts,
            rate_hz=RATE_HZ,
            folder=folder,
        )
        assert any("no motor encoder in the logs" in doubt for doubt in made.doubts)
        project = seaid.load_project(folder)
        assert project.contacts == tuple(contacts)
        assert len(project.logs) == count
        log = project.logs[0].read(project.robot())
        assert log.base is not None
        check(log.base, "position", "orientation")


def generalised() -> dict[str, Array]:
    """Positions, velocities and accelerations of base and joints, as Pinocchio has them."""
    one = states()
    rates = np.gradient(one["joints"], 1 / RATE_HZ, axis=0)
    slower = np.gradient(rates, 1 / RATE_HZ, axis=0)
    in_base = np.einsum("tji,tj->ti", one["R"], one["velocity"])
    return {
        "q": np.hstack([one["position"], one["orientation"][:, [1, 2, 3, 0]], one["joints"]]),
        "v": np.hstack([in_base, one["w"], rates]),
        "a": np.hstack([0 * one["w"], 0 * one["w"], slower]),
        "tau": one["torque"],
        "contact": one["flags"],
    }


@pytest.mark.parametrize("suffix", ["dat", "npy", "npz"])
def test_arrays_whose_rows_are_the_channels_are_found(tmp_path: Path, suffix: str) -> None:
    arrays = generalised()
    if suffix == "npz":
        turned: dict[str, Any] = {name: values.T for name, values in arrays.items()}
        np.savez(tmp_path / "walk.npz", **turned)
        paths = [tmp_path / "walk.npz"]
    else:
        paths = [tmp_path / f"robot_{name}.{suffix}" for name in arrays]
        for path, values in zip(paths, arrays.values(), strict=True):
            if suffix == "npy":
                np.save(path, values.T)
            else:
                np.savetxt(path, values.T, fmt="%.12g", delimiter="\t")
    guess = seaid.describe_log(paths, go2(), rate_hz=RATE_HZ)
    log = seaid.read_log(paths, go2(), description=guess.description)
    assert log.base is not None
    check(log.base, "position", "orientation", "velocity", "angular_velocity")
    np.testing.assert_allclose(log.motor_torque, states()["torque"], atol=1e-9)


def test_one_table_without_names_is_divided_by_its_samples(tmp_path: Path) -> None:
    arrays = generalised()
    table = np.column_stack([states()["time"], *arrays.values()])
    np.savetxt(tmp_path / "walk.csv", table, fmt="%.12g", delimiter=",")
    base = described(tmp_path / "walk.csv")
    check(base, "position", "orientation", "velocity", "angular_velocity")


def test_columns_with_numbers_codes_of_contacts_and_loads_are_found(tmp_path: Path) -> None:
    """An IMU and motors with numbers; flags 1 and 2, loads and two-column clocks as Spot has."""
    one, time = states(), 1_700_000_000.6 + states()["time"]
    columns = {"stamp_sec": np.floor(time), "stamp_nsec": np.round(time % 1 * 1e9)}
    vectors = {"quat": one["orientation"], "gyro": one["w"], "acc": one["specific_force"]}
    columns |= {f"imu_{x}_{k}": y[:, k] for x, y in vectors.items() for k in range(y.shape[1])}
    columns |= of_joints("{}.position", "{}.load")
    columns |= {f"{foot}.contact": 2 - one["flags"][:, k] for k, foot in enumerate(FEET)}
    write_columns(tmp_path / "walk.csv", columns, "%.17g")
    base = described(tmp_path / "walk.csv")
    check(base, "orientation", "angular_velocity", "specific_force")
    guess = seaid.describe_log(tmp_path / "walk.csv", go2())
    clock = {"column": "stamp_sec", "nanoseconds": "stamp_nsec"}
    assert guess.description.to_dict()["time"] == clock
    assert any("codes: 1 is taken for contact" in one for one in guess.unsure)
    assert guess.description.contacts[FEET[0]]["contact"].unknown == 0


def test_a_contact_of_unknown_state_is_no_measurement(tmp_path: Path) -> None:
    """Spot's code 0 is neither 1, contact, nor 2, its loss: its neighbours tell the state."""
    one = states()
    codes = 2 - one["flags"]
    is_within = np.all([np.roll(codes, k, axis=0) == codes for k in (-2, -1, 1, 2)], axis=0)
    codes[is_within & (np.arange(len(codes)) % 10 == 5)[:, None]] = 0
    assert np.any((codes == 0) & (one["flags"] == 0))
    arrays: dict[str, Any] = {"joint_pos": one["joints"], "joint_torque": one["torque"]}
    arrays["contact"] = codes
    arrays |= {"imu_quat": one["orientation"], "imu_gyro": one["w"]}
    np.savez(tmp_path / "walk.npz", **arrays)
    base = described(tmp_path / "walk.npz", rate_hz=RATE_HZ)
    for foot, flags in zip(FEET, one["flags"].T, strict=True):
        np.testing.assert_array_equal(base.contacts[foot][:, 0] > 0.5, flags > 0.5)


def test_signs_of_quaternions_in_columns_of_seaid_are_none_of_the_motion(tmp_path: Path) -> None:
    """An interpolation of lost samples between p and -p passes zero, which is no rotation."""
    one = states()
    flips = np.where(np.arange(len(one["time"])) // 50 % 2, -1, 1)[:, None]
    columns = {"time_s": one["time"]}
    vectors = {"orientation": flips * one["orientation"], "angular_velocity": one["w"]}
    for name, values in vectors.items():
        columns |= dict(zip(CHANNELS[name], values.T, strict=True))
    columns |= of_joints("{}.joint_position_rad", "{}.joint_torque_Nm")
    kept = np.ones(len(flips), dtype=bool)
    kept[50:-50:50] = False  # at the changes of sign
    columns = {name: values[kept] for name, values in columns.items()}
    path = write_columns(tmp_path / "walk.csv", columns, "%.15g")
    log = seaid.read_log(path, go2(), repair=seaid.Repairs())
    assert log.base is not None
    assert log.base.orientation is not None
    sign = np.sign(np.sum(log.base.orientation * one["orientation"], axis=1))
    assert np.all(sign == sign[0])
    np.testing.assert_allclose(sign[0] * log.base.orientation, one["orientation"], atol=1e-4)


@pytest.mark.parametrize("scale", [120.0, 2.0, -1.0])
def test_a_contact_beyond_zero_and_one_is_no_flag(tmp_path: Path, scale: float) -> None:
    """Noise of a force in the air would be a contact, and so would be Spot's code of its loss."""
    table = {"time_s": states()["time"]} | of_joints("{}.joint_position_rad", "{}.joint_torque_Nm")
    wrong, right = (of_feet("{}.contact", factor) for factor in (scale, 1.0))
    nothing = {f"{FEET[-1]}.contact": np.full(len(table["time_s"]), np.nan)}  # as if not logged
    path = write_columns(tmp_path / "walk.csv", table | wrong | nothing)
    with pytest.raises(LogError, match=r"contact of 'FL_foot' must be 0 .*\[contacts.FL_foot\]"):
        seaid.read_log(path, go2())
    write_columns(path, table | right | nothing)
    log = seaid.read_log(path, go2())
    assert log.base is not None
    assert [*log.base.contacts] == list(FEET[:-1])


def test_a_clock_adds_nanoseconds_to_seconds_only() -> None:
    with pytest.raises(LogError, match="nanoseconds are added to a column of seconds"):
        Clock("t", unit="ms", nanoseconds="ns")


@pytest.mark.parametrize("kind", ["in g", "without gravity"])
def test_an_accelerometer_in_g_or_without_gravity_is_found(tmp_path: Path, kind: str) -> None:
    one = states()
    up = np.einsum("tji,j->ti", one["R"], [0.0, 0.0, 9.81])
    acc = one["specific_force"] / 9.80665 if kind == "in g" else one["specific_force"] - up
    arrays: dict[str, Any] = {"imu_quat": one["orientation"], "imu_gyro": one["w"], "imu_acc": acc}
    arrays |= {"joint_pos": one["joints"], "joint_torque": one["torque"], "contact": one["flags"]}
    np.savez(tmp_path / "walk.npz", **arrays)
    base = described(tmp_path / "walk.npz", rate_hz=RATE_HZ)
    check(base, "orientation", "angular_velocity", "specific_force", atol=1e-6)


def test_a_contact_is_that_of_the_link_with_the_most_of_its_words(tmp_path: Path) -> None:
    one, links = states(), ("FL_foot", "FL_calf")
    robot = seaid.load_robot(example_urdf("go2.urdf"), base="floating", contacts=links)
    columns: dict[str, Any] = {"quat": one["orientation"], "gyro": one["w"]}
    columns |= {"joint_pos": one["joints"], "joint_torque": one["torque"]}
    columns |= {f"{link}_contact": one["flags"][:, k] for k, link in enumerate(links)}
    np.savez(tmp_path / "walk.npz", **columns)
    contacts = seaid.describe_log(tmp_path / "walk.npz", robot).description.contacts
    assert {x: y["contact"].columns for x, y in contacts.items()} == {
        link: (f"{link}_contact",) for link in links
    }


def test_a_vector_that_lacks_an_axis_is_said(tmp_path: Path) -> None:
    one = states()
    columns = {"time": one["time"], "imu_acc_x": one["w"][:, 0], "imu_acc_z": one["w"][:, 2]}
    columns |= {f"q_{x}": one["joints"][:, k] for k, x in enumerate(go2().joint_names)}
    columns |= {"odom_x": one["w"][:, 0], "odom_y": one["w"][:, 1]}  # a robot on wheels
    write_columns(tmp_path / "walk.csv", columns)
    unsure = seaid.describe_log(tmp_path / "walk.csv", go2()).unsure
    lacking = [one for one in unsure if "a vector of the base needs x, y and z" in one]
    assert lacking == ["imu_acc: has no y: a vector of the base needs x, y and z"]


def test_the_torque_of_a_series_elastic_actuator_is_that_of_its_spring(tmp_path: Path) -> None:
    columns = {"time_s": states()["time"]} | of_joints(torque="{}/sea_torque_Nm")
    path = write_columns(tmp_path / "sway.csv", columns)
    guess = seaid.describe_log(path, go2())
    assert all("joint_torque" in own for own in guess.description.joints.values())
    assert not any("sea" in text for text in guess.unsure)
