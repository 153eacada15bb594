"""describe_log: columns of joints are what their names and samples say, with the doubts."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives import StiffDrive
from seaid.errors import LogError
from seaid.legged import load_robot
from seaid.log import Description, describe, describe_log, read_log
from seaid.log.readers.table import Table
from tests.log.describe.signals import GOAL, RATE, TIME, wave
from tests.one_joint import chain, one_joint
from tests.plants import write_columns

HEADERS = Path(__file__).parents[2] / "data" / "headers"
Columns = dict[str, Array]


def guess(folder: Path, **columns: Array) -> Description:
    np.savez(folder / "log.npz", **columns)  # type: ignore[arg-type]
    return describe_log(folder / "log.npz")


def plain(description: Description) -> dict[str, Any]:
    joints: dict[str, Any] = description.description.to_dict()["joints"]
    return joints


LABELS = tomllib.loads((HEADERS / "columns.toml").read_text("utf-8"))["labels"]


@pytest.mark.parametrize("case", LABELS, ids=[str(case["labels"]) for case in LABELS])
def test_labels_are_joints_by_name_by_number_or_in_order(
    tmp_path: Path, case: dict[str, list[str]]
) -> None:
    """Labels of a log are joints of the robot; what is not matched by its name is said."""
    columns = {"t": TIME}
    for k, label in enumerate(case["labels"]):
        columns |= {f"ang_{label}": wave(0.3 + 0.1 * k), f"tau_{label}_Nm": wave(0.35 + 0.1 * k)}
    inferred = describe_log(columns, chain(tmp_path, *case["joints"]))
    positions = {joint: of["joint_position"] for joint, of in plain(inferred).items()}
    named = zip(case["expected"], case["labels"], strict=False)
    assert positions == {joint: f"ang_{label}" for joint, label in named}
    text = "\n".join(inferred.unsure)
    assert str(case.get("doubt", "")) in text
    assert "doubt" in case or "in their order" not in text


def test_names_with_line_breaks_and_quotes_make_a_toml_that_reads(tmp_path: Path) -> None:
    """No name breaks out of its line, in a file or on a terminal."""
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


def test_the_robot_tells_degrees_and_the_description_reads(tmp_path: Path) -> None:
    """An angle beyond the limits of a joint is in degrees; what is written is what is read."""
    robot = chain(tmp_path, "hip_pitch", "knee_pitch", limit=1.0)
    columns = {"t": TIME, "q_hip": GOAL, "tau_hip": wave(0.9)}
    columns |= {"q_knee": wave(0.5, 5.0), "tau_knee": wave(1.0)}
    path = write_columns(tmp_path / "log.npz", columns)
    description = describe_log(path, robot)
    assert plain(description)["knee_pitch"]["joint_position"] == {"column": "q_knee", "unit": "deg"}
    path.with_suffix(".toml").write_text(description.to_toml())
    log = read_log(path, robot)
    np.testing.assert_allclose(log.joint_position[:, 1], np.deg2rad(wave(0.5, 5.0)), rtol=1e-12)


@pytest.mark.parametrize("pattern", ["{}{}", "{}[{}]"])
@pytest.mark.parametrize("joints", [("joint5",), ("joint2", "joint4"), ("joint4", "joint5")])
@pytest.mark.parametrize("is_still", [False, True])
def test_joints_that_move_are_found_among_all_of_the_file(
    pattern: str, joints: tuple[str, ...], is_still: bool, tmp_path: Path
) -> None:
    """Labels count all joints of the URDF, from one or, in arrays, from zero."""
    first, columns = 1 if pattern == "{}{}" else 0, {"t": TIME}
    for k in range(7):
        q = 2.35 * np.sin((1 + 0.1 * k) * TIME + k)
        columns[pattern.format("q", k + first)] = 0 * q if is_still and k == 0 else q
        columns[pattern.format("tau", k + first)] = np.cos((1 + 0.2 * k) * TIME + k)
    urdf = chain(tmp_path, *(f"joint{k}" for k in range(1, 8)), limit=0.0).urdf
    assert urdf is not None
    inferred = describe_log(columns, load_robot(urdf, joints=joints))
    numbers = {joint: int(joint[-1]) - 1 + first for joint in joints}
    assert {
        joint: (of["joint_position"].column, of["joint_position"].unit, of["motor_torque"].column)
        for joint, of in inferred.description.joints.items()
    } == {
        joint: (pattern.format("q", k), None, pattern.format("tau", k))  # limits (0, 0) are none
        for joint, k in numbers.items()
    }
    assert not any("deg" in text or "no joint of the robot" in text for text in inferred.unsure)


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


def test_counts_of_motors_follow_from_the_gear_ratio_and_those_of_the_joints(
    tmp_path: Path,
) -> None:
    """A motor turns many times: its counts were a guess by their size, and the wheel a joint's."""
    robot = chain(tmp_path, "hip", "wheel", limit=1.0)
    geared = {x: StiffDrive(gear_ratio=36.0) for x in robot.joint_names}
    turns = GOAL / np.ptp(GOAL) / 8  # of the joint, which stays within its limits
    columns = {
        "t": TIME,
        "hip_actual_position_inc": np.round(36 * 2**12 * turns),
        "hip_aux_encoder_inc": np.round(2**14 * turns),
        "wheel_actual_position_inc": np.round(36 * 2**12 * 40 * turns),
    }
    columns |= {f"{joint}_torque_Nm": wave(0.9) for joint in geared}
    guess = describe_log(columns, robot.with_drives(geared))
    sources = guess.description.joints
    hip = [sources["hip"][x].counts_per_turn for x in ("motor_position", "joint_position")]
    assert hip[1] == 4 * (hip[0] or 0)
    assert [*sources["wheel"]] == ["motor_position", "motor_torque"]
    assert sources["wheel"]["motor_position"].counts_per_turn == hip[0]
    said = "\n".join(guess.unsure)
    assert "by the gear ratio and the guess for hip_aux_encoder_inc" in said
    assert f"hip_aux_encoder_inc: in counts: {hip[1]:.0f} per turn is a guess" in said


def test_an_estimate_of_a_drive_next_to_a_joint_encoder_is_that_of_its_motor() -> None:
    """The columns of an ODrive: turns of the motor, of which the torque is, too."""
    columns = {
        "t": TIME,
        "axis_hip_pos_estimate_turns": 24 * GOAL / (2 * np.pi),
        "axis_hip_torque_estimate_Nm": wave(0.9),
        "hip_output_encoder_deg": np.rad2deg(GOAL),
    }
    guess = describe_log(columns)
    (sources,) = guess.description.joints.values()
    assert {x: (y.column, y.unit, y.side) for x, y in sources.items()} == {
        "motor_position": ("axis_hip_pos_estimate_turns", "turn", None),
        "joint_position": ("hip_output_encoder_deg", "deg", None),
        "motor_torque": ("axis_hip_torque_estimate_Nm", None, None),
    }
    assert not any("is not used" in text for text in guess.unsure)
    smoothed = columns | {"axis_hip_pos_estimate_turns": GOAL / (2 * np.pi)}
    (alone,) = describe_log(smoothed).description.joints.values()
    assert "motor_position" not in alone


@pytest.mark.parametrize(("given", "is_said"), [(100.0, False), (50.0, True), (None, True)])
def test_a_ratio_of_the_encoders_is_said_where_it_is_not_that_of_the_drive(
    tmp_path: Path, given: float | None, is_said: bool
) -> None:
    """A spring makes it three per cent larger than that of the gear."""
    drive = None if given is None else {"type": "series_elastic", "gear_ratio": given}
    columns = {"t": TIME, "q_motor_rad": 103 * GOAL, "q_joint_rad": GOAL, "tau_Nm": wave(0.9)}
    guess = describe_log(columns, one_joint(tmp_path, drive=drive))
    said = [text for text in guess.unsure if "times as far" in text]
    assert len(said) == is_said


def test_names_of_the_user_say_what_the_columns_of_a_file_are(tmp_path: Path) -> None:
    """A name stands for a column, or for one of each joint; what cannot be divided is refused."""
    rows = np.column_stack([TIME, GOAL, wave(0.7), RATE, RATE, 3 * GOAL, 3 * wave(0.7)])
    path, robot = tmp_path / "log.csv", chain(tmp_path, "hip", "knee")
    np.savetxt(path, rows, delimiter=",")
    inferred = describe_log(path, robot, columns=["t", "q", "qd", "tau"])
    assert inferred.description.to_dict() == {
        "time": "1",
        "joints": {
            joint: {"joint_position": q, "motor_torque": {"column": tau, "side": "joint"}}
            for joint, q, tau in (("hip", "2", "6"), ("knee", "3", "7"))
        },
    }
    assert not any("order" in doubt for doubt in inferred.unsure)
    whole = ["time", "pos_hip", "pos_knee", "vel_hip", "vel_knee", "eff_hip", "eff_knee"]
    assert describe_log(path, robot, columns=whole).to_toml() == inferred.to_toml()
    for names in (["t", "q", "tau"], whole[:-1], [*whole, "more"], ["t"]):
        with pytest.raises(LogError, match="columns= does not name the 7 columns of the log"):
            describe_log(path, robot, columns=names)


@pytest.mark.slow  # 2.0 s
@pytest.mark.parametrize(
    ("count", "texts", "most_reads"), [(2000, slice(2, 3), 25), (8000, slice(2, None, 2), 1000)]
)
def test_texts_among_many_columns_are_found_in_few_reads(
    monkeypatch: pytest.MonkeyPatch, count: int, texts: slice, most_reads: int
) -> None:
    """One text takes 2 log2(n) reads; where there are many, the search is given up."""
    names = ["t", *(f"pos_{index}" for index in range(count))]
    words, reads = {*names[texts]}, list[int]()

    def load(wanted: list[str]) -> Columns:
        reads.append(len(wanted))
        if words.intersection(wanted):
            raise LogError(f"column '{min(words.intersection(wanted))}' is a text")
        return dict.fromkeys(wanted, TIME)

    monkeypatch.setattr(describe, "open_tables", lambda paths: Table(names, load))
    inferred = describe_log("log.npz")
    assert len(reads) <= most_reads
    assert "joint_0" in inferred.description.joints
    unread = [*inferred.unused, *(text.partition(":")[0] for text in inferred.unsure)]
    assert names[texts][-1] in unread


def test_a_description_is_shown_shortly_with_its_doubts(tmp_path: Path) -> None:
    """A table of joints, then doubts, of which long lists of columns hide none, then the rest."""
    text = str(guess(tmp_path, t=TIME, q=GOAL, tau=wave(1.0), extra=wave(2.0)))
    assert text.splitlines()[0].split() == ["joint", "quantity", "column", "unit", "time"]
    assert text.splitlines()[1].split() == ["joint", "joint_position", "q", "SI", "t"]
    assert "unsure: q (moves by 2): taken for rad" in text
    assert text.endswith("not used: extra")
    names = [f"/a_rather_long_name_of_a_robot/state/motors[{k}]" for k in range(12)]
    columns = {f"{name}/q": wave(0.3 + 0.02 * k) for k, name in enumerate(names)}
    columns |= {f"{name}/tau": wave(0.4 + 0.02 * k) for k, name in enumerate(names)}
    toml = describe_log({"t": TIME, **columns}).to_toml()
    lines = [line for line in toml.splitlines() if line.startswith("# unsure: ")]
    assert max(map(len, lines)) < 420
    (line,) = [line for line in lines if "motors[0]/tau" in line]
    assert " ... " in line
    assert line.endswith("name it joint_torque if a sensor behind the gear measures it")
