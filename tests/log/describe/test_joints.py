"""describe_log: synthetic foreign logs described as they were made, and all measured sets."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives.controller import Controller
from seaid.errors import LogError
from seaid.legged import load_robot
from seaid.log import describe
from seaid.log.describe import Description, describe_log
from seaid.log.readers.table import Table
from seaid.log.reading import read_log
from tests.measured import LOGS
from tests.one_joint import chain, one_joint
from tests.plants import write_columns

TIME = np.arange(500) / 200
Columns = dict[str, Array]


def wave(hz: float, size: float = 1.0) -> Array:
    return size * np.sin(2 * np.pi * hz * TIME + hz)


LATE = wave(0.5)[np.maximum(np.arange(len(TIME)) - 5, 0)]
"""What follows a command wave(0.5)."""


def guess(folder: Path, **columns: Array) -> Description:
    np.savez(folder / "log.npz", **columns)  # type: ignore[arg-type]
    return describe_log(folder / "log.npz")


def plain(found: Description) -> dict[str, Any]:
    joints: dict[str, Any] = found.description.to_dict()["joints"]
    return joints


@pytest.mark.parametrize(
    ("labels", "joints", "expected", "note"),
    [
        (("left_s0", "left_w0"), ("left_w0", "left_s0"), ("left_s0", "left_w0"), ""),
        (("hip_yaw", "hip_yow"), ("hip_yow", "hip_yaw"), ("hip_yaw", "hip_yow"), ""),
        (("odrive_10", "odrive_9"), ("hip", "knee"), ("knee", "hip"), "odrive_9, odrive_10: ta"),
        (("hip_yaw", "hip_rol"), ("hip_yaw", "hip_roll"), ("hip_yaw",), "hip_rol: no joint of"),
        (("hip_jaw",), ("hip_yaw", "hip_roll"), ("hip_yaw",), "hip_jaw: taken for the robot's"),
        (("hip_yaw", "gripper"), ("hip_yaw",), ("hip_yaw",), "gripper: no joint of the robot has"),
        (("j2", "j1"), ("joint1", "joint2"), ("joint2", "joint1"), ""),
        (("0", "1"), ("joint1", "joint2"), ("joint1", "joint2"), "0, 1: taken for the robot's"),
        (("1", "2"), ("hip", "knee"), ("hip", "knee"), "1, 2: taken for the robot's joints in"),
        (("a", "b", "c"), ("hip", "knee"), ("hip", "knee"), "3 joints in the log, 2 in the robot"),
    ],
)
def test_labels_are_joints_by_name_by_number_or_in_order(
    tmp_path: Path,
    labels: tuple[str, ...],
    joints: tuple[str, ...],
    expected: tuple[str, ...],
    note: str,
) -> None:
    columns = {f"ang_{one}": wave(0.3 + 0.1 * k) for k, one in enumerate(labels)}
    columns |= {f"tau_{one}_Nm": wave(0.35 + 0.1 * k) for k, one in enumerate(labels)}
    np.savez(tmp_path / "log.npz", t=TIME, **columns)  # type: ignore[arg-type]
    found = describe_log(tmp_path / "log.npz", chain(tmp_path, *joints))
    positions = {joint: one["joint_position"] for joint, one in plain(found).items()}
    named = zip(expected, labels, strict=False)
    assert positions == {joint: f"ang_{label}" for joint, label in named}
    text = "\n".join(found.unsure)
    assert note in text
    assert note or "in their order" not in text


def test_a_motor_that_turns_against_its_joint_has_the_opposite_sign(tmp_path: Path) -> None:
    """Antrieb and Gelenk are motor and joint; the encoders are in counts."""
    names = ("Motor1 Position [counts]", "Gelenk1 Position [counts]", "Motor1 Strom [mA]")
    columns = (np.round(wave(0.5, -2e5)), np.round(wave(0.5, 2e3)), wave(0.7, 900.0))
    named = {"Zeit [ms]": 1e3 * TIME, **dict(zip(names, columns, strict=True))}
    np.savez(tmp_path / "log.npz", **named)  # type: ignore[arg-type]
    found = describe_log(tmp_path / "log.npz", chain(tmp_path, "elbow"))
    sources = found.description.joints["elbow"]
    assert {name: one.sign for name, one in sources.items()} == {
        **{"motor_position": -1, "joint_position": 1, "motor_current": -1}
    }
    said = [one for one in found.unsure if "sign = -1 on the motor's side" in one]
    assert len(said) == 1
    assert said[0].startswith("Motor1 Position [counts], Motor1 Strom [mA]")


def test_units_with_prefixes_reach_the_description(tmp_path: Path) -> None:
    found = guess(
        tmp_path,
        t_ms=1e3 * TIME,
        knee_motor_mdeg=wave(0.5, 9e4),
        knee_joint_mrad=wave(0.5, 900.0),
        knee_torque_mNm=wave(0.6, 5.0),
        knee_current_mA=wave(0.7, 5.0),
        knee_voltage_mV=wave(0.7, 5.0),
    )
    assert {name: one["unit"] for name, one in plain(found)["knee"].items()} == {
        **{"motor_position": "mdeg", "joint_position": "mrad", "motor_torque": "mNm"},
        **{"motor_current": "mA", "motor_voltage": "mV"},
    }
    path = tmp_path / "log.npz"
    path.with_suffix(".toml").write_text(found.to_toml())
    log = read_log(path, chain(tmp_path, "knee"))
    assert log.motor_voltage is not None
    np.testing.assert_allclose(log.motor_voltage[:, 0], wave(0.7, 5e-3), atol=1e-12)
    np.testing.assert_allclose(log.motor_position[:, 0], np.deg2rad(wave(0.5, 90.0)), atol=1e-9)


@pytest.mark.parametrize("name", ["cmd_1", "action[1]", "target_q1", "j1_ref"])
def test_a_command_that_the_position_follows_is_one_of_the_position(
    name: str, tmp_path: Path
) -> None:
    found = guess(tmp_path, **{"t": TIME, "q_1": LATE, name: wave(0.5)})
    assert plain(found)["joint_1"] == {"joint_position": "q_1", "position_command": name}
    other = guess(tmp_path, **{"t": TIME, "q_1": LATE, "cmd_1": np.gradient(wave(0.5), TIME)})
    assert "position_command" not in plain(other)["joint_1"]


def test_a_command_that_a_soft_loop_hardly_follows_is_one_of_the_position(tmp_path: Path) -> None:
    """Weight, friction and inertia over the gain are in u = 1.1 q + b q' + c q'' + d."""
    q = wave(0.5) + wave(1.3, 0.6) + wave(2.1, 0.3)
    rate = np.gradient(q, TIME)
    rest = 0.12 * rate + 0.02 * np.gradient(rate, TIME) + 0.2 + 0.05 * np.sign(rate)
    loop = 1.1 * q + rest
    assert np.var(loop - q) > 0.5 * np.var(loop)
    found = guess(tmp_path, t=TIME, q_1=q, cmd_1=loop)
    assert plain(found)["joint_1"] == {"joint_position": "q_1", "position_command": "cmd_1"}
    for other in (0.3 * q + rest, rest):  # a torque, and nearly a velocity
        found = guess(tmp_path, t=TIME, q_1=q, cmd_1=other)
        assert plain(found)["joint_1"] == {"joint_position": "q_1"}
        assert any("cmd_1: a command of what is unknown" in one for one in found.unsure)


def test_measured_next_to_a_command_that_it_follows_is_a_position(tmp_path: Path) -> None:
    found = guess(tmp_path, **{"t": TIME, "meas[0]": LATE, "cmd[0]": wave(0.5)})
    assert plain(found)["joint_0"] == {"joint_position": "meas[0]", "position_command": "cmd[0]"}
    assert "meas[0]: measured, without a quantity: taken for the position" in found.unsure
    with pytest.raises(LogError, match="no column looks like the position of a joint"):
        guess(tmp_path, **{"t": TIME, "meas[0]": wave(3.0), "cmd[0]": wave(0.5)})


def test_low_level_commands_are_all_taken(tmp_path: Path) -> None:
    """Those that are zero all the time are not; a torque is said to be a feed-forward."""
    found = guess(
        tmp_path,
        **{
            **{"t": TIME, "motor_state[0].q": LATE, "motor_cmd[0].q": wave(0.5)},
            **{"motor_cmd[0].dq": np.gradient(wave(0.5), TIME), "motor_cmd[0].tau": wave(2.0)},
        },
    )
    assert plain(found)["joint_0"] == {
        "joint_position": "motor_state[0].q",
        "position_command": "motor_cmd[0].q",
        "velocity_command": "motor_cmd[0].dq",
        "torque_command": "motor_cmd[0].tau",
    }
    assert any("taken for a feed-forward torque that the drive adds" in one for one in found.unsure)
    quiet = guess(
        tmp_path,
        **{
            **{"t": TIME, "q_1": LATE, "q_des_1": wave(0.5), "dq_des_1": np.zeros_like(TIME)},
            "tau_ff_1": np.zeros_like(TIME),
        },
    )
    assert set(plain(quiet)["joint_1"]) == {"joint_position", "position_command"}


@pytest.mark.parametrize(
    ("name", "is_taken"),
    [
        *((f"{name}_1", True) for name in ("tau_ff", "t_ff", "effort_feedforward")),
        *((f"{name}_1", False) for name in ("tau_grav", "tau_gravity", "model_torque")),
    ],
)
def test_a_feed_forward_torque_is_not_left_out_without_a_word(
    name: str, is_taken: bool, tmp_path: Path
) -> None:
    found = guess(tmp_path, **{"t": TIME, "q_1": LATE, "q_des_1": wave(0.5), name: wave(2.0)})
    assert (plain(found)["joint_1"].get("torque_command") == name) == is_taken
    words = (
        "taken for a feed-forward torque" if is_taken else "computed, and not used: if the drive"
    )
    assert any(name in one and words in one for one in found.unsure)


def gains(kp: float, kd: float) -> Controller:
    return Controller(position_gain_Nm_per_rad=kp, velocity_gain_Nms_per_rad=kd)


def test_gains_next_to_the_commands_are_those_of_the_controller(tmp_path: Path) -> None:
    kp = np.full_like(TIME, 40.0)
    columns = {"t": TIME, "motor_state[0].q": LATE, "motor_cmd[0].q": wave(0.5)}
    columns |= {"motor_cmd[0].kp": kp, "motor_cmd[0].kd": kp / 20, "motor_cmd[1].kp": kp + 1}
    found = guess(tmp_path, **columns)
    assert found.gains == {"joint_0": gains(40.0, 2.0)}
    assert any("taken for a gain of the controller" in one for one in found.unsure)
    changing = columns | {"motor_cmd[0].kp": np.where(TIME[100] < TIME, 40.0, 20.0)}
    found = guess(tmp_path, **changing)
    assert found.gains == {"joint_0": gains(0.0, 2.0)}
    assert any("a gain that changes" in one for one in found.unsure)
    plain_names = {"t": TIME, "q_1": LATE, "q_des_1": wave(0.5), "kp_1": kp}
    assert guess(tmp_path, **plain_names).gains == {"joint_1": gains(40.0, 0.0)}
    supply = {"vin": np.full_like(TIME, 12.0)}
    in_volts = guess(tmp_path, **plain_names, **supply)
    assert in_volts.gains["joint_1"].is_up_to_scale
    assert any("in V per rad, as the motor has the supply 'vin'" in one for one in in_volts.unsure)
    sensed = columns | supply | {"motor_state[0].tau_est": wave(1.0)}
    assert guess(tmp_path, **sensed).gains == {}  # the torque is used, and no command


def test_velocity_commands_alone(tmp_path: Path) -> None:
    rate = np.gradient(wave(0.5), TIME) * 60 / (2 * np.pi)
    found = guess(tmp_path, t=TIME, pos_1=wave(0.5), vel_cmd_1_rpm=rate)
    sources = found.description.joints["joint_1"]
    assert sources["velocity_command"].unit == "rpm"
    assert any('motor_input = "velocity_command"' in one for one in found.unsure)


@pytest.mark.parametrize(
    ("names", "column", "unit", "level"),
    [
        (("j1_temp",), "j1_temp", None, 40.0),
        (("j1_temperature_K",), "j1_temperature_K", "K", 310.0),
        (("j1_temp_degF",), "j1_temp_degF", "degF", 100.0),
        (("j1_temp",), "j1_temp", "K", 310.0),
        (("j1_temp_C", "j1_motor_temp_C"), "j1_motor_temp_C", None, 40.0),
        (("j1_temp_controller", "j1_temp_winding"), "j1_temp_winding", None, 40.0),
        (("j1_board_temp",), None, None, 40.0),
    ],
)
def test_the_temperature_of_the_motor_is_read_in_its_unit(
    tmp_path: Path, names: tuple[str, ...], column: str | None, unit: str | None, level: float
) -> None:
    warm = dict.fromkeys(names, level + 0.01 * wave(0.1))
    found = guess(tmp_path, t=TIME, j1_pos=wave(0.5), j1_tau=wave(0.6), **warm)
    (sources,) = found.description.joints.values()
    source = sources.get("motor_temperature")
    assert (source and source.column, source and source.unit) == (column, unit)


def test_degrees_counts_and_nanoseconds_are_inferred_from_their_size(tmp_path: Path) -> None:
    found = guess(
        tmp_path,
        stamp=1.7e18 + 5e6 * np.arange(500.0),
        q_knee=wave(0.5, 70.0),
        tau_knee=wave(0.6, 5.0),
        q_hip=np.round(wave(0.5, 1800.0) + 2000),
        tau_hip=wave(0.8),
    )
    joints = plain(found)
    assert joints["knee"]["joint_position"] == {"column": "q_knee", "unit": "deg"}
    counts = {"column": "q_hip", "unit": "counts", "counts_per_turn": 4096.0}
    assert joints["hip"]["joint_position"] == counts
    assert joints["hip"]["motor_torque"] == {"column": "tau_hip", "side": "joint"}
    assert found.description.to_dict()["time"] == {"column": "stamp", "unit": "ns"}
    text = "\n".join(found.unsure)
    assert "q_knee (moves by 140): taken for degrees" in text
    assert "q_hip: in counts: 4096 per turn is a guess" in text
    assert "stamp: has steps of 5e+06: taken for ns" in text


def test_dead_channels_and_words_are_excluded_and_named(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{t},{q},0,nan,ok,{q}" for t, q in zip(TIME, wave(0.5), strict=True)]
    path.write_text("\n".join(["t,pos_0,mpos_0,cur_0,state,eff_0", *rows]) + "\n")
    found = describe_log(path)
    assert list(plain(found)["joint_0"]) == ["joint_position", "motor_torque"]
    assert "mpos_0: 0 all the time: a dead sensor, excluded" in found.unsure
    assert "cur_0: without a number: a dead sensor, excluded" in found.unsure
    assert "state: no column of numbers: excluded" in found.unsure


def test_names_without_a_latin_letter_are_read_or_left_unused(tmp_path: Path) -> None:
    data = {"t": TIME, "θ": wave(0.5), "τ": wave(1.0), "位置": wave(2.0), "": wave(3.0)}
    found = guess(tmp_path, **data)
    assert set(plain(found)["joint"]) == {"joint_position", "motor_torque"}
    assert found.unused == ("位置", "")
    assert tomllib.loads(found.to_toml())["joints"]["joint"]["joint_position"] == "θ"
    with pytest.raises(LogError, match="no column looks like the position of a joint"):
        guess(tmp_path, 位置=wave(1.0), 力=wave(2.0))


@pytest.mark.parametrize("label", ["²", "٣", "1", "a"])
def test_a_label_of_a_joint_may_look_like_a_number(tmp_path: Path, label: str) -> None:
    data = {"t": TIME, f"q[{label}]": wave(0.5), "q[7]": wave(1.0)}
    assert len(plain(guess(tmp_path, **data))) == 2


def test_names_with_line_breaks_and_quotes_make_a_toml_that_reads(tmp_path: Path) -> None:
    name = 'q_1"\\\n\x7f\x1b[2J]'
    path = tmp_path / "log.json"
    data = {"t": TIME.tolist(), name: wave(0.5).tolist(), "x\ny": wave(1.0).tolist()}
    path.write_text(json.dumps(data))
    found = describe_log(path)
    (joint,) = tomllib.loads(found.to_toml())["joints"].values()
    assert joint["joint_position"] == name
    assert all(
        line.startswith("# unsure") for line in found.to_toml().splitlines() if "rad" in line
    )
    for line in str(found).splitlines():
        assert line.isprintable()


@pytest.mark.slow  # 1.3 s
def test_ten_thousand_columns_are_described_shortly(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, t=TIME, q=wave(0.5), x=np.tile(wave(1.0)[:, None], (1, 9_000)))
    assert len(str(describe_log(path))) < 5_000


def test_two_positions_without_sides_are_told_by_how_far_they_move(tmp_path: Path) -> None:
    found = guess(
        tmp_path, t=TIME, angle_0=wave(0.5, 90.0), encoder_0=wave(0.5, 0.9), torque_0=wave(1.0)
    )
    joint = plain(found)["joint_0"]
    assert (joint["motor_position"], joint["joint_position"]) == ("angle_0", "encoder_0")
    assert "angle_0: moves much farther than encoder_0: taken for the motor side" in found.unsure


def test_time_may_be_missing_or_without_a_name(tmp_path: Path) -> None:
    found = guess(tmp_path, x=TIME, q=wave(0.5), tau=wave(1.0))
    assert found.description.to_dict()["time"] == "x"
    found = guess(tmp_path, q=wave(0.5), tau=wave(1.0))
    assert "time: no column looks like it: name it, or give time = { rate_hz" in found.unsure[-1]


def test_log_without_positions_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no column looks like the position of a joint; columns are"):
        guess(tmp_path, t=TIME, temp=wave(0.1))


def test_robot_names_the_joints_and_tells_degrees(tmp_path: Path) -> None:
    robot = chain(tmp_path, "hip_pitch", "knee_pitch", limit=1.0)
    path = tmp_path / "log.npz"
    columns = {"t": TIME, "q_knee": wave(0.5, 5.0), "tau_knee": wave(1.0)}
    np.savez(path, q_hip=wave(0.5), tau_hip=wave(0.9), **columns)  # type: ignore[arg-type]
    found = describe_log(path, robot)
    assert set(plain(found)) == {"hip_pitch", "knee_pitch"}
    assert plain(found)["knee_pitch"]["joint_position"] == {"column": "q_knee", "unit": "deg"}
    path.with_suffix(".toml").write_text(found.to_toml())
    log = read_log(path, robot)
    np.testing.assert_allclose(log.joint_position[:, 1], np.deg2rad(wave(0.5, 5.0)), rtol=1e-12)
    assert log.motor_torque.shape == (500, 2)
    np.savez(path, t=TIME, q1=wave(0.5), q2=wave(0.6), tau1=wave(1.0), tau2=wave(1.1))
    found = describe_log(path, robot)
    assert plain(found)["knee_pitch"]["joint_position"] == "q2"
    assert "1, 2: taken for the robot's joints in their order" in found.unsure


def test_description_is_shown_as_a_table_with_its_doubts(tmp_path: Path) -> None:
    text = str(guess(tmp_path, t=TIME, q=wave(0.5), tau=wave(1.0), extra=wave(2.0)))
    assert text.splitlines()[0].split() == ["joint", "quantity", "column", "unit", "time"]
    assert text.splitlines()[1].split() == ["joint", "joint_position", "q", "SI", "t"]
    assert "unsure: q (moves by 2): taken for rad" in text
    assert text.endswith("not used: extra")


# Measured logs

HEBI = (
    *("motor_position", "joint_position", "joint_torque", "motor_current", "motor_voltage"),
    "motor_temperature",
)
STIFF = ("joint_position", "motor_torque")


@pytest.mark.slow  # 0.8 s
@pytest.mark.parametrize(
    ("place", "joints", "quantities"),
    [
        ("hebi_arms/capstone_repeat_waypoints.npz", 5, HEBI),
        ("hebi_arms/grav_comp_bad.npz", 2, HEBI),
        ("hebi_arms/ps4_repeat_waypoints.npz", 3, HEBI),
        ("hebi_arms/ps5_robot_data.npz", 3, HEBI),
        ("hebi_arms/star_trace.npz", 2, HEBI),
        ("hebi_arms/virtual_spring.npz", 2, HEBI),
        ("hebi_arms/sample.npz", 2, ("joint_position", "deflection", *HEBI[2:4], HEBI[-1])),
        ("hebi_x5_unloaded/exampleLog.csv", 1, HEBI),
        pytest.param(
            *("hebi_x5_unloaded/exampleLog.hebilog", 1, (*HEBI[:4], HEBI[-1])),
            marks=pytest.mark.hebi,
        ),
        ("ur10_exciting/ur10_exciting_trajectory.npz", 6, STIFF),
        ("ur10_exciting/ur10_exciting_trajectory.db3", 6, STIFF),
        ("double_pendulum_a0/strong_torque/*.npz", 2, STIFF),
        ("double_pendulum_a0/weak_torque/*.npz", 2, STIFF),
        ("xl330_pendulum/raw/*.npz", 1, (STIFF[0], "position_command", HEBI[-1])),
    ],
)
def test_every_measured_set_is_described(
    place: str, joints: int, quantities: tuple[str, ...]
) -> None:
    for path in sorted(LOGS.glob(place))[:2]:
        found = describe_log(path)
        assert len(found.description.joints) == joints
        for sources in found.description.joints.values():
            assert tuple(sources) == quantities
        assert found.unsure


def test_deflection_of_the_unpowered_arm_has_the_sign_of_its_makers() -> None:
    found = describe_log(LOGS / "hebi_arms" / "sample.npz")
    for sources in found.description.joints.values():
        assert sources["deflection"].sign == -1


def counted(names: list[str], texts: set[str]) -> tuple[Table, list[int]]:
    """Return a table that refuses texts, and the number of columns of each read."""
    reads: list[int] = []

    def load(wanted: list[str]) -> Columns:
        reads.append(len(wanted))
        if texts.intersection(wanted):
            raise LogError(f"column '{texts.intersection(wanted).pop()}' is a text")
        return dict.fromkeys(wanted, TIME)

    return Table(names, load), reads


@pytest.mark.slow  # 1.1 s
def test_a_text_among_many_columns_is_found_in_few_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["t", "pos_0", "note", *(f"pos_{index}" for index in range(1, 2000))]
    table, reads = counted(names, {"note"})
    monkeypatch.setattr(describe, "open_tables", lambda paths: table)
    found = describe_log("log.npz")
    assert len(reads) <= 2 * np.log2(len(names)) + 3
    assert len(found.description.joints) == 2000
    assert "note: no column of numbers: excluded" in found.unsure


@pytest.mark.slow  # 0.9 s
def test_many_texts_among_many_columns_are_not_looked_for_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = ["t", *(f"pos_{index}" for index in range(8000))]
    table, reads = counted(names, set(names[2::2]))
    monkeypatch.setattr(describe, "open_tables", lambda paths: table)
    found = describe_log("log.npz")
    assert len(reads) < 1000
    assert "joint_0" in found.description.joints
    assert "pos_7999" in found.unused


def test_a_long_list_of_columns_does_not_hide_what_is_unsure(tmp_path: Path) -> None:
    names = [f"/a_rather_long_name_of_a_robot/state/motors[{k}]" for k in range(12)]
    columns = {f"{name}/q": wave(0.3 + 0.02 * k) for k, name in enumerate(names)}
    columns |= {f"{name}/tau": wave(0.4 + 0.02 * k) for k, name in enumerate(names)}
    np.savez(tmp_path / "log.npz", t=TIME, **columns)  # type: ignore[arg-type]
    found = describe_log(tmp_path / "log.npz")
    lines = [line for line in found.to_toml().splitlines() if line.startswith("# unsure: ")]
    assert max(map(len, lines)) < 420
    (line,) = [line for line in lines if "motors[0]/tau" in line]
    assert " ... " in line
    assert line.endswith("name it joint_torque if a sensor behind the gear measures it")


@pytest.mark.parametrize("name", ["log.csv", "log.npz", "still.npz"])
@pytest.mark.parametrize(
    "joints", [["panda_joint5"], ["panda_joint2", "panda_joint4"], ["panda_joint4", "panda_joint5"]]
)
def test_joints_that_move_are_found_among_all_of_the_file(
    name: str, joints: list[str], tmp_path: Path
) -> None:
    t, k = np.arange(0, 8, 0.01)[:, None], np.arange(1, 8)
    q, tau = 2.35 * np.sin((1 + 0.1 * k) * t + k), np.cos((1 + 0.2 * k) * t + k)
    q[:, 0] *= name != "still.npz"
    path = tmp_path / name
    if path.suffix == ".npz":
        np.savez(path, t=t[:, 0], q=q, tau=tau)
    else:
        columns = {f"q{n}": one for n, one in zip(k, q.T, strict=True)}
        columns |= {f"tau{n}": one for n, one in zip(k, tau.T, strict=True)}
        write_columns(path, {"t": t[:, 0], **columns})
    names = [f"panda_joint{number}" for number in k]
    urdf = chain(tmp_path, *names, limit=0.0).urdf  # limits (0, 0) are none
    assert urdf is not None
    guess = describe_log(path, load_robot(urdf, joints=joints))
    of = "{}{}" if path.suffix == ".csv" else "{}[{}]"
    for joint in joints:
        number = int(joint[-1]) - (path.suffix == ".npz")
        sources = guess.description.joints[joint]
        assert sources["joint_position"].column == of.format("q", number)
        assert sources["joint_position"].unit is None  # (0, 0) are no limits: 4.7 are rad
        assert sources["motor_torque"].column == of.format("tau", number)
    assert {*guess.description.joints} == {*joints}
    assert not any("deg" in one or "no joint of the robot" in one for one in guess.unsure)


def test_names_of_the_user_say_what_the_columns_of_a_file_are(tmp_path: Path) -> None:
    time = np.arange(0, 4, 0.01)
    q = np.column_stack([np.sin(time), np.cos(2 * time)])
    rows = np.column_stack([time, q, np.gradient(q, time, axis=0), 3 * q])
    path, robot = tmp_path / "log.csv", chain(tmp_path, "hip", "knee")
    np.savetxt(path, rows, delimiter=",")
    guess = describe_log(path, robot, columns=["t", "q", "qd", "tau"])
    assert guess.description.to_dict()["time"] == "1"
    of_joints = {
        x: {y: z.column for y, z in of.items()} for x, of in guess.description.joints.items()
    }
    assert of_joints == {
        "hip": {"joint_position": "2", "motor_torque": "6"},
        "knee": {"joint_position": "3", "motor_torque": "7"},
    }
    assert not any("order" in doubt for doubt in guess.unsure)
    whole = ["time", "pos_hip", "pos_knee", "vel_hip", "vel_knee", "eff_hip", "eff_knee"]
    assert describe_log(path, robot, columns=whole).to_toml() == guess.to_toml()
    for names in (["t", "q", "tau"], whole[:-1], [*whole, "more"], ["t"]):
        with pytest.raises(LogError, match="columns= does not name the 7 columns of the log"):
            describe_log(path, robot, columns=names)


@pytest.mark.parametrize(
    ("limits", "shift", "is_shifted"), [(1.8, 2048, True), (1.8, 0, False), (6.0, 2048, False)]
)
def test_counts_about_half_a_turn_beyond_the_limits_have_their_zero_there(
    tmp_path: Path, limits: float, shift: int, is_shifted: bool
) -> None:
    """A servo in the middle of its range reads 2048: every position was off by pi."""
    robot = chain(tmp_path, "pan", "lift", limit=limits)
    time = np.arange(4000) / 200
    columns = {"t": time}
    for joint, rate in (("pan", 0.9), ("lift", 1.3)):
        counts = np.round(4096 / (2 * np.pi) * 1.2 * np.sin(rate * time))
        columns[f"{joint}_goal_position"] = counts + shift
        columns[f"{joint}_present_position"] = np.roll(counts, 4) + shift
    guess = describe_log(columns, robot)
    for sources in guess.description.joints.values():
        zeros = {quantity: source.offset for quantity, source in sources.items()}
        assert zeros.keys() == {"joint_position", "position_command"}
        assert {*zeros.values()} == {-np.pi if is_shifted else 0.0}
    said = [text for text in guess.unsure if "lie about 2048 counts, half a turn" in text]
    assert len(said) == is_shifted


def test_counts_of_a_joint_that_slides_are_read(tmp_path: Path) -> None:
    """Counts per turn are no unit of metres: the draft could not be read, and was not written."""
    robot = one_joint(tmp_path, "prismatic")
    time = np.arange(4000) / 200
    columns = {"t": time, "q_counts": np.round(900 * np.sin(time)), "tau_Nm": np.cos(3 * time)}
    guess = describe_log(columns, robot)
    (text,) = [text for text in guess.unsure if "per m is a guess" in text]
    assert text.startswith("q_counts: in counts: 1024 per m")
    log = read_log(columns, robot, description=guess.description)
    assert np.max(log.joint_position) == pytest.approx(900 / 1024, rel=1e-2)


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ({"pwm": wave(0.5)}, "pwm"),
        ({"pwm": 1500.0 + 200.0 * wave(1.0)}, None),  # the pulses of a servo
        ({"pwm": wave(0.5), "iq": wave(2.0)}, None),
        ({"pwm": wave(0.5), "elbow_voltage": wave(12.0)}, "elbow_voltage"),
        ({"pwm": wave(0.5), "vbus": 0 * TIME + 24.0}, {"column": "pwm", "times": "vbus"}),
    ],
)
def test_a_duty_cycle_is_a_voltage_where_nothing_else_drives_a_joint(
    tmp_path: Path, columns: dict[str, Array], expected: object
) -> None:
    found = guess(tmp_path, t=TIME, elbow_pos=wave(0.5), **columns)
    assert plain(found)["elbow"].get("motor_voltage") == expected
