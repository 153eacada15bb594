"""Estimates over the pass band: flat where the model is right, and not where noise is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from seaid.errors import IdentificationError
from seaid.identification.identification import CutoffSensitivity, cutoff_sensitivity, identify
from seaid.identification.result import Identification
from seaid.log.reading import Log
from seaid.simulation.simulation import measure
from tests.experiments import ARM_SENSORS, arm, arm_motion, with_named_friction

KNOWN = with_named_friction(arm().without_nominal())


@cache
def log(steps: int = 2**17) -> Log:
    sensors = replace(ARM_SENSORS, joint_resolution_rad=2 * np.pi / steps)
    return measure(arm(), arm_motion(), sensors, 0)


@cache
def scanned(steps: int = 2**17) -> CutoffSensitivity:
    return cutoff_sensitivity(KNOWN, log(steps), [3.0, 6.0, 300.0, 700.0])


def test_a_band_that_tells_other_parameters_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = identify(KNOWN, log())
    fewer = replace(plain, drive_side=dict(list(plain.drives.items())[1:]))

    def identified(
        *_: object, cutoff_hz: float | None = None, method: str = "auto"
    ) -> Identification:
        assert method == ("auto" if cutoff_hz is None else plain.method)
        return plain if cutoff_hz is None else fewer

    monkeypatch.setattr("seaid.identification.identification.identify", identified)
    result = cutoff_sensitivity(KNOWN, log(), [6.0])
    assert "other parameters are ident" in result.refused[6.0]
    assert np.all(np.isnan(result.values[result.cutoffs_hz == 6.0]))


@pytest.mark.slow  # 2.0 s
def test_rows_are_those_of_identify_and_the_proposed_band_is_among_them() -> None:
    result = scanned()
    plain, six = identify(KNOWN, log()), identify(KNOWN, log(), cutoff_hz=6.0)
    assert result.cutoffs_hz.tolist() == sorted([3.0, 6.0, 300.0, 700.0, plain.cutoff_hz])
    assert result.cutoffs_hz[result.proposed] == plain.cutoff_hz
    for cutoff, found in ((plain.cutoff_hz, plain), (6.0, six)):
        row = result.cutoffs_hz.tolist().index(cutoff)
        for joint in KNOWN.elastic_joints:
            estimate = found.drives[joint]
            place = result.names.index(f"stiffness of {joint}")
            assert result.values[row, place] == estimate.value("stiffness")
            assert result.standard_errors[row, place] == estimate.standard_error("stiffness")
        count = len(found.load.values)
        assert np.array_equal(result.values[row, -count:], found.load.values)
    assert len(result.units) == len(result.names)


@pytest.mark.slow  # 1.7 s
def test_band_that_cannot_be_is_told_and_does_not_stop_the_others() -> None:
    result = scanned()
    assert list(result.refused) == [700.0]
    assert np.all(np.isnan(result.values[-1]))
    assert "cutoff_hz must be between 0 and half the sampling rate" in result.refused[700.0]
    assert "! 700 Hz: cutoff_hz must be" in str(result)


def test_moves_are_the_largest_shift_between_half_and_twice_the_proposed_band() -> None:
    result = CutoffSensitivity(
        cutoffs_hz=np.array([1.0, 2.0, 4.0, 8.0, 12.0]),
        names=("a", "b"),
        units=("kg", "m"),
        values=np.array([[9.0, 9.0], [1.0, 1.0], [2.0, 1.5], [2.5, 1.5], [9.0, 9.0]]),
        standard_errors=np.full((5, 2), 0.5),
        proposed=2,
        refused={},
    )
    assert result.moves == pytest.approx([2.0, 1.0])
    text = str(result)
    assert "[4 Hz]" in text
    assert "2.0 s.e." in text


@pytest.mark.slow  # an identification for each of many cutoffs
def test_coarse_encoder_shows_in_the_estimates_of_wide_bands() -> None:
    coarse = cutoff_sensitivity(KNOWN, log(2**9), [20.0])
    fine = cutoff_sensitivity(KNOWN, log(), [20.0])
    shifts = [
        np.max(np.abs(one.values[-1] - one.values[one.proposed])[-14:] / fine_errors)
        for fine_errors in [fine.standard_errors[fine.proposed, -14:]]
        for one in (coarse, fine)
    ]
    assert shifts[0] > 5 * shifts[1]


@pytest.mark.slow  # an identification for each of many cutoffs
def test_default_cutoffs_go_from_a_third_to_three_times(tmp_path: Path) -> None:
    result = cutoff_sensitivity(KNOWN, log())
    proposed = result.cutoffs_hz[result.proposed]
    assert result.cutoffs_hz[[0, -1]] == pytest.approx([proposed / 3, 3 * proposed])
    result.save_figure(tmp_path / "bands.png")
    assert (tmp_path / "bands.png").stat().st_size > 20_000


@pytest.mark.parametrize("cutoff", [0.0, -1.0, np.nan, np.inf])
def test_cutoffs_must_be_positive(cutoff: float) -> None:
    with pytest.raises(IdentificationError, match="cutoffs_hz must be more than 0 and finite"):
        cutoff_sensitivity(KNOWN, log(), [cutoff])


def test_cutoff_hz_is_what_varies() -> None:
    with pytest.raises(IdentificationError, match="give cutoffs_hz instead"):
        cutoff_sensitivity(KNOWN, log(), cutoff_hz=4.0)
