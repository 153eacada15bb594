"""write_model: files of simulators hold the drives' numbers, and say what they cannot hold.

Each file is read by its own package where that is installed (make test-simulators: usd-core, drake
and newton); else its schema is checked, as the documentation of the package has it.
"""

import math
import re
import runpy
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from lxml import etree

import seaid
from seaid.cli.export import CODE, export
from seaid.drives import Controller, SeriesElasticDrive, StiffDrive
from seaid.errors import RobotError
from seaid.export import FORMATS, WrittenModel
from seaid.export.joint_actuators import EFFECTS, actuators_of
from seaid.robot import Robot
from tests.one_joint import chain, one_joint

ROOT = Path(__file__).parents[2]
KP, KD, LIMIT, DELAY_S = 20.0, 1.5, 12.0, 0.0123
GAINS = Controller(position_gain_Nm_per_rad=KP, velocity_gain_Nms_per_rad=KD, torque_limit_Nm=LIMIT)
N, I_M, F_V, F_C, F_0 = 9.0, 1e-4, 1e-3, 0.02, 0.01
SERVO = StiffDrive(
    gear_ratio=N,
    motor_inertia_kg_m2=I_M,
    viscous_friction_Nms_per_rad=F_V,
    coulomb_friction_Nm=F_C,
    friction=("viscous", "coulomb", "offset"),
    nominal={"friction_offset": F_0},
    motor_input="position_command",
    command_delay_s=DELAY_S,
    controller=GAINS,
)
FED = replace(SERVO, controller=replace(GAINS, feedforward_Nm=3.0))
ARMATURE, VISCOUS, DRY, OFFSET = N**2 * I_M, N**2 * F_V, N * F_C, N * F_0
PER_DEGREE = math.pi / 180
ODD = "odd-joint \"'</\\&é"
"""A name that text of Python, USD and XML has to quote."""


def robot_with(folder: Path, drive: Any = SERVO, kind: str = "revolute") -> Robot:
    return one_joint(folder, kind).with_drives({"arm": drive})


def written(robot: Robot, folder: Path, name: Any, **options: Any) -> WrittenModel:
    path = folder / f"{name}{FORMATS[name].suffix}"
    return seaid.write_model(robot, path, name, **options)


def test_isaac_lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A drive without a controller has no gains and no limit."""
    dry = {"friction": DRY, "dynamic_friction": DRY, "viscous_friction": VISCOUS}
    passive = {"armature": ARMATURE, **dry}
    delays = {"min_delay": 3, "max_delay": 3}  # of 4 ms
    torque = replace(SERVO, motor_input="torque", controller=None, command_delay_s=None)
    gains = {"stiffness": KP, "damping": KD, "effort_limit": LIMIT}
    for drive, kind, active in (
        (SERVO, "DelayedPDActuatorCfg", gains | delays),
        (torque, "IdealPDActuatorCfg", {"stiffness": 0, "damping": 0}),
    ):
        path = written(robot_with(tmp_path, drive), tmp_path, "isaaclab", time_step_s=0.004).path
        ((joint, (name, fields)),) = configured(path, "isaaclab.actuators", monkeypatch).items()
        assert (joint, name) == ("arm", kind)
        assert fields.pop("joint_names_expr") == ["arm"]
        assert fields == pytest.approx(passive | active)


def test_a_feed_forward_is_within_the_limit_and_apart_from_the_friction(tmp_path: Path) -> None:
    """The force that an actuator documents is that of the drive, at its limit too."""
    robot = robot_with(tmp_path, FED)
    (actuator,) = actuators_of(robot)
    errors = np.linspace(-1.0, 1.0, 9)  # u - q [rad]; beyond 0.45 rad the controller is at 12 N m
    wanted = actuator.position_gain * errors + actuator.feedforward
    force = np.clip(wanted, -actuator.limit, actuator.limit) - actuator.offset
    law = FED.law
    assert law is not None
    torque, is_limited = law.torque(KP * errors + law.feedforward_Nm, 0 * errors, 0 * errors)
    assert 0 < np.sum(is_limited) < len(errors)
    np.testing.assert_allclose(force, torque - OFFSET)
    # Isaac Lab has neither, Newton both, with a common limit
    remedies = {x.message: x.remedy for x in written(robot, tmp_path, "isaaclab").warnings}
    text = "Isaac Lab has no {}: it is not in the file for arm ({} N m)"
    assert remedies[text.format("feed-forward", 3)] == "add to the commands: arm +0.15 rad"
    assert remedies[text.format("friction offset", 0.09)] == "add to the commands: arm -0.0045 rad"
    model = written(robot, tmp_path, "newton", time_step_s=DELAY_S)
    assert "float newton:constEffort = 2.91" in model.path.read_text()  # F - N F_0
    (finding,) = model.warnings
    assert (finding.severity, finding.code) == ("note", "not-in-format")
    assert finding.evidence == {"arm": pytest.approx(OFFSET)}
    assert "no friction offset: arm (0.09 of 12)" in finding.message


def test_drake(tmp_path: Path) -> None:
    """It replaces the transmissions of its joints."""
    robot, path = robot_with(tmp_path), tmp_path / "arm.urdf"
    others = '<transmission name="x"><joint name="other"/></transmission>'
    old = '<transmission name="t"><joint name="arm"/><actuator name="m"/></transmission>'
    path.write_text(path.read_text().replace("</robot>", f"{old}{others}</robot>"))
    model = written(seaid.load_robot(path, robot.drives), tmp_path, "drake")
    root = etree.parse(model.path).getroot()
    assert {one.get("name") for one in root.findall("transmission")} == {"arm", "x"}
    space = "{http://drake.mit.edu}"
    (actuator,) = root.findall("transmission/actuator")
    names = ("gear_ratio", "rotor_inertia")
    assert [float(actuator.find(f"{space}{name}").get("value")) for name in names] == [N, I_M]
    gains = actuator.find(f"{space}controller_gains")
    assert (float(gains.get("p")), float(gains.get("d"))) == (KP, KD)
    damping = float(root.find("joint/dynamics").get("damping"))
    assert damping == pytest.approx(VISCOUS)
    assert seaid.load_robot(model.path, {"arm": SERVO}).n == 1


def test_other_terms_and_what_replaces_them(tmp_path: Path) -> None:
    drive = replace(
        SERVO,
        friction=("viscous", "smooth_coulomb", "offset", "quadratic"),
        nominal={"friction_offset": F_0, "coulomb_width": 0.1, "quadratic_friction": 1e-6},
    )
    found = written(robot_with(tmp_path, drive), tmp_path, "isaaclab").warnings
    assert [one.severity for one in found] == ["doubtful", "note", "note", "note"]
    assert {one.code for one in found} == {"not-in-format"}
    assert "not these terms of the drives: arm (quadratic)" in found[0].message
    assert found[1].remedy == "add to the commands: arm -0.0045 rad"  # N F_0 / K_p
    assert found[1].evidence == {"arm": pytest.approx(OFFSET)}
    assert "smooth friction is written as dry friction for arm" in found[2].message
    assert "steps of 5 ms in the file: arm is -2.3 ms off" in found[3].message
    assert found[3].remedy.startswith("--time-step")
    plain = replace(SERVO, friction=("viscous", "coulomb"), nominal={}, command_delay_s=0.01)
    for name in ("mjcf", "urdf", "isaaclab", "newton"):
        assert written(robot_with(tmp_path, plain), tmp_path, name).warnings == ()


FIELDS = {
    # isaaclab.actuators.ActuatorBaseCfg and DelayedPDActuatorCfg, Isaac Lab 2.3 and 3.0
    "isaaclab.actuators": (
        *("joint_names_expr", "effort_limit", "velocity_limit", "stiffness", "damping"),
        *("armature", "friction", "dynamic_friction", "viscous_friction"),
        *("min_delay", "max_delay"),
    )
}


def configured(path: Path, module: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Run a Python file of configurations, with stand-ins that have the documented fields."""
    stand_in = ModuleType(module)

    def config_of(name: str) -> Any:
        def config(**fields: Any) -> tuple[str, dict[str, Any]]:
            assert set(fields) <= {*FIELDS[module]}
            return name, fields

        return config

    stand_in.__getattr__ = config_of  # type: ignore[method-assign]
    monkeypatch.setitem(sys.modules, module.split(".")[0], ModuleType(module.split(".")[0]))
    monkeypatch.setitem(sys.modules, module, stand_in)
    return runpy.run_path(str(path))["ACTUATORS"]


def stage_of(robot: Robot, layer: Path, kind: str) -> Any:
    """Return a USD stage: two bodies, a joint at the place that layers expect, and the layer."""
    pxr_usd = pytest.importorskip("pxr.Usd")
    from pxr import UsdPhysics

    stage = pxr_usd.Stage.CreateNew(str(layer.with_suffix(".base.usda")))
    name = robot.name if robot.name.isidentifier() else "_1_odd"
    joint = "arm" if robot.joint_names == ("arm",) else "odd_joint________"
    root = stage.DefinePrim(f"/{name}", "Xform")
    stage.SetDefaultPrim(root)
    UsdPhysics.ArticulationRootAPI.Apply(root)
    for body in ("base", "body"):
        prim = stage.DefinePrim(f"/{name}/{body}", "Xform")
        UsdPhysics.RigidBodyAPI.Apply(prim)
        mass = UsdPhysics.MassAPI.Apply(prim)
        mass.CreateMassAttr(1.0)
        mass.CreateDiagonalInertiaAttr((1.0, 1.0, 1.0))
    stage.DefinePrim(f"/{name}/joints", "Scope")
    made = {"revolute": UsdPhysics.RevoluteJoint, "prismatic": UsdPhysics.PrismaticJoint}[kind]
    hinge = made.Define(stage, f"/{name}/joints/{joint}")
    hinge.CreateBody0Rel().SetTargets([f"/{name}/base"])
    hinge.CreateBody1Rel().SetTargets([f"/{name}/body"])
    hinge.CreateAxisAttr("Z")
    stage.GetRootLayer().subLayerPaths.append(str(layer))
    return stage, stage.GetPrimAtPath(f"/{name}/joints/{joint}")


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_usd_has_degrees(tmp_path: Path, kind: str) -> None:
    pytest.importorskip("pxr", reason="needs usd-core: make test-simulators")
    from pxr import UsdPhysics

    drive = SERVO
    if kind == "prismatic":
        drive = replace(SERVO, gear_ratio=None, gear_ratio_rad_per_m=N)
    robot = robot_with(tmp_path, drive, kind)
    _, joint = stage_of(robot, written(robot, tmp_path, "usd").path, kind)
    axis, per = ("linear", 1.0) if kind == "prismatic" else ("angular", PER_DEGREE)
    there = UsdPhysics.DriveAPI.Get(joint, axis)
    assert there.GetStiffnessAttr().Get() == pytest.approx(KP * per)
    assert there.GetDampingAttr().Get() == pytest.approx(KD * per)
    assert there.GetMaxForceAttr().Get() == pytest.approx(LIMIT)
    assert there.GetTypeAttr().Get() == "force"
    physx = {
        "armature": ARMATURE,
        "staticFrictionEffort": DRY,
        "dynamicFrictionEffort": DRY,
        "viscousFrictionCoefficient": VISCOUS * per,
    }
    for name, value in physx.items():
        assert joint.GetAttribute(f"physxJointAxis:{axis}:{name}").Get() == pytest.approx(value)
    assert f"PhysxJointAxisAPI:{axis}" in str(joint.GetMetadata("apiSchemas"))


def test_newton_has_degrees_in_joints_and_radians_in_actuators(tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="needs usd-core: make test-simulators")
    robot = robot_with(tmp_path)
    model = written(robot, tmp_path, "newton", time_step_s=0.004)
    stage, joint = stage_of(robot, model.path, "revolute")
    passive = {"armature": ARMATURE, "friction": DRY, "damping": VISCOUS * PER_DEGREE}
    for name, value in passive.items():
        assert joint.GetAttribute(f"newton:{name}").Get() == pytest.approx(value)
    actuator = stage.GetPrimAtPath("/arm/actuators/arm")
    assert actuator.GetRelationship("newton:targets").GetTargets() == [joint.GetPath()]
    active = {"kp": KP, "kd": KD, "constEffort": -OFFSET, "maxEffort": LIMIT, "delaySteps": 3}
    for name, value in active.items():
        assert actuator.GetAttribute(f"newton:{name}").Get() == pytest.approx(value)


def test_newton_reads_its_file(tmp_path: Path) -> None:
    newton = pytest.importorskip("newton", reason="needs newton: make test-simulators")
    robot = robot_with(tmp_path)
    model = written(robot, tmp_path, "newton", time_step_s=0.004)
    stage, _ = stage_of(robot, model.path, "revolute")
    builder = newton.ModelBuilder()
    builder.add_usd(stage)
    made = builder.finalize(device="cpu")
    passive = (made.joint_armature, made.joint_friction, made.joint_damping)
    last = [np.ravel(x.numpy())[-1] for x in passive]
    assert last == pytest.approx([ARMATURE, DRY, VISCOUS])
    (actuator,) = made.actuators
    assert np.ravel(actuator.drive.kp.numpy()) == pytest.approx([KP])
    assert np.ravel(actuator.drive.const_effort.numpy()) == pytest.approx([-OFFSET])


def test_the_law_of_a_spring_with_pulleys_is_that_at_the_joint(tmp_path: Path) -> None:
    """It acts at theta_M/N = (r_L/r_M) q, here at twice the angle, with twice its torque."""
    law = Controller(
        position_gain_Nm_per_rad=30.0,
        velocity_gain_Nms_per_rad=2.0,
        torque_limit_Nm=5.0,
        feedforward_Nm=3.0,
    )
    drive = SeriesElasticDrive(
        gear_ratio=10.0,
        motor_pulley_radius_m=0.02,
        load_pulley_radius_m=0.04,
        motor_inertia_kg_m2=1e-5,
        friction=(),
        stiffness_N_per_m=1e6,
        motor_input="position_command",
        controller=law,
    )
    (actuator,) = actuators_of(robot_with(tmp_path, drive))
    assert (actuator.position_gain, actuator.velocity_gain) == (120.0, 8.0)
    assert (actuator.limit, actuator.feedforward, actuator.offset) == (10.0, 6.0, 0.0)


def test_drake_reads_its_file(tmp_path: Path) -> None:
    pytest.importorskip("pydrake", reason="needs drake: make test-simulators")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import JointActuatorIndex

    model = written(robot_with(tmp_path), tmp_path, "drake")
    plant = MultibodyPlant(0.001)
    Parser(plant).AddModels(str(model.path))
    plant.Finalize()
    actuator = plant.get_joint_actuator(JointActuatorIndex(0))
    assert actuator.default_gear_ratio() == N
    assert actuator.default_rotor_inertia() == pytest.approx(I_M)
    assert actuator.get_controller_gains().p == KP
    assert actuator.get_controller_gains().d == KD
    assert plant.GetJointByName("arm").default_damping() == pytest.approx(VISCOUS)


SPRING = SeriesElasticDrive(gear_ratio=N, motor_inertia_kg_m2=I_M).with_values(
    {"viscous_friction": F_V, "coulomb_friction": F_C, "stiffness": 100.0}
)
WITH: Mapping[str, Any] = {
    "spring": SPRING,
    "parallel spring": replace(
        SERVO, parallel_spring=("linear",), nominal={**SERVO.nominal, "parallel_stiffness": 3.0}
    ),
    "Stribeck friction": replace(
        SERVO,
        friction=(*SERVO.friction, "stribeck"),
        nominal={**SERVO.nominal, "stribeck_friction": 0.01, "stribeck_speed": 2.0},
    ),
    "feed-forward": FED,
}


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("effect", EFFECTS)
def test_what_a_format_lacks_is_said_and_nothing_else(
    tmp_path: Path, name: Any, effect: str
) -> None:
    drive = WITH.get(effect, SERVO)
    said = [one.message for one in written(robot_with(tmp_path, drive), tmp_path, name).warnings]
    is_said = any(f"has no {effect}: it is not in the file for arm (" in text for text in said)
    assert is_said == (effect not in FORMATS[name].holds)


def test_names_are_quoted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = chain(tmp_path, ODD, name="1 odd").with_drives({ODD: SERVO})
    path = written(robot, tmp_path, "isaaclab").path
    ((joint, (_, fields)),) = configured(path, "isaaclab.actuators", monkeypatch).items()
    assert joint == ODD
    assert len(fields["joint_names_expr"]) == 1
    root = etree.parse(written(robot, tmp_path, "drake").path).getroot()
    assert [joint.get("name") for joint in root.iter("joint")] == [ODD] * 2
    for name in ("usd", "newton"):
        _, prim = stage_of(robot, written(robot, tmp_path, name).path, "revolute")
        assert prim.GetPropertyNames()


def test_what_is_refused(tmp_path: Path) -> None:
    """Not a format by the suffix of the file."""
    robot = robot_with(tmp_path)
    for step in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(RobotError, match="time_step_s= must be more than zero and finite"):
            written(robot, tmp_path, "isaaclab", time_step_s=step)
    with pytest.raises(RobotError, match="did you mean 'isaaclab'"):
        seaid.write_model(robot, tmp_path / "x", "isaaclabs")  # type: ignore[arg-type]
    unknown = robot_with(tmp_path, replace(SERVO, coulomb_friction_Nm=None))
    with pytest.raises(RobotError, match="'coulomb_friction_Nm' is not known"):
        written(unknown, tmp_path, "isaaclab")
    assert written(unknown, tmp_path, "urdf").warnings == ()  # which holds what is known
    for name, start in (("a.xml", "<?xml"), ("b.usda", "#usda 1.0"), ("c.urdf", "<robot")):
        model = seaid.write_model(robot, tmp_path / name)
        assert model.path.read_text().startswith(start)
    assert model.drives == tmp_path / "c.toml"


def test_the_table_of_the_documentation_is_that_of_the_code() -> None:
    page = (ROOT / "docs" / "how_to" / "simulators.md").read_text()
    lines = page.splitlines()
    for name, format_ in FORMATS.items():
        steps = " (whole steps)" if format_.in_steps else ""
        held = [f"{x}{steps}" if x == "delay" else x for x in EFFECTS if x in format_.holds]
        lacks = [effect for effect in EFFECTS if effect not in format_.holds]
        (held if format_.has_bodies else lacks).append("bodies")
        if "other terms" in format_.holds:
            held, lacks = ["bodies. The TOML has all else"], []
        lacking = f" It does not hold {', '.join(lacks)}." if lacks else ""
        assert f"- `{name}` holds {', '.join(held)}.{lacking}" in lines
        assert any(line.startswith(f"| `{name}` | `{format_.suffix}`") for line in lines)


def test_the_help_of_the_command_has_all_formats() -> None:
    about = re.search(r"\n    format\n(.*)", export.__doc__ or "")
    assert about is not None
    assert {*FORMATS, *CODE} <= {*re.findall(r"\w+", about[1])}


def test_delays_of_mujoco_stay_whole_in_a_step_ten_times_shorter(tmp_path: Path) -> None:
    root = etree.parse(written(robot_with(tmp_path), tmp_path, "mjcf").path).getroot()
    actuator, step = root.find("actuator/general"), float(root.find("option").get("timestep"))
    assert int(actuator.get("nsample")) * step / 10 >= float(actuator.get("delay")) == DELAY_S
