"""Fits in turn as one estimate: errors that several values have in common are correlated."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives.terms import ParameterName
from seaid.estimation.estimate import Estimate
from seaid.identification.stacked_fits import FitsInTurn
from tests.experiments import leg

JOINTS = ("hip_pitch", "knee_pitch")
SPRING = ("stiffness", "spring_offset")
UNIT, OF_UNIT = np.array([[80.0, 3.0], [60.0, -2.0]]), np.diag([0.5, 0.1])
CONSTANTS, OF_CONSTANTS = np.array([2.0, 3.0]), np.array([[4e-4, 3e-4], [3e-4, 9e-4]])


def fitted(names: tuple[str, ...], values: Array, covariance: Array) -> Any:
    """Return a fit with an estimate, which the propagated springs do not move."""
    estimate = Estimate(names, values, covariance, ("",) * len(names), 0.1, 1.0)
    return SimpleNamespace(estimate=estimate, sensitivity=np.zeros((len(names), 4)))


def test_springs_that_one_load_scales_share_the_errors_of_their_constants() -> None:
    """k = K k_1 for a constant K by the load: cov(k, k') = k_1 k_1' cov(K, K')."""
    names = tuple(ParameterName("torque_constant", joint) for joint in JOINTS)
    motors = {joint: fitted(SPRING, x, OF_UNIT) for joint, x in zip(JOINTS, UNIT, strict=True)}
    scales = fitted(names, CONSTANTS, OF_CONSTANTS)
    constants = dict(zip(JOINTS, names, strict=True))
    drives = FitsInTurn(leg(), motors, JOINTS, constants, by_load=scales).drives
    found = drives.of_names([ParameterName("stiffness", joint) for joint in JOINTS])
    assert found.values == pytest.approx(CONSTANTS * UNIT[:, 0])
    shared = np.outer(UNIT[:, 0], UNIT[:, 0]) * OF_CONSTANTS
    assert found.covariance == pytest.approx(shared + np.diag(CONSTANTS**2 * OF_UNIT[0, 0]))
