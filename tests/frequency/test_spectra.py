"""The best linear approximation of logs without periods, by averaged cross-spectra."""

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.frequency.spectra import Approximation, Record, Spectra, approximation_of

STEP_S = 0.01


def record(torque: Array, motor: Array) -> Record:
    """Return a log without periods (T, n)."""
    nothing = np.full_like(torque, np.nan)[None]
    posture = np.zeros(torque.shape[1])
    return Record(torque[None], motor[None], nothing, STEP_S, posture)


def approximation(*records: Record) -> Approximation:
    n = records[0].torque.shape[-1]
    no_lines, hz = np.zeros((1, 1, 2, n)), np.array([5.0, 45.0])
    unexcited = np.zeros((2, 1, 1, 0, n))
    spectra = Spectra(hz, no_lines, no_lines, no_lines, hz[:0], unexcited, False)
    return approximation_of(spectra, records, range(n), np.zeros((2, n, n)))


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_the_coherence_does_not_depend_on_the_phase_of_the_response(delay: int) -> None:
    """A delay of one sample turns the phase by 90 degrees at half the Nyquist frequency."""
    torque = np.random.default_rng(3).normal(size=(2304, 1))
    response = approximation(record(torque, np.roll(torque, delay)))
    assert np.abs(response.response) == pytest.approx(1.0, abs=0.05)
    assert np.all(response.coherence > 0.99)


@pytest.mark.parametrize(("logs", "n"), [(1, 1), (1, 3), (3, 2)])
def test_total_std_of_segments_is_the_spread_of_the_response(logs: int, n: int) -> None:
    rng = np.random.default_rng(logs + 10 * n)
    truth = np.eye(n) + 0.3 * rng.normal(size=(n, n))
    errors, variances = [], []
    for _ in range(60):
        torques = rng.normal(size=(logs, 1152, n))
        motors = torques @ truth.T + rng.normal(size=torques.shape)
        response = approximation(*map(record, torques, motors))
        errors.append(np.abs(response.response - truth) ** 2)
        variances.append(response.total_std**2)
    assert 0.93 < np.sqrt(np.mean(variances) / np.mean(errors)) < 1.1
