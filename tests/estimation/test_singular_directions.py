"""The scaled singular value decomposition."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from seaid.errors import IdentificationError
from seaid.estimation import scaled_svd


def test_a_decomposition_that_does_not_converge_is_repeated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Divide and conquer did not converge for the columns of a Go2, QR iterations did."""
    columns = np.random.default_rng(3).normal(size=(30, 4)) * [1.0, 1e3, 1e-3, 0.0]
    y, tried = columns @ [1.0, 2.0, 3.0, 0.0], []
    expected = scaled_svd(columns).solve(y, 1e-9)

    def fails(matrix: Any, **options: Any) -> Any:
        tried.append(matrix.shape)
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", fails)
    np.testing.assert_allclose(scaled_svd(columns).solve(y, 1e-9), expected, rtol=1e-9)
    assert tried == [columns.shape]
    with pytest.raises(IdentificationError, match="it cannot be solved: 3 numbers"):
        scaled_svd(np.diag([np.nan, 1.0, 1.0]), "it")
