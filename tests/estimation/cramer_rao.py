"""The least covariance that an unbiased estimate of output errors can have."""

from collections.abc import Sequence

import numpy as np

from seaid._arrays import Array
from seaid.estimation.nonlinear_least_squares import Residuals, _projected, _solve
from seaid.estimation.parameters import Parameter, priors_of


def fisher_covariance(
    logs: Sequence[Residuals], parameters: Sequence[Parameter], stds: Array
) -> Array:
    """Return the Cramer-Rao bound (p, p) of the covariance, for white noise of `stds` (C,)."""
    J = np.vstack([_projected(logs, stds)[0], np.diag(1 / priors_of(parameters)[1])])
    return _solve(J, np.zeros(len(J)), [parameter.name for parameter in parameters])[1]
