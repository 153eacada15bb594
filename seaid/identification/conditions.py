"""Several conditions at once: with and without payload, warm and cold, several robots of one type.

Shared parameters are estimated from all conditions, condition-specific ones from each: in one
regression per side, in which a specific column occurs once per condition. Two payloads, one of
them known, identify what one condition cannot, such as the torque constant of a motor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from seaid._arrays import FrozenMapping
from seaid._progress import MOST_NAMES, Result, counted
from seaid.drives import PARAMETERS, ParameterName
from seaid.errors import Hertz, IdentificationError, check_name, checked, listed, shown
from seaid.estimation import TermTest
from seaid.estimation.estimate import independent_rows
from seaid.estimation.fitting import LinearEstimator
from seaid.estimation.parameters import shared_parameters, with_groups
from seaid.identification.conclusion import conclude
from seaid.identification.datasets import Source, sources_of
from seaid.identification.problem import Options, solve
from seaid.identification.result import Identification
from seaid.identification.two_step import BODIES, SpecificParameters, TwoStepFits
from seaid.robot import Robot

CONDITION_SPECIFIC = ("spring_offset", "deflection_zero")
"""Default: encoders are zeroed anew when a robot is switched on."""


@dataclass(frozen=True, eq=False, repr=False)
class Conditions(Result):
    """The identifications of several conditions.

    Attributes
    ----------
    identifications : mapping {condition: Identification}
        One per condition, with equal shared parameters.
    condition_specific : tuple of str
        The parameters that are not shared.
    differences : mapping {parameter: TermTest}
        Test per specific parameter of whether the conditions differ in it.
    """

    table_name = "conditions_table"

    identifications: Mapping[str, Identification]
    condition_specific: tuple[str, ...]
    differences: Mapping[str, TermTest]

    def _in_short(self) -> str:
        differ = sum(test.bic > 0 for test in self.differences.values())
        specific = counted(len(self.differences), "specific parameter")
        return f"{listed(self.identifications, MOST_NAMES)}: {specific}, differing: {differ}"


@checked(IdentificationError)
def identify_conditions(
    conditions: Mapping[str, tuple[Robot, Source | Sequence[Source]]],
    *,
    condition_specific: Sequence[str] = CONDITION_SPECIFIC,
    torque_joints: str | Sequence[str] | None = None,
    estimator: LinearEstimator = "wls",
    feasible: bool = False,
    cutoff_hz: Hertz | None = None,
    encoder_offset_std: float = 0.0,
    known_std: Mapping[str, float] = MappingProxyType({}),
    share: Mapping[str, Sequence[str]] = MappingProxyType({}),
    progress: bool = False,
) -> Conditions:
    """Identify several conditions together, by the two-step method.

    Parameters
    ----------
    conditions : mapping {condition: (robot, logs)}
        The robots are of one type, with the same URDF and drives; their payloads may differ.
    condition_specific : sequence of str
        Parameters estimated per condition, for all joints ("viscous_friction") or for one
        ("viscous_friction of knee"), or "bodies" for the base parameters. All others are shared.
    torque_joints, estimator, feasible, cutoff_hz, encoder_offset_std, known_std, share, progress
        As in `identify`; a constant has one error in all conditions. Nonlinear drive equations are
        linearised near values of the first condition, and each has encoder offsets of its own.

    Returns
    -------
    Conditions

    Raises
    ------
    IdentificationError
        For less than two conditions, for unknown names, and for robots that differ in joints,
        drives or base parameters; further errors as in `identify`.

    Examples
    --------
    >>> both = seaid.identify_conditions(
    ...     {"cold": (robot, cold_log), "warm": (robot, warm_log)},
    ...     condition_specific=("spring_offset", "viscous_friction"),
    ... )
    >>> print(both.summary())
    """
    _check_conditions(conditions)
    robots = {name: robot for name, (robot, _) in conditions.items()}
    first = next(iter(robots.values()))
    _check_joints(robots)
    _check_specific(first, condition_specific)
    if share:
        robots = {x: y.with_drives(with_groups(y.drives, share)) for x, y in robots.items()}
    first.selected(torque_joints)  # refuses unknown joints before a log is read
    options = Options(
        torque_joints=torque_joints,
        method="two-step",
        estimator=estimator,
        feasible=feasible,
        cutoff_hz=cutoff_hz,
        encoder_offset_std=encoder_offset_std,
        known_std=known_std,
        progress=progress,
        specific=SpecificParameters(tuple(condition_specific)),
    )
    sources = {name: sources_of(logs) for name, (_, logs) in conditions.items()}
    problem = solve(robots, sources, options)
    parts = {name: conclude(problem, name) for name in robots}
    tests = FrozenMapping(_differences(problem.fits))
    return Conditions(FrozenMapping(parts), tuple(condition_specific), tests)


def _differences(fits: TwoStepFits) -> dict[str, TermTest]:
    """Return {specific parameter (of a joint): test of whether the conditions differ in it}."""
    tests = dict[str, TermTest]()
    for joint, fit in [*fits.actuators.items(), ("", fits.load)]:
        groups: dict[ParameterName, list[int]] = {}
        for place, name in enumerate(fit.estimate.names):
            if name.condition is not None:
                groups.setdefault(name.within(None), []).append(place)
        rows = independent_rows(fit.qr_factor, fit.estimate)
        for tested in shared_parameters(fit.estimate, groups, rows):
            tests[ParameterName(tested.name, joint) if joint else tested.name] = tested.difference
    return tests


def _check_conditions(conditions: Mapping[str, object]) -> None:
    """Check that conditions are at least two pairs of a robot and its logs."""
    if len(conditions) < 2:
        raise IdentificationError(
            f"identify_conditions needs at least two conditions, found {len(conditions)}"
        )
    for name, pair in conditions.items():
        if not (isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[0], Robot)):
            raise IdentificationError(
                f"condition '{name}' must be (robot, logs), found {shown(pair)}"
            )


def _check_joints(robots: Mapping[str, Robot]) -> None:
    (first, robot), *others = robots.items()
    for name, compared in others:
        if compared.joint_names != robot.joint_names:
            raise IdentificationError(
                f"condition '{first}' has the joints {', '.join(robot.joint_names)}, '{name}' "
                f"{', '.join(compared.joint_names)}: they must be one type of robot"
            )


def _check_specific(robot: Robot, specific: Sequence[str]) -> None:
    place = "condition_specific=", "condition_specific="
    for name in map(ParameterName.read, specific):
        check_name("parameter", name.quantity, [BODIES, *PARAMETERS], IdentificationError, *place)
        if name.owner:
            check_name("joint", name.owner, robot.joint_names, IdentificationError, *place)
