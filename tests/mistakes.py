"""Set-ups with mistakes: logs with a changed channel, what is found first, and its repair."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

import seaid
from seaid._arrays import Array
from seaid.errors import Finding
from seaid.log.log import Log
from seaid.log.repair.channels import unwrapped
from seaid.robot.robot import Robot
from tests.experiments import TEST_MASS, arm, arm_log, leg, leg_log

CASES: dict[str, tuple[Callable[[], Robot], Callable[..., Log]]] = {
    "leg": (lambda: leg(TEST_MASS), leg_log),
    "arm": (arm, arm_log),
}


def changed(log: Log, factors: Mapping[str, Array | float]) -> Log:
    found: dict[str, Any] = {name: getattr(log, name) * by for name, by in factors.items()}
    return replace(log, **found)


def of_joint(log: Log, j: int, **factors: float) -> Log:
    """Return the log with channels of joint j multiplied by factors."""
    own = np.arange(len(log.joint_names)) == j
    return changed(log, {name: np.where(own, by, 1.0) for name, by in factors.items()})


def worst(robot: Robot, *logs: Log) -> Finding:
    warnings = seaid.check(robot, list(logs)).warnings
    assert warnings
    return warnings[0]


def described(log: Log, remedy: str, number: int = 0) -> Log:
    """Return the log as a description reads it, applied without a file."""
    first, text = remedy.split("\n", 1)
    assert first == f"in the description of {f'log {number}' if number else 'the log'}:"
    columns = log.columns()
    found: dict[str, Any] = {name: x.copy() for name, x in log.sensors().items()}
    for joint, entries in tomllib.loads(text)["joints"].items():
        for quantity, source in entries.items():
            factor = source.get("sign", 1) * source.get("scale", 1.0)
            column = columns[source["column"]]
            if "wraps" in source:
                column = unwrapped(quantity, log.time, column, source["wraps"])[0]
            values = factor * column + source.get("offset", 0.0)
            found[quantity][:, log.joint_names.index(joint)] = values
    return replace(log, **found)
