"""Possible bodies as a program: optimal by its definition, the risk by differences, errors."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scripts.benchmarks.random_programs import (
    outcome,
)
from seaid._arrays import Array
from seaid.errors import IdentificationError, SeaidWarning
from seaid.estimation import nearest, sdp
from seaid.estimation import sdp as interior_point
from seaid.estimation.sdp import (
    RESOLVED,
    WEIGHTS,
    FeasiblePoint,
    Program,
    covariance_root,
    floored_covariance,
    of_least_risk,
    regularised,
)
from seaid.robot.inertia import from_center_of_mass, pseudo_inertia
from tests.representatives import quick_first

BODIES, TOLD = 2, 12
SEEDS = st.integers(0, 2**32 - 1)


def body(rng: np.random.Generator) -> Array:
    spread = 0.1 * rng.normal(size=(3, 3))
    second = spread @ spread.T + 1e-3 * np.eye(3)
    tensor = np.trace(second) * np.eye(3) - second
    return from_center_of_mass(rng.uniform(0.5, 3), 0.1 * rng.normal(size=3), tensor)


def program(seed: int, noise: float = 1.0, shift: Array | None = None) -> Program:
    """Return two bodies and a friction (at least 0), of which 12 combinations are estimated."""
    rng = np.random.default_rng(seed)
    prior = np.array([body(rng) for _ in range(BODIES)])
    truth = np.append(np.concatenate([body(rng) for _ in range(BODIES)]), 0.2)
    columns = np.zeros((TOLD + 1, len(truth)))
    pivots = (*sorted(rng.choice(20, TOLD, replace=False).tolist()), 20)
    columns[:TOLD, :20] = rng.normal(size=(TOLD, 20)) * (rng.random((TOLD, 20)) < 0.2)
    columns[:, pivots] = np.eye(TOLD + 1)
    values = columns @ truth
    half = rng.normal(size=(TOLD + 1, 2 * TOLD)) * 0.05 * (np.abs(values) + 0.01)[:, None]
    root = covariance_root(half @ half.T / TOLD, values)
    limit = np.zeros((1, len(truth)))
    limit[0, 20] = 1.0
    estimate = values + noise * root @ rng.normal(size=TOLD + 1)
    return Program(
        columns=columns,
        pivots=pivots,
        estimate=estimate if shift is None else estimate + root @ shift,
        root=root,
        prior=prior,
        limits=limit,
        bounds=np.zeros(1),
        start=np.append(prior.ravel(), 0.1),
    )


def merit(one: Program, unknowns: Array, weight: float) -> float:
    """Return chi-square + weight times divergence from their definitions; infinite outside."""
    u = np.linalg.solve(one.root, one.columns @ unknowns - one.estimate)
    total = float(u @ u)
    for parameters, prior in zip(unknowns[:20].reshape(-1, 10), one.prior, strict=True):
        ratio = np.linalg.solve(pseudo_inertia(prior), pseudo_inertia(parameters))
        if np.linalg.eigvalsh(pseudo_inertia(parameters))[0] <= 0 or unknowns[20] < 0:
            return np.inf
        total += weight * float(np.trace(ratio) - np.linalg.slogdet(ratio)[1] - 4)
    return total


@pytest.mark.rounding
@settings(max_examples=10)
@given(SEEDS, st.sampled_from([1e-2, 1.0, 1e2]))
def test_no_step_from_the_minimum_goes_lower(seed: int, weight: float) -> None:
    one = program(seed % 1000)
    found = regularised(one, weight)
    least = merit(one, found.unknowns, weight)
    np.testing.assert_allclose(found.values, one.columns @ found.unknowns, rtol=0, atol=1e-9)
    rng = np.random.default_rng(seed)
    for size in (1e-4, 1e-3, 1e-2, 1e-1):
        for _ in range(20):
            step = size * rng.normal(size=21) * np.abs(found.unknowns)
            assert merit(one, found.unknowns + step, weight) > least - 1e-4


def test_freedom_is_the_derivative_of_the_values_by_the_estimate() -> None:
    step, trace = 1e-4, 0.0
    for column in range(TOLD + 1):
        shift = np.zeros(TOLD + 1)
        shift[column] = step
        ends = [regularised(program(5, shift=sign * shift), 0.3) for sign in (1, -1)]
        root = program(5).root
        trace += np.linalg.solve(root, ends[0].values - ends[1].values)[column] / (2 * step)
    assert regularised(program(5), 0.3).effective_parameters == pytest.approx(trace, rel=1e-5)


def test_data_choose_the_weight_of_least_risk() -> None:
    one = program(6, noise=1.0)
    found = of_least_risk(one, nearest(one).chi_square)
    for weight in (1e4, 1e2, 1.0, 1e-2, 1e-4):
        assert found.risk <= regularised(one, weight).risk


def test_risk_is_the_mean_squared_distance_to_the_truth() -> None:
    weight, runs = 1.0, 60
    rng = np.random.default_rng(0)
    exact = program(7, noise=0.0)
    estimated, real = [], []
    for _ in range(runs):
        one = program(7, noise=0.0, shift=rng.normal(size=TOLD + 1))
        found = regularised(one, weight)
        away = np.linalg.solve(exact.root, found.values - exact.estimate)
        estimated.append(found.risk)
        real.append(away @ away)
    gap = np.array(estimated) - np.array(real)
    assert abs(np.mean(gap)) < 3 * np.std(gap) / np.sqrt(runs)
    assert np.std(gap) / np.sqrt(runs) < 0.25 * np.mean(real)


@pytest.mark.rounding
def test_impossible_moments_are_held_at_a_flat_plate_and_a_negative_friction_at_zero() -> None:
    impossible = from_center_of_mass(1.0, np.zeros(3), np.diag([1.0, 1.0, 2.5]))
    estimate = np.append(impossible, -0.3)
    one = Program(
        columns=np.eye(11),
        pivots=tuple(range(11)),
        estimate=estimate,
        root=0.01 * np.eye(11),
        prior=from_center_of_mass(1.0, np.zeros(3), np.eye(3))[None],
        limits=np.eye(11)[10:],
        bounds=np.zeros(1),
        start=np.append(from_center_of_mass(1.0, np.zeros(3), np.eye(3)), 1.0),
    )
    found = nearest(one)
    assert found.ranks == (3,)
    assert found.active_bounds == (0,)
    # the excess of 0.5 spread over the three moments, and friction 30 standard errors off
    assert found.chi_square == pytest.approx(3 * (0.5 / 3 / 0.01) ** 2 + 30**2, rel=1e-5)
    possible = nearest(replace(one, estimate=np.append(one.prior[0], 0.2)))
    assert possible.chi_square < 1e-6
    assert possible.ranks == (4,)
    assert possible.active_bounds == ()


@pytest.mark.rounding
@given(SEEDS)
def test_root_is_that_of_the_covariance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(6, 20)) * 10.0 ** rng.uniform(-6, 3, 6)[:, None]
    covariance = half @ half.T
    root = covariance_root(covariance, np.ones(6))
    errors = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        root @ root.T / np.outer(errors, errors), covariance / np.outer(errors, errors), atol=1e-9
    )
    # of values without errors too, so that it can be inverted
    exact = covariance_root(np.zeros((3, 3)), np.array([1.0, 100.0, 0.0]))
    assert np.linalg.matrix_rank(exact) == 3
    assert np.all(np.linalg.norm(exact, axis=1) < 1e-7)


def test_no_combination_is_known_better_than_white_noise_allows() -> None:
    rng = np.random.default_rng(0)
    white, covariance = (half @ half.T for half in rng.normal(size=(2, 5, 8)))
    spread = floored_covariance(covariance, white)
    assert np.linalg.eigvalsh(spread - white)[0] > -1e-9
    assert np.linalg.eigvalsh(spread - covariance)[0] > -1e-9
    np.testing.assert_allclose(floored_covariance(100 * white, white), 100 * white)
    # a log without noise
    np.testing.assert_allclose(floored_covariance(np.eye(2), np.zeros((2, 2))), np.eye(2))
    rank_one = np.outer([1.0, 2.0], [1.0, 2.0])
    np.testing.assert_allclose(floored_covariance(rank_one, rank_one), rank_one, rtol=1e-6)


def test_parameters_of_very_different_sizes_are_no_singular_covariance() -> None:
    """Of the root the condition number is 1e14, which is that of the units."""
    sizes = 10.0 ** np.linspace(-7, 7, TOLD + 1)
    plain = program(0)
    wide = replace(
        plain,
        columns=sizes[:, None] * plain.columns,
        estimate=sizes * plain.estimate,
        root=sizes[:, None] * plain.root,
    )
    unknowns = np.arange(1.0, plain.columns.shape[1] + 1)
    distance = plain.coordinates(unknowns)
    np.testing.assert_allclose(wide.coordinates(unknowns), distance, rtol=1e-9)


def test_programs_without_a_solution_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers that are not finite, or too different in size, and a search that does not end."""
    one = program(0)
    for name in ("columns", "estimate", "root", "prior", "bounds", "start"):
        bad = getattr(one, name).copy()
        bad.flat[0] = np.nan
        with pytest.raises(IdentificationError, match=f"{name} must be finite"):
            replace(one, **{name: bad})
    with pytest.raises(IdentificationError, match=r"differ too much in size .* check their units"):
        nearest(replace(one, estimate=1e200 * one.estimate))
    monkeypatch.setattr(interior_point, "_MOST_STEPS", 2)
    with pytest.raises(IdentificationError, match=r"with weight 0\.1 were not found: .* payloads"):
        regularised(one, 0.1)


@pytest.mark.rounding
def test_no_weight_is_tried_that_cannot_be_resolved(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[float] = []

    def watched(one: Program, weight: float) -> FeasiblePoint:
        tried.append(weight)
        return regularised(one, weight)

    monkeypatch.setattr(sdp, "regularised", watched)
    for least in (0.0, 1e6, 1e20):
        tried.clear()
        of_least_risk(program(3), least)
        assert max(tried) <= WEIGHTS[0]
        assert min(tried) >= min(max(WEIGHTS[-1], RESOLVED * least), WEIGHTS[0])


@pytest.mark.rounding
@pytest.mark.parametrize(
    "number",
    quick_first(range(48), 5),  # by another solver each, 0.5 s
)
def test_random_programs_of_robots_are_solved_as_clarabel_does(number: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeaidWarning)
        one = outcome(number, choose_every=4)
    assert one.result == "solved", one.words
    # ours is feasible, so that it may be below another solver's that ends with its tolerances, and
    # never above beyond its own gap, which is taken off already
    assert one.worse < 1e-6
    assert one.apart is None or one.apart < 1e-5
