"""What is given for a robot: a path, a name, a file of another kind, each read or refused."""

import gzip
import sys
import types
import warnings
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from scripts.example_robots import example_urdf
from seaid.errors import RobotError, SeaidWarning
from seaid.legged import load_robot
from seaid.robot import Robot
from seaid.robot.urdf import search_folders
from tests.experiments import MODELS

LEG = MODELS / "tulip_leg.urdf"
DRIVES = MODELS / "tulip_leg.toml"


def refusal(urdf: str | Path, drives: str | Path | None = None) -> str:
    with pytest.raises(RobotError) as caught:
        load_robot(urdf, drives)
    return str(caught.value)


def same(one: Robot, two: Robot) -> None:
    assert one.joint_names == two.joint_names
    np.testing.assert_allclose(one.parameters, two.parameters, rtol=1e-12, atol=1e-15)


def test_a_missing_file_names_path_working_folder_and_the_nearest_names(tmp_path: Path) -> None:
    path = tmp_path / "tulip_lge.urdf"
    start = f"no URDF file at '{path}' (working folder {Path.cwd()})"
    assert refusal(path) == start
    (tmp_path / "tulip_leg.urdf").write_bytes(b"")
    (tmp_path / "other.urdf").write_bytes(b"")
    assert refusal(path) == f"{start}; there is tulip_leg.urdf"
    folder = f"no URDF file at '{tmp_path}' (working folder {Path.cwd()}): it is a folder; in it: "
    assert refusal(tmp_path) == f"{folder}other.urdf, tulip_leg.urdf"


def test_urdf_and_drives_in_each_others_place_are_named(tmp_path: Path) -> None:
    """A file of drives with a mistake in its TOML is named with the place of it."""
    assert refusal(DRIVES) == (
        f"'{DRIVES}' is TOML, not a URDF: the robot's URDF comes first, and its drives as drives="
    )
    assert refusal(LEG, LEG) == (
        f"drives '{LEG}' is XML, as a URDF is: the drives are a TOML file with a table for each "
        "joint, and the URDF is the first argument"
    )
    (tmp_path / "drives.toml").write_text('[knee_pitch]\ntype = "stiff"\ngear_ratio = \n')
    text = refusal(LEG, tmp_path / "drives.toml")
    assert "drives.toml' is not valid TOML: Invalid value (at line 3, column 14)" in text


@pytest.mark.parametrize(
    ("content", "name", "words"),
    [
        (gzip.compress(b"<robot/>", mtime=0), "a.urdf.gz", "unpack it (gunzip -k a.urdf.gz)"),
        (b"PK\x03\x04...", "a.zip", "is compressed: unpack it (unzip a.zip) and name the URDF"),
        (b"<?xml version='1.0'?>\n<sdf version='1.9'/>", "a.sdf", "is SDF, which seaid does not"),
        (b"<sdf version='1.9'/>", "a.urdf", "sdformat_urdf, or sdf2urdf of pysdf"),
        (b"time,q\n0,1\n", "run.csv", "by its name a log: the robot's URDF comes first, then"),
    ],
)
def test_a_file_of_another_kind_says_what_makes_it_a_urdf(
    tmp_path: Path, content: bytes, name: str, words: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    assert f"'{path}' {words}" in refusal(path) or words in refusal(path)


XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="length" value="0.5"/>
<link name="base"/><link name="rod"><inertial><origin xyz="${length / 2} 0 0"/><mass value="2"/>
<inertia ixx="0" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="continuous"><parent link="base"/><child link="rod"/></joint>
</robot>"""


def test_xacro_is_expanded_where_its_package_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the package the message says how to expand it; a mistake in it has its command."""
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(XACRO)
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "xacro", None)
        assert refusal(path) == (
            f"'{path}' is a xacro file, not a URDF: expand it (xacro arm.urdf.xacro > arm.urdf) "
            "and name the URDF, or install the package that reads it here (pip install xacro)"
        )
    pytest.importorskip("xacro")
    robot = load_robot(path)
    assert robot.joint_names == ("pivot",)
    np.testing.assert_allclose(robot.parameters[:2], [2.0, 0.5])
    path = tmp_path / "arm.urdf"
    path.write_text(XACRO.replace("length /", "lenght /"))
    text = refusal(path)
    assert f"xacro cannot expand '{path}': " in text
    assert "lenght" in text
    assert "xacro arm.urdf > arm.urdf name:=value" in text


@pytest.fixture
def descriptions(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Stand in for the package robot_descriptions, which clones repositories."""

    def fake(**attributes: object) -> None:
        package = types.ModuleType("robot_descriptions")
        package.DESCRIPTIONS = {"leg_description": None, "go2_description": None}  # type: ignore[attr-defined]
        package.__path__ = []
        monkeypatch.setitem(sys.modules, "robot_descriptions", package)
        module = types.ModuleType("robot_descriptions.leg_description")
        vars(module).update(attributes)
        monkeypatch.setitem(sys.modules, "robot_descriptions.leg_description", module)

    return fake


def test_a_name_of_robot_descriptions_is_its_file(
    descriptions: Callable[..., None], tmp_path: Path
) -> None:
    descriptions(URDF_PATH=str(LEG))
    robot = load_robot("leg_description", DRIVES)
    assert robot.urdf == LEG
    same(robot, load_robot(LEG))
    assert refusal("lge_description").startswith(
        "no robot of robot_descriptions is named 'lge_description'; did you mean 'leg_description'"
    )
    assert refusal("go2_description").startswith(
        "robot_descriptions cannot get 'go2_description': No module named"
    )
    assert "$ROBOT_DESCRIPTIONS_CACHE" in refusal("go2_description")
    descriptions()
    assert refusal("leg_description") == (
        "robot_descriptions has neither a URDF nor an MJCF of 'leg_description'"
    )


def test_a_name_of_example_robot_data_is_its_file() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeaidWarning)
        assert load_robot("panda").dependent_joints[0].name == "panda_finger_joint2"
        assert load_robot("ur5").urdf == example_urdf("ur5_robot.urdf")
    assert refusal("talos").startswith(
        "example-robot-data has no robot 'talos' but talos_full_v2, talos_full_v2_box, "
    )
    assert refusal("tallos").startswith("no URDF file at 'tallos'")


def test_without_their_packages_names_are_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message says which package has the name."""

    def missing(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "files", missing)
    assert refusal("panda").startswith("no URDF file at 'panda'")
    monkeypatch.setitem(sys.modules, "robot_descriptions", None)
    assert refusal("go2_description").endswith(
        "if it is a name of the package robot_descriptions, install that package: "
        "pip install robot_descriptions"
    )


def test_meshes_are_searched_where_ros_has_its_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path / 'src'}:relative")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    found = search_folders(LEG, ())
    assert found[-2:] == [tmp_path / "src", tmp_path / "install" / "share"]
