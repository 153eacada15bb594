"""The vocabulary of column names: each word has one quantity, and each unit a factor."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from seaid.log.channels import (
    OF_BASE,
    OF_CONTACTS,
    OF_JOINTS,
    SENSORS,
    TEMPERATURES,
    UNIT_FACTORS,
    UNITS,
    quantity_of,
)
from seaid.log.describe.names import kind_of, known_unit, meaning_of, place_of, vocabulary


def test_a_word_has_one_quantity_and_a_quantity_one_rank() -> None:
    tables = vocabulary().tables
    words = Counter(word for text in tables["quantities"].values() for word in text.split())
    assert [word for word, count in words.items() if count > 1] == []
    assert tables["ranks"].keys() == tables["quantities"].keys()


def test_a_spelling_has_one_unit_and_a_unit_a_factor_to_si() -> None:
    factors = {unit for units in UNIT_FACTORS.values() for unit in units}
    factors |= {*TEMPERATURES, "counts"}
    units = {unit for _, unit in vocabulary().units.values()}
    units |= {*vocabulary().tables["base_units"]}
    assert units - factors == set()
    spellings = Counter(
        spelling
        for entry in UNITS["units"].values()
        for spelling in {*entry.get("symbols", "").split(), *entry.get("also", "").split()}
    )
    assert [spelling for spelling, count in spellings.items() if count > 1] == []


def test_prefixes_stand_before_symbols_and_names() -> None:
    assert known_unit("mN·m") == ("torque", "mNm")
    assert known_unit("milliradians") == ("position", "mrad")
    assert known_unit("nanoseconds") == ("time", "ns")
    assert UNIT_FACTORS["Nm"]["mNm"] == 1e-3


def test_phrases_count_as_a_whole() -> None:
    assert kind_of("rot_vel") == "angular_velocity"
    assert kind_of("base_vel") == "velocity"
    assert meaning_of("rot_vel").quantity == "velocity"
    form, stem, axis, factor = place_of("imu_rot_vel_z [deg/s]", "")
    assert (form, stem, axis) == ("axis", "imu_rot_vel", "z")
    assert factor == np.pi / 180


def test_the_table_of_channels_has_the_fields_of_a_log_and_the_documented_quantities() -> None:
    assert tuple(OF_JOINTS) == SENSORS
    text = (Path(__file__).parents[3] / "docs" / "logs.md").read_text("utf-8")
    documented = re.search(r"Quantities of a joint: (.*?)\. Velocities", text, re.DOTALL)
    assert documented is not None
    assert {*re.findall(r"`(\w+)`", documented[1])} == {*SENSORS}


def test_a_column_of_any_quantity_is_found_in_the_table() -> None:
    for name, row in OF_JOINTS.items():
        for is_prismatic in (False, True):
            assert quantity_of(row.column("base", is_prismatic)) == row == quantity_of(name)
    for row in OF_BASE.values():
        assert all(quantity_of(column) == row for column in row.columns("base"))
    for row in OF_CONTACTS.values():
        assert all(quantity_of(column) == row for column in row.columns("foot.left"))
    assert quantity_of("knee.speed").kind == ""


# X


@pytest.mark.parametrize(
    ("name", "quantity", "side", "joint", "unit"),
    [
        ("mpos_0", "position", "motor", "0", None),
        ("pos_12", "position", "", "12", None),
        ("q1", "position", "", "1", None),
        ("qd2", "velocity", "", "2", None),
        ("tau_meas1", "torque", "", "1", None),
        ("wcur_0", "current", "", "0", None),
        ("defl_vel_3", "velocity", "", "3", None),
        ("t_tx_0", "time", "", "tx_0", None),
        ("knee_motor_angle_deg", "position", "motor", "knee", "deg"),
        ("A3 Istwinkel [Grad]", "position", "", "a3", "deg"),
        ("kneeMotorAngle", "position", "motor", "knee", None),
        ("elbow.joint_position_rad", "position", "joint", "elbow", "rad"),
        ("slide.joint_position_m", "position", "joint", "slide", "m"),
        ("pos_elbow_joint", "position", "", "elbow_joint", None),
        ("/joint_states/effort[hip]", "torque", "", "hip", None),
        ("/drives/motor.angle[2]", "position", "motor", "2", None),
        ("input_volts", "voltage", "", "input", None),
        ("timestamp_ms", "time", "", "", "ms"),
        ("knee_motor_current_mA", "current", "motor", "knee", "mA"),
        ("knee_torque_mNm", "torque", "", "knee", "mNm"),
        ("TORQUE_MNM_2", "torque", "", "2", "mNm"),
        ("slide_force_kN", "torque", "", "slide", "kN"),
        ("torque1mNm", "torque", "", "1", "mNm"),
        ("torq_left_s0", "torque", "", "left_s0", None),
        ("torAct", "torque", "", "", None),
        ("posAct", "position", "", "", None),
        ("currentmA", "current", "", "", "mA"),
        ("vbus mV", "voltage", "", "", "mV"),
        ("slide.link_pos_um", "position", "joint", "slide", "um"),
        ("slide_position_meters", "position", "", "slide", "m"),
        ("slide_position_micrometers", "position", "", "slide", "um"),
        ("knee_enc_mrad", "position", "", "knee", "mrad"),
        ("pos_mdeg_3", "position", "", "3", "mdeg"),
        ("enc_counts", "position", "", "", "counts"),
        ("motor_counts", "position", "motor", "", "counts"),
        ("knee_motor_turns", "position", "motor", "knee", "turn"),
        ("hip_yaw_motor_rad", "position", "motor", "hip_yaw", "rad"),
        ("hip_yaw_rpm", "velocity", "", "hip_yaw", "rpm"),
        ("vel_deg_s", "velocity", "", "", "deg/s"),
        ("dq1 [rad/s]", "velocity", "", "1", "rad/s"),
        ("acc_2 (m/s^2)", "acceleration", "", "2", "m/s^2"),
        ("q[1](rad)", "position", "", "1", "rad"),
        ("tau (measured) [Nm]", "torque", "", "", "Nm"),
        ("position[A]", "position", "", "A", None),
        ("ang_left_s0", "position", "", "left_s0", None),
        ("current_position", "position", "", "", None),
        ("/joint_states/elbow/position", "position", "", "elbow", None),
        ("sample_count", "", "", "sample", None),
        ("firmware_rev", "", "", "firmware", None),
        ("θ_m1", "position", "motor", "1", None),
        ("τ_knee", "torque", "", "knee", None),
        ("\N{MATHEMATICAL ITALIC SMALL THETA}2", "position", "", "2", None),
        ("θ\N{COMBINING DOT ABOVE}", "velocity", "", "", None),
        ("q\N{COMBINING DIAERESIS}_1", "acceleration", "", "1", None),
        ("ω", "velocity", "", "", None),
        ("t_\N{MICRO SIGN}s", "time", "", "", "us"),
        ("pos_Hüfte", "position", "", "hufte", None),
        ("pos_肩", "position", "", "肩", None),
        ("位置", "", "", "位置", None),
        ("²", "", "", "2", None),
        ("", "", "", "", None),
        ("🤖", "", "", "", None),
    ],
)
def test_name_of_a_column_is_read(
    name: str, quantity: str, side: str, joint: str, unit: str | None
) -> None:
    found = meaning_of(name)
    assert (found.quantity, found.side, found.joint, found.unit) == (quantity, side, joint, unit)
    assert found.is_raw


@pytest.mark.parametrize(
    ("name", "joint", "quantity", "side"),
    [
        ("ang_left_s0", "left_s0", "position", ""),
        ("left_w0_motor_pos", "left_w0", "position", "motor"),
        ("LEFT_S0_TORQUE", "left_s0", "torque", ""),
        ("elbow_vel", "elbow_joint", "velocity", ""),
        ("position[elbow_joint]", "elbow_joint", "position", ""),
        ("position[elbow]", "elbow_joint", "position", ""),
        ("tau_motor_arm", "motor_arm", "torque", ""),
        ("/joint_states/left_s0/effort", "left_s0", "torque", ""),
        ("q1", "1", "position", ""),  # the joint q1: without its name there would be no quantity
        ("q1_torque", "q1", "torque", ""),
    ],
)
def test_the_name_of_a_joint_of_the_robot_is_read_as_nothing_else(
    name: str, joint: str, quantity: str, side: str
) -> None:
    joints = ("left_s0", "left_w0", "elbow_joint", "motor_arm", "q1")
    found = meaning_of(name, joints)
    assert (found.joint, found.quantity, found.side) == (joint, quantity, side)


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("x_axis [mm]", "position", "mm"),
        ("x_axis_mm", "position", "mm"),
        ("x_axis (m)", "position", "m"),
        ("x_axis scale [mm]", "position", "mm"),
        ("x_axis linear scale um", "position", "um"),
        ("x_axis_m", "", None),  # of the motor, perhaps
        ("x_axis lvdt [mm]", "", None),  # of what, nobody says
        ("x_axis torque_scale", "torque", None),
    ],
)
def test_a_length_of_a_joint_is_its_position(name: str, quantity: str, unit: str | None) -> None:
    found = meaning_of(name, ("x_axis", "z_axis"))
    assert (found.joint, found.quantity, found.unit) == ("x_axis", quantity, unit)


@pytest.mark.parametrize(
    ("name", "quantity", "joint", "role"),
    [
        ("/lowstate/motor_state[3]/q", "position", "3", "measured"),
        ("/lowstate/motor_state.7/dq", "velocity", "7", "measured"),
        ("low_state.motor_state.7.tau_est", "torque", "7", "estimated"),
        ("/lowcmd/motor_cmd[3]/q", "position", "3", "command"),
        ("/arm_controller/state/actual/positions[0]", "position", "0", "measured"),
        ("/arm_controller/state/desired/positions[0]", "position", "0", "command"),
        ("/arm_controller/state/error/positions[0]", "position", "0", "derived"),
        ("/arm/state/feedback/positions/left_s0", "position", "left_s0", "measured"),
        ("/arm/state/reference/positions/left_s0", "position", "left_s0", "command"),
        ("/effort_controllers/commands/data[1]", "torque", "1", "command"),
        ("/elbow_position_controller/command/data", "position", "elbow_joint", "command"),
        ("/odrive_axis1/controller_status/pos_measured", "position", "odrive_1", "measured"),
        ("/iiwa/JointState/measured_torque/a1", "torque", "a1", "measured"),
        ("/wrench/force/x", "", "x", "derived"),
        ("Present_Position_1", "position", "1", "measured"),
        ("Axis1.SetPos", "position", "1", "command"),
        ("observation.state.left_s0.pos", "position", "left_s0", "measured"),
    ],
)
@pytest.mark.parametrize("joints", [(), ("left_s0", "elbow_joint")])
def test_all_parts_of_a_topic_count(
    name: str, quantity: str, joint: str, role: str, joints: tuple[str, ...]
) -> None:
    found = meaning_of(name, joints)
    if not joints:
        joint = joint.removesuffix("_joint")
    assert (found.quantity, found.joint, found.role) == (quantity, joint, role)


@pytest.mark.parametrize("name", ["pos_cmd_0", "goal_position", "tau_fric1", "q_des", "pos_filt2"])
def test_commanded_and_computed_columns_are_no_sensors(name: str) -> None:
    assert not meaning_of(name).is_raw
