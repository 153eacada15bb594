"""A small arm, its motions and their logs on disk, and the command line that is run on them."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from click.testing import CliRunner

import seaid
from seaid.cli.commands import app
from tests.plants import kept

URDF = """<robot name="small_arm">
<!-- kept -->
<link name="base"/>
<link name="upper"><inertial><origin xyz="0.02 0.01 -0.12"/><mass value="2.0"/>
  <inertia ixx="0.025" ixy="0.001" ixz="0.002" iyy="0.022" iyz="0.001" izz="0.008"/></inertial>
</link>
<link name="lower"><inertial><origin xyz="0.03 0.0 -0.1"/><mass value="1.0"/>
  <inertia ixx="0.012" ixy="0" ixz="0.001" iyy="0.013" iyz="0" izz="0.004"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
  <limit lower="-1.2" upper="1.2" velocity="3" effort="60"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
  <origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/>
  <limit lower="-1.2" upper="1.2" velocity="3" effort="40"/></joint>
</robot>
"""
DRIVES = """[shoulder]
type = "stiff"
gear_ratio = 50.0
motor_inertia_kg_m2 = 4e-6
viscous_friction_Nms_per_rad = 5e-5
coulomb_friction_Nm = 0.003

[elbow]
type = "series_elastic"
gear_ratio = 100.0
motor_inertia_kg_m2 = 4e-6
stiffness_Nm_per_rad = 250.0
viscous_friction_Nms_per_rad = 8e-5
coulomb_friction_Nm = 0.006
"""


class Said:
    """What a run of the command line said and how it ended."""

    def __init__(self, arguments: list[str]) -> None:
        result = CliRunner().invoke(app, arguments)
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        self.code, self.out, self.err = result.exit_code, result.stdout, result.stderr


def run(*arguments: str | Path) -> Said:
    return Said([str(one) for one in arguments])


def done(*arguments: str | Path) -> Said:
    said = run(*arguments)
    assert said.code == 0, said.err
    return said


def refused(*arguments: str | Path) -> str:
    """Return the one line of an error that is ours."""
    said = run(*arguments)
    lines = said.err.splitlines()
    assert said.code == 1
    assert lines[-1].startswith("Error: ")
    assert not any(line.startswith("Error: ") for line in lines[:-1])
    return lines[-1]


@kept
def experiment() -> dict[str, bytes]:
    """Return the files of a small arm, of motions planned for it and of their logs."""
    with TemporaryDirectory() as folder:
        run_experiment(Path(folder))
        return {file.name: file.read_bytes() for file in Path(folder).iterdir()}


def run_experiment(folder: Path) -> None:
    (folder / "arm.urdf").write_text(URDF)
    (folder / "arm.toml").write_text(DRIVES)
    urdf, drives = folder / "arm.urdf", ("--drives", folder / "arm.toml")
    for seed, name in ((1, "run"), (2, "other")):
        search = ("--duration", "2", "--starts", "1", "--iterations", "12", "--seed", str(seed))
        done("excite", urdf, *search, "-o", folder / f"{name}_plan.json")
        plan, log = folder / f"{name}_plan.json", folder / f"{name}.csv"
        noise = ("--torque-std", "0.001", "--seed", str(seed))
        done("simulate", urdf, plan, *drives, *noise, "-o", log)
    lines = (f"{load},{load / 250}" for load in range(-6, 7))
    (folder / "weights.csv").write_text("load_Nm,deflection_rad\n" + "\n".join(lines))
    values = np.zeros((10, 2))
    values[4:6] = 0.05
    basis = seaid.excitation.make_basis("bspline", 0.5, 10)
    seaid.Trajectory(("shoulder", "elbow"), basis, values).save(folder / "short_plan.json")


def robot_and_drives(arm: Path) -> tuple[str | Path, ...]:
    return (arm / "arm.urdf", "--drives", arm / "arm.toml")


def robot_of(arm: Path) -> seaid.Robot:
    return seaid.load_robot(arm / "arm.urdf", arm / "arm.toml")


def log_of(arm: Path, name: str = "run.csv") -> seaid.Log:
    return seaid.read_log(arm / name, robot_of(arm))
