"""What combinations of parameters rows tell well and badly, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from seaid.arrays import Array
from seaid.estimation.information import Information
from seaid.linear_algebra import safely

_PART = 0.1
"""A parameter whose share of a combination is below this part of the largest is not named."""

_MOST_TERMS = 4
_LONGEST_NAME = 40
_SEEN = 1e-9


@dataclass(frozen=True, eq=False)
class Directions:
    """Singular directions of rows with columns scaled to unit norm, best told first.

    `shares` (p,) are the singular values relative to the largest, so that 1 / shares[-1] is the
    condition number; `vectors` (p, p) has the right singular vectors as rows; `norms` (p,) are the
    norms of the columns. `left` (p, p) are the left singular vectors in the basis of the factor and
    `largest` the largest singular value.
    """

    names: tuple[str, ...]
    shares: Array
    vectors: Array
    norms: Array
    left: Array
    largest: float

    def terms(self, direction: int) -> list[int]:
        """Return the parameters that make up a direction, the largest share first."""
        share = np.abs(self.vectors[direction])
        named = np.flatnonzero(share > _PART * share.max())
        return [int(place) for place in named[np.argsort(-share[named], kind="stable")]]

    def text(self, direction: int) -> str:
        """Return the combination in words, 'A - 0.97 B', in the units of the parameters."""
        terms = self.terms(direction)
        coefficients = self.vectors[direction] * self.norms
        words = first_term(self.names[terms[0]])
        for place in terms[1:_MOST_TERMS]:
            value = coefficients[place] / coefficients[terms[0]]
            size = "" if abs(abs(value) - 1) < 5e-3 else f"{abs(value):.2g} "
            words += f" {'-' if value < 0 else '+'} {size}{first_term(self.names[place])}"
        more = len(terms) - _MOST_TERMS
        return words + (f" and {more} more" if more > 0 else "")


def directions(factor: Array, names: tuple[str, ...]) -> Directions:
    """Return the singular directions of a weighted factor (p+1, p+1) without columns of zeros."""
    p = len(names)
    norms = np.linalg.norm(factor[:p, :p], axis=0)
    U, s, Vt = safely(linalg.svd, factor[:p, :p] / norms, what="the equations", check_finite=False)
    largest = float(s[0]) if p else 1.0
    return Directions(names, s / largest, Vt, norms, U, largest)


def equation_name(joint_names: tuple[str, ...], index: int) -> str:
    """Return the joint of an equation, by name where names are known.

    After the n equations of the joints come those of their motors, where both are solved at once.
    """
    if not joint_names:
        return f"joint {index}"
    name = joint_names[index % len(joint_names)]
    return name if index < len(joint_names) else f"motor of {name}"


def telling_joints(information: Information, columns: list[int]) -> list[str]:
    """Return the joints whose torque tells columns, by name where names are known.

    Of the equations that see a column the one that sees the fewest others: the outermost joint.
    """
    norms = np.linalg.norm(information.factors[:, :, :-1], axis=1)
    sees = norms > _SEEN * np.max(norms, axis=0, initial=0.0)
    joints = []
    for column in columns:
        seeing = np.flatnonzero(sees[:, column])
        if len(seeing):
            fewest = np.sum(sees[seeing], axis=1)
            place = seeing[np.flatnonzero(fewest == fewest.min())[-1]]
            joints.append(information.equations[place])
    return [equation_name(information.joint_names, joint) for joint in sorted(set(joints))]


def first_term(name: str) -> str:
    """Return a long grouping by its first parameter, which is the base column's own name."""
    return name if len(name) <= _LONGEST_NAME else f"{name.split(' ')[0]} + ..."
