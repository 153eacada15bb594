"""Drives as data: what the TOML says, and what is wrong in it."""

from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.drives.drives import Drive, SeriesElasticDrive, StiffDrive
from seaid.drives.equations import spring_force
from seaid.drives.toml import drives_from_mapping, read_drives
from seaid.errors import RobotError

ELASTIC = '[knee]\ntype = "series_elastic"\ngear_ratio = 100.0\n'
STIFF = '[knee]\ntype = "stiff"\ngear_ratio = 100.0\n'


def read(folder: Path, text: str) -> Drive:
    path = folder / "drives.toml"
    path.write_text(text)
    return read_drives(path)["knee"]


def read_error(folder: Path, text: str) -> str:
    with pytest.raises(RobotError) as caught:
        read(folder, text)
    return str(caught.value)


def test_toml_of_the_tulip_leg_is_read_number_by_number(tulip_urdf: Path) -> None:
    drives = read_drives(tulip_urdf.with_suffix(".toml"))
    assert list(drives) == ["hip_yaw", "hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch"]
    assert drives["hip_yaw"] == StiffDrive(
        gear_ratio=86.0,
        motor_inertia_kg_m2=3.4e-6,
        viscous_friction_Nms_per_rad=8e-5,
        coulomb_friction_Nm=0.004,
    )
    assert drives["ankle_pitch"] == SeriesElasticDrive(
        gear_ratio=86.0,
        motor_inertia_kg_m2=3.4e-6,
        motor_pulley_radius_m=0.020,
        load_pulley_radius_m=0.030,
        stiffness_N_per_m=51394.0,
        viscous_friction_Nms_per_rad=4e-5,
        coulomb_friction_Nm=0.01178,
    )


def test_linear_spring_has_radii_and_newtons_a_metre(tmp_path: Path) -> None:
    radii = "motor_pulley_radius_m = 0.02\nload_pulley_radius_m = 0.04\n"
    drive = read(tmp_path, f"{ELASTIC}{radii}stiffness_N_per_m = 5e4\n")
    assert isinstance(drive, SeriesElasticDrive)
    assert (drive.motor_radius, drive.load_radius, drive.ratio) == (0.02, 0.04, 100.0)
    assert (drive.stiffness, drive.spring_units) == (5e4, ("N", "m"))


def test_rotary_spring_has_radii_of_one_and_newton_metres_a_radian(tmp_path: Path) -> None:
    drive = read(tmp_path, f"{ELASTIC}stiffness_Nm_per_rad = 70\n")
    assert isinstance(drive, SeriesElasticDrive)
    assert (drive.motor_radius, drive.load_radius) == (1.0, 1.0)
    assert (drive.stiffness, drive.spring_units) == (70, ("N m", "rad"))


def test_drum_of_a_prismatic_joint_counts_one_on_the_load_side(tmp_path: Path) -> None:
    drive = read(tmp_path, f"{ELASTIC}motor_pulley_radius_m = 0.02\nstiffness_N_per_m = 5e4\n")
    assert isinstance(drive, SeriesElasticDrive)
    assert (drive.motor_radius, drive.load_radius, drive.is_linear_spring) == (0.02, 1.0, True)


def test_stiff_drive_has_the_face_of_an_elastic_one_but_takes_no_spring() -> None:
    drive = StiffDrive(gear_ratio=100.0)
    assert (drive.is_elastic, drive.is_nonlinear_spring) == (False, False)
    assert (drive.spring, drive.joint_friction) == ((), ())
    assert (drive.motor_radius, drive.load_radius, spring_force(drive)) == (1.0, 1.0, 0)
    for name in ("spring", "joint_friction", "motor_radius", "load_radius", "is_elastic"):
        assert hasattr(SeriesElasticDrive(gear_ratio=100.0), name)
        assert f"{name}=" not in repr(drive)
        with pytest.raises(FrozenInstanceError):
            setattr(drive, name, None)
        with pytest.raises(TypeError, match=name):
            StiffDrive(**{name: ()})  # type: ignore[arg-type]


def test_stiff_prismatic_drive_has_its_ratio_in_radians_a_metre(tmp_path: Path) -> None:
    drive = read(tmp_path, '[knee]\ntype = "stiff"\ngear_ratio_rad_per_m = 300\n')
    assert drive.ratio == 300


def test_terms_are_lists_in_the_file_and_tuples_in_the_drive(tmp_path: Path) -> None:
    terms = """friction = ["coulomb", "offset"]\nextra_terms = ["c*theta_M'**3"]\n"""
    drive = read(tmp_path, STIFF + terms)
    assert drive.friction == ("coulomb", "offset")
    assert drive.extra_terms == ("c*theta_M'**3",)
    assert hash(drive) == hash(read(tmp_path, STIFF + terms))
    assert StiffDrive(gear_ratio=1.0, friction=["viscous"]).friction == ("viscous",)  # type: ignore[arg-type]


def test_mapping_takes_drives_and_tables_alike() -> None:
    drive = StiffDrive(gear_ratio=np.int64(50))  # type: ignore[arg-type]
    assert drives_from_mapping({"a": drive, "b": {"type": "stiff", "gear_ratio": 50}}) == {
        "a": drive,
        "b": drive,
    }


def test_unknown_is_none_and_known_values_stay_without_the_nominal_ones() -> None:
    known = StiffDrive(gear_ratio=50.0, friction=("viscous",), extra_terms=("c*theta_M_dot",))
    assert known.motor_inertia_kg_m2 is None
    nominal = StiffDrive(
        gear_ratio=50.0,
        viscous_friction_Nms_per_rad=1e-3,
        coulomb_friction_Nm=0.1,
        friction=("viscous",),
        extra_terms=("c*theta_M_dot",),
    )
    assert nominal.without_nominal() == known
    radii: dict[str, Any] = {"motor_pulley_radius_m": 0.02, "load_pulley_radius_m": 0.04}
    elastic = SeriesElasticDrive(
        50.0, 1e-6, stiffness_N_per_m=1e4, coulomb_friction_Nm=0.1, **radii
    )
    assert elastic.without_nominal() == SeriesElasticDrive(50.0, 1e-6, **radii)


def test_file_that_is_no_toml_is_named(tmp_path: Path) -> None:
    path = tmp_path / "no.toml"
    with pytest.raises(RobotError, match=r"cannot read drives '.*no\.toml': No such file"):
        read_drives(path)
    with pytest.raises(RobotError, match=r"cannot read drives '.*': Is a directory"):
        read_drives(tmp_path)
    path.write_text("[knee\n")
    with pytest.raises(RobotError, match=r"no\.toml' is not valid TOML: .*line 1"):
        read_drives(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RobotError, match=r"no\.toml' is not valid TOML: 'utf-8' codec"):
        read_drives(path)


TWO_OFFSETS = "friction = ['offset']\nfriction_offset_Nm = 1\nnominal = {friction_offset = 2}\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("knee = 3\n", "must be a table of a drive, found 3"),
        ("[knee]\ngear_ratio = 1\n", "key 'type' is missing; allowed: stiff, series_elastic"),
        (STIFF.replace("stiff", "serial_elastic"), "did you mean 'series_elastic'? allowed: "),
        ('[knee]\ntype = ["stiff"]\n', "no drive type is named '['stiff']'"),
        ('[knee]\ntype = "stiff"\n', "key 'gear_ratio' is missing or '?'; give the motor"),
        ('[knee]\ntype = "series_elastic"\n', "key 'gear_ratio' is missing or '?'; give the motor"),
        (f"{STIFF}motor_inertia_kgm2 = 1\n", "did you mean 'motor_inertia_kg_m2'? allowed: "),
        (f"{STIFF}stiffness_N_per_m = 1\n", "no key is named 'stiffness_N_per_m'; "),
        (f"{STIFF}gear_ratio_rad_per_m = 1\n", "(prismatic joint), found both"),
        (f"{ELASTIC}load_pulley_radius_m = 1\n", "too (give neither for a rotary spring)"),
        (f"{ELASTIC}stiffness_N_per_m = 1\n", "not given): use stiffness_Nm_per_rad"),
        (
            f"{ELASTIC}motor_pulley_radius_m = 1\nstiffness_Nm_per_rad = 1\n",
            "but the spring is linear (pulley radii given): use stiffness_N_per_m",
        ),
        (f'{STIFF}friction = ["viscos"]\n', "'viscos'; did you mean 'viscous'? allowed: viscous"),
        (f'{STIFF}friction = "viscous"\n', "friction must be a list of texts, found 'viscous'"),
        (f"{STIFF}friction = 1\n", "friction must be a list of texts, found 1"),
        (f'{STIFF}friction = ["coulomb", "coulomb"]\n', "names a term twice: coulomb, coulomb"),
        (f'{ELASTIC}friction = ["offset"]\n', "constant column is the spring offset"),
        (f"{STIFF}extra_terms = [1]\n", "extra_terms must be a list of texts, found [1]"),
        (f"{STIFF}coulomb_friction_Nm = 1e300\n", "from 0 to 1e+30 in size, found 1e+300"),
        (f"{STIFF}coulomb_friction_Nm = nan\n", "must be a finite number"),
        (f"{STIFF}transmission = {{knee = 1e-20}}\n", "'knee' must be from 1e-09 to 1e+09 in size"),
        (f"{STIFF}motor_input = ['torque']\n", "no motor input is named"),
        (f"{STIFF}extra_terms = {[f'c{i}' for i in range(21)]}\n", "21 terms, allowed are 20"),
        (f"{STIFF}friction = {['x' * 5000]}\n", "no friction term is named 'xxx"),
        (f"{STIFF}friction = [['coulomb']]\n", "friction must be a list of texts"),
        (f"{STIFF}{TWO_OFFSETS}", "found two values of 'friction_offset': one in nominal, one"),
        (f'{STIFF}extra_terms = "c"\n', "extra_terms must be a list of texts, found 'c'"),
    ],
)
def test_wrong_table_names_file_joint_and_key(tmp_path: Path, text: str, words: str) -> None:
    error = read_error(tmp_path, text)
    assert str(tmp_path / "drives.toml") in error
    assert "knee" in error
    assert words in error
    assert len(error) < 1500 + len(str(tmp_path))


POSITIVE = ("gear_ratio", "motor_pulley_radius_m", "load_pulley_radius_m", "stiffness_N_per_m")
MAY_BE_ZERO = ("motor_inertia_kg_m2", "viscous_friction_Nms_per_rad", "coulomb_friction_Nm")
GOOD: dict[str, Any] = {
    "gear_ratio": 100.0,
    "motor_pulley_radius_m": 0.02,
    "load_pulley_radius_m": 0.04,
}


@pytest.mark.parametrize("key", [*POSITIVE, *MAY_BE_ZERO])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf, -np.inf])
def test_number_that_cannot_be_names_key_and_value(key: str, value: float) -> None:
    with pytest.raises(RobotError, match=rf"{key} must be .* and finite, found {value}"):
        SeriesElasticDrive(**GOOD | {key: value})


@pytest.mark.parametrize("key", [*POSITIVE, *MAY_BE_ZERO])
@pytest.mark.parametrize("value", ["100", True, [1.0]])
def test_value_that_is_no_number_names_key_and_value(key: str, value: object) -> None:
    with pytest.raises(RobotError) as caught:
        SeriesElasticDrive(**GOOD | {key: value})
    assert str(caught.value) == f"{key} must be a number, found {value!r}"


def test_zero_is_allowed_where_it_means_something() -> None:
    for key in MAY_BE_ZERO:
        assert getattr(SeriesElasticDrive(**GOOD | {key: 0.0}), key) == 0.0
    for key in POSITIVE:
        with pytest.raises(RobotError, match=f"{key} must be more than zero and finite, found 0"):
            SeriesElasticDrive(**GOOD | {key: 0})


def test_a_key_of_older_files_is_read_under_its_new_name() -> None:
    table = {"type": "series_elastic", "gear_ratio": 100.0, "stiffness_Nm_per_rad": 70.0}
    old, new = {"deflection_offset_Nm": 2.0}, {"spring_offset_Nm": 2.0}
    drives = [drives_from_mapping({"knee": table | one})["knee"] for one in (old, new)]
    assert drives[0] == drives[1]
    with pytest.raises(RobotError, match="'deflection_offset_Nm' is the old name of 'spring_off"):
        drives_from_mapping({"knee": table | old | new})
