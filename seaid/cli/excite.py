"""Command excite: plan an exciting motion."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Option

import seaid
from seaid.cli.messages import is_stdout, is_terminal, written
from seaid.cli.options import (
    Description,
    Output,
    ResultOptions,
    RobotOptions,
    TorqueJoints,
    band_of,
    checked_suffix,
    logs_of,
    names,
    numbers,
    one_of,
    values,
)

if TYPE_CHECKING:
    from seaid.excitation import Excitation, Limits, Multisine, Stance, Trajectory
    from seaid.robot import Robot


_OF_ALL = "for all joints, or as knee=2,hip=1"


@dataclass(frozen=True)
class MotionOptions:
    """The kind of motion."""

    duration: Annotated[float, Option(help="Duration of the motion [s].")] = 10.0
    basis: Annotated[
        str,
        one_of(
            "basis",
            "bspline, fourier, polynomial, or multisine for frequency responses.",
            lambda: seaid.excitation.BasisName,
        ),
    ] = "bspline"
    ends_in_motion: Annotated[
        bool, Option("--ends-in-motion", help="Start and end in motion, with run-in and run-out.")
    ] = False
    rate_hz: Annotated[float, Option(help="Rate of the set-points [Hz].")] = 1000.0


@dataclass(frozen=True)
class MultisineOptions:
    """The shape of a multisine."""

    band: Annotated[
        str | None, Option(help="Multisine: lowest, highest frequency [Hz], as 0.5,20.")
    ] = None
    period_s: Annotated[
        float | None, Option(help="Multisine: period [s]; default: half of the duration.")
    ] = None
    spectrum: Annotated[
        str, Option(help="Multisine: equal amplitudes of position, velocity or acceleration.")
    ] = "acceleration"
    amplitude: Annotated[
        str | None,
        Option(help=f"Multisine: largest displacement [rad or m], {_OF_ALL}; 0 holds a joint."),
    ] = None
    posture: Annotated[
        str | None, Option(help=f"Mean position of a multisine, or posture in stance, {_OF_ALL}.")
    ] = None
    realisation: Annotated[int, Option(help="Multisine: number of the random phases.")] = 0
    experiment: Annotated[int, Option(help="Multisine: number of the orthogonal experiment.")] = 0

    def shape(self) -> Multisine:
        """Return the shape."""
        from seaid.excitation import Multisine

        return Multisine(
            band_hz=band_of(self.band),
            period_s=self.period_s,
            spectrum=self.spectrum,  # type: ignore[arg-type]  # checked by Multisine
            amplitude=values("--amplitude", self.amplitude),
            posture=values("--posture", self.posture),
            realisation=self.realisation,
            experiment=self.experiment,
        )


@dataclass(frozen=True)
class StanceOptions:
    """The contacts of a floating base that stand on the ground."""

    stance: Annotated[
        str | None,
        Option(help="Links of contacts that stand, as a,b: a floating base moves over them."),
    ] = None
    friction: Annotated[float, Option(help="Stance: friction coefficient.")] = 0.6
    sole_m: Annotated[
        str | None, Option(help="Stance: length, width of flat feet [m], as 0.2,0.1.")
    ] = None
    least_load: Annotated[
        float, Option(help="Stance: least normal force, over the weight per contact.")
    ] = 0.1

    def shape(self, posture: float | dict[str, float] | None, robot: Robot) -> Stance | None:
        """Return the stance; None without one."""
        from seaid.excitation import Stance

        if self.stance is None:
            return None
        sole = None
        if self.sole_m is not None:
            length, width = numbers("--sole-m", self.sole_m, "a length and a width, as 0.2,0.1", 2)
            sole = length, width
        every = dict.fromkeys(robot.joint_names, posture) if isinstance(posture, float) else posture
        return Stance(
            names(self.stance) or [],
            posture=every,
            friction=self.friction,
            sole_m=sole,
            least_load=self.least_load,
        )


@dataclass(frozen=True)
class LimitOptions:
    """The limits of a motion: a number for all joints, or one per joint."""

    lower: Annotated[str | None, Option(help=f"Lower position limit, {_OF_ALL}.")] = None
    upper: Annotated[str | None, Option(help=f"Upper position limit, {_OF_ALL}.")] = None
    velocity: Annotated[str | None, Option(help=f"Velocity limit [rad/s or m/s], {_OF_ALL}.")] = (
        None
    )
    acceleration: Annotated[
        str | None, Option(help=f"Acceleration limit [rad/s2 or m/s2], default 10, {_OF_ALL}.")
    ] = None
    joint_torque: Annotated[
        str | None, Option(help=f"Joint torque limit [N m or N], {_OF_ALL}.")
    ] = None

    motor_torque: Annotated[str | None, Option(help=f"Motor torque limit [N m], {_OF_ALL}.")] = None
    motor_speed: Annotated[str | None, Option(help=f"Motor speed limit [rad/s], {_OF_ALL}.")] = None
    deflection: Annotated[
        str | None, Option(help=f"Limit of the spring deflection [m or rad], {_OF_ALL}.")
    ] = None

    def limits(self) -> Limits:
        """Return the limits."""
        from seaid.excitation import Limits

        texts = vars(self).items()
        return Limits(**{name: values(f"--{name.replace('_', '-')}", text) for name, text in texts})


@dataclass(frozen=True)
class SearchOptions:
    """What a motion excites, and the search for it."""

    torque_joints: TorqueJoints = None
    criterion: Annotated[
        str,
        one_of(
            "criterion",
            "condition_number, d_optimality or relative_error.",
            lambda: seaid.excitation.CriterionName,
        ),
    ] = "condition_number"
    drive_parameters: Annotated[
        bool, Option("--drive-parameters", help="Excite friction and stiffness as well.")
    ] = False
    previous_logs: Annotated[
        list[Path] | None, Option(help="Log of a previous motion. May be repeated.")
    ] = None
    description: Description = None
    starts: Annotated[int, Option(help="Random starts of the search.")] = 3
    iterations: Annotated[int, Option(help="Iteration limit of the search.")] = 150
    seed: Annotated[int, Option(help="Seed of the random starts.")] = 0


def excite(
    options: RobotOptions,
    motion: MotionOptions,
    multisine: MultisineOptions,
    standing: StanceOptions,
    limits: LimitOptions,
    search: SearchOptions,
    *,
    joint_trajectory: Annotated[
        Path | None, Option(help="Also write it for ROS 2 trajectory controllers.", metavar="YAML")
    ] = None,
    output: Output = Path("excitation.json"),
    result: ResultOptions,
) -> None:
    """Plan a motion within limits that excites the parameters.

    The command writes the trajectory as JSON, and its set-points as CSV next to it. The motion
    starts and ends at rest; --ends-in-motion allows a better excitation. The default limits are
    those of the URDF. A multisine has random phases instead of a search, and a run-in and run-out.

    seaid excite leg.urdf --drives leg.toml --velocity 2.5 -o plan.json
    seaid excite arm.urdf --duration 20 --velocity shoulder=1,elbow=2 --torque-joints shoulder,elbow
    seaid excite leg.urdf --basis multisine --band 0.5,15 --amplitude hip=0.1,knee=0.2
    seaid excite arm.urdf --ends-in-motion --joint-trajectory arm.yaml -o plan.json
    seaid excite robot.urdf --base floating --contact a,b,c,d --stance a,b,c,d --posture knee=-1.5

    In stance the base sways over the contacts, and the motion of the base is a second CSV.
    """
    from seaid.excitation import add_run_in, design_excitation

    checked_suffix(output, ".json")
    set_points = None if is_stdout(output) else output.with_suffix(".csv")
    of_base = None
    if set_points is not None and standing.stance is not None:
        of_base = output.with_name(f"{output.stem}_base.csv")
    asked, rate_hz = limits.limits(), motion.rate_hz
    if not rate_hz > 0:
        raise typer.BadParameter(f"{rate_hz:g} is not more than zero", param_hint="--rate-hz")
    previous = search.previous_logs or []
    read = (options.urdf, options.drives, search.description, *previous)
    result.check(output, set_points, of_base, joint_trajectory, read=read)
    robot = options.robot()
    plan = design_excitation(
        robot,
        motion.duration,
        basis=motion.basis,  # type: ignore[arg-type]  # checked by one_of
        multisine=multisine.shape() if motion.basis == "multisine" else None,
        limits=asked,
        rest_to_rest=not motion.ends_in_motion,
        torque_joints=names(search.torque_joints),
        criterion=search.criterion,  # type: ignore[arg-type]
        drive_parameters=search.drive_parameters,
        stance=standing.shape(values("--posture", multisine.posture), robot),
        previous_logs=logs_of(previous, robot, search.description),
        starts=search.starts,
        iterations=search.iterations,
        seed=search.seed,
        progress=is_terminal(),
    )
    planned = plan.trajectory
    if motion.ends_in_motion or motion.basis == "multisine":
        planned = add_run_in(planned, robot, asked)
    with written(output, ".json") as file:
        planned.save(file)
    if set_points is not None:
        planned.save_set_points(set_points, rate_hz)
    if of_base is not None and plan.stance is not None:
        plan.stance.base.save_set_points(of_base, rate_hz)
    if joint_trajectory is not None:
        planned.save_joint_trajectory(joint_trajectory)
    text = _plan_text(robot.name, plan, planned)
    content = _content(plan, planned)
    result.show(text, content, output, set_points, of_base, joint_trajectory, robot=robot.name)


def _content(plan: Excitation, motion: Trajectory) -> dict[str, Any]:
    """Return a plan and its motion as the content of JSON."""
    content = {
        "duration_s": motion.duration,
        "main_interval_s": motion.main_interval,
        "condition_number": plan.condition_number,
        "measures": asdict(plan.measures),
        "criterion": plan.criterion,
        "value": plan.value,
        "parameters": [
            {"name": name, "unit": unit, "standard_error": error}
            for name, unit, error in zip(plan.names, plan.units, plan.standard_errors, strict=True)
        ],
    }
    if plan.stance is not None:
        keys = ("friction_used", "least_normal_force")
        content["stance"] = {key: getattr(plan.stance, key) for key in keys}
    return content


def _plan_text(name: str, plan: Excitation, motion: Trajectory) -> str:
    from seaid.report import condition_lines

    begin, end = motion.main_interval
    total = f" ({motion.duration:.4g} s with run-in and run-out)"
    run_ins = total if end - begin < motion.duration else ""
    return "\n".join(
        [
            f"{name}: a motion of {end - begin:.4g} s{run_ins} for {len(plan.names)} parameters; "
            f"{plan.criterion} {plan.value:.4g}",
            *condition_lines(plan),
            *([] if plan.stance is None else [f"in stance: {plan.stance._in_short()}"]),
        ]
    )
