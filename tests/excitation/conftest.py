from pathlib import Path

import pytest

from seaid.legged import load_robot
from seaid.robot import Robot

SLIDER_ARM = """<robot name="slider_arm">
  <link name="ground"/><link name="carriage">{body}</link>
  <link name="upper">{body}</link><link name="lower">{body}</link>
  <joint name="rail" type="prismatic"><parent link="ground"/><child link="carriage"/>
    <axis xyz="1 0 0"/><limit lower="-0.4" upper="0.6" velocity="1.0" effort="50"/></joint>
  <joint name="shoulder" type="continuous"><parent link="carriage"/><child link="upper"/>
    <origin xyz="0 0.1 0"/><axis xyz="0 1 0"/><limit velocity="3.0" effort="20"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/>
    <limit lower="0.1" upper="2.0" velocity="3.0" effort="20"/></joint>
</robot>"""
BODY = """<inertial><origin xyz="0.01 0.02 -0.1"/><mass value="1.5"/>
  <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.005"/></inertial>"""


@pytest.fixture(scope="session")
def slider_arm_text() -> str:
    return SLIDER_ARM.format(body=BODY)


@pytest.fixture(scope="session")
def slider_arm(tmp_path_factory: pytest.TempPathFactory, slider_arm_text: str) -> Robot:
    """Return a robot with a rail, a shoulder that turns without end, and an elbow."""
    path = tmp_path_factory.mktemp("robots") / "slider_arm.urdf"
    path.write_text(slider_arm_text)
    return load_robot(path)


@pytest.fixture(scope="session")
def leg(tulip_urdf: Path) -> Robot:
    return load_robot(tulip_urdf).without_nominal()


@pytest.fixture(scope="session")
def slider_arm_with_bodies(
    tmp_path_factory: pytest.TempPathFactory, slider_arm_text: str
) -> tuple[Path, Robot]:
    """Return the slider arm with a capsule-like cylinder a link, and its file."""
    body = """<collision><origin xyz="0 0 -0.12"/>
      <geometry><cylinder radius="0.03" length="0.2"/></geometry></collision>"""
    path = tmp_path_factory.mktemp("robots") / "slider_arm_bodies.urdf"
    path.write_text(slider_arm_text.replace("</inertial>", "</inertial>" + body))
    return path, load_robot(path)
