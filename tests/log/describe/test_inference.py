"""describe_log on the headers of 130 real logs: what each column is, or that it is doubtful."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives import Controller
from seaid.errors import LogError
from seaid.log import Description, describe_log
from seaid.log.describe.names import meaning_of
from tests.log.describe.signals import columns_of
from tests.one_joint import chain

FOLDER = Path(__file__).parents[2] / "data" / "headers"
HEADERS = tomllib.loads((FOLDER / "headers.toml").read_text("utf-8"))["header"]
MORE = tomllib.loads((FOLDER / "more_headers.toml").read_text("utf-8"))["header"]
TWENTY = tomllib.loads((FOLDER / "twenty_headers.toml").read_text("utf-8"))["header"]
ALL = HEADERS + MORE + TWENTY
DEVELOP = [one for one in HEADERS if one.get("develop")]
HELD_OUT = [one for one in HEADERS if not one.get("develop")]
FIRST_HALF = [one for one in MORE if one["half"] == 1]
SECOND_HALF = [one for one in MORE if one["half"] == 2]
LAST = [one for one in MORE if one["half"] == 3]
TIME: Array = np.linspace(0.0, 3.99, 400)
MOTIONS = ("position", "velocity", "acceleration")
LEAST = 0.9
"""Share of the columns that must be right."""

SURE = 0.75
"""Share of those right that must not be listed as doubtful."""

SIZES = {"rad": 1.0, "deg": 57.3, "turn": 0.159, "counts": 652.0, "s": 1.0, "ms": 1e3, "us": 1e6}
SIZES |= {"ns": 1e9, "mrad": 1e3, "rpm": 9.55, "deg/s": 57.3, "mA": 1e3, "mNm": 1e3}
NEVER_READ = ("velocity", "acceleration", "temperature")
"""Quantities that are never commands, or never read from a log."""
NO_QUANTITY = ("other", "doubtful", "supply", "flag")
SI = {"position": "rad", "torque": "Nm", "current": "A", "voltage": "V", "time": "s"}
SI["temperature"] = "degC"


@dataclass(frozen=True)
class Truth:
    """What a column is; see the head of the file of headers."""

    column: str
    joint: str
    quantity: str
    kind: str
    side: str
    unit: str
    role: str
    doubtful: bool


def truths(header: dict[str, Any]) -> Iterator[Truth]:
    """Yield the truth of every column of a header."""
    for pattern, text in header["columns"].items():
        main, *more = text.split(", ")
        words, _, unit = main.partition(" in ")
        quantity, side = (*words.split(), "")[:2]
        named = "{}" in pattern
        pairs = zip(header["joints"], header["labels"], strict=True)
        for joint, label in pairs if named else [(header["joints"][0], "")]:
            yield Truth(
                column=pattern.replace("{}", label),
                joint=joint if named or len(header["joints"]) == 1 else "",
                quantity="" if quantity in NO_QUANTITY else quantity,
                kind=quantity,
                side=side,
                unit=unit,
                role=next((one for one in more if one != "doubtful"), ""),
                doubtful="doubtful" in (quantity, *more),
            )


def samples(truth: Truth, number: int) -> Array:
    """Return samples as such a column has them: a motion of each joint, its derivatives, a torque.

    The side of the motor turns fifty times as far.
    """
    size, seed = SIZES.get(truth.unit, 1.0), np.random.default_rng(number)
    noise = 1e-3 * seed.standard_normal(len(TIME))
    if truth.quantity == "time":
        return size * TIME
    if truth.quantity == "temperature":
        return 40 + 0.1 * (number % 3) * TIME
    if truth.kind == "supply":
        return 24 + noise
    if truth.kind == "flag":
        return np.repeat(seed.integers(0, 4, 8), len(TIME) // 8)
    rate, start = 2 * np.pi * seed.uniform(0.3, 0.9), seed.uniform(0, 6)
    if truth.quantity in MOTIONS and truth.role in ("", "command"):  # of one motion per joint
        of_joint = np.random.default_rng([len(truth.joint), *truth.joint.encode()])
        rate, start = 2 * np.pi * of_joint.uniform(0.3, 0.9), of_joint.uniform(0, 6)
        start += 0.05 * (truth.role == "command")
    size *= 50.0 if truth.side == "motor" and truth.quantity in MOTIONS else 1.0
    order = MOTIONS.index(truth.quantity) if truth.quantity in MOTIONS else 0
    wave = rate**order * np.sin(rate * TIME + start + order * np.pi / 2)
    values = size * (wave + noise)
    return np.round(values) if truth.unit == "counts" else values


def described(header: dict[str, Any], folder: Path) -> Description:
    """Return the inference for a log with this header and likely samples."""
    robot = chain(folder, *header["joints"])
    columns = {one.column: samples(one, k) for k, one in enumerate(truths(header))}
    names = ",".join(f'"{name}"' for name in columns)
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / "log.csv", table, fmt="%.9g", delimiter=",", header=names, comments="")
    return describe_log(folder / "log.csv", robot)


def used_as(found: Description) -> dict[str, tuple[str, str, str | None]]:
    """Return {column: (joint, quantity, unit)} of the columns that a description uses."""
    used: dict[str, tuple[str, str, str | None]] = {}
    for joint, sources in found.description.joints.items():
        for quantity, source in sources.items():
            for column in source.used:
                name = "supply" if column == source.times else quantity
                used[column] = (joint, name, source.unit)
            if source.time is not None and source.time.column:
                used[source.time.column] = ("", "time", source.time.unit)
    clock = found.description.time
    if clock is not None and clock.column:
        used[clock.column] = ("", "time", clock.unit)
    return used


def is_right(
    header: dict[str, Any], truth: Truth, used: tuple[str, str, str | None] | None
) -> bool:
    """Return whether a column was read and used as what it is."""
    is_raw = truth.quantity != "" and (not truth.role or truth.quantity in NEVER_READ)
    if used is None:
        meaning = meaning_of(truth.column, header["joints"])
        is_needed = is_raw and truth.quantity in ("position", "torque", "current")
        is_role_read = meaning.is_raw == is_raw or truth.quantity in NEVER_READ
        is_read = meaning.quantity == truth.quantity and is_role_read
        return not truth.quantity or (is_read and not is_needed)
    joint, quantity, unit = used
    if quantity == "supply" or truth.quantity == "duty":  # their product is a voltage
        return truth.kind == quantity or quantity == "motor_voltage"
    if quantity.endswith("_command"):  # of a joint without torque
        kind = quantity.removesuffix("_command")
        is_command = (truth.quantity, truth.role) == (kind, "command")
        usual = {"position": "rad", "velocity": "rad/s", "torque": "Nm"}[kind]
        return is_command and joint == truth.joint and (unit or usual) == (truth.unit or usual)
    side, kind = quantity.split("_") if "_" in quantity else ("", quantity)
    wanted_side = truth.side if kind in ("position", "torque") else ""
    return (
        is_raw
        and kind == truth.quantity
        and (joint == truth.joint or kind == "time")
        and wanted_side in ("", side)
        and (unit or SI[kind]) == (truth.unit or unit or SI[kind])
    )


@cache
def judged(place: int) -> list[tuple[Truth, bool, bool]]:
    """Return each column of a header, whether it is right, and whether it is listed as doubtful."""
    result, header = [], ALL[place]
    try:
        with TemporaryDirectory() as folder:
            found = described(header, Path(folder))
        used, text = used_as(found), "\n".join(found.unsure)
    except LogError as problem:  # no column that looks like a position: all are listed
        used, text = {}, str(problem)
    for truth in truths(header):
        listed = re.search(rf"(?<![\w.]){re.escape(truth.column)}(?![\w.])", text) is not None
        right = truth.doubtful and (listed or truth.column not in used)
        result.append((truth, right or is_right(header, truth, used.get(truth.column)), listed))
    return result


@pytest.mark.parametrize("place", range(len(ALL)), ids=[one["name"] for one in ALL])
def test_no_column_of_a_real_header_is_wrong_without_being_listed(place: int) -> None:
    wrong = [one.column for one, right, listed in judged(place) if not right | listed]
    assert wrong == []


@pytest.mark.parametrize(
    "headers",
    [DEVELOP, HELD_OUT, FIRST_HALF, SECOND_HALF, LAST, TWENTY],
    ids=["developed on", "held out", "first half", "second half", "last", "twenty"],
)
def test_most_columns_of_real_headers_are_right(headers: list[dict[str, Any]]) -> None:
    found = [one for header in headers for one in judged(ALL.index(header))]
    assert np.mean([right for _, right, _ in found]) >= LEAST
    sure = [not listed for truth, right, listed in found if right and not truth.doubtful]
    assert np.mean(sure) >= SURE


def gains_of(controller: Controller) -> list[float]:
    return [controller.position_gain_Nm_per_rad, controller.velocity_gain_Nms_per_rad]


CASES = tomllib.loads((FOLDER / "columns.toml").read_text("utf-8"))["case"]


@pytest.mark.parametrize("case", CASES, ids=[str([*case["columns"]]) for case in CASES])
def test_columns_are_what_their_names_and_samples_say(tmp_path: Path, case: dict[str, Any]) -> None:
    """Each quantity has its column, side and unit, no column more is used, and a guess is said."""
    robot = chain(tmp_path, *case["robot"]) if "robot" in case else None
    if "refused" in case:
        with pytest.raises(LogError, match=case["refused"]):
            describe_log(columns_of(case), robot)
        return
    inferred = describe_log(columns_of(case), robot)
    doubts, content = "\n".join(inferred.unsure), inferred.description.to_dict()
    assert case.get("doubt", "") in doubts
    assert "no_doubt" not in case or not re.search(case["no_doubt"], doubts)
    assert case.get("assumed", "") in "\n".join(inferred.assumed)
    assert case.get("joints") in (None, content["joints"])
    assert case.get("gains") in (None, {joint: gains_of(x) for joint, x in inferred.gains.items()})
    assert case.get("time") in (None, content.get("time", False))
    for kind, text in (("unsure", doubts), ("assumed", "\n".join(inferred.assumed))):
        assert not text or f"{kind}: {text.splitlines()[0]}" in f"{inferred}{inferred.to_toml()}"


@pytest.mark.parametrize(("first", "count"), [(1, 0), (0, 0), (7, 1)])
def test_a_column_without_a_name_is_the_numbers_of_the_rows_or_the_last_one_in_doubt(
    tmp_path: Path, first: int, count: int
) -> None:
    """Where the first cells number the rows all columns keep their names."""
    rows = np.column_stack([first + np.arange(len(TIME)), TIME, np.sin(TIME), np.cos(TIME)])
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, fmt="%.6g", delimiter=",", header="t,q,tau", comments="")
    inferred = describe_log(path)
    assert sum("taken for the last column" in doubt for doubt in inferred.unsure) == count
    assert inferred.unused == ("unnamed",)
    assert inferred.description.joints["joint"]["joint_position"].column == "q"
