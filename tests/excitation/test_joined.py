from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import ExcitationError
from seaid.excitation import Trajectory, load_trajectory, make_basis
from seaid.excitation.basis import JoinedBasis

PARTS = (make_basis("bspline", 1.3, 8), make_basis("fourier", 2.0, 7))
JOINED = JoinedBasis((*PARTS, make_basis("polynomial", 0.1, 6)))


def coefficients(seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(size=(JOINED.size, 2))


def test_each_part_keeps_its_interval_and_its_coefficients() -> None:
    assert (JOINED.size, JOINED.starts) == (21, (0.0, 1.3, 3.3, 3.4))
    assert JOINED.duration == 3.4
    c = coefficients()
    for part, first, start in zip(JOINED.parts, (0, 8, 15), JOINED.starts, strict=False):
        local = np.linspace(0.0, part.duration, 9)[:-1] + 1e-12
        alone = part.states(local, c[first : first + part.size])
        for one, other in zip(JOINED.states(local + start, c), alone, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-8)


def test_states_are_the_matrices_times_coefficients_in_any_order_of_times() -> None:
    time = np.random.default_rng(1).permutation(np.linspace(0.0, 3.4, 101))
    c = coefficients()
    for states, matrix in zip(JOINED.states(time, c), JOINED.matrices(time), strict=True):
        np.testing.assert_allclose(states, matrix @ c, rtol=1e-12, atol=1e-9)


def test_where_parts_meet_the_later_counts() -> None:
    c = coefficients()
    at_joint = JOINED.states(np.array([1.3]), c)
    start = PARTS[1].states(np.array([0.0]), c[8:15])
    for one, other in zip(at_joint, start, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_hull_constant_and_natural_are_those_of_the_parts(order: int) -> None:
    c = coefficients(2)
    curve = JOINED.states(np.linspace(0.0, 3.4, 20001), c)[order]
    most = np.abs(JOINED.hull(order, 4) @ c).max(axis=0)
    assert np.all(np.abs(curve).max(axis=0) <= most * (1 + 1e-12))
    one = JOINED.matrices(np.linspace(0.0, 3.4, 11))[order] @ JOINED.constant
    np.testing.assert_allclose(one, 1.0 if order == 0 else 0.0, atol=1e-9)
    np.testing.assert_array_equal(JOINED.scaling[8:15, 8:15], PARTS[1].scaling)
    assert np.count_nonzero(JOINED.scaling) == JOINED.size


def test_files_keep_it_exactly(tmp_path: Path) -> None:
    motion = Trajectory(("a", "b"), JOINED, coefficients(), ("b",), (1.3, 3.3))
    motion.save(tmp_path / "motion.json")
    loaded = load_trajectory(tmp_path / "motion.json")
    assert loaded.main_interval == (1.3, 3.3)
    time = np.linspace(0.0, 3.4, 1001)
    for one, other in zip(motion.sample(time), loaded.sample(time), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_joined_basis_has_parts() -> None:
    with pytest.raises(ExcitationError, match="at least one part"):
        JoinedBasis(())
