"""Each command is the call of the library that it stands for, as text, as JSON and on stdout."""

import ast
import json
import re
import runpy
import tomllib
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import seaid
from seaid._files import plain
from seaid.cli.commands import COMMANDS, command_of
from seaid.export import content_of
from tests.cli.small_arm import done, log_of, refused, robot_and_drives, robot_of, run
from tests.representatives import quick_only


@pytest.fixture(scope="module", autouse=True)
def results(arm: Path) -> None:
    """Write the runs and the parameters that commands read."""
    for name in ("run", "other"):
        done("identify", *robot_and_drives(arm), arm / f"{name}.csv", "-o", arm / f"{name}.npz")
    seaid.write_parameters(seaid.project.load_run(arm / "run.npz").identification, arm / "run.json")


@cache
def identified(arm: Path, name: str = "run.csv") -> seaid.Identification:
    return seaid.identify(robot_of(arm), log_of(arm, name))


def conditions(arm: Path) -> dict[str, Any]:
    robot, logs = robot_of(arm), {"a": log_of(arm), "b": log_of(arm, "other.csv")}
    pairs = {name: (robot, log) for name, log in logs.items()}
    found = seaid.identify_conditions(pairs, condition_specific=("viscous_friction",))
    each = {name: content_of(one) for name, one in found.identifications.items()}
    names = [{"parameter": str(name)} for name in found.differences]
    return {"conditions": each, "differences": names}


def comparison(arm: Path) -> dict[str, Any]:
    runs = (seaid.project.load_run(arm / f"{name}.npz").identification for name in ("run", "other"))
    found = seaid.report.comparison_of(*runs, names=("run", "other"))
    keys = ("name", "first", "second_error", "change", "significance", "p_value", "is_significant")
    rows = [{key: getattr(row, key) for key in keys} for row in found.differences]
    groups = {name: {"chi_square": one.chi_square} for name, one in found.groups.items()}
    return {"names": found.names, "differences": rows, "groups": groups}


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


def measures(arm: Path) -> dict[str, Any]:
    files = ("run_plan.json", "other_plan.json")
    plans = [seaid.load_trajectory(arm / file) for file in files]
    first, other = (seaid.excitation.excitation_measures(robot_of(arm), plan) for plan in plans)
    efficiency = first.d_efficiency(other)
    values = {"d_value": other.d_value, "d_efficiency": efficiency}
    return {"plans": {files[0]: {"d_value": first.d_value}, files[1]: values}}


def in_pieces(arm: Path) -> dict[str, Any]:
    found = seaid.identify(robot_of(arm), str(arm / "run.csv"), method="two-step")
    return content_of(found)


def responded(arm: Path) -> dict[str, Any]:
    found = seaid.frequency_response(robot_of(arm), log_of(arm), band_hz=(0.3, 5.0))
    drives = {
        joint: [{"name": x, "value": v} for x, v in zip(one.names, one.values, strict=True)]
        for joint, one in found.drives.items()
    }
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
    "inspect --plan run_plan.json": (f"{ARM} --plan other_plan.json", "", measures),
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
    "check --delays": (
        LOG,
        "csv",
        lambda arm: {
            "delays": [
                asdict(x) for x in seaid.identification.estimate_delays(robot_of(arm), log_of(arm))
            ]
        },
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
    "identify --condition a=run.csv": (
        f"{ARM} --condition b=other.csv --specific viscous_friction",
        "json",
        conditions,
    ),
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
READ: dict[str, Callable[[str], object]] = {
    "json": json.loads,
    "toml": tomllib.loads,
    "urdf": ElementTree.fromstring,
    "csv": lambda text: np.loadtxt(text.splitlines(), delimiter=",", skiprows=1),
    "html": str.split,
    "py": ast.parse,
}


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


@pytest.mark.parametrize(
    "command",
    quick_only(
        [name for name, (_, suffix, _) in LINES.items() if suffix],
        ["simulate", "describe", "identify", "export --format python"],
    ),
)
def test_a_result_on_stdout_is_that_of_the_file(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    """With `-o -` the text goes to stderr."""
    monkeypatch.chdir(arm)
    arguments, suffix, _ = LINES[command]
    line, file = [*command.split(), *arguments.split()], tmp_path / f"out.{suffix}"
    done(*line, "-o", file)
    printed = done(*line, "-o", "-")
    if command != "report":
        written = [re.sub(r"\d\d:\d\d UTC", "", x) for x in (printed.out, file.read_text())]
        assert written[0].rstrip("\n") == written[1].rstrip("\n")
    READ[LINES[command][1]](printed.out)
    assert "Results: " not in printed.out + printed.err
    said = run(*line, "-o", "-", "--json")
    assert said.code == 2
    assert "stdout has the JSON: name a file" in said.err


@pytest.mark.slow  # a command with a robot each
def test_files_of_a_command_are_those_of_the_library(arm: Path, tmp_path: Path) -> None:
    """Logs with errors of encoders, plans within limits, and code with payloads."""
    line = ("simulate", *robot_and_drives(arm), arm / "short_plan.json")
    noise = ("--joint-offset", "elbow=0.02", "--motor-offset", "0.3", "--torque-std", "0.001")
    done(*line, *noise, "--seed", "1", "-o", tmp_path / "off.csv")
    robot, plan = robot_of(arm), seaid.load_trajectory(arm / "short_plan.json")
    off = seaid.read_log(tmp_path / "off.csv", robot)
    errors = {"joint_offset_rad": (0.0, 0.02), "motor_offset_rad": (0.3, 0.3)}
    own = seaid.simulate(robot, plan, noise=seaid.Noise(**errors, torque_std_Nm=0.001), seed=1)
    for channel in ("motor_position", "motor_torque", "joint_position"):
        np.testing.assert_allclose(getattr(off, channel), getattr(own, channel), atol=1e-9)

    search = ("--duration", "2", "--starts", "1", "--iterations", "3", "--seed", "1")
    limits = ("--motor-speed", "elbow=60", "--deflection", "elbow=0.02")
    done("excite", *robot_and_drives(arm), *search, *limits, "-o", tmp_path / "plan.json")
    bounds = seaid.Limits(motor_speed={"elbow": 60.0}, deflection={"elbow": 0.02})
    options: Any = {"duration": 2.0, "starts": 1, "iterations": 3, "seed": 1}
    with pytest.warns(seaid.SeaidWarning, match="raise iterations"):
        planned = seaid.design_excitation(robot, limits=bounds, **options).trajectory
    read = seaid.load_trajectory(tmp_path / "plan.json")
    np.testing.assert_allclose(read.coefficients, planned.coefficients)

    known = ("--payload", "lower:2:0.1,0,0", "--parameters", arm / "run.json")
    done("export", arm / "arm.urdf", *known, "-o", tmp_path / "loaded.py")
    states = np.random.default_rng(5).normal(size=(3, 4, 2))
    found = runpy.run_path(str(tmp_path / "loaded.py"))["inverse_dynamics"](*states)
    payload = seaid.Payload("lower", 2.0, (0.1, 0.0, 0.0))
    loaded = seaid.load_robot(arm / "arm.urdf", payloads=[payload])
    loaded = seaid.export.read_parameters(arm / "run.json", loaded)
    np.testing.assert_allclose(found, seaid.regressor.joint_torques(loaded, *states), atol=1e-9)


def test_every_limit_and_gravity_is_an_option(arm: Path) -> None:
    help_text = done("excite", "--help").out
    assert all(f"--{one.name.replace('_', '-')} " in help_text for one in fields(seaid.Limits))
    for name in COMMANDS:
        options = {option for one in command_of(name).params for option in one.opts}
        assert ("--gravity" in options) == ("urdf" in options), name
    none = json.loads(done("inspect", arm / "arm.urdf", "--gravity", "0,0,0", "--json").out)
    robot = seaid.load_robot(arm / "arm.urdf", gravity=(0.0, 0.0, 0.0))
    assert none["result"]["base_parameters"] == list(seaid.base_parameters(robot).expressions)


def test_a_late_channel_is_corrected(arm: Path, tmp_path: Path) -> None:
    log, robot, output = log_of(arm), robot_of(arm), tmp_path / "corrected.csv"
    late = np.array(log.motor_position)
    late[5:, 0] = late[:-5, 0]  # the motor encoder of the shoulder is 5 ms late
    seaid.write_log(replace(log, motor_position=late), tmp_path / "late.csv")
    line = ("check", *robot_and_drives(arm), tmp_path / "late.csv", "--delays")
    assert "is 5" in done(*line, "--largest-s", "0.02", "-o", output).out
    corrected = seaid.read_log(output, robot)
    part = slice(400, 900)
    true = np.interp(corrected.time[part], log.time, log.motor_position[:, 0])
    error = corrected.motor_position[part, 0] - true
    assert np.max(np.abs(error)) < 0.05 * np.ptp(true)


@pytest.mark.slow  # simulates the arm with its load, and identifies two pairs of logs
def test_a_condition_has_its_own_payload(arm: Path, tmp_path: Path) -> None:
    load = "lower:0.4:0.1,0,0"
    log, drives = tmp_path / "loaded.csv", robot_and_drives(arm)
    done("simulate", *drives, arm / "other_plan.json", "--payload", load, "-o", log)
    both = ("--condition", f"bare={arm / 'run.csv'}", "--condition", f"loaded={log}")
    line = ("identify", *drives, *both, "--specific", "", "--condition-payload", f"loaded={load}")
    payload = seaid.Payload("lower", 0.4, (0.1, 0.0, 0.0))
    loaded = seaid.load_robot(arm / "arm.urdf", arm / "arm.toml", payloads=[payload])
    own = seaid.identify_conditions(
        {"bare": (robot_of(arm), log_of(arm)), "loaded": (loaded, seaid.read_log(log, loaded))},
        condition_specific=(),
    )
    each = {name: {"load": content_of(one)["load"]} for name, one in own.identifications.items()}
    check_part(json.loads(done(*line, "--json").out)["result"]["conditions"], plain(each))


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
    found = {one["name"]: one["value"] for one in content["drives"]["elbow"]}
    assert found["stiffness"] == pytest.approx(250.0, rel=0.03)
    assert content["identified"] is not None
    narrow = ("frequency", *robot_and_drives(arm), log, "--band", "0.6,0.7")
    assert "excited frequencies from 0.6 to 0.7 Hz" in refused(*narrow)
    wrong = ("frequency", *robot_and_drives(arm), log, "--plan", arm / "run_plan.json")
    assert "--plan must be a multisine" in run(*wrong).err
    done("report", "--run", saved, "--multisine", log, "--plan", plan, "-o", page)
    assert "Size of the frequency response of elbow" in page.read_text(encoding="utf-8")
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
    options = ("--port", "0", "--seconds", "0", "--no-browser", "--json")
    content = json.loads(done("view", arm / "arm.urdf", *options).out)
    assert [*content] == KEYS
    assert content["result"]["url"].startswith("http://127.0.0.1:")
