"""Logs damaged in known ways: found, counted, repaired within limits, refused beyond them."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log import Repair, Repairs
from seaid.log.reading import repaired
from seaid.log.repair import Channel
from seaid.log.repair.channels import interpolated, on_time
from seaid.log.repair.clocks import median_slope

RATE = 500.0
T: Array = np.arange(4000) / RATE
ENCODER = 2 * np.pi / 2**14
POSITION, TORQUE = "knee.joint_position_rad", "knee.motor_torque_Nm"
HIP = "hip.joint_position_rad"
Damaged = tuple[Array, Array]
Damage = Callable[[str, Array, Array, int], Damaged]
"""From the name, the times and the values of a channel, and a seed, to damaged ones."""


def angle(time: Array, phase: float = 0.0) -> Array:
    """Return a realistic motion [rad]: up to 3 Hz, three rad wide."""
    return np.asarray(
        1.2 * np.sin(2 * np.pi * 0.4 * time + phase)
        + 0.3 * np.sin(2 * np.pi * 1.3 * time + 2.0 + phase)
        + 0.05 * np.sin(2 * np.pi * 3.0 * time)
    )


def torque(time: Array, seed: int = 0) -> Array:
    noise = np.random.default_rng(seed).normal(size=len(time))
    return np.asarray(2.0 * np.cos(2 * np.pi * 0.4 * time) + 0.05 * noise)


def pair(time: Array = T) -> tuple[Channel, Channel]:
    return Channel(POSITION, time, angle(time)), Channel(TORQUE, time, torque(time))


def kept(time: Array, *spans: tuple[int, int]) -> Array:
    """Return the times outside of spans of samples."""
    return np.delete(time, np.concatenate([np.arange(*span) for span in spans]))


def kinds(repairs: tuple[Repair, ...]) -> dict[str, int]:
    return {repair.kind: repair.count for repair in repairs}


def off(time: Array, values: Array) -> float:
    """Return how far repaired angles are off, largest, in encoder steps."""
    return float(np.max(np.abs(values - angle(time)))) / ENCODER


# What is no fault


STEP = 0.01 * angle(T) + (np.arange(len(T)) >= 2000)
GLITCH = 0.01 * angle(T) + 6.0 * (np.arange(len(T)) == 1000)
RIGHT: dict[str, list[Channel]] = {
    "a log without faults": [*pair()],
    "a coarse encoder": [Channel(POSITION, T, np.round(angle(T) / 0.05) * 0.05)],
    "a step": [Channel(POSITION, T, STEP)],
    "a glitch": [Channel(POSITION, T, GLITCH)],
    "a coarse torque": [Channel(TORQUE, T, np.round(torque(T) / 0.05) * 0.05)],
    "a torque of few levels": [Channel(TORQUE, T, np.round(40 * np.cos(2.5 * T)) * 0.05)],
    "no such sensor": [*pair(), Channel("knee.joint_torque_Nm", T, np.full(len(T), np.nan))],
    "an orientation at rest": [
        Channel("base.orientation_w", T, np.minimum(1.0, 1.3 - 0.4 * np.sin(T) ** 2))
    ],
}


@pytest.mark.parametrize("name", RIGHT)
def test_what_is_no_fault_comes_out_as_it_went_in(name: str) -> None:
    grid, values, repairs = repaired(RIGHT[name])
    assert repairs == ()
    assert np.array_equal(grid, T)
    for channel in RIGHT[name]:
        assert np.array_equal(values[channel.name], channel.values, equal_nan=True)


# Faults, as other people's logs have them


def jitter(name: str, time: Array, values: Array, seed: int) -> Damaged:
    """Sampled at irregular times, 1 to 3 ms apart."""
    steps = np.random.default_rng(seed).uniform(0.001, 0.003, len(time))
    new = np.cumsum(steps)
    new = new[new < time[-1]]
    if name.endswith("_Nm"):  # white noise has no time of its own
        return new, values[np.round(new / np.diff(time)[0]).astype(int)]
    # of what the encoder turns, in its steps
    step = 2 * np.pi / (2000 if "motor" in name else 2**14)
    return new, np.round(np.interp(new, time, values) / step) * step


def gaps(name: str, time: Array, values: Array, seed: int) -> Damaged:
    """Up to eight gaps of 10 to 40 ms, the same ones in all channels."""
    rng = np.random.default_rng(seed)
    starts = 100 * rng.choice(np.arange(1, len(time) // 100 - 1), rng.integers(1, 9), replace=False)
    lost = np.concatenate([start + np.arange(rng.integers(5, 20)) for start in starts])
    return np.delete(time, lost), np.delete(values, lost)


def places(name: str, values: Array, seed: int, count: int) -> Any:
    """Return samples of a channel's own, neighbours and repetitions among them."""
    return np.random.default_rng([seed, *name.encode()]).integers(5, len(values) - 5, count)


def dropouts(name: str, time: Array, values: Array, seed: int) -> Damaged:
    values[places(name, values, seed, 40)] = np.nan
    return time, values


def zeros(name: str, time: Array, values: Array, seed: int) -> Damaged:
    if "position" in name:
        values[places(name, values, seed, 20)] = 0.0
    return time, values


def held(name: str, time: Array, values: Array, seed: int) -> Damaged:
    for place in places(name, values, seed, 60):
        values[place] = values[place - 1]
    return time, values


def disorder(name: str, time: Array, values: Array, seed: int) -> Damaged:
    order = np.arange(len(time))
    for place in 100 * np.random.default_rng(seed).choice(np.arange(2, 28), 3, replace=False):
        order[place : place + 3] = order[[place + 2, place, place + 1]]
    return time[order], values[order]


def repeats(name: str, time: Array, values: Array, seed: int) -> Damaged:
    twice = np.random.default_rng(seed).choice(len(time), 90, replace=False)
    rows = np.sort(np.concatenate([np.arange(len(time)), twice]))
    return time[rows], values[rows]


def set_back(name: str, time: Array, values: Array, seed: int) -> Damaged:
    """Return times of a clock that is set back, by more than two samples and no whole number.

    Every third one is set on, by so much that the motion, which goes on, shows that it is no gap.
    """
    rng = np.random.default_rng(seed)
    samples = rng.integers(2, (8, 1500)[seed % 2]) + 0.4
    shift_s = -samples / RATE if seed % 3 else 30.0
    time[rng.integers(200, len(time) - 200) :] += shift_s
    return time, values


FAULTS: tuple[tuple[Damage, str, tuple[int, int], float], ...] = (
    (jitter, "irregular steps", (3900, 4000), 1.6),
    (gaps, "gaps", (1, 8), 3.0),
    (dropouts, "values that are no number", (30, 40), 0.1),
    (zeros, "sudden zeros", (15, 20), 0.1),
    (held, "held values", (30, 60), 30.0),  # slow ones pass: the motion of a sample, at most
    (disorder, "late samples", (6, 6), 1e-6),
    (repeats, "repeated stamps", (90, 90), 1e-6),
    (set_back, "clock jumps", (1, 1), 0.1),
)
"""Each with its kind in the report, how many are counted, and the largest error [encoder steps]."""


@pytest.mark.parametrize(("damage", "kind", "counts", "most_off"), FAULTS)
@given(seed=st.integers(0, 999))
def test_a_fault_of_any_place_is_counted_and_repaired(
    damage: Damage, kind: str, counts: tuple[int, int], most_off: float, seed: int
) -> None:
    """The report has this fault alone, and the motion is that before the damage."""
    damaged = [
        Channel(name, *damage(name, T.copy(), values, seed))
        for name, values in ((POSITION, 3.0 + angle(T)), (TORQUE, torque(T)))
    ]
    grid, values, repairs = repaired(damaged)
    assert {repair.kind for repair in repairs} == {kind}
    count = next(repair.count for repair in repairs if POSITION in repair.channel)
    assert counts[0] <= count <= counts[1]
    assert off(grid, values[POSITION] - 3.0) < most_off
    assert np.ptp(np.diff(grid)) < 1e-9


@given(seed=st.integers(0, 1000))
def test_irregular_steps_cost_far_less_than_an_encoder_step(seed: int) -> None:
    """Straight lines between samples would cost ten times as much as is allowed."""
    steps = np.random.default_rng(seed).uniform(0.002, 0.010, 1500)
    time = np.cumsum(steps)
    grid, values, found = repaired([Channel(POSITION, time, angle(time))])
    inner = slice(5, -5)
    error = values[POSITION][inner] - angle(grid[inner])
    lines = np.interp(grid[inner], time, angle(time)) - angle(grid[inner])
    assert np.sqrt(np.mean(error**2)) < 0.01 * ENCODER
    assert np.max(np.abs(error)) < 0.2 * ENCODER
    assert np.sqrt(np.mean(lines**2)) > 0.1 * ENCODER
    assert kinds(found) == {"irregular steps": pytest.approx(1490, abs=15)}
    assert np.ptp(np.diff(grid)) < 1e-12


def test_torques_are_not_dulled_in_the_pass_band() -> None:
    """Straight lines would take 0.7 % of a torque of 8 Hz, and more of its friction."""
    time = np.cumsum(np.random.default_rng(1).uniform(0.002, 0.010, 2000))
    wave = np.sin(2 * np.pi * 8.0 * time)
    grid, values, _ = repaired([Channel(TORQUE, time, wave)])
    truth = np.sin(2 * np.pi * 8.0 * grid)
    assert float(values[TORQUE] @ truth / (truth @ truth)) == pytest.approx(1.0, abs=2e-3)
    assert float(np.interp(grid, time, wave) @ truth / (truth @ truth)) < 0.993


def test_a_burst_of_noisy_samples_is_no_slope() -> None:
    """Two noisy samples 0.2 ms apart are not continued over the next 10 ms."""
    time = np.cumsum(np.tile([0.0098, 0.0002], 400))
    noisy = angle(time) + np.random.default_rng(0).normal(0.0, ENCODER, len(time))
    grid, values, _ = repaired([Channel(POSITION, time, noisy)])
    assert off(grid, values[POSITION]) < 8.0


def test_a_lower_rate_passes_a_low_pass_first() -> None:
    """A torque of 98 Hz, sampled at 100 Hz, would be one of 2 Hz."""
    whistle = np.sin(2 * np.pi * 0.5 * T) + 0.5 * np.sin(2 * np.pi * 98.0 * T)
    grid, values, _ = repaired([Channel(TORQUE, T, whistle)], Repairs(rate_hz=100.0))
    inner = slice(20, -20)
    assert np.diff(grid) == pytest.approx(0.01)
    assert np.max(np.abs(values[TORQUE] - np.sin(2 * np.pi * 0.5 * grid))[inner]) < 0.02


@example(offset=4e-3, drift=-8e-4, seed=0)  # the offset is below a step in the middle of the log
@given(offset=st.floats(-3e3, 3e3), drift=st.floats(-1.5e-3, 1.5e-3), seed=st.integers(0, 99))
def test_one_clock_a_joint(offset: float, drift: float, seed: int) -> None:
    """Offsets and drifts of a joint's clock are removed, but for a step of it and its jitter."""
    jitter = np.random.default_rng(seed).exponential(2e-4, len(T))
    other = Channel(HIP, (T + jitter) * (1 + drift) + offset, angle(T, 1.0))
    grid, values, repairs = repaired([Channel(POSITION, T, angle(T)), other])
    speed = np.max(np.abs(np.gradient(angle(T), T)))
    error = values[HIP] - angle(grid, 1.0)
    assert np.max(np.abs(error)) < speed * (np.max(jitter) + 2 / RATE)
    assert off(grid, values[POSITION]) < 0.01
    if abs(offset) > 4 / RATE:
        assert "clock offset" in kinds(repairs)
    if abs(drift) * T[-1] > 2 / RATE:
        assert "clock drift" in kinds(repairs)
        assert np.std(error) < speed * 3e-4


def test_channels_of_different_length_share_the_time_that_all_have() -> None:
    """The grid starts with the latest channel, at the rate of the fastest."""
    grid, values, _ = repaired([*pair(), Channel(HIP, T[300::2], angle(T[300::2]))])
    assert grid[0] == T[300]
    assert grid[-1] <= T[-2] + 1e-9
    assert off(grid, values[HIP]) < 0.01
    assert 1 / np.diff(grid) == pytest.approx(RATE)


def test_a_hole_of_one_channel_is_a_hole_of_the_log() -> None:
    """No sample of the log is in it, unless the limit for gaps is longer."""
    time = kept(T, (1500, 1800))
    channels = [Channel(POSITION, T, angle(T)), Channel(TORQUE, time, torque(T)[np.isin(T, time)])]
    grid, values, repairs = repaired(channels)
    assert kinds(repairs) == {"gaps": 1}
    assert np.array_equal(grid, time)
    assert np.max(np.abs(values[TORQUE] - channels[1].values)) < 1e-9
    bridged = repaired(channels, Repairs(longest_gap_s=1.0))[0]
    assert np.ptp(np.diff(bridged)) < 1e-12


def test_a_torque_over_a_gap_does_not_follow_its_noise() -> None:
    """What is interpolated lies between the samples at the ends of the gap."""
    gap = np.isin(np.arange(len(T)), np.arange(1500, 1540))
    noise = np.random.default_rng(0).normal(0, 1.0, len(T))
    values = interpolated(T[~gap], noise[~gap], T, "akima")
    assert values[~gap] == pytest.approx(noise[~gap])
    ends = sorted(noise[[1499, 1540]])
    assert ends[0] <= np.min(values[gap]) <= np.max(values[gap]) <= ends[1]


def test_commands_are_what_was_sent() -> None:
    """Repeated values, zeros and jumps are no faults; a command holds until the next one comes."""
    sent = angle(T)[(np.arange(len(T)) // 10) * 10]
    sent[300:340], sent[400:1000] = 0.0, 0.4
    name, encoder = "knee.position_command_rad", Channel(POSITION, T, angle(T))
    _, values, repairs = repaired([encoder, Channel(name, T, sent)])
    assert repairs == ()
    assert np.array_equal(values[name], sent)
    changes = np.flatnonzero(np.diff(sent, prepend=np.nan) != 0.0)  # a topic that is sent on change
    grid, values, repairs = repaired([encoder, Channel(name, T[changes], sent[changes])])
    assert "holes" not in kinds(repairs)
    assert grid[-1] == pytest.approx(T[-1], abs=0.5 / RATE)
    assert np.array_equal(values[name], sent[np.searchsorted(T, grid + 1e-9, side="right") - 1])


@pytest.mark.parametrize(
    ("digits", "tolerance"),
    [
        (lambda time: np.round(time, 2), 1e-4),
        (lambda time: np.floor(time / 0.016) * 0.016, 1e-4),
        (lambda time: [float(f"{stamp:.10g}") for stamp in 1.7e9 + time], 1e-3),
    ],
)
def test_stamps_with_too_few_digits_are_replaced_by_a_regular_clock(
    digits: Callable[[Array], Any], tolerance: float
) -> None:
    """The clock has the rate of the samples; the samples stay."""
    wrong = [replace(channel, time=np.array(digits(T))) for channel in pair()]
    grid, values, repairs = repaired(wrong)
    assert np.array_equal(values[TORQUE], wrong[1].values)
    assert np.diff(grid) == pytest.approx(1 / RATE, rel=tolerance)
    assert [repair.kind for repair in repairs] == ["stamps with too few digits"]
    rate = float(str(repairs[0]).split("replaced by a regular clock of ")[1].split()[0])
    assert rate == pytest.approx(RATE, rel=tolerance)


def test_rows_that_each_repeat_the_stamp_and_the_values_of_another_are_no_coarse_clock() -> None:
    """Two rows a stamp are one sample; where each has a new value of one sensor, they are none."""
    rows = np.repeat(np.arange(len(T)), 2)
    twice = [replace(one, time=one.time[rows], values=one.values[rows]) for one in pair()]
    grid, _, repairs = repaired(twice)
    assert kinds(repairs) == {"repeated stamps": len(T)}
    assert grid == pytest.approx(T)
    turns = [(np.arange(2 * len(T)) + place) // 2 % len(T) for place in range(2)]
    in_turn = [
        replace(channel, time=channel.time[rows], values=channel.values[turn])
        for channel, turn in zip(pair(), turns, strict=True)
    ]
    with pytest.raises(LogError, match="repeated with other values"):
        repaired(in_turn)


def test_a_slower_sensor_gives_the_samples_that_are_new() -> None:
    """The error is a twentieth of that of the held values."""
    slow = angle(T[(np.arange(len(T)) // 5) * 5])
    grid, values, repairs = repaired([Channel(POSITION, T, slow)])
    assert "values of a slower sensor" in kinds(repairs)
    assert off(grid, values[POSITION]) < 0.05 * off(T, slow)


def test_a_torque_that_is_held_throughout_lacks_nothing() -> None:
    """A motor may get it so; parts of it that looked like lost messages had a log refused."""
    noise = 0.05 * np.random.default_rng(0).normal(size=len(T))
    torque = (angle(T) + noise)[(np.arange(len(T)) // 10) * 10]
    grid, values, repairs = repaired([Channel(TORQUE, T, torque)])
    assert "held values" not in kinds(repairs)
    np.testing.assert_array_equal(values[TORQUE], np.interp(grid, T, torque))


FAST = 3000.0 * np.sin(2 * np.pi * 0.25 * T) ** 2
"""A motor that turns by more than half a period of its encoder in a sample."""


@pytest.mark.parametrize(
    ("period", "is_given", "turns"),
    [
        *((2 * np.pi, is_given, 4 * np.pi * angle(T)) for is_given in (True, False)),
        *((0.7, is_given, 1.4 * angle(T)) for is_given in (True, False)),
        (2 * np.pi, True, FAST),
    ],
)
def test_encoders_that_wrap_around_are_unwrapped(
    period: float, is_given: bool, turns: Array
) -> None:
    """A given period is exact; without one it is found to a step of the encoder."""
    true = np.round(turns / ENCODER) * ENCODER
    name = "knee.motor_position_rad"
    channel = Channel(name, T, np.mod(true, period), period if is_given else None)
    _, values, repairs = repaired([channel])
    assert kinds(repairs)["wraps"] > 5
    assert np.ptp(values[name] - true) < (1e-8 if is_given else ENCODER)


def test_a_dead_channel_is_named_and_left() -> None:
    """A sensor that is zero all the time is reported, not changed, and spoils no other."""
    dead = Channel("knee.motor_position_rad", T, np.zeros(len(T)))
    _, values, repairs = repaired([*pair(), dead])
    assert [(one.channel, one.kind, one.count) for one in repairs] == [
        (dead.name, "constant channel", 1)
    ]
    assert not np.any(values[dead.name])


def test_stamps_that_are_not_finite_are_left_out() -> None:
    torn = T.copy()
    torn[[7, 100, 101]] = np.nan
    grid, values, repairs = repaired([Channel(POSITION, torn, angle(T))])
    assert kinds(repairs) == {"stamps that are not finite": 3, "irregular steps": 2}
    assert off(grid, values[POSITION]) < 0.01


def test_a_channel_that_was_not_measured_stays_unknown_when_it_is_late() -> None:
    late = {TORQUE: np.full_like(T, np.nan)}
    within, values = on_time(T, late, {TORQUE: 0.05})
    assert np.all(np.isnan(values[TORQUE]))
    assert len(values[TORQUE]) == np.sum(within)


def test_saturated_samples_are_counted_and_left() -> None:
    for level in (2.05, 1.9):
        clipped = Channel(TORQUE, T, np.clip(torque(T), -level, level))
        _, values, repairs = repaired([clipped])
        stuck = np.abs(clipped.values) == level
        assert 0 < kinds(repairs)["saturated samples"] <= stuck.sum()
        assert np.array_equal(values[TORQUE], clipped.values)


# What is refused


def hip(time: Array, values: Array) -> list[Channel]:
    return [*pair(), Channel(HIP, time, values)]


def position(time: Array, values: Array | None = None, *, period: float | None = None) -> Any:
    return [Channel(POSITION, time, angle(time) if values is None else values, period)]


UNEVEN: Array = np.cumsum(np.random.default_rng(0).uniform(0.001, 0.003, 4000))
HOLED = kept(T, (500, 545), (1500, 1800), (2500, 2545))
ENDS = np.where(np.arange(4000) < 2000, 3.0 + angle(T), 0.0)
ANY_TURN: Array = np.random.default_rng(0).uniform(0.0, 6.28, 4000)
FEW_DIGITS = (1.7e9 + T).astype(np.float32).astype(float)
REFUSED: dict[str, list[Channel]] = {
    r"hip.* drifts by 0\.01 s/s .*allowed 0\.002": hip(T * 1.01, angle(T)),
    r"share 0 s of 7\.998 s: 'hip.*the same zero": hip(T[:-7] + 100.0, T[:-7]),
    r"gap of 0\.092 s .* such gaps is 1.*most_gap_error": position(HOLED, angle(20 * HOLED)),
    r"stamps are late, repeated .*most_disordered": [*pair(T.reshape(-1, 2)[:, ::-1].ravel())],
    r"all its digits.* time = \{ rate_hz = (499|50[01])": position(UNEVEN.round(1), angle(UNEVEN)),
    r"all its digits.* time = \{ rate_hz = \.\.\. \}": position(FEW_DIGITS, angle(T)),
    r"goes backwards at sample 4000 .* two recordings in one": position(
        np.tile(T, 2), np.concatenate([angle(T), angle(T, 1.5)])
    ),
    r"'knee.joint_position_rad' lacks 2000 of 4000 samples .* allowed 0\.25 ": position(T, ENDS),
    r"wraps around every 6\.28319: the number of wraps is ambiguous": position(
        T, ANY_TURN, period=2 * np.pi
    ),
    "no channels to repair": [],
    "has 0 finite stamps, at least 4 are needed": position(np.full(4000, np.nan), angle(T)),
    "no channel of the log has as many as four samples": position(T, np.full(4000, np.nan)),
}
BEYOND: dict[str, tuple[dict[str, float], list[Channel]]] = {
    r"gap of 0\.602 s at t = 2\.998 s; allowed 0\.1 ": (
        {"longest_gap_s": 0.1},
        [*pair(kept(T, (1500, 1800)))],
    ),
    "cannot be estimated, the log is too short": (
        {"most_missing": 0.9},
        position(kept(T[400:580], (100, 145))),
    ),
    r"gaps with 50\.0% of the time .*most_missing": (
        {"longest_gap_s": 10.0},
        [*pair(kept(T, (1000, 3000)))],
    ),
    "'rate_hz' must be a finite number above 0, found 0": ({"rate_hz": 0.0}, []),
    "'longest_gap_s' must be a finite number .* found inf": ({"longest_gap_s": np.inf}, []),
    "'most_missing' must be a share from 0 to 1, found 1.5": ({"most_missing": 1.5}, []),
    "'most_disordered' must be .* found nan": ({"most_disordered": np.nan}, []),
}


@pytest.mark.parametrize("words", [*REFUSED, *BEYOND])
def test_what_is_not_repaired_is_named_with_the_limit(words: str) -> None:
    limits, channels = BEYOND.get(words) or ({}, REFUSED[words])
    with pytest.raises(LogError, match=words):
        repaired(channels, Repairs(**limits))


# All at once


def wraps(name: str, time: Array, values: Array, seed: int) -> Damaged:
    """The encoders of the motors know one turn."""
    return time, np.mod(values, 2 * np.pi) if "motor_position" in name else values


@pytest.mark.parametrize("seed", [4, 6, 8])
def test_faults_that_come_together_are_repaired_as_each_alone(seed: int) -> None:
    """The motion is that before the damage, but for slow values that were held."""
    motor, channels = "knee.motor_position_rad", []
    for name, values in {POSITION: angle(T), motor: 8 * angle(T), TORQUE: torque(T)}.items():
        time = T.copy()
        for damage in (wraps, held, dropouts, gaps, repeats, set_back):
            time, values = damage(name, time, values, seed)
        channels.append(Channel(name, time, values))
    grid, values_of, repairs = repaired(channels)
    others = {kind for damage, kind, *_ in FAULTS if damage in (held, dropouts, gaps, repeats)}
    assert {*kinds(repairs)} == others | {"wraps", "clock jumps"}
    assert off(grid, values_of[POSITION]) < 0.1
    assert np.ptp(values_of[motor] - 8 * angle(grid)) < 1.2 * ENCODER
    assert np.ptp(np.diff(grid)) < 1e-9


def test_median_slope_and_its_interval_are_those_of_scipy() -> None:
    """Its package takes a third of a second to import, and has no more than ten lines of it."""
    from scipy.stats import theilslopes

    rng = np.random.default_rng(0)
    for case in range(200):
        count = int(rng.integers(3, 60))
        x, y = np.sort(rng.normal(size=count)), rng.normal(size=count)
        if case % 2:  # with ties
            x, y = np.round(x, 1), np.round(y, 1)
        if np.ptp(x) > 0:
            slope, _, low, high = theilslopes(y, x)
            assert median_slope(x, y) == (slope, low, high)
    # No interval of points of which all are equal: the slope has no error.
    assert median_slope(np.arange(5.0), np.zeros(5)) == (0.0, 0.0, 0.0)


def test_reading_a_log_does_not_import_the_statistics_of_scipy() -> None:
    code = (
        "import sys, numpy as np; from seaid.log.repair.clocks import clock_line; "
        "time = np.arange(200) * 1e-2; clock_line(time * 1.001, time); "
        "print('scipy.stats' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
