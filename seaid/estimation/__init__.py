"""Estimation: linear equations become parameters with standard errors.

A `Regression` comes in; an `Estimate` goes out: values, covariance, standard errors that allow for
autocorrelated residuals, the condition number, and flags for poorly determined values.

- `parameters`: the parameters of a problem as data, with priors and bounds;
- `fitting`: estimators by name; `least_squares` has the ordinary and weighted ones, `robust` those
  of Huber and Tukey;
- `instrumental_variables`, `nonlinear_least_squares`: for noisy columns and for
  equations nonlinear in the parameters;
- `qr_factor`: the R factors of rows, which add up, so that logs may be longer than memory;
- `sdp`: semidefinite programs for physically consistent inertial parameters.

Nothing here depends on a robot model but the pseudo-inertia of a body.

>>> from seaid.estimation import estimator_named
>>> estimate = estimator_named("wls").solve(rows, None)  # rows: a Regression
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
