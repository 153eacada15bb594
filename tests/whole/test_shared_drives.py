"""Drives of one type share parameters: fewer of them, smaller errors, and a test of the type."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import tomli_w

from seaid._arrays import Array
from seaid.drives import read_drives, write_drives
from seaid.errors import Finding, IdentificationError, RobotError
from seaid.estimation import Estimate, estimator_named
from seaid.export import content_of
from seaid.identification import Identification, identify, identify_conditions, refine
from seaid.identification.simultaneous import estimation, settled, simultaneous_regression
from seaid.legged import load_robot
from seaid.log import Log, Motion, reconstruct_motion
from seaid.project import load_run, save_run
from seaid.regressor import Regression
from seaid.robot import Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure, simulate_motion
from tests.experiments import wiggle
from tests.plants import kept, write_robot
from tests.representatives import quick_first

pytestmark = pytest.mark.usefixtures("estimates_only")

STIFF = {
    "type": "stiff",
    "gear_ratio": 50.0,
    "motor_inertia_kg_m2": 2e-5,
    "viscous_friction_Nms_per_rad": 1e-3,
    "coulomb_friction_Nm": 0.01,
    "friction": ["viscous", "coulomb"],
}
ELASTIC = STIFF | {"type": "series_elastic", "stiffness_Nm_per_rad": 120.0}
TRUTH = {"viscous_friction": 1e-3, "coulomb_friction": 0.01, "stiffness": 120.0}
FRICTION = ("viscous_friction", "coulomb_friction")
JOINTS = ("ankle", "elbow", "hip", "knee")
BODY = (
    '<inertial><origin xyz="0.1 0 -0.25"/><mass value="2"/>'
    '<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.02"/></inertial>'
)
LIMIT = '<limit lower="-3" upper="3" effort="90" velocity="9"/>'


def pendulums(*drives: Mapping[str, Any]) -> Robot:
    """Return equal pendulums next to each other, with these drives."""
    named = dict(zip(JOINTS, drives, strict=False))
    axis = f'<axis xyz="0 1 0"/>{LIMIT}'
    joints = {joint: f"revolute base {joint}_link {axis}" for joint in named}
    with TemporaryDirectory() as folder:
        return load_robot(write_robot(Path(folder) / "pendulums.urdf", joints, BODY), named)


@cache
def plant(*springs: float) -> Robot:
    """Return pendulums with the stiffness of each spring, zero for none."""
    drives = [ELASTIC | {"stiffness_Nm_per_rad": spring} if spring else STIFF for spring in springs]
    return pendulums(*drives)


@kept
def motion_of(*springs: float) -> Motion:
    robot = plant(*springs)
    motion = wiggle(robot, 5.0, (0.2,) * robot.n, (0.9,) * robot.n)
    same = np.repeat(motion.coefficients[:, :1], robot.n, axis=1)
    return simulate_motion(robot, replace(motion, coefficients=same))


def log_of(*springs: float, seed: int = 1) -> Log:
    """Return a log in which all joints make the same motion, with noise of their own.

    Rounding of encoders would be nearly the same at all joints, so that they are fine.
    """
    robot, motion = plant(*springs), motion_of(*springs)
    sensors = Noise(
        motor_resolution_rad=2 * np.pi / 2**16,
        joint_resolution_rad=1e-7,
        motor_offset_rad=(1.0, -2.0, 0.5, 3.0)[: robot.n],
        torque_std_Nm=0.01,
    )
    return measure(robot, motion, sensors, seed)


def found(robot: Robot, log: Log, *joints: str, **options: Any) -> Identification:
    """Return the two-step identification with the drives of some joints in one group."""
    options = {"method": "two-step", "cutoff_hz": 5.0, **options}
    share = {"calf_motor": joints} if joints else {}
    return identify(robot.without_nominal(), log, share=share, **options)


@cache
def both_ways(kind: str = "series_elastic") -> tuple[Identification, Identification]:
    """Return four equal drives identified alone, and as one group."""
    springs = [120.0 if kind == "series_elastic" else 0.0] * 4
    robot, log = plant(*springs), log_of(*springs)
    return found(robot, log), found(robot, log, *JOINTS)


def white_error(estimate: Estimate, name: str) -> float:
    """Return the standard error of a parameter for white noise."""
    errors = estimate.white_standard_errors
    assert errors is not None
    return float(errors[estimate.names.index(name)])


@pytest.mark.parametrize("kind", quick_first(["series_elastic", "stiff"]))
def test_four_equal_drives_have_half_the_standard_errors_of_one(kind: str) -> None:
    """Of equal excitation, 1/sqrt(k): the errors of their equations are independent."""
    alone, shared = both_ways(kind)
    for name in TRUTH if kind == "series_elastic" else FRICTION:
        (value,) = {drive.value(name) for drive in shared.drives.values()}
        drive = shared.drives["elbow"]
        assert abs(value - TRUTH[name]) < 4 * drive.standard_error(name)
        if kind == "series_elastic":
            own = np.array([x.standard_error(name) for x in alone.drives.values()])
            expected = np.sqrt(np.mean(own**2)) / 2
            assert drive.standard_error(name) == pytest.approx(expected, rel=0.15)
        # On the load side ten degrees of freedom leave chance correlations of 0.3 between joints.
        own = np.array([white_error(x, name) for x in alone.drives.values()])
        assert white_error(drive, name) == pytest.approx(np.sqrt(np.mean(own**2)) / 2, rel=0.1)
    assert alone.shared == ()
    assert {x.name for x in shared.shared} == {
        f"{name} of calf_motor" for name in (TRUTH if kind == "series_elastic" else FRICTION)
    }


def differing(result: Identification) -> list[Finding]:
    """Return the findings about drives that are not of one type."""
    return [finding for finding in result.findings if finding.code == "drives-differ"]


def test_drives_that_are_not_of_one_type_are_named() -> None:
    """With a spring of half the stiffness in the group, and with the other joints alone."""
    robot, log = plant(120.0, 120.0, 60.0), log_of(120.0, 120.0, 60.0)
    wrong, right = found(robot, log, *JOINTS[:3]), found(robot, log, *JOINTS[:2])
    (finding,) = differing(wrong)
    assert finding.severity == "doubtful"
    assert finding.joints == JOINTS[:3]
    assert finding.evidence["hip"] == pytest.approx(60.0, rel=0.05)
    tests = {shared.name.quantity: shared.difference for shared in wrong.shared}
    assert tests["stiffness"].bic > 0 > tests["viscous_friction"].bic
    assert not differing(right)
    assert all(shared.difference.bic < 0 for shared in right.shared)
    assert right.drives["hip"].value("stiffness") == pytest.approx(60.0, rel=0.05)


def test_what_is_shared_is_in_the_summary_the_files_and_a_saved_run(tmp_path: Path) -> None:
    _, shared = both_ways()
    assert "stiffness of calf_motor ankle, elbow, hip, knee" in " ".join(shared.summary().split())
    content = json.loads(json.dumps(content_of(shared)))["shared"]
    (stiffness,) = [x for x in content if x["parameter"] == "stiffness"]
    assert stiffness["group"] == "calf_motor"
    assert set(stiffness["alone"]) == set(JOINTS)
    assert stiffness["difference"]["bic"] < 0
    save_run(shared, tmp_path / "run.npz")
    again = load_run(tmp_path / "run.npz").identification
    kept = [[(x.name, x.joints, x.values) for x in run.shared] for run in (shared, again)]
    assert kept[0] == kept[1]
    # The identified drives stay of one type when they are written and read.
    write_drives(shared.robot.drives, tmp_path / "drives.toml")
    assert {x.shared for x in read_drives(tmp_path / "drives.toml").values()} == {"calf_motor"}


def test_a_group_of_the_drives_file_is_that_of_the_option() -> None:
    robot = pendulums(*[ELASTIC | {"shared": "calf_motor"}] * 4)
    by_file = found(robot, log_of(*[120.0] * 4))
    for joint, estimate in both_ways()[1].drives.items():
        np.testing.assert_array_equal(by_file.drives[joint].values, estimate.values)


@pytest.mark.slow  # 1.2 s
def test_conditions_share_what_their_drives_share() -> None:
    first, second = (log_of(120.0, 120.0, seed=seed) for seed in (1, 2))
    grouped = pendulums(*[ELASTIC] * 2).without_nominal()
    both = identify_conditions(
        {"cold": (grouped, first), "warm": (grouped, second)},
        condition_specific=("spring_offset", "viscous_friction"),
        share={"motor": JOINTS[:2]},
    )
    cold, warm = (both.identifications[name].drives for name in ("cold", "warm"))
    for drives in (cold, warm):
        assert drives["ankle"].value("viscous_friction") == drives["elbow"].value(
            "viscous_friction"
        )
    assert cold["ankle"].value("viscous_friction") != warm["ankle"].value("viscous_friction")
    assert len({x[y].value("stiffness") for x in (cold, warm) for y in ("ankle", "elbow")}) == 1


@pytest.mark.parametrize("option", quick_first([{"method": "simultaneous"}, {"estimator": "iv"}]))
def test_methods_that_go_on_from_two_steps_share(option: dict[str, str]) -> None:
    """The refinement by output error does not."""
    robot, log = plant(120.0, 120.0), log_of(120.0, 120.0)
    alone, shared = (found(robot, log, *joints, **option) for joints in ((), JOINTS[:2]))
    for name, truth in TRUTH.items():
        (value,) = {drive.value(name) for drive in shared.drives.values()}
        errors = [drive.standard_error(name) for drive in alone.drives.values()]
        error = shared.drives["ankle"].standard_error(name)
        assert abs(value - truth) < 4 * error
        assert error < 0.85 * np.sqrt(np.mean(np.square(errors)))
    assert {x.name.quantity for x in shared.shared} == {*TRUTH}
    with pytest.raises(IdentificationError, match="of ankle, which shares parameters"):
        refine(shared, log)


def test_both_sides_at_once_share_as_one_regression_with_their_columns_summed() -> None:
    robot, log = plant(120.0, 120.0), log_of(120.0, 120.0)
    result = found(robot, log, *JOINTS[:2], method="auto")
    assert result.method == "simultaneous"
    known = robot.without_nominal()
    motion = reconstruct_motion(known, log, 5.0)
    rows = simultaneous_regression(known, motion, result.model, JOINTS[:2], JOINTS[:2])
    keys = [name.quantity if name.quantity in TRUTH else name for name in rows.names]
    firsts = [place for place, key in enumerate(keys) if key not in keys[:place]]
    sums = np.array([[float(key == keys[first]) for first in firsts] for key in keys])
    weighted = estimation(estimator_named("wls"))

    def of_sums(whitened: Regression, theta: Array) -> Estimate:
        few = replace(whitened.of_columns(firsts), H=whitened.H @ sums)
        estimate = weighted(few, theta[firsts])
        covariance = sums @ estimate.covariance @ sums.T
        return replace(
            estimate,
            names=rows.names,
            units=rows.units,
            values=sums @ estimate.values,
            covariance=covariance,
            degrees_of_freedom=None,
            white_standard_errors=np.sqrt(np.diag(covariance)),
        )

    own = Estimate.joined(drive.at(joint) for joint, drive in result.drives.items())
    names = {**own.by_name, **result.load_side.by_name}
    expected, _ = settled(known, rows, np.array([names[name] for name in rows.names]), of_sums)
    for name in TRUTH:
        error = result.drives["elbow"].standard_error(name)
        difference = result.drives["elbow"].value(name) - expected.value(f"{name} of elbow")
        assert abs(difference) < 0.05 * error
        assert error == pytest.approx(expected.standard_error(f"{name} of elbow"), rel=0.02)


LINEAR = {"motor_pulley_radius_m": 0.1, "load_pulley_radius_m": 0.1, "stiffness_Nm_per_rad": "drop"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stiffness_Nm_per_rad": 60.0, "known": ["stiffness"]}, "differ in known parameters"),
        ({"motor_inertia_kg_m2": 3e-5}, r"differ in known parameters, .*2e-05.* and .*3e-05"),
        ({"motor_inertia_kg_m2_std": 1e-6}, "in motor_inertia_kg_m2_std, 0.0 and 1e-06"),
        ({"friction": ["viscous"]}, "differ in unknown parameters"),
        (STIFF | {"stiffness_Nm_per_rad": "drop"}, "differ in type, 'series_elastic' and 'stiff'"),
        (LINEAR, "differ in unit of the spring, 'N m' and 'N'"),
        ({"shared": 3}, "shared must be the name of a group"),
        ({"shared": "thigh_motor"}, r"\[ankle\] is alone in the group 'calf_motor'"),
    ],
)
def test_drives_that_cannot_be_of_one_type_are_refused_with_file_and_joint(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    table, path = ELASTIC | {"shared": "calf_motor"}, tmp_path / "drives.toml"
    second = {key: value for key, value in (table | change).items() if value != "drop"}
    path.write_text(tomli_w.dumps({"ankle": table, "elbow": second}))
    with pytest.raises(RobotError, match=message) as problem:
        read_drives(path)
    assert "drives.toml" in str(problem.value)


SMOOTH = ELASTIC | {"friction": ["viscous", "smooth_coulomb"]}
UNLIKE = [ELASTIC | {"shared": "motor", "friction": terms} for terms in (["viscous"], ["coulomb"])]
SHARES: list[tuple[Sequence[Mapping[str, Any]], dict[str, Any], str]] = [
    ([ELASTIC] * 2, {"a": ("ankle", "elbo")}, r"share=: no joint is named 'elbo'.*'elbow'"),
    ([ELASTIC] * 2, {"a": ("ankle",)}, r"share=: \[ankle\] is alone"),
    ([ELASTIC] * 2, {"": JOINTS[:2]}, "the group '' needs a name, and joints"),
    ([ELASTIC] * 2, {"a": ()}, "the group 'a' needs a name, and joints"),
    ([ELASTIC] * 2, {"a": ("ankle", "ankle")}, "ankle is in 'a' and in 'a': name it once"),
    (
        [ELASTIC] * 2,
        {"first": JOINTS[:2], "second": JOINTS[1:]},
        "elbow is in 'first' and in 'second'",
    ),
    ([SMOOTH] * 2, {"a": JOINTS[:2]}, "nonlinear in the unknown coulomb_width"),
    # A mapping is not a file: its drives are compared when they are identified.
    (UNLIKE, {}, r"\[ankle\] and \[elbow\] share 'motor' and differ"),
]


@pytest.mark.parametrize(("drives", "share", "words"), SHARES)
def test_groups_that_cannot_be_are_refused_by_name(
    drives: Sequence[Mapping[str, Any]], share: dict[str, Any], words: str
) -> None:
    with pytest.raises(RobotError, match=words):
        identify(pendulums(*drives).without_nominal(), log_of(120.0, 120.0), share=share)


@pytest.mark.parametrize("name", ["payload", "bodies", "load_pulley_radius_m"])
def test_deviations_of_what_the_robot_has_not_are_refused(name: str) -> None:
    words = f"known_std has '{name}', and of the robot none is known: leave it out"
    with pytest.raises(IdentificationError, match=words):
        found(plant(120.0, 120.0), log_of(120.0, 120.0), known_std={name: 0.1})
