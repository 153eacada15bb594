"""Plan an exciting motion for any robot: `design_excitation.py robot.urdf [drives.toml]`.

The motion keeps the limits of the URDF and of the options at every instant. The result folder has
excitation.json (for `seaid.load_trajectory`), excitation.csv (set-points), joint_trajectory.yaml
(for ROS 2) and excitation.png. `--help` lists the options.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path
from textwrap import shorten

import numpy as np

import seaid
from seaid._arrays import Array
from seaid._files import result_folder
from seaid.excitation.basis import BASES
from seaid.excitation.criteria import CRITERIA
from seaid.excitation.limits import margins
from seaid.regressor.load import load_model
from seaid.report import table
from seaid.report.formats import number, percent

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.excitation_figure import save_excitation_figure

LIMIT_NAMES = ("lower", "upper", "velocity", "acceleration", "joint_torque")


def main(arguments: argparse.Namespace) -> None:
    """Load, plan, print, write."""
    begin = time.perf_counter()
    if not arguments.rate > 0:
        raise seaid.errors.ExcitationError(
            f"--rate must be more than zero, found {arguments.rate:g}"
        )
    robot = seaid.load_robot(arguments.urdf, arguments.toml, joints=arguments.joints)
    output = result_folder(arguments.output or Path("out/excitation") / robot.name)
    limits = seaid.Limits(**{name: getattr(arguments, name) for name in LIMIT_NAMES})
    plan = seaid.design_excitation(
        robot,
        arguments.duration,
        basis=arguments.basis,
        coefficients=arguments.coefficients,
        limits=limits,
        rest_to_rest=not arguments.ends_in_motion,
        torque_joints=arguments.torque_joints,
        criterion=arguments.criterion,
        drive_parameters=arguments.drives,
        torque_std=arguments.torque_std,
        previous_logs=[seaid.read_log(path, robot) for path in arguments.previous_logs],
        starts=arguments.starts,
        iterations=arguments.iterations,
        seed=arguments.seed,
        progress=True,
    )
    motion = plan.trajectory
    if arguments.ends_in_motion:
        motion = seaid.excitation.add_run_in(motion, robot, limits)

    print(head(robot, arguments, plan, motion))
    title = f"Expected standard errors, torque noise {arguments.torque_std:g} N m at 1 kHz"
    print(parameter_table(title, robot, arguments.torque_joints, plan))
    print(margin_table("Limits, and the smallest distance to them", robot, plan, motion))
    motion.save(output / "excitation.json")
    motion.save_set_points(output / "excitation.csv", arguments.rate)
    motion.save_joint_trajectory(output / "joint_trajectory.yaml")
    save_excitation_figure(
        motion,
        plan.limits,
        output / "excitation.png",
        plan.start_singular_values,
        plan.singular_values,
    )
    print(f"{time.perf_counter() - begin:.0f} s. Results: {output}/")


def head(
    robot: seaid.Robot,
    arguments: argparse.Namespace,
    plan: seaid.Excitation,
    motion: seaid.Trajectory,
) -> str:
    """Return a summary of the plan, with criterion and condition number before and after."""
    begin, end = motion.main_interval
    ends = (
        f"run-in to {begin:.3g} s, run-out from {end:.3g} s"
        if arguments.ends_in_motion
        else "at rest"
    )
    previous_logs = (
        f", after {len(arguments.previous_logs)} previous logs" if arguments.previous_logs else ""
    )
    first, last = (
        singular[0] / singular[-1]
        for singular in (plan.start_singular_values, plan.singular_values)
    )
    rows = robot.selected(arguments.torque_joints)
    lines = [
        f"{robot.name}: {len(plan.names)} parameters{previous_logs}",
        f"known torques: {', '.join(rows)}",
        f"motion: {arguments.basis}, {motion.duration:.3g} s, ends: {ends}",
        f"criterion: {CRITERIA[plan.criterion].meaning}, {before(plan)}planned {plan.value:.4g}",
        f"condition number of its scaled columns: random start {first:.4g}, planned {last:.4g}",
        f"condition number of the {len(plan.base.columns)} base columns of this motion alone: "
        f"{plan.condition_number:.4g}",
    ]
    return "\n".join(lines)


def before(plan: seaid.Excitation) -> str:
    """Return the criterion of the best random start, if its singular values determine it."""
    singular = plan.start_singular_values
    if plan.criterion == "d_optimality":
        return f"random start {np.exp(-np.mean(np.log(singular))):.4g}, "
    if plan.criterion == "condition_number":
        return f"random start {singular[0] / singular[-1]:.4g}, "
    return ""


def parameter_table(
    title: str, robot: seaid.Robot, rows: list[str] | None, plan: seaid.Excitation
) -> str:
    """Return the table of parameters with nominal values and expected standard errors.

    Long groupings are cut; `seaid.base_parameters(robot).expressions` has the full ones.
    """
    nominal = nominal_of(robot, rows, plan)
    relative = plan.standard_errors / np.where(nominal == 0, np.nan, np.abs(nominal))
    entries = [
        [shorten(name, 56, placeholder=" ..."), number(value), number(error), percent(share), unit]
        for name, value, error, share, unit in zip(
            plan.names, nominal, plan.standard_errors, relative, plan.units, strict=True
        )
    ]
    return table(title, ["parameter", "nominal", "std. error", "rel.", "unit"], entries)


def nominal_of(robot: seaid.Robot, rows: list[str] | None, plan: seaid.Excitation) -> Array:
    """Return the nominal values of the parameters (p,), NaN for those without one."""
    model = load_model(robot, plan.base, robot.selected(rows))
    drives = {
        (joint, name): value
        for joint, drive in robot.drives.items()
        for name, value in drive.values.items()
    }
    values = plan.base.project(robot.parameters)
    if len(plan.names) > len(values):  # with drives: base parameters include their rotor inertias
        absorbed = [drives.get((joint, name), np.nan) for joint, name, _ in model.absorbed]
        used = model.absorption[: len(values)]
        values = values + np.where(used == 0, 0.0, used * absorbed).sum(axis=1)
    others = [name.rpartition(" of ") for name in plan.names[len(values) :]]
    return np.append(values, [drives.get((joint, name), np.nan) for name, _, joint in others])


def margin_table(
    title: str, robot: seaid.Robot, plan: seaid.Excitation, motion: seaid.Trajectory
) -> str:
    """Return the table of limits and margins per joint, of the torque if it is limited.

    The torque is that of the planned motion, without a run-in.
    """
    kept, limits = margins(motion, plan.limits), plan.limits
    torque = plan.margins.joint_torque
    torque = np.full(robot.n, np.inf) if torque is None else torque
    lines = []
    for index, joint in enumerate(robot.joint_names):
        unit = "m" if robot.is_prismatic[index] else "rad"
        line = [
            joint,
            f"{limits.lower[index]:.4g} .. {limits.upper[index]:.4g} {unit}",
            number(kept.position[index]),
            f"{limits.velocity[index]:.4g} {unit}/s",
            number(kept.velocity[index]),
            f"{limits.acceleration[index]:.4g} {unit}/s2",
            number(kept.acceleration[index]),
        ]
        lines.append([*line, number(torque[index])])
    header = ["joint", "position", "left", "velocity", "left", "acceleration", "left"]
    return table(title, [*header, "torque left"], lines)


def names(text: str) -> list[str]:
    """Return the names in a comma-separated list."""
    return [name.strip() for name in text.split(",")]


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    shown = argparse.ArgumentDefaultsHelpFormatter
    found = argparse.ArgumentParser(
        description=(__doc__ or "").splitlines()[0], formatter_class=shown
    )
    add = found.add_argument
    add("urdf", type=Path, help="the robot")
    add("toml", type=Path, nargs="?", help="its drives")
    add("--duration", type=float, default=10.0, help="of the motion, s")
    add("--basis", choices=BASES, default="bspline", help="functions that the motion is a sum of")
    add("--coefficients", type=int, help="per joint; default: from duration and number of joints")
    add("--lower", type=float, help="least position of all joints, rad or m; default: the URDF's")
    add("--upper", type=float, help="largest position of all joints; default: the URDF's")
    add("--velocity", type=float, help="limit of all joints, rad/s or m/s; default: the URDF's")
    add("--acceleration", type=float, default=10.0, help="limit of all joints, rad/s2 or m/s2")
    add("--joint-torque", type=float, help="limit of all joints, N m or N; default: the URDF's")
    add("--joints", type=names, help="moving joints, as a,b,c; the others are locked at zero")
    add("--torque-joints", type=names, help="joints whose torque is known, as a,b,c; default: all")
    add("--criterion", choices=tuple(CRITERIA), default="condition_number", help="to minimise")
    add("--drives", action="store_true", help="excite friction and stiffness of the drives as well")
    add("--torque-std", type=float, default=1.0, help="torque noise at the joints, N m")
    add("--ends-in-motion", action="store_true", help="ends in motion, with a run-in and a run-out")
    add("--previous-logs", type=Path, nargs="+", default=[], metavar="LOG", help="known already")
    add("--rate", type=float, default=1000.0, help="of the set-points, 1/s")
    add("--starts", type=int, default=3, help="random starts of the search")
    add("--iterations", type=int, default=150, help="of the search, at most")
    add("--seed", type=int, default=0, help="of the random starts")
    add("--output", type=Path, help="result folder; default: out/excitation/<robot>")
    return found


if __name__ == "__main__":
    warnings.formatwarning = lambda message, *_: f"note: {message}\n"
    try:
        main(parser().parse_args())
    except seaid.SeaidError as error:
        sys.exit(f"error: {error}")
