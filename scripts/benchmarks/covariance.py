"""Coverage of 95 % intervals by several covariances, on synthetic rows with known truth.

The rows resemble those of an identification: a slow regressor, noise as filters shape it, and a few
joints at each instant. Coverage should be 95 %.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from scripts.short_form import few, sized
from seaid._arrays import Array
from seaid.estimation.covariance import (
    bartlett,
    fixed_b,
    left_by_fit,
    left_of_mean,
    long_run,
)
from seaid.report import table

JOINTS, EXPERIMENTS, ROWS_PER_PERIOD = 3, sized(300, 2), 4
METHODS = (
    "white noise",
    "8 lags",
    "Andrews 1991",
    "Newey-West 1994",
    "block bootstrap",
    "block jackknife",
    "1.3 sqrt(T), fixed b",
)


def autoregressive(rng: np.random.Generator, phi: float, shape: tuple[int, int]) -> Array:
    """Return an autoregressive process (T, c) of variance one."""
    noise = rng.normal(size=(shape[0] + 200, shape[1]))
    return np.asarray(lfilter([1.0], [1.0, -phi], noise, axis=0)[200:] * np.sqrt(1 - phi**2))


def behind_low_pass(rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    """Return white noise (T, c) after the zero-phase low-pass filter of a regression, decimated."""
    fine = 8
    white = rng.normal(size=((shape[0] + 100) * fine, shape[1]))
    sections = butter(2, 1.0, fs=ROWS_PER_PERIOD * fine, output="sos")
    filtered = sosfiltfilt(sections, white, axis=0)[50 * fine :: fine][: shape[0]]
    return np.asarray(filtered / filtered.std())


NOISES: dict[str, Callable[[np.random.Generator, tuple[int, int]], Array]] = {
    "white": lambda rng, shape: autoregressive(rng, 0.0, shape),
    "AR 0.5": lambda rng, shape: autoregressive(rng, 0.5, shape),
    "AR 0.8": lambda rng, shape: autoregressive(rng, 0.8, shape),
    "low pass": behind_low_pass,
    "low pass + slow": lambda rng, shape: (
        behind_low_pass(rng, shape) + 0.5 * autoregressive(rng, 0.95, shape)
    ),
}


def andrews(scores: Array) -> int:
    """Return the plug-in bandwidth of Andrews (1991) for Bartlett weights, from AR(1) fits."""
    rho = np.sum(scores[1:] * scores[:-1], axis=0) / np.sum(scores[:-1] ** 2, axis=0)
    rho = np.clip(rho, -0.97, 0.97)
    var = np.sum((scores[1:] - rho * scores[:-1]) ** 2, axis=0) / len(scores)
    weight = 1 / np.sum(scores**2, axis=0) ** 2
    top = np.sum(weight * 4 * rho**2 * var**2 / ((1 - rho) ** 6 * (1 + rho) ** 2))
    alpha = top / np.sum(weight * var**2 / (1 - rho) ** 4)
    return int(1.1447 * (alpha * len(scores)) ** (1 / 3))


def newey_west_1994(scores: Array) -> int:
    """Return the bandwidth of Newey and West (1994) for Bartlett weights."""
    count = len(scores)
    scaled = scores / np.sqrt(np.sum(scores**2, axis=0))
    first = int(4 * (count / 100) ** (2 / 9))
    moments = [np.sum(scaled[lag:] * scaled[: count - lag]) for lag in range(first + 1)]
    zeroth = moments[0] + 2 * sum(moments[1:])
    slope = 2 * sum(lag * moment for lag, moment in enumerate(moments))
    return int(1.1447 * ((slope / zeroth) ** 2 * count) ** (1 / 3))


def blocks(H: Array, residual: Array, length: int) -> tuple[Array, Array]:
    """Return normal matrices (B, p, p) and scores (B, p) of blocks of instants."""
    count = max(len(H) // length, 2)
    parts = [np.array_split(values, count) for values in (H, residual)]
    grams = [np.einsum("tjp,tjq->pq", part, part) for part in parts[0]]
    scores = [np.einsum("tjp,tj->p", part, r) for part, r in zip(*parts, strict=True)]
    return np.array(grams), np.array(scores)


def standard_errors(H: Array, y: Array) -> tuple[Array, dict[str, Array]]:
    """Return the estimate (p,) and its standard errors (p,) by each method; H (T, joints, p)."""
    count, p = y.size, H.shape[2]
    gram = np.einsum("tjp,tjq->pq", H, H)
    inverse = np.linalg.inv(gram)
    theta = inverse @ np.einsum("tjp,tj->p", H, y)
    residual = y - H @ theta
    scores = np.einsum("tjp,tj->tp", H, residual)
    own, freedom = scores @ inverse, count / (count - p)
    plug_in = andrews(own)
    grams, sums = blocks(H, residual, 2 * plug_in + 2)
    shifts = np.linalg.solve(gram - grams + 1e-12 * gram, sums[..., None])[..., 0]
    ours = long_run([[scores]], len(scores))
    meats = {
        "white noise": gram * np.sum(residual**2) / (count - p),
        "8 lags": bartlett([scores], 8)[0] * freedom,
        "Andrews 1991": bartlett([scores], plug_in)[0] * freedom,
        "Newey-West 1994": bartlett([scores], newey_west_1994(own))[0] * freedom,
        "block bootstrap": sums.T @ sums * freedom * len(sums) / (len(sums) - 1),
        "block jackknife": gram @ (shifts.T @ shifts) @ gram * (len(sums) - 1) / len(sums),
    }
    found = {name: np.sqrt(np.diag(inverse @ meat @ inverse)) for name, meat in meats.items()}
    rows, instants = H.reshape(count, p), np.repeat(np.arange(len(H), dtype=float), H.shape[1])
    root = np.linalg.inv(np.linalg.cholesky(gram)).T
    left = left_by_fit(rows @ inverse, rows @ root, instants, np.zeros(count))
    quantile = fixed_b(ours.bandwidth) * np.sqrt(left_of_mean(ours.bandwidth)) / 1.96
    raw = np.sqrt(np.diag(inverse @ ours.covariance @ inverse))
    return theta, found | {METHODS[-1]: quantile * raw / np.sqrt(left)}


def coverage(noise: str, instants: int, p: int) -> list[str]:
    """Return a row of the table: the share of intervals that contain the truth, by method."""
    held: dict[str, list[float]] = {name: [] for name in METHODS}
    for seed in range(EXPERIMENTS):
        rng = np.random.default_rng(seed)
        H = autoregressive(rng, 0.8, (instants, JOINTS * p)).reshape(instants, JOINTS, p)
        theta, errors = standard_errors(H, NOISES[noise](rng, (instants, JOINTS)))
        for name, error in errors.items():
            held[name].append(float(np.mean(np.abs(theta) < 1.96 * error)))
    return [
        noise,
        str(instants),
        str(p),
        *(f"{100 * float(np.mean(held[name])):.1f}" for name in METHODS),
    ]


def main() -> None:
    """Print coverage by kind of noise, length of the log and number of parameters."""
    rows = [
        coverage(noise, instants, p)
        for instants, p in few(((150, 4), (150, 20), (1000, 4), (1000, 20)))
        for noise in NOISES
    ]
    header = ["noise", "instants", "p", *METHODS]
    print(table(f"Coverage of 95 % intervals [%], {EXPERIMENTS} experiments", header, rows))


if __name__ == "__main__":
    main()
