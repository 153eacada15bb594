"""Both sides at once: rows that the truth solves, and what is found with and without noise."""

import tomllib
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import IdentificationError, LogError
from seaid.estimation import Estimate, estimator_named
from seaid.estimation.fitting import EstimatorName
from seaid.estimation.least_squares import ordinary
from seaid.export import content_of
from seaid.identification import identify
from seaid.identification.simultaneous import estimation, settled, simultaneous_regression, whitened
from seaid.legged import load_robot
from seaid.log import Motion, reconstruct_motion
from seaid.regressor import Regression, base_parameters, load_regression
from seaid.regressor.load import LoadModel, load_model, offset_sensitivity
from seaid.report.provenance import settings_facts
from seaid.robot import Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure, simulate_motion
from tests.experiments import (
    ELASTIC,
    LEG_SENSORS,
    MODELS,
    TEST_MASS,
    arm,
    leg,
    leg_log,
    leg_motion,
    leg_trajectory,
    true_value,
    with_drive,
)
from tests.mistakes import with_channels
from tests.representatives import quick_first, quick_only
from tests.standard_errors import check_scores
from tests.terms import TIME, exact_motion

LEG, IN_MOTION = leg(TEST_MASS), leg()
CUBIC = 2e-9
OLS, WLS = estimation(estimator_named("ols")), estimation(estimator_named("wls"))


@cache
def some_joints(*names: str, **options: Any) -> Robot:
    """Return the leg with some joints, in their order."""
    return load_robot(MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml", joints=names, **options)


REORDERED = ("knee_pitch", "hip_yaw", "ankle_pitch", "hip_roll", "hip_pitch")
TWO_SPRINGS = some_joints("hip_pitch", "knee_pitch")
WITH_CUBIC = with_drive(TWO_SPRINGS, "knee_pitch", extra_terms=("c*theta_M'**3",))


def model_of(robot: Robot, rows: tuple[str, ...] | None = None) -> LoadModel:
    known = robot.joint_names if rows is None else rows
    return load_model(robot, base_parameters(robot, torque_joints=known), known)


def truth_of(robot: Robot, model: LoadModel, names: tuple[str, ...]) -> Array:
    """Return the true parameters (p,) in the columns of the joint regression."""
    values = dict(zip(model.expressions, model.base.project(robot.parameters), strict=True))
    own = {"spring_offset": 0.0, "c": CUBIC}
    for full in set(names) - set(values):
        name, joint = full.split(" of ")
        values[full] = own[name] if name in own else true_value(robot, joint, name)
    return np.array([values[name] for name in names])


@cache
def exact(robot: Robot) -> Motion:
    """Return the motion of a robot that (3), (7) and (8) ask for, with sensors behind springs."""
    reach = np.where(robot.is_prismatic, 0.2, 0.8).tolist()
    return exact_motion(robot, reach=reach, is_sensed=True, c=CUBIC)


CASES: dict[str, tuple[Robot, tuple[str, ...] | None]] = {
    "mixed drives, test mass": (LEG, None),
    "free foot": (IN_MOTION, None),
    "springs alone": (LEG, ELASTIC),
    "one torque": (LEG, ("knee_pitch",)),
    "rows in another order": (LEG, ELASTIC[::-1]),
    "joints in another order": (some_joints(*REORDERED, payloads=(TEST_MASS,)), None),
    "rotary spring, elastic telescope": (arm(), None),
    "extra term": (WITH_CUBIC, None),
}
"""{case: the robot, and the joints whose torque is known if not all}."""


@pytest.fixture(params=list(CASES))
def case(request: pytest.FixtureRequest) -> tuple[Robot, LoadModel, Regression, Array]:
    robot, rows = CASES[request.param]
    model = model_of(robot, rows)
    springs = [j for j in model.torque_joints if j in robot.elastic_joints]
    both = simultaneous_regression(robot.without_nominal(), exact(robot), model, springs)
    return robot, model, both, truth_of(robot, model, both.names)


Case = tuple[Robot, LoadModel, Regression, Array]


def scaled_error(found: Array, rows: Regression, truth: Array) -> float:
    """Return the largest error, as a part of the parameter or of what one column can make of y."""
    size = np.abs(truth) + np.max(np.abs(rows.H * truth)) / np.max(np.abs(rows.H), axis=0)
    return float(np.max(np.abs(found - truth) / size))


@pytest.mark.rounding
def test_truth_solves_both_sides(case: Case) -> None:
    _, _, rows, truth = case
    residual = rows.y - rows.H @ truth
    assert np.max(np.abs(residual)) < 1e-10 * np.max(np.abs(rows.H * truth))


@pytest.mark.rounding
@pytest.mark.parametrize("case", quick_only(CASES, [*CASES][-3:]), indirect=True)
def test_noise_free_motion_gives_the_truth_from_any_start(case: Case) -> None:
    robot, _, rows, truth = case
    stiff = np.array([name.startswith("stiffness") for name in rows.names])
    for factor in (1.0, 0.2, 5.0, -1.0):
        found, iterations = settled(robot, rows, np.where(stiff, factor * truth, truth), OLS)
        assert scaled_error(found.values, rows, truth) < 1e-6
        assert np.max(np.abs(found.values[stiff] / truth[stiff] - 1)) < 1e-6
        assert iterations <= 8


def test_noise_of_the_acceleration_leaves_the_motor_equation_what_it_is() -> None:
    model = model_of(LEG)
    rows = simultaneous_regression(LEG, exact(LEG), model, ELASTIC)
    truth = truth_of(LEG, model, rows.names)
    load, motor, again = (
        rows.joint == offset * LEG.n + LEG.index("knee_pitch") for offset in range(3)
    )
    rng = np.random.default_rng(0)
    of_load = rng.normal(0, 0.1, np.sum(load))
    y = rows.y.copy()
    y[load] += of_load
    y[again] += of_load[np.searchsorted(rows.time[load], rows.time[again])]
    y[motor] += rng.normal(0, 1e-3, np.sum(motor))
    noisy = replace(rows, y=y)
    found = whitened(LEG, noisy, truth)
    residual = found.y - found.H @ truth
    noisy = noisy.at(rows.joint < 2 * LEG.n)
    load, motor = (found.joint == offset + LEG.index("knee_pitch") for offset in (0, LEG.n))
    assert residual[motor] == pytest.approx((noisy.y - noisy.H @ truth)[motor], abs=2e-4)
    assert abs(np.corrcoef(residual[motor], residual[load][-np.sum(motor) :])[0, 1]) < 0.2


@pytest.mark.slow  # 200 estimates
def test_errors_are_as_large_as_the_standard_errors_say() -> None:
    robot, model = TWO_SPRINGS.without_nominal(), model_of(TWO_SPRINGS)
    sensors = Noise(2 * np.pi / 2000, 2 * np.pi / 2**14, torque_std_Nm=0.005)
    unsensed = replace(exact(TWO_SPRINGS), joint_torque=np.full((len(TIME), 2), np.nan))
    scores = []
    for seed in range(200):
        log = measure(TWO_SPRINGS, unsensed, sensors, seed)
        motion = reconstruct_motion(robot, log, 8.0)
        rows = simultaneous_regression(robot, motion, model, robot.joint_names)
        truth = truth_of(TWO_SPRINGS, model, rows.names)
        found, _ = settled(robot, rows, truth, WLS)
        scores.append((found.values - truth) / found.standard_errors)
    check_scores(scores, band=1.2)


@pytest.mark.parametrize(
    ("springs", "is_blind"),
    [(ELASTIC, True), (("hip_pitch", "ankle_pitch"), True), (("hip_pitch", "ankle_pitch"), False)],
)
def test_a_spring_whose_torque_is_measured(springs: tuple[str, ...], is_blind: bool) -> None:
    """(4b) stands for (7) without a motor torque, by itself or freed of the spring by (8)."""
    motion = exact(LEG)
    if is_blind:
        motion = with_channels(motion, "knee_pitch", motor_torque=lambda x: np.nan * x)
    rows = simultaneous_regression(LEG, motion, model_of(LEG), springs)
    assert ("viscous_friction of knee_pitch" not in rows.names) == is_blind
    truth = truth_of(LEG, model_of(LEG), rows.names)
    assert np.max(np.abs(rows.y - rows.H @ truth)) < 1e-9 * np.max(np.abs(rows.H * truth))
    found, _ = settled(LEG, rows, 1.5 * truth, OLS)
    assert scaled_error(found.values, rows, truth) < 1e-6


def test_shifted_zero_does_what_it_does_on_the_load_side() -> None:
    motion, model = exact(arm()), model_of(arm())
    elastic = arm().elastic_joints
    springs = {x: np.array([true_value(arm(), x, "stiffness"), 0.0]) for x in elastic}
    at_once = partial(simultaneous_regression, arm(), model=model, springs=elastic)
    theta = truth_of(arm(), model, at_once(motion).names)
    both = offset_sensitivity(arm(), motion, at_once, theta)
    of_load = partial(load_regression, arm(), model=model, springs=springs)
    load = offset_sensitivity(arm(), motion, of_load, theta[-len(model.names) :])
    count, motors = len(load.y), both.joint // arm().n == 1
    assert both.propagated[:count] == pytest.approx(load.propagated, abs=1e-5)
    assert np.max(np.abs(load.propagated)) > 1.0
    assert np.max(np.abs(both.propagated[motors])) < 1e-9  # (7) does not know where the joint is


def test_errors_of_rows_that_cannot_be_made() -> None:
    blind = replace(exact(LEG), joint_torque=np.full_like(exact(LEG).joint_torque, np.nan))
    still = replace(blind, motor_torque=np.full_like(blind.motor_torque, np.nan))
    for motion, rows, springs, words in (
        (blind, None, ("hip_pitch", "ankle_pitch"), "no torque in the log at knee_pitch; name the"),
        (blind, None, ("hip_yaw",), "joint 'hip_yaw' has no spring"),
        (still, ELASTIC, ELASTIC, "elastic joint 'hip_pitch' has no torque in the log"),
    ):
        with pytest.raises(LogError, match=words):
            simultaneous_regression(LEG, motion, model_of(LEG, rows), springs)


@pytest.mark.slow  # 0.5 s
def test_errors_of_iterations() -> None:
    robot, model = TWO_SPRINGS, model_of(TWO_SPRINGS)
    rows = simultaneous_regression(robot, exact(robot), model, robot.joint_names)
    with pytest.raises(
        IdentificationError, match="stiffness of zero, which predicts no deflection"
    ):
        settled(robot, rows, np.zeros(len(rows.names)), OLS)
    rng = np.random.default_rng(0)

    def restless(one: Regression, theta: Array) -> Estimate:
        estimate = ordinary(one)
        step = 1e-4 * rng.normal() * (np.arange(len(one.names)) == 0)
        return replace(estimate, values=estimate.values + step)

    words = "not converge in 50 iterations: viscous_friction of hip_pitch still changes by .* N m s"
    with pytest.raises(IdentificationError, match=words):
        settled(robot, rows, truth_of(robot, model, rows.names), restless)


@pytest.mark.parametrize("ratios", [(0.96,), (0.96, -0.93), (0.97, -0.95, 0.9, 0.6)])
def test_slow_and_alternating_iterations_end_in_few_steps(ratios: tuple[float, ...]) -> None:
    """Plain iterations need more than a hundred."""
    robot, model = TWO_SPRINGS, model_of(TWO_SPRINGS)
    rows = simultaneous_regression(robot, exact(robot), model, robot.joint_names)
    noise = np.random.default_rng(0).normal(0, 0.05, len(rows.y))
    end = ordinary(replace(rows, y=rows.y + noise))
    linear = [k for k, name in enumerate(rows.names) if name.quantity != "stiffness"]
    ratio, start = np.zeros(len(rows.names)), end.values.copy()
    ratio[linear[: len(ratios)]] = ratios
    start += 5 * end.standard_errors * (ratio != 0)

    def slow(_: Regression, theta: Array) -> Estimate:
        """Contract, faster at a distance from the end."""
        away = theta - end.values
        shares = ratio / (1 + 1e-3 * (away / end.standard_errors) ** 2)
        return replace(end, values=end.values + shares * away)

    found, iterations = settled(robot, rows, start, slow)
    assert iterations <= 15
    # The last step is below 1e-3 standard errors, and the way left a geometric sum of such.
    left = np.abs(found.values - end.values) / end.standard_errors
    assert np.max(left) < 1e-3 / (1 - max(ratios))


@pytest.mark.slow  # 5.0 s
@pytest.mark.parametrize("sensors", quick_first([LEG_SENSORS, Noise()]), ids=["noisy", "perfect"])
def test_missing_friction_at_the_hip_converges(sensors: Noise) -> None:
    """0.3 N m behind the spring: weights settled in every iteration alternated between two ends."""
    table = tomllib.loads((MODELS / "tulip_leg.toml").read_text(encoding="utf-8"))
    table["hip_pitch"] |= {"joint_friction": ["coulomb"], "joint_coulomb_friction_Nm": 0.3}
    dry = load_robot(MODELS / "tulip_leg.urdf", table)
    log = measure(dry, simulate_motion(dry, leg_trajectory()), sensors, 0)
    found = identify(IN_MOTION.without_nominal(), log, method="simultaneous")
    for joint in ELASTIC:
        true = true_value(IN_MOTION, joint, "stiffness")
        assert found.drives[joint].value("stiffness") == pytest.approx(true, rel=0.02)


@pytest.mark.usefixtures("estimates_only")
def test_a_complete_model_has_both_sides_at_once_by_default() -> None:
    known = leg(TEST_MASS).without_nominal()
    by_data = identify(known, leg_log())
    chosen = identify(known, leg_log(), method="simultaneous")
    assert by_data.method == chosen.method == "simultaneous"
    assert by_data.not_shared == ""
    np.testing.assert_array_equal(by_data.load.values, chosen.load.values)
    assert "method: simultaneous" in by_data.summary()


@pytest.mark.parametrize(
    ("factor", "drag", "spring", "reason"),
    [
        (1.05, 0.0, ("linear",), "contradicts the motor equations"),
        (1.0, 0.0, ("linear", "cubic"), "the spring of knee_pitch has cubic"),
        pytest.param(1.0, 4e-7, ("linear",), "missing-term at knee_pitch", marks=pytest.mark.slow),
    ],
)
def test_an_incomplete_model_is_identified_in_turn(
    factor: float, drag: float, spring: tuple[str, ...], reason: str
) -> None:
    """The torque of the knee has another scale, or drag by the square of its speed."""
    w = leg_motion(TEST_MASS).motor_velocity[:, leg().index("knee_pitch")]
    log = with_channels(
        leg_log(), "knee_pitch", motor_torque=lambda x: factor * x + drag * w * np.abs(w)
    )
    known = leg(TEST_MASS).without_nominal()
    by_data = identify(with_drive(known, "knee_pitch", spring=spring), log)
    assert by_data.method == "two-step"
    assert reason in by_data.not_shared
    assert by_data.not_shared in by_data.summary()


@pytest.mark.usefixtures("estimates_only")
@pytest.mark.parametrize(
    ("estimator", "method", "words"),
    [
        ("wls", "simultaneous", "by least squares weighted per joint (wls)"),
        (
            "iv",
            "two-step",
            "by instrumental variables (iv), since instruments are of the equations",
        ),
        ("huber", "simultaneous", "by Huber's M-estimate (huber)"),
    ],
)
def test_method_estimator_and_reason_are_in_summary_file_and_page(
    estimator: EstimatorName, method: str, words: str
) -> None:
    found = identify(leg(TEST_MASS).without_nominal(), leg_log(), estimator=estimator)
    assert words in found.summary()
    of_file = content_of(found)["method"]
    assert of_file == {"name": method, "estimator": estimator, "not_shared": found.not_shared}
    assert words in dict(settings_facts(found))["Method"]
