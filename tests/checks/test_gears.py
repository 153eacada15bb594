"""The gear ratio from angles on both sides: recovered, with an honest error, refused in words."""

import numpy as np
import pytest

from seaid.errors import LogError
from seaid.identification import gear_ratio


def angles(ratio: float, swing: float, error: float, zero: float = 0.7) -> tuple[np.ndarray, ...]:
    """Return motor angle in Hall steps and output angle with a periodic transmission error."""
    output = swing * np.sin(np.linspace(0.0, 9.0, 4000))
    motor = ratio * (output + error * np.sin(8 * output + zero)) + 3.0
    return np.round(motor / (np.pi / 3)) * (np.pi / 3), output


@pytest.mark.parametrize("ratio", [-100.0, 272.222, 1742.222])
def test_exact_angles_give_the_ratio(ratio: float) -> None:
    output = np.sin(np.linspace(0.0, 9.0, 500))
    found = gear_ratio(ratio * output - 5.0, output)
    assert found.value == pytest.approx(ratio, rel=1e-12)
    assert found.standard_error < 1e-9


@pytest.mark.parametrize("zero", [0.0, 0.7, 1.4, 2.1, 2.8])
@pytest.mark.parametrize("swing", [0.6, 1.0])
def test_the_standard_error_holds_transmission_errors(swing: float, zero: float) -> None:
    motor, output = angles(762.222, swing, 2e-3, zero)
    found = gear_ratio(motor, output)
    assert abs(found.value - 762.222) < found.standard_error
    of_one_sample = 762.222 * found.misfit_rad / np.std(output)
    assert found.standard_error == pytest.approx(of_one_sample, rel=0.02)
    assert found.misfit_rad == pytest.approx(2e-3 / np.sqrt(2), rel=0.4)


def test_more_samples_do_not_make_it_surer() -> None:
    motor, output = angles(272.222, 1.0, 2e-3)
    once, often = gear_ratio(motor, output), gear_ratio([motor] * 9, [output] * 9)
    assert often.standard_error == pytest.approx(once.standard_error)


def test_logs_have_their_own_offset_and_nan_samples_are_excluded() -> None:
    motor, output = angles(272.222, 1.0, 0.0)
    motor[5] = np.nan
    found = gear_ratio([motor, motor + 400.0], [output, output - 1.0])
    assert found.value == pytest.approx(272.222, rel=2e-4)


def test_angles_without_a_ratio_are_refused() -> None:
    turning = np.sin(np.linspace(0.0, 9.0, 500))
    noise = np.random.default_rng(0).normal(size=500)
    with pytest.raises(LogError, match="one of the angles is constant"):
        gear_ratio(turning, np.ones(500))
    with pytest.raises(LogError, match="turn the joint farther, or check units and wraps"):
        gear_ratio(100 * turning + 50 * noise, turning)
    with pytest.raises(LogError, match=r"found shapes \(500,\) and \(499,\)"):
        gear_ratio(turning, turning[1:])
    with pytest.raises(LogError, match="found 2 and 1"):
        gear_ratio([turning, turning], [turning])
    with pytest.raises(LogError, match="NaN at all samples"):
        gear_ratio(np.full(500, np.nan), turning)
