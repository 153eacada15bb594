"""Frequency responses of linear plants that scipy simulates, and the springs found in them."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import seaid
from seaid._arrays import Array
from seaid.frequency import FrequencyResponse, frequency_response
from seaid.frequency.linear_joints import linearised
from seaid.log import Log
from tests.experiments import with_drive
from tests.linear_plant import (
    RATE_HZ,
    TwoMass,
    driven,
    log_of,
    multisine_torque,
    state_space,
)
from tests.mistakes import unlogged
from tests.one_joint import chain
from tests.representatives import quick_first

MODELS = Path(__file__).parents[2] / "models"
PLANT = TwoMass()
NAMES = ("resonance", "resonance_damping", "antiresonance", "antiresonance_damping")
ALL = (*NAMES, "stiffness", "spring_damping", "load_inertia", "viscous_friction")


@cache
def clean_log(seed: int = 0, top_hz: float = 25.0) -> Log:
    return PLANT.log(multisine_torque(0.1, seed=seed, top_hz=top_hz), joint=True)


def with_noise(log: Log, seed: int, torque_std: float = 0.005, angle_std: float = 1e-3) -> Log:
    noise = np.random.default_rng(seed).normal(size=(2, len(log.time), 1))
    torque, motor = log.motor_torque + torque_std * noise[0], log.motor_position
    return log_of(("arm",), torque, motor + angle_std * noise[1])


def values(found: FrequencyResponse, *names: str) -> Array:
    return np.array([found.drives["arm"].value(name) for name in names])


@pytest.mark.slow  # 0.6 s
@pytest.mark.parametrize("known", quick_first(["all", "no values", "no bodies"]))
def test_springs_of_a_linear_plant_need_no_joint_encoder(tmp_path: Path, known: str) -> None:
    """Also where spring, friction and body have no value, or the file has no body at all."""
    robot = PLANT.robot(tmp_path, nominal=known == "all")
    if known == "no values":
        robot = robot.without_nominal()
    if known == "no bodies":
        text = (tmp_path / "pendulum.urdf").read_text("utf-8")
        bare = text[: text.index("<inertial>")] + text[text.index("</inertial>") + 11 :]
        (tmp_path / "pendulum.urdf").write_text(bare, "utf-8")
        robot = seaid.load_robot(tmp_path / "pendulum.urdf", robot.drives)
    found = frequency_response(robot, unlogged(clean_log(), "joint_position"), period_s=4.0)
    truth = [*PLANT.modes, PLANT.stiffness, PLANT.damping, PLANT.load, PLANT.friction]
    assert values(found, *ALL, "gravity_stiffness") == pytest.approx(
        [*truth, PLANT.gravity], rel=3e-3
    )
    assert found.warnings == ()


def test_a_rotor_inertia_that_is_not_stated_is_estimated(tmp_path: Path) -> None:
    robot = PLANT.robot(tmp_path)
    robot, log = with_drive(robot, "arm", motor_inertia_kg_m2=None), with_noise(clean_log(), 1)
    found = frequency_response(robot, log, period_s=4.0)
    assert values(found, "motor_inertia") == pytest.approx([PLANT.motor_inertia], rel=0.01)
    assert values(found, "stiffness") == pytest.approx([PLANT.stiffness], rel=0.01)
    assert found.warnings == ()


@pytest.mark.slow  # 2.2 s
@pytest.mark.parametrize("factor", [0.7, 1.0, 1.3])
def test_a_wrong_rotor_inertia_is_named_with_the_right_one(tmp_path: Path, factor: float) -> None:
    robot = PLANT.robot(tmp_path)
    drive = robot.drives["arm"].with_values({"motor_inertia": factor * PLANT.motor_inertia})
    log = with_noise(clean_log(), 1)
    found = frequency_response(robot.with_drives({"arm": drive}), log, period_s=4.0)
    named = [one for one in found.warnings if one.code == "rotor-inertia"]
    assert len(named) == (factor != 1)
    for finding in named:
        assert finding.evidence["stiffness with it"] == pytest.approx(PLANT.stiffness, rel=0.01)
        line = finding.remedy.splitlines()[-1]
        assert line.startswith("motor_inertia_kg_m2 = ")
        assert float(line.split()[-1]) == pytest.approx(PLANT.motor_inertia, rel=0.01)


@pytest.mark.slow  # 1.1 s
def test_the_response_is_that_of_the_plant_within_its_standard_deviations(tmp_path: Path) -> None:
    """Near the antiresonance an error of the period that has not quite settled is seen."""
    robot = PLANT.robot(tmp_path)
    found = frequency_response(robot, clean_log(), period_s=4.0)
    exact = PLANT.response(found.frequency_hz)
    assert found.response[:, 0, 0] == pytest.approx(exact, rel=0.02)
    assert found.model[:, 0, 0] == pytest.approx(exact, rel=2e-3)
    noisy = frequency_response(robot, with_noise(clean_log(), 1), period_s=4.0)
    scores = np.abs(noisy.response[:, 0, 0] - exact) / noisy.noise_std[:, 0, 0]
    assert 0.6 < np.sqrt(np.mean(scores**2)) < 1.6
    assert np.all(noisy.coherence > 0.9)


@pytest.mark.slow  # 30 fits of eight parameters
def test_intervals_hold_the_truth_as_often_as_they_say(tmp_path: Path) -> None:
    robot = PLANT.robot(tmp_path)
    truth = [*PLANT.modes, PLANT.stiffness, PLANT.damping, PLANT.load, PLANT.friction]
    scores = []
    for seed in range(30):
        found = frequency_response(robot, with_noise(clean_log(), seed), period_s=4.0)
        errors = [found.drives["arm"].standard_error(name) for name in ALL]
        scores.append((values(found, *ALL) - truth) / errors)
    spread = np.sqrt(np.mean(np.array(scores) ** 2))
    held = np.mean(np.abs(scores) < 1.96)
    assert 0.8 < spread < 1.3
    assert 0.88 < held < 0.99


@pytest.mark.slow  # logs of a hundred periods, simulated and fitted
def test_dry_friction_makes_the_nonlinear_variance_and_not_the_noise(tmp_path: Path) -> None:
    """Realisations differ by what is nonlinear, periods by noise only."""
    robot = PLANT.robot(tmp_path)
    logs = [
        [
            with_noise(PLANT.log(multisine_torque(0.1, seed=seed, left_out=4), coulomb=level), seed)
            for seed in range(4)
        ]
        for level in (0.0, 0.02)
    ]
    plain, dry = (frequency_response(robot, one, period_s=4.0) for one in logs)
    share = [np.median(one.total_std / one.noise_std) for one in (plain, dry)]
    assert share[0] < 1.5
    assert share[1] > 3.0
    one = frequency_response(robot, logs[1][0], period_s=4.0)
    assert np.median(one.total_std / one.noise_std) > 3.0  # by odd lines that are not excited
    terms = {"coulomb_friction_Nm": 0.02, "friction": ("viscous", "coulomb")}
    better = frequency_response(with_drive(robot, "arm", **terms), logs[1], period_s=4.0)
    assert values(better, *NAMES) == pytest.approx(PLANT.modes, rel=0.03)
    errors = [found.drives["arm"].standard_error("stiffness") for found in (better, dry)]
    assert errors[0] < errors[1]


@pytest.mark.slow  # logs of a hundred periods, simulated and fitted
def test_a_resonance_that_the_log_cannot_show_is_said_with_the_remedy(tmp_path: Path) -> None:
    robot = PLANT.robot(tmp_path)
    low = with_noise(clean_log(top_hz=2.0), 3)
    (one,) = frequency_response(robot, low, period_s=4.0).warnings
    assert (one.code, one.severity, one.joint) == ("hidden-resonance", "wrong", "arm")
    assert "the antiresonance is at 4.09 Hz, and the motion excites up to" in one.message
    assert one.remedy == "excite up to 6.13 Hz"

    slow = low.at(np.arange(len(low.time)) % 160 == 0)
    (one,) = frequency_response(robot, slow, period_s=4.0).warnings
    assert "half of the rate (Nyquist) is 3.125 Hz" in one.message
    assert one.remedy == "log at 15.3 Hz or more, and excite up to 6.13 Hz"

    blind = frequency_response(robot.without_nominal(), low, period_s=4.0).warnings
    assert "above that, or inside the noise" in blind[0].message
    faint = with_noise(clean_log(), 4, torque_std=2.0, angle_std=0.5)
    (one,) = frequency_response(robot, faint, period_s=4.0).warnings
    assert "noise and nonlinear distortion are" in one.message
    assert "times the amplitude" in one.remedy


PLAN = seaid.Trajectory(("arm",), seaid.excitation.make_basis("bspline", 4.0, 8), np.zeros((8, 1)))


REFUSED: list[tuple[Callable[[Log], dict[str, Any]], str]] = [
    (lambda _: {"logs": []}, "needs at least one log"),
    (lambda _: {"period_s": 50.0}, "shorter than the period"),
    (lambda _: {"period_s": -1.0}, "period_s must be more than zero"),
    (lambda _: {"band_hz": (3.0, 1.0)}, "band_hz must be a lowest and a highest"),
    (lambda _: {"band_hz": (1.0, 1.1)}, "excited frequencies from 1 to 1.1 Hz"),
    (lambda log: {"logs": unlogged(log, "motor_torque")}, "'arm' has no motor torque"),
    (lambda log: {"logs": [log, replace(log, time=log.time / 2)]}, "rates from 1000 to 2000 Hz"),
    (lambda log: {"logs": replace(log, motor_position=0 * log.motor_position)}, "no motor moves"),
    (lambda _: {"period_s": None, "plan": PLAN}, "must be a multisine"),
]


@pytest.mark.parametrize(("change", "says"), REFUSED)
def test_what_has_no_response_is_refused(
    tmp_path: Path, change: Callable[[Log], dict[str, Any]], says: str
) -> None:
    """Logs without a channel, of two rates or at rest, and bands and periods of nothing."""
    given: dict[str, Any] = {"logs": clean_log(), "period_s": 4.0} | change(clean_log())
    with pytest.raises(seaid.errors.IdentificationError, match=says):
        frequency_response(PLANT.robot(tmp_path), **given)


def cut() -> Log:
    return with_noise(clean_log(), 2, 0.001).between(0.3, 10.0)


def uneven() -> Log:
    """A clock that is 0.02 % fast makes a period of no whole number of samples."""
    log = clean_log()
    jitter = np.random.default_rng(0).uniform(-0.2, 0.2, len(log.time)) / RATE_HZ
    moved = log.time + jitter * (log.time > 0)
    torque, angle = (
        np.interp(moved, log.time, one[:, 0])[:, None]
        for one in (log.motor_torque, log.motor_position)
    )
    return replace(log_of(("arm",), torque, angle), time=moved)


@pytest.mark.slow  # logs of a hundred periods, simulated and fitted
@pytest.mark.parametrize(("make", "period_s", "share"), [(cut, None, 5e-3), (uneven, 4.0, 0.01)])
def test_logs_without_whole_periods_give_the_same_spring(
    tmp_path: Path, make: Callable[[], Log], period_s: float | None, share: float
) -> None:
    """A log that was cut, and one with uneven time stamps."""
    robot = PLANT.robot(tmp_path).without_nominal()
    found = frequency_response(robot, make(), period_s=period_s)
    assert found.period_s == period_s
    assert values(found, *NAMES) == pytest.approx(PLANT.modes, rel=share)
    assert values(found, "stiffness") == pytest.approx([PLANT.stiffness], rel=share)
    near = np.abs(found.response[:, 0, 0] / PLANT.response(found.frequency_hz) - 1)
    assert np.median(near) < 0.03


def test_the_table_has_every_number_and_warning(tmp_path: Path) -> None:
    found = frequency_response(
        PLANT.robot(tmp_path), with_noise(clean_log(top_hz=2.0), 3), period_s=4.0
    )
    text = found.summary()
    assert re.search(r"\barm +antiresonance_damping ", text)
    assert "hidden-resonance" in text
    assert repr(found).startswith("FrequencyResponse(joints arm: ")


@dataclass(frozen=True)
class Coupled:
    """Two hanging links with springs, coupled by their mass matrix, in SI units at the joints."""

    stiffness: tuple[float, float]
    inertia: tuple[float, float]
    mass: tuple[float, float, float]
    gravity: tuple[float, float, float]
    friction: tuple[float, float]
    damping: tuple[float, float]

    def log(self, seed: int) -> Log:
        """Drive both motors by independent multisines, with noise of 2 % in the torques."""
        springs, dampers = np.diag(self.stiffness), np.diag(self.damping)
        M, G = (np.array([one[:2], one[1:]]) for one in (self.mass, self.gravity))
        nothing = np.zeros((2, 2))
        mass = np.block([[np.diag(self.inertia), nothing], [nothing, M]])
        stiffness = np.block([[springs, -springs], [-springs, springs + G]])
        damping = np.block([[dampers + np.diag(self.friction), -dampers], [-dampers, dampers]])
        sizes = 10 * np.diag(M)
        waves = [
            multisine_torque(size, period_s=5.0, seed=10 * seed + i) for i, size in enumerate(sizes)
        ]
        torque = np.stack(waves, axis=1)
        angles = driven(state_space(mass, stiffness, damping, 2), torque, RATE_HZ)[:, :2]
        noise = 0.02 * sizes * np.random.default_rng(seed).normal(size=torque.shape)
        return log_of(("one", "two"), (torque + noise) / 100, 100 * angles)

    def robot(self, folder: Path, *, rotors: bool) -> seaid.Robot:
        """The robot without any value of springs, friction and bodies."""
        drive = {"type": "series_elastic", "gear_ratio": 100.0, "friction": ["viscous"]}
        drive["spring"] = ["linear", "damping"]
        known = [{"motor_inertia_kg_m2": one / 1e4} if rotors else {} for one in self.inertia]
        chain(folder, "one", "two")
        drives = {joint: drive | own for joint, own in zip(("one", "two"), known, strict=True)}
        return seaid.load_robot(folder / "robot.urdf", drives).without_nominal()


@pytest.mark.slow  # 0.9 s
@pytest.mark.parametrize("rotors", quick_first([True, False]))
def test_springs_of_coupled_joints_need_no_nominal_values(tmp_path: Path, rotors: bool) -> None:
    """From starts with one antiresonance for both joints, k was wrong by 6 to 25 % here."""
    plant = Coupled(
        *((255, 198), (0.483, 0.104), (1.10, 0.465, 0.225), (19.4, 7.08, 7.08)),
        *((1.8, 0.44), (0.38, 0.16)),
    )
    found = frequency_response(
        plant.robot(tmp_path, rotors=rotors), [plant.log(0), plant.log(1)], period_s=5.0
    )
    springs = [found.drives[joint].value("stiffness") for joint in ("one", "two")]
    assert springs == pytest.approx(plant.stiffness, rel=5e-3)
    assert found.warnings == ()


@pytest.mark.parametrize("picked", [[0, 1, 2], [0, 1]])
def test_springs_and_friction_at_coupled_joints_are_those_of_the_joints(picked: list[int]) -> None:
    """They once acted at the coordinates phi = C q of the drives, as if these were the joints."""
    C = np.array([[1.0, 0, 0], [0, 1, 1], [0, 1, -1]])
    names, stiffness, friction = ("elbow", "wrist_pitch", "wrist_roll"), (4, 3, 0.5), (2, 0.1, 0.7)
    drives = {
        name: seaid.SeriesElasticDrive(
            gear_ratio=50.0,
            motor_inertia_kg_m2=2e-5,
            stiffness_Nm_per_rad=30.0,
            transmission=dict(zip(names, row, strict=True)),
            friction=(),
            parallel_spring=("linear",),
            joint_friction=("viscous",),
        ).with_values({"parallel_stiffness": k, "joint_viscous_friction": b})
        for name, row, k, b in zip(names, C.tolist(), stiffness, friction, strict=True)
    }
    robot = seaid.load_robot(MODELS / "differential_wrist.urdf", drives)
    q, data, dq = np.array([0.3, -0.4, 0.2]), robot.model.createData(), 1e-4 * np.eye(3)
    M = np.triu(pin.crba(robot.model, data, q))
    M = M + np.triu(M, 1).T
    gravity = [pin.computeGeneralizedGravity(robot.model, data, x).copy() for x in q + dq]
    gravity -= np.array(
        [pin.computeGeneralizedGravity(robot.model, data, x).copy() for x in q - dq]
    )
    s = 2j * np.pi * 1.5
    at_joints = M * s**2 + np.diag(friction) * s + gravity / 2e-4 + np.diag(stiffness)
    # q = C^-1 phi: a drive that is not picked is held.
    motion = np.linalg.inv(C)[:, picked]
    springs = 30.0 * np.eye(len(picked))
    rotors = 50.0**2 * 2e-5 * s**2 * np.eye(len(picked))
    load = motion.T @ at_joints @ motion
    impedance = np.block([[rotors + springs, -springs], [-springs, load + springs]])
    compliance = linearised(robot, q, picked).compliance(np.array([s]))[0]
    np.testing.assert_allclose(compliance, np.linalg.inv(impedance), rtol=1e-5)


@pytest.mark.slow  # logs of a hundred periods, simulated and fitted
def test_a_spring_with_negative_damping_is_not_determined(tmp_path: Path) -> None:
    """A log at 12.5 Hz of a resonance of 7.6 Hz: the fit follows images of the sampling."""
    from scripts.benchmarks.motor_side import ANYDRIVE, robot_of, simulated

    log = simulated(replace(ANYDRIVE, highest_hz=2.0))
    rare = log.at(np.arange(len(log.time)) % 80 == 0)
    found = seaid.frequency_response(robot_of(ANYDRIVE, tmp_path), rare, period_s=10.0)
    assert found.drives["arm"].value("antiresonance_damping") < -0.05
    assert [one.code for one in found.warnings] == ["hidden-resonance"]
