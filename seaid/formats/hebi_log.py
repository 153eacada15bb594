"""HEBI logs (.hebilog), read with HEBI's own package (`pip install 'seaid[hebi]'`)."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from seaid.errors import LogError
from seaid.formats.table import Block, Table, optional, part_of

_FIELDS = (
    *("position", "velocity", "effort", "deflection", "deflection_velocity"),
    *("motor_position", "motor_velocity", "motor_current", "motor_winding_current"),
    *("motor_winding_voltage", "motor_winding_temperature", "pwm_command", "voltage"),
    *("position_command", "velocity_command", "effort_command"),
)
_CLOCKS = {"time": "receive_time_us", "transmit_time": "hardware_transmit_time_us"}
"""Our time columns [s]: arrival at the computer, and the module's own clock, both from zero on."""


def open_hebilog(path: Path) -> Table:
    """Return the columns of a HEBI log: HEBI's field and module, as "motor_position[0]".

    `time[k]` is when the sample of module k arrived, `transmit_time[k]` the module's own clock [s].
    Raises LogError for what is no such file, and where hebi-py is not installed.
    """
    with contextlib.redirect_stdout(io.StringIO()):  # it prints what it would like to have beside
        optional("hebi", "hebi", path)
        util = optional("hebi.util", "hebi", path)
    modules = _opened(util, path).number_of_modules
    names = [f"{field}[{k}]" for k in range(modules) for field in (*_CLOCKS, *_FIELDS)]
    clocks = {f"{field}[{k}]": f"time[{k}]" for k in range(modules) for field in _FIELDS}
    return Table(names, lambda wanted: _load(util, path, wanted), clocks=clocks)


def _opened(util: Any, path: Path) -> Any:
    try:
        return util.load_log(str(path), load=False)
    except (OSError, RuntimeError) as problem:
        reason = str(problem).replace(str(path), "it")
        raise LogError(f"'{path}' is not a HEBI log, or a damaged one: {reason}") from None


def _load(util: Any, path: Path, wanted: list[str]) -> Block:
    places = {name: part_of(name) for name in wanted}
    fields = {base: _CLOCKS.get(base, base) for base, _ in places.values()}
    rows: dict[str, list[Any]] = {base: [] for base in fields}
    try:
        for feedback in _feedback(_opened(util, path)):
            for base, field in fields.items():
                rows[base].append(np.array(getattr(feedback, field)))
    except RuntimeError as problem:
        raise LogError(f"'{path}' is a damaged HEBI log: {problem}") from None
    found: Block = {}
    for name, (base, module) in places.items():
        values = np.array(rows[base])
        if base in _CLOCKS:
            first = values[0].min() if base == "time" else values[0, module]
            values = (values.astype(np.int64) - np.int64(first)) * 1e-6
        found[name] = values[:, module].astype(np.float64)
    return found


def _feedback(log: Any) -> Iterator[Any]:
    yield from log.feedback_iterate
