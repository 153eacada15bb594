"""Any drive is the same after its file, by its values, and in a set."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given, reject
from hypothesis import strategies as st

from seaid.drives import Controller, FrictionTerm, MotorInput, SpringTerm
from seaid.drives.drives import Drive, SeriesElasticDrive, StiffDrive
from seaid.drives.terms import JointFrictionTerm, ParallelSpringTerm
from seaid.drives.toml import read_drives, write_drives
from seaid.errors import RobotError
from tests.experiments import arm, leg

FIELDS = {
    "friction": get_args(FrictionTerm),
    "parallel_spring": get_args(ParallelSpringTerm),
    "spring": get_args(SpringTerm),
    "joint_friction": get_args(JointFrictionTerm),
}


@st.composite
def drives(draw: st.DrawFn) -> Drive:
    """Return a drive with some terms of each kind, and values of some of their parameters."""
    is_elastic = draw(st.booleans())
    options: dict[str, Any] = {
        field: tuple(draw(st.lists(st.sampled_from(terms), unique=True, max_size=4)))
        for field, terms in FIELDS.items()
        if is_elastic or field in ("friction", "parallel_spring")
    }
    options["gear_ratio"] = draw(st.floats(1.0, 300.0))
    options["motor_input"] = draw(st.sampled_from(get_args(MotorInput)))
    options["extra_terms"] = draw(st.sampled_from([(), ("c*theta_M_dot**3",)]))
    options["transmission"] = draw(st.sampled_from([{}, {"a": 1.0, "b": -0.5}]))
    if options["motor_input"] == "position_command":
        options["controller"] = Controller(position_gain_Nm_per_rad=draw(st.floats(1.0, 1e3)))
    try:
        drive = (SeriesElasticDrive if is_elastic else StiffDrive)(**options)
        names = [name for name in drive.parameter_names if draw(st.booleans())]
        valued = drive.with_values({name: draw(st.floats(1e-3, 1e3)) for name in names})
        known = tuple(name for name in names[:2] if draw(st.booleans()))
        return replace(valued, known=known)
    except RobotError:  # terms that exclude each other, or a nonlinear spring without stiffness
        reject()


@given(one=drives(), other=drives())
def test_any_drives_are_the_same_after_writing_and_reading(
    one: Drive, other: Drive, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("drives") / "drives.toml"
    write_drives({"a": one, "b": other}, path)
    assert read_drives(path) == {"a": one, "b": other}
    assert {one: 1}[replace(one)] == 1
    assert one.without_nominal().with_values(one.values) == one
    assert set(one.without_nominal().values) <= set(one.values)


def test_drives_of_robots_are_the_same_after_writing_and_reading(tmp_path: Path) -> None:
    for written in (leg().drives, arm().drives, {"hip": StiffDrive(motor_inertia_kg_m2=1e-4)}):
        write_drives(written, tmp_path / "drives.toml")
        read = read_drives(tmp_path / "drives.toml")
        assert {joint: drive.ratio for joint, drive in read.items()} == {
            joint: drive.ratio for joint, drive in written.items()
        }
        assert all(read[joint].values == drive.values for joint, drive in written.items())
