"""The command that shows: what it says, what it plays, how it ends."""

import re
import signal
import subprocess
import sys
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from seaid.cli.commands import app
from seaid.log import write_log
from seaid.project import save_run
from seaid.view import View, view_robot
from seaid.view.picture import NOMINAL, ellipsoids_of
from tests.experiments import arm_found, leg
from tests.view.motions import log_of, plan_of

MODELS = Path(__file__).parents[2] / "models"
LEG = (str(MODELS / "tulip_leg.urdf"), "--drives", str(MODELS / "tulip_leg.toml"))
AT_ONCE = ("--port", "0", "--seconds", "0")


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["view", *map(str, arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a log, the same as another robot writes it, and a plan."""
    folder = tmp_path_factory.mktemp("motions")
    log = replace(log_of(leg()), motor_torque=log_of(leg()).joint_position)
    (folder / "again").mkdir()
    write_log(log, folder / "run.csv")
    write_log(log, folder / "again" / "run.csv")
    plan_of(leg()).save(folder / "plan.json")
    return folder


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[View]:
    """Return the views that are opened from now on."""
    found: list[View] = []

    def remembered(*arguments: object, **options: object) -> View:
        found.append(view_robot(*arguments, **options))  # type: ignore[arg-type]
        return found[-1]

    monkeypatch.setattr("seaid.view.view_robot", remembered)
    return found


def test_the_address_is_the_last_line_and_options_reach_the_robot(opened: list[View]) -> None:
    """Nothing but the address is printed, and the window ends with the command."""
    options = ("--joints", "knee_pitch,ankle_pitch", "--payload", "foot:2.0:0.15,0,0")
    said = run(*LEG, *options, *AT_ONCE)
    assert (said.exit_code, said.stderr) == (0, "")
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+\n", said.stdout)
    (view,) = opened
    assert not view._clock.is_alive()
    assert view.picture.robot.joint_names == ("knee_pitch", "ankle_pitch")
    assert np.sum(view.picture.robot.payload_parameters[::10]) == 2.0
    assert run(*LEG, "--host", "0.0.0.0", *AT_ONCE).stdout.startswith("http://localhost:")


def test_logs_and_trajectories_are_played_under_their_names(
    folder: Path, opened: list[View]
) -> None:
    logs = ("--log", folder / "run.csv", "--log", folder / "again" / "run.csv")
    said = run(*LEG, *logs, "--trajectory", folder / "plan.json", *AT_ONCE)
    assert said.exit_code == 0, said.stderr
    files = ("run.csv", "again/run.csv", "plan.json")
    assert [x.name for x in opened[0].playbacks] == [str(folder / file) for file in files]
    assert np.all(np.isfinite(opened[0].playbacks[0].deflection[:, 2:]))


def test_what_was_identified_is_compared_with_the_robot_file(
    tmp_path: Path, opened: list[View]
) -> None:
    """A saved run brings its motions, and its nominal bodies only with their file."""
    found, saved = arm_found(), tmp_path / "arm.npz"
    assert found.robot.urdf is not None
    robot = (found.robot.urdf, "--drives", found.robot.urdf.with_suffix(".toml"))
    save_run(found, saved)
    for line in (("--run", saved), (*robot, "--run", saved)):
        said = run(*line, *AT_ONCE)
        assert said.exit_code == 0, said.stderr
    for shown, bodies in zip(opened, (0, 4), strict=True):
        assert len(shown.picture.groups["nominal"]) == bodies
        sizes = [shape.mesh.volume for shape in shown.picture.groups["identified"]]
        expected = [shape.mesh.volume for shape in ellipsoids_of(found.robot, NOMINAL)]
        np.testing.assert_allclose(sizes, expected, rtol=1e-2)
    for shown in opened:
        (played,) = shown.playbacks
        assert played.name == "identified from 1"
        error = played.computed - played.torque
        assert np.all(np.nanstd(error, axis=0) < 0.1 * np.nanstd(played.torque, axis=0))


def test_the_browser_opens_on_request(monkeypatch: pytest.MonkeyPatch) -> None:
    visited: list[str] = []
    monkeypatch.setattr("click.launch", visited.append)
    said = run(*LEG, *AT_ONCE, "--open")
    assert visited == [said.stdout.strip()]


@pytest.mark.slow  # a process of its own, with its window
def test_it_is_shown_until_it_is_interrupted() -> None:
    # a shell lets what it starts in the background ignore Ctrl-C, and its children after it
    heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{heard}; from seaid.cli import main; main()"
    command = [sys.executable, "-c", code, "view", LEG[0], "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        url = process.stdout.readline().decode().strip()
        with urllib.request.urlopen(url, timeout=60) as page:
            assert page.status == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0
        assert process.stdout.read() == process.stderr.read() == b""
