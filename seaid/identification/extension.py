"""What a kind of robot adds to `identify` and `validate`: nothing, if its base is held.

A package that knows another kind of robot registers its `Extension` for the type of that robot, so
that nothing in this package asks what kind a robot is.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, Protocol

from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid._arrays import Array
    from seaid.errors import Finding
    from seaid.estimation import FittedRows
    from seaid.identification.datasets import Dataset
    from seaid.identification.result import Identification, Validation
    from seaid.log import Log, Motion
    from seaid.regressor import LoadModel


class SensorErrors(Protocol):
    """Constant errors (k,) of sensors that were identified with the bodies.

    `columns` are the changes of y by the errors (R, k), which have a `covariance` (k, k).
    """

    @property
    def columns(self) -> Array:
        """The changes of y by the errors (R, k)."""

    @property
    def covariance(self) -> Array:
        """The covariance (k, k) of the errors."""

    def removed(self, datasets: Sequence[Dataset]) -> list[Motion]:
        """Return the motions without the errors."""

    def findings(self) -> Iterable[Finding]:
        """Yield the notes on the errors that were subtracted."""


class Extension:
    """The additions of robots whose base is held, which are none: other kinds replace them."""

    def log_findings(
        self, robot: Robot, logs: Sequence[Log], motions: Sequence[Sequence[Motion]]
    ) -> Iterable[Finding]:
        """Return what contradicts itself in logs and the motions of each of them, before a fit."""
        return ()

    def torque_findings(
        self, robot: Robot, asked: Sequence[str], used: Collection[str]
    ) -> Iterable[Finding]:
        """Return the notes on joints that are `asked` for and whose torque is not `used`."""
        return ()

    def sensor_errors(
        self, robot: Robot, datasets: Sequence[Dataset], model: LoadModel, fit: FittedRows
    ) -> SensorErrors | None:
        """Return the errors of sensors that the rows of a fit support; `robot` has its bodies."""
        return None

    def fit_findings(
        self,
        result: Identification,
        datasets: Sequence[Dataset],
        fit: FittedRows,
        errors: SensorErrors | None,
    ) -> Iterable[Finding]:
        """Return what the rows of a fit contradict, after `errors` of sensors were removed."""
        return ()

    def value_findings(self, declared: Robot, result: Identification) -> Iterable[Finding]:
        """Return what the values of a result contradict; `declared` has those of the robot file."""
        return ()

    def compared(self, comparison: Validation, rows: Sequence[Array]) -> Validation:
        """Return a comparison with what the `rows` (T, r, 2) of each motion have besides joints.

        They are measured and computed torques of the load side.
        """
        return comparison

    def validated(self, identification: Identification, comparison: Validation) -> Validation:
        """Return the comparison of an unseen log with what else is predicted in it."""
        return comparison


@singledispatch
def extension_of(robot: Robot) -> Extension:
    """Return what the kind of a robot adds."""
    return Extension()
