"""The proposed pass band: motion, noise, encoder steps, rate and duration, each with its reason."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import welch
from scipy.special import zeta

from seaid._arrays import Array
from seaid.log.filtering import CutoffSelection, _noise_of_steps, select_cutoff

RATE_HZ = 1000.0
TIME = np.arange(20_000) / RATE_HZ
NAMES = ("hip", "knee")


def sine(frequency_hz: float, phase: float = 0.3) -> Array:
    return np.asarray(np.sin(2 * np.pi * frequency_hz * TIME + phase)[:, None])


def noise(seed: int, size: float) -> Array:
    return np.random.default_rng(seed).normal(0.0, size, (len(TIME), 1))


def proposed(joint: Array, motor: Array | None = None, rate_hz: float = RATE_HZ) -> CutoffSelection:
    motor = np.full_like(joint, np.nan) if motor is None else motor
    return select_cutoff(joint, motor, rate_hz, NAMES[: joint.shape[1]])


@pytest.mark.parametrize("frequency_hz", [0.5, 1.0, 2.5, 8.0, 20.0])
def test_clean_motion_gets_four_times_its_edge_however_slow_or_fast(frequency_hz: float) -> None:
    found = proposed(sine(frequency_hz))
    assert found.cutoff_hz == pytest.approx(4 * frequency_hz, abs=0.5)
    assert "four times the bandwidth of the velocity" in str(found)


@pytest.mark.parametrize("size", [3e-4, 1e-3, 3e-3])
def test_noise_of_the_acceleration_is_one_percent_in_the_band(size: float) -> None:
    """By hand: N (2 pi)^4 f^5 / 5 against 1e-4 of half the square of the acceleration."""
    found = proposed(sine(1.0) + noise(0, size))
    floor = 2 * size**2 / RATE_HZ
    exact = (1e-4 * 0.5 * 5 / floor) ** 0.2
    assert found.noise_limit_hz == pytest.approx(exact, rel=0.05)
    assert found.noise_floor == pytest.approx(floor, rel=0.1)
    assert found.cutoff_hz == pytest.approx(max(min(exact, 4.0), 2.0), abs=0.3)


def test_noise_of_a_motor_counts_in_its_speed_where_the_joint_has_an_encoder() -> None:
    noisy = sine(1.0) + noise(0, 1e-2)
    floor = 2 * 1e-4 / RATE_HZ
    found = proposed(sine(1.0), noisy)
    assert found.noise_limit_hz == pytest.approx((1e-4 * 0.5 * 3 / floor) ** (1 / 3), rel=0.05)
    assert found.channel == "motor side of hip"
    alone = proposed(np.full_like(noisy, np.nan), noisy)
    assert alone.noise_limit_hz == proposed(noisy).noise_limit_hz


def test_coarser_encoder_narrower_band_but_not_narrower_than_the_motion() -> None:
    motion = sine(0.4) + 0.3 * sine(2.0, 1.0)
    bands = [proposed(np.round(motion / step) * step) for step in (1e-6, 1e-2, 3e-2)]
    assert [band.cutoff_hz for band in bands] == sorted(
        (band.cutoff_hz for band in bands), reverse=True
    )
    assert bands[0].cutoff_hz == pytest.approx(8.0, abs=0.3)
    assert bands[-1].cutoff_hz == pytest.approx(4.0, abs=0.3)
    assert "although noise of the joint side of hip requires less" in bands[-1].reason


def test_floor_of_steps_is_above_the_white_one_of_a_slow_coarse_encoder() -> None:
    slow = 0.2 * sine(0.3)
    coarse = np.round(slow / 1e-2) * 1e-2
    steps_hz = np.sum(np.abs(np.diff(coarse[:, 0]))) / 1e-2 / TIME[-1]
    floor = 1e-4 * zeta(3) / np.pi**3 / steps_hz
    assert proposed(coarse).noise_floor == pytest.approx(floor, rel=0.01)


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


def test_vibration_beyond_the_motion_does_not_widen_the_lower_edge() -> None:
    found = proposed(sine(0.5) + 0.02 * sine(15.0))
    assert found.motion_hz[0] == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_coloured_noise_narrows_the_band_as_far_as_its_own_level(exponent: float) -> None:
    """Noise of spectrum c f^-p: the acceleration's power below f is (2 pi)^4 c f^(5-p) / (5-p)."""
    rng, frequency = np.random.default_rng(4), np.fft.rfftfreq(len(TIME), 1 / RATE_HZ)
    density = 1e-9 * np.maximum(frequency, frequency[1]) ** -exponent
    white = rng.normal(size=(2, len(frequency))).T @ [1, 1j]
    coloured = np.fft.irfft(white * np.sqrt(density * RATE_HZ * len(TIME) / 4), len(TIME))
    power = 5 - exponent
    exact = (1e-4 * 0.5 * power / 1e-9) ** (1 / power)
    found = proposed(sine(1.0) + coloured[:, None])
    assert found.noise_limit_hz == pytest.approx(exact, rel=0.15)
    fast = proposed(sine(6.0) + 100 * coloured[:, None])
    assert fast.noise_limit_hz >= 1.5 * 6.0 - 0.1


def test_sweep_is_a_motion_and_what_shakes_on_it_is_not() -> None:
    """From one pose to another at an even speed, as in a log of a single long move."""
    sweep = 0.3 * TIME[:, None]
    found = proposed(sweep + 2e-3 * sine(20.0) + noise(0, 1e-4))
    assert found.motion_hz[0] < 0.5
    assert proposed(sweep + noise(0, 1e-3)).channel == "joint side of hip"


def test_fastest_joint_decides_whatever_its_unit_or_offset() -> None:
    slow, fast = sine(0.3), sine(2.5)
    together = proposed(np.hstack([100 * slow + 5.0, 1e-3 * fast - 2.0]))
    assert together.cutoff_hz == pytest.approx(proposed(fast).cutoff_hz, rel=1e-6)


def test_band_of_a_slow_or_short_log_says_so() -> None:
    slow = proposed(sine(1.0)[::50], rate_hz=20.0)
    assert slow.cutoff_hz == 2.5
    assert "an eighth of the rate" in slow.reason
    short = proposed(sine(0.5)[:4000])
    assert short.cutoff_hz == pytest.approx(15 / 4)
    assert "fifteen periods in the log" in short.reason


def test_joints_that_stand_still_or_only_shake_have_no_say() -> None:
    moving, still = sine(2.5), np.full((len(TIME), 1), 0.7)
    expected = proposed(moving)
    assert proposed(np.hstack([moving, still])).cutoff_hz == expected.cutoff_hz
    assert proposed(np.hstack([moving, noise(0, 1e-3)])).cutoff_hz == expected.cutoff_hz
    nothing = proposed(still)
    assert nothing.cutoff_hz == RATE_HZ / 8
    assert "nothing moves" in str(nothing)
