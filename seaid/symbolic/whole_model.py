"""The complete model of a leg as one symbolic system: (7) and (8) of every joint in sympy."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from seaid.drivetrain.equations import joint_equation, motor_equation, spring_force
from seaid.drivetrain.model import IDEAL_DRIVE, Drive, SeriesElasticDrive
from seaid.drivetrain.symbols import N, i_M, r_L, t, tau_G, tau_L, tau_M, theta_L, theta_M, u_M
from seaid.robot import Robot
from seaid.symbolic.regressor_form import rigid_body
from seaid.transmission import coupled_groups


@dataclass(frozen=True, eq=False)
class CompleteModel:
    """A robot with its drives as equations that are zero, for `separate` or any other use.

    An elastic joint has two, (7) of its motor and (8) of its load, a stiff one the one that joins
    them. `coordinates` are the joints' and the elastic joints' motors' positions, functions of
    time; `inputs` the motor torques (at an ideal drive the joint torque). `parameters` are the
    standard inertial parameters, the other symbols those of `seaid.drivetrain.equations` with the
    joint's name behind, as k_knee: N, r_M, r_L and I_M are known, the others not. The equations of
    a drive that moves several joints are those of what it turns; its factors are exact numbers.
    """

    equations: tuple[sp.Expr, ...]
    coordinates: tuple[sp.Expr, ...]
    inputs: tuple[sp.Expr, ...]
    parameters: tuple[sp.Symbol, ...]


def complete_model(robot: Robot) -> CompleteModel:
    """Return (7) and (8) of a robot: lengths and gravity are exact numbers, the rest symbols."""
    form = rigid_body(robot)
    joints = [sp.Function(f"q_{joint}")(t) for joint in robot.joint_names]
    inertial = tuple(sp.Symbol(text) for text in robot.parameter_names)
    torques = form.expanded(form.R) * sp.Matrix(inertial)
    in_time = {
        symbol: joint.diff(t, order)
        for order, symbols in enumerate(form.motion)
        for symbol, joint in zip(symbols, joints, strict=True)
    }
    loads = [
        torque.xreplace(in_time) + _beside(robot.drivetrains[joint], joint, position)
        for torque, joint, position in zip(torques, robot.joint_names, joints, strict=True)
    ]
    turned, loads = _at_drives(robot, joints, loads)
    equations: list[sp.Expr] = []
    coordinates, inputs = list(joints), []
    for joint, position, load in zip(robot.joint_names, turned, loads, strict=True):
        drive = robot.drivetrains[joint]
        motor = sp.Function(f"theta_M_{joint}")(t)
        torque = sp.Function(f"tau_{joint}" if drive is IDEAL_DRIVE else f"tau_M_{joint}")(t)
        inputs.append(torque)
        if drive is IDEAL_DRIVE:
            equations.append(load - torque)
            continue
        side = motor_equation(drive).expression
        if isinstance(drive, SeriesElasticDrive):
            spring = r_L * spring_force(drive)
            coordinates.append(motor)
            equations.append(_of_joint(side, joint, position, motor, torque))
            equations.append(_of_joint(spring, joint, position, motor, torque) - load)
        else:
            side = side.subs(theta_M, N * theta_L).doit()
            stiff = _of_joint(side, joint, position, motor, torque)
            equations.append(stiff.subs({tau_L: load, tau_G: load}))
    return CompleteModel(tuple(equations), tuple(coordinates), tuple(inputs), inertial)


def _beside(drive: Drive, joint: str, position: sp.Expr) -> sp.Expr:
    """Return the torque that acts at the joint itself, beside its drive."""
    if drive is IDEAL_DRIVE:
        return sp.Integer(0)
    return _of_joint(joint_equation(drive).expression + tau_L, joint, position, theta_M, tau_M)


def _at_drives(
    robot: Robot, joints: list[sp.Expr], loads: list[sp.Expr]
) -> tuple[list[sp.Expr], list[sp.Expr]]:
    """Return what the drives turn, C q, and the torques on that, C^-T tau."""
    if not coupled_groups(robot.transmission):
        return joints, loads
    factors = sp.Matrix(
        [[sp.Rational(repr(factor)) for factor in row] for row in robot.transmission.tolist()]
    )
    return list(factors * sp.Matrix(joints)), list(factors.inv().T * sp.Matrix(loads))


def _of_joint(
    expression: sp.Expr, joint: str, position: sp.Expr, motor: sp.Expr, torque: sp.Expr
) -> sp.Expr:
    """Give the signals and symbols of a drive's equation the name of their joint."""
    signals = {theta_M: motor, theta_L: position, tau_M: torque, i_M: torque, u_M: torque}
    symbols = {
        symbol: sp.Symbol(f"{symbol.name}_{joint}", positive=symbol.is_positive)
        for symbol in expression.free_symbols - {t}
    }
    return expression.subs(signals).doit().xreplace(symbols)
