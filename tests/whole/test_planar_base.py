"""A robot whose base a boom guides in a plane: two legs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import make_interp_spline

import seaid
from scripts.example_robots import example_urdf
from seaid._arrays import Array
from seaid.checks.engine import observed
from seaid.errors import SeaidError
from seaid.legged.base import RECORD_CHECKS, BaseRecord
from seaid.legged.floating import floating_regressor, floating_rows, planar_rotations
from seaid.log import BaseLog
from seaid.log.base_log import moving_base
from seaid.log.filtering import spline_derivatives
from seaid.robot import Contact, Robot
from tests.plants import write_columns
from tests.regressor.stances import columns_of_stances
from tests.representatives import quick_first

FEET = ("front_foot", "hind_foot")
_BODY = (
    '<link name="{0}"><inertial><origin xyz="{1}" rpy="0 0 0"/><mass value="{2}"/>'
    '<inertia ixx="{3}" iyy="{4}" izz="{5}" ixy="0" ixz="1e-4" iyz="0"/></inertial></link>'
)
_JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="{4}"/>'
    '<axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="20" effort="60"/></joint>'
)


def hopper_text(at_root: str = "") -> str:
    parts = [_BODY.format("trunk", "0.03 0 0.02", 4.0, 0.02, 0.06, 0.07)]
    for leg, x in (("front", 0.2), ("hind", -0.2)):
        foot = f"{leg}_foot"
        parts += [
            _BODY.format(f"{leg}_thigh", "0.01 0 -0.09", 0.8, 0.003, 0.0035, 0.001),
            _BODY.format(f"{leg}_calf", "0.005 0 -0.08", 0.3, 0.001, 0.0012, 0.0003),
            f'<link name="{foot}"/>',
            _JOINT.format(f"{leg}_hip", "revolute", "trunk", f"{leg}_thigh", f"{x} 0 0"),
            _JOINT.format(f"{leg}_knee", "revolute", f"{leg}_thigh", f"{leg}_calf", "0 0 -0.2"),
            _JOINT.format(f"{leg}_end", "fixed", f"{leg}_calf", foot, "0 0 -0.2"),
        ]
    return f'<robot name="hopper">{at_root}{"".join(parts)}</robot>'


ON_BOOM = '<link name="boom"/>' + _JOINT.format("guide", "planar", "boom", "trunk", "0 0 0")


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the robot alone, on a boom, obliquely, and on two slides and a hinge."""
    folder = tmp_path_factory.mktemp("planar")
    guides = {"j0": ("prismatic", "l1", "1 0 0"), "j1": ("prismatic", "l2", "0 0 1")}
    guides["j2"] = ("continuous", "trunk", "0 1 0")
    slides = ""
    for place, (name, (kind, below, axis)) in enumerate(guides.items()):
        joint = _JOINT.format(name, kind, f"l{place}", below, "0 0 0").replace("0 1 0", axis)
        slides += f'<link name="l{place}"/>{joint}'
    oblique = ON_BOOM.replace('"0 1 0"', '"0 1 1"')
    roots = {"hopper": "", "boom": ON_BOOM, "oblique": oblique, "chain": slides}
    for name, root in roots.items():
        (folder / f"{name}.urdf").write_text(hopper_text(root))
    return folder


@pytest.mark.parametrize(
    ("name", "base", "message"),
    [
        ("boom.urdf", "floating", "is planar: load it with base='planar'"),
        ("boom.urdf", "fixed", "joint 'guide' is planar; .*or that of the base with base='planar'"),
        ("hopper.urdf", "planar", "name the plane by axes of the base, as base='planar_xz'"),
        (
            "oblique.urdf",
            "planar",
            r"oblique\.urdf': the axis .* must be one of those of its child link",
        ),
    ],
)
def test_a_base_that_is_not_that_of_the_file_is_refused(
    folder: Path, name: str, base: str, message: str
) -> None:
    with pytest.raises(SeaidError, match=message):
        seaid.load_robot(folder / name, base=base)  # type: ignore[arg-type]


QUANTITIES = {
    "position": ("x", "z"),
    "velocity": ("vx", "vz"),
    "specific_force": ("fx", "fz"),
    "angle": ("angle",),
    "angular_velocity": ("rate",),
}


def loaded(folder: Path, name: str = "boom.urdf", base: str = "planar") -> Robot:
    contacts = [Contact(foot, radius_m=0.02) for foot in FEET]
    return seaid.load_robot(folder / name, base=base, contacts=contacts)  # type: ignore[arg-type]


def test_planar_joint_of_the_file_is_that_of_the_base(folder: Path) -> None:
    of_file, named = loaded(folder), loaded(folder, "hopper.urdf", "planar_xz")
    np.testing.assert_array_equal(of_file.parameters, named.parameters)
    for robot in (of_file, named):
        assert moving_base(robot).normal == (0.0, 1.0, 0.0)
        assert "planar base" in repr(robot)
    seaid.write_urdf(of_file, folder / "written.urdf")
    assert loaded(folder, "written.urdf").joint_names == of_file.joint_names


def test_rows_are_those_of_two_slides_and_a_hinge(folder: Path) -> None:
    robot, chain = loaded(folder), seaid.load_robot(folder / "chain.urdf")
    rng, count = np.random.default_rng(1), 20
    q, v, a = rng.normal(size=(3, count, 7))
    R = planar_rotations(moving_base(robot), q[:, 2])
    zero = np.zeros(count)
    w, e = (np.column_stack([zero, x[:, 2], zero]) for x in (v, a))
    f = np.einsum("tji,tj->ti", R, np.column_stack([a[:, 0], zero, a[:, 1] + 9.81]))
    states = (q[:, 3:], v[:, 3:], a[:, 3:])
    Y = floating_rows(robot, floating_regressor(robot, *states, (w, e, f)), range(4))
    rows = Y @ robot.parameters
    force = np.einsum("tij,tj->ti", R, rows[:, :3])
    found = np.column_stack([force[:, [0, 2]], rows[:, 4], rows[:, 6:]])
    data = chain.model.createData()
    wanted = [
        pin.rnea(chain.model, data, *x) for x in zip(*map(chain.to_model, (q, v, a)), strict=True)
    ]
    np.testing.assert_allclose(found, chain.from_model(np.array(wanted)), atol=1e-9)


@pytest.mark.parametrize("plane", ["planar_xy", "planar_xz", "planar_yz"])
def test_exact_columns_of_a_planar_base_are_the_numeric_ones(plane: str) -> None:
    feet = ("FL_FOOT", "FR_FOOT")
    robot = seaid.load_robot(example_urdf("bolt.urdf"), base=plane, contacts=feet)  # type: ignore[arg-type]
    for stances in ([()], [feet[:1]], [feet]):
        exact = columns_of_stances(robot, stances)
        assert exact == seaid.base_parameters(robot, stances=stances).columns


def test_legs_in_the_plane_of_the_base_have_fewer_parameters(folder: Path) -> None:
    robot = seaid.load_robot(folder / "hopper.urdf", base="planar_xz", contacts=FEET)
    for stances, count in (([()], 16), ([FEET], 14)):
        found = seaid.identifiability(robot, stances=stances)
        assert (found.rank, found.agree) == (count, True)


def of_joints(robot: Robot, time: Array) -> dict[str, Array]:
    """Return columns of the time and of waves at all joints."""
    table = {"time_s": time}
    for place, joint in enumerate(robot.joint_names):
        table[f"{joint}.joint_position_rad"] = np.sin((2.0 + 0.3 * place) * time)
        table[f"{joint}.motor_torque_Nm"] = np.cos((2.0 + 0.3 * place) * time)
    return table


@pytest.mark.parametrize("wraps", [False, True])
def test_an_angle_with_lost_samples_is_smooth(folder: Path, tmp_path: Path, wraps: bool) -> None:
    """A spline bridges what was lost, also where the angle goes from pi to -pi."""
    robot, time = loaded(folder), np.arange(0.0, 8.0, 0.01)
    table = of_joints(robot, time) | {"base.angle_rad": 4.0 * np.sin(3.0 * time)}
    if wraps:
        table["base.angle_rad"] = (table["base.angle_rad"] + np.pi) % (2 * np.pi) - np.pi
    kept = np.ones(len(time), dtype=bool)
    kept[7::29] = False
    path = write_columns(tmp_path / "turns.csv", {name: x[kept] for name, x in table.items()})
    log = seaid.read_log(path, robot, repair=seaid.Repairs())
    assert log.base is not None
    assert log.base.orientation is not None
    angle = 2 * np.unwrap(np.arctan2(log.base.orientation[:, 2], log.base.orientation[:, 0]))
    error = np.angle(np.exp(1j * (angle - 4.0 * np.sin(3.0 * log.time))))
    assert len(log.time) == len(time)
    assert np.max(np.abs(error)) < 1e-5


NAMES: dict[str, dict[str, str]] = {
    "degrees": {"x": "base_x [m]", "z": "base_z [m]", "angle": "trunk pitch [deg]"},
    "boom": {"x": "x", "z": "z", "angle": "pitch", "rate": "pitch_rate"},
    "imu": {"fx": "acc_x", "fz": "acc_z", "rate": "gyro_y", "angle": "base.pitch_rad"},
    "gym": {"x": "rootx", "z": "rootz", "angle": "rooty"},
    "rates": {"x": "px", "z": "pz", "vx": "dx", "vz": "dz", "angle": "theta_body", "rate": "wy"},
}


def signals(folder: Path) -> dict[str, Array]:
    """Return the coordinates of the base in the plane, their derivatives, and those of `of_joints`.

    A specific force is what an accelerometer shows in the axes of the base.
    """
    time = np.arange(0.0, 16.0, 0.004)
    own = {
        "x": 0.03 * np.sin(2 * np.pi * 0.7 * time),
        "z": 0.34 + 0.02 * np.sin(2 * np.pi * 1.2 * time),
        "angle": 0.1 * np.sin(2 * np.pi * 0.3 * time) + 0.05 * np.sin(2 * np.pi * 0.9 * time),
    }
    _, rates, (ax, az, _) = (
        one.T for one in spline_derivatives(time, np.column_stack([*own.values()]))
    )
    c, s = np.cos(own["angle"]), np.sin(own["angle"])
    own |= dict(zip(("vx", "vz", "rate"), rates, strict=True))
    own |= {"fx": c * ax - s * (az + 9.81), "fz": s * ax + c * (az + 9.81)}
    flags = {f"{foot}.contact": np.ones(len(time)) for foot in FEET}
    return of_joints(loaded(folder), time) | flags | {f"@{x}": y for x, y in own.items()}


@pytest.mark.parametrize("kind", quick_first(NAMES))  # 0.7 s each
def test_columns_of_a_planar_base_are_described_by_their_names(folder: Path, kind: str) -> None:
    robot, table, names = loaded(folder), signals(folder), NAMES[kind]
    scale = 180 / np.pi if kind == "degrees" else 1.0
    kept = {x: y for x, y in table.items() if not x.startswith("@")}
    own = {names[x]: table[f"@{x}"] * (scale if x == "angle" else 1.0) for x in names}
    path = write_columns(folder / f"{kind}.csv", {**kept, **own})
    guess = seaid.describe_log(path, robot)
    assert {name: one.columns for name, one in guess.description.base.items()} == {
        quantity: tuple(names[x] for x in parts)
        for quantity, parts in QUANTITIES.items()
        if set(parts) <= names.keys()
    }
    assert not any(set(names.values()) & {*one.split(": ")} for one in guess.unsure)
    description = path.with_suffix(".toml")
    description.write_text(guess.to_toml())
    log = seaid.read_log(path, robot, description=description)
    assert isinstance(log.base, BaseLog)
    assert log.base.orientation is not None
    angle = 2 * np.arctan2(log.base.orientation[:, 2], log.base.orientation[:, 0])
    np.testing.assert_allclose(angle, table["@angle"], atol=1e-6)


def test_arrays_of_a_planar_base_and_its_joints_are_states(folder: Path) -> None:
    robot, table = loaded(folder), signals(folder)
    of_joints = [table[f"{x}.joint_position_rad"] for x in robot.joint_names]
    rates = [np.gradient(one, table["time_s"]) for one in of_joints]
    states = {
        "qpos": np.column_stack([table["@x"], table["@z"], table["@angle"], *of_joints]),
        "qvel": np.column_stack([table["@vx"], table["@vz"], table["@rate"], *rates]),
        "tau": np.column_stack([table[f"{x}.motor_torque_Nm"] for x in robot.joint_names]),
        "contact": np.ones((len(table["time_s"]), 2)),
        "time": table["time_s"],
    }
    base = seaid.describe_log(write_columns(folder / "states.npz", states), robot).description.base
    assert {name: one.columns for name, one in base.items()} == {
        "position": ("qpos[0]", "qpos[1]"),
        "angle": ("qpos[2]",),
        "velocity": ("qvel[0]", "qvel[1]"),
        "angular_velocity": ("qvel[2]",),
    }


def test_what_a_planar_base_lacks_or_contradicts_is_noted(folder: Path) -> None:
    robot, table = loaded(folder), signals(folder)
    kept = {x: y for x, y in table.items() if not x.startswith("@")}
    own = {
        "x": table["@x"],
        "pitch": 57.3 * 20 * table["@angle"],
        "gyro_y": -table["@rate"],
        "acc_x": table["@fx"],
        "acc_z": table["@fz"] - 9.81,
    }
    guess = seaid.describe_log(write_columns(folder / "odd.csv", {**kept, **own}), robot)
    notes = "\n".join(guess.unsure)
    assert "x: has no z: the plane of the base needs both" in notes
    assert "without a unit: taken for degrees" in notes
    assert "gyro_y: minus the derivative of the angle: one of them needs scale = -1" in notes
    assert "without gravity or in another unit: not used" in notes
    assert "specific_force" not in guess.description.base


@pytest.mark.parametrize(
    ("name", "base"),
    [("hopper.urdf", "floating"), ("hopper.urdf", "planar_xz"), ("boom.urdf", "planar")],
)
@pytest.mark.parametrize("belly_m", [0.1, 0.7])
def test_the_lowest_contact_of_a_written_model_touches_the_floor(
    folder: Path, tmp_path: Path, name: str, base: Any, belly_m: float
) -> None:
    """A ball at the base itself counts as those of its legs do."""
    belly = Contact("trunk", position_m=(0.0, 0.0, -belly_m), radius_m=0.03)
    contacts = [belly, *(Contact(foot, radius_m=0.02) for foot in FEET)]
    robot = seaid.load_robot(folder / name, base=base, contacts=contacts)
    seaid.write_mjcf(robot, tmp_path / "model.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    balls = [model.geom(f"{contact.link}_contact").id for contact in contacts]
    lowest = data.geom_xpos[balls, 2] - model.geom_size[balls, 0]
    assert np.min(lowest) == pytest.approx(0.0, abs=1e-6)
    assert (np.argmin(lowest) == 0) == (belly_m > 0.5)


def in_the_air(folder: Path, held: str) -> dict[str, Array]:
    """Columns of a hopper in the air whose pitch, and x, a guide may hold: forces on it are zero.

    The others have a motion by which the equations of the base hold without a guide.
    """
    robot = seaid.load_robot(folder / "hopper.urdf", base="planar_xz")
    time = np.arange(0.0, 8.0, 0.004)
    places = [0.4 * np.sin((3.0 + 0.7 * k) * time + k) for k in range(4)]
    q = np.column_stack(places) + np.array([0.3, -0.6, 0.2, -0.7])
    v, a = (spline_derivatives(time, q)[order] for order in (1, 2))
    free = [row for row, axis in ((0, "x"), (2, "z"), (4, "pitch")) if axis not in held.split()]

    def rows(values: Array) -> Array:
        """Return the rows of accelerations (T, 6) of a base that does not turn fast."""
        base = (np.zeros((len(time), 3)), values[:, 3:], values[:, :3])
        return floating_rows(robot, floating_regressor(robot, q, v, a, base), range(4)) @ (
            robot.parameters
        )

    # The rows are linear in the accelerations: those of the free axes make their rows zero.
    nothing = np.zeros((len(time), 6))
    still = rows(nothing)
    mass = np.stack([(rows(nothing + np.eye(6)[row]) - still)[:, free] for row in free], axis=2)
    accelerations = nothing.copy()
    accelerations[:, free] = -np.linalg.solve(mass, still[:, free][:, :, None])[:, :, 0]
    torque, rng = rows(accelerations)[:, 6:], np.random.default_rng(3)
    table = {"time_s": time, "base.angle_rad": 1e-5 * rng.normal(size=len(time))}
    for axis, row in (("x", 0), ("z", 2)):
        change = accelerations[:, row] - 9.81 * (axis == "z")
        speed = make_interp_spline(time, change, k=5).antiderivative()(time)
        table[f"base.velocity_{axis}_m_per_s"] = speed * (row in free)
    for place, joint in enumerate(robot.joint_names):
        noise = rng.normal(size=(2, len(time)))
        table[f"{joint}.joint_position_rad"] = q[:, place] + 1e-6 * noise[0]
        table[f"{joint}.motor_torque_Nm"] = torque[:, place] + 1e-3 * noise[1]
    return table


@pytest.mark.parametrize(
    ("held", "equations"),
    [("pitch", "base moment y"), ("pitch x", "base force x, base moment y")],
)
def test_equations_of_a_base_have_no_force_of_a_guide_that_holds_it(
    folder: Path, held: str, equations: str
) -> None:
    robot = seaid.load_robot(folder / "hopper.urdf", base="planar_xz")
    log = seaid.read_log(write_columns(folder / "air.csv", in_the_air(folder, held)), robot)
    found = seaid.identify(robot.without_nominal(), log, cutoff_hz=10.0)
    (note,) = [finding for finding in found.warnings if finding.code == "locked-output"]
    assert f"not used are {equations}" in note.message
    truth = found.base.project(robot.parameters)
    np.testing.assert_allclose(found.load.values, truth, atol=0.02 * np.max(np.abs(truth)))
    scores = (found.load.values - truth) / found.load.standard_errors
    assert np.sqrt(np.mean(scores**2)) < 2.0


MISREAD: dict[str, tuple[Callable[[Array], Array], str]] = {
    "right": (lambda v: v, ""),
    "opposite": (lambda v: -v, "its sign: scale = -1"),
    "mm": (lambda v: 1000 * v, "is in mm/s"),
    "exchanged": (lambda v: v[:, [2, 1, 0]], "x and z are exchanged"),
}


@pytest.mark.parametrize("plane", ["planar_xz", "floating"])
@pytest.mark.parametrize("what", MISREAD)
def test_a_velocity_is_the_change_of_the_position(folder: Path, plane: Any, what: str) -> None:
    """It was silent in a plane: the velocity alone gives the acceleration of the base."""
    base = moving_base(seaid.load_robot(folder / "hopper.urdf", base=plane))
    assert base is not None
    time, rng = np.arange(0.0, 10.0, 0.004), np.random.default_rng(0)
    shift = np.array([0.05, 0.04 * (plane == "floating"), 0.03])
    rates = 2 * np.pi * np.array([0.7, 0.5, 1.2])
    position = shift * np.sin(time[:, None] * rates)
    velocity = shift * rates * np.cos(time[:, None] * rates)
    angle = 0.3 * np.sin(3.0 * time)
    turned = np.column_stack([np.cos(angle / 2), 0 * angle, np.sin(angle / 2), 0 * angle])
    change, text = MISREAD[what]
    log = BaseLog(
        orientation=turned,
        position=position + 1e-4 * rng.normal(size=position.shape) * (shift > 0),
        velocity=change(velocity),
    )
    found = observed(RECORD_CHECKS, BaseRecord(log, time, base))
    assert [x.code for x in found] == ["base-frames"] * (what != "right")
    assert all(text in x.message for x in found)
    tipping = np.outer(np.cos(3.0 * time), [1, 0, 0]) + 1e-3 * rng.normal(size=(len(time), 3))
    found = observed(RECORD_CHECKS, BaseRecord(BaseLog(angular_velocity=tipping), time, base))
    assert ["out of the plane [rad/s]" in x.evidence for x in found] == [True] * (
        plane != "floating"
    )
