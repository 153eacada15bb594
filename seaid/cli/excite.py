"""Command excite: plan an exciting motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import seaid
from seaid._progress import counted
from seaid.cli import kinds
from seaid.cli.messages import is_terminal
from seaid.cli.options import ResultOptions, RobotOptions, by_joint, logs_of, refuse


@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """The kind of motion.

    Parameters
    ----------
    duration
        Duration of the motion [s].
    basis
        bspline, fourier, polynomial, or multisine for frequency responses.
    ends_in_motion
        Start and end in motion, with run-in and run-out.
    rate_hz
        Rate of the set-points [Hz].
    """

    duration: float = 10.0
    basis: Literal["bspline", "polynomial", "fourier", "multisine"] = "bspline"
    ends_in_motion: bool = False
    rate_hz: float = 1000.0


@dataclass(frozen=True, kw_only=True)
class MultisineOptions:
    """The shape of a multisine.

    Parameters
    ----------
    band
        Multisine: lowest, highest frequency [Hz], as 0.5,20.
    period_s
        Multisine: period [s]; default: half of the duration.
    spectrum
        Multisine: equal amplitudes of position, velocity or acceleration.
    amplitude
        Multisine: largest displacement [rad or m], 0 to hold a joint
    posture
        Mean position of a multisine, or posture in stance
    realisation
        Multisine: number of the random phases.
    experiment
        Multisine: number of the orthogonal experiment.
    """

    band: kinds.Band | None = None
    period_s: float | None = None
    spectrum: Literal["position", "velocity", "acceleration"] = "acceleration"
    amplitude: kinds.ByJoint | None = None
    posture: kinds.ByJoint | None = None
    realisation: int = 0
    experiment: int = 0

    def shape(self, basis: str) -> seaid.Multisine | None:
        """Return the shape; None for a motion with another basis."""
        if basis != "multisine":
            return None
        values = dict(vars(self))
        return seaid.Multisine(band_hz=values.pop("band"), **values)


@dataclass(frozen=True, kw_only=True)
class StanceOptions:
    """The contacts of a floating base that stand on the ground.

    Parameters
    ----------
    stance
        Links of contacts that stand, as a,b: a floating base moves over them.
    friction
        Stance: friction coefficient.
    sole_m
        Stance: length, width of flat feet [m], as 0.2,0.1.
    least_load
        Stance: least normal force, over the weight per contact.
    """

    stance: kinds.Names | None = None
    friction: float = 0.6
    sole_m: kinds.Sole | None = None
    least_load: float = 0.1

    def shape(
        self, posture: float | dict[str, float] | None, robot: seaid.Robot
    ) -> seaid.excitation.Stance | None:
        """Return the stance; None without one."""
        if self.stance is None:
            return None
        every = None if posture is None else by_joint("--posture", posture, robot)
        values = dict(vars(self))
        return seaid.excitation.Stance(values.pop("stance"), posture=every, **values)


@dataclass(frozen=True, kw_only=True)
class LimitOptions:
    """The limits of a motion: a number for all joints, or one per joint.

    Parameters
    ----------
    lower
        Lower position limit
    upper
        Upper position limit
    velocity
        Velocity limit [rad/s or m/s]
    acceleration
        Acceleration limit [rad/s2 or m/s2], default 10
    joint_torque
        Joint torque limit [N m or N]
    motor_torque
        Motor torque limit [N m]
    motor_speed
        Motor speed limit [rad/s]
    deflection
        Limit of the spring deflection [m or rad]
    """

    lower: kinds.ByJoint | None = None
    upper: kinds.ByJoint | None = None
    velocity: kinds.ByJoint | None = None
    acceleration: kinds.ByJoint | None = None
    joint_torque: kinds.ByJoint | None = None
    motor_torque: kinds.ByJoint | None = None
    motor_speed: kinds.ByJoint | None = None
    deflection: kinds.ByJoint | None = None


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """What a motion excites, and the search for it.

    Parameters
    ----------
    criterion
        condition_number, d_optimality or relative_error.
    drive_parameters
        Excite friction and stiffness as well.
    previous_logs
        Log of a previous motion.
    starts
        Random starts of the search.
    iterations
        Iteration limit of the search.
    seed
        Seed of the random starts.
    """

    torque_joints: kinds.Names | None = None
    criterion: Literal["condition_number", "d_optimality", "relative_error"] = "condition_number"
    drive_parameters: bool = False
    previous_logs: tuple[kinds.LogFile, ...] = ()
    description: kinds.TomlFile | None = None
    starts: int = 3
    iterations: int = 150
    seed: int = 0

    def keywords(self, robot: seaid.Robot) -> dict[str, Any]:
        """Return keyword arguments of `design_excitation`."""
        keywords = dict(vars(self))
        description = keywords.pop("description")
        return {**keywords, "previous_logs": logs_of(self.previous_logs, robot, description)}


def excite(
    options: RobotOptions,
    motion: MotionOptions,
    multisine: MultisineOptions,
    standing: StanceOptions,
    limits: LimitOptions,
    search: SearchOptions,
    *,
    joint_trajectory: kinds.YamlFile | None = None,
    output: kinds.Plan = Path("excitation.json"),
    result: ResultOptions,
) -> None:
    """Plan a motion within limits that excites the parameters.

    The command writes the trajectory as JSON, and its set-points as CSV next to it. The motion
    starts and ends at rest; --ends-in-motion allows a better excitation. The default limits are
    those of the URDF. A multisine has random phases instead of a search, and a run-in and run-out.
    In stance the base sways over the contacts, and the motion of the base is a second CSV.

    Parameters
    ----------
    joint_trajectory
        Also write it for ROS 2 trajectory controllers.

    Examples
    --------
    seaid excite leg.urdf --drives leg.toml --velocity 2.5 -o plan.json
    seaid excite arm.urdf --duration 20 --velocity shoulder=1,elbow=2 --torque-joints shoulder,elbow
    seaid excite leg.urdf --basis multisine --band 0.5,15 --amplitude hip=0.1,knee=0.2
    seaid excite arm.urdf --ends-in-motion --joint-trajectory arm.yaml -o plan.json
    seaid excite robot.urdf --base floating --contact a,b,c,d --stance a,b,c,d --posture knee=-1.5
    """
    set_points = output.with_suffix(".csv")
    of_base = output.with_name(f"{output.stem}_base.csv") if standing.stance else None
    asked, rate_hz = seaid.Limits(**vars(limits)), motion.rate_hz
    if not rate_hz > 0:
        refuse(f"{rate_hz:g} is not more than zero", "rate_hz")
    read = (*options.files, search.description, *search.previous_logs)
    robot = options.robot()
    result.check(output, set_points, of_base, joint_trajectory, read=read)
    plan = seaid.design_excitation(
        robot,
        motion.duration,
        basis=motion.basis,
        multisine=multisine.shape(motion.basis),
        limits=asked,
        rest_to_rest=not motion.ends_in_motion,
        stance=standing.shape(multisine.posture, robot),
        progress=is_terminal(),
        **search.keywords(robot),
    )
    planned = plan.trajectory
    if motion.ends_in_motion or motion.basis == "multisine":
        planned = seaid.excitation.add_run_in(planned, robot, asked)
    planned.save(output)
    planned.save_set_points(set_points, rate_hz)
    if of_base is not None and plan.stance is not None:
        plan.stance.base.save_set_points(of_base, rate_hz)
    if joint_trajectory is not None:
        planned.save_joint_trajectory(joint_trajectory)
    text = _plan_text(robot.name, plan, planned)
    names = ("condition_number", "measures", "criterion", "value", "names", "standard_errors")
    content = {name: getattr(plan, name) for name in names}
    content |= {"duration_s": planned.duration, "main_interval_s": planned.main_interval}
    result.show(text, content, output, set_points, of_base, joint_trajectory, robot=robot.name)


def _plan_text(name: str, plan: seaid.Excitation, motion: seaid.Trajectory) -> str:

    begin, end = motion.main_interval
    total = f" ({motion.duration:.4g} s with run-in and run-out)"
    run_ins = total if end - begin < motion.duration else ""
    text = f"{name}: a motion of {end - begin:.4g} s{run_ins} for "
    text += f"{counted(len(plan.names), 'parameter')}; "
    text += f"{plan.criterion} {plan.value:.4g}"
    stance = [] if plan.stance is None else [f"in stance: {plan.stance._in_short()}"]
    return "\n".join([text, *seaid.report.condition_lines(plan), *stance])
