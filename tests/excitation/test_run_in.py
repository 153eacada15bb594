from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid.errors import ExcitationError
from seaid.excitation import EndState, Limits, Trajectory, joint_limits, make_basis, margins
from seaid.excitation.basis import BasisName, JoinedBasis
from seaid.excitation.boundary import IN_MOTION, add_run_in, limit_rows, motion_space, with_run_in
from seaid.robot.robot import Robot

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
    q, v, a = whole.sample(np.arange(0.0, whole.duration, 1e-5))
    assert np.all(np.abs(q - bounds.middle) <= bounds.half_range + 1e-9)
    assert np.all(np.abs(v) <= bounds.velocity + 1e-9)
    assert np.all(np.abs(a) <= bounds.acceleration + 1e-9)
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
