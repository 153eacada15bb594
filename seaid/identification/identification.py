"""`identify`: the actuator side first, then the load side with its springs, or both at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from types import MappingProxyType

from seaid.errors import IdentificationError, checked
from seaid.estimation import EstimatorName
from seaid.identification.datasets import Source, sources_of
from seaid.identification.motor_side import without_joint_encoder
from seaid.identification.motors_alone import identify_from_motors
from seaid.identification.options import Method, Options
from seaid.identification.problem import concluded, solved
from seaid.identification.result import Identification
from seaid.log import Log
from seaid.robot import Robot


@checked(IdentificationError)
def identify(
    robot: Robot,
    logs: Source | Sequence[Source],
    *,
    torque_joints: str | Sequence[str] | None = None,
    method: Method = "auto",
    estimator: EstimatorName = "wls",
    feasible: bool = False,
    cutoff_hz: float | None = None,
    encoder_offset_std: float = 0.0,
    known_std: Mapping[str, float] = MappingProxyType({}),
    executor: Executor | None = None,
    progress: bool = False,
) -> Identification:
    """Identify the drives and the load of a robot from one log or several.

    Part one estimates friction, stiffness and spring offset of each elastic joint from its motor
    equation (7). Part two computes the load torques from the springs by (4b) and estimates the base
    parameters from the load side (8), with the uncertainty of the springs propagated. Where the
    data support it, both equations are then solved at once.

    Of `robot` only ratios, radii, geometry, payloads and known values enter the estimate, and with
    `feasible` its inertial parameters as a prior; nominal values are only starts of a search.
    Parameters in which a drive equation is nonlinear (a width, a Stribeck speed, a dead zone) are
    first searched by variable projection (in the first piece of a log that is read in pieces); then
    they have a column and a standard error like all others.

    Parameters
    ----------
    robot : Robot
        The robot model of `load_robot`.
    logs : Log, LongLog, path, or a sequence of them
        Logs in memory, or log files with standard column names that are read in pieces: with "ols"
        and "wls" memory does not grow with their length.
    torque_joints : sequence of str, optional
        Joints whose torque is used on the load side. Default: all with a measured torque.
    method : {"auto", "two-step", "simultaneous"}
        "two-step" is that of the paper. "simultaneous" continues from it to (7) and (8) in one
        regression that shares the springs. "auto" takes the latter, which is the more accurate one,
        if the equations of two steps lack nothing, and if both agree; `Identification.not_shared`
        says why not.
    estimator : {"wls", "ols", "huber", "tukey", "iv"}
        Least squares weighted per joint or ordinary, robust estimators, or instrumental variables
        from the fitted model against the bias by noise in the regressor (two-step only). Logs
        without the joint position of a spring refuse "iv", and the method "simultaneous".
    feasible : bool
        Make `Identification.robot` physically consistent; see `feasible_parameters`.
    cutoff_hz : float, optional
        Cutoff of the low pass. Default: proposed from the data.
    encoder_offset_std : float
        Standard deviation of the joint encoder offsets [rad or m], propagated to the load side.
    known_std : mapping {constant: relative standard deviation}
        Of what was given as known: "torque" (one scale error common to all torques), "payload"
        (mass), "bodies" (each known body, by a scale of its own), "motor_inertia_kg_m2",
        "gear_ratio", "motor_pulley_radius_m", "load_pulley_radius_m"; propagated to all estimates.
        A drive's own `std` takes precedence.
    executor : concurrent.futures.Executor, optional
        Processes the logs, one per task.
    progress : bool
        Show progress bars.

    Returns
    -------
    Identification

    Raises
    ------
    IdentificationError, ExcitationError, LogError
        For wrong options, for a motion that leaves parameters unidentifiable, for logs that do not
        fit the robot.

    Examples
    --------
    >>> robot = seaid.load_robot("leg.urdf", "leg.toml")
    >>> result = seaid.identify(robot, seaid.read_log("run.csv", robot), feasible=True)
    >>> print(result.summary())
    """
    robot.selected(torque_joints)  # refuses unknown joints before a log is read
    options = Options(
        torque_joints=torque_joints,
        method=method,
        estimator=estimator,
        feasible=feasible,
        cutoff_hz=cutoff_hz,
        encoder_offset_std=encoder_offset_std,
        known_std=known_std,
        executor=executor,
        progress=progress,
    )
    sources = sources_of(logs)
    in_memory = [source for source in sources if isinstance(source, Log)]
    unseen = without_joint_encoder(robot, in_memory) if len(in_memory) == len(sources) else ()
    if unseen:
        return identify_from_motors(robot, in_memory, unseen, options, identify)
    return concluded(solved({"": robot}, {"": sources}, options), "")
