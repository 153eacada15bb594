"""The vocabulary of column names: each word has one quantity, and each unit a factor."""

from __future__ import annotations

from collections import Counter

import numpy as np

from seaid.log.describe.names import known_unit, meaning_of, vocabulary
from seaid.log.describe.vectors import kind_of, place_of
from seaid.log.log import TEMPERATURES, UNIT_FACTORS


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
        for entry in vocabulary().tables["units"].values()
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
