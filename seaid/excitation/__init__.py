"""Exciting trajectories (16)-(19): plan a motion that tells the parameters, within limits."""

from seaid.excitation.basis import Basis, make_basis
from seaid.excitation.criteria import CRITERIA
from seaid.excitation.design import Excitation, design_excitation
from seaid.excitation.ends import FREE, EndState, MotionSpace, limit_rows, motion_space
from seaid.excitation.fourier import FourierBasis
from seaid.excitation.joined import JoinedBasis
from seaid.excitation.limits import JointLimits, Limits, Margins, joint_limits, margins
from seaid.excitation.pivoted import pivoted_base
from seaid.excitation.run_in import add_run_in
from seaid.excitation.spline import SplineBasis
from seaid.excitation.trajectory import Trajectory, load_trajectory, polynomial_trajectory
from seaid.excitation.ways import with_run_in

__all__ = [
    "CRITERIA",
    "FREE",
    "Basis",
    "EndState",
    "Excitation",
    "FourierBasis",
    "JoinedBasis",
    "JointLimits",
    "Limits",
    "Margins",
    "MotionSpace",
    "SplineBasis",
    "Trajectory",
    "add_run_in",
    "design_excitation",
    "joint_limits",
    "limit_rows",
    "load_trajectory",
    "make_basis",
    "margins",
    "motion_space",
    "pivoted_base",
    "polynomial_trajectory",
    "with_run_in",
]
