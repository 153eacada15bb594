"""Which terms the data support: what is there is recommended, what is not is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seaid.drives.equations import states
from seaid.errors import IdentificationError
from seaid.identification import compare_terms
from tests.experiments import TEST_MASS, leg, leg_log, leg_motion
from tests.mistakes import with_torque
from tests.terms import ELASTIC, STIFF, TIME, arm, exact_motion, noisy_log

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


def test_a_term_that_the_log_has_no_equation_for_says_so() -> None:
    log = with_torque("knee_pitch", np.nan)
    sensed = np.full_like(log.motor_torque, np.nan)
    sensed[:, 3] = leg_motion(TEST_MASS).joint_torque[:, 3] + 0.01 * np.sin(log.time)
    log = replace(log, joint_torque=sensed)
    found = compare_terms(ROBOT, log, joints=["knee_pitch"], terms={"friction": ["stribeck"]})
    (one,) = found.comparisons
    assert one.comparison is None
    assert one.reason.startswith("it has no column: the log lacks its equation")
