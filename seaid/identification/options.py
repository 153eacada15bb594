"""The options of `identify`, checked before a log is read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Literal

from seaid.errors import IdentificationError, listed, unknown_name
from seaid.estimation import Estimator, EstimatorName, estimator_named
from seaid.identification.two_step import NOTHING_SPECIFIC, SpecificParameters
from seaid.regressor import check_offset_std

KNOWN_STD = {
    "torque": "the torques, with one scale error common to all",
    "payload": "the mass of the payloads",
    "bodies": "the known bodies, each with a scale of its own",
    "motor_inertia_kg_m2": "rotor inertias",
    "gear_ratio": "gear ratios",
    "motor_pulley_radius_m": "motor pulley radii",
    "load_pulley_radius_m": "load pulley radii",
}
"""Names in `known_std`: relative standard deviations of what."""


def check_known_std(known_std: Mapping[str, float]) -> None:
    """Raise IdentificationError for an unknown name or a standard deviation outside [0, 1]."""
    for name, std in known_std.items():
        if name not in KNOWN_STD:
            wrong = unknown_name("constant", name, KNOWN_STD)
            raise IdentificationError(f"known_std=: {wrong}", "known_std=")
        if not 0 <= std <= 1:
            raise IdentificationError(
                f"known_std of '{name}' must be a relative standard deviation from 0 to 1, found "
                f"{std}",
                "known_std=",
            )


Method = Literal["auto", "two-step", "simultaneous"]
"""Values of `method=`."""


@dataclass(frozen=True, eq=False)
class Options:
    """The options of `identify`, and the parameters that conditions have for themselves."""

    torque_joints: str | Sequence[str] | None = None
    method: Method = "auto"
    estimator: EstimatorName = "wls"
    feasible: bool = False
    cutoff_hz: float | None = None
    encoder_offset_std: float = 0.0
    known_std: Mapping[str, float] = field(default_factory=dict)
    executor: Executor | None = None
    progress: bool = False
    specific: SpecificParameters = NOTHING_SPECIFIC

    def __post_init__(self) -> None:
        if self.estimator == "iv" and self.method == "simultaneous":
            raise IdentificationError(
                f'estimator="iv" needs method="two-step", found "{self.method}"',
                'estimator="iv"',
                'method="two-step"',
            )
        check_offset_std(self.encoder_offset_std)
        check_known_std(self.known_std)

    @property
    def linear_estimator(self) -> Estimator:
        """The estimator of two steps, from which instruments continue too."""
        return estimator_named("wls" if self.estimator == "iv" else self.estimator)

    def check_without_encoders(self, joints: Sequence[str]) -> None:
        """Raise IdentificationError for options that do nothing if `joints` have no encoder."""
        refused = 'method="simultaneous"' if self.method == "simultaneous" else ""
        refused = 'estimator="iv"' if self.estimator == "iv" else refused
        if refused:
            raise IdentificationError(
                f"{refused} needs the joint position of each spring, and the logs have none of "
                f"{listed(joints)}: these springs are found by a refinement that simulates the "
                f"motors, whatever the first estimate is; remove {refused}, or log the joint "
                "position",
                refused,
            )
