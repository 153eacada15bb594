"""Possible bodies of robots: the truth without noise, possible with noise, bounds, every error."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg

from seaid._arrays import Array
from seaid.drives import ParameterName, StiffDrive
from seaid.errors import IdentificationError
from seaid.estimation import Estimate
from seaid.identification import FeasibleParameters, identify
from seaid.identification.consistency import balls, feasible_parameters, prior_bodies
from seaid.legged import load_robot
from seaid.log import Log, read_log
from seaid.regressor import base_parameters
from seaid.regressor.load import LoadModel, load_model
from seaid.robot import Payload, Robot, is_physical
from seaid.robot.inertia import from_center_of_mass, pseudo_inertia
from seaid.simulation.simulation import measure
from tests.experiments import LEG_SENSORS, MODELS, TEST_MASS, arm, leg, leg_motion, true_value
from tests.measured import LOGS
from tests.representatives import quick_first, quick_only


@cache
def model_of(robot: Robot) -> LoadModel:
    return load_model(robot, base_parameters(robot), robot.joint_names)


def true_values(robot: Robot, model: LoadModel) -> Array:
    """Return the true values of the model's columns; all unknown of drives is 0.1."""
    values = np.append(model.base.project(robot.parameters), np.full(len(model.drives), 0.1))
    return np.asarray(values + np.sum(0.1 * model.absorption, axis=1))


def estimated(robot: Robot, relative: float, seed: int = 0, correlated: bool = True) -> Estimate:
    """Return the truth with errors of some part of each value, as they are said to be."""
    model, rng = model_of(robot), np.random.default_rng(seed)
    values = true_values(robot, model)
    p = len(values)
    half = rng.normal(size=(p, 2 * p)) / np.sqrt(2 * p) if correlated else np.eye(p)
    half = half * (relative * (np.abs(values) + 1e-3))[:, None]
    off = half @ rng.normal(size=half.shape[1])
    return Estimate(model.names, values + off, half @ half.T, model.units, 1.0, 1.0)


def found(robot: Robot, estimate: Estimate, **options: object) -> FeasibleParameters:
    return feasible_parameters(robot, model_of(robot), estimate, **options)  # type: ignore[arg-type]


def assert_possible(result: FeasibleParameters) -> None:
    """Check each body by Pinocchio's pseudo-inertia, and the whole by its mass matrix."""
    for body in result.parameters.reshape(-1, 10):
        theirs = pin.PseudoInertia.FromDynamicParameters(body).toMatrix()
        assert np.linalg.eigvalsh(theirs)[0] > 0
    model, rng = result.robot.model, np.random.default_rng(0)
    data = model.createData()
    for _ in range(50):
        mass = pin.crba(model, data, rng.uniform(-3, 3, model.nq))
        mass = np.triu(mass) + np.triu(mass, 1).T
        assert np.linalg.eigvalsh(mass)[0] > 0


ROBOTS = ("leg", "arm", "panda")


@pytest.fixture(params=ROBOTS, scope="module")
def robot(request: pytest.FixtureRequest, example_path: Callable[[str], Path]) -> Robot:
    """Return the TULip leg, the arm with rail and telescope, the Panda arm."""
    if request.param == "panda":
        joints = [f"panda_joint{number}" for number in range(1, 8)]
        return load_robot(example_path("panda.urdf"), joints=joints)
    return leg() if request.param == "leg" else arm()


@pytest.mark.rounding
@pytest.mark.parametrize("robot", quick_only(ROBOTS, ["arm"]), indirect=True)
@pytest.mark.parametrize(
    ("has_file", "weight"), quick_first([(True, None), (False, 0.0), (False, None)], 2)
)
def test_without_noise_values_are_true_and_what_they_leave_open_is_that_of_the_file(
    robot: Robot, has_file: bool, weight: float | None
) -> None:
    known = robot if has_file else robot.without_nominal()
    result = found(known, estimated(robot, 1e-9), weight=weight)
    truth = true_values(robot, model_of(robot))
    np.testing.assert_allclose(result.values, truth, rtol=1e-6, atol=1e-9)
    assert_possible(result)
    if has_file:
        scale = np.abs(robot.parameters) + 1e-3
        assert np.max(np.abs(result.parameters - robot.parameters) / scale) < 1e-4
        assert result.notes == ()


@pytest.mark.parametrize("weight", [0.0, None])
def test_active_bounds_are_those_of_the_returned_bodies(weight: float | None) -> None:
    robot = leg()
    result = found(robot, estimated(robot, 2.0, seed=2), weight=weight)
    flat = {words.split(" is ")[0] for words in result.active_bounds} & {*robot.body_names}
    bodies, priors = (x.reshape(-1, 10) for x in (result.parameters, robot.parameters))
    for name, body, prior in zip(robot.body_names, bodies, priors, strict=True):
        thinnest = linalg.eigvalsh(pseudo_inertia(body), pseudo_inertia(prior))[0]
        assert (name in flat) == (thinnest < 1e-3), name
    assert bool(flat) == (weight == 0.0)


@pytest.mark.rounding
@settings(max_examples=12)
@given(st.integers(0, 2**31), st.sampled_from([0.01, 0.3, 3.0, 100.0]), st.booleans())
def test_result_is_always_possible(seed: int, relative: float, with_file: bool) -> None:
    robot = arm() if with_file else arm().without_nominal()
    result, model = found(robot, estimated(arm(), relative, seed)), model_of(arm())
    assert_possible(result)
    drives = np.array(
        [
            true_value(result.robot, joint, name) if name != "friction_offset" else np.nan
            for joint, name, _ in model.absorbed
        ]
    )
    assert np.all(drives >= 0)
    p = len(model.expressions)
    kept = model.base.project(result.parameters) + model.absorption[:p] @ drives
    np.testing.assert_allclose(kept, result.values[:p], rtol=1e-6, atol=1e-7)


def stiff_leg() -> Robot:
    """Return the leg with stiff drives whose friction and rotor inertia are unknown."""
    drive = StiffDrive(gear_ratio=50.0)
    return load_robot(MODELS / "tulip_leg.urdf", dict.fromkeys(leg().joint_names, drive))


def test_rotor_inertia_that_the_base_absorbs_takes_what_no_body_needs() -> None:
    robot = stiff_leg()
    model = model_of(robot)
    assert ("hip_yaw", "motor_inertia", "kg m^2") in model.absorbed
    estimate = estimated(robot, 1e-9)  # with rotors of 0.1 kg m^2 behind gears of 50
    result = found(robot, estimate)
    np.testing.assert_allclose(result.values, estimate.values, rtol=1e-6, atol=1e-9)
    inertia = true_value(result.robot, "hip_yaw", "motor_inertia")
    assert inertia == pytest.approx(0.1, rel=1e-3)
    np.testing.assert_allclose(result.parameters, robot.parameters, rtol=0, atol=2e-2)


@pytest.mark.rounding
def test_negative_friction_becomes_zero_and_is_named() -> None:
    robot = stiff_leg()
    estimate = estimated(robot, 0.01, correlated=False)
    place = estimate.names.index("viscous_friction of knee_pitch")
    values = estimate.values.copy()
    values[place] = -5 * estimate.standard_errors[place]
    result = found(robot, replace(estimate, values=values))
    assert "viscous friction of knee_pitch is zero" in result.active_bounds
    assert 0 <= result.values[place] < 1e-3 * estimate.standard_errors[place]
    assert result.distance[place] == pytest.approx(5, rel=1e-3)
    assert true_value(result.robot, "knee_pitch", "viscous_friction") == result.values[place]
    others = np.delete(result.distance, place)
    assert np.max(np.abs(others)) < 5


def test_drives_estimated_beside_the_load_side_are_possible_too() -> None:
    names = ("viscous_friction", "coulomb_friction", "stiffness", "spring_offset")
    values, errors = np.array([-1e-5, 0.004, 80000.0, -3.0]), np.array([1e-5, 1e-4, 500.0, 1.0])
    drive = Estimate(ParameterName.all_of(names), values, np.diag(errors**2), ("",) * 4, 1.0, 1.0)
    result = found(leg(), estimated(leg(), 0.01), drives={"hip_pitch": drive})
    at = dict(zip(result.names, result.values, strict=True))
    assert 0 < at["viscous_friction of hip_pitch"] < 1e-9
    assert at["stiffness of hip_pitch"] == pytest.approx(80000, rel=1e-6)
    assert at["spring_offset of hip_pitch"] == pytest.approx(-3, rel=1e-6)
    assert result.robot.drives["hip_pitch"].stiffness_N_per_m == pytest.approx(80000)  # type: ignore[union-attr]
    assert result.robot.drives["knee_pitch"] == leg().drives["knee_pitch"]
    assert "viscous friction of hip_pitch is zero" in result.active_bounds


@pytest.mark.slow  # 1.8 s
@pytest.mark.parametrize("known", quick_first(["file", "nothing"]))
@pytest.mark.parametrize(
    "payload",
    quick_first([TEST_MASS, Payload("foot", 2.0), Payload("shank", 2.0, (0.0, 0.0, -0.1))]),
)
def test_payload_that_is_not_on_the_robot_is_named(payload: Payload, known: str) -> None:
    robot = leg(payload) if known == "file" else leg(payload).without_nominal()
    log = measure(leg(), leg_motion(), LEG_SENSORS, seed=0)
    result = identify(robot, log, feasible=True)
    assert result.feasible is not None
    assert_possible(result.feasible)
    (flag,) = result.feasible.warnings
    text = str(flag)
    assert text.startswith("no physically consistent robot comes near the estimate: chi-square is")
    assert f"without the payload of 2 kg on {payload.link}: check that it is on the" in text
    assert {flag, replace(flag, severity="note", remedy="")} & {*result.warnings}
    assert f" inconsistent-inertia: {flag}" in result.summary()
    assert result.feasible.nearest_chi_square > 1000


def test_what_no_bodies_come_near_is_named_or_refused() -> None:
    """Data that contradict all bodies, or those that are known; and an estimate without a value."""
    known = load_robot(MODELS / "tulip_leg.urdf", known_bodies=("thigh", "foot"))
    causes = "missing payloads, encoder offsets, and lengths", "check known bodies (thigh, foot), "
    for robot, words in zip((leg(), known), causes, strict=True):
        estimate = estimated(robot, 1e-4)
        result = found(robot, replace(estimate, values=-estimate.values))
        assert words in str(result.warnings[0])
    with pytest.raises(IdentificationError, match="the estimate must be finite"):
        found(known, replace(estimate, values=np.nan * estimate.values))


@pytest.mark.parametrize(
    ("mass", "centre", "inertia", "kind"),
    [
        (0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "degenerate"),
        (2.0, (0.1, 0.0, 0.3), (0.0, 0.0, 0.0), "degenerate"),
        (2.0, (0.0, 0.0, 0.0), (0.1, 0.1, 0.0), "degenerate"),
        (2.0, (0.0, 0.0, 0.0), (0.1, 0.1, 0.3), "physically inconsistent"),
        (-2.0, (0.0, 0.0, 0.0), (-0.1, -0.1, -0.1), "physically inconsistent"),
    ],
)
def test_bodies_of_the_file_that_cannot_be_are_mended_a_little_and_named(
    mass: float, centre: tuple[float, ...], inertia: tuple[float, ...], kind: str
) -> None:
    """The others stay as they are."""
    body = from_center_of_mass(mass, np.array(centre), np.diag(inertia))
    given_bodies = leg().parameters.reshape(-1, 10).copy()
    given_bodies[2] = body
    bodies, notes = prior_bodies(leg(), given_bodies.ravel())
    assert len(notes) == 1
    assert notes[0].startswith(f"thigh is {kind} in the file: 0.001 of a ball of")
    assert np.linalg.eigvalsh(pseudo_inertia(bodies[2]))[0] > 0
    if kind == "degenerate":
        assert np.max(np.abs(bodies[2] - body)) < 0.01 * max(np.max(np.abs(body)), 1.0)
    assert np.array_equal(np.delete(bodies, 2, 0), np.delete(given_bodies, 2, 0))


def test_balls_lie_along_the_links(robot: Robot) -> None:
    plain = balls(robot)
    assert all(is_physical(ball) for ball in plain)
    np.testing.assert_allclose(plain[:, 0], 1.0)
    for position, index in enumerate(robot.model_order):
        children = [
            child for child, parent in enumerate(robot.model.parents) if parent == position + 1
        ]
        if len(children) == 1:
            end = robot.model.jointPlacements[children[0]].translation
            np.testing.assert_allclose(plain[index, 1:4], end / 2)


def hebi_arm(**options: Any) -> tuple[Robot, Log]:
    robot = load_robot(MODELS / "hebi_arm_2.urdf", MODELS / "hebi_arm_2.toml", **options)
    path = LOGS / "hebi_arms/grav_comp_bad.npz"
    return robot, read_log(path, robot, description=LOGS / "hebi_csv_2.toml")


@pytest.mark.slow  # identifications of the leg with possible bodies
def test_masses_stay_near_the_prior_where_it_contradicts_other_values() -> None:
    """The prior of this arm is far off in what the log determines; its masses are all there is."""
    robot, log = hebi_arm()
    found = identify(robot, log, feasible=True)
    assert found.feasible is not None
    assert found.feasible.weight == 1
    assert found.feasible.chi_square < len(found.feasible.values)
    masses = found.robot.parameters[::10] / robot.parameters[::10]
    assert np.all((masses > 0.3) & (masses < 3))  # 832 kg of 0.7 with a weight of 1e-6


def test_bodies_that_are_all_known_are_those_of_the_robot_file() -> None:
    """Springs at all joints have no column on the load side: it has no parameter left."""
    robot, log = hebi_arm(known_bodies="all")
    plain, consistent = identify(robot, log), identify(robot, log, feasible=True)
    assert consistent.load_side.names == ()
    np.testing.assert_array_equal(consistent.robot.parameters, robot.parameters)
    for joint in robot.joint_names:
        np.testing.assert_allclose(
            consistent.drives[joint].values, plain.drives[joint].values, rtol=1e-6
        )
