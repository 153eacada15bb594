"""Cases of measured logs, of position commands, and of what `init` writes for them."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

import seaid
from scripts.example_robots import example_urdf
from scripts.golden_records import (
    Case,
    Records,
    folder_of_files,
    number,
    of_identification,
    of_settings,
    of_validation,
)

MODELS = Path(__file__).resolve().parents[1] / "models"
LOGS = MODELS / "logs"


def measured_robot(table: Mapping[str, Any]) -> seaid.Robot:
    """Return the robot of an entry of `scripts/real_data.toml`."""
    package, _, name = str(table["robot"]).rpartition("/")
    return seaid.load_robot(
        example_urdf(name) if package else MODELS / name,
        MODELS / table["drives"],
        payloads=[seaid.Payload(**payload) for payload in table.get("payload", ())],
        known_bodies=table.get("known_bodies", ()),
    )


def _measured(table: Mapping[str, Any], half: bool = False) -> Records:
    """Identify the logs of an entry, or the first half of the first one."""
    robot = measured_robot(table)
    description = LOGS / table["description"]
    paths = sorted(LOGS.glob(table["logs"]))
    logs = [seaid.read_log(path, robot, description=description) for path in paths]
    if not half:
        found = seaid.identify(robot, logs)
        return of_identification(found) | of_validation(found, logs[0])
    middle = float(np.mean(logs[0].time[[0, -1]]))
    found = seaid.identify(robot, logs[0].between(-np.inf, middle))
    return of_identification(found) | of_validation(found, logs[0].between(middle, np.inf))


def _gear_ratios(table: Mapping[str, Any]) -> Records:
    """Compare the motor angle with the angle behind the gear."""
    robot = measured_robot(table)
    (path,) = LOGS.glob(table["logs"])
    log, behind = (
        seaid.read_log(path, robot, description=LOGS / table[key])
        for key in ("description", "gears")
    )
    turned = behind.motor_position / [robot.drives[joint].ratio for joint in robot.joint_names]
    angles = [np.interp(log.time, behind.time, angle) for angle in turned.T]
    # Between the encoders of motor and gear output there is no spring.
    stiff = {x: seaid.StiffDrive(gear_ratio=drive.ratio) for x, drive in robot.drives.items()}
    both = replace(log, joint_position=np.column_stack(angles))
    found = seaid.check(robot.with_drives(stiff), both)
    return {
        f"{joint} gear_ratio": ["value", x.gear_ratio, x.gear_ratio_error]
        for joint, x in found.joints.items()
    }


def measured_table() -> list[dict[str, Any]]:
    """Return the entries of `scripts/real_data.toml`, and that of a module without a load."""
    content = tomllib.loads((MODELS.parent / "scripts/real_data.toml").read_text("utf-8"))
    module = {"name": "HEBI X5 unloaded", "robot": "hebi_module.urdf", "drives": "hebi_module.toml"}
    module |= {"logs": "hebi_x5_unloaded/*.csv", "description": "hebi_csv_1.toml"}
    tables: list[dict[str, Any]] = [*content["case"], module]
    (ur10,) = (table for table in tables if table["name"] == "UR10")
    bag = {"name": "UR10, bag", "logs": "ur10_exciting/*.db3", "description": "ur10_bag.toml"}
    return [*tables, ur10 | bag]


_CHEAP = ("HEBI sample", "HEBI virtual_spring")


def measured_cases() -> list[Case]:
    """Return the cases of measured logs."""
    cases = []
    for table in measured_table():
        name = table["name"]
        if "gains" in table:
            cases.append(Case(name, "commands", partial(_xl330_commands, table)))
            continue
        group = "XL330" if name.startswith("XL330") else "measured"
        cases.append(Case(name, group, partial(_measured, table), quick=name in _CHEAP))
        if "gears" in table:
            cases.append(Case(f"{name}, gear ratios", group, partial(_gear_ratios, table)))
        if name == "UR10":
            cases.append(Case(f"{name}, half", group, partial(_measured, table, half=True)))
    return cases


def _xl330_commands(table: Mapping[str, Any]) -> Records:
    """Identify the logs of several gains together."""
    robot, gains = measured_robot(table), table["gains"]
    sets: dict[str, tuple[seaid.Robot, list[seaid.Log]]] = {}
    for path in sorted(LOGS.glob(table["logs"])):
        with np.load(path) as columns:
            gain, supply = (float(columns[gains[key]][0]) for key in ("gain", "supply"))
        law = {
            "position_gain_Nm_per_rad": gains["factor"] * gain * supply,
            "torque_limit_Nm": supply,
        }
        drives = {
            joint: replace(drive, controller=replace(drive.controller, **law))
            for joint, drive in robot.drives.items()
            if drive.controller is not None
        }
        log = seaid.read_log(path, robot, description=LOGS / table["description"])
        entry = sets.setdefault(f"{gain:g} at {supply:g} V", (robot.with_drives(drives), []))
        entry[1].append(log)
    found = seaid.identify_conditions(sets, condition_specific=()).identifications
    name, first = next(iter(found.items()))
    log = sets[name][1][0]
    error = np.mean(np.abs(seaid.replay(first.robot, log).joint_position - log.joint_position))
    return of_identification(first) | {"error of the replay": number(error)}


@cache
def _go2() -> tuple[seaid.Robot, seaid.Log, seaid.Log]:
    """Return the Go2 with known bodies, the first two thirds of its log, and the last one."""
    with np.load(LOGS / "go2_commands/go2_second_half.npz") as table:
        columns = {name: np.asarray(table[name]) for name in table}
    joints = [name.split(".")[0] for name in columns if name.endswith(".position_rad")]
    drive = seaid.StiffDrive(
        friction=("viscous", "coulomb", "offset"),
        motor_input="position_command",
        controller=seaid.Controller(position_gain_Nm_per_rad=20.0, velocity_gain_Nms_per_rad=1.5),
    )
    robot = seaid.load_robot(
        example_urdf("go2.urdf"),
        dict.fromkeys(joints, drive),
        joints=joints,
        known_bodies="all",
    )
    positions, commands = (
        np.column_stack([columns[f"{joint}.{name}_rad"] for joint in robot.joint_names])
        for name in ("position", "command")
    )
    log = seaid.Log(
        time=columns["time_s"],
        joint_names=robot.joint_names,
        joint_position=positions,
        motor_position=np.full_like(positions, np.nan),
        motor_torque=np.full_like(positions, np.nan),
        position_command=commands,
        is_prismatic=robot.is_prismatic,
    )
    begin, end = log.time[0], log.time[-1]
    middle = begin + 2 / 3 * (end - begin)
    return robot, log.between(-np.inf, middle), log.between(middle, np.inf)


@cache
def go2_found() -> seaid.Identification:
    """Return the Go2 as identified from the first two thirds of its log."""
    robot, log, _ = _go2()
    return seaid.identify(robot, log)


def _go2_records(refined: bool) -> Records:
    found, (_, log, unseen) = go2_found(), _go2()
    if refined:
        found = seaid.refine(found, log)
    moved = seaid.replay(found.robot, unseen).joint_position
    error = np.mean(np.abs(moved - unseen.joint_position))
    return of_identification(found) | {"error of the replay": number(error)}


def command_cases() -> list[Case]:
    """Return the cases of the Go2."""
    make = partial(Case, group="commands", batch="Go2")
    return [
        make(name="Go2", records=partial(_go2_records, False)),
        make(name="Go2, refined", records=partial(_go2_records, True)),
    ]


def first_project(
    urdf: Path | str, files: Sequence[Path], drives: str = "", **options: Any
) -> Records:
    """Write a first project for copies of files, and return its settings."""
    with folder_of_files() as folder:
        shutil.copy(urdf, folder / "robot.urdf")
        logs = [folder / f"run_{place}{path.suffix}" for place, path in enumerate(files, 1)]
        for path, copy in zip(files, logs, strict=True):
            shutil.copy(path, copy)
        if drives:
            shutil.copy(MODELS / drives, folder / "drives.toml")
            options |= {"drives": folder / "drives.toml"}
        made = seaid.write_first_project(folder / "robot.urdf", logs, folder=folder, **options)
        records: Records = {"doubts": number(len(made.doubts))}
        for path in made.files:
            records |= of_settings(path)
        return records


def _first_ur10(pattern: str) -> Records:
    return first_project(example_urdf("ur10_robot.urdf"), [*LOGS.glob(f"ur10_exciting/{pattern}")])


def _first_go2(gains: bool) -> Records:
    controller = seaid.Controller(position_gain_Nm_per_rad=20.0, velocity_gain_Nms_per_rad=1.5)
    options: dict[str, Any]
    options = {"controllers": dict.fromkeys(_go2()[0].joint_names, controller)} if gains else {}
    return first_project(
        example_urdf("go2.urdf"), [LOGS / "go2_commands/go2_second_half.npz"], **options
    )


def init_cases() -> list[Case]:
    """Return the cases of what `init` writes for measured logs."""
    init = partial(Case, group="init")
    of_files: dict[str, tuple[str, list[str]]] = {
        "HEBI, 2 joints": ("hebi_arm_2.urdf", ["hebi_arms/grav_comp_bad.npz"]),
        "HEBI, 3 joints": ("hebi_arm_3.urdf", ["hebi_arms/ps4_repeat_waypoints.npz"]),
        "HEBI, 5 joints": ("hebi_arm_5.urdf", ["hebi_arms/capstone_repeat_waypoints.npz"]),
        "HEBI, X5": ("hebi_module.urdf", ["hebi_x5_unloaded/exampleLog.csv"]),
        "double pendulum": (
            "double_pendulum_a0.urdf",
            sorted(
                str(path.relative_to(LOGS))
                for path in LOGS.glob("double_pendulum_a0/weak_torque/*.npz")
            ),
        ),
        "XL330": (
            "xl330_pendulum.urdf",
            sorted(str(path.relative_to(LOGS)) for path in LOGS.glob("xl330_pendulum/raw/*"))[:2],
        ),
    }
    return [
        *(
            init(
                name=f"init, {name}",
                records=partial(first_project, MODELS / urdf, [LOGS / path for path in logs]),
                quick=name == "HEBI, X5",
            )
            for name, (urdf, logs) in of_files.items()
        ),
        init(name="init, UR10", records=partial(_first_ur10, "*.npz")),
        init(name="init, UR10, bag", records=partial(_first_ur10, "*.db3")),
        init(name="init, Go2", records=partial(_first_go2, False), batch="Go2"),
        init(name="init, Go2, gains", records=partial(_first_go2, True), batch="Go2"),
    ]
