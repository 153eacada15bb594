"""Exciting trajectories (16)-(19): plan a motion that tells the parameters, within limits."""

from seaid.excitation.basis import Basis, make_basis
from seaid.excitation.criterion import pivoted_base
from seaid.excitation.design import Excitation, design_excitation
from seaid.excitation.fourier import FourierBasis
from seaid.excitation.limits import JointLimits, Limits, Margins, joint_limits, margins
from seaid.excitation.spline import SplineBasis
from seaid.excitation.trajectory import Trajectory, load_trajectory, polynomial_trajectory

__all__ = [
    "Basis",
    "Excitation",
    "FourierBasis",
    "JointLimits",
    "Limits",
    "Margins",
    "SplineBasis",
    "Trajectory",
    "design_excitation",
    "joint_limits",
    "load_trajectory",
    "make_basis",
    "margins",
    "pivoted_base",
    "polynomial_trajectory",
]
