"""Doubts and assumptions of describe_log: unknown words, and samples that contradict names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.log.describe import Description, describe_log
from tests.one_joint import chain

TIME: Array = np.arange(1000.0) / 200


def sine(size: float = 1.0, phase: float = 0.0) -> Array:
    """Return a sine of 0.5 Hz; a phase of pi/2 and a size of pi make its derivative."""
    return size * np.sin(np.pi * TIME + phase)


SPEED = sine(np.pi, np.pi / 2)
TORQUE = sine(3.0, 1.0) + 0.3 * np.sin(11 * TIME)


def asked(folder: Path, **columns: Array) -> Description:
    """Return the inference for columns of a robot with one joint."""
    np.savez(folder / "log.npz", t=TIME, **columns)  # type: ignore[arg-type]
    return describe_log(folder / "log.npz", chain(folder, "knee"))


def test_what_names_and_samples_agree_on_is_sure(tmp_path: Path) -> None:
    found = asked(tmp_path, knee_pos=sine(), knee_vel=SPEED, knee_current_A=TORQUE)
    assert found.unsure == ()
    assert found.assumed == (
        "knee_pos: taken for rad",
        "knee_pos: taken for the joint side of the gear; it may be the motor side",
    )
    assert "# assumed: knee_pos: taken for rad\n" in found.to_toml()
    assert "assumed: knee_pos: taken for rad\n" in str(found)


@pytest.mark.parametrize(
    ("unit", "size", "name"),
    [
        ("deg", np.degrees(1.0), "knee_vel_rad_s"),
        ("turn", 1 / (2 * np.pi), "knee_vel_rad_s"),
        (None, 1.0, "knee_vel_rad_s"),
        ("turn", 60 / (2 * np.pi) / 60, "knee_rpm"),
    ],
)
def test_a_velocity_with_a_unit_gives_that_of_the_position(
    tmp_path: Path, unit: str | None, size: float, name: str
) -> None:
    speed = SPEED * (30 / np.pi if name == "knee_rpm" else 1.0)
    found = asked(tmp_path, knee_pos=sine(size), knee_tau_Nm=TORQUE, **{name: speed})
    assert found.description.joints["knee"]["joint_position"].unit == unit
    assert f"knee_pos: {unit or 'rad'} by its velocity" in found.assumed


@pytest.mark.parametrize(
    ("columns", "doubt"),
    [
        (
            {"knee_pos_rad": sine(), "knee_vel_deg_s": SPEED},
            "knee_pos_rad: moves 57.3 times as far as knee_vel_deg_s says: check the units",
        ),
        (
            {"knee_pos": sine(), "knee_vel": -SPEED},
            "knee_pos, knee_vel: position and velocity have opposite signs",
        ),
        (
            {"knee_pos": sine(), "knee_vel": np.sin(17 * TIME)},
            "knee_pos, knee_vel: one is not the velocity of the other",
        ),
        ({"knee_pos_mm": sine(50)}, "knee_pos_mm: mm does not fit the type of knee"),
        (
            {"knee_pos_rad": sine(57)},
            "knee_pos_rad: goes beyond the limits of knee: check its unit",
        ),
        ({"knee_pos_deg": sine(0.2)}, "knee_pos_deg: hardly moves in deg: check its unit"),
        ({"knee_pos": sine(0.1)}, "knee_pos (moves by 0.2): taken for rad"),
        (
            {"knee_pos": sine(), "iq_measured": TORQUE},
            "knee_pos (moves by 2): taken for rad; turns are usual of such drives",
        ),
        (
            {"knee_pos": sine(), "knee_current": np.abs(TORQUE)},
            "knee_current: has one sign: a magnitude or the current of a supply?",
        ),
        (
            {"knee_pos": sine(), "knee_motor_torque": np.round(100 * TORQUE)},
            "knee_motor_torque: in whole numbers without a unit: raw values of the drive?",
        ),
        (
            {"knee_pos": sine(), "knee_tau_Nm": TORQUE, "knee_tau_cmd_Nm": TORQUE},
            "knee_tau_Nm: equals knee_tau_cmd_Nm: which one is measured?",
        ),
        (
            {"knee_pos": sine(), "knee_blurb_torque": TORQUE},
            "knee_blurb_torque: the meaning of blurb in the name is not known",
        ),
        (
            {"knee_pos": sine(), "knee_tau": TORQUE, "other_tau": TORQUE},
            "other_tau: has the name of a torque, and is not used",
        ),
        (
            {"knee_pos": sine(), "knee_tau": TORQUE, "knee_blurb": 2 * SPEED},
            "knee_blurb: not understood, and not used; it moves like the velocity of knee",
        ),
        (
            {"knee_pos": sine(), "knee_blurb": TORQUE},
            "knee_blurb: not understood: it may be what a joint lacks",
        ),
        (
            {"knee_pos": sine(), "knee_current": np.floor(TIME) % 3},
            "knee_current: has a few whole numbers only: a state, excluded",
        ),
        (
            {"knee_pos_estimate": sine(), "knee_current_A": TORQUE},
            "knee_pos_estimate: an estimate of the drive, as there is no other position",
        ),
        (
            {"drive_knee_position": sine(), "drive_foot_position": sine(1, 2)},
            "drive_foot_position: has the name of a position, and is not used",
        ),
    ],
)
def test_what_names_or_samples_leave_open_is_a_doubt(
    tmp_path: Path, columns: dict[str, Array], doubt: str
) -> None:
    assert doubt in "\n".join(asked(tmp_path, **columns).unsure)


def test_a_word_that_most_names_have_is_no_doubt(tmp_path: Path) -> None:
    found = asked(tmp_path, blurb_knee_pos=sine(), blurb_knee_vel=SPEED, blurb_knee_amps=TORQUE)
    assert "blurb in the name" not in "\n".join(found.unsure)
