"""Every term of a drive is found where it is, and found to be nothing where it is not."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from seaid.checks.codes import CODES
from seaid.drives import Drive
from seaid.errors import IdentificationError, LogError
from seaid.identification import Identification, identify, identify_conditions, refine
from seaid.identification.problem import explained
from seaid.log import Log, Motion
from seaid.regressor import identifiability
from seaid.robot import Payload, Robot
from tests.experiments import scores_of_drive, with_named_friction
from tests.representatives import quick_first, quick_only
from tests.standard_errors import check_scores
from tests.terms import (
    ELASTIC,
    STIFF,
    Case,
    arm,
    exact_motion,
    free_stretch,
    friction,
    identified,
    noisy_log,
    spring,
    with_terms,
)

pytestmark = pytest.mark.usefixtures("estimates_only")

FRICTION: dict[str, Case] = {
    "smooth": friction("smooth_coulomb", coulomb_width=1.5),
    "shifted": friction("shifted_coulomb", coulomb_width=1.5, coulomb_shift=0.4),
    "dahl": friction("dahl", presliding_angle=0.4),
    "dahl under load": friction("dahl", "load", presliding_angle=0.4, load_friction=0.1),
    "asymmetric": friction("coulomb", "asymmetric", asymmetric_friction=1e-4),
    "quadratic": friction("coulomb", "quadratic", quadratic_friction=2e-6),
    "position": (
        {"friction": ("viscous", "coulomb", "coulomb_position"), "reference_position_rad": 0.2},
        {"coulomb_position_slope": 0.01, "coulomb_position_curvature": 0.004},
    ),
    "load": friction("coulomb", "load", load_friction=0.1),
    "stribeck": friction("coulomb", "stribeck", stribeck_friction=0.02, stribeck_speed=8.0),
    "ripple": (
        {"torque_ripple": {"joint": [4]}},
        {"torque_ripple_joint_4_cos": 4e-3, "torque_ripple_joint_4_sin": -2e-3},
    ),
    "warm-up": (
        {"friction": ("viscous", "coulomb", "viscous_warm_up", "coulomb_warm_up")},
        {"cold_viscous_friction": 2e-4, "cold_coulomb_friction": 0.01, "warm_up_time": 2.5},
    ),
    "smooth, quadratic and stribeck": (
        {"friction": ("viscous", "smooth_coulomb", "quadratic", "stribeck")},
        {
            "coulomb_width": 1.5,
            "quadratic_friction": 2e-6,
            "stribeck_friction": 0.02,
            "stribeck_speed": 20.0,
        },
    ),
}
"""{term: what a drive then has, and the true values}."""

SPRINGS: dict[str, Case] = {
    "cubic": spring("cubic", cubic_stiffness=4000.0, deflection_zero=0.02),
    "fifth": spring("fifth", fifth_stiffness=4e5, deflection_zero=0.02),
    "dead zone": spring("dead_zone", dead_zone=0.02, deflection_zero=0.01),
    "smooth dead zone": (
        {"spring": ("linear", "smooth_dead_zone")},
        {"dead_zone": 0.02, "dead_zone_rounding": 0.003, "deflection_zero": 0.01},
    ),
    "dahl": spring("dahl", hysteresis_force=2.0, hysteresis_deflection=0.02),
    "damping": spring("damping", spring_damping=3.0),
    "preload": spring("preload", spring_offset=1.5),
    "cubic and preload": (
        {"spring": ("linear", "cubic", "preload")},
        {"cubic_stiffness": 4000.0, "deflection_zero": 0.02, "spring_offset": 1.5},
    ),
}

PARALLEL = {"parallel_spring": ("linear", "preload")}
SMOOTH_JOINT: Case = (
    {"joint_friction": ("viscous",), **PARALLEL},
    {"joint_viscous_friction": 0.3, "parallel_stiffness": 5.0, "parallel_preload": 1.0},
)
"""At the joint, without steps of the deflection, which derivatives of a log cannot follow."""

JOINT_FRICTION: Case = (
    {"joint_friction": ("viscous", "coulomb"), **PARALLEL},
    {**SMOOTH_JOINT[1], "joint_coulomb_friction": 0.2},
)

STIFF_FRICTION: dict[str, Case] = {
    **FRICTION,
    "offset": friction("coulomb", "offset", friction_offset=0.01),
    "parallel spring": (PARALLEL, {"parallel_stiffness": 6.0, "parallel_preload": 2.0}),
}


@cache
def robot(one: Drive = STIFF, two: Drive = ELASTIC, **options: Any) -> Robot:
    with TemporaryDirectory() as folder:
        return arm(Path(folder), one, two, **options)


@cache
def plain_motion() -> Motion:
    return exact_motion(robot())


@cache
def free_motion() -> Motion:
    return exact_motion(robot(), {"two": free_stretch(0.15)})


def check_values(found: Identification, truth: Robot, joint: str, rel: float = 1e-6) -> None:
    """Check every parameter of a drive against the truth."""
    estimate, values = found.drives[joint], truth.drives[joint].values
    told = dict(zip(estimate.names, estimate.values.tolist(), strict=True))
    wanted = {name: values.get(name, 0.0) for name in told}
    assert told == pytest.approx(wanted, rel=rel, abs=1e-9)


def check_bodies(found: Identification, truth: Robot) -> None:
    wanted = found.base.project(truth.parameters)
    np.testing.assert_allclose(found.load.values, wanted, rtol=1e-6, atol=1e-8)


def check_intervals(found: Identification, truth: Robot, joint: str) -> None:
    """Check that no parameter is farther from the truth than its error says."""
    far = scores_of_drive(found, truth, joint)
    assert np.max(np.abs(far)) < 3.3, dict(zip(found.drives[joint].names, far, strict=True))


CONSTANTS = {"current": "torque_constant", "voltage": "voltage_constant"}

CASES = {
    **{("two", term): case for term, case in FRICTION.items()},
    **{("spring of two", term): case for term, case in SPRINGS.items()},
    **{("one", term): case for term, case in STIFF_FRICTION.items()},
}
"""{(where, term): what the drive then has, and the true values}."""


@pytest.mark.parametrize("zero", [-0.2, 0.2])
def test_the_zero_of_a_spring_that_is_loaded_to_one_side_is_found(zero: float) -> None:
    """The deflection reaches from -0.05 to 0.05, four times as far from the zero as is wide."""
    values = {"cubic_stiffness": 4000.0, "fifth_stiffness": 4e4, "deflection_zero": zero}
    drive = with_terms(ELASTIC, {"spring": ("linear", "cubic", "fifth")}, values)
    truth = robot(STIFF, drive)
    found = identified(truth, exact_motion(truth, {"two": free_stretch(0.05)}), ["one"])
    check_values(found, truth, "two", rel=1e-3)


CURRENT: Case = {"motor_input": "current"}, {"torque_constant": 0.05}
ALWAYS = {"payloads": (Payload("lower", 0.5, (0.0, 0.0, -0.2)),)}
KNOWN = [(), ("lower",), ("upper", "lower")]


@pytest.mark.parametrize(
    ("kind", "bodies"),
    quick_only(
        [(kind, bodies) for kind in ("current", "voltage") for bodies in KNOWN],
        [("current", ()), ("voltage", ("lower",)), ("current", ("upper", "lower"))],
    ),
)
def test_the_load_gives_the_motor_constant_of_a_spring(kind: str, bodies: tuple[str, ...]) -> None:
    """`identifiability` and `identify` agree: known bodies do, or the torque of another joint."""
    constant = CONSTANTS[kind]
    one = STIFF if not bodies else with_terms(STIFF, {"motor_input": kind}, {constant: 0.05})
    two = with_terms(ELASTIC, {"motor_input": kind}, {constant: 0.03})
    truth = robot(one, two, known_bodies=bodies)
    motion = exact_motion(truth)
    unknown = robot(
        *(replace(drive, motor_inertia_kg_m2=None) for drive in (one, two)), known_bodies=bodies
    )
    assert f"{constant} of two" in identifiability(unknown).identifiable
    found = identified(unknown, motion)
    check_values(found, truth, "two", rel=1e-5)
    if bodies:
        for name in (constant, "viscous_friction"):
            true = one.values[name]
            assert found.drives["one"].value(name) == pytest.approx(true, rel=1e-6)
    log = noisy_log(motion, 0.03, 2e-5)
    noisy = identify(unknown.without_nominal(), log, cutoff_hz=10.0)
    estimate = noisy.drives["two"]
    for name in (constant, "stiffness"):
        error = estimate.value(name) - truth.drives["two"].values[name]
        assert abs(error) < 3.3 * estimate.standard_error(name) < 0.5 * estimate.value(name)


ONE, TWO = with_terms(STIFF, *CURRENT), with_terms(ELASTIC, *CURRENT)


@pytest.mark.parametrize(
    ("drives", "options", "words"),
    [
        ((ONE, ONE), {}, "of one is unidentifiable: only the current.*Give one of: known bodies"),
        ((ONE, TWO), {}, "two is unidentifiable: only the current.*: the stiffness of its spring"),
        ((ONE, ONE), ALWAYS, "logs with and without a payload"),
    ],
)
def test_nothing_known_leaves_no_scale(
    drives: tuple[Drive, Drive], options: dict[str, Any], words: str
) -> None:
    """Neither does a payload that is always there; the error names what would give it."""
    motion = exact_motion(robot(*drives, **options))
    unknown = robot(*(replace(drive, motor_inertia_kg_m2=None) for drive in drives), **options)
    with pytest.raises(IdentificationError, match=words):
        identified(unknown, motion)


@cache
def noisy(which: str) -> Log:
    return noisy_log(plain_motion() if which == "plain" else free_motion(), 0.003, 2e-5)


def found_in(log: Log, known: Robot, rows: list[str] | None = None) -> Identification:
    return identify(known.without_nominal(), log, torque_joints=rows, cutoff_hz=10.0)


BEHIND = {"two": free_stretch(0.15)}
NOISY = {
    # Stribeck friction behind a spring at times has two minima
    "friction": (15, [("one", term) for term in ("shifted", "load", "stribeck")]),
    "friction behind a spring": (15, [("two", term) for term in ("shifted", "load")]),
    "springs": (15, [("spring of two", term) for term in ("cubic", "dead zone", "damping")]),
    "hysteresis": (96, [("one", "dahl"), ("spring of two", "dahl")]),
}
"""{family: number of draws of each term, and where the terms are}."""


@pytest.mark.slow  # 15 to 96 searches for each term
@pytest.mark.parametrize("families", [[*NOISY][:3], [*NOISY][3:]], ids=["laws", "hysteresis"])
def test_errors_are_as_large_as_the_standard_errors_say(families: list[str]) -> None:
    """Of all terms of drives that a search or a linearisation is needed for."""
    scores = []
    for draws, places in map(NOISY.__getitem__, families):
        for place, term in places:
            joint, is_free = place.split()[-1], place.startswith("spring")
            drive = with_terms(STIFF if joint == "one" else ELASTIC, *CASES[place, term])
            truth = with_named_friction(robot(**{joint: drive}))
            motion, rows = exact_motion(truth, BEHIND if is_free else None), ["one"]
            for seed in range(draws):
                log = noisy_log(motion, 0.003, 2e-5, seed)
                found = found_in(log, truth, rows if is_free else None)
                scores.append(scores_of_drive(found, truth, joint))
    check_scores(scores, band=1.2)


ABSENT = [
    ("friction", "asymmetric", "asymmetric friction"),
    ("friction", "quadratic", "quadratic friction"),
    ("friction", "load", "load friction"),
    ("spring", "cubic", "cubic stiffness"),
    ("spring", "dead zone", "dead zone"),
    ("spring", "damping", "spring damping"),
    ("friction", "smooth", "coulomb width"),
    ("friction", "shifted", "coulomb width"),
    ("friction", "stribeck", "stribeck friction"),
]
"""Terms that the log has no trace of, and the names of their parameters."""


@pytest.mark.parametrize(("field", "term", "name"), quick_only(ABSENT, [ABSENT[0], ABSENT[4]]))
@pytest.mark.findings
def test_a_term_that_is_not_there_is_found_to_be_nothing(field: str, term: str, name: str) -> None:
    """Its parameter is reported as poorly identified, and the others are as without it."""
    is_free = field == "spring"
    terms = (SPRINGS if is_free else FRICTION)[term][0]
    drives = {"two": with_terms(ELASTIC, terms, {})}
    if not is_free:
        drives["one"] = with_terms(STIFF, terms, {})
    log = noisy("free" if is_free else "plain")
    found = found_in(log, robot(**drives), ["one"] if is_free else None)
    for joint in drives:
        poor = [x.message for x in found.warnings if x.code == "poorly-identified"]
        assert any(f"{name} of {joint} " in message for message in poor)
        if ABSENT.index((field, term, name)) < 6:
            check_intervals(found, robot(), joint)
        else:  # Coulomb friction goes to a width that the log does not show
            told, true = found.drives[joint], robot().drives[joint].values["viscous_friction"]
            error = told.value("viscous_friction") - true
            assert abs(error) < 3.3 * told.standard_error("viscous_friction")


@pytest.mark.findings
def test_an_optimum_that_the_log_does_not_exclude_is_a_doubt() -> None:
    """Noise makes the wrong law fit best: the right one is named, which the errors exclude."""
    truth = with_named_friction(
        robot(two=with_terms(ELASTIC, *FRICTION["smooth, quadratic and stribeck"]))
    )
    log = noisy_log(exact_motion(truth), 0.02, 2e-5, seed=0)
    found = found_in(log, truth)
    assert abs(found.drives["two"].value("stribeck_speed") - 20.0) > 40.0
    (doubt,) = (x for x in found.warnings if x.code == "competing-optima")
    assert (doubt.joint, doubt.severity) == ("two", "doubtful")
    assert doubt.evidence["stribeck_speed"] == pytest.approx(20.0, rel=0.2)
    assert "stribeck speed 22.5 rad/s" in doubt.message
    clear = found_in(noisy_log(exact_motion(truth), 0.003, 2e-5, seed=0), truth)
    assert not any(x.code == "competing-optima" for x in clear.warnings)


@pytest.mark.findings
def test_a_zero_that_only_moves_a_preload_is_held_and_said() -> None:
    known = robot(STIFF, with_terms(ELASTIC, SPRINGS["cubic and preload"][0], {}))
    found = identified(known, free_motion(), ["one"])
    assert found.drives["two"].value("stiffness") == pytest.approx(120.0)
    assert ("unidentifiable", "two") in {(x.code, x.joint) for x in found.warnings}
    assert "deflection_zero" in found.known.drives["two"].known


@pytest.mark.findings
def test_values_of_the_search_are_no_nominal_ones() -> None:
    """They stood as nominal values of their estimates in summaries of runs and in reports."""
    known = robot(STIFF, with_terms(ELASTIC, SPRINGS["cubic"][0], {}))
    found = identify(known, noisy("free"), torque_joints=["one"], cutoff_hz=10.0)
    assert found.nominal is not None
    assert found.nominal.drives["two"].own_values == known.drives["two"].own_values


@pytest.mark.parametrize("option", quick_first([{"method": "simultaneous"}, {"estimator": "iv"}]))
def test_other_methods_take_friction_and_what_acts_at_the_joint(option: dict[str, str]) -> None:
    drive = with_terms(ELASTIC, *SMOOTH_JOINT)
    drive = with_terms(drive, *FRICTION["quadratic"])
    truth = robot(with_terms(STIFF, *FRICTION["quadratic"]), drive)
    log = noisy_log(exact_motion(truth), 0.003, 1e-6)
    found = identify(truth.without_nominal(), log, cutoff_hz=10.0, **option)  # type: ignore[arg-type]
    check_intervals(found, truth, "two")


CUBIC = with_terms(ELASTIC, *SPRINGS["cubic"])
LACKING: dict[str, tuple[Drive, dict[str, Any]]] = {
    'the spring of two has cubic.*method="two-step"': (CUBIC, {"method": "simultaneous"}),
    'spring of two has cubic.*estimator="wls"': (CUBIC, {"estimator": "iv"}),
    "the spring of two has a known stiffness": (
        replace(ELASTIC, known=("stiffness",)),
        {"method": "simultaneous"},
    ),
    "'two' has no torque in the log: motor current.*write motor_input = \"torque\"": (TWO, {}),
}
"""{words of the error: the drive of the joint, and options}."""


@pytest.mark.parametrize("words", LACKING)
def test_what_a_method_or_a_log_lacks_is_said(words: str) -> None:
    """The error names the joint, and what would take it."""
    drive, option = LACKING[words]
    known = robot(two=drive).without_nominal()
    with pytest.raises((IdentificationError, LogError), match=words):
        identify(known, noisy("plain"), cutoff_hz=10.0, **option)


def test_an_error_stands_behind_its_cause_and_the_remedy_of_that() -> None:
    """The remedy stood at the end, as if it were that of the error."""
    cause = CODES["sign"].finding("opposite", "two", {"subject": "torques"}, "in the file:\nsign")
    words = "sign: torques .*; remedy: in the file:\nsign\nand so: no torque: write a key"
    with pytest.raises(LogError, match=words), explained(lambda: [cause]):
        raise LogError("no torque: write a key")


def test_refine_says_what_it_does_not_simulate() -> None:
    """Friction that grows with the load needs the load at each instant."""
    found = found_in(noisy("plain"), robot(STIFF, ELASTIC))
    drives = {"one": replace(found.known.drives["one"], friction=("viscous", "coulomb", "load"))}
    found = replace(found, known=found.known.with_drives(drives))
    with pytest.raises(IdentificationError, match="drive of one, whose friction grows with the lo"):
        refine(found, noisy("plain"))


WIDE = with_terms(STIFF, FRICTION["smooth"][0], {"coulomb_width": 10.0})
COMES = ("with", ALWAYS["payloads"]), ("without", ())


@pytest.mark.parametrize(
    ("drive", "name", "rel"),
    quick_first(
        [
            (ONE, "torque_constant", 2e-3),
            (WIDE, "coulomb_width", 0.05),
            (TWO, "torque_constant", 2e-3),
        ],
        2,
    ),
)
def test_conditions_determine_what_one_does_not(drive: Drive, name: str, rel: float) -> None:
    """A payload that comes and goes gives the scale of currents, and laws are searched for once."""
    conditions = {}
    for condition, payloads in COMES:
        log = noisy_log(exact_motion(robot(drive, drive, payloads=payloads)), 0.003, 1e-6)
        unknown = replace(drive, motor_inertia_kg_m2=None) if drive is not WIDE else drive
        conditions[condition] = robot(unknown, unknown, payloads=payloads).without_nominal(), log
    found = identify_conditions(conditions, cutoff_hz=10.0).identifications["with"]
    for estimate in found.drives.values():
        assert estimate.value(name) == pytest.approx(drive.values[name], rel=rel)
