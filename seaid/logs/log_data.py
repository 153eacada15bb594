"""Log: what the sensors of a robot said."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seaid.arrays import Array, frozen
from seaid.errors import LogError
from seaid.logs.log_columns import SENSORS, column_names
from seaid.logs.repair import Repair

MINIMUM_SAMPLES = 50

LARGEST = 1e15
"""In SI units no sensor says more; powers of what is beyond soon leave the floating-point range."""


@dataclass(frozen=True, eq=False)
class Log:
    """Samples of n joints at `time` (T,) [s], each array (T, n); NaN columns where no sensor is.

    Motor side in rad and N m. Joint side in rad and N m, at prismatic joints m and N. Motor current
    [A] or voltage [V] where the torque constant is not known. `report`: what was found in the file
    and mended. Raises LogError for wrong shapes, too few samples, time that does not grow, single
    NaN, absurdly large values.
    """

    time: Array
    joint_names: tuple[str, ...]
    motor_position: Array
    joint_position: Array
    motor_torque: Array
    joint_torque: Array | None = None
    is_prismatic: tuple[bool, ...] = ()
    motor_current: Array | None = None
    motor_voltage: Array | None = None
    report: tuple[Repair, ...] = ()

    def __post_init__(self) -> None:
        shape = (len(np.atleast_1d(self.time)), len(self.joint_names))
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        if len(set(self.joint_names)) < shape[1]:
            raise LogError(f"joint_names has a joint twice: {', '.join(self.joint_names)}")
        object.__setattr__(self, "time", frozen("time", self.time, (None,), LogError))
        for field, value in self.sensors().items():
            object.__setattr__(self, field, frozen(field, value, shape, LogError))
        if not self.is_prismatic:
            object.__setattr__(self, "is_prismatic", (False,) * shape[1])
        if len(self.is_prismatic) != shape[1]:
            raise LogError(
                f"is_prismatic needs one entry a joint, {shape[1]}, found {len(self.is_prismatic)}"
            )
        _check_time(self.time)
        for name, column in self.columns().items():
            _check_column(name, column, self.time)

    def sensors(self) -> dict[str, Array]:
        """Return {field: samples (T, n)} of all fields that are there."""
        found = {field: getattr(self, field) for field in SENSORS}
        return {field: values for field, values in found.items() if values is not None}

    def between(self, start_s: float, end_s: float) -> Log:
        """Return the samples with start_s <= time < end_s."""
        kept = (self.time >= start_s) & (self.time < end_s)
        parts: dict[str, Any] = {field: values[kept] for field, values in self.sensors().items()}
        return replace(self, time=self.time[kept], **parts)

    def columns(self) -> dict[str, Array]:
        """Return {file column name: samples} of all sensors that are there."""
        found = {}
        for index, joint in enumerate(self.joint_names):
            for name, field in column_names(joint, self.is_prismatic[index]).items():
                values = getattr(self, field)
                if values is not None and not np.all(np.isnan(values[:, index])):
                    found[name] = values[:, index]
        return found


def _check_time(time: Array) -> None:
    if len(time) < MINIMUM_SAMPLES:
        raise LogError(f"a log needs {MINIMUM_SAMPLES} samples or more, found {len(time)}")
    if not np.all(np.isfinite(time)):
        row = int(np.flatnonzero(~np.isfinite(time))[0])
        raise LogError(f"time_s has a value that is not finite in sample {row}")
    if np.max(np.abs(time)) > LARGEST:
        raise LogError(
            f"time_s goes from {time[0]:.4g} to {time[-1]:.4g} s, allowed is up to {LARGEST:.0e}: "
            "is it in another unit?"
        )
    steps = np.diff(time)
    for word, bad in (("goes backwards", steps < 0), ("repeats", steps == 0)):
        if np.any(bad):
            row = int(np.flatnonzero(bad)[0]) + 1
            raise LogError(
                f"time_s {word} at sample {row} ({time[row - 1]:.9g} s, then {time[row]:.9g} s; "
                f"{int(bad.sum())} such places); it must grow: sort or drop these samples, "
                "or let read_log mend them with repair=seaid.Repairs()"
            )


def _check_column(name: str, column: Array, time: Array) -> None:
    bad = ~np.isfinite(column)
    if np.any(bad):
        row = int(np.flatnonzero(bad)[0])
        raise LogError(
            f"column '{name}' has {int(bad.sum())} values that are not finite, the first in sample "
            f"{row} (t = {time[row]:.6g} s); repair them, or leave the whole column NaN if there "
            "is no such sensor; read_log mends single places with repair=seaid.Repairs()"
        )
    largest = int(np.argmax(np.abs(column)))
    if abs(column[largest]) > LARGEST:
        raise LogError(
            f"column '{name}' has {column[largest]:.4g} in sample {largest} (t = "
            f"{time[largest]:.6g} s), allowed is up to {LARGEST:.0e}: no sensor says that; take "
            "these samples out"
        )
