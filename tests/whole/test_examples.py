"""The examples in the docstrings of the packages and of all public names run as they stand."""

import csv
import doctest
import inspect
import shutil
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

import seaid
from scripts.example_robots import example_urdf
from scripts.legged_plant import GO2, plant
from scripts.legged_plant import simulate as simulate_legged
from seaid.log import Motion
from seaid.simulation.simulation import measure, simulate_motion
from tests.experiments import LEG_SENSORS, leg, leg_motion, wiggle
from tests.plants import kept, write_robot

MODELS = Path(__file__).parents[2] / "models"
PACKAGES = ("drives", "robot", "log", "regressor", "excitation", "simulation", "identification")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with models/ and two logs of the leg, as the examples expect them."""
    place = tmp_path_factory.mktemp("examples")
    (place / "models").mkdir()
    for name in ("tulip_leg.urdf", "tulip_leg.toml", "tulip_plan.json"):
        shutil.copy(MODELS / name, place / "models" / name)
    for seed, name in enumerate(("run", "other")):
        seaid.write_log(measure(leg(), leg_motion(), LEG_SENSORS, seed), place / f"{name}.csv")
    return place


@pytest.mark.slow  # some simulate a whole plan, search for one, or identify with a report
@pytest.mark.parametrize("name", [*PACKAGES, "export", "report"])
def test_example_of_a_package_runs(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every name that it makes has a value."""
    monkeypatch.chdir(folder)
    text = (Path(seaid.__file__).parent / name / "__init__.py").read_text().split('"""')[1]
    examples = doctest.DocTestParser().get_examples(text)
    assert len(examples) >= 2
    values: dict[str, object] = {}
    for example in examples:
        exec(compile(example.source, f"seaid.{name}", "single"), values)
    plt.close("all")
    assert all(value is not None for value in values.values())


BOX = '<collision><geometry><box size="0.02 0.02 0.02"/></geometry></collision>'
BODY = """<inertial><origin xyz="0.02 0 -0.15"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.03" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 -0.15"/><geometry><sphere radius="0.03"/></geometry></collision>"""
LIMIT = '<axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="5" effort="100"/>'
LEG = {
    "hip": f"revolute base thigh {LIMIT}",
    "knee": f'revolute thigh shank <origin xyz="0 0 -0.4"/>{LIMIT}',
}
FRICTION = {"viscous_friction": 1e-4, "coulomb_friction": 0.01}
HIP = seaid.StiffDrive(50.0, None, 1e-5).with_values(FRICTION)
KNEE = seaid.SeriesElasticDrive(100.0, 1e-5).with_values(FRICTION | {"stiffness": 300.0})
PROJECT = """[[log]]
file = "run.csv"
[run]
folder = "out"
"""
FUNCTIONS = [name for name in seaid.__all__ if inspect.isfunction(getattr(seaid, name))]
CLASSES = [name for name in seaid.__all__ if inspect.isclass(getattr(seaid, name))]


class Quick(SimpleNamespace):
    """seaid with one identification for all examples, and searches of one step."""

    def __getattr__(self, name: str) -> Any:
        return getattr(seaid, name)


def custom_columns(text: str) -> str:
    """Return a CSV with time in ms and the knee in degrees, under other names."""
    header, *rows = csv.reader(text.splitlines())
    time, knee = header.index("time_s"), header.index("knee.joint_position_rad")
    header[time], header[knee] = "t", "pos_2"
    for row in rows:
        row[time] = str(1e3 * float(row[time]))
        row[knee] = str(np.rad2deg(float(row[knee])))
    return "\n".join(map(",".join, [header, *rows]))


def load_leg(place: Path) -> seaid.Robot:
    """Write the files of the leg, and load it."""
    write_robot(place / "leg.urdf", LEG, {"base": BOX, "thigh": BODY, "shank": BODY})
    seaid.write_drives({"hip": HIP, "knee": KNEE}, place / "leg.toml")
    return seaid.load_robot(place / "leg.urdf", place / "leg.toml")


@kept
def motion_of_the_leg() -> Motion:
    with TemporaryDirectory() as folder:
        robot = load_leg(Path(folder))
        return simulate_motion(robot, wiggle(robot, 12.0, (0.0,) * 2, (0.7,) * 2), rate_hz=200.0)


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A folder with the files of the examples, and the names that they start from."""
    place = tmp_path_factory.mktemp("functions")
    robot, motion = load_leg(place), motion_of_the_leg()
    wiggle(robot, 1.0, (0.0, 0.0), (0.1, 0.1)).save(place / "plan.json")
    logs = [measure(robot, motion, seaid.Noise(torque_std_Nm=1e-3), seed) for seed in range(2)]
    for log, name in zip(logs * 2, ("run.csv", "other.csv", "day.parquet"), strict=False):
        seaid.write_log(log, place / name)
    arrays = [motion.joint_position, motion.joint_velocity, motion.motor_torque]
    table = np.column_stack([motion.time, *arrays])
    np.savetxt(place / "no_header.csv", table, delimiter=",")
    (place / "custom.csv").write_text(custom_columns((place / "run.csv").read_text()))
    (place / "models").symlink_to(MODELS)
    result = seaid.identify(robot, logs[0], feasible=True)
    seaid.write_parameters(result, place / "parameters.json")
    quick = Quick(
        identify=lambda *logs, **options: result,
        design_excitation=partial(seaid.design_excitation, starts=1, iterations=2),
        view_robot=partial(seaid.view_robot, port=0),
    )
    names = {"seaid": quick, "np": np, "Path": Path, "robot": robot, "result": result}
    names["validation"] = seaid.validate(result, logs[1])
    seaid.project.save_run(result, place / "saved.npz")
    (place / "runs" / "latest").mkdir(parents=True)
    (place / "saved.npz").rename(place / "runs" / "latest" / "identification.npz")
    (place / "seaid.toml").write_text('urdf = "leg.urdf"\ndrives = "leg.toml"\n' + PROJECT)
    names |= {"log": logs[0], "cold_log": logs[0], "warm_log": logs[1]}
    names |= {"estimate": result.drives["knee"], **{name: getattr(seaid, name) for name in CLASSES}}
    return place, names


def walking(place: Path) -> dict[str, Any]:
    """Return a quadruped and its walk without flags of contacts."""
    robot = seaid.load_robot(example_urdf("go2.urdf"), base="floating", contacts=GO2.contacts)
    log = simulate_legged(robot, plant(robot), 5.0)
    assert log.base is not None
    return {"robot": robot, "log": replace(log, base=replace(log.base, contacts={}))}


OTHER_ROBOTS = {"find_contacts": walking}


SLOW = (
    *("add_run_in", "compare_replays", "frequency_response", "replay"),  # simulate in small steps
    *("cross_validate", "find_contacts"),  # identify from each log, and simulate a quadruped
    *("run", "simulate", "write_randomization"),  # half a second and more
)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in SLOW else ())
        for name in (*FUNCTIONS, *CLASSES)
    ],
)
def test_example_of_a_public_name_runs(
    name: str,
    prepared: tuple[Path, dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """All functions but `identify` itself use one identification."""
    place, names = prepared
    monkeypatch.chdir(place)
    shutil.rmtree("leg", ignore_errors=True)  # a project that another example has made
    monkeypatch.setattr("seaid.view.window.View.wait", lambda view: None)
    examples = doctest.DocTestParser().get_examples(inspect.getdoc(getattr(seaid, name)) or "")
    assert examples or name in CLASSES
    values = {**names, "seaid": seaid} if name == "identify" else dict(names)
    if name in OTHER_ROBOTS:
        values |= OTHER_ROBOTS[name](place)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", seaid.SeaidWarning)  # searches of two steps end early
        for example in examples:
            exec(compile(example.source, f"seaid.{name}", "single"), values)
    plt.close("all")
