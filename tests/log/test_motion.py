"""Motion from a log: order, derivatives, both sides, and logs that cannot be used."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from seaid.errors import LogError
from seaid.log import Log, Repair, reconstruct_motion
from seaid.log.motion import reconstruct_motions
from seaid.robot import Robot
from tests.experiments import TEST_MASS, arm, arm_log, arm_motion, leg, leg_log, perfect_log
from tests.plants import picked


def log() -> Log:
    return perfect_log(arm(), arm_motion())


def without(joint: str, *sides: str) -> Log:
    """Return the log without the positions of a joint on some sides."""
    positions = {f"{side}_position": getattr(log(), f"{side}_position").copy() for side in sides}
    for values in positions.values():
        values[:, arm().index(joint)] = np.nan
    return replace(log(), **positions)


def with_holes(source: Log, *holes: tuple[float, float]) -> Log:
    """Return a log without the samples inside (start_s, end_s)."""
    kept = np.ones(len(source.time), dtype=bool)
    for start, end in holes:
        kept &= (source.time <= start) | (source.time >= end)
    return source.at(kept)


def without_samples(share: float) -> Log:
    """Return the log without a random share of its samples."""
    kept = np.random.default_rng(0).random(len(log().time)) >= share
    kept[[0, -1]] = True
    return log().at(kept)


def test_derivatives_are_those_of_the_true_motion() -> None:
    """Only jumps of a motor where its friction turns are beyond what encoders see."""
    motion, inside = reconstruct_motion(arm(), log(), 20.0), slice(200, -200)
    bounds = {"position": 1e-4, "velocity": 2e-3, "acceleration": 0.05}
    for side in ("joint", "motor"):
        for state, allowed in bounds.items():
            if (side, state) != ("motor", "acceleration"):
                values, true = (
                    getattr(one, f"{side}_{state}")[inside] for one in (motion, arm_motion())
                )
                error = np.linalg.norm(values - true, axis=0) / np.linalg.norm(true, axis=0)
                assert np.max(error) < allowed


def test_torques_stay_as_measured_and_the_cutoff_is_proposed() -> None:
    noisy = arm_log(0)
    motion = reconstruct_motion(arm(), noisy)
    assert np.array_equal(motion.motor_torque, noisy.motor_torque)
    assert np.all(np.isnan(motion.joint_torque))
    assert 4.0 <= motion.cutoff_hz <= 6.0
    assert motion.transient_s == pytest.approx(1 / motion.cutoff_hz)
    assert motion.rate_hz == pytest.approx(1000.0)
    assert "four times the bandwidth of the velocity" in str(motion.processing)


def test_joints_come_in_the_robots_order_and_others_are_left_alone() -> None:
    expected = reconstruct_motion(arm(), log(), 8.0)
    names = ("wrist", "shoulder", "rail", "telescope", "other")
    foreign = picked(log(), [3, 1, 0, 2, 2], names)
    found = reconstruct_motion(arm(), foreign, 8.0)
    assert found.joint_names == arm().joint_names
    assert np.array_equal(found.joint_position, expected.joint_position)
    assert np.array_equal(found.motor_torque, expected.motor_torque)


def refused() -> Iterator[tuple[Robot, Log, float | None, str]]:
    """Yield logs that cannot be used: robot, log, cutoff, and what is said."""
    for side in ("motor", "joint"):
        blind = without("telescope", side)
        yield arm(), blind, None, f"elastic joint 'telescope' needs its {side} position"
    yield arm(), without("wrist", "motor", "joint"), None, "joint 'wrist' has no position in the"
    yield leg(), log(), None, r"the log has no joint hip_yaw, .* of 'tulip_leg'; its"
    few = picked(log(), [0, 1, 3], ("rail", "shoulder", "wrist"))
    yield arm(), few, None, "no joint telescope of 'mixed_arm'"
    for cutoff_hz in (-1.0, 0.0, 500.0, np.inf, np.nan):
        yield arm(), log(), cutoff_hz, "between 0 and half the sampling rate, 500 Hz, found"
    yield arm(), with_holes(log(), (2.0, 3.0)), 0.0, "cutoff_hz must be between 0 and half"
    most = r"1 found, the longest of 5 s at t = 0.5 s\): .* are 83% of 6 s, allowed 50%; .*between"
    yield arm(), with_holes(log(), (0.5, 5.5)), None, most
    short = r"too short: 0.999 s are fewer than 10 periods .* 4 Hz"
    yield arm(), log().between(0.0, 1.0), 4.0, short


def test_logs_that_cannot_be_used_are_refused() -> None:
    for robot, source, cutoff_hz, words in refused():
        with pytest.raises(LogError, match=words):
            reconstruct_motions(robot, source, cutoff_hz)
    with pytest.raises(LogError, match=r"holes in time \(1 found, the first of 1 s at t = 2 s\)"):
        reconstruct_motion(arm(), with_holes(log(), (2.0, 3.0)))


def test_a_log_with_holes_is_taken_stretch_by_stretch() -> None:
    """Each stretch has the motion that it has alone, and the speeds of the whole log."""
    holed = with_holes(log(), (2.0, 2.6), (5.0, 5.6))
    first, second = reconstruct_motions(arm(), holed, 8.0)
    assert (first.time[0], first.time[-1]) == pytest.approx((0.0, 2.0))
    assert (second.time[0], second.time[-1]) == pytest.approx((2.6, 5.0))  # the last is too short
    alone = reconstruct_motion(arm(), log().between(0.0, 2.0005), 8.0)
    assert np.array_equal(first.joint_acceleration, alone.joint_acceleration)
    for side, field in enumerate(("motor_velocity", "joint_velocity")):
        speeds = np.abs(np.concatenate([getattr(one, field) for one in (first, second)]))
        for motion in (first, second):
            assert motion.largest_speeds[side] == pytest.approx(np.max(speeds, axis=0))
    (repair,) = first.processing.repairs if first.processing else ()
    assert (repair.kind, repair.count, repair.time_s) == ("holes in time", 2, 2.0)
    assert second.processing
    assert not second.processing.repairs


def test_irregular_times_are_resampled_without_bias() -> None:
    """Straight lines between samples, which cut off bends, would miss each bound by ten times."""
    holes = without_samples(0.3)
    found, expected = (reconstruct_motion(arm(), one, 8.0) for one in (holes, log()))
    assert np.diff(found.time) == pytest.approx(np.mean(np.diff(holes.time)))
    assert found.time[[0, -1]] == pytest.approx(expected.time[[0, -1]])
    inside = slice(500, -500)
    for state, tolerance in (("position", 1e-6), ("velocity", 5e-5), ("acceleration", 2e-3)):
        exact = getattr(expected, f"joint_{state}")
        for joint in range(4):
            again = CubicSpline(expected.time, exact[:, joint])(found.time)
            error = getattr(found, f"joint_{state}")[:, joint] - again
            assert np.max(np.abs(error[inside])) < tolerance * np.max(np.abs(again))


def test_small_jitter_of_the_clock_is_not_resampled() -> None:
    jitter = 1e-8 * np.random.default_rng(0).normal(size=len(log().time))
    found = reconstruct_motion(arm(), replace(log(), time=log().time + jitter), 8.0)
    assert np.array_equal(found.time, log().time + jitter)


def test_motion_tells_what_was_done_to_it() -> None:
    plain = reconstruct_motion(arm(), log(), 8.0).processing
    assert str(plain) == (
        "1000 Hz, positions below 40 Hz; regressor and torque below 8 Hz, as given; "
        "0.12 s excluded at both ends"
    )
    report = (Repair("rail.motor_torque_Nm", "values that are no number", 3, 0.5, "bridged"),)
    thinned = replace(without_samples(0.3), report=report)
    record = reconstruct_motion(arm(), thinned, 100.0).processing
    assert record is not None
    assert (record.resampled, record.repairs) == (True, report)
    assert record.logged_rate_hz == pytest.approx(700, rel=0.02)
    assert "positions unfiltered" in str(record)


def test_reversals_of_an_unknown_rotor_get_a_wider_band_where_noise_permits() -> None:
    """Twice the band, for its inertia, but not where friction is smooth."""
    known = leg(TEST_MASS).without_nominal()
    knee = replace(known.drives["knee_pitch"], motor_inertia_kg_m2=None)
    unknown = known.with_drives({"knee_pitch": knee})
    narrow, wide = (reconstruct_motion(robot, leg_log()) for robot in (known, unknown))
    assert wide.processing is not None
    selected = wide.processing.cutoff_selection
    assert selected is not None
    assert wide.cutoff_hz == min(2 * narrow.cutoff_hz, selected.noise_limit_hz)
    assert "for the reversals of knee_pitch" in str(selected)
    smooth = unknown.with_drives({"knee_pitch": replace(knee, friction=("viscous",))})
    assert reconstruct_motion(smooth, leg_log()).cutoff_hz == narrow.cutoff_hz
