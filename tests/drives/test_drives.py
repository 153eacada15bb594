"""Drives as data: radii, ratios and units of each kind, and numbers that cannot be."""

from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest

from seaid.drives import AngleRatio, Controller, SeriesElasticDrive, StiffDrive, spring_force
from seaid.errors import RobotError

PULLEYS: dict[str, Any] = {"motor_pulley_radius_m": 0.02, "load_pulley_radius_m": 0.04}


@pytest.mark.parametrize(
    ("options", "radii", "units"),
    [
        ({**PULLEYS, "stiffness_N_per_m": 70.0}, (0.02, 0.04), ("N", "m")),
        ({"stiffness_Nm_per_rad": 70.0}, (1.0, 1.0), ("N m", "rad")),
        # the drum of a prismatic joint counts one on the load side
        ({"motor_pulley_radius_m": 0.02, "stiffness_N_per_m": 70.0}, (0.02, 1.0), ("N", "m")),
    ],
)
def test_springs_have_the_radii_and_units_of_their_kind(
    options: dict[str, Any], radii: tuple[float, float], units: tuple[str, str]
) -> None:
    """Linear springs have pulleys and N/m, rotary ones radii of one and N m/rad."""
    drive = SeriesElasticDrive(gear_ratio=100.0, **options)
    assert (drive.motor_radius, drive.load_radius) == radii
    assert (drive.ratio, drive.values["stiffness"], drive.spring_units) == (100.0, 70.0, units)


def test_stiff_drive_has_the_face_of_an_elastic_one_but_takes_no_spring() -> None:
    """What reads a drive needs no case for its kind."""
    drive = StiffDrive(gear_ratio=100.0)
    assert (drive.is_elastic, drive.is_nonlinear_spring) == (False, False)
    assert (drive.spring, drive.joint_friction) == ((), ())
    assert (drive.motor_radius, drive.load_radius, spring_force(drive)) == (1.0, 1.0, 0)
    for name in ("spring", "joint_friction", "motor_radius", "load_radius", "is_elastic"):
        assert hasattr(SeriesElasticDrive(gear_ratio=100.0), name)
        assert f"{name}=" not in repr(drive)
        with pytest.raises(FrozenInstanceError):
            setattr(drive, name, None)
        with pytest.raises(TypeError, match=name):
            StiffDrive(**{name: ()})  # type: ignore[arg-type]
    assert StiffDrive(gear_ratio_rad_per_m=300).ratio == 300
    assert StiffDrive(gear_ratio=1.0, friction=["viscous"]).friction == ("viscous",)  # type: ignore[arg-type]
    with pytest.raises(RobotError, match="needs a joint that turns"):
        StiffDrive(gear_ratio_rad_per_m=100.0, torque_ripple={"joint": [1]})
    with pytest.raises(RobotError, match="angle_ratio cos must be finite"):
        StiffDrive(gear_ratio=100.0, angle_ratio=AngleRatio(cos=(np.nan,)))
    for gain in ("position_gain_Nm_per_rad", "feedforward_Nm"):
        gains: dict[str, Any] = {"position_gain_Nm_per_rad": 1.0, gain: np.inf}
        with pytest.raises(RobotError, match=f"{gain} must be .* finite, found inf"):
            Controller(**gains)


POSITIVE = ("gear_ratio", "motor_pulley_radius_m", "load_pulley_radius_m", "stiffness_N_per_m")
MAY_BE_ZERO = ("motor_inertia_kg_m2", "viscous_friction_Nms_per_rad", "coulomb_friction_Nm")


@pytest.mark.parametrize("key", [*POSITIVE, *MAY_BE_ZERO])
def test_number_that_cannot_be_names_key_and_value(key: str) -> None:
    """Zero is allowed where it means something."""
    wrong: tuple[Any, ...] = (-1.0, np.nan, -np.inf, "100", True, [1.0])
    for value in wrong:
        is_number = type(value) is float
        words = f"{key} must be .* and finite, found {value}" if is_number else "must be a number,"
        with pytest.raises(RobotError, match=words) as caught:
            SeriesElasticDrive(**{"gear_ratio": 100.0, **PULLEYS, key: value})
        assert is_number or str(caught.value) == f"{key} must be a number, found {value!r}"
    options = {"gear_ratio": 100.0, **PULLEYS, key: 0}
    if key in MAY_BE_ZERO:
        assert getattr(SeriesElasticDrive(**options), key) == 0.0
    else:
        with pytest.raises(RobotError, match=f"{key} must be more than zero and finite, found 0"):
            SeriesElasticDrive(**options)
