"""Multisines: their spectrum, their limits, and what they refuse."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid._arrays import Array
from seaid.excitation import Limits, Multisine
from tests.excitation.robots import assert_kept
from tests.experiments import leg
from tests.one_joint import chain

LIMITS = Limits(acceleration=60.0)
SHAPE = Multisine(band_hz=(0.4, 10.0), period_s=5.0)


def plan(shape: Multisine = SHAPE, seed: int = 0, limits: Limits = LIMITS) -> seaid.Excitation:
    return seaid.design_excitation(
        leg(), 10.0, basis="multisine", multisine=shape, limits=limits, seed=seed
    )


def amplitudes(found: seaid.Trajectory, order: int = 0) -> Array:
    time = np.arange(2000) * found.duration / 2000
    return np.asarray(np.abs(np.fft.rfft(found.sample(time)[order], axis=0)) / 1000)


def test_only_odd_lines_of_the_band_are_excited_equally_in_acceleration() -> None:
    """The motion keeps all limits, that of the torque too."""
    found = plan()
    lines = amplitudes(found.trajectory, 2)
    excited = np.flatnonzero(lines[:, 0] > 1e-6 * lines.max())
    assert np.all(excited % 2 == 0)  # two periods
    assert np.all((excited // 2) % 2 == 1)
    assert excited[0] / 10 >= 0.4
    assert excited[-1] / 10 <= 10.0
    assert lines[excited] == pytest.approx(np.broadcast_to(lines[excited][0], (len(excited), 5)))
    possible = len(np.arange(3, 51, 2))
    assert len(excited) == possible - possible // 4  # one of four is omitted
    assert_kept(found.trajectory, found.limits, 500.0)
    assert np.all(found.margins.velocity > 0)
    limits = seaid.excitation.limits.drive_limits(leg(), LIMITS, found.limits.velocity)
    assert limits is not None
    time = np.linspace(0, 5, 400)
    torque = seaid.excitation.limits.drive_loads(limits, time, found.trajectory.sample(time))[0]
    assert np.all(np.abs(torque) <= leg().effort_limits)


@pytest.mark.slow  # 3.5 s
def test_experiments_are_orthogonal_and_realisations_differ() -> None:
    free = Limits(acceleration=60.0, joint_torque=math.inf)
    plans = [plan(replace(SHAPE, experiment=e, amplitude=0.05), limits=free) for e in range(5)]
    size = plans[0].trajectory.basis.harmonics  # type: ignore[attr-defined]
    spectra = [one.trajectory.coefficients[1:] for one in plans]
    lines = np.stack([one[size:] - 1j * one[:size] for one in spectra], axis=1)  # (H, E, n)
    excited = np.abs(lines[:, 0, 0]) > 0
    gram = np.einsum("hei,hej->hij", lines[excited].conj(), lines[excited])
    diagonal = np.einsum("hii->hi", gram).real
    assert gram / diagonal[:, :, None] == pytest.approx(
        np.broadcast_to(np.eye(5), gram.shape), abs=1e-9
    )
    other = plan(replace(SHAPE, realisation=1))
    assert not np.allclose(other.trajectory.coefficients, plan().trajectory.coefficients)
    assert np.array_equal(plan().trajectory.coefficients, plan().trajectory.coefficients)
    assert not np.allclose(plan(seed=1).trajectory.coefficients, plan().trajectory.coefficients)


def test_held_joints_given_amplitudes_and_spectra() -> None:
    sizes = {"hip_yaw": 0.0, "knee_pitch": 0.02}
    shape = replace(SHAPE, amplitude=sizes, spectrum="velocity", omit_one_of=0)
    found = plan(replace(shape, odd=False)).trajectory
    q = found.sample(np.linspace(0, 10, 5001))[0]
    reach = np.abs(q - found.coefficients[0]).max(axis=0)
    assert reach[0] == 0.0
    assert 0.019 < reach[3] <= 0.02
    assert reach[4] > 0.02
    lines = amplitudes(found)[:, 3]
    assert lines[100] / lines[4] == pytest.approx(4 / 100, rel=1e-6)


@pytest.mark.parametrize(
    ("shape", "limits", "says"),
    [
        ({"amplitude": 3.0}, LIMITS, r"'hip_roll': the multisine breaks its position limit"),
        (
            {"amplitude": {"knee_pitch": 0.5}},
            Limits(acceleration=400, velocity={"knee_pitch": 1.0}),
            r"'knee_pitch': the multisine breaks its velocity limit: [\d.]+, allowed 1; give an",
        ),
        ({"amplitude": 0.3}, Limits(), "breaks its acceleration limit"),
        ({"amplitude": 0.3}, Limits(acceleration=900), "breaks its joint torque limit"),
        ({"amplitude": 0.0}, LIMITS, "moves no joint"),
        ({"posture": {"knee_pitch": 2.0}}, LIMITS, "'knee_pitch': the posture 2 of"),
        ({"period_s": 3.0}, LIMITS, "not a whole number of periods of 3 s: give 9 s"),
        ({"period_s": 30.0}, LIMITS, "at most the duration, 10 s, found 30"),
        ({"band_hz": (5.0, 5.1)}, LIMITS, "the band 5 to 5.1 Hz has 1 frequency of"),
        ({"band_hz": (1.0, 300.0)}, LIMITS, "at most 400 are allowed"),
        ({}, Limits(joint_torque=1e-6), "torque"),
    ],
)
def test_a_multisine_that_breaks_a_limit_is_refused_by_name(
    shape: dict[str, Any], limits: Limits, says: str
) -> None:
    with pytest.raises(seaid.errors.ExcitationError, match=says):
        plan(replace(SHAPE, **shape), limits=limits)


def test_wrong_shapes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(seaid.errors.ExcitationError, match="realisation must be a whole number"):
        Multisine(realisation=-1)
    with pytest.raises(seaid.errors.ExcitationError, match="no spectrum is named 'white'"):
        Multisine(spectrum="white")  # type: ignore[arg-type]
    with pytest.raises(seaid.errors.ExcitationError, match="multisine= needs basis='multisine'"):
        seaid.design_excitation(chain(tmp_path, "arm"), 5.0, multisine=SHAPE)
