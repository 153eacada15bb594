"""Friction by temperature of the motor and over time: recovered, selected, refused, exported."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid._arrays import Array
from seaid.drives import Drive, SeriesElasticDrive, StiffDrive
from seaid.errors import IdentificationError, LogError, SeaidError
from seaid.identification import Identification
from seaid.log import Log
from seaid.robot import Robot
from seaid.simulation.forward_dynamics import begin_of
from seaid.simulation.plant import JOINT_SPEED, SPEED, plant_of, warmed
from seaid.simulation.simulation import measure
from tests.experiments import LEG_SENSORS, TEST_MASS, leg, leg_motion, leg_trajectory, wiggle
from tests.mistakes import with_channels
from tests.one_joint import one_joint
from tests.representatives import quick_first
from tests.standard_errors import scores
from tests.terms import exact_motion, noisy_log

KNEE = "knee_pitch"
TERMS: tuple[str, ...] = ("viscous", "coulomb", "viscous_temperature", "coulomb_temperature")
SLOPES = {"viscous_temperature_slope": -0.96e-6, "coulomb_temperature_slope": -1.1e-5}
"""-1.2 and -0.4 % of the friction of the knee per kelvin."""


def warming(drive: Drive) -> Drive:
    return replace(drive, friction=TERMS, nominal={**drive.nominal, **SLOPES})


def log_at(warmth: Array, slopes: tuple[float, ...] = tuple(SLOPES.values()), seed: int = 1) -> Log:
    """Return a log whose knee has more friction by the formula, at the same motion."""
    motion = leg_motion(TEST_MASS)
    speed = motion.motor_velocity[:, leg().index(KNEE)]
    more = (warmth - 25.0) * (slopes[0] * speed + slopes[1] * np.sign(speed))
    motion = replace(motion, motor_temperature=np.full_like(motion.motor_torque, np.nan))
    motion = with_channels(
        motion, KNEE, motor_torque=lambda x: x + more, motor_temperature=lambda _: warmth
    )
    return measure(leg(TEST_MASS), motion, LEG_SENSORS, seed)


def ramp(low: float = 18.0, high: float = 48.0) -> Array:
    return np.linspace(low, high, len(leg_motion(TEST_MASS).time))


def robot_of(terms: tuple[str, ...] = TERMS) -> Robot:
    robot = leg(TEST_MASS)
    drive = replace(robot.drives[KNEE], friction=terms)
    return robot.with_drives({KNEE: drive}).without_nominal()


@cache
def found() -> Identification:
    return seaid.identify(robot_of(), log_at(ramp()))


@pytest.mark.slow  # 0.6 s
def test_friction_of_a_warming_motor_is_recovered_within_its_intervals() -> None:
    estimate, true = found().drives[KNEE], {**leg(TEST_MASS).drives[KNEE].values, **SLOPES}
    names = {"viscous_friction", "coulomb_friction", *SLOPES}
    assert np.max(np.abs(scores(estimate, {name: true[name] for name in names}))) < 3
    assert estimate.standard_error("viscous_temperature_slope") < 0.2e-6
    assert not any(one.severity == "wrong" for one in found().warnings)


def test_terms_of_a_temperature_are_compared_where_it_was_logged() -> None:
    log = replace(log_at(ramp()), motor_temperature=None)
    terms = {"friction": ["quadratic"]}
    selection = seaid.compare_terms(robot_of(TERMS[:2]), log, joints=KNEE, terms=terms)
    assert {one.term for one in selection.comparisons} == {"quadratic"}
    with pytest.raises(IdentificationError, match="a log has none: log 'knee_pitch"):
        seaid.compare_terms(
            robot_of(TERMS[:2]), log, joints=KNEE, terms={"friction": ["viscous_temperature"]}
        )
    warm = seaid.compare_terms(
        robot_of(TERMS[:2]), log_at(ramp()), joints=KNEE, terms={"friction": TERMS[2:]}
    )
    assert ("friction", "viscous_temperature") in warm.recommended[KNEE]


@pytest.mark.slow  # 1 s
@pytest.mark.usefixtures("estimates_only")
def test_a_cold_and_a_warm_log_are_a_range_together() -> None:
    both = [log_at(ramp(20.0, 20.5)), log_at(ramp(45.0, 45.5), seed=2)]
    estimate = seaid.identify(robot_of(), both).drives[KNEE]
    name = "viscous_temperature_slope"
    assert abs(scores(estimate, {name: SLOPES[name]})) < 3


LIKE = r"ranges from 31 to {} degC: .* needs a range of 2 K"
HEATED: tuple[str, ...] = ("viscous", "coulomb", "viscous_warm_up")


@pytest.mark.parametrize(
    ("terms", "warmth", "is_long", "words"),
    [
        (TERMS, (31.0, 31.4), False, LIKE.format(31.4)),
        (TERMS, (31.0, 31.0), False, LIKE.format(31)),
        (TERMS, (31.0, 31.4), True, LIKE.format(31.4)),
        (TERMS, None, False, "or remove its terms viscous_temperature"),
        (HEATED, (31.0, 50.0), True, "in pieces: read it with read_log"),
    ],
)
@pytest.mark.usefixtures("estimates_only")
def test_logs_that_show_no_such_friction_are_refused(
    tmp_path: Path,
    terms: tuple[str, ...],
    warmth: tuple[float, float] | None,
    is_long: bool,
    words: str,
) -> None:
    """In memory or in pieces, where a warm-up is not searched for."""
    log = log_at(ramp(*(warmth or (18.0, 48.0))))
    log = log if warmth else replace(log, motor_temperature=None)
    seaid.write_log(log, tmp_path / "log.npz")
    with pytest.raises(SeaidError, match=words):
        seaid.identify(robot_of(terms), tmp_path / "log.npz" if is_long else log)


def test_a_plant_at_one_temperature_is_that_of_the_friction_there() -> None:
    robot = leg(TEST_MASS)
    drives = {joint: warming(robot.drives[joint]) for joint in ("hip_yaw", KNEE)}
    warm = robot.with_drives(drives)
    one = warmed(plant_of(warm), np.full(robot.n, 45.0))
    other = plant_of(warm.at_temperature(45.0))
    rng = np.random.default_rng(0)
    for state in rng.normal(size=(5, 4, robot.n)):
        torque = rng.normal(size=robot.n)
        found = [
            begin_of(plant, plant.model.createData(), state, torque, np.sign(state[1]))[1][
                [SPEED, JOINT_SPEED]
            ]
            for plant in (one, other)
        ]
        np.testing.assert_allclose(found[0], found[1], rtol=1e-9)


def test_export_states_the_temperature_of_the_friction(tmp_path: Path) -> None:
    robot = leg(TEST_MASS)
    warm = robot.with_drives({KNEE: warming(robot.drives[KNEE])})
    for path, write in (("leg.xml", seaid.write_mjcf), ("leg.urdf", seaid.write_urdf)):
        write(warm, tmp_path / path, at_temperature_degC=45.0)
        text = (tmp_path / path).read_text()
        assert "friction of knee_pitch at a motor temperature of 45 degC" in text
    damping = re.findall(r'damping="([^"]+)"', (tmp_path / "leg.xml").read_text())
    assert any(abs(float(one) - (8e-5 - 20 * 0.96e-6)) < 1e-9 for one in damping)
    back = seaid.load_robot(tmp_path / "leg.urdf", tmp_path / "leg.toml")
    assert back.drives[KNEE].friction == TERMS
    assert back.drives[KNEE].values == warm.drives[KNEE].values
    assert "degC" not in seaid.write_mjcf(robot, tmp_path / "plain.xml").notes[2]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"knee": 20.0}, "did you mean 'knee_pitch'"),
        ({KNEE: 400.0}, "must be between -100 and 300 degC, found"),
        ({KNEE: ()}, "must be between -100 and 300 degC, found"),
    ],
)
def test_temperatures_of_a_simulation_are_checked(given: dict[str, float], words: str) -> None:
    with pytest.raises(SeaidError, match=words):
        seaid.simulate(leg(), leg_trajectory(), temperature_degC=given)


WARM_UP: tuple[str, ...] = ("viscous", "coulomb", "viscous_warm_up", "coulomb_warm_up")
COLD = {"cold_viscous_friction": 0.02, "cold_coulomb_friction": 0.02, "warm_up_time": 15.0}
FRICTION = {"viscous_friction": 0.03, "coulomb_friction": 0.05}


def cold_arm(folder: Path, kind: str = "stiff") -> Robot:
    """Return one joint whose drive is cold when its log starts."""
    common: dict[str, Any] = {"gear_ratio": 5.0, "motor_inertia_kg_m2": 1e-4, "friction": WARM_UP}
    drive = StiffDrive(**common) if kind == "stiff" else SeriesElasticDrive(**common)
    spring = {} if kind == "stiff" else {"stiffness": 200.0}
    return one_joint(folder).with_drives({"arm": drive.with_values({**FRICTION, **COLD, **spring})})


def without_terms(robot: Robot) -> Robot:
    drive = robot.drives["arm"].at_temperature()
    return robot.with_drives({"arm": drive}).without_nominal()


def cold_log(robot: Robot, periods: int = 8, seed: int = 1) -> Log:
    """Return a log of the formulas, of some periods of 8 s."""
    motion = exact_motion(robot, reach=(1.0,), periods=periods)
    return noisy_log(motion, 0.005, 1e-5, seed, motor_std=1e-4)


@pytest.mark.slow  # 1.4 s
@pytest.mark.parametrize("kind", quick_first(["stiff", "elastic"]))
def test_warm_up_is_selected_and_recovered_within_its_intervals(tmp_path: Path, kind: str) -> None:
    robot = cold_arm(tmp_path, kind)
    log = cold_log(robot)
    later = replace(log, time=log.time + 1.7e9)  # a clock that does not start with the log
    selection = seaid.compare_terms(without_terms(robot), later)
    assert {term for _, term in selection.recommended["arm"]} == {*WARM_UP[2:]}
    found = seaid.identify(selection.robot, log)
    estimate = found.drives["arm"]
    assert np.max(np.abs(scores(estimate, {**FRICTION, **COLD}))) < 3.5
    assert estimate.standard_error("warm_up_time") < 0.1 * COLD["warm_up_time"]
    drive = found.robot.drives["arm"]
    assert drive.at_temperature().friction == ("viscous", "coulomb")
    assert not {*COLD} & {*drive.at_temperature().values}


def test_without_a_warm_up_none_is_selected_and_short_logs_are_not_searched(tmp_path: Path) -> None:
    robot = cold_arm(tmp_path)
    warm = without_terms(robot)
    plain = robot.with_drives({"arm": robot.drives["arm"].at_temperature()})
    selection = seaid.compare_terms(warm, cold_log(plain))
    assert "viscous_warm_up" in {one.term for one in selection.comparisons}
    assert not selection.recommended
    short = seaid.compare_terms(warm, cold_log(robot, 2))
    assert not {*WARM_UP[2:]} & {one.term for one in short.comparisons}


def test_a_log_that_is_shorter_than_the_warm_up_is_refused_with_the_remedy(tmp_path: Path) -> None:
    robot = cold_arm(tmp_path)
    log = cold_log(robot, 1)
    with pytest.raises(IdentificationError, match=r"longer than the log of 8 s, .* no warm motor"):
        seaid.identify(robot.without_nominal(), log)
    drive = replace(robot.drives["arm"], known=("warm_up_time",))
    found = seaid.identify(robot.with_drives({"arm": drive}).without_nominal(), log).drives["arm"]
    truth = {x: {**FRICTION, **COLD}[x] for x in ("viscous_friction", "cold_viscous_friction")}
    assert np.max(np.abs(scores(found, truth))) < 3.5
    terms = {"friction": WARM_UP[2:3]}
    selection = seaid.compare_terms(without_terms(robot), log, terms=terms)
    assert "warms up over" in selection.comparisons[0].reason
    assert not selection.recommended


@pytest.mark.slow  # long simulations of a warming motor
@pytest.mark.parametrize("terms", [TERMS, WARM_UP], ids=["temperature", "time"])
def test_a_simulated_motor_has_the_friction_of_its_time_and_replays(
    tmp_path: Path, terms: tuple[str, ...]
) -> None:
    """A motor that is cold all the time, and one that is warm, move otherwise."""
    is_time = terms is WARM_UP
    drive = StiffDrive(gear_ratio=5.0, motor_inertia_kg_m2=1e-4, friction=terms)
    slopes = {"viscous_temperature_slope": -4e-4, "coulomb_temperature_slope": -4e-4}
    bent = {**COLD, "warm_up_time": 0.7} if is_time else slopes
    robot = one_joint(tmp_path).with_drives({"arm": drive.with_values({**FRICTION, **bent})})
    plan = wiggle(robot, 1.5, (0.0,), (1.0,), seed=1)
    heated = None if is_time else {"arm": (20.0, 60.0)}
    log = seaid.simulate(robot, plan, rate_hz=500.0, temperature_degC=heated)
    warm = robot.drives["arm"].at_temperature(40.0)
    cold = warm.with_values({"viscous_friction": 0.05, "coulomb_friction": 0.07})
    errors = [
        np.max(np.abs(seaid.replay(one, log).joint_position - log.joint_position))
        for one in (robot, *(robot.with_drives({"arm": same}) for same in (warm, cold)))
    ]
    assert errors[0] < 0.1 * min(errors[1:])
    if is_time:
        notes = " ".join(seaid.write_mjcf(robot, tmp_path / "arm.xml").notes)
        assert "friction of arm of a warm motor" in notes
        return
    assert log.motor_temperature is not None
    np.testing.assert_allclose(log.motor_temperature[:, 0], np.linspace(20.0, 60.0, 751))
    with pytest.raises(LogError, match="the log has no motor temperature of 'arm'"):
        seaid.replay(robot, replace(log, motor_temperature=None))
