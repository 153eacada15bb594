"""Estimation: linear equations become parameters with standard errors.

A `Regression` comes in; an `Estimate` goes out: values, covariance, standard errors that allow for
autocorrelated residuals, the condition number, and flags where a value is poorly determined.

- `estimators`: ordinary, weighted, Huber and Tukey least squares;
- `instrumental_variables`, `variable_projection`, `gauss_newton`: where columns are noisy or
  equations nonlinear in the parameters;
- `qr_factor`: the R factors of rows, which add up, so that logs may be longer than memory;
- `sdp`: semidefinite programs for physically consistent inertial parameters.

Nothing here knows what a robot is.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
