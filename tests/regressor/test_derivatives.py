"""What motor angle and motor torque determine with their derivatives, against simulations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import seaid
from seaid._arrays import Array
from seaid.regressor.structural_identifiability import Sensor

MOTOR_SIDE: tuple[Sensor, ...] = ("motor_position", "motor_torque")
N = 50.0
BODY = {"Iyy": 0.09, "mx": 0.24, "mz": -0.1}
DRIVE = {"viscous": 3e-4, "inertia": 4e-5, "stiffness": 60.0, "offset": 1.5}


def one_joint(folder: Path, axis: str) -> seaid.Robot:
    path = folder / "one.urdf"
    path.write_text(
        f"""<robot name="one">
        <link name="base"/><link name="arm"><inertial>
        <origin xyz="0.2 0 0"/><mass value="1.2"/>
        <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="arm"/>
        <axis xyz="{axis}"/><limit lower="-3" upper="3" effort="50" velocity="20"/></joint>
        </robot>"""
    )
    drive = seaid.SeriesElasticDrive(gear_ratio=N, friction=("viscous",))
    return seaid.load_robot(path, {"j": drive})


def motor_angles(parameters: Array, start: Array, gravity: float) -> Array:
    """Return the motor angles (T,) of a motor, a spring and a pendulum under a given torque."""
    viscous, inertia, stiffness, offset, J, mx, mz = parameters

    def rate(time: float, state: Array) -> list[float]:
        theta, w, q, v = state
        given = 0.03 * np.sin(1.3 * time) + 0.02 * np.sin(4.1 * time + 1) + 0.02 * np.cos(9 * time)
        torque = stiffness * (theta / N - q) + offset
        weight = gravity * (mx * np.cos(q) + mz * np.sin(q))
        return [w, (given - viscous * w - torque / N) / inertia, v, (torque + weight) / J]

    times = np.linspace(0, 3, 200)
    run = solve_ivp(rate, (0, 3), start, t_eval=times, rtol=1e-11, atol=1e-12, method="DOP853")
    return np.asarray(run.y[0])


def rank_of_simulations(gravity: float) -> int:
    """Return the number of combinations in the angles, besides those of the first state."""
    truth, start = np.array([*DRIVE.values(), *BODY.values()]), np.array([0.1, 0.0, 0.0, 0.2])
    columns = []
    for place in range(len(truth) + len(start)):
        ends = []
        for sign in (1, -1):
            changed, begin = truth.copy(), start.copy()
            if place < len(truth):
                changed[place] *= 1 + sign * 1e-4
            else:
                begin[place - len(truth)] += sign * 1e-4
            ends.append(motor_angles(changed, begin, gravity))
        columns.append(ends[0] - ends[1])
    S = np.column_stack(columns)
    norms = np.linalg.norm(S, axis=0)
    kept = norms > 1e-9 * norms.max()
    sizes = np.linalg.svd(S[:, kept] / norms[kept], compute_uv=False)
    rank = int(np.argmax(sizes[:-1] / sizes[1:])) + 1
    assert sizes[rank - 1] > 100 * sizes[rank]
    return rank - len(start)


@pytest.mark.slow  # 1.8 s
@pytest.mark.parametrize(("axis", "gravity", "rank"), [("0 1 0", 9.81, 6), ("0 0 1", 0.0, 4)])
def test_the_count_is_that_of_simulated_motor_angles(
    tmp_path: Path, axis: str, gravity: float, rank: int
) -> None:
    """An offset of the spring is one of the joint's angle, and turns the last body."""
    found = seaid.identifiability(one_joint(tmp_path, axis), MOTOR_SIDE)
    assert found.rank == 0
    assert found.derivatives is not None
    # an offset moves the first angle of the joint, which is free in the simulation
    assert len(found.derivatives.columns) == rank == rank_of_simulations(gravity)
    alone = np.count_nonzero(found.derivatives.grouping, axis=1) == 1
    names = [name for name, one in zip(found.derivatives.names, alone, strict=True) if one]
    for name in ("stiffness of j", "motor_inertia of j", "viscous_friction of j"):
        assert name in names
    assert "By derivatives of motor angle and motor torque" in str(found.summary())


def test_the_leg_without_joint_encoders() -> None:
    leg = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
    by_regression = seaid.identifiability(leg)
    found = seaid.identifiability(leg, MOTOR_SIDE)
    assert found.derivatives is not None
    assert by_regression.derivatives is None
    # all but one: the offset of the ankle's spring turns the foot
    assert len(found.derivatives.columns) == by_regression.rank - 1 == 44
    assert found.derivatives.gap > 1e6
    expressions = found.derivatives.expressions
    for joint in leg.elastic_joints:
        assert f"stiffness of {joint}" in expressions


def test_the_other_joints_may_have_any_sensors() -> None:
    leg = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
    both: tuple[Sensor, ...] = (*MOTOR_SIDE, "joint_position")
    sensors = {joint: MOTOR_SIDE if joint == "knee_pitch" else both for joint in leg.joint_names}
    found = seaid.identifiability(leg, sensors)
    assert found.derivatives is not None
    assert len(found.derivatives.columns) == 45
    sensors["hip_yaw"] = ("motor_torque",)
    assert seaid.identifiability(leg, sensors).derivatives is None
