"""Figures of each actuator: friction over velocity, spring torque over deflection, responses.

A sample of the friction is what the motor equation (7) leaves when inertia and spring are taken
away as identified; a sample of the spring force is what remains without inertia and friction. All
are below the cutoff, without standstill.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.drives import PARAMETERS, PARAMETERS_OF, Drive, friction_curve, spring_curve
from seaid.drives.drives import deflection
from seaid.drives.equations import states
from seaid.drives.terms import parameter_named
from seaid.errors import SeaidError
from seaid.log import Motion, in_band, standstill
from seaid.regressor.load import drive_columns, load_side, with_gear_torque
from seaid.regressor.regression import actuator_columns, signals, under_load
from seaid.report.formats import layout_of
from seaid.report.html_charts import Axis, Figure, Layer, Panel

if TYPE_CHECKING:
    from seaid.frequency import FrequencyResponse
    from seaid.identification import Identification
    from seaid.robot import Robot

_LAYOUT = layout_of("curves")

_FRICTION = {name for terms in PARAMETERS_OF["friction"].values() for name in terms}
_SPRING = {name for terms in PARAMETERS_OF["spring"].values() for name in terms}
_SPRING |= {"spring_offset"}
_SHAPES = {name for name, parameter in PARAMETERS.items() if parameter.starts}
"""Parameters whose columns are slopes, no parts of a torque."""


def actuator_figures(result: Identification, nominal: Robot) -> list[Panel]:
    """Return the figures of every joint with friction or a spring, none for long logs."""
    motions = fitted_motions(result)
    most = max(60, min(_LAYOUT.most_samples, _LAYOUT.room // max(2 * result.robot.n, 1)))
    sides = [_sides(result, motion) for motion in motions]
    figures = []
    for index, (joint, drive) in enumerate(result.known.drives.items()):
        parts = [
            _samples(motion, index, of_motion[joint])
            for motion, of_motion in zip(motions, sides, strict=True)
            if joint in of_motion
        ]
        samples = np.concatenate([np.zeros((4, 0)), *parts], axis=1)
        if not samples.size:
            continue
        samples = samples[:, np.unique(np.linspace(0, samples.shape[1] - 1, most).astype(int))]
        drives = {"nominal": nominal.drives[joint], "identified": _identified(result, joint)}
        drawn = (*_friction_figure(joint, samples, drives), *_spring_figure(joint, samples, drives))
        if drawn:
            figures.append(Panel(joint, "series elastic" if drive.is_elastic else "stiff", drawn))
    return figures


def fitted_motions(identification: Identification) -> list[Motion]:
    """Return the motions used, with the torque through the gears where friction depends on it."""
    # Friction that depends on the load needs the torque through the gear, which the fit has made.
    if not under_load(identification.known, identification.model.torque_joints):
        return list(identification.motions)
    model, theta = identification.model, identification.load_side.values
    return [
        with_gear_torque(identification.known, motion, model, identification.springs, theta)
        for motion in identification.motions
    ]


def _sides(result: Identification, motion: Motion) -> dict[str, tuple[Array, Array, Array]]:
    """Return the sides of `_elastic_side` by joint."""
    sides = _stiff_sides(result, motion)
    for joint in result.known.elastic_joints:
        elastic = _elastic_side(result, motion, joint)
        if elastic is not None:
            sides[joint] = elastic
    return sides


def _identified(identification: Identification, joint: str) -> Drive:
    """Return the drive with the values of its equations, as they were identified."""
    drive = identification.known.drives[joint]
    estimate = identification.drive_side.get(joint)
    if estimate is None:
        return drive
    values = estimate.by_name
    valid = {
        name: max(value, 0.0) if parameter_named(name).is_positive else value
        for name, value in values.items()
        if name in drive.parameter_names and (value > 0 or name != "stiffness")
    }
    return drive.with_values(valid)


def _samples(motion: Motion, index: int, sides: tuple[Array, Array, Array]) -> Array:
    """Return the samples (4, P) of a joint in a motion: its motor's speed, and the sides."""
    lost = round(motion.transient_s * motion.rate_hz)
    inside = np.zeros(len(motion.time), dtype=bool)
    inside[lost : len(inside) - lost] = True
    if motion.bridged is not None:
        inside &= ~motion.bridged
    kept = inside & ~standstill(motion, index)
    return np.array([in_band(motion, motion.motor_velocity[:, index]), *sides])[:, kept]


def _elastic_side(
    identification: Identification, motion: Motion, joint: str
) -> tuple[Array, Array, Array] | None:
    """Return friction at the motor, deflection from the spring's zero, and spring force (T,)."""
    estimate, drive = identification.drive_side[joint], identification.known.drives[joint]
    regressor, zeta, R = actuator_columns(identification.known, motion, joint)
    if not set(regressor.names) <= set(estimate.names):
        return None
    values = np.array([estimate.value(name) for name in regressor.names])
    offset = estimate.value("torque_offset") if "torque_offset" in estimate.names else 0.0
    # (7): zeta = R theta + residual, so that friction is the residual plus its own columns: samples
    # scatter about the identified curve by the residual only.
    parts = R * values
    is_motor = bool(regressor.signals & {"tau_M", "i_M", "u_M"})
    residual = zeta - np.sum(parts, axis=1) - (offset if is_motor else 0.0)
    torques = {
        kind: residual
        + np.sum(parts[:, [name in names - _SHAPES for name in regressor.names]], axis=1)
        for kind, names in (("friction", _FRICTION), ("spring", _SPRING))
    }
    # (7) has the spring as r_M/N F_s, a torque at the motor; a sensor behind the spring has F_s.
    lever = drive.ratio / drive.motor_radius if is_motor else 1.0
    by_name = signals(identification.known, motion, identification.known.index(joint))
    measured = deflection(drive, by_name["theta_M"], by_name["theta_L"])
    friction = in_band(motion, torques["friction"]) if is_motor else np.full_like(residual, np.nan)
    zero = _spring_zero(drive, estimate.by_name)
    return friction, in_band(motion, measured) - zero, lever * in_band(motion, torques["spring"])


def _spring_zero(drive: Drive, values: Mapping[str, float]) -> float:
    """Return the measured deflection at which the spring is relaxed, by its encoder offsets."""
    if drive.is_nonlinear_spring:
        return values.get("deflection_zero", 0.0)
    if "preload" in drive.spring or not values.get("stiffness"):
        return 0.0
    # k d + f_0 = 0
    return -values.get("spring_offset", 0.0) / values["stiffness"]


def _stiff_sides(result: Identification, motion: Motion) -> dict[str, tuple[Array, Array, Array]]:
    """Return the sides of `_elastic_side` by stiff joint: the friction at its motor, and nothing.

    It is that of the fit with what the load side (8) leaves of the torque: of a robot on the ground
    the contact forces are eliminated from that, and so a part of the friction.
    """
    model, theta = result.model, result.load_side.values[: len(result.model.names)]
    rows = {
        joint: [
            place
            for place, (of, name, _) in enumerate(model.drives)
            if of == joint and name in _FRICTION and not result.known.drives[joint].is_elastic
        ]
        for joint in model.torque_joints
    }
    if not any(rows.values()):
        return {}
    side = load_side(result.known)
    torque, payload, made = side.torques(motion, model, result.springs, theta[:, None])
    # The rows of the joints are the last ones, behind those of a floating base.
    residual = (torque - payload - made[:, :, 0])[:, -len(rows) :]
    columns, values = drive_columns(result.known, motion, model)(), theta[len(model.expressions) :]
    sides = {}
    for row, (joint, places) in enumerate(rows.items()):
        if places:
            friction = residual[:, row] + columns[:, row][:, places] @ values[places]
            # (8) is at the joint: over N is at the motor.
            friction = in_band(motion, friction) / result.known.drives[joint].ratio
            nothing = np.full_like(friction, np.nan)
            sides[joint] = (friction, nothing, nothing)
    return sides


def _friction_figure(joint: str, samples: Array, drives: Mapping[str, Drive]) -> Iterator[Figure]:
    """Yield the friction without load over the speed of the motor."""
    speeds, friction, _, _ = samples
    if not (drives["identified"].friction and np.any(np.isfinite(friction))):
        return
    fastest = float(np.max(np.abs(speeds)))
    speed = np.linspace(-fastest, fastest, _LAYOUT.points - 1)  # without zero, where the sign jumps

    def curve(drive: Drive) -> Array:
        law, width = friction_curve(joint, drive.without_harmonics()), _LAYOUT.sign_width * fastest
        return law.torque(speed, np.zeros_like(speed), sign_width=width)[0]

    figure = Figure(
        f"Friction of {joint} over the speed of its motor",
        [Layer(speeds, friction, "sample")],
        Axis("motor speed", "rad/s"),
        Axis("friction torque", "N m"),
        "Friction over the speed of the motor",
    )
    yield _with_curves(figure, speed, curve, drives)


def _spring_figure(joint: str, samples: Array, drives: Mapping[str, Drive]) -> Iterator[Figure]:
    """Yield the force of a spring over its deflection."""
    speeds, _, deflections, force = samples
    if not np.any(np.isfinite(force)):
        return
    # Two directions of the motor, because hysteresis of spring and gear separates them.
    ways = {"sample up": speeds > 0, "sample down": ~(speeds > 0)}
    x = np.linspace(float(np.min(deflections)), float(np.max(deflections)), _LAYOUT.points)
    if "dahl" in drives["identified"].spring:
        x = np.concatenate([x, x[::-1]])  # around the loop
    unit, length = drives["identified"].spring_units
    figure = Figure(
        f"Spring of {joint}: torque over deflection",
        [Layer(deflections[way], force[way], name) for name, way in ways.items()],
        Axis("deflection", length),
        Axis(f"spring {'force' if unit == 'N' else 'torque'}", unit),
        "Spring over its deflection",
    )
    yield _with_curves(figure, x, lambda drive: _spring_force(drive, x), drives)


def _spring_force(drive: Drive, x: Array) -> Array:
    """Return the force (P,) of a relaxed spring's deflections x.

    Hysteresis is that of the second time along x. Raises SeaidError if a value is missing.
    """
    force = spring_curve(drive, x + drive.values.get("deflection_zero", 0.0))
    if "dahl" in drive.spring:
        # The state of Dahl's model depends on the past: the first round leads to the loop.
        z = states(np.tile(x, 2), drive.values["hysteresis_deflection"])[0][len(x) :]
        force = force + drive.values["hysteresis_force"] * z
    return force


def _with_curves(
    figure: Figure, x: Array, curve: Callable[[Drive], Array], drives: Mapping[str, Drive]
) -> Figure:
    """Return a figure of samples with the curve over x of each drive that has all values."""
    layers = [*figure.layers]
    for name, drive in drives.items():
        with suppress(SeaidError):
            layers.append(Layer(x, curve(drive), name, "line"))
    # Samples and the identified curve are shown whole; the nominal one may leave the chart.
    seen = np.concatenate([layer.y for layer in layers if layer.name != "nominal"])
    low, high = float(np.nanmin(seen)), float(np.nanmax(seen))
    room = 0.08 * (high - low) or 1.0
    return replace(figure, layers=layers, y=replace(figure.y, low=low - room, high=high + room))


def response_figures(response: FrequencyResponse) -> list[Panel]:
    """Return size and phase of the response of every joint to its own motor torque.

    They are measured, with deviations, and those of the models. Vertical lines are the resonance
    and the antiresonance of an elastic joint. The coherence is the share of power that the linear
    response explains.
    """
    panels = []
    for place, joint in enumerate(response.joints):
        explained = response.coherence[:, place]
        note = f"coherence {np.nanmin(explained):.2f} to {np.nanmax(explained):.2f}"
        panels.append(Panel(joint, note, _response_figures(response, place)))
    return panels


def _response_figures(response: FrequencyResponse, place: int) -> tuple[Figure, Figure]:
    """Return size and phase of the response of one joint."""
    hz, joint = response.frequency_hz, response.joints[place]
    measured = response.response[:, place, place]
    models = [(response.model, "identified"), (response.identified, "computed")]
    curves = [(model[:, place, place], name) for model, name in models if model is not None]
    stds = [(response.noise_std, "threshold"), (response.total_std, "nominal")]
    deviations = [(std[:, place, place], name) for std, name in stds]
    sizes = np.concatenate([np.abs(measured), *(curve for curve, _ in deviations)])
    # A deviation of zero (of noise-free data) has no place on a logarithmic axis.
    sizes = sizes[np.isfinite(sizes) & (sizes > 1e-6 * np.max(np.abs(measured)))]
    low, high = 0.7 * float(np.min(sizes)), 1.4 * float(np.max(np.abs(measured)))
    marks = [
        (response.drives[joint].value(name), style)
        for name, style in (("resonance", "sample up"), ("antiresonance", "sample down"))
        if joint in response.drives
    ]
    size = [
        *_marked(marks, low, high),
        *(Layer(hz, curve, name, "line") for curve, name in deviations),
        Layer(hz, np.abs(measured), "sample"),
        *(Layer(hz, np.abs(curve), name, "line") for curve, name in curves),
    ]
    phase = [
        *_marked(marks, -360.0, 360.0),
        Layer(hz, _degrees(measured), "sample"),
        *(Layer(hz, _degrees(curve), name, "line") for curve, name in curves),
    ]
    across = Axis("frequency", "Hz", float(hz[0]) / 1.05, float(hz[-1]) * 1.05, is_log=True)
    up = Axis("motor angle / torque", "rad/(N m)", low, high, is_log=True)
    text, turns = f"the frequency response of {joint}", Axis("phase", "°", -225.0, 45.0)
    return (
        Figure(f"Size of {text}", size, across, up, "Motor angle per motor torque"),
        Figure(f"Phase of {text}", phase, across, turns, "Its phase"),
    )


def _marked(marks: Sequence[tuple[float, str]], low: float, high: float) -> Iterator[Layer]:
    for hz, name in marks:
        yield Layer(np.array([hz, hz]), np.array([low, high]), name, "line")


def _degrees(response: Array) -> Array:
    """Return the phase (F,) from -225 to 135 degrees, interrupted where it jumps."""
    # A motor angle lags its torque by up to 180 degrees: the cut of the phase is at -225, so that
    # noise about -180 does not jump.
    phase = (np.degrees(np.angle(response)) + 225.0) % 360.0 - 225.0
    return np.where(np.abs(np.diff(phase, prepend=phase[0])) > 180.0, np.nan, phase)
