from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.errors import ExcitationError
from seaid.excitation import (
    BasisName,
    EndState,
    JoinedBasis,
    Limits,
    Trajectory,
    add_run_in,
    make_basis,
)
from seaid.excitation.boundary import IN_MOTION, MotionSpace, limit_rows, motion_space, with_run_in
from seaid.excitation.limits import JointLimits, joint_limits, margins
from seaid.robot import Robot
from tests.excitation.robots import assert_kept

BASES: list[tuple[BasisName, int]] = [
    ("bspline", 8),
    ("bspline", 25),
    ("polynomial", 9),
    ("polynomial", 18),
    ("fourier", 13),
]
JOINTS = ("rail", "shoulder", "elbow")


def limits(n: int = 3) -> JointLimits:
    return JointLimits(-np.ones(n), 2 * np.ones(n), 3 * np.ones(n), 10 * np.ones(n))


def space(
    start: EndState,
    end: EndState,
    name: BasisName = "bspline",
    count: int = 12,
    duration: float = 4.0,
) -> MotionSpace:
    return motion_space(make_basis(name, duration, count), JOINTS, limits(), start, end)


def states_at_ends(motions: MotionSpace, x: Array) -> tuple[Array, Array, Array]:
    ends = np.array([0.0, motions.basis.duration])
    return motions.basis.states(ends, motions.coefficients(x))


def filling(motions: MotionSpace, bounds: JointLimits, rng: np.random.Generator) -> Array:
    """Return a random x on the bounds of its limits: from the feasible start as far as possible."""
    rows, offsets = limit_rows(motions, bounds)
    x = rng.normal(size=motions.shape)
    along = np.einsum("jgck,jk->jgc", rows, x)
    with np.errstate(divide="ignore"):
        reach = (1.0 - np.sign(along) * offsets) / np.abs(along)
    return np.asarray(x * reach.min(axis=(1, 2))[:, None])


@pytest.mark.rounding
@pytest.mark.parametrize(("name", "count"), BASES)
def test_rest_is_rest_wherever_it_is(name: BasisName, count: int) -> None:
    found = space(EndState(), EndState(), name, count)
    conditions = 2 if name == "fourier" else 4
    assert found.shape == (3, count - conditions)
    np.testing.assert_array_equal(
        found.feasible_start, np.outer(found.basis.constant, np.full(3, 0.5))
    )
    x = np.random.default_rng(0).normal(size=found.shape)
    q, v, a = states_at_ends(found, x)
    np.testing.assert_allclose(v, 0.0, atol=1e-11)
    np.testing.assert_allclose(a, 0.0, atol=1e-9)
    assert np.ptp(q) > 0.1


@pytest.mark.slow  # a search for each kind of ends
@settings(derandomize=True, max_examples=15, deadline=None)
@given(
    case=st.sampled_from(BASES),
    asked=st.lists(st.sampled_from([True, False]), min_size=6, max_size=6),
    seed=st.integers(0, 2**32 - 1),
)
def test_all_motions_keep_the_ends_given_as_number_row_or_mapping(
    case: tuple[BasisName, int], asked: list[bool], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    periodic = case[0] == "fourier"
    start = (float(rng.uniform(0, 1)), rng.uniform(-0.3, 0.3, 3), rng.uniform(-1, 1, 3))
    end = start if periodic else (0.7, dict(zip(JOINTS, (0.1, -0.2, 0.0), strict=True)), (1, 0, -1))
    parts = [value if wanted else None for value, wanted in zip((*start, *end), asked, strict=True)]
    found = space(EndState(*parts[:3]), EndState(*parts[3:]), *case)
    states = states_at_ends(found, rng.normal(size=found.shape))
    for which in range(2):
        for kind in range(3):
            value = parts[3 * which + kind]
            if value is not None:
                row = [value[joint] for joint in JOINTS] if isinstance(value, dict) else value
                np.testing.assert_allclose(states[kind][which], row, atol=1e-8)
    assert np.linalg.matrix_rank(found.free) == found.shape[1]
    rows, offsets = limit_rows(found, limits())
    assert np.abs(offsets).max() < 1.0
    assert np.all(np.linalg.norm(rows, axis=3) > 0)


def test_a_start_at_the_very_end_of_the_range_leaves_room_elsewhere() -> None:
    found = space(EndState(2.0), EndState(-1.0), duration=3.0)
    x = filling(found, limits(), np.random.default_rng(0))
    assert np.linalg.norm(x, axis=1).min() > 1e-2
    q, _, _ = states_at_ends(found, x)
    np.testing.assert_allclose(q, [[2.0] * 3, [-1.0] * 3], atol=1e-9)


SLOW = "'rail': no motion between these ends keeps its acceleration limit .* uses 17.6 of it; give"


@pytest.mark.parametrize(
    ("start", "end", "options", "words"),
    [
        ({"position": 2.5}, {}, {}, "'rail': position 2.5 at the start is outside its .* -1 to 2;"),
        ({}, {"velocity": [0, -4, 0]}, {}, "'shoulder': velocity -4 at the end is outside its lim"),
        ({}, {"acceleration": 11}, {}, "'rail': acceleration 11 at the end is outside its limits"),
        ({"position": [0, 1]}, {}, {}, r"position at the start must have shape \(3\)"),
        ({"velocity": np.nan}, {}, {}, "velocity at the start must be finite"),
        ({"velocity": "fast"}, {}, {}, "velocity at the start must be numbers"),
        ({"position": {"elbo": 1.0}}, {}, {}, "position at the start: no joint is named 'elbo'; d"),
        ({}, {"position": {"elbow": 1.0}}, {}, "at the end is not given for rail, shoulder; name"),
        ({"position": 0.0}, {"position": 1.5}, {"duration": 0.2}, SLOW),
        (
            {"position": 1.99, "velocity": 3.0, "acceleration": 0.0},
            *({}, {}, "keeps its position limit at every instant"),
        ),
        ({"position": 0.0}, {"position": 1.5}, {"count": 6}, "give at least 7"),
        ({"position": 0.0}, {"position": 0.0}, {"count": 6}, "6 coefficients .* are too few"),
        ({}, {}, {"name": "fourier", "count": 3}, "2 conditions at the ends; give at least 4"),
        (
            {"position": 0.0},
            {"position": 1.0},
            {"name": "fourier", "count": 11},
            "'rail': position 0 at the start and 1 at the end contradict each other, for a fourier",
        ),
    ],
)
def test_ends_that_cannot_be_say_why(
    start: dict[str, Any], end: dict[str, Any], options: dict[str, Any], words: str
) -> None:
    with pytest.raises(ExcitationError, match=words):
        space(EndState(**start), EndState(**end), **options)


# Run-ins: from rest into a motion, and out of it

LIMITS = Limits(velocity=[1.0, 3.0, 3.0], acceleration=8.0)


def free_motion(
    robot: Robot, name: BasisName, count: int, seed: int = 0, duration: float = 3.0
) -> Trajectory:
    """Return a motion with free ends that can be run into and is at a limit somewhere."""
    bounds = joint_limits(robot, LIMITS)
    basis = make_basis(name, duration, count)
    space = motion_space(basis, robot.joint_names, bounds, IN_MOTION, IN_MOTION)
    space = with_run_in(space, robot.joint_names, bounds)
    rows, _ = limit_rows(space, bounds)
    x = np.random.default_rng(seed).normal(size=space.shape)
    x /= np.abs(np.einsum("jgck,jk->jgc", rows, x)).max(axis=(1, 2))[:, None]
    return Trajectory(robot.joint_names, basis, space.coefficients(x), ("rail",))


@pytest.mark.slow  # four motions, each sampled at 100 kHz
@settings(derandomize=True, max_examples=4, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    case=st.sampled_from([("bspline", 14), ("polynomial", 12), ("fourier", 11)]),
)
def test_it_rests_at_both_ends_without_a_jump_and_within_limits(
    seed: int, case: tuple[BasisName, int], slider_arm: Robot
) -> None:
    main = free_motion(slider_arm, *case, seed=seed)
    assert not main.rests_at_ends
    whole = add_run_in(main, slider_arm, LIMITS)
    assert whole.rests_at_ends
    assert whole.prismatic_joints == ("rail",)
    assert isinstance(whole.basis, JoinedBasis)
    first = 0
    states = []
    for part in whole.basis.parts:
        values = whole.coefficients[first : first + part.size]
        states.append(part.states(np.array([0.0, part.duration]), values))
        first += part.size
    bounds = joint_limits(slider_arm, LIMITS)
    sizes = (bounds.half_range, bounds.velocity, bounds.acceleration)
    for before, after in pairwise(states):
        for last, start, size in zip(before, after, sizes, strict=True):
            np.testing.assert_allclose(last[1] / size, start[0] / size, atol=1e-8)
    found = margins(whole, bounds)
    assert np.min([found.position, found.velocity, found.acceleration]) > -1e-9
    assert_kept(whole, bounds, 1e5)
    begin, end = whole.main_interval
    assert end - begin == pytest.approx(3.0, rel=1e-12)
    assert 0.0 < begin < 1.0
    assert 0.0 < whole.duration - end < 1.0


def test_the_main_interval_is_the_motion_itself(slider_arm: Robot) -> None:
    """A run-in goes before it and a run-out after it."""
    main = free_motion(slider_arm, "bspline", 12)
    whole = add_run_in(main, slider_arm, LIMITS)
    time = np.linspace(0.0, 3.0, 50)[:-1]
    planned, moved = main.sample(time), whole.sample(whole.main_interval[0] + time)
    np.testing.assert_allclose(moved, planned, atol=1e-9)


def test_periods_of_a_fourier_series_are_equal_so_that_they_can_be_averaged(
    slider_arm: Robot,
) -> None:
    main = free_motion(slider_arm, "fourier", 11)
    whole = add_run_in(main, slider_arm, LIMITS, periods=3)
    begin, end = whole.main_interval
    assert end - begin == pytest.approx(9.0)
    time = np.linspace(begin, begin + 3.0, 40)[1:-1]
    runs = [np.stack(whole.sample(time + 3.0 * run)) for run in range(3)]
    np.testing.assert_allclose(runs[1], runs[0], atol=1e-8)
    np.testing.assert_allclose(runs[2], runs[0], atol=1e-8)
    # the same motion, begun elsewhere in its period: the same positions are passed
    for joint in range(3):
        q = main.sample(np.linspace(0.0, 3.0, 2000))[0][:, joint]
        assert runs[0][0][:, joint].max() <= q.max() + 1e-3
        assert np.ptp(runs[0][0][:, joint]) > 0.9 * np.ptp(q)


def test_a_motion_at_rest_needs_no_run_in(slider_arm: Robot) -> None:
    bounds = joint_limits(slider_arm, LIMITS)
    basis = make_basis("bspline", 3.0, 12)
    space = motion_space(basis, slider_arm.joint_names, bounds, EndState(0.5), EndState(0.5))
    kept = with_run_in(space, slider_arm.joint_names, bounds)
    assert kept.run_ins == ()
    motion = Trajectory(slider_arm.joint_names, basis, space.feasible_start)
    thrice = add_run_in(motion, slider_arm, LIMITS, periods=3)
    assert thrice.main_interval == (0.0, 9.0)
    assert thrice.duration == 9.0


def test_a_motion_that_cannot_be_run_into_says_so(slider_arm: Robot, leg: Robot) -> None:
    """Of ends beyond the limits, of another robot, and periods of a motion without any."""
    basis = make_basis("bspline", 3.0, 12)
    bounds = joint_limits(slider_arm, LIMITS)
    start = EndState([0.59, 0.0, 1.0], [-0.99, 0.0, 0.0], None)
    space = motion_space(basis, slider_arm.joint_names, bounds, start, EndState())
    motion = Trajectory(slider_arm.joint_names, basis, space.feasible_start)
    with pytest.raises(
        ExcitationError, match=r"no run-in to its start .*'rail': .* position limit"
    ):
        add_run_in(motion, slider_arm, LIMITS)
    with pytest.raises(ExcitationError, match="joint 'rail': no motion between these ends"):
        with_run_in(space, slider_arm.joint_names, bounds)
    main = free_motion(slider_arm, "bspline", 12)
    with pytest.raises(ExcitationError, match="the trajectory moves rail, shoulder, elbow, but"):
        add_run_in(main, leg)
    with pytest.raises(ExcitationError, match="periods must be a whole number of at least 1"):
        add_run_in(main, slider_arm, periods=0)
    with pytest.raises(ExcitationError, match="'rail' does not end as it starts, so the motion"):
        add_run_in(main, slider_arm, LIMITS, periods=2)
