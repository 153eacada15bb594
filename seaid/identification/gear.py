"""The gear between the encoders: the spring alone, and what the stiffness of a result includes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import FrozenMapping
from seaid.drives import of_spring, spring_slopes
from seaid.errors import Finding, listed

if TYPE_CHECKING:
    from seaid.drives import Drive
    from seaid.estimation import Estimate
    from seaid.identification.identification import Identification


def own_estimates(
    drives: Mapping[str, Drive], estimates: Mapping[str, Estimate]
) -> FrozenMapping[Estimate]:
    """Return estimates {joint: Estimate} between the encoders as those of the springs alone."""
    return FrozenMapping(
        {joint: _own_estimate(drives[joint], one) for joint, one in estimates.items()}, "joint"
    )


def _own_estimate(drive: Drive, estimate: Estimate) -> Estimate:
    """Return the estimate of a drive in its own values, with the covariance propagated."""
    if not drive.gear_compliance:
        return estimate
    names = estimate.names
    values = dict(zip(names, estimate.values, strict=True))
    own = of_spring(values, drive.gear_compliance)
    slopes = spring_slopes(values, drive.gear_compliance)
    J = np.array([[slopes[row].get(column, 0.0) for column in names] for row in names])
    white = estimate.white_standard_errors
    return replace(
        estimate,
        values=np.array([own[name] for name in names]),
        covariance=J @ estimate.covariance @ J.T,
        white_standard_errors=None if white is None else np.abs(np.diag(J)) * white,
    )


def gear_findings(found: Identification) -> tuple[Finding, ...]:
    """Return a note on the joints whose stiffness includes that of the gear."""
    joints = [
        joint
        for joint in found.known.elastic_joints
        if joint in found.drives
        and includes_gear(found.known.drives[joint])
        and "stiffness" in found.drives[joint].names
    ]
    if not joints:
        return ()
    message = (
        f"the stiffness of {listed(joints)} is that between the encoders, of spring and gear in "
        "series; give gear_stiffness_Nm_per_rad in the drives, or log the deflection too, for that "
        "of the spring alone"
    )
    return (Finding("gear-compliance", message, joints[0] if len(joints) == 1 else "", "note"),)


def includes_gear(drive: Drive) -> bool:
    """Return whether a drive has a gear whose compliance is not known."""
    return drive.ratio != 1 and not drive.gear_compliance
