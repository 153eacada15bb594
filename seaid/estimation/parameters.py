"""Parameters of a problem, as data: what is estimated, of what, and what is known of it before.

A problem has a tuple of these, one per column of its residual blocks. Two blocks share a parameter
by naming the same quantity, owner and condition: all else is not compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from seaid._arrays import Array
from seaid.drives import ParameterName
from seaid.errors import IdentificationError


@dataclass(frozen=True)
class Prior:
    """What is known of a parameter before the data: an expected value, a standard deviation."""

    value: float
    std: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.value) and math.isfinite(self.std) and self.std > 0):
            raise IdentificationError(
                "a prior needs a finite value and a standard deviation above zero, found "
                f"{self.value} and {self.std}"
            )


@dataclass(frozen=True)
class Parameter:
    """One parameter of a problem; two are the same if quantity, owner and condition are.

    Attributes
    ----------
    quantity : str
        What it is: "stiffness", "viscous_friction", "command_delay", a base parameter.
    owner : str
        The joint, link, sensor or bus that has it; "" for what belongs to the robot.
    condition : str or None
        The condition of the experiments in which it has this value; None: in all of them.
    unit : str
    prior : Prior or None
        What is known of it before the data; None: nothing.
    lower, upper : float
        Bounds of a search.
    starts : tuple of float
        Values from which a search starts; without any the problem is linear in the parameter, or
        has a start of its own.
    is_fixed : bool
        Whether it keeps its value, as known constants do. The standard deviation of its prior is
        then in the errors of all others, and the data do not reduce it.

    Examples
    --------
    >>> Parameter("stiffness", "knee", unit="N m/rad", lower=0.0).name
    'stiffness of knee'
    """

    quantity: str
    owner: str = ""
    condition: str | None = None
    unit: str = field(default="", compare=False)
    prior: Prior | None = field(default=None, compare=False)
    lower: float = field(default=-math.inf, compare=False)
    upper: float = field(default=math.inf, compare=False)
    starts: tuple[float, ...] = field(default=(), compare=False)
    is_fixed: bool = field(default=False, compare=False)

    def __post_init__(self) -> None:
        if not self.lower < self.upper:
            raise IdentificationError(
                f"the bounds of {self.name} leave no value: {self.lower} to {self.upper}"
            )

    @classmethod
    def of_column(cls, name: str, unit: str = "") -> Parameter:
        """Return the parameter of a column: of a joint or a condition if the name has one."""
        parts = ParameterName.of(name)
        return cls(parts.quantity, parts.owner, parts.condition, unit)

    @property
    def name(self) -> ParameterName:
        """The name of its column, in text "stiffness of knee [warm]"."""
        return ParameterName(self.quantity, self.owner, self.condition)


def bounds_of(parameters: Sequence[Parameter]) -> tuple[Array, Array]:
    """Return the lower and upper bounds (p,) of a search."""
    lower, upper = (np.array([getattr(x, end) for x in parameters]) for end in ("lower", "upper"))
    return lower, upper


def priors_of(parameters: Sequence[Parameter]) -> tuple[Array, Array]:
    """Return expected values (p,) and standard deviations (p,), 0 and infinite without a prior."""
    none = Prior(0.0, 1.0)
    priors = [parameter.prior for parameter in parameters]
    expected = [(prior or none).value for prior in priors]
    stds = [math.inf if prior is None else prior.std for prior in priors]
    return np.array(expected, dtype=float), np.array(stds, dtype=float)
