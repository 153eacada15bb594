"""frozen: float64, shape-checked, read-only copies."""

import math

import numpy as np
import pytest

from seaid._arrays import check_rate, finite, frozen, seed_of, white_noise
from seaid.errors import LogError, RobotError, SeaidError


def test_result_is_a_read_only_copy_in_float64() -> None:
    source = np.array([[1, 2], [3, 4]], dtype=np.int32)
    array = frozen("q", source, (None, 2))
    source[0, 0] = 9
    assert array.dtype == np.float64
    assert array.flags.c_contiguous
    assert array[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        array[0, 0] = 5.0


def test_nan_is_kept_by_frozen_and_refused_by_finite() -> None:
    assert np.isnan(frozen("q", [1.0, np.nan], (2,))[1])
    with pytest.raises(SeaidError, match=r"q must be finite, found \[1.0, nan\]"):
        finite("q", [1.0, np.nan], (2,))
    with pytest.raises(SeaidError, match="gravity must be finite, found inf"):
        finite("gravity", np.inf, ())


@pytest.mark.parametrize("shape", [(3,), (2, 3), (None,), (None, 2, None), ()])
def test_wrong_shape_names_the_array_and_both_shapes(shape: tuple[int | None, ...]) -> None:
    with pytest.raises(LogError, match=r"motor_position must have shape \(.*\), found \(4, 5\)"):
        frozen("motor_position", np.zeros((4, 5)), shape, LogError)


@pytest.mark.parametrize("value", ["abc", ["1", "x"], [[1.0], [1.0, 2.0]], None, {}])
def test_what_is_no_number_is_refused_by_name(value: object) -> None:
    with pytest.raises(SeaidError, match=r"^com must "):
        frozen("com", value, (3,))


@pytest.mark.parametrize("seed", [-1, 1.5, "1", None, True])
def test_a_seed_that_is_none_is_refused(seed: object) -> None:
    with pytest.raises(RobotError, match="seed must be a whole number, zero or more, found"):
        seed_of(seed, RobotError)


def test_seeds_may_be_large_and_of_numpy() -> None:
    assert [seed_of(seed) for seed in (0, 10**40, np.int32(3))] == [0, 10**40, 3]


@pytest.mark.parametrize(
    ("rate", "words"),
    [
        (math.nan, "rate_hz must be more than zero, found nan"),
        (math.inf, "rate_hz must be more than zero, found inf"),
        (0, "rate_hz must be more than zero, found 0"),
        (True, "rate_hz must be a number, found True"),
        ("10", "rate_hz must be a number, found '10'"),
        (1e15, r"rate_hz of 1e\+15 makes more than 10,000,000 samples of 4 s.*at most 2.5e\+06"),
    ],
)
def test_a_rate_that_is_none_is_refused(rate: object, words: str) -> None:
    with pytest.raises(SeaidError, match=words):
        check_rate(rate, 4.0)
    check_rate(2.5e6, 4.0)
    with pytest.raises(RobotError, match=r"rate_hz must be more than 0\.1, found 1e-320"):
        check_rate(1e-320, 4.0, 0.1, RobotError)


def test_the_noise_of_a_channel_is_found_below_its_motion_and_its_jumps() -> None:
    time = np.linspace(0.0, 10.0, 10_000)
    noisy = np.sin(time) + np.random.default_rng(0).normal(0.0, 1e-3, len(time))
    assert white_noise(noisy) == pytest.approx(1e-3, rel=0.05)
    assert white_noise(noisy, robust=True) == pytest.approx(1e-3, rel=0.05)
    noisy[::500] += 1.0
    assert white_noise(noisy, robust=True) == pytest.approx(1e-3, rel=0.05)
    assert white_noise(noisy) > 0.03
