"""Custom columns of a floating base: described, inferred, and turned to the frames of BaseLog."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import seaid
from scripts.example_robots import example_urdf
from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log import BaseLog
from seaid.log.channels import CHANNELS
from seaid.log.description import Clock
from tests.experiments import DATA
from tests.plants import log_with, write_columns

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
    R = np.empty((len(time), 3, 3))
    R[0] = pin.rpy.rpyToMatrix(0.3, 0.0, 2.1)
    for t in range(len(time) - 1):  # exact for a constant turn between two samples
        R[t + 1] = R[t] @ pin.exp3(0.5 * (w[t] + w[t + 1]) / RATE_HZ)
    quaternion = np.array([np.roll(pin.Quaternion(one).coeffs(), 1) for one in R])
    quaternion *= np.cumprod(np.sign(np.sum(quaternion * np.roll(quaternion, 1, 0), 1)))[:, None]
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
    columns = {}
    for k, joint in enumerate(go2().joint_names):
        columns[position.format(joint)] = states()["joints"][:, k]
        columns[torque.format(joint)] = states()["torque"][:, k]
    return columns


def of_feet(pattern: str, factor: float = 1.0) -> dict[str, Array]:
    return {pattern.format(x): factor * y for x, y in zip(FEET, states()["flags"].T, strict=True)}


def of_axes(pattern: str, values: Array, axes: str = "wxyz") -> dict[str, Array]:
    """Return a column for each axis of vectors or of quaternions."""
    return {pattern.format(x): y for x, y in zip(axes[-values.shape[1] :], values.T, strict=True)}


def in_base(vectors: Array) -> Array:
    """Return vectors of the world in the axes of the base."""
    return np.asarray(np.einsum("tji,tj->ti", states()["R"], vectors))


# Layouts of logs with a base: their files, what must be found in them, and what is said

Layout = tuple[dict[str, Any], tuple[str, ...], str]
MOTION = ("position", "orientation", "velocity", "w")
FELT = ("orientation", "w", "specific_force")


def generalised(order: str, frame: str) -> dict[str, Array]:
    """Return states as Pinocchio or MuJoCo have them, with signs of p that change: p and -p."""
    one = states()
    flips = np.where(np.arange(len(one["w"])) // 50 % 2, -1, 1)[:, None]
    quaternion = one["orientation"][:, [1, 2, 3, 0]] if order == "xyzw" else one["orientation"]
    velocities = [in_base(one["velocity"]), one["w"]]
    if frame == "world":
        velocities = [one["velocity"], np.einsum("tij,tj->ti", one["R"], one["w"])]
    rates = np.gradient(one["joints"], 1 / RATE_HZ, axis=0)
    return {
        "q": np.hstack([one["position"], flips * quaternion, one["joints"]]),
        "v": np.hstack([*velocities, rates]),
        "a": np.hstack([np.zeros((len(rates), 6)), np.gradient(rates, 1 / RATE_HZ, axis=0)]),
        "tau": one["torque"],
        "contact": one["flags"],
    }


def in_arrays(frame: str, order: str, name: str = "walk.npz") -> Layout:
    """Return an archive, where torques of the base are zero, a table, or files turned or not."""
    arrays = generalised(order, frame)
    if name == "walk.npz":
        arrays["tau"] = np.hstack([np.zeros((len(arrays["tau"]), 6)), arrays["tau"]])
        del arrays["a"]
    if name == "walk.csv":
        return {name: np.column_stack([states()["time"], *arrays.values()])}, MOTION, ""
    if name.startswith("turned"):
        arrays = {key: values.T for key, values in arrays.items()}
    if name.endswith("npz"):
        return {name: arrays}, MOTION, ""
    if name == ".dat":  # the order of p is that of an upright base
        arrays = {key: arrays[key] for key in ("q", "tau", "contact")}
    files = {f"walk_{key}{name[-4:]}": values for key, values in arrays.items()}
    return files, MOTION if "v" in arrays else MOTION[:2], ""


def with_headers(*heads: str | tuple[str, float]) -> Layout:
    """Return columns by the heads of their names, with the factor of a unit."""
    parts = (*MOTION[:2], *(("velocity", "w", "specific_force") if len(heads) > 3 else ("w",)))
    columns = {"time_s": states()["time"]} | of_feet("{}_touch")
    columns |= of_joints(torque="{}_torque_Nm")
    for head, name in zip(heads, parts, strict=True):
        pattern, factor = head if isinstance(head, tuple) else (head + "{}", 1.0)
        axes = "XYZ" if pattern.startswith("Gyro") else "wxyz"
        columns |= of_axes(pattern, factor * states()[name], axes)
    columns |= of_axes("FL_foot_{}_mm", states()["joints"][:, :3])  # its place
    return {"walk.csv": columns}, parts, ""


def with_imu(factor: float = 1.0, gravity: float = 0.0, **more: Array) -> Layout:
    """Return arrays of an IMU in other units, or without gravity."""
    up = in_base(np.tile([0.0, 0.0, 9.81], (len(states()["w"]), 1)))
    arrays = {"imu_quat": states()["orientation"], "imu_gyro": states()["w"]}
    arrays["imu_acc"] = (states()["specific_force"] - gravity * up) / factor
    arrays |= {"joint_pos": states()["joints"], "joint_torque": states()["torque"]}
    return {"walk.npz": arrays | {"contact": states()["flags"]} | more}, FELT, ""


def without_gyro() -> Layout:
    """Return an IMU whose p is in the order in which its forces carry the robot."""
    files, _, _ = with_imu()
    arrays = dict(files["walk.npz"])
    arrays["imu_quat"] = np.roll(arrays["imu_quat"], -1, axis=1)
    del arrays["imu_gyro"]
    return {"walk.npz": arrays}, ("orientation", "specific_force"), ""


def with_codes() -> Layout:
    """Return an IMU and motors with numbers; codes of contacts, loads and clocks as Spot has."""
    one, time = states(), 1_700_000_000.6 + states()["time"]
    columns = {"stamp_sec": np.floor(time), "stamp_nsec": np.round(time % 1 * 1e9)}
    vectors = {"quat": one["orientation"], "gyro": one["w"], "acc": one["specific_force"]}
    columns |= {f"imu_{x}_{k}": y[:, k] for x, y in vectors.items() for k in range(y.shape[1])}
    columns |= of_joints("{}.position", "{}.load")
    columns |= {f"{foot}.contact": 2 - one["flags"][:, k] for k, foot in enumerate(FEET)}
    return {"walk.csv": columns}, FELT, "codes: 1 is taken for contact"


def with_unknown_contacts() -> Layout:
    """Spot's code 0 is neither 1, contact, nor 2, its loss: its neighbours tell the state."""
    codes = 2 - states()["flags"]
    is_within = np.all([np.roll(codes, k, axis=0) == codes for k in (-2, -1, 1, 2)], axis=0)
    codes[is_within & (np.arange(len(codes)) % 10 == 5)[:, None]] = 0
    return with_imu(contact=codes)


ODOMETRY = (
    "/odom/pose.pose.position.",
    "/odom/pose.pose.orientation.",
    "/odom/twist.twist.linear.",
)
LAYOUTS: dict[str, Callable[[], Layout]] = {
    **{
        f"{frame}, {order}": partial(in_arrays, frame, order)
        for frame in ("base", "world")
        for order in ("xyzw", "wxyz")
    },
    **{
        name: partial(in_arrays, "base", "xyzw", name)
        for name in (".npy", ".dat", "turned.npz", "walk.csv")
    },
    "topics": partial(
        with_headers, *ODOMETRY, "/imu/angular_velocity.", "/imu/linear_acceleration."
    ),
    "words": partial(
        with_headers, "base_pos_", "base_quat_", "base_lin_vel_", "imu_gyro_", "imu_acc_"
    ),
    "letters": partial(with_headers, "p", "q", "v", "w", "a"),
    "mocap in mm": partial(
        with_headers, ("trunk_t{} [mm]", 1e3), "trunk_q", ("Gyro{} [deg/s]", 180 / np.pi)
    ),
    "no words": partial(
        with_headers, ("pelvis_{}_cm", 1e2), "pelvis_q", ("pelvis_{}_dps", 180 / np.pi)
    ),
    "SI": partial(with_headers, "trunk.t", "rot_", ("imu_w{}_rad_s", 1.0)),
    "axes in the middle": partial(
        with_headers, ("body_p_{}_mm", 1e3), "q_", ("imu_w_{}_rad_s", 1.0)
    ),
    "in g": partial(with_imu, 9.80665),
    "without gravity": partial(with_imu, gravity=1.0),
    "no gyro": without_gyro,
    "codes": with_codes,
    "unknown contacts": with_unknown_contacts,
}


def written(folder: Path, files: dict[str, Any]) -> list[Path]:
    """Write columns, or an array, into each file by its ending."""
    paths = [folder / name for name in files]
    for path, content in zip(paths, files.values(), strict=True):
        if isinstance(content, dict):
            write_columns(path, content, "%.17g")
        elif path.suffix == ".npy":
            np.save(path, content)
        else:
            delimiter = "," if path.suffix == ".csv" else "\t"
            np.savetxt(path, content, fmt="%.12g", delimiter=delimiter)
    return paths


def check(base: BaseLog | None, *names: str, atol: float = 1e-9) -> None:
    """Assert that a base has the states of these names, and all contacts."""
    assert base is not None
    for name in names:
        values = getattr(base, "angular_velocity" if name == "w" else name)
        if name == "orientation":
            values = np.sign(values[0] @ states()[name][0]) * values
        np.testing.assert_allclose(values, states()[name], atol=atol, err_msg=name)
    for foot, flags in zip(FEET, states()["flags"].T, strict=True):
        np.testing.assert_allclose(base.contacts[foot][:, 0], flags, rtol=0, atol=1e-12)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_base_is_found_in_any_layout(tmp_path: Path, layout: str) -> None:
    """The description that is inferred, and its file, give the states, without a wrong doubt."""
    files, names, doubt = LAYOUTS[layout]()
    paths = written(tmp_path, files)
    rate_hz = None if paths[0].suffix == ".csv" else RATE_HZ
    atol = 1e-6 if layout in ("in g", "without gravity") else 1e-9
    guess = seaid.describe_log(paths, go2(), rate_hz=rate_hz)
    (tmp_path / "again.toml").write_text(guess.to_toml())
    for description in (guess.description, tmp_path / "again.toml"):
        log = seaid.read_log(paths, go2(), description=description)
        check(log.base, *names, atol=atol)
        np.testing.assert_allclose(log.joint_position, states()["joints"], atol=1e-9)
        np.testing.assert_allclose(log.motor_torque, states()["torque"], atol=1e-9)
    assert any(doubt in text for text in guess.unsure)
    assert not any("how it" in text for text in guess.unsure)


@pytest.mark.parametrize(
    "style",
    [
        "/{}_ft/wrench/force/{} /{}_ft/wrench/torque/{}",
        "{}_foot_F_{} {}_foot_M_{}",
        "ft_{}_F{} ft_{}_M{}",
    ],
)
def test_force_sensors_are_those_of_the_contacts_with_their_words(
    tmp_path: Path, style: str
) -> None:
    """A log of joint positions, an IMU and force sensors needs no torque."""
    one, rng = states(), np.random.default_rng(0)
    columns = {"time_s": one["time"]} | of_axes("imu_gyro_{}", one["w"])
    columns |= of_axes("imu_acc_{}", one["specific_force"]) | of_axes("quat_{}", one["orientation"])
    wrenches = {foot: rng.normal(size=(len(one["time"]), 6)) for foot in FEET}
    for foot, wrench in wrenches.items():
        for head, part in zip(style.split(), (wrench[:, :3], wrench[:, 3:]), strict=True):
            columns |= of_axes(head.replace("{}", foot[:2], 1), part)
    for other in ("/wrist_ft/wrench/force/{}", "FL_foot_ref_{}", "FL_foot_des_force_{}"):
        columns |= of_axes(other, rng.normal(size=(len(one["time"]), 3)))  # none of a contact
    columns |= {x: y for x, y in of_joints().items() if not x.endswith("torque")}
    path = write_columns(tmp_path / "walk.csv", columns)
    guess = seaid.describe_log(path, go2())
    (unused,) = [text for text in guess.unsure if "a force sensor whose name" in text]
    assert unused.startswith("/wrist_ft/wrench: ")
    log = seaid.read_log(path, go2(), description=guess.description)
    assert np.all(np.isnan(log.motor_torque))
    assert log.base is not None
    assert not log.base.contacts
    for foot, wrench in wrenches.items():
        np.testing.assert_allclose(log.base.wrenches[foot], wrench, atol=1e-9)


def unsure_of(columns: dict[str, Any], **options: Any) -> str:
    columns |= {"time": states()["time"], "joint_pos": states()["joints"]}
    return "\n".join(seaid.describe_log(columns, go2(), **options).unsure)


def test_what_a_base_lacks_is_said() -> None:
    """No column of its rotation or acceleration, and a vector without an axis, are named."""
    doubts = unsure_of({"joint_torque": states()["torque"], "contact": states()["flags"]})
    assert "base: no column found of how it turns: name one in [base]" in doubts
    assert "base: no column found of how it accelerates: name in [base]" in doubts
    w = states()["w"]
    wheels = {"odom_x": w[:, 0], "odom_y": w[:, 1]}  # of a robot that has no z
    doubts = unsure_of({"imu_acc_x": w[:, 0], "imu_acc_z": w[:, 2], **wheels})
    assert doubts.count("a vector of the base needs x, y and z") == 1
    assert "imu_acc: has no y: a vector of the base needs x, y and z" in doubts


def test_an_acceleration_without_gravity_becomes_a_specific_force(tmp_path: Path) -> None:
    """In the axes of the base, or in those of the world, which needs the orientation."""
    one = states()
    in_world = np.einsum("tij,tj->ti", one["R"], one["specific_force"]) - [0, 0, 9.81]
    table: dict[str, Any] = {"time": {"rate_hz": RATE_HZ}}
    table["base"] = {"angular_velocity": "w[0:3]", "orientation": "p[0:4]"}
    np.savez(
        tmp_path / "a.npz",
        **{"a": in_base(in_world), "b": in_world, "w": one["w"], "p": one["orientation"]},
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
        check(seaid.read_log(tmp_path / "a.npz", go2(), description=whole).base, *FELT)
    del whole["base"]["orientation"]
    message = "the acceleration of the base in the frame of the world needs the orientation"
    with pytest.raises(LogError, match=message):
        seaid.read_log(tmp_path / "a.npz", go2(), description=whole)
    held = seaid.load_robot(example_urdf("go2.urdf"))
    with pytest.raises(
        LogError, match=re.escape("[base] and [contacts] are those of a base that moves")
    ):
        seaid.read_log(tmp_path / "a.npz", held, description=whole)


def test_a_velocity_alone_gives_the_acceleration() -> None:
    """Its derivative and gravity are the specific force, but for half a sample of the sum."""
    one = states()
    sensors = {"joint_position": one["joints"], "motor_torque": one["torque"]}
    still = log_with(go2().joint_names, one["time"], **sensors)
    given: dict[str, Any] = {"contacts": dict(zip(FEET, one["flags"].T, strict=True))}
    given |= {"orientation": one["orientation"], "angular_velocity": one["w"]}
    forces = []
    for name in ("specific_force", "velocity"):
        own: Any = {name: one[name]}
        log = replace(still, base=BaseLog(**given, **own))
        motion = seaid.reconstruct_motion(go2(), log, cutoff_hz=4.0)
        assert motion.base is not None
        forces.append(motion.base.specific_force[100:-100])
    # the sum of the velocity is half a sample late
    np.testing.assert_allclose(forces[0], forces[1], atol=0.25)


MISTAKES = tomllib.loads((DATA / "descriptions" / "mistakes.toml").read_text("utf-8"))["of_base"]


@pytest.mark.parametrize("mistake", MISTAKES, ids=[mistake["says"] for mistake in MISTAKES])
def test_mistake_in_the_description_of_a_base_is_named(mistake: dict[str, Any]) -> None:
    """A key of the base or of a contact is refused with what is allowed."""
    joints = {joint: {"joint_position": f"q[{k}]"} for k, joint in enumerate(go2().joint_names)}
    table = {key: value for key, value in mistake.items() if key != "says"}
    description = {"time": {"rate_hz": 100}, "joints": joints, **table}
    columns = {"q": np.zeros((100, 12)), "c": np.zeros((100, 4))}
    with pytest.raises(LogError, match=re.escape(mistake["says"])):
        seaid.read_log(columns, go2(), description=description)


def test_a_clock_adds_nanoseconds_to_seconds_only() -> None:
    """Of milliseconds they would be none."""
    with pytest.raises(LogError, match="nanoseconds are added to a column of seconds"):
        Clock("t", unit="ms", nanoseconds="ns")


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


def test_a_contact_is_that_of_the_link_with_the_most_of_its_words() -> None:
    """FL is in both names, and foot in one."""
    one, links = states(), ("FL_foot", "FL_calf")
    robot = seaid.load_robot(example_urdf("go2.urdf"), base="floating", contacts=links)
    columns: dict[str, Any] = {"quat": one["orientation"], "gyro": one["w"]}
    columns |= {"joint_pos": one["joints"], "joint_torque": one["torque"]}
    columns |= {f"{link}_contact": one["flags"][:, k] for k, link in enumerate(links)}
    contacts = seaid.describe_log(columns, robot).description.contacts
    names = {link: sources["contact"].columns for link, sources in contacts.items()}
    assert names == {link: (f"{link}_contact",) for link in links}


def test_the_torque_of_a_series_elastic_actuator_is_that_of_its_spring(tmp_path: Path) -> None:
    """It is no torque of the motor."""
    columns = {"time_s": states()["time"]} | of_joints(torque="{}/sea_torque_Nm")
    path = write_columns(tmp_path / "sway.csv", columns)
    guess = seaid.describe_log(path, go2())
    assert all("joint_torque" in own for own in guess.description.joints.values())
    assert not any("sea" in text for text in guess.unsure)
