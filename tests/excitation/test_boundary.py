from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.errors import ExcitationError
from seaid.excitation import EndState, JointLimits, Trajectory, make_basis
from seaid.excitation.basis import BasisName
from seaid.excitation.boundary import IN_MOTION, MotionSpace, limit_rows, motion_space

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


@pytest.mark.slow  # a motion at 100 kHz
@settings(derandomize=True, max_examples=24, deadline=None)
@given(
    case=st.sampled_from(BASES),
    ends=st.sampled_from(["rest", "free", "given"]),
    n=st.integers(1, 7),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_limit_is_broken_at_100_kHz(
    case: tuple[BasisName, int], ends: str, n: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    lower, range_ = rng.uniform(-2, 2, n), 10 ** rng.uniform(-2, 1, n)
    bounds = JointLimits(
        lower, lower + range_, 10 ** rng.uniform(-1, 1, n), 10 ** rng.uniform(-1, 2, n)
    )
    duration = float(10 ** rng.uniform(-0.5, 0))
    # what a joint can reach within so short a time, with room to brake
    speed = 0.1 * np.minimum(bounds.velocity, bounds.acceleration * duration)
    speed = np.minimum(speed, 0.05 * range_ / duration)
    middle = EndState(bounds.middle, speed * rng.uniform(-1, 1, n), None)
    state = {"rest": EndState(), "free": IN_MOTION, "given": middle}[ends]
    names = [f"joint{j}" for j in range(n)]
    found = motion_space(make_basis(case[0], duration, case[1]), names, bounds, state, state)
    motion = Trajectory(tuple(names), found.basis, found.coefficients(filling(found, bounds, rng)))
    q, v, a = motion.sample(np.append(np.arange(0.0, duration, 1e-5), duration))
    assert np.all(q >= bounds.lower - 1e-9)
    assert np.all(q <= bounds.upper + 1e-9)
    assert np.all(np.abs(v) <= bounds.velocity * (1 + 1e-9))
    assert np.all(np.abs(a) <= bounds.acceleration * (1 + 1e-9))
    used = [np.abs(q - bounds.middle).max(axis=0) / bounds.half_range]
    used += [np.abs(v).max(axis=0) / bounds.velocity, np.abs(a).max(axis=0) / bounds.acceleration]
    assert np.all(np.max(used, axis=0) > 0.9)  # it is at a limit: the hulls are close


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
