"""Logs damaged in known ways: found, counted, repaired within limits, refused beyond them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import seaid
from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log.channels import column_names
from seaid.log.reading import Log, repaired
from seaid.log.reading import repaired as repaired_channels
from seaid.log.repair import Channel, Repair, Repairs
from seaid.log.repair.channels import interpolated, on_time
from seaid.log.repair.clocks import clock_line, longest_bridge
from seaid.robot.robot import Robot
from seaid.simulation.simulation import measure
from tests.experiments import ELASTIC, LEG_SENSORS, leg, leg_motion, true_value
from tests.measured import LOGS
from tests.representatives import quick_first

RATE = 500.0
ENCODER = 2 * np.pi / 2**14
POSITION, TORQUE = "knee.joint_position_rad", "knee.motor_torque_Nm"
HIP = "hip.joint_position_rad"


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


def regular(duration: float = 8.0) -> Array:
    return np.arange(round(duration * RATE)) / RATE


def pair(time: Array, period: float | None = None) -> tuple[Channel, Channel]:
    values = angle(time)
    if period is not None:
        values = np.mod(values, period)
    return Channel(POSITION, time, values, period), Channel(TORQUE, time, torque(time))


def kept(time: Array, *spans: tuple[int, int]) -> Array:
    """Return the times outside of spans of samples."""
    return np.delete(time, np.concatenate([np.arange(*span) for span in spans]))


def kinds(found: tuple[Repair, ...]) -> dict[str, int]:
    return {one.kind: one.count for one in found}


def off(time: Array, values: Array) -> float:
    """Return how far repaired angles are off, largest, in encoder steps."""
    return float(np.max(np.abs(values - angle(time)))) / ENCODER


def test_a_log_without_faults_comes_out_as_it_went_in() -> None:
    time = regular()
    position, force = pair(time)
    grid, values, found = repaired_channels([position, force])
    assert found == ()
    assert np.array_equal(grid, time)
    assert np.array_equal(values[POSITION], position.values)
    assert np.array_equal(values[TORQUE], force.values)


def test_a_coarse_encoder_at_rest_and_in_motion_is_no_fault() -> None:
    time = regular()
    slow = np.round(angle(time) / 0.05) * 0.05
    _, values, found = repaired_channels([Channel(POSITION, time, slow)])
    assert found == ()
    assert np.array_equal(values[POSITION], slow)


@given(seed=st.integers(0, 1000))
@settings(derandomize=True, deadline=None, max_examples=15)
def test_irregular_steps_cost_far_less_than_an_encoder_step(seed: int) -> None:
    steps = np.random.default_rng(seed).uniform(0.002, 0.010, 1500)
    time = np.cumsum(steps)
    grid, values, found = repaired_channels([Channel(POSITION, time, angle(time))])
    inner = slice(5, -5)
    error = values[POSITION][inner] - angle(grid[inner])
    lines = np.interp(grid[inner], time, angle(time)) - angle(grid[inner])
    assert np.sqrt(np.mean(error**2)) < 0.01 * ENCODER
    assert np.max(np.abs(error)) < 0.2 * ENCODER
    assert np.sqrt(np.mean(lines**2)) > 0.1 * ENCODER  # what straight lines would cost
    assert kinds(found) == {"irregular steps": pytest.approx(1490, abs=15)}
    assert np.ptp(np.diff(grid)) < 1e-12


def test_torques_are_not_dulled_in_the_pass_band() -> None:
    time = np.cumsum(np.random.default_rng(1).uniform(0.002, 0.010, 2000))
    wave = np.sin(2 * np.pi * 8.0 * time)
    grid, values, _ = repaired_channels([Channel(TORQUE, time, wave)])
    truth = np.sin(2 * np.pi * 8.0 * grid)
    assert float(values[TORQUE] @ truth / (truth @ truth)) == pytest.approx(1.0, abs=2e-3)
    assert float(np.interp(grid, time, wave) @ truth / (truth @ truth)) < 0.993


def test_a_burst_of_noisy_samples_is_no_slope() -> None:
    steps = np.tile([0.0098, 0.0002], 400)
    time = np.cumsum(steps)
    noisy = angle(time) + np.random.default_rng(0).normal(0.0, ENCODER, len(time))
    grid, values, _ = repaired_channels([Channel(POSITION, time, noisy)])
    assert off(grid, values[POSITION]) < 8.0


def test_a_lower_rate_passes_a_low_pass_first() -> None:
    time = regular()
    whistle = np.sin(2 * np.pi * 0.5 * time) + 0.5 * np.sin(2 * np.pi * 98.0 * time)
    grid, values, _ = repaired_channels([Channel(TORQUE, time, whistle)], Repairs(rate_hz=100.0))
    inner = slice(20, -20)
    assert np.diff(grid) == pytest.approx(0.01)
    assert np.max(np.abs(values[TORQUE] - np.sin(2 * np.pi * 0.5 * grid))[inner]) < 0.02


@given(offset=st.floats(-3e3, 3e3), drift=st.floats(-1.5e-3, 1.5e-3), seed=st.integers(0, 99))
@settings(derandomize=True, deadline=None, max_examples=25)
def test_one_clock_a_joint(offset: float, drift: float, seed: int) -> None:
    time = regular()
    jitter = np.random.default_rng(seed).exponential(2e-4, len(time))
    other = (time + jitter) * (1 + drift) + offset
    channels = [
        Channel(POSITION, time, angle(time)),
        Channel("hip.joint_position_rad", other, angle(time, 1.0)),
    ]
    grid, values, found = repaired_channels(channels)
    # what an offset or a drift below one step may leave, and the largest jitter of a stamp
    shift = np.max(jitter) + 2 / RATE
    speed = np.max(np.abs(np.gradient(angle(time), time)))
    error = values["hip.joint_position_rad"] - angle(grid, 1.0)
    assert np.max(np.abs(error)) < speed * shift
    assert np.max(np.abs(values[POSITION] - angle(grid))) < 1e-6
    if abs(offset) > 4 / RATE:
        assert "clock offset" in kinds(found)
    if abs(drift) * 8.0 > 2 / RATE:
        assert "clock drift" in kinds(found)
        assert np.std(error) < speed * 3e-4  # the jitter of the stamps is 2e-4 s


def test_channels_of_different_length_share_the_time_that_all_have() -> None:
    time = regular()
    late = Channel("hip.joint_position_rad", time[300::2], angle(time[300::2]))
    grid, values, _ = repaired_channels([*pair(time), late])
    assert grid[0] == time[300]
    assert grid[-1] <= time[-2] + 1e-9
    assert off(grid, values["hip.joint_position_rad"]) < 0.01
    assert 1 / np.diff(grid) == pytest.approx(RATE)


def test_a_gap_after_which_the_robot_is_back_is_no_jump_of_the_clock() -> None:
    time = regular()
    keep = np.ones(len(time), dtype=bool)
    keep[346:362] = False  # it turns there
    grid, values, found = repaired_channels(pair(time[keep]))
    assert kinds(found) == {"gaps": 1}
    assert off(grid, values[POSITION]) < 1.0


@given(places=st.sets(st.integers(100, 3800), min_size=1, max_size=8), length=st.integers(5, 40))
@settings(derandomize=True, deadline=None, max_examples=25)
def test_gaps_are_bridged(places: set[int], length: int) -> None:
    time = regular()
    keep = np.ones(len(time), dtype=bool)
    for place in {100 * round(place / 100) for place in places}:  # none runs into another
        keep[place : place + length] = False
    grid, values, found = repaired_channels(pair(time[keep]))
    assert kinds(found)["gaps"] <= len(places)
    assert off(grid, values[POSITION]) < 30.0
    assert np.ptp(np.diff(grid)) < 1e-12


def test_a_hole_of_one_channel_is_a_hole_of_the_log() -> None:
    time = regular()
    keep = np.ones(len(time), dtype=bool)
    keep[1500:1800] = False
    channels = [
        Channel(POSITION, time, angle(time)),
        Channel(TORQUE, time[keep], torque(time[keep])),
    ]
    grid, values, found = repaired_channels(channels)
    assert kinds(found) == {"gaps": 1}
    assert "1 above 0.1 s excluded" in found[0].action
    steps = np.diff(grid)
    place = int(np.argmax(steps))
    assert steps[place] == pytest.approx(0.602)
    assert grid[place] == pytest.approx(time[1499])
    assert np.ptp(np.delete(steps, place)) < 1e-12
    assert np.max(np.abs(values[TORQUE] - torque(grid))) < 1e-9
    bridged = repaired_channels(channels, Repairs(longest_gap_s=1.0))[0]
    assert np.ptp(np.diff(bridged)) < 1e-12


def test_a_torque_over_a_gap_does_not_follow_its_noise() -> None:
    time = regular()
    keep = np.ones(len(time), dtype=bool)
    keep[1500:1540] = False
    noise = np.random.default_rng(0).normal(0, 1.0, len(time))
    values = interpolated(time[keep], noise[keep], time, "akima")
    assert values[keep] == pytest.approx(noise[keep])
    ends = sorted(noise[[1499, 1540]])
    assert ends[0] <= np.min(values[~keep]) <= np.max(values[~keep]) <= ends[1]


def test_commands_are_what_was_sent() -> None:
    """Repeated values, zeros and jumps are no faults; a command holds until the next one comes."""
    time, step = regular(), round(regular()[1] - regular()[0], 9)
    held = angle(time)[(np.arange(len(time)) // 10) * 10]
    held[300:340], held[400:1000] = 0.0, 0.4
    name = "knee.position_command_rad"
    position, whole = (
        Channel("knee.joint_position_rad", time, angle(time)),
        Channel(name, time, held),
    )
    _, picked, report = repaired_channels([position, whole], Repairs())
    assert report == ()
    assert np.array_equal(picked[name], held)
    changed = np.flatnonzero(np.diff(held, prepend=np.nan) != 0.0)  # a topic of its own, on change
    rare = Channel(name, time[changed], held[changed])
    grid, picked, report = repaired_channels([position, rare], Repairs())
    assert "holes" not in kinds(report)
    np.testing.assert_allclose(grid[-1], time[-1], atol=step / 2)
    before = np.searchsorted(time, grid + 1e-9, side="right") - 1
    assert np.array_equal(picked[name], held[before])


def test_late_samples_go_back_into_place() -> None:
    time = regular()
    order = np.arange(len(time))
    for place in (400, 1200, 2500):
        order[place : place + 3] = order[[place + 2, place, place + 1]]
    grid, values, found = repaired_channels(pair(time[order]))
    assert kinds(found) == {"late samples": 6}
    assert grid == pytest.approx(time)
    assert off(grid, values[POSITION]) < 1e-6


def test_repeated_samples_are_taken_once() -> None:
    time = regular()
    rows = np.sort(np.concatenate([np.arange(len(time)), [50, 51, 52, 3000]]))
    twice = [Channel(one.name, one.time[rows], one.values[rows]) for one in pair(time)]
    grid, values, found = repaired_channels(twice)
    assert kinds(found) == {"repeated stamps": 4}
    assert grid == pytest.approx(time)
    assert off(grid, values[POSITION]) < 1e-6


def few_digits(time: Array) -> Array:
    return np.array([float(f"{stamp:.10g}") for stamp in 1.7e9 + time])


@pytest.mark.parametrize(
    ("coarse", "tolerance"),
    [
        (lambda time: np.round(time, 2), 1e-4),
        (lambda time: np.floor(time / 0.016) * 0.016, 1e-4),
        (few_digits, 1e-3),
    ],
)
def test_stamps_with_too_few_digits_are_replaced_by_a_regular_clock(
    coarse: Callable[[Array], Array], tolerance: float
) -> None:
    time = regular()
    wrong = [Channel(one.name, coarse(time), one.values) for one in pair(time)]
    grid, values, found = repaired_channels(wrong)
    assert np.array_equal(values[TORQUE], wrong[1].values)
    assert np.diff(grid) == pytest.approx(1 / RATE, rel=tolerance)
    assert list(kinds(found)) == ["stamps with too few digits"]
    assert "replaced by a regular clock of " in str(found[0])
    rate = float(str(found[0]).split(" clock of ")[1].split()[0])
    assert rate == pytest.approx(RATE, rel=tolerance)


def test_rows_that_each_repeat_the_stamp_and_the_values_of_another_are_no_coarse_clock() -> None:
    time = regular()
    rows = np.repeat(np.arange(len(time)), 2)
    twice = [Channel(one.name, one.time[rows], one.values[rows]) for one in pair(time)]
    grid, _, found = repaired_channels(twice)
    assert kinds(found) == {"repeated stamps": len(time)}
    assert grid == pytest.approx(time)
    in_turn = [  # each row has a new value of one sensor
        Channel(
            one.name, one.time[rows], one.values[(np.arange(2 * len(time)) + place) // 2 % 4000]
        )
        for place, one in enumerate(pair(time))
    ]
    with pytest.raises(LogError, match="repeated with other values"):
        repaired_channels(in_turn)


@given(back=st.floats(0.004, 3.0), place=st.integers(200, 3800))
@settings(derandomize=True, deadline=None, max_examples=25)
def test_a_clock_that_is_set_back_while_the_robot_goes_on(back: float, place: int) -> None:
    time = regular()
    wrong = time.copy()
    wrong[place:] -= back
    if abs(back * RATE - round(back * RATE)) < 1e-6:
        wrong[place:] -= 0.3 / RATE
    given_ = [Channel(one.name, wrong, one.values) for one in pair(time)]
    grid, values, found = repaired_channels(given_)
    assert kinds(found) == {"clock jumps": 1}
    assert grid == pytest.approx(time, abs=1e-6)
    assert off(grid, values[POSITION]) < 0.1


def test_a_clock_that_is_set_on_while_the_robot_goes_on() -> None:
    time = regular()
    wrong = time.copy()
    wrong[1700:] += 30.0
    grid, values, found = repaired_channels([Channel(POSITION, wrong, angle(time))])
    assert kinds(found) == {"clock jumps": 1}
    assert "30 s" in str(found[0])
    assert off(grid, values[POSITION]) < 1e-3


@given(bad=st.sets(st.integers(10, 3980), min_size=1, max_size=60), kind=st.sampled_from("nzh"))
@settings(derandomize=True, deadline=None, max_examples=30)
def test_dropouts_are_found_and_bridged(bad: set[int], kind: str) -> None:
    time = regular()
    values = np.round((3.0 + angle(time)) / ENCODER) * ENCODER
    places = np.array(sorted(bad))
    fast = np.abs(np.gradient(values, time))[places] > 8 * ENCODER * RATE
    damaged = values.copy()
    damaged[places] = {"n": np.nan, "z": 0.0}.get(kind, 0.0)
    if kind == "h":
        for place in places:
            damaged[place] = damaged[place - 1]
    grid, repaired, found = repaired_channels([Channel(POSITION, time, damaged)])
    count = sum(kinds(found).values())
    assert len(grid) == len(time)
    if kind != "h":
        assert count == len(places)
        assert np.max(np.abs(repaired[POSITION] - 3.0 - angle(grid))) < 3 * ENCODER
    else:
        assert count >= 0.5 * fast.sum()
        assert count <= len(places)


def test_a_slower_sensor_gives_the_samples_that_are_new() -> None:
    time = regular()
    held = angle(time[(np.arange(len(time)) // 5) * 5])
    grid, values, found = repaired_channels([Channel(POSITION, time, held)])
    plain = np.max(np.abs(held - angle(time)))
    assert "values of a slower sensor" in kinds(found)
    assert np.max(np.abs(values[POSITION] - angle(grid))) < 0.05 * plain


@pytest.mark.parametrize("period", [2 * np.pi, np.pi / 2, 4096 * ENCODER / 4, 0.7])
@pytest.mark.parametrize("is_given", [True, False])
def test_encoders_that_wrap_around(period: float, is_given: bool) -> None:
    time = regular()
    true = np.round(2 * period * angle(time) / ENCODER) * ENCODER
    channel = Channel(POSITION, time, np.mod(true, period), period if is_given else None)
    _, values, found = repaired_channels([channel])
    assert kinds(found)["wraps"] > 5
    moved = values[POSITION] - true
    assert np.ptp(moved) < (1e-9 if is_given else ENCODER)


def test_a_motor_that_turns_more_than_half_a_period_a_sample() -> None:
    time = regular()
    true = 3000.0 * np.sin(2 * np.pi * 0.25 * time) ** 2
    assert np.max(np.abs(np.diff(true))) > np.pi
    wrapped = Channel("knee.motor_position_rad", time, np.mod(true, 2 * np.pi), 2 * np.pi)
    _, values, _ = repaired_channels([wrapped])
    assert values["knee.motor_position_rad"] == pytest.approx(true, abs=1e-6)


def test_a_step_and_a_glitch_are_no_wrap() -> None:
    time = regular()
    step, glitch = 0.01 * angle(time), 0.01 * angle(time)
    step[2000:] += 1.0
    glitch[1000] += 6.0
    for values in (step, glitch):
        _, repaired, found = repaired_channels([Channel(POSITION, time, values)])
        assert "wraps" not in kinds(found)
        assert np.array_equal(repaired[POSITION], values)


def test_a_dead_channel_is_named_and_left() -> None:
    time = regular()
    dead = Channel("knee.motor_position_rad", time, np.zeros(len(time)))
    _, values, found = repaired_channels([*pair(time), dead])
    assert [str(one) for one in found] == [
        "knee.motor_position_rad: constant channel, 1 found, the first at t = 0 s: it is 0 all the "
        "time; not changed"
    ]
    assert not np.any(values["knee.motor_position_rad"])


def test_a_channel_without_numbers_is_no_sensor() -> None:
    time = regular()
    nothing = Channel("knee.joint_torque_Nm", time, np.full(len(time), np.nan))
    grid, values, found = repaired_channels([*pair(time), nothing])
    assert found == ()
    assert np.array_equal(grid, time)
    assert np.all(np.isnan(values["knee.joint_torque_Nm"]))


def test_a_coarse_torque_is_not_saturated() -> None:
    time = regular()
    for values in (torque(time), 2.0 * np.cos(2 * np.pi * 0.4 * time)):
        coarse = np.round(values / 0.05) * 0.05
        assert repaired_channels([Channel(TORQUE, time, coarse)])[2] == ()


def test_stamps_that_are_not_finite_are_left_out() -> None:
    time = regular()
    torn = time.copy()
    torn[[7, 100, 101]] = np.nan
    grid, values, found = repaired_channels([Channel(POSITION, torn, angle(time))])
    assert kinds(found) == {"stamps that are not finite": 3, "irregular steps": 2}
    assert off(grid, values[POSITION]) < 0.01


def test_a_channel_that_was_not_measured_stays_unknown_when_it_is_late() -> None:
    time = np.arange(0.0, 1.0, 0.01)
    late = {"a.motor_torque_Nm": np.full_like(time, np.nan)}
    kept, values = on_time(time, late, {"a.motor_torque_Nm": 0.05})
    assert np.all(np.isnan(values["a.motor_torque_Nm"]))
    assert len(values["a.motor_torque_Nm"]) == np.sum(kept)


def test_saturation_is_counted_but_that_of_an_orientation_at_rest_is_none() -> None:
    time = regular()
    for level in (2.05, 1.9):
        clipped = Channel(TORQUE, time, np.clip(torque(time), -level, level))
        _, values, found = repaired_channels([clipped], Repairs(most_saturated=0.4))
        stuck = np.abs(clipped.values) == level
        assert 0 < kinds(found)["saturated samples"] <= stuck.sum()
        assert np.array_equal(values[TORQUE], clipped.values)
    resting = np.minimum(1.0, 1.3 - 0.4 * np.sin(time) ** 2)
    repaired_channels([Channel("base.orientation_w", time, resting)])


# What is refused


def uneven() -> Array:
    return np.cumsum(np.random.default_rng(0).uniform(0.001, 0.003, 4000))


def hip(time: Array, values: Array) -> list[Channel]:
    return [*pair(regular()), Channel(HIP, time, values)]


def one(time: Array, values: Array, period: float | None = None) -> list[Channel]:
    return [Channel(POSITION, time, values, period)]


T = regular()
HOLES = ((500, 545), (1500, 1800), (2500, 2545))
REFUSED: tuple[tuple[list[Channel], dict[str, float], str], ...] = (
    (hip(T * 1.01, angle(T)), {}, r"hip.* drifts by 0\.01 s/s .*allowed 0\.002"),
    (hip(T[:-7] + 100.0, T[:-7]), {}, r"share 0 s of 7\.998 s: 'hip.*the same zero"),
    (
        [*pair(kept(T, (1500, 1800)))],
        {"longest_gap_s": 0.1},
        r"gap of 0\.602 s at t = 2\.998 s, allowed 0\.1 s",
    ),
    (
        one(kept(T, *HOLES), angle(20 * kept(T, *HOLES))),
        {},
        r"gap of 0\.092 s .* such gaps is 1.*most_gap_error",
    ),
    (
        one(kept(T[400:580], (100, 145)), angle(kept(T[400:580], (100, 145)))),
        {"most_missing": 0.9},
        "cannot be estimated, the log is too short",
    ),
    (
        [*pair(kept(T, (1000, 3000)))],
        {"longest_gap_s": 10.0},
        r"1 gaps with 50\.0% of the time .*most_missing",
    ),
    (
        [*pair(T.reshape(-1, 2)[:, ::-1].ravel())],
        {},
        r"stamps are late, repeated .*most_disordered",
    ),
    (
        one(np.round(uneven(), 1), angle(uneven())),
        {},
        r"all its digits.* time = \{ rate_hz = (499|50[01])",
    ),
    (
        one((1.7e9 + T).astype(np.float32).astype(float), angle(T)),
        {},
        r"all its digits.* time = \{ rate_hz = \.\.\. \}",
    ),
    (
        one(np.tile(T, 2), np.concatenate([angle(T), angle(T, 1.5)])),
        {},
        r"goes backwards at sample 4000 .* two recordings in one",
    ),
    (
        one(T, np.where(np.arange(4000) < 2000, 3.0 + angle(T), 0.0)),
        {},
        r"'knee.joint_position_rad' lacks 2000 of 4000 samples .* allowed 25\.0%",
    ),
    (
        one(T, np.random.default_rng(0).uniform(0.0, 6.28, 4000), 2 * np.pi),
        {},
        r"wraps around every 6\.28319: the number of wraps is ambiguous",
    ),
    (
        [Channel(TORQUE, T, np.clip(torque(T), -1.9, 1.9))],
        {},
        r"saturated \(1\.9\) in .*most_saturat",
    ),
    ([], {}, "no channels to repair"),
    (one(np.full(4000, np.nan), angle(T)), {}, "has 0 finite stamps, at least 4 are needed"),
    (one(T, np.full(4000, np.nan)), {}, "no channel of the log has as many as four samples"),
    ([], {"rate_hz": 0.0}, "Repairs: 'rate_hz' must be a finite number above 0, found 0"),
    (
        [],
        {"longest_gap_s": np.inf},
        "Repairs: 'longest_gap_s' must be a finite number .* found inf",
    ),
    ([], {"most_missing": 1.5}, "Repairs: 'most_missing' must be a share from 0 to 1, found 1.5"),
    ([], {"most_disordered": np.nan}, "Repairs: 'most_disordered' must be .* found nan"),
)


@pytest.mark.parametrize(("channels", "limits", "words"), REFUSED, ids=[w for *_, w in REFUSED])
def test_what_is_not_repaired_is_named_with_the_limit(
    channels: list[Channel], limits: dict[str, float], words: str
) -> None:
    with pytest.raises(LogError, match=words):
        repaired_channels(channels, Repairs(**limits))


# Clean simulated logs damaged as other people's are: repaired, and identified as if nothing was

Damaged = tuple[Array, Array]
Damage = Callable[[str, Array, Array, np.random.Generator], Damaged]


@cache
def clean() -> Log:
    log = measure(leg(), leg_motion(), LEG_SENSORS, 0)
    return log.at(np.arange(len(log.time)) % 2 == 0)


@cache
def undamaged() -> seaid.Identification:
    return seaid.identify(leg().without_nominal(), clean())


def with_hole(start: float, end: float) -> Log:
    return clean().at((clean().time <= start) | (clean().time >= end))


TERMS = ("viscous_friction", "coulomb_friction", "stiffness")


def check_errors(found: seaid.Identification) -> None:
    """Assert that errors of drives and load are as large as their standard errors allow."""
    for joint in ELASTIC:
        drive = found.drives[joint]
        for name in TERMS:
            error = drive.value(name) - true_value(leg(), joint, name)
            assert abs(error) < 3.0 * drive.standard_error(name), f"{name} of {joint}"
    truth = found.base.project(leg().parameters)
    off = (found.load.values - truth)[: len(truth)] / found.load.standard_errors
    assert np.sqrt(np.mean(off**2)) < 2.0


def channels_of(log: Log, damage: Damage) -> list[Channel]:
    """Return the log as channels, damaged one by one."""
    found = []
    for number, (name, values) in enumerate(log.columns().items()):
        rng = np.random.default_rng(number)
        found.append(Channel(name, *damage(name, log.time.copy(), values.copy(), rng)))
    return found


def log_of(robot: Robot, channels: list[Channel]) -> Log:
    time, values, report = repaired(channels)
    fields: dict[str, Any] = {
        field: np.full((len(time), robot.n), np.nan)
        for field in ("motor_position", "joint_position", "motor_torque")
    }
    for index, joint in enumerate(robot.joint_names):
        for name, field in column_names(joint, robot.is_prismatic[index]).items():
            if name in values:
                fields[field][:, index] = values[name]
    return Log(time=time, joint_names=robot.joint_names, report=report, **fields)


def joint_clock(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    """Every joint has a clock of its own: started at another time, up to 600 us/s off."""
    joint = leg().index(name.split(".")[0])
    return time * (1 + 3e-4 * (joint - 2)) + 100.0 * joint, values


def jitter(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    """Sampled at irregular times, 1 to 3 ms apart."""
    steps = np.random.default_rng(0).uniform(0.001, 0.003, len(time))
    new = np.cumsum(steps)
    new = new[new < time[-1]]
    if name.endswith("_Nm"):  # white noise has no time of its own
        return new, values[np.round(new / np.diff(time)[0]).astype(int)]
    # of what the encoder turns, in its steps
    step = 2 * np.pi / (2000 if "motor" in name else 2**14)
    return new, np.round(np.interp(new, time, values) / step) * step


def gaps(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    kept = np.ones(len(time), dtype=bool)
    for start in (400, 900, 1500, 2200, 2600):
        kept[start : start + 20] = False
    return time[kept], values[kept]


def dropouts(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    values[rng.integers(5, len(values) - 5, 40)] = np.nan
    return time, values


def zeros(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    if "position" in name:
        values[rng.integers(5, len(values) - 5, 20)] = 0.0
    return time, values


def held(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    for place in rng.integers(5, len(values) - 5, 60):
        values[place] = values[place - 1]
    return time, values


def wraps(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    """The encoders of the motors know one turn."""
    return time, np.mod(values, 2 * np.pi) if "motor_position" in name else values


def disorder(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    order = np.arange(len(time))
    for place in (300, 1000, 2000):
        order[place : place + 2] = order[place : place + 2][::-1]
    return time[order], values[order]


def repeats(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    rows = np.sort(np.concatenate([np.arange(len(time)), np.arange(100, 2800, 30)]))
    return time[rows], values[rows]


def set_back(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    time[1300:] -= 0.7
    return time, values


def everything(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    for damage in (wraps, held, dropouts, gaps, repeats, set_back, joint_clock):
        time, values = damage(name, time, values, np.random.default_rng(len(name)))
    return time, values


WAYS = (
    *(joint_clock, jitter, gaps, dropouts, zeros, held, wraps, disorder, repeats, set_back),
    everything,
)


QUICK = (jitter, everything)
"""The other ways are parts of the last one, but for zeros and disorder, in which time stays."""


@pytest.mark.slow  # 2.3 s
@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(  # an identification of a leg each
            way, id=way.__name__, marks=() if way in QUICK else pytest.mark.slow
        )
        for way in WAYS
    ],
)
def test_a_damaged_log_is_repaired_and_its_estimate_holds(damage: Damage) -> None:
    robot = leg().without_nominal()
    log = log_of(robot, channels_of(clean(), damage))
    assert log.report
    found, before = seaid.identify(robot, log), undamaged()
    check_errors(found)
    for joint in ELASTIC:
        for name in TERMS:
            now, plain = (one.drives[joint].standard_error(name) for one in (found, before))
            assert now < 2.0 * plain


@pytest.mark.slow  # 1.0 s
@pytest.mark.parametrize(
    ("hole", "described"),
    quick_first(  # an identification of a leg each
        [((3.0, 3.3), True), ((3.0, 3.15), False), ((2.5, 3.5), False)]
    ),
)
def test_a_hole_is_excluded_and_said(hole: tuple[float, float], described: bool) -> None:
    """Bridged, holes of 0.3 and of 1 s put a stiffness 30 and 20 standard errors off."""
    robot, log = leg().without_nominal(), with_hole(*hole)
    if described:
        kept = np.isin(clean().time, log.time)
        channels = [Channel(name, clean().time, one) for name, one in clean().columns().items()]
        cut = [replace(one, time=one.time[kept], values=one.values[kept]) for one in channels]
        log = log_of(robot, cut)
    found = seaid.identify(robot, log)
    said = [
        one for one in map(str, found.warnings) if "holes in time, 1 found, the first at" in one
    ]
    assert len(said) == 1
    check_errors(found)
    validation = seaid.validate(found, log)
    assert len(validation.time) == len(log.time)
    assert np.nanmax(validation.load.relative_error) < 1.5 * np.nanmax(
        seaid.validate(found, clean()).load.relative_error
    )


def table(path: Path) -> dict[str, Array]:
    with np.load(path) as columns:
        return dict(columns)


def hebi_channels(name: str) -> list[Channel]:
    columns = table(LOGS / "hebi_arms" / f"{name}.npz")
    sensors = {"pos": "joint_position_rad", "mpos": "motor_position_rad", "eff": "joint_torque_Nm"}
    return [
        Channel(f"joint_{joint}.{ours}", columns[f"t_tx_{joint}"], columns[f"{theirs}_{joint}"])
        for joint in range(5)
        if f"t_tx_{joint}" in columns
        for theirs, ours in sensors.items()
    ]


@pytest.mark.parametrize(
    "name",
    [
        *("capstone_repeat_waypoints", "grav_comp_bad", "ps4_repeat_waypoints"),
        *("ps5_robot_data", "star_trace", "virtual_spring"),
    ],
)
def test_modules_with_clocks_of_their_own(name: str) -> None:
    channels = hebi_channels(name)
    time, values, found = repaired(channels)
    kinds = {one.kind for one in found}
    assert {"irregular steps", "gaps"} <= kinds
    assert not kinds & {"wraps", "sudden zeros", "constant channel", "clock jumps"}
    steps = np.diff(time)
    inside = steps <= longest_bridge(time)  # the others are holes
    assert np.ptp(steps[inside]) < 1e-9
    assert np.sum(~inside) < 30
    for channel in channels:
        assert np.all(np.isfinite(values[channel.name]))
        assert np.min(values[channel.name]) > np.min(channel.values) - 0.1 * np.ptp(channel.values)
        assert np.max(values[channel.name]) < np.max(channel.values) + 0.1 * np.ptp(channel.values)


def test_clocks_of_modules_beside_the_receiver() -> None:
    columns = table(LOGS / "hebi_arms" / "ps4_repeat_waypoints.npz")
    lines = [clock_line(columns[f"t_tx_{joint}"], columns["t_rx"]) for joint in range(3)]
    assert all(line.jitter_s < 0.01 for line in lines)
    beside = [clock_line(columns[f"t_tx_{one}"], columns["t_tx_0"]) for one in (1, 2)]
    assert all(abs(line.offset_s) < 1e-3 and line.jitter_s < 5e-4 for line in beside)
    assert all(abs(line.drift) < 1e-4 for line in beside)


def test_unpowered_modules_have_dead_motor_channels() -> None:
    channels = hebi_channels("sample")
    _, values, found = repaired(channels)
    dead = [one.channel for one in found if one.kind == "constant channel"]
    assert dead == ["joint_0.motor_position_rad", "joint_1.motor_position_rad"]
    assert not np.any(values[dead[0]])


def test_torques_that_end_half_way_are_refused() -> None:
    name = "design_A.0_20220812_sys_id_20220812-060143-PM_measured.npz"
    columns = table(LOGS / "double_pendulum_a0" / "strong_torque" / name)
    channels = [Channel("a.motor_torque_Nm", columns["time"], columns["tau1"])]
    with pytest.raises(LogError, match=r"'a.motor_torque_Nm' lacks 999 of 1998 samples"):
        repaired(channels)


def test_jittered_servo_logs_and_pendulums() -> None:
    for path in sorted((LOGS / "xl330_pendulum" / "raw").glob("*.npz")):
        columns = table(path)
        time, angle = columns["timestamp"], columns["position"]
        grid, values, found = repaired([Channel("a.joint_position_rad", time, angle)])
        assert {one.kind for one in found} <= {"irregular steps", "held values"}
        assert 180 < 1 / np.diff(grid)[0] < 290
        line = np.interp(grid, time, angle)
        assert np.max(np.abs(values["a.joint_position_rad"] - line)) < 0.02
    for path in sorted((LOGS / "double_pendulum_a0" / "weak_torque").glob("*.npz")):
        columns = table(path)
        channels = [Channel("a.joint_position_rad", columns["time"], columns["pos_meas1"])]
        assert {one.kind for one in repaired(channels)[2]} == {"irregular steps"}
