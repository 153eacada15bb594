"""The ten inertial parameters of a body: order, names, pseudo-inertia, physical consistency.

Pinocchio's order (m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz): mass [kg], first moments [kg m] and
the inertia [kg m^2] about the origin of the body's frame.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, finite, number, safely
from seaid._progress import Display
from seaid.errors import RobotError

PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")

UNITS = ("kg",) + ("kg m",) * 3 + ("kg m^2",) * 6
"""Units of `PARAMETERS`."""

_FILE_DIGITS, _ROUNDING = 1e-3, 1e-9
"""Errors of moments of inertia, over the largest: by the rounded digits of a file, and by
arithmetic."""

THIN = 1e-9
"""Relative tolerance on the least eigenvalue of a pseudo-inertia, which is 0 for a thin body."""
LARGEST = {"m": 1e4, "rad": 1e4, "rad or m": 1e4, "kg": 1e9, "kg m^2": 1e15}
"""{unit: limit} of lengths, angles, masses and inertias in a description of a robot.

In another frame an inertia grows by mass * distance^2: beyond 10 km that sum keeps no digit of the
body's own inertia, and beyond 1e154 m it overflows.
"""
SMALLEST_KG = 1e-30
"""The least mass that is not zero; divisions by less lose all digits."""


def parameter_names(bodies: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the standard parameters, ten per body, such as 'Iyy_thigh'."""
    return tuple(f"{parameter}_{body}" for body in bodies for parameter in PARAMETERS)


def pseudo_inertia(parameters: Array) -> Array:
    """Return the 4x4 pseudo-inertia [[S, h], [h^T, m]] of ten parameters (Wensing et al. 2018).

    S = trace(I)/2 * 1 - I. It is linear in the parameters, which are physically consistent if it is
    positive semidefinite.
    """
    pseudo = pin.PseudoInertia.FromDynamicParameters(np.asarray(parameters, dtype=float))
    return np.asarray(pseudo.toMatrix())


def second_moments(parameters: Array) -> Array:
    """Return the second moments (3, 3) of a body with mass about its centre of mass [kg m^2].

    They are S_c = S - h h^T / m, in terms of the pseudo-inertia.
    """
    pseudo = pseudo_inertia(parameters)
    return np.asarray(pseudo[:3, :3] - np.outer(pseudo[:3, 3], pseudo[:3, 3]) / parameters[0])


def principal_moments(parameters: Array) -> Array:
    """Return the principal moments of inertia (3,) about the centre of mass [kg m^2], ascending."""
    second = second_moments(parameters)
    return _eigenvalues(np.trace(second) * np.eye(3) - second)


def from_pseudo_inertia(pseudo: Array) -> Array:
    """Return the ten parameters of a 4x4 pseudo-inertia."""
    return np.asarray(pin.PseudoInertia.FromMatrix(pseudo).toDynamicParameters())


def in_parent_frame(parameters: Array, placement: pin.SE3) -> Array:
    """Return the ten parameters in the parent frame, T J T^T with the body's `placement` T."""
    transform = placement.homogeneous
    return from_pseudo_inertia(transform @ pseudo_inertia(parameters) @ transform.T)


def from_center_of_mass(mass: float, com: Array, inertia: Array) -> Array:
    """Return the ten parameters of mass [kg], centre [m] and 3x3 inertia at the centre [kg m^2]."""
    # Parallel axes (Steiner) in terms of the second moments: S = S_c + m c c^T.
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia + mass * np.outer(com, com)
    return np.asarray(pin.PseudoInertia(mass, mass * com, second).toDynamicParameters())


def _eigenvalues(matrix: Array) -> Array:
    """Return the eigenvalues of a symmetric matrix of a body, in ascending order."""
    what = "the inertia of a body"
    return np.asarray(safely(np.linalg.eigvalsh, matrix, what=what, error=RobotError))


def is_physical(parameters: Array, tolerance: float = 1e-12) -> bool:
    """Whether ten parameters are physically consistent: some mass density >= 0 has them."""
    eigenvalues = _eigenvalues(pseudo_inertia(parameters))
    return bool(eigenvalues[0] >= -tolerance * max(eigenvalues[-1], 1e-300))


def inconsistent_link(link: str, parameters: Array) -> str | None:
    """Return the message about a physically inconsistent link, None if consistent or just thin."""
    if is_physical(parameters, THIN):
        return None
    least = float(_eigenvalues(pseudo_inertia(parameters))[0])
    return (
        f"link '{link}' would be physically inconsistent (mass {parameters[0]:.4g} kg, least "
        f"eigenvalue of its pseudo-inertia {least:.2g})"
    )


def out_of_range(parameters: Array) -> str | None:
    """Return which of ten parameters exceeds the limits of a robot description, None if none."""
    mass, first = float(parameters[0]), float(np.max(np.abs(parameters[1:4])))
    if abs(mass) > LARGEST["kg"]:
        return f"a mass of {mass:.4g} kg (at most {LARGEST['kg']:g} kg)"
    if first > LARGEST["m"] * max(abs(mass), SMALLEST_KG):
        return f"its centre of mass further than {LARGEST['m']:g} m away"
    inertia = float(np.max(np.abs(parameters[4:])))
    if inertia > LARGEST["kg m^2"]:
        return f"an inertia of {inertia:.4g} kg m^2 (at most {LARGEST['kg m^2']:g} kg m^2)"
    return None


def inconsistency(parameters: Array) -> str | None:
    """Return why ten parameters are physically inconsistent, by mass and principal moments.

    None if they are consistent up to the rounded digits of a file: a thousandth of the largest
    principal moment.
    """
    mass, scale = float(parameters[0]), float(np.max(np.abs(parameters[4:])))
    if mass < 0:
        return f"a negative mass, {mass:.4g} kg"
    if mass == 0:
        return "inertia without mass" if np.any(parameters) else None
    moments = principal_moments(parameters)
    allowed = _FILE_DIGITS * float(np.max(np.abs(moments))) + _ROUNDING * scale
    clean = np.where(np.abs(moments) > _ROUNDING * np.max(np.abs(moments)), moments, 0.0)
    shown = ", ".join(f"{moment:.4g}" for moment in clean)
    if moments[0] < -allowed:
        return f"a negative principal moment of inertia: {shown} kg m^2"
    if moments[0] + moments[1] < moments[2] - allowed:
        return f"a principal moment of inertia above the sum of the other two: {shown} kg m^2"
    return None


@dataclass(frozen=True, repr=False)
class Payload(Display):
    """A known body fixed to a link.

    Parameters
    ----------
    link : str
        Link of the URDF.
    mass : float
        Mass [kg], above zero.
    com : 3 floats, default (0, 0, 0)
        Centre of mass [m] in the link's frame.
    inertia : 3 x 3 floats, default zero (a point mass)
        Inertia [kg m^2] at the centre of mass.

    Raises
    ------
    RobotError
        For values that no body has.

    Examples
    --------
    >>> Payload("foot", mass=0.5, com=(0.05, 0.0, -0.02))
    """

    link: str
    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[tuple[float, float, float], ...] = ((0.0,) * 3,) * 3

    def __post_init__(self) -> None:
        where = f"payload on '{self.link}'"
        mass = number(f"mass of the {where}", self.mass, RobotError)
        finite(f"com of the {where}", self.com, (3,), RobotError)
        inertia = finite(f"inertia of the {where}", self.inertia, (3, 3), RobotError)
        if not SMALLEST_KG <= mass <= LARGEST["kg"]:
            allowed = f"{SMALLEST_KG:g} to {LARGEST['kg']:g} kg"
            raise RobotError(f"mass of the {where} must be {allowed}, found {mass:g}")
        with np.errstate(over="ignore"):  # of sizes that are out of range
            absurd = out_of_range(self.parameters)
        if absurd:
            raise RobotError(f"{where} has {absurd}")
        rounding = _ROUNDING * np.max(np.abs(inertia))
        symmetric = np.allclose(inertia, inertia.T, rtol=0, atol=rounding)
        if not symmetric or _eigenvalues(inertia)[0] < -rounding:
            raise RobotError(
                f"inertia of the {where} must be a symmetric matrix without negative principal "
                f"moments, found {inertia.tolist()}"
            )

    @property
    def parameters(self) -> Array:
        """The ten inertial parameters in the link's frame."""
        return from_center_of_mass(self.mass, np.array(self.com), np.array(self.inertia))


def to_pinocchio(parameters: Array) -> pin.Inertia:
    """Return the Pinocchio inertia of ten parameters.

    Pinocchio stores the centre of mass, so that a body without mass cannot have first moments.
    """
    if not np.any(parameters):
        return pin.Inertia.Zero()
    return pin.Inertia.FromDynamicParameters(np.asarray(parameters))
