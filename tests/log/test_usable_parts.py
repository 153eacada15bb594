"""What of a log is used: not the rest at its ends, nor frozen channels, nor rows over gaps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid._arrays import Array
from seaid.checks.channels import excluded_findings
from seaid.errors import LogError
from seaid.log import Log, Motion, reconstruct_motion, row_samples
from seaid.log.motion import reconstruct_motions
from seaid.log.usable_parts import FROZEN, REST, REST_S, holes, usable
from seaid.simulation import Noise
from seaid.simulation.simulation import measure
from tests.experiments import LEG_SENSORS, leg, leg_motion
from tests.mistakes import with_channels

TIME = np.arange(6000) / 1000


def with_rest(motion: Motion, before_s: float, after_s: float) -> tuple[Motion, float, float]:
    """Return a true motion with rest before and after it, and its start and end [s]."""
    counts = [round(one * motion.rate_hz) for one in (before_s, after_s)]
    parts: dict[str, Any] = {
        name: np.pad(values, (counts, (0, 0)), mode="edge")
        for name, values in vars(motion).items()
        if np.ndim(values) == 2 and name != "fastest"
    }
    time = np.arange(len(parts["motor_position"])) / motion.rate_hz
    return replace(motion, time=time, **parts), before_s, float(time[-1]) - after_s


def frozen_at(values: Array, start: int, end: int) -> Array:
    values = values.copy()
    values[start:end] = values[start]
    return values


def log_of(*columns: Array, torque: Array | None = None) -> Log:
    """Return a log of joints with one encoder each."""
    positions = np.column_stack(columns)
    nothing = np.full_like(positions, np.nan)
    torques = nothing if torque is None else np.column_stack([torque] * len(columns))
    return Log(TIME, tuple("abc"[: len(columns)]), nothing, positions, torques)


def wave(hz: float = 0.7, size: float = 1.0) -> Array:
    return np.asarray(size * np.sin(2 * np.pi * hz * TIME))


def white(seed: int, size: float) -> Array:
    return np.random.default_rng(seed).normal(0.0, size, len(TIME))


# Rest at the ends


@pytest.mark.parametrize("sensors", [LEG_SENSORS, Noise()])
def test_rest_before_and_after_a_motion_is_cut(sensors: Noise) -> None:
    motion, start_s, end_s = with_rest(leg_motion(), 3.0, 4.0)
    log = measure(leg(), motion, sensors, seed=2)
    part = usable(log)
    assert start_s - REST_S - 0.06 < part.time[0] < start_s + 0.1
    assert end_s - 0.1 < part.time[-1] < end_s + REST_S + 0.06
    (repair,) = part.report
    assert (repair.kind, repair.count) == (REST, len(log.time) - len(part.time))
    assert usable(part) is part


def test_cutoff_is_that_of_the_motion_and_the_processing_says_what_was_cut() -> None:
    motion, start_s, end_s = with_rest(leg_motion(), 20.0, 4.0)
    log = measure(leg(), motion, LEG_SENSORS, seed=2)
    found = reconstruct_motion(leg(), log)
    expected = reconstruct_motion(leg(), log.between(start_s, end_s))
    assert found.cutoff_hz == pytest.approx(expected.cutoff_hz, rel=0.05)
    assert found.processing is not None
    assert "rest at the ends: 19." in str(found.processing)
    (warning,) = excluded_findings([found.processing])
    assert (warning.code, warning.severity) == ("standstill", "note")
    slow = reconstruct_motion(leg(), log, 0.8)  # ten periods of the cutoff remain
    assert slow.time[-1] - slow.time[0] == pytest.approx(12.5, abs=0.2)


MOVING = np.maximum((TIME - 0.35) * (5.65 - TIME), 0.0) ** 2
FIRST, LAST = np.where(TIME < 2.0, wave(0.5), 0.0), np.where(TIME > 4.0, wave(0.5), 0.0)


@pytest.mark.parametrize(
    "log",
    [
        log_of(FIRST + white(0, 1e-4), LAST + white(1, 1e-4), white(2, 1e-4)),  # and a pause
        log_of(MOVING),  # short rest
        log_of(np.zeros_like(TIME), white(0, 1e-3)),  # nothing moves
        measure(leg(), leg_motion(), LEG_SENSORS, 0),
    ],
)
def test_what_is_no_rest_at_the_ends_stays(log: Log) -> None:
    assert usable(log) is log


def test_a_robot_that_stands_while_its_torque_changes_is_not_at_rest() -> None:
    moving = np.where((TIME > 2.0) & (TIME < 4.0), 1.0 - np.cos(2 * np.pi * TIME), 0.0)
    noise = white(0, 0.01)
    assert usable(log_of(moving, torque=moving + noise)).time[0] > 1.0
    log = log_of(moving, torque=moving + noise + 0.8 * TIME)
    assert usable(log) is log


def test_rest_of_a_coarse_encoder_that_toggles_is_rest() -> None:
    step = 2 * np.pi / 512
    moving = np.where((TIME > 2.0) & (TIME < 4.0), wave(1.0), 0.0)
    log = usable(log_of(np.round((moving + 0.5 * step + white(0, 0.1 * step)) / step) * step))
    assert log.time[0] == pytest.approx(2.0 - REST_S, abs=0.02)
    assert log.time[-1] == pytest.approx(4.0 + REST_S, abs=0.02)


# Frozen channels


@pytest.mark.parametrize("field", ["motor_position", "joint_position", "motor_torque"])
@pytest.mark.parametrize(("start", "end"), [(2000, 2300), (4800, 6001)])
def test_a_frozen_channel_is_excluded_and_said(field: str, start: int, end: int) -> None:
    plain = measure(leg(), leg_motion(), LEG_SENSORS, seed=1)
    log = with_channels(plain, "knee_pitch", **{field: lambda x: frozen_at(x, start, end)})
    part = usable(log)
    kept = np.isin(plain.time, part.time)
    assert not np.any(kept[start + 1 : end])
    assert np.sum(~kept) == pytest.approx(end - start - 1, abs=2)
    (repair,) = part.report
    assert repair.kind == FROZEN
    assert repair.channel.startswith(f"knee_pitch.{field}")
    if end - start == 300:
        motions = reconstruct_motions(leg(), log, 8.0)
        assert motions[0].processing is not None
        kinds = [one.code for one in excluded_findings([motions[0].processing])]
        assert kinds == ["holes", "holes"]
        with pytest.raises(LogError, match="holes in time"):
            reconstruct_motion(leg(), log, 8.0)


@pytest.mark.parametrize(
    ("position", "torque"),
    [
        (np.round(wave() / 0.05) * 0.05, white(0, 1.0)),  # a coarse encoder
        (wave()[TIME.searchsorted(np.floor(TIME * 5) / 5)], white(0, 1.0)),  # five samples a second
        (np.where(np.abs(TIME - 3) < 0.5, 0.0, wave(1.0)), white(0, 1.0)),  # a pause
        (wave(), np.clip(wave(1.0, 3.0) + white(0, 0.1), -1.0, 1.0)),  # saturated
        (wave(), np.where(np.abs(TIME - 3) < 0.5, 0.0, white(0, 1.0))),  # the motor is off
        (wave(), np.round(white(0, 1.0) + 3 * np.floor(TIME)) // 4),  # a coarse torque
        (wave(), np.floor(TIME) * 0.3),  # steps of a command
    ],
)
def test_what_is_not_frozen_stays(position: Array, torque: Array) -> None:
    log = log_of(position, wave(0.9), torque=torque)
    assert usable(log) is log


def test_a_frozen_channel_is_refused_where_nothing_can_be_excluded(tmp_path: Path) -> None:
    """Most of a log, and a part of one that is read in pieces, are not left out."""
    log = log_of(frozen_at(wave(), 1000, 5500))
    with pytest.raises(LogError, match=r"frozen in 75% of its samples, allowed 50%; a\.joint_posi"):
        usable(log)
    plain = measure(leg(), leg_motion(), LEG_SENSORS, seed=1)
    frozen = with_channels(plain, "knee_pitch", joint_position=lambda x: frozen_at(x, 2000, 2300))
    seaid.write_log(frozen, tmp_path / "log.npz")
    with pytest.raises(LogError, match=r"repeated for up to 0\.298 s; excluded; a log that"):
        seaid.open_long_log(tmp_path / "log.npz", leg(), cutoff_hz=6.0)


# Rows over gaps


@pytest.mark.parametrize(("gap_s", "excluded"), [(0.01, False), (0.09, True)])
def test_rows_over_a_bridged_gap_are_excluded(gap_s: float, excluded: bool) -> None:
    plain = measure(leg(), leg_motion(), LEG_SENSORS, seed=1)
    kept = (plain.time <= 2.0) | (plain.time >= 2.0 + gap_s)
    motion = reconstruct_motion(leg(), plain.at(kept), 4.0)
    assert not len(holes(plain.time[kept]))
    assert motion.bridged is not None
    rows = motion.time[row_samples(motion)]
    near = np.min(np.abs(rows - (2.0 + gap_s / 2)))
    assert (near > 1 / (4 * 4.0)) == excluded
    whole = row_samples(reconstruct_motion(leg(), plain, 4.0))
    assert len(rows) == pytest.approx(len(whole), abs=4)


# Temperatures


def test_a_temperature_that_steps_and_drifts_decides_nothing_of_what_is_used(
    tmp_path: Path,
) -> None:
    motion, _, _ = with_rest(leg_motion(), 3.0, 2.0)
    log = measure(leg(), motion, LEG_SENSORS, seed=1)
    warmth = np.round(30.0 + 0.4 * log.time)[:, None] * np.ones(leg().n)  # a step in 2.5 s
    warm = replace(log, motor_temperature=warmth)
    np.testing.assert_array_equal(usable(warm).time, usable(log).time)
    seaid.write_log(warm, tmp_path / "log.csv")
    back = seaid.read_log(tmp_path / "log.csv", leg(), repair=seaid.Repairs())
    assert len(back.time) == len(log.time)
    assert not len(holes(back.time))
    motion = reconstruct_motion(leg(), back)
    assert motion.motor_temperature is not None
    assert np.all(np.isfinite(motion.motor_temperature))
    inside = np.searchsorted(back.time, motion.time)
    assert np.max(np.abs(motion.motor_temperature - warmth[inside])) < 1.1
