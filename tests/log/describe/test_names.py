"""The vocabulary of column names: each word has one quantity, and each unit a factor."""

from __future__ import annotations

import inspect
import re
import tomllib
from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from seaid.log import BaseLog, Log, LogDescription
from seaid.log.channels import (
    CHANNELS,
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
from seaid.regressor.structural_identifiability import Sensor

FOLDER = Path(__file__).parents[3]


def test_a_word_has_one_quantity_and_a_quantity_one_rank() -> None:
    """No word is in two quantities, and each quantity has a rank."""
    tables = vocabulary().tables
    words = Counter(word for text in tables["quantities"].values() for word in text.split())
    assert [word for word, count in words.items() if count > 1] == []
    assert tables["ranks"].keys() == tables["quantities"].keys()


def test_a_spelling_has_one_unit_and_a_unit_a_factor_to_si() -> None:
    """No spelling is that of two units, and each unit can be converted."""
    factors = {unit for units in UNIT_FACTORS.values() for unit in units}
    factors |= {*TEMPERATURES, "counts"}
    units = {unit for _, unit in vocabulary().units.values()}
    assert units - factors == set()
    spellings = Counter(
        spelling
        for entry in UNITS["units"].values()
        for spelling in {*entry.get("symbols", "").split(), *entry.get("also", "").split()}
    )
    assert [spelling for spelling, count in spellings.items() if count > 1] == []


def test_prefixes_stand_before_symbols_and_names() -> None:
    """Milli, micro and nano are read before symbols and before words."""
    assert known_unit("mN·m") == ("torque", "mNm")
    assert known_unit("milliradians") == ("position", "mrad")
    assert known_unit("nanoseconds") == ("time", "ns")
    assert UNIT_FACTORS["Nm"]["mNm"] == 1e-3


def test_phrases_count_as_a_whole() -> None:
    """A rotation velocity is one of angles, and a velocity of a base is not."""
    assert kind_of("rot_vel") == "angular_velocity"
    assert kind_of("base_vel") == "velocity"
    assert meaning_of("rot_vel").quantity == "velocity"
    form, stem, axis, factor = place_of("imu_rot_vel_z [deg/s]", "")
    assert (form, stem, axis) == ("axis", "imu_rot_vel", "z")
    assert factor == np.pi / 180


def attributes_of(documented: type) -> dict[str, str]:
    """{attribute: what the docstring of a class has about it}."""
    text = inspect.getdoc(documented) or ""
    entries = re.findall(r"\n(\w[\w, ]*) : (.*(?:\n {4}.*)*)", text)
    return {name: about for names, about in entries for name in names.split(", ")}


def test_fields_and_sensors_are_those_of_the_table_of_channels() -> None:
    """Typed fields and options cannot be made of a table: they are written, and equal to it."""
    others = {"time", "joint_names", "is_prismatic", "base", "report", "description"}
    assert {field.name for field in fields(Log)} - others == {*SENSORS}
    assert {field.name for field in fields(BaseLog)} - {"contacts", "wrenches"} == {*CHANNELS}
    measured = {x for x, row in OF_JOINTS.items() if not (row.is_command or row.is_slow)}
    assert {*get_args(Sensor)} == measured


def test_documented_quantities_and_units_are_those_of_the_table_of_channels() -> None:
    """The docstrings and the page list the same quantities, with their units."""
    about = attributes_of(Log) | attributes_of(BaseLog)
    for row in (*OF_JOINTS.values(), *(OF_BASE[name] for name in CHANNELS)):
        units = ",".join(re.findall(r"\[(.*?)\]", about[row.name]))
        for unit in filter(None, (row.unit, row.prismatic_unit)):
            spelled = unit.replace("Nm", "N m").replace("_per_", "/").replace("s2", "s^2")
            assert spelled in re.split(r",? or |, ?", units), row.name
    described = attributes_of(LogDescription)
    for key, rows in (("joints", OF_JOINTS), ("base", OF_BASE), ("contacts", OF_CONTACTS)):
        assert {*rows} <= {*re.findall(r"\w+", described[key])}
    text = (FOLDER / "docs" / "logs.md").read_text("utf-8")
    documented = re.search(r"Quantities of a joint: (.*?)\. Velocities", text, re.DOTALL)
    assert documented is not None
    assert {*re.findall(r"`(\w+)`", documented[1])} == {*SENSORS}


def test_a_column_of_any_quantity_is_found_in_the_table() -> None:
    """Names that seaid writes are those that it reads."""
    for name, row in OF_JOINTS.items():
        for is_prismatic in (False, True):
            (column,) = row.columns("base", is_prismatic)
            assert quantity_of(column) == row == quantity_of(name)
    for row in OF_BASE.values():
        assert all(quantity_of(column) == row for column in row.columns("base"))
    for row in OF_CONTACTS.values():
        assert all(quantity_of(column) == row for column in row.columns("foot.left"))
    assert quantity_of("knee.speed").kind == ""


NAMES = tomllib.loads((FOLDER / "tests" / "data" / "headers" / "names.toml").read_text("utf-8"))


@pytest.mark.parametrize(
    ("group", "name"), [(group, name) for group in NAMES["group"] for name in group["names"]]
)
def test_name_of_a_column_is_read(group: dict[str, Any], name: str) -> None:
    """The words of a name, a topic or a joint have their meanings, and no others."""
    meaning = meaning_of(name, tuple(group["joints"]))
    values = [getattr(meaning, field) or "" for field in group["fields"]]
    assert values == group["names"][name]
