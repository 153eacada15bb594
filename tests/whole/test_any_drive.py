"""Any drive of a strategy: moved by its equations, identified exactly, written, and read again.

With noise each of its terms is found within its errors.
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid.drives import Drive
from seaid.export import content_of, read_parameters, write_parameters
from seaid.identification import identify
from seaid.project import load_run, save_run
from seaid.robot import Robot
from tests.experiments import scores_of_drive, with_named_friction
from tests.identification.test_nonlinear_terms import (
    BEHIND,
    CASES,
    CONSTANTS,
    FRICTION,
    JOINT_FRICTION,
    SPRINGS,
    STIFF_FRICTION,
    check_bodies,
    check_values,
    robot,
)
from tests.representatives import quick_only
from tests.terms import ELASTIC, STIFF, Case, exact_motion, identified, noisy_log, with_terms

LAWS = {"coulomb", "smooth_coulomb", "shifted_coulomb", "dahl"}
NOT_TOGETHER = ({"load", "viscous_warm_up"}, {"offset", "parallel_spring"})
"""What is refused, and what one constant torque is the sum of."""

NOTHING: Case = ({}, {})
LOADED = {"nothing": NOTHING, "preload": SPRINGS["preload"]}

AT_JOINT: dict[str, Case] = {"nothing": NOTHING, "joint friction": JOINT_FRICTION}
AT_JOINT |= {
    kind: ({"motor_input": kind, "known": ("stiffness",)}, {constant: 0.03})
    for kind, constant in CONSTANTS.items()
}

EVERY = {**CASES, **{("two", kind): case for kind, case in AT_JOINT.items()}}

QUICK = (("one", "offset"), ("two", "current"), ("two", "warm-up"), ("spring of two", "dahl"))


def joined(one: Case, two: Case) -> Case:
    """Return what both cases bring, or the first alone if they exclude each other."""
    friction = (case[0].get("friction", ("viscous",)) for case in (one, two))
    terms: dict[str, Any] = {**one[0], **two[0]}
    terms["friction"] = tuple(dict.fromkeys(term for terms in friction for term in terms))
    names, both = {*terms, *terms["friction"]}, one[0].keys() & two[0].keys()
    if both - {"friction"} or len(LAWS & names) > 1 or any(x <= names for x in NOT_TOGETHER):
        return one
    return terms, {**one[1], **two[1]}


@st.composite
def drives(draw: st.DrawFn, plain: Any, is_free: bool, case: Case = NOTHING) -> Drive:
    """Return a drive with a case, friction of another kind, a spring, and what is at its joint."""
    tables = [FRICTION, *([SPRINGS] if is_free else [LOADED, AT_JOINT])]
    for table in tables if plain.is_elastic else [STIFF_FRICTION]:
        case = joined(case, table[draw(st.sampled_from([*table]))])
    terms = case[0] | {"gear_ratio": plain.ratio * draw(st.floats(0.7, 1.5))}
    values = with_terms(plain, terms, case[1]).values.items()
    sizes = draw(st.lists(st.floats(0.7, 1.3), min_size=20, max_size=20))
    scaled = {name: size * value for size, (name, value) in zip(sizes, values, strict=False)}
    return with_terms(plain, terms, scaled)  # type: ignore[no-any-return]


def robots(place: str, case: Case) -> st.SearchStrategy[Robot]:
    """Return the arm with two drives, of which one has a case."""
    two = st.sampled_from([STIFF, ELASTIC]) if place == "one" else st.just(ELASTIC)
    is_free = place.startswith("spring")
    return st.builds(
        lambda *pair: with_named_friction(robot(*pair)),
        drives(STIFF, False, case if place == "one" else NOTHING),
        two.flatmap(lambda plain: drives(plain, is_free, NOTHING if place == "one" else case)),
    )


@pytest.mark.parametrize(("place", "term"), quick_only(EVERY, QUICK))
@settings(max_examples=2)
@given(data=st.data())
def test_any_drive_is_found_exactly_and_again_in_what_is_written(
    place: str, term: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    truth, folder = data.draw(robots(place, EVERY[place, term])), tmp_path_factory.mktemp("drives")
    behind, rows = (BEHIND, ["one"]) if place.startswith("spring") else (None, None)
    found = identified(truth, exact_motion(truth, behind), rows)
    assert {*EVERY[place, term][1]} <= {*found.drives[place.split()[-1]].names}
    for joint in truth.joint_names:
        check_values(found, truth, joint)
    if rows is None:
        check_bodies(found, truth)
    write_parameters(found, folder / "parameters.json")
    again = read_parameters(folder / "parameters.json", truth.without_nominal())
    assert again.drives == found.robot.drives
    assert again.parameters.tolist() == found.robot.parameters.tolist()
    save_run(found, folder / "run.npz")
    assert content_of(load_run(folder / "run.npz").identification) == content_of(found)


@pytest.mark.usefixtures("estimates_only")
@pytest.mark.parametrize(("place", "term"), EVERY)
def test_any_term_is_found_within_its_errors(place: str, term: str) -> None:
    """A score of Student's t with 18 degrees of freedom exceeds 5 once in 10,000 times."""
    joint, is_free = place.split()[-1], place.startswith("spring")
    drive = with_terms(STIFF if joint == "one" else ELASTIC, *EVERY[place, term])
    truth = with_named_friction(robot(**{joint: drive}))
    log = noisy_log(exact_motion(truth, BEHIND if is_free else None), 0.003, 2e-5)
    rows = ["one"] if is_free else None
    found = identify(truth.without_nominal(), log, torque_joints=rows, cutoff_hz=10.0)
    for owner in truth.joint_names:
        assert np.max(np.abs(scores_of_drive(found, truth, owner))) < 5
