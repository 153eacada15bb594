"""Logs of a trotting Solo12 as public data sets have them, by `seaid init` and `seaid run` alone.

Run from the folder of the project: python -m scripts.benchmarks.legged_logs [form ...]
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.io import savemat
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

import seaid
from scripts.benchmarks.legged import quadruped
from scripts.example_robots import example_urdf
from scripts.legged_plant import HOME, SOLO12, changed_bodies, foot_positions, plant, trot
from scripts.short_form import sized, words
from seaid._arrays import Array
from seaid.legged import whole_body

DURATION_S, RATE_HZ = sized(20.0, 4.0), 1000
FRICTION, VISCOUS, ROTOR = 0.02, 0.01, 8e-4
"""Of each joint [N m], [N m s/rad], [kg m^2]."""

Signals = Mapping[str, Array]


def targets(robot: seaid.Robot, seed: int) -> CubicSpline:
    """Return the joint angles of a trot."""
    trotting = trot(robot, SOLO12, DURATION_S, seed)
    return CubicSpline(trotting.time, trotting.angles)


def simulated(robot: seaid.Robot, seed: int) -> Signals:
    """Return the noisy signals of the robot on the ground, with friction and rotors."""
    model, wanted = plant(robot), targets(robot, seed)
    data, rates = mujoco.MjData(model), wanted.derivative()
    joints = [model.joint(name) for name in robot.joint_names]
    places, dofs = [x.qposadr[0] for x in joints], [x.dofadr[0] for x in joints]
    model.dof_frictionloss[dofs], model.dof_damping[dofs] = FRICTION, VISCOUS
    model.dof_armature[dofs] = ROTOR
    feet = {model.geom(foot).id: k for k, foot in enumerate(SOLO12.feet)}
    data.qpos[3:7], data.qpos[places] = [1, 0, 0, 0], HOME
    data.qpos[2] = SOLO12.radius_m - np.mean(foot_positions(robot, HOME[None])[0, :, 2])
    step_s, rows = model.opt.timestep, []
    for step in range(-round(1 / step_s), round((DURATION_S - 0.02) / step_s)):
        t = max(step * step_s, 0.0)
        speed = rates(t) if step > 0 else np.zeros(robot.n)
        torque = SOLO12.stiffness * (wanted(t) - data.qpos[places])
        torque += SOLO12.damping * (speed - data.qvel[dofs])
        data.qfrc_applied[dofs] = np.clip(torque, -SOLO12.torque_limit, SOLO12.torque_limit)
        mujoco.mj_forward(model, data)
        if step >= 0 and step % round(1 / (RATE_HZ * step_s)) == 0:
            force = np.zeros(4)
            for place, contact in enumerate(data.contact):
                own = np.empty(6)
                mujoco.mj_contactForce(model, data, place, own)
                for geom in (contact.geom1, contact.geom2):
                    if geom in feet:
                        force[feet[geom]] += np.linalg.norm(own[:3])
            v, a = data.qvel, data.qacc
            now = (data.qpos[:3], data.qpos[3:7], data.qpos[places], v[:6], v[dofs], a[:6], a[dofs])
            rows.append(np.concatenate([[t], *now, data.qfrc_applied[dofs], force]))
        mujoco.mj_step(model, data)
    widths = np.cumsum([1, 3, 4, 12, 3, 3, 12, 3, 3, 12, 12])
    t, p, turn, q, v, w, dq, a, e, ddq, tau, force = np.split(np.array(rows), widths, axis=1)
    rng, R = np.random.default_rng(seed), Rotation.from_quat(turn[:, [1, 2, 3, 0]])

    def noisy(values: Array, size: float) -> Array:
        return np.asarray(values + size * rng.normal(size=values.shape))

    jitter = Rotation.from_rotvec(3e-4 * rng.normal(size=(len(t), 3)))
    return {
        "t": t[:, 0],
        "p": noisy(p, 1e-4),
        "xyzw": (R * jitter).as_quat(),
        "q": noisy(q, 2e-4),
        "v": noisy(v, 3e-3),
        "v_base": noisy(R.inv().apply(v), 3e-3),
        "w": noisy(w, 5e-3),
        "dq": noisy(dq, 5e-3),
        "a": noisy(np.hstack([R.inv().apply(a), e, ddq]), 0.2),
        "f": noisy(R.inv().apply(a + np.array([0, 0, 9.81])), 0.05),
        "tau": noisy(tau, SOLO12.torque_limit / 450),
        "force": force,
        "flag": (force > 0).astype(float),
    }


def states(one: Signals) -> dict[str, Array]:
    """Return the states of base and joints, quaternions xyzw, velocities in the base."""
    return {
        "q": np.hstack([one["p"], one["xyzw"], one["q"]]),
        "dq": np.hstack([one["v_base"], one["w"], one["dq"]]),
        "ddq": one["a"],
        "tau": one["tau"],
        "contact": one["flag"],
    }


def legs(one: Signals, *order: int) -> Signals:
    """Return the signals with the legs in another order."""
    joints = np.concatenate([np.arange(3 * k, 3 * k + 3) for k in order])
    own = {name: one[name][:, joints] for name in ("q", "dq", "tau")}
    return {**one, **own, **{name: one[name][:, order] for name in ("flag", "force")}}


def rows_of_channels(one: Signals, folder: Path) -> list[Path]:
    """A text file per quantity with a channel in each row, 1000 Hz."""
    for name, values in states(one).items():
        np.savetxt(folder / f"robot_{name}.dat", values.T, delimiter="\t", fmt="%.8g")
    return [folder / f"robot_{name}.dat" for name in states(one)]


def one_table(one: Signals, folder: Path) -> list[Path]:
    """A CSV without names: time, q, v, torques and flags, 500 Hz."""
    parts = [one["t"], *(x for name, x in states(one).items() if name != "ddq")]
    np.savetxt(folder / "all.csv", np.column_stack(parts)[::2], delimiter=",", fmt="%.9g")
    return [folder / "all.csv"]


def right_legs_first(one: Signals, folder: Path) -> list[Path]:
    """A MAT file with legs FR FL HR HL, quaternions wxyz, velocities in the world, foot forces."""
    one = legs(one, 1, 0, 3, 2)
    q = np.hstack([one["p"], one["xyzw"][:, [3, 0, 1, 2]], one["q"]])
    dq = np.hstack([one["v"], one["w"], one["dq"]])
    arrays = {"q": q, "dq": dq, "tau": one["tau"], "foot_force": one["force"], "t": one["t"]}
    savemat(folder / "walk.mat", {name: values[::2].T for name, values in arrays.items()})
    return [folder / "walk.mat"]


def hips_first(one: Signals, folder: Path) -> list[Path]:
    """Named arrays at 200 Hz, all hips first, as simulators of many robots have them."""
    group = np.arange(12).reshape(4, 3).T.ravel()
    base = {"base_pos": one["p"], "base_quat": one["xyzw"], "base_lin_vel": one["v_base"]}
    joints = {f"joint_{x}": one[y][:, group] for x, y in (("pos", "q"), ("torque", "tau"))}
    base |= {"base_ang_vel": one["w"], **joints, "foot_contact": one["flag"]}
    np.savez(folder / "run.npz", timestamps=one["t"][::5], **{x: y[::5] for x, y in base.items()})  # type: ignore[arg-type]
    return [folder / "run.npz"]


def averaged(one: Signals, folder: Path) -> list[Path]:
    """The same at 200 Hz with the means of five samples, as of a filter in front of the log."""
    mean = {x: uniform_filter1d(y, 5, axis=0) for x, y in one.items()}
    return hips_first({**mean, **{x: one[x] for x in ("t", "flag", "force")}}, folder)


def imu_without_flags(one: Signals, folder: Path) -> list[Path]:
    """An IMU and joints without any flag of a contact, 1000 Hz."""
    np.savez(
        folder / "data.npz",
        q_mes=one["q"],
        v_mes=one["dq"],
        torquesFromCurrentMeasurment=one["tau"],
        baseOrientationQuat=one["xyzw"],
        baseAngularVelocity=one["w"],
        baseAccelerometer=one["f"],
        energy=np.arange(len(one["t"])),
        tstamps=one["t"],
    )
    return [folder / "data.npz"]


FORMS: dict[str, tuple[Callable[[Signals, Path], list[Path]], float | None]] = {
    "rows": (rows_of_channels, RATE_HZ),
    "table": (one_table, None),
    "right": (right_legs_first, None),
    "hips": (hips_first, None),
    "averaged": (averaged, None),
    "imu": (imu_without_flags, None),
}


def main() -> None:
    """Print what the two commands make of each form."""
    with tempfile.TemporaryDirectory() as place:
        urdf = changed_bodies(example_urdf(SOLO12.urdf), Path(place), 1)
        robot = quadruped(SOLO12, urdf)
        one, mass = simulated(robot, 1), float(robot.parameters[::10].sum())
        for name in words() or FORMS:
            write, rate_hz = FORMS[name]
            folder = Path(place) / name
            folder.mkdir()
            start = time.perf_counter()
            seaid.write_first_project(
                example_urdf(SOLO12.urdf),
                write(one, folder),
                folder=folder,
                base="floating",
                contacts=SOLO12.contacts,
                rate_hz=rate_hz,
            )
            project = seaid.load_project(folder / "seaid.toml")
            found = seaid.run_project(project).runs[""].identification
            whole = whole_body(found)[0]
            own, blocks = found.residual
            print(
                f"{name}: {found.verdict.level}, {len(found.load.values)} parameters, residual "
                f"{own:.2%}, excluded blocks {blocks:.2%}, mass {whole.value - mass:+.4f} kg "
                f"+- {whole.standard_error:.4f}, {time.perf_counter() - start:.0f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
