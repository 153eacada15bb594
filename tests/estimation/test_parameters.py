"""Parameters that several fits share, by constraints of their estimates."""

import numpy as np
import pytest

from seaid.drives import ParameterName
from seaid.estimation import Estimate
from seaid.estimation.parameters import Constraints


def with_one_value(variances: tuple[float, ...], freedom: tuple[float, ...]) -> Estimate:
    """Return estimates of one parameter by separate fits, under the constraint that it is one."""
    p = len(variances)
    covariance = np.diag(variances)
    free = Estimate(
        names=tuple(ParameterName("stiffness", x) for x in "abc"[:p]),
        values=np.arange(1.0, p + 1),
        covariance=covariance,
        units=("N m/rad",) * p,
        residual_std=1.0,
        condition_number=1.0,
        degrees_of_freedom=np.array(freedom),
    )
    return Constraints.of(p, [range(p)]).applied(free, np.eye(p))


@pytest.mark.parametrize(
    ("variances", "freedom", "least", "most"),
    [
        ((1.0, 0.01), (5.0, 1000.0), 5.0, 5.2),  # 5.1 by Welch and Satterthwaite
        ((0.01, 1.0), (5.0, 1000.0), 500.0, 1000.0),
        ((1.0, 1.0), (8.0, 8.0), 8.0, 16.0),
        ((1.0, 1.0, 1.0), (np.inf, np.inf, np.inf), np.inf, np.inf),
        ((0.0, 0.0), (5.0, 5.0), np.inf, np.inf),
    ],
)
def test_a_shared_parameter_has_the_degrees_of_freedom_of_what_its_variance_is_made_of(
    variances: tuple[float, ...], freedom: tuple[float, ...], least: float, most: float
) -> None:
    """The mean has equal weights; a fit with a small part of its variance lends it no freedom."""
    shared = with_one_value(variances, freedom).degrees_of_freedom
    assert shared is not None
    assert np.all((least * (1 - 1e-9) <= shared) & (shared <= most * (1 + 1e-9)))
