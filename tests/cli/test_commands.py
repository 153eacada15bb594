"""Each command is the call of the library that it stands for, as text, as JSON and on stdout."""

import json
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid._files import plain
from seaid.cli.commands import COMMANDS, command_of
from seaid.export import content_of
from tests.cli.small_arm import done, log_of, refused, robot_and_drives, robot_of, run


@pytest.fixture(scope="module", autouse=True)
def results(arm: Path) -> None:
    """Write the runs and the parameters that commands read."""
    for name in ("run", "other"):
        done("identify", *robot_and_drives(arm), arm / f"{name}.csv", "-o", arm / f"{name}.npz")
    seaid.write_parameters(seaid.project.load_run(arm / "run.npz").identification, arm / "run.json")


@cache
def identified(arm: Path, name: str = "run.csv") -> seaid.Identification:
    return seaid.identify(robot_of(arm), log_of(arm, name))


def comparison(arm: Path) -> dict[str, Any]:
    files = (arm / "run.npz", arm / "other.npz")
    runs = [seaid.project.load_run(file).identification for file in files]
    return asdict(seaid.report.comparison_of(*runs, names=("run.npz", "other.npz")))


def inspected(arm: Path) -> dict[str, Any]:
    robot = robot_of(arm)
    sensors: Any = ("motor_position", "motor_torque")
    derivatives = seaid.identifiability(robot, sensors).derivatives
    assert derivatives is not None
    return {
        "base_parameters": list(seaid.base_parameters(robot).expressions),
        "joints": [
            {"joint": "shoulder"},
            {"joint": "elbow", "drive": {"stiffness_Nm_per_rad": 250.0}},
        ],
        "sensors": {", ".join(sensors): {"by_derivatives": list(derivatives.expressions)}},
    }


def in_pieces(arm: Path) -> dict[str, Any]:
    found = seaid.identify(robot_of(arm), str(arm / "run.csv"), method="two-step")
    return content_of(found)


def responded(arm: Path) -> dict[str, Any]:
    found = seaid.frequency_response(robot_of(arm), log_of(arm), band_hz=(0.3, 5.0))
    drives = {joint: seaid.export.values_of(one) for joint, one in found.drives.items()}
    return {"drives": drives, "frequency_hz": found.frequency_hz}


def calibrated(arm: Path) -> dict[str, Any]:
    found = seaid.identification.calibrate_statics(
        seaid.identification.read_statics(arm / "weights.csv")
    ).estimate
    return {"parameters": {"stiffness": {"value": found.value("stiffness"), "unit": "N m/rad"}}}


def folds(arm: Path) -> dict[str, Any]:
    logs = [log_of(arm), log_of(arm, "other.csv")]
    own = seaid.cross_validate(robot_of(arm), logs, estimator="ols", cutoff_hz=6.0)
    return {"validations": [one.to_dict() for one in own]}


def replayed(arm: Path) -> dict[str, Any]:
    other, found = log_of(arm, "other.csv"), identified(arm).robot
    return seaid.compare_replays(robot_of(arm), found, other).to_dict()


def code_of(arm: Path) -> dict[str, Any]:
    form = seaid.symbolic.rigid_body(seaid.load_robot(arm / "arm.urdf"))
    return {"base_parameters": list(form.base.expressions)}


Library = Callable[[Path], dict[str, Any]]
ARM, LOG = "arm.urdf --drives arm.toml", "arm.urdf run.csv --drives arm.toml"
FROM = "arm.urdf other.csv --from run.csv --drives arm.toml"
LINES: dict[str, tuple[str, str, Library]] = {
    "inspect": (ARM, "", inspected),
    "inspect --exact": ("arm.urdf", "", lambda _: {"exact": {"agree": True}}),
    "excite": ("arm.urdf --duration 2 --starts 1 --iterations 3", "json", lambda _: {}),
    "simulate": ("arm.urdf short_plan.json --drives arm.toml", "csv", lambda _: {}),
    "describe": (
        "run.csv",
        "toml",
        lambda arm: {"description": seaid.describe_log(arm / "run.csv").description.to_dict()},
    ),
    "check": (
        LOG,
        "",
        lambda arm: {"joints": plain(seaid.check(robot_of(arm), log_of(arm)).joints)},
    ),
    "check --terms": (
        f"{LOG} --of elbow",
        "toml",
        lambda arm: {
            "recommended": seaid.compare_terms(
                robot_of(arm), log_of(arm), joints=["elbow"]
            ).recommended
        },
    ),
    "calibrate": ("weights.csv", "", calibrated),
    "identify": (LOG, "json", lambda arm: content_of(identified(arm))),
    "identify --refine": (
        LOG,
        "json",
        lambda arm: content_of(seaid.refine(identified(arm), log_of(arm))),
    ),
    "identify --in-pieces": (f"{LOG} --method two-step", "json", in_pieces),
    "frequency": (f"{LOG} --band 0.3,5", "", responded),
    "validate": (
        FROM,
        "json",
        lambda arm: seaid.validate(identified(arm), log_of(arm, "other.csv")).to_dict(),
    ),
    "validate --cross": (
        "arm.urdf run.csv other.csv --drives arm.toml --estimator ols --cutoff-hz 6",
        "",
        folds,
    ),
    "replay": (f"{FROM} --nominal arm.toml", "html", replayed),
    "compare": ("run.npz other.npz", "html", comparison),
    "report": ("arm.urdf --from run.csv --drives arm.toml", "html", lambda _: {"validations": []}),
    "export": (
        "arm.urdf --from run.csv --drives arm.toml",
        "urdf",
        lambda _: {"bodies": ["upper", "lower"]},
    ),
    "export --format python": ("arm.urdf", "py", code_of),
}
"""{command: its arguments, the suffix of its output, and what the library returns for it}."""

SLOW = ("frequency", "identify --refine", "replay", "validate --cross")
"""Commands that fit or simulate for more than a second."""

OF_PROJECTS = ("init", "run")
"""Commands that are tried in tests/project."""

VERDICTS = (
    *("identify", "identify --refine", "identify --in-pieces", "validate", "report", "export"),
    "replay",
)
"""Lines whose result is judged."""

KEYS = ["format", "command", "robot", "verdict", "warnings", "notes", "result", "files", "error"]


def check_part(found: Any, part: Any, place: str = "result") -> None:
    """Check that JSON content holds a part, with the same numbers."""
    if isinstance(part, dict):
        for key, value in part.items():
            assert key in found, f"{place} has no {key}"
            check_part(found[key], value, f"{place}.{key}")
    elif isinstance(part, list):
        assert len(found) == len(part), place
        for number, (one, of_part) in enumerate(zip(found, part, strict=True)):
            check_part(one, of_part, f"{place}[{number}]")
    elif isinstance(part, float):
        assert found == pytest.approx(part, rel=1e-6, abs=1e-12), place
    else:
        assert found == part, place


def test_every_command_but_the_view_is_tried_here() -> None:
    tried = {line.split()[0] for line in LINES}
    assert tried == {*COMMANDS} - {"view", *OF_PROJECTS}
    outputs = {
        name for name in tried if any("--output" in one.opts for one in command_of(name).params)
    }
    assert outputs == {line.split()[0] for line, (_, suffix, _) in LINES.items() if suffix}


@pytest.mark.parametrize(
    "command",
    [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in LINES],
)
def test_a_command_is_the_call_of_the_library(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    """With --json stdout has the JSON, and nothing is written but the output."""
    monkeypatch.chdir(arm)
    arguments, suffix, of_library = LINES[command]
    before = {*arm.iterdir()}
    line, file = [*command.split(), *arguments.split()], tmp_path / f"out.{suffix}"
    said = done(*line, *(("-o", file) if suffix else ()), "--json")
    content = json.loads(said.out)
    assert [*content] == KEYS
    assert (content["format"], content["command"]) == (f"seaid {line[0]} 1", line[0])
    assert content["robot"] == (None if command in ("describe", "calibrate") else "small_arm")
    assert content["error"] is None
    check_part(content["result"], plain(of_library(arm)))
    assert {*content["files"]} == {str(one) for one in tmp_path.iterdir()}
    assert (content["verdict"] is not None) == (command in VERDICTS)
    if suffix:
        assert said.err.splitlines()[-1].startswith(f"Results: {file}")
    assert {*arm.iterdir()} == before


def test_every_limit_and_gravity_is_an_option(arm: Path) -> None:
    help_text = done("excite", "--help").out
    assert all(f"--{one.name.replace('_', '-')} " in help_text for one in fields(seaid.Limits))
    for name in COMMANDS:
        options = {option for one in command_of(name).params for option in one.opts}
        assert ("--gravity" in options) == ("urdf" in options), name
    none = json.loads(done("inspect", arm / "arm.urdf", "--gravity", "0,0,0", "--json").out)
    robot = seaid.load_robot(arm / "arm.urdf", gravity=(0.0, 0.0, 0.0))
    assert none["result"]["base_parameters"] == list(seaid.base_parameters(robot).expressions)


@pytest.fixture(scope="module")
def sines(arm: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A multisine planned on the command line, and its simulated log without joint encoder."""
    folder = tmp_path_factory.mktemp("sines")
    plan, log = folder / "sine.json", folder / "log.csv"
    shape = ("--basis", "multisine", "--duration", "4", "--period-s", "2", "--band", "0.6,16")
    size = ("--amplitude", "shoulder=0.05,elbow=0.1", "--acceleration", "300", "--velocity", "3")
    done("excite", *robot_and_drives(arm), *shape, *size, "-o", plan)
    noise = ("--torque-std", "0.001", "--motor-resolution", "0.002")
    done("simulate", *robot_and_drives(arm), plan, *noise, "-o", log)
    measured = seaid.read_log(log, robot_of(arm))
    position = measured.joint_position.copy()
    position[:, 1] = np.nan
    seaid.write_log(replace(measured, joint_position=position), log)
    return plan, log


@pytest.mark.slow  # plan, simulation and several fits
def test_a_multisine_from_its_plan_to_the_report(
    arm: Path, sines: tuple[Path, Path], tmp_path: Path
) -> None:
    """Through simulation with its run-in, stick-slip and encoders, and compared with a run."""
    (plan, log), saved = sines, arm / "run.npz"
    page = tmp_path / "page.html"
    line = ("frequency", *robot_and_drives(arm), log, "--plan", plan, "--run", saved)
    content = json.loads(done(*line, "--json").out)["result"]
    stiffness = content["drives"]["elbow"]["stiffness"]["value"]
    assert stiffness == pytest.approx(250.0, rel=0.03)
    narrow = ("frequency", *robot_and_drives(arm), log, "--band", "0.6,0.7")
    assert "excited frequencies from 0.6 to 0.7 Hz" in refused(*narrow)
    wrong = ("frequency", *robot_and_drives(arm), log, "--plan", arm / "run_plan.json")
    assert "--plan must be a multisine" in run(*wrong).err
    fit = seaid.project.load_run(saved).identification
    drive = fit.drive_side["elbow"]
    values = np.where(np.array(drive.names) == "stiffness", 1.3, 1.0) * drive.values
    stiffer = replace(fit, drive_side={"elbow": replace(drive, values=values)})
    response = seaid.frequency_response(
        robot_of(arm),
        seaid.read_log(log, robot_of(arm)),
        plan=seaid.load_trajectory(plan),
        identification=stiffer,
    )
    seaid.write_report(stiffer, page, frequency=response)
    assert "Size of the frequency response of elbow" in page.read_text(encoding="utf-8")
    (one,) = [x for x in response.warnings if x.code == "estimator-disagrees"]
    assert (one.joint, one.severity) == ("elbow", "doubtful")
    with pytest.raises(seaid.SeaidError, match="give a response of the same robot"):
        seaid.write_report(fit, page, frequency=replace(response, joints=("knee", "ankle")))


def test_errors_and_notes_are_in_the_json(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(arm)
    for line, code, words in (
        (("inspect", "no.urdf"), 1, "no URDF file at 'no.urdf'"),
        (("identify", "arm.urdf"), 2, "LOG: it is missing"),
        (("inspect", "caf\udce9.urdf"), 1, "caf\\udce9.urdf"),
        (("identfy",), 2, "Did you mean 'identify'?"),
    ):
        said, without = run(*line, "--json"), run(*line)
        content = json.loads(said.out)
        assert [*content] == KEYS
        assert content["error"]["exit_code"] == said.code == without.code == code
        message = " ".join(content["error"]["message"].split())
        assert words in message.encode("utf-8", "backslashreplace").decode()
        assert (content["result"], said.err, without.out) == (None, without.err, "")
    text = (arm / "arm.urdf").read_text()
    rounded = tmp_path / "rounded.urdf"
    rounded.write_text(text.replace('xyz="0 0 -0.3"', 'xyz="0 0 -0.3" rpy="1.5708 0 0"'))
    said = done("inspect", rounded, "--json")
    (note,) = json.loads(said.out)["notes"]
    assert "1.5708" in note
    assert said.err == f"note: {note}\n"


def test_the_view_has_its_address_in_json(arm: Path) -> None:
    pytest.importorskip("viser")
    options = ("--port", "0", "--seconds", "0", "--json")
    content = json.loads(done("view", arm / "arm.urdf", *options).out)
    assert [*content] == KEYS
    assert content["result"]["url"].startswith("http://127.0.0.1:")
