"""Logs damaged in known ways: found, counted, repaired within limits, refused beyond them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log.log import MINIMUM_SAMPLES
from seaid.log.long_log import _overlapping
from seaid.log.reading import repaired as repaired_channels
from seaid.log.repair import Channel, Repair, Repairs
from seaid.log.repair.channels import interpolated, on_time

RATE = 500.0
ENCODER = 2 * np.pi / 2**14
POSITION, TORQUE = "knee.joint_position_rad", "knee.motor_torque_Nm"


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


def test_clocks_that_cannot_belong_together_are_refused() -> None:
    time = regular()
    other = Channel("hip.joint_position_rad", time * 1.01, angle(time))
    with pytest.raises(LogError, match=r"hip.* drifts by 0\.01 s/s .*allowed 0\.002"):
        repaired_channels([*pair(time), other])
    far = Channel("hip.joint_position_rad", time[:-7] + 100.0, angle(time[:-7]))
    with pytest.raises(LogError, match=r"share 0 s of 7\.998 s: 'hip.*the same zero"):
        repaired_channels([*pair(time), far])


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


def test_gaps_beyond_the_limits_are_refused() -> None:
    time = regular()
    keep = np.ones(len(time), dtype=bool)
    keep[1500:1800] = False
    with pytest.raises(LogError, match=r"gap of 0\.602 s at t = 2\.998 s, allowed 0\.1 s"):
        repaired_channels(pair(time[keep]), Repairs(longest_gap_s=0.1))
    few = keep.copy()
    few[500:545] = few[2500:2545] = False
    with pytest.raises(LogError, match=r"gap of 0\.092 s .* such gaps is 1.*most_gap_error"):
        repaired_channels([Channel(POSITION, time[few], angle(20 * time[few]))])
    with pytest.raises(LogError, match="cannot be estimated, the log is too short"):
        short = time[400:580][few[400:580]]
        repaired_channels([Channel(POSITION, short, angle(short))], Repairs(most_missing=0.9))
    keep[1000:3000] = False
    with pytest.raises(LogError, match=r"1 gaps with 50\.0% of the time .*most_missing"):
        repaired_channels(pair(time[keep]), Repairs(longest_gap_s=10.0))


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


def test_too_many_late_samples_are_refused() -> None:
    time = regular()
    order = np.arange(len(time)).reshape(-1, 2)[:, ::-1].ravel()
    with pytest.raises(LogError, match=r"stamps are late, repeated .*most_disordered"):
        repaired_channels(pair(time[order]))


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


def test_coarse_stamps_of_uneven_samples_are_refused_with_their_mean_rate() -> None:
    time = np.cumsum(np.random.default_rng(0).uniform(0.001, 0.003, 4000))
    with pytest.raises(LogError, match=r"all its digits.* time = \{ rate_hz = (499|50[01])"):
        repaired_channels([Channel(POSITION, np.round(time, 1), angle(time))])


def test_stamps_without_any_digits_are_refused_and_ask_for_the_rate() -> None:
    time = regular()
    stamps = (1.7e9 + time).astype(np.float32).astype(float)
    with pytest.raises(LogError, match=r"all its digits.* time = \{ rate_hz = \.\.\. \}"):
        repaired_channels([Channel(POSITION, stamps, angle(time))])


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


def test_two_recordings_in_one_are_refused() -> None:
    time = regular()
    twice, values = np.concatenate([time, time]), np.concatenate([angle(time), angle(time, 1.5)])
    with pytest.raises(LogError, match=r"goes backwards at sample 4000 .* two recordings in one"):
        repaired_channels([Channel(POSITION, twice, values)])


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


def test_too_many_dropouts_are_refused() -> None:
    time = regular()
    values = 3.0 + angle(time)
    values[2000:] = 0.0
    message = r"'knee.joint_position_rad' lacks 2000 of 4000 samples .* allowed 25\.0%"
    with pytest.raises(LogError, match=message):
        repaired_channels([Channel(POSITION, time, values)])


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


def test_ambiguous_wraps_are_refused() -> None:
    time = regular()
    wild = np.mod(np.random.default_rng(0).uniform(0.0, 60.0, len(time)), 2 * np.pi)
    with pytest.raises(
        LogError, match=r"wraps around every 6\.28319: the number of wraps is ambiguous"
    ):
        repaired_channels([Channel(POSITION, time, wild, 2 * np.pi)])


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


def test_saturation_is_counted_and_beyond_the_limit_refused() -> None:
    time = regular()
    for level, refused in ((2.05, False), (1.9, True)):
        clipped = Channel(TORQUE, time, np.clip(torque(time), -level, level))
        if refused:
            with pytest.raises(LogError, match=r"saturated \(1\.9\) in .*most_saturat"):
                repaired_channels([clipped])
        _, values, found = repaired_channels([clipped], Repairs(most_saturated=0.4))
        stuck = np.abs(clipped.values) == level
        assert 0 < kinds(found)["saturated samples"] <= stuck.sum()
        assert np.array_equal(values[TORQUE], clipped.values)


def test_a_coarse_torque_is_not_saturated() -> None:
    time = regular()
    for values in (torque(time), 2.0 * np.cos(2 * np.pi * 0.4 * time)):
        coarse = np.round(values / 0.05) * 0.05
        assert repaired_channels([Channel(TORQUE, time, coarse)])[2] == ()


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"rate_hz": 0.0}, r"Repairs: 'rate_hz' must be a finite number above 0, found 0"),
        (
            {"longest_gap_s": np.inf},
            r"Repairs: 'longest_gap_s' must be a finite number .* found inf",
        ),
        ({"most_missing": 1.5}, r"Repairs: 'most_missing' must be a share from 0 to 1, found 1.5"),
        ({"most_disordered": np.nan}, r"Repairs: 'most_disordered' must be .* found nan"),
        ({"most_saturated": "all"}, r"Repairs: 'most_saturated' must be .* found 'all'"),
    ],
)
def test_limits_that_cannot_be_meant(bad: dict[str, float], message: str) -> None:
    with pytest.raises(LogError, match=message):
        Repairs(**bad)


def _without_stamps(time: Array) -> list[Channel]:
    return [Channel(POSITION, np.full(len(time), np.nan), angle(time))]


def _without_numbers(time: Array) -> list[Channel]:
    return [Channel(POSITION, time, np.full(len(time), np.nan))]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda time: [], "no channels to repair"),
        (_without_stamps, "has 0 finite stamps, at least 4 are needed"),
        (_without_numbers, "no channel of the log has as many as four samples"),
    ],
)
def test_nothing_to_repair(make: Callable[[Array], list[Channel]], message: str) -> None:
    with pytest.raises(LogError, match=message):
        repaired_channels(make(regular()))


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


@pytest.mark.parametrize("lengths", [(100, 30, 100), (20, 100, 30), (100, 10, 10, 80, 5)])
@pytest.mark.parametrize("overlap", [0, 10])
def test_no_sample_of_a_short_piece_is_lost(lengths: tuple[int, ...], overlap: int) -> None:
    ends = np.cumsum(lengths)
    blocks = [{"t": np.arange(end - n, end)} for n, end in zip(lengths, ends, strict=True)]
    seen = [
        block["t"][before : before + length]
        for block, before, length in _overlapping(iter(blocks), overlap)
    ]
    np.testing.assert_array_equal(np.concatenate(seen), np.arange(ends[-1]))
    assert min(map(len, seen)) >= MINIMUM_SAMPLES


def test_an_orientation_that_rests_is_not_saturated() -> None:
    time = np.arange(0.0, 4.0, 0.01)
    values = np.minimum(1.0, 1.3 - 0.4 * np.sin(time) ** 2)
    with pytest.raises(LogError, match="is saturated"):
        repaired_channels([Channel("a.motor_torque_Nm", time, values)])
    repaired_channels([Channel("base.orientation_w", time, values)])
