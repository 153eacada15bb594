"""Low pass, derivatives and decimation, on signals that are known exactly."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import welch

from seaid._arrays import Array
from seaid.log import Motion, in_band, low_pass, select_cutoff
from seaid.log.filtering import (
    CutoffSelection,
    _noise_of_steps,
    decimation,
    is_friction_known,
    mean_directions,
    spline_derivatives,
)
from seaid.log.rows import in_band_at

RATE_HZ = 1000.0
TIME = np.arange(20_000) / RATE_HZ
INSIDE = slice(1000, -1000)


def waves(frequency_hz: float, phase: float = 0.3) -> Array:
    return np.asarray(np.sin(2 * np.pi * frequency_hz * TIME + phase)[:, None])


def gain(frequency_hz: float, cutoff_hz: float) -> float:
    """Return the gain of two passes of a second-order Butterworth filter, bilinear transform."""
    warped = np.tan(np.pi * frequency_hz / RATE_HZ) / np.tan(np.pi * cutoff_hz / RATE_HZ)
    return float(1 / (1 + warped**4))


@pytest.mark.parametrize("frequency_hz", [0.5, 5.0, 30.0])
def test_sine_keeps_its_phase_and_takes_the_gain_of_two_passes(frequency_hz: float) -> None:
    """The gain is that of the bilinear transform of two passes, and backwards it is the same."""
    filtered = low_pass(waves(frequency_hz), RATE_HZ, 10.0)
    expected = gain(frequency_hz, 10.0) * waves(frequency_hz)
    assert np.allclose(filtered[INSIDE], expected[INSIDE], rtol=0, atol=1e-6)
    backwards = low_pass(waves(frequency_hz)[::-1], RATE_HZ, 10.0)[::-1]
    assert np.allclose(filtered[INSIDE], backwards[INSIDE], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("samples", "cutoff_hz"),
    [
        (np.arange(130, 3900, 25), 10.0),
        (np.delete(np.arange(0, 4000, 25), [3, 4, 80]), 10.0),
        (np.arange(7, 4000, 160), 1.5),
        (np.array([1000, 3000]), 40.0),
        (np.arange(3999, 0, -43)[:5], 10.0),
        (np.array([2000]), 10.0),
        (np.arange(500, 900, 3), 90.0),
        (np.arange(0, 4000, 20), np.inf),
    ],
)
def test_values_at_rows_are_those_of_all_samples(samples: np.ndarray, cutoff_hz: float) -> None:
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(4000, 3, 4)).cumsum(axis=0)
    columns[:, 1] = 0.0
    bands = {"rate_hz": RATE_HZ, "cutoff_hz": cutoff_hz}
    motion = cast(Motion, SimpleNamespace(time=np.arange(4000) / RATE_HZ, **bands))
    every, some = in_band(motion, columns), in_band_at(motion, columns, samples)
    # One period of the cutoff from the ends, where there are no rows, transients are below 1e-6.
    np.testing.assert_allclose(some, every[samples], rtol=0, atol=1e-6 * float(np.std(columns)))
    margin = 3 * RATE_HZ / cutoff_hz
    inside = (samples > margin) & (samples < 4000 - margin)
    np.testing.assert_allclose(some[inside], every[samples[inside]], rtol=0, atol=1e-8)
    single = in_band_at(motion, columns[:, 0, 0], samples)
    np.testing.assert_allclose(single, some[:, 0, 0], rtol=0, atol=1e-10)


def test_many_columns_are_never_in_memory_at_all_samples() -> None:
    columns = np.random.default_rng(0).normal(size=(4000, 3, 15)).cumsum(axis=0)
    bands = {"rate_hz": RATE_HZ, "cutoff_hz": 10.0}
    motion = cast(Motion, SimpleNamespace(time=np.arange(4000) / RATE_HZ, **bands))
    sizes, samples = list[int](), np.arange(130, 3900, 25)

    def of_samples(part: slice) -> np.ndarray:
        sizes.append(len(columns[part]))
        return columns[part]

    by_parts = in_band_at(motion, of_samples, samples)
    few = [in_band_at(motion, columns[:, :, [x]], samples) for x in range(15)]
    assert max(sizes) < 2500
    np.testing.assert_allclose(by_parts, np.concatenate(few, axis=2), rtol=0, atol=1e-9)
    margin = (samples > 300) & (samples < 3700)
    every = in_band(motion, columns)[samples[margin]]
    np.testing.assert_allclose(by_parts[margin], every, rtol=0, atol=1e-8)


@given(seed=st.integers(0, 1000), cutoff_hz=st.floats(1.0, 100.0))
def test_the_low_pass_is_linear_and_keeps_lines(seed: int, cutoff_hz: float) -> None:
    """Regressor and target are filtered alike, and a line passes unchanged up to the ends."""
    rng = np.random.default_rng(seed)
    H, theta = rng.normal(size=(800, 3)), rng.normal(size=(3, 1))
    together, apart = (low_pass(x, RATE_HZ, cutoff_hz) for x in (H @ theta, H))
    assert np.allclose(together, apart @ theta, rtol=0, atol=1e-10)
    line = (0.3 + 2.0 * TIME)[:, None]
    assert np.allclose(low_pass(line, RATE_HZ, cutoff_hz), line, rtol=0, atol=1e-6)
    assert low_pass(np.ones((12, 1)), RATE_HZ, cutoff_hz) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("cutoff_hz", "step"), [(5.0, 50), (12.0, 20), (100.0, 2), (240.0, 1), (450.0, 1), (np.inf, 1)]
)
def test_four_rows_a_period_of_the_cutoff(cutoff_hz: float, step: int) -> None:
    """Above four tenths of the rate the signals are left alone."""
    assert decimation(RATE_HZ, cutoff_hz) == step
    signal = np.random.default_rng(1).normal(size=(100, 1))
    assert (low_pass(signal, RATE_HZ, cutoff_hz) is signal) == (cutoff_hz >= 400.0)


@pytest.mark.parametrize("frequency_hz", [0.3, 1.0, 5.0])
def test_derivatives_of_a_sine_right_up_to_the_ends(frequency_hz: float) -> None:
    """Both derivatives are exact, and those of a missing signal are missing."""
    omega = 2 * np.pi * frequency_hz
    angle = omega * TIME[:2000] + 0.3
    value, first, second = spline_derivatives(TIME[:2000], np.sin(angle)[:, None])
    assert np.array_equal(value[:, 0], np.sin(angle))
    assert np.max(np.abs(first[:, 0] - omega * np.cos(angle))) < 1e-8 * omega
    assert np.max(np.abs(second[:, 0] + omega**2 * np.sin(angle))) < 1e-6 * omega**2
    missing = spline_derivatives(TIME[:100], np.full((100, 1), np.nan))
    assert np.all(np.isnan(missing))


def passing(friction: float, rate_hz: float, band_hz: float) -> tuple[Array, Array]:
    """Return the speed behind the low pass, and the true means of the direction.

    A joint of 1 kg m^2 follows two sines, which are much stronger than its Coulomb friction.
    """
    parts = 100
    step = 1 / (rate_hz * parts)
    time = np.arange(int(12 * rate_hz) * parts, dtype=np.float64) * step
    force = 30 * np.sin(9 * time) + 12 * np.sin(23 * time + 1)
    q, v = np.zeros(len(time)), -2.5
    direction = np.empty(len(time))
    for tick in range(1, len(time)):
        direction[tick - 1] = np.sign(v)
        change = step * (force[tick] - friction * np.sign(v))
        q[tick], v = q[tick - 1] + step * (v + change / 2), v + change
    direction[-1] = np.sign(v)
    position = low_pass(q[::parts, None], rate_hz, band_hz)
    _, speed, _ = spline_derivatives(time[::parts], position)
    means = np.convolve(direction, np.ones(parts) / parts, mode="same")[::parts]
    return speed[:, 0], means


@pytest.mark.parametrize("friction", [0.0, 1.0, 3.0])
def test_directions_are_the_means_of_the_true_ones(friction: float) -> None:
    """The area between them is a twentieth of that of the signs at the samples, or less."""
    rate_hz, band_hz = 200.0, 25.0
    speed, true = passing(friction, rate_hz, band_hz)
    inside = slice(100, -100)

    def area_ms(directions: Array) -> float:  # per reversal, from one side to the other
        reversals = np.sum(np.diff(np.sign(speed[inside])) != 0)
        return float(1e3 * np.sum(np.abs(directions - true)[inside]) / rate_hz / reversals)

    found = mean_directions(speed, rate_hz, band_hz, friction)
    true = low_pass(true[:, None], rate_hz, band_hz)[:, 0]
    assert area_ms(np.sign(speed)) > 20 * area_ms(found)
    late = mean_directions(speed, rate_hz, band_hz, 0.0)
    assert friction == 0 or area_ms(late) > 4 * area_ms(found)


def test_friction_is_not_known_at_rest_nor_where_a_joint_may_stick() -> None:
    """A reversal with thrice the acceleration of dry friction is passed; a stop is none."""
    rate_hz, band_hz, blur = 100.0, 20.0, 3.5
    time = np.arange(0, 6, 1 / rate_hz)
    speed = np.where(time < 2.005, 2.005 - time, np.where(time < 4.005, 0.0, 4.005 - time))

    def unknown_s(dry: float) -> tuple[float, float]:
        known = is_friction_known(speed, 2.0, rate_hz, band_hz, dry, blur)
        return float(np.sum(~known)) / rate_hz, float(time[~known][-1])

    blur_s = blur / (2 * np.pi * band_hz)
    length, end = unknown_s(np.inf)
    assert length == pytest.approx(2.04 + 2 * blur_s, abs=0.03)
    assert end == pytest.approx(4.02 + blur_s, abs=0.02)

    line = 1.5025 - time
    for dry, sticks in ((0.3, False), (0.4, True), (np.inf, True)):
        known = is_friction_known(line, 1.5, rate_hz, band_hz, dry, blur)
        assert np.all(known) != sticks
        if sticks:
            assert np.sum(~known) / rate_hz == pytest.approx(0.03 + 2 * blur_s, abs=0.03)
            assert np.mean(time[~known]) == pytest.approx(1.5025, abs=0.01)


def test_a_joint_at_rest_has_no_direction() -> None:
    """Rounding decides no direction, and a stop begins and ends at the zeros of the lines."""
    speed = np.array([0.2, 0.1, 0.0, 1e-9, -1e-9, 0.0, -0.1, -0.2, -0.3] * 4)
    found = mean_directions(speed, 100.0, 100.0, 0.0)
    np.testing.assert_allclose(found[:7], [1, 1, 0.5, 0, 0, -0.5, -1])


# The proposed pass band: motion, noise, encoder steps, rate and duration, each with its reason

NAMES = ("hip", "knee")


def noise(seed: int, size: float) -> Array:
    return np.random.default_rng(seed).normal(0.0, size, (len(TIME), 1))


def proposed(joint: Array, motor: Array | None = None, rate_hz: float = RATE_HZ) -> CutoffSelection:
    motor = np.full_like(joint, np.nan) if motor is None else motor
    return select_cutoff(joint, motor, rate_hz, NAMES[: joint.shape[1]])


@pytest.mark.parametrize("frequency_hz", [0.5, 2.5, 20.0])
def test_clean_motion_gets_four_times_its_edge_however_slow_or_fast(frequency_hz: float) -> None:
    found = proposed(waves(frequency_hz))
    assert found.cutoff_hz == pytest.approx(4 * frequency_hz, abs=0.5)
    assert "four times the bandwidth of the velocity" in str(found)


def test_noise_of_a_motor_counts_in_its_speed_where_the_joint_has_an_encoder() -> None:
    """N (2 pi)^2 f^3 / 3 against 1e-4 of half the square of the velocity."""
    noisy = waves(1.0) + noise(0, 1e-2)
    floor = 2 * 1e-4 / RATE_HZ
    found = proposed(waves(1.0), noisy)
    assert found.noise_limit_hz == pytest.approx((1e-4 * 0.5 * 3 / floor) ** (1 / 3), rel=0.05)
    assert found.channel == "motor side of hip"
    alone = proposed(np.full_like(noisy, np.nan), noisy)
    assert alone.noise_limit_hz == proposed(noisy).noise_limit_hz


def test_coarser_encoder_narrower_band_but_not_narrower_than_the_motion() -> None:
    motion = waves(0.4) + 0.3 * waves(2.0, 1.0)
    bands = [proposed(np.round(motion / step) * step) for step in (1e-6, 1e-2, 3e-2)]
    assert [band.cutoff_hz for band in bands] == sorted(
        (band.cutoff_hz for band in bands), reverse=True
    )
    assert bands[0].cutoff_hz == pytest.approx(8.0, abs=0.3)
    assert bands[-1].cutoff_hz == pytest.approx(4.0, abs=0.3)
    assert "although noise of the joint side of hip requires less" in bands[-1].reason


@pytest.mark.parametrize("steps_hz", [5, 20, 100, 1000])
def test_noise_of_steps_is_that_of_simulated_encoders(steps_hz: int) -> None:
    """At few steps per second it was once four times as large."""
    rng, rate, time = np.random.default_rng(steps_hz), 200.0, np.arange(80_000) / 200.0
    densities = []
    for _ in range(4):
        hz, phases = rng.uniform(0.1, 1.0, 8), rng.uniform(0, 2 * np.pi, 8)
        angle = np.sum(np.sin(2 * np.pi * np.outer(time, hz) + phases) / hz, axis=1)
        step = np.mean(np.abs(np.diff(angle))) * rate / steps_hz
        read = step * np.round(angle / step)
        frequency, power = welch(read - angle, rate, nperseg=4000)
        slow = (frequency > 0.05) & (frequency < 0.3 * min(steps_hz, rate / 2))
        density, variance = _noise_of_steps(read, rate)
        assert np.var(read - angle) == pytest.approx(variance, rel=0.05)
        densities.append(np.mean(power[slow]) / density)
    assert np.mean(densities) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0])
def test_noise_narrows_the_band_as_far_as_its_own_level(exponent: float) -> None:
    """Noise of spectrum c f^-p: the acceleration's power below f is (2 pi)^4 c f^(5-p) / (5-p).

    It is 1 % of the acceleration in the band.
    """
    rng, frequency = np.random.default_rng(4), np.fft.rfftfreq(len(TIME), 1 / RATE_HZ)
    density = 1e-9 * np.maximum(frequency, frequency[1]) ** -exponent
    white = rng.normal(size=(2, len(frequency))).T @ [1, 1j]
    coloured = np.fft.irfft(white * np.sqrt(density * RATE_HZ * len(TIME) / 4), len(TIME))
    power = 5 - exponent
    exact = (1e-4 * 0.5 * power / 1e-9) ** (1 / power)
    found = proposed(waves(1.0) + coloured[:, None])
    assert found.noise_limit_hz == pytest.approx(exact, rel=0.15 if exponent else 0.05)
    assert exponent or found.noise_floor == pytest.approx(1e-9, rel=0.1)
    fast = proposed(waves(6.0) + 100 * coloured[:, None])
    assert not exponent or fast.noise_limit_hz >= 1.5 * 6.0 - 0.1


def test_what_is_no_motion_does_not_decide() -> None:
    """Vibrations, sweeps, units, offsets and joints that stand still leave the band as it is."""
    fast, still = waves(2.5), np.full((len(TIME), 1), 0.7)
    expected = proposed(fast).cutoff_hz
    for joints in ((100 * waves(0.3) + 5.0, 1e-3 * fast - 2.0), (fast, still)):
        assert proposed(np.hstack(joints)).cutoff_hz == pytest.approx(expected, rel=1e-6)
    assert proposed(np.hstack([fast, noise(0, 1e-3)])).cutoff_hz == expected
    assert proposed(waves(0.5) + 0.02 * waves(15.0)).motion_hz[0] == pytest.approx(1.0, abs=0.3)
    sweep = 0.3 * TIME[:, None]  # a single long move at an even speed
    assert proposed(sweep + 2e-3 * waves(20.0) + noise(0, 1e-4)).motion_hz[0] < 0.5


def test_band_of_a_slow_short_or_still_log_says_so() -> None:
    slow = proposed(waves(1.0)[::50], rate_hz=20.0)
    assert slow.cutoff_hz == 2.5
    assert "an eighth of the rate" in slow.reason
    short = proposed(waves(0.5)[:4000])
    assert short.cutoff_hz == pytest.approx(15 / 4)
    assert "fifteen periods in the log" in short.reason
    nothing = proposed(np.full((len(TIME), 1), 0.7))
    assert nothing.cutoff_hz == RATE_HZ / 8
    assert "nothing moves" in str(nothing)
