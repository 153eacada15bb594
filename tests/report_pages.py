"""Identifications to write reports of: a real one, and made-up ones of any size and any names."""

from pathlib import Path

import numpy as np

from seaid._arrays import Array, FrozenMapping, frozen
from seaid.drives import ParameterName
from seaid.estimation import Estimate, TermTest, Whiteness
from seaid.estimation.estimate import ModelChecks
from seaid.identification import Fit, Identification, Validation
from seaid.regressor import BaseParameters
from seaid.regressor.load import LoadModel
from seaid.robot.inertia import UNITS
from tests.one_joint import chain

HOSTILE = ("<b>x</b>", "\"'&amp;", "</script><script>alert(1)</script>", "${a}", "$x_y$", "{{ 7 }}")


def estimate(names: tuple[str, ...], units: tuple[str, ...], seed: int = 0) -> Estimate:
    """Return a made-up estimate, values between 0.1 and 10 with errors from 0.1 % to 100 %."""
    rng = np.random.default_rng(seed)
    values = 10 ** rng.uniform(-1, 1, len(names))
    errors = values * 10 ** rng.uniform(-3, 0, len(names))
    mixed = np.eye(len(names)) + 0.3 * rng.normal(size=(len(names), 5)) @ rng.normal(
        size=(5, len(names))
    ) / np.sqrt(5)
    covariance = mixed @ mixed.T
    scale = errors / np.sqrt(np.diag(covariance))
    covariance *= np.outer(scale, scale)
    return Estimate(ParameterName.all_of(names), values, covariance, units, 0.01, 20.0)


def made_up(
    folder: Path, joints: tuple[str, ...], samples: int = 4000
) -> tuple[Identification, Validation]:
    """Return an identification of a chain whose own motions are not kept, and its validation."""
    robot = chain(folder, *joints, name="chain <i>")
    per_joint = 7
    columns = tuple(10 * body + k for body in range(robot.n) for k in range(per_joint))
    names = robot.parameter_names
    expressions = tuple(
        names[c]
        + "".join(f" + {0.1 * k:.3g} {one}" for k, one in enumerate(names[c + 10 :: 10], 1))
        for c in columns
    )
    grouping = frozen("grouping", np.zeros((len(columns), len(names))), (None, None))
    base = BaseParameters(columns, tuple(names[c] for c in columns), expressions, grouping, 1e6)
    model = LoadModel(base, joints, (), expressions, (), np.zeros((len(columns), 0)))
    load = estimate(expressions, tuple(UNITS[c % 10] for c in columns))
    checks = ModelChecks(
        condition_number=300.0,
        poorly_determined=tuple(
            f"the data tell 1e-03 of the combination {one}" for one in names[:12]
        ),
        terms=(TermTest((f"viscous_friction of {joints[0]}",), 1.001, 1.0, 0.4, -3.0, 100.0),),
        whiteness={joint: Whiteness(0.5, 1.0, 0.1) for joint in joints},
    )
    found = Identification(
        drive_side=FrozenMapping(
            {
                joint: estimate(("viscous_friction", "coulomb_friction"), ("N m s/rad", "N m"), k)
                for k, joint in enumerate(joints)
            }
        ),
        load=load,
        base=base,
        robot=robot,
        known=robot,
        model=model,
        load_side=load,
        springs=FrozenMapping({}),
        cutoff_hz=5.0,
        excluded=FrozenMapping({"load": 10}),
        checks=FrozenMapping({"load": checks}),
    )
    return found, prediction(joints, samples)


def prediction(joints: tuple[str, ...], samples: int) -> Validation:
    """Return a made-up validation at 500 Hz, the actuator side without equations."""
    rng = np.random.default_rng(1)
    time = np.arange(samples) / 500.0
    phase = rng.uniform(0, 6, len(joints))
    measured = np.sin(np.outer(2 * np.pi * time, rng.uniform(0.2, 2, len(joints))) + phase)
    computed = measured + 0.02 * np.cos(np.outer(9 * time, np.ones(len(joints))))
    for ends in (slice(None, 50), slice(-50, None)):
        measured[ends] = computed[ends] = np.nan
    nothing = np.full_like(measured, np.nan)
    return Validation(joints, time, 5.0, fit(nothing, nothing), fit(measured, computed))


def fit(measured: Array, computed: Array) -> Fit:
    """Return a fit with the numbers of its traces."""
    told = np.isfinite(measured[:, 0])
    if not np.any(told):
        none = np.full(measured.shape[1], np.nan)
        return Fit(measured, computed, np.isfinite(measured), *[none] * 6)
    error, signal = (measured - computed)[told], measured[told]
    relative = np.linalg.norm(error, axis=0) / np.linalg.norm(signal, axis=0)
    rms = np.sqrt(np.mean(error**2, axis=0))
    counted, r_squared, shares = np.isfinite(measured), 1 - relative**2, np.ones(len(rms))
    return Fit(measured, computed, counted, rms, relative, r_squared, relative, relative, shares)
