"""Drives and their files: any drive is the same after its file, and what is wrong is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given, reject
from hypothesis import strategies as st

from seaid.drives import (
    PARAMETERS,
    PARAMETERS_OF,
    AngleRatio,
    Controller,
    Drive,
    SeriesElasticDrive,
    StiffDrive,
    read_drives,
    terms,
    unit_of,
    write_drives,
)
from seaid.drives.toml import drives_from_mapping
from seaid.errors import RobotError
from tests.experiments import arm, leg

FIELDS = ("friction", "parallel_spring", "spring", "joint_friction")
HARMONICS = {"motor": [1], "joint": [3]}
OPTIONAL: dict[str, list[Any]] = {
    "extra_terms": [("c*theta_M_dot**3",)],
    "transmission": [{"a": 1.0, "b": -0.5}],
    "torque_ripple": [HARMONICS, {"joint": [12], "motor": [4, 6]}],
    "angle_ratio": [
        AngleRatio(cos=(0.24,), sin=(-0.07, 0.1)),
        AngleRatio(angle_rad=(-1.2, 0.0, 2.0), ratio=(1.1, 0.9, 1.4)),
    ],
}


@st.composite
def drives(draw: st.DrawFn) -> Drive:
    """Return a drive with some terms of each kind, and values of some of their parameters."""
    is_elastic = draw(st.booleans())
    options: dict[str, Any] = {
        field: tuple(
            draw(st.lists(st.sampled_from([*PARAMETERS_OF[field]]), unique=True, max_size=4))
        )
        for field in FIELDS
        if is_elastic or field in ("friction", "parallel_spring")
    }
    options["gear_ratio"] = draw(st.floats(1.0, 300.0))
    options["motor_input"] = draw(st.sampled_from(get_args(terms.MotorInput)))
    field = draw(st.sampled_from(["", *OPTIONAL, "transmission_error"]))
    if field == "transmission_error":
        options |= {field: {**HARMONICS, "mesh": [2]}, "spring": ("linear",)}
    elif field:
        options[field] = draw(st.sampled_from(OPTIONAL[field]))
    if options["motor_input"] == "position_command":
        options["controller"] = Controller(position_gain_Nm_per_rad=draw(st.floats(1.0, 1e3)))
    try:
        drive = (SeriesElasticDrive if is_elastic else StiffDrive)(**options)
        names = [name for name in drive.parameter_names if draw(st.booleans())]
        valued = drive.with_values({name: draw(st.floats(1e-3, 1e3)) for name in names})
        known = tuple(name for name in names[:2] if draw(st.booleans()))
        return replace(valued, known=known)
    except (RobotError, TypeError):  # terms that exclude each other, or that only a spring has
        reject()


@given(one=drives(), other=drives())
def test_any_drives_are_the_same_after_writing_and_reading(
    one: Drive, other: Drive, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """By their values and in a set, too; without the nominal ones, known values alone stay."""
    path = tmp_path_factory.mktemp("drives") / "drives.toml"
    write_drives({"a": one, "b": other}, path)
    assert read_drives(path) == {"a": one, "b": other}
    assert {one: 1}[replace(one)] == 1
    assert one.without_nominal().with_values(one.values) == one
    unknown = set(one.own_values) - {"motor_inertia", *one.known}
    assert set(one.without_nominal().own_values) == set(one.own_values) - unknown


def test_drives_of_robots_are_the_same_after_writing_and_reading(tmp_path: Path) -> None:
    """Radii of drums and pulleys, ratios in rad/m, and a drive without any ratio."""
    for written in (leg().drives, arm().drives, {"hip": StiffDrive(motor_inertia_kg_m2=1e-4)}):
        write_drives(written, tmp_path / "drives.toml")
        read = read_drives(tmp_path / "drives.toml")
        assert {joint: drive.ratio for joint, drive in read.items()} == {
            joint: drive.ratio for joint, drive in written.items()
        }
        assert all(read[joint].values == drive.values for joint, drive in written.items())


def test_values_are_read_under_keys_with_units() -> None:
    """Each parameter has a key of its own, and one of older files is read under its new name.

    A mapping takes drives and tables alike.
    """
    table = {
        "type": "series_elastic",
        "gear_ratio": 50,
        "friction": ["coulomb", "stribeck"],
        "spring": ["linear", "cubic"],
        "known": ["stribeck_speed"],
        "stribeck_speed_rad_per_s": 0.4,
        "cubic_stiffness_Nm_per_rad3": -2.0,
    }
    drive = drives_from_mapping({"knee": table})["knee"]
    assert drives_from_mapping({"knee": drive}) == {"knee": drive}
    assert drive.values == {"stribeck_speed": 0.4, "cubic_stiffness": -2.0}
    assert drive.without_nominal().values == {"stribeck_speed": 0.4}
    assert len({terms.key_of(name, unit_of(drive, name)) for name in PARAMETERS}) == len(PARAMETERS)


# One table of refused files

ELASTIC = '[knee]\ntype = "series_elastic"\ngear_ratio = 100.0\n'
STIFF = '[knee]\ntype = "stiff"\ngear_ratio = 100.0\n'
TWO_OFFSETS = "friction = ['offset']\nfriction_offset_Nm = 1\nnominal = {friction_offset = 2}"
ORDER = "an order is a whole number from 1 to 1000, found"
ORDERS = "must be a list of orders"
BY_POSITION = f'{STIFF}motor_input = "position_command"\ncontroller = '
BY_VELOCITY = BY_POSITION.replace("position", "velocity")
GAIN = "position_gain_Nm_per_rad = 1.0"
FED = f"{{ {GAIN}, command_velocity_gain_Nms_per_rad = 1.0 }}"
REFUSED: list[tuple[str, str, str]] = [
    (STIFF, "std = { viscous_friction = 0.1 }", "no constant is named 'viscous_friction'"),
    (STIFF, "gear_ratio_std = 6e6", "'gear_ratio' must be more than zero and at most 100"),
    (STIFF, "torque_scale_std = 1.5", "'torque_scale' must be more than zero and at most 1"),
    (STIFF, "gear_ratio_std = 0.0", "standard deviation of 'gear_ratio' must be more than zero"),
    (ELASTIC, "gear_stiffness_Nm_per_rad = 0.0", "gear_stiffness_Nm_per_rad must be"),
    (ELASTIC, "gear_stiffness_Nm_per_rad = 1e40", "gear_stiffness_Nm_per_rad must be"),
    (STIFF, 'motor_input = "position_command"', "give its gains in the table 'controller'"),
    (STIFF, f"controller = {{ {GAIN} }}", "and the motor input 'torque'"),
    (BY_POSITION, "20", "must be a table of its values"),
    (BY_POSITION, "{ Kp = 1.0 }", "controller: no key is named 'Kp'"),
    (BY_POSITION, "{ feedforward_Nm = 1.0 }", "position_gain_Nm_per_rad is missing or zero"),
    (BY_POSITION, "{ position_gain_Nm_per_rad = -1 }", "must be zero or more and"),
    (BY_POSITION, "{ velocity_gain_Nms_per_rad = -1.0 }", "must be zero or more"),
    (BY_POSITION, "{ velocity_gain_Nms_per_rad = 1.0 }", 'which motor_input = "position_command"'),
    (BY_POSITION, f"{{ {GAIN}, torque_limit_Nm = true }}", "must be a number, found True"),
    (BY_POSITION, f"{{ {GAIN}, is_held = 1 }}", "is_held must be true or false, found 1"),
    (BY_POSITION, f"{{ {GAIN}, is_duty = true }}", "is_duty = true needs nominal_supply_V"),
    (BY_POSITION, f"{{ {GAIN}, nominal_supply_V = 0.0 }}", "must be more than zero"),
    (BY_VELOCITY, "{ velocity_gain_Nms_per_rad = 1.0 }", "is missing or zero"),
    (BY_VELOCITY, FED, "found position_gain_Nm_per_rad with motor_input"),
    (
        ELASTIC,
        'transmission_error = { motor = [1] }\nknown = ["transmission_error_motor_1_cos"]',
        "needs a known stiffness",
    ),
    ("knee = 3\n", "", "must be a table of a drive, found 3"),
    ("[drives.knee]\n", 'type = "stiff"', "write [knee] for [...knee]"),
    ("[knee]\n", 'type = "stiff"\ngear_ratio = "100:1"', "must be a number, found '100:1'"),
    ("[knee]\n", "gear_ratio = 1", "key 'type' is missing; allowed: stiff, series_elastic"),
    (STIFF.replace("stiff", "serial_elastic"), "", "did you mean 'series_elastic'? allowed: "),
    ("[knee]\n", 'type = ["stiff"]', "no drive type is named '['stiff']'"),
    ("[knee]\n", 'type = "stiff"', "key 'gear_ratio' is missing or '?'; give the motor"),
    (STIFF, "motor_inertia_kgm2 = 1", "did you mean 'motor_inertia_kg_m2'? allowed: "),
    (STIFF, "stiffness_N_per_m = 1", "no key is named 'stiffness_N_per_m'; "),
    (STIFF, "gear_ratio_rad_per_m = 1", "(prismatic joint), found both"),
    (ELASTIC, "load_pulley_radius_m = 1", "too (give neither for a rotary spring)"),
    (ELASTIC, "stiffness_N_per_m = 1", "not given): use stiffness_Nm_per_rad"),
    (
        ELASTIC,
        "motor_pulley_radius_m = 1\nstiffness_Nm_per_rad = 1",
        "given): use stiffness_N_per_m",
    ),
    (STIFF, 'friction = ["viscos"]', "'viscos'; did you mean 'viscous'? allowed: viscous"),
    (STIFF, 'friction = "viscous"', "friction must be a list of texts, found 'viscous'"),
    (STIFF, "friction = [['coulomb']]", "friction must be a list of texts"),
    (STIFF, 'friction = ["coulomb", "coulomb"]', "names a term twice: coulomb, coulomb"),
    (STIFF, 'friction = ["coulomb", "smooth_coulomb"]', "dahl, found coulomb, smooth_coulomb"),
    (STIFF, f"friction = {['x' * 5000]}", "no friction term is named 'xxx"),
    (STIFF, 'friction = ["load"]\nload_friction = -1.0', "must be zero or more and finite"),
    (ELASTIC, 'friction = ["offset"]', "constant column is the spring offset"),
    (STIFF, TWO_OFFSETS, "found two values of 'friction_offset': one in nominal, one"),
    (STIFF, "coulomb_friction_Nm = 1e300", "from 0 to 1e+30 in size, found 1e+300"),
    (STIFF, "coulomb_friction_Nm = nan", "must be a finite number"),
    (STIFF, "presliding_angle_rad = 0.1", "but the drive lacks the term 'dahl' of friction"),
    (STIFF, "extra_terms = [1]", "extra_terms must be a list of texts, found [1]"),
    (STIFF, f"extra_terms = {[f'c{i}' for i in range(21)]}", "21 terms, allowed are 20"),
    (STIFF, "transmission = {knee = 1e-20}", "'knee' must be from 1e-09 to 1e+09 in size"),
    (STIFF, 'transmission = {knee = "one"}', "transmission 'knee' must be a number, found 'one'"),
    (
        STIFF,
        'transmission = { joint = "knee", ratio = "r0 + r1*cos(q)" }',
        "a ratio that depends on the angle of the joint is angle_ratio = { cos = [c_1], sin = ",
    ),
    (STIFF, "motor_input = ['torque']", "no motor input is named"),
    (STIFF, "motor_input = 'volts'", "no motor input is named 'volts'; did you mean 'voltage'?"),
    (ELASTIC, 'spring = ["linear", "quintic"]', "no spring term is named 'quintic'"),
    (ELASTIC, 'spring = ["dead_zone"]', "needs a stiffness term"),
    (ELASTIC, 'spring = ["dead_zone", "smooth_dead_zone"]', "found dead_zone, smooth_dead_zone"),
    (ELASTIC, "dead_zone_rad = 0.1", "but the drive lacks the term 'dead_zone' of spring"),
    (ELASTIC, "deflection_zero_rad = 0.1", "a nonlinear spring"),
    (ELASTIC, 'parallel_spring = ["cubic"]', "no parallel spring term is named 'cubic'"),
    (ELASTIC, 'joint_friction = ["viscos"]', "did you mean 'viscous'?"),
    (ELASTIC, 'known = ["stiffnes"]', "no known parameter is named 'stiffnes'"),
    (ELASTIC, 'known = ["stiffness"]', "known names 'stiffness', but it has no value"),
    (ELASTIC, "nominal = { stifness = 1.0 }", "did you mean 'stiffness'?"),
    (ELASTIC, "nominal = { stiffness = 1.0 }", "give it as stiffness_Nm_per_rad"),
    (ELASTIC, "nominal = 3", "nominal must be a table of numbers, found 3"),
    (ELASTIC, "transmission_error = [1, 2]", "must be a table of orders, such as { motor ="),
    (ELASTIC, "transmission_error = { rotor = [1] }", "of transmission_error is named 'rotor'"),
    (ELASTIC, "transmission_error = { motor = 1 }", f"transmission_error motor {ORDERS}"),
    (ELASTIC, "transmission_error = { motor = [] }", f"transmission_error motor {ORDERS}"),
    (ELASTIC, 'transmission_error = { motor = [1] }\nspring = ["cubic"]', "a linear spring"),
    (ELASTIC, "torque_ripple = { motor = [0] }", f"{ORDER} 0"),
    (ELASTIC, "torque_ripple = { motor = [1.5] }", f"{ORDER} 1.5"),
    (ELASTIC, "torque_ripple = { motor = [true] }", ORDER),
    (ELASTIC, "torque_ripple = { motor = [2, 2] }", "torque_ripple names an order twice"),
    (ELASTIC, "torque_ripple = { motor = { 2 = [1.0, 0.0] } }", "such as torque_ripple_motor_6_c"),
    (STIFF, "angle_ratio = 3", "must be a table of its values, found 3"),
    (STIFF, "angle_ratio = { cosine = [0.1] }", "no key is named 'cosine'"),
    (STIFF, 'angle_ratio = { cos = ["a"] }', "angle_ratio cos must be numbers"),
    (STIFF, "angle_ratio = { angle_rad = [0, 1, 2], ratio = [1, 200, 1] }", "from 0.01 to 100"),
    (STIFF, "angle_ratio = {}", "has harmonics"),
    (STIFF, "angle_ratio = { cos = [0.1], angle_rad = [0, 1], ratio = [1, 1] }", "has harmonics"),
    (STIFF, "angle_ratio = { cos = [1.2] }", "from -0.2 to 2.2, "),
    (STIFF, "angle_ratio = { cos = [1.0] }", "must be from 0.01 to 100 at all angles"),
    (
        STIFF,
        "angle_ratio = { angle_rad = [0, 1, 2, 3], ratio = [1, 0.5, -0.5, -1] }",
        "from -1 to 1, and must be",
    ),
    (STIFF, "angle_ratio = { angle_rad = [0], ratio = [1] }", "needs two or more increasing angl"),
    (STIFF, "angle_ratio = { angle_rad = [0, 1], ratio = [1, 1, 1] }", "as many ratios, found ang"),
    (STIFF, "angle_ratio = { angle_rad = [0, 1, 1], ratio = [1, 1, 1] }", "increasing angles"),
    *(
        (ELASTIC, f"angle_ratio = {{ cos = [0.1] }}\n{line}", f"with angle_ratio has no {line[:8]}")
        for line in (
            "transmission = { hip = 1.0, knee = 1.0 }",
            'parallel_spring = ["linear"]',
            'joint_friction = ["viscous"]',
        )
    ),
]


@pytest.mark.parametrize(("head", "line", "words"), REFUSED)
def test_wrong_table_names_file_joint_and_key(
    tmp_path: Path, head: str, line: str, words: str
) -> None:
    """The message says what is allowed, in a length that can be read."""
    path = tmp_path / "drives.toml"
    path.write_text(f"{head}{line}\n")
    with pytest.raises(RobotError) as caught:
        read_drives(path)
    error = str(caught.value)
    assert str(path) in error
    assert "knee" in error
    assert words in error
    assert len(error) < 1500 + len(str(tmp_path))
