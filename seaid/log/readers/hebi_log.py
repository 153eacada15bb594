"""HEBI logs (.hebilog), read with HEBI's own package (`pip install 'seaid[hebi]'`).

HEBI's library aborts the process on some damaged files, so it runs in a child process.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from seaid.log.readers.child_process import read_in_child
from seaid.log.readers.table import Table, check_installed, held

_FIELDS = (
    *("position", "velocity", "effort", "deflection", "deflection_velocity"),
    *("motor_position", "motor_velocity", "motor_current", "motor_winding_current"),
    *("motor_winding_voltage", "motor_winding_temperature", "pwm_command", "voltage"),
    *("position_command", "velocity_command", "effort_command"),
)
_CLOCKS = {"time": "receive_time_us", "transmit_time": "hardware_transmit_time_us"}
"""Time columns [s]: arrival at the computer, and the clock of the module, both from zero on."""


def open_hebilog(path: Path) -> Table:
    """Return the columns of a HEBI log: HEBI's field and module, as "motor_position[0]".

    `time[k]` is the arrival of the sample of module k, `transmit_time[k]` the clock of the module
    [s]. Raises LogError for an invalid file, and if hebi-py is not installed.
    """
    check_installed("hebi", "hebi", path)
    arrays = read_in_child(read_fields, path, "a HEBI log", 2e5)
    modules = range(arrays["time"].shape[1])
    clocks = {f"{field}[{k}]": f"time[{k}]" for k in modules for field in _FIELDS}
    return replace(held(path, arrays), clocks=clocks)


def read_fields(path: str) -> dict[str, Any]:
    """Return all fields (T, modules) of a log; runs in the child."""
    from hebi import util

    log: Any = util.load_log(path, load=False)
    kinds = dict.fromkeys(_FIELDS, np.float64) | dict.fromkeys(_CLOCKS.values(), np.int64)
    data = {field: bytearray() for field in kinds}
    for feedback in _samples(log):
        for field, kind in kinds.items():
            # Copied at once, because the arrays of the object change with the next sample.
            data[field] += np.asarray(getattr(feedback, field)).astype(kind).tobytes()
    shape = -1, int(log.number_of_modules)
    arrays = {x: np.frombuffer(data[x], dtype=kind).reshape(shape) for x, kind in kinds.items()}
    time, transmitted = (arrays.pop(field) for field in _CLOCKS.values())
    # The computer's clock is common to all modules, so that their offsets stay; each module has a
    # clock of its own, whose zero means nothing.
    seconds = {"time": time - time[0].min(), "transmit_time": transmitted - transmitted[0]}
    return {name: 1e-6 * values for name, values in seconds.items()} | arrays


def _samples(log: Any) -> Iterator[Any]:
    """Yield the samples of a log, from the second on as HEBI's own iterator does.

    That makes an object of 13 arrays per sample; one object for all halves the time.
    """
    samples = log.feedback_iterate
    following = getattr(log, "_get_next_feedback", lambda _: next(samples))
    feedback = next(samples, None)
    while feedback is not None:
        yield feedback
        try:
            feedback = following(feedback)
        except StopIteration:
            return
