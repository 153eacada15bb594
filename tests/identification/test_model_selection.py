"""Which terms the data support: what is there is recommended, what is not is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scripts.benchmarks import hysteresis
from seaid.drives.equations import states
from seaid.errors import IdentificationError
from seaid.identification import compare_terms, identify
from seaid.simulation.simulation import measure
from tests.experiments import TEST_MASS, leg, leg_log, leg_motion
from tests.mistakes import with_torque
from tests.terms import ELASTIC, STIFF, TIME, arm, exact_motion, noisy_log, with_terms

ROBOT = leg(TEST_MASS).without_nominal()


def test_a_term_that_is_there_is_recommended_alone() -> None:
    """A knee that sticks more than it slides."""
    speed = leg_motion(TEST_MASS).motor_velocity[:, 3]
    log = with_torque("knee_pitch", 0.02 * np.exp(-((speed / 60.0) ** 2)) * np.sign(speed))
    terms = {"friction": ("stribeck", "quadratic", "asymmetric"), "spring": ("cubic",)}
    found = compare_terms(ROBOT, log, joints=["knee_pitch"], terms=terms)
    assert dict(found.recommended) == {"knee_pitch": (("friction", "stribeck"),)}
    assert found.robot.drives["knee_pitch"].friction == ("viscous", "coulomb", "stribeck")
    steps = [[one.term for one in found.comparisons if one.step == step] for step in (0, 1)]
    assert steps[0] == ["stribeck", "quadratic", "asymmetric", "cubic"]
    assert {*steps[1]} == {"quadratic", "asymmetric", "cubic"}
    assert [one.term for one in found.comparisons if one.selected] == ["stribeck"]
    (line,) = (line for line in str(found).splitlines() if "friction stribeck" in line)
    assert line.split()[-1] == "selected"
    assert "knee_pitch: add 'stribeck' to friction; identify(selection.robot, ...)" in str(found)


@pytest.mark.parametrize(
    ("field", "width", "level"), [("friction", 6.0, 0.01), ("spring", 4e-4, 20.0)]
)
def test_hysteresis_that_is_there_is_recommended(field: str, width: float, level: float) -> None:
    """In the place of Coulomb friction or next to the spring."""
    motion, drive = leg_motion(TEST_MASS), leg().drives["knee_pitch"]
    motor = motion.motor_position[:, 3]
    lever = drive.motor_radius / drive.ratio
    if field == "spring":
        stretch = lever * motor - drive.load_radius * motion.joint_position[:, 3]
        more = lever * level * states(stretch, width)[0]
    else:
        coulomb = drive.values["coulomb_friction"]
        more = (coulomb + level) * states(motor, width)[0]
        more -= coulomb * np.sign(motion.motor_velocity[:, 3])
    log = with_torque("knee_pitch", more)
    terms = {"friction": ("dahl",), "spring": ("dahl", "dead_zone")}
    found = compare_terms(ROBOT, log, joints=["knee_pitch"], terms=terms)
    assert dict(found.recommended)["knee_pitch"][0] == (field, "dahl")
    assert "dahl" in getattr(found.robot.drives["knee_pitch"], field)


def test_a_log_without_reversals_has_a_reason_in_the_place_of_a_comparison(tmp_path: Path) -> None:
    robot = arm(tmp_path, STIFF, ELASTIC)
    motion = exact_motion(robot)
    joint, motor = motion.joint_position.copy(), motion.motor_position.copy()
    joint[:, 0] = 0.3 * TIME + 0.05 * np.sin(TIME)
    motor[:, 0] = 40 * joint[:, 0]
    log = noisy_log(replace(motion, joint_position=joint, motor_position=motor), 0.003, 2e-5)
    terms = {"friction": ("dahl", "offset")}
    known = robot.without_nominal()
    found = compare_terms(known, log, joints=["one"], terms=terms, cutoff_hz=10.0)
    for one in found.comparisons:
        is_law = one.term == "dahl"
        assert (one.comparison is None) == is_law
        assert ("the angle of the motor never turns back" in one.reason) == is_law


@pytest.mark.slow  # 0.7 s
def test_what_is_not_there_is_not_recommended() -> None:
    terms = {
        "friction": ("offset", "quadratic", "load", "dahl"),
        "spring": ("dead_zone", "dahl"),
        "joint_friction": ("coulomb",),
    }
    found = compare_terms(ROBOT, leg_log(3), joints=["hip_roll", "ankle_pitch"], terms=terms)
    assert not found.recommended
    assert "The data support no term in addition" in str(found)
    asked = {(one.joint, one.term) for one in found.comparisons}
    assert ("ankle_pitch", "offset") not in asked  # an elastic drive cannot have it
    assert ("hip_roll", "dead_zone") not in asked  # no spring
    assert ("ankle_pitch", "coulomb") in asked


def test_what_a_load_side_lacks_is_found_there() -> None:
    terms = {"friction": ("offset", "asymmetric")}
    found = compare_terms(ROBOT, with_torque("hip_roll", 0.03), joints=["hip_roll"], terms=terms)
    assert dict(found.recommended) == {"hip_roll": (("friction", "offset"),)}


@pytest.mark.parametrize(
    ("field", "term", "words"),
    [
        ("frictions", "load", "no field is named 'frictions'; did you mean 'friction"),
        ("friction", "lod", "no friction term is named 'lod'; did you mean 'load'"),
    ],
)
def test_unknown_terms_are_refused(field: str, term: str, words: str) -> None:
    """The error names the nearest."""
    with pytest.raises(IdentificationError, match=rf"terms=: {words}"):
        compare_terms(ROBOT, leg_log(3), terms={field: (term,)})


@pytest.mark.slow  # 1.2 s
def test_a_width_of_coulomb_friction_is_recommended() -> None:
    """A torque that turns with the direction of the hip over 15 rad/s, a tenth of its speeds."""
    speed = leg_motion(TEST_MASS).motor_velocity[:, 1]
    own = leg().drives["hip_roll"].values["coulomb_friction"]
    log = with_torque("hip_roll", (own + 0.05) * np.tanh(speed / 15.0) - own * np.sign(speed))
    found = compare_terms(ROBOT, log, joints=["hip_roll"])
    assert dict(found.recommended) == {"hip_roll": (("friction", "smooth_coulomb"),)}
    drive = found.robot.drives["hip_roll"]
    assert drive.friction == ("viscous", "smooth_coulomb")
    assert drive.known == ()
    width = identify(found.robot, log).drives["hip_roll"].value("coulomb_width")
    assert width == pytest.approx(15.0, rel=0.2)


def test_a_term_that_the_log_has_no_equation_for_says_so() -> None:
    log = with_torque("knee_pitch", np.nan)
    sensed = np.full_like(log.motor_torque, np.nan)
    sensed[:, 3] = leg_motion(TEST_MASS).joint_torque[:, 3] + 0.01 * np.sin(log.time)
    log = replace(log, joint_torque=sensed)
    found = compare_terms(ROBOT, log, joints=["knee_pitch"], terms={"friction": ["stribeck"]})
    (one,) = found.comparisons
    assert one.comparison is None
    assert one.reason.startswith("it has no column: the log lacks its equation")


@pytest.mark.slow  # a comparison of all terms
def test_a_dead_zone_whose_teeth_bounce_is_found_at_a_higher_cutoff(tmp_path: Path) -> None:
    """At the cutoff of this motion the searched dead zone explains a tenth of the residual."""
    _, contact, terms, values = hysteresis.CASES["backlash, contact of 4000 N m/rad"]
    truth = arm(tmp_path, STIFF, with_terms(contact, terms, values))
    log = measure(truth, hysteresis.motion_of(truth, 0), hysteresis.SENSORS, 0)
    known = arm(tmp_path, STIFF, contact).without_nominal()
    terms = {"spring": ("dahl", "dead_zone")}
    found = compare_terms(known, log, joints=["two"], terms=terms)
    assert dict(found.recommended) == {"two": (("spring", "dead_zone"),)}
    (chosen,) = (one for one in found.comparisons if one.selected)
    first = [one for one in found.comparisons if one.cutoff_hz is None]
    assert not any(one.is_supported for one in first)
    assert chosen.cutoff_hz is not None
    assert f"spring dead_zone at {chosen.cutoff_hz:.3g} Hz" in str(found)
    assert chosen.values["dead_zone"] == pytest.approx(0.005, rel=0.1)
    given = compare_terms(known, log, joints=["two"], terms=terms, cutoff_hz=6.0)
    assert all(one.cutoff_hz is None for one in given.comparisons)
