"""The command line: every command, what it says where, what it writes and what it leaves alone."""

from __future__ import annotations

import hashlib
import importlib
import json
import re
import resource
import shlex
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import yaml

import seaid
from seaid._files import plain
from seaid.cli import main
from seaid.cli.commands import COMMANDS, MOVED, RENAMED, command_of
from seaid.cli.messages import error_text
from seaid.errors import IdentificationError, LogError, RobotError
from seaid.estimation import EstimatorName
from tests.cli.small_arm import done, refused, robot_and_drives, run

ROOT = Path(__file__).parents[2]
HELP_SECONDS = 0.5


def test_export_of_saved_parameters_writes_the_same_files(arm: Path, tmp_path: Path) -> None:
    robot, log, saved = robot_and_drives(arm), arm / "run.csv", tmp_path / "parameters.json"
    done("identify", *robot, log, "--feasible", "-o", saved)
    done("export", *robot, "--from", log, "-o", tmp_path / "one.urdf")
    said = done("export", arm / "arm.urdf", "--parameters", saved, "-o", tmp_path / "two.urdf")
    assert said.out.splitlines()[0] == "small_arm: 2 bodies and their drives written"
    for ending in (".urdf", ".toml"):
        one, two = ((tmp_path / name).with_suffix(ending) for name in ("one", "two"))
        assert one.read_bytes() == two.read_bytes()
    assert "is of another robot" in refused(
        *("export", arm / "arm.urdf", "--joints", "elbow", "--parameters", saved),
        *("-o", tmp_path / "three.urdf"),
    )


@pytest.mark.slow  # two identifications, a validation and their pages
def test_report_says_what_it_was_made_of_and_whether_it_is_validated(
    arm: Path, tmp_path: Path
) -> None:
    page, other = tmp_path / "report.html", arm / "other.csv"
    logs = ("--from", arm / "run.csv", "--validate", other)
    said = done("report", *robot_and_drives(arm), *logs, "-o", page)
    verdicts = tuple(f"small_arm: {level}" for level in ("good", "usable with care", "do not use"))
    assert said.out.splitlines()[0].startswith(verdicts)
    text = page.read_text(encoding="utf-8")
    digest = hashlib.sha256(other.read_bytes()).hexdigest()[:12]
    assert f"other.csv, {other.stat().st_size} bytes, SHA-256 {digest}…" in text
    assert "Not validated" not in text
    assert "<dt>Estimator</dt><dd>wls</dd>" in text
    assert [one.name for one in tmp_path.iterdir()] == ["report.html"]
    options = ("--from", arm / "run.csv", "--feasible", "--cutoff-hz", "6", "--force")
    done("report", *robot_and_drives(arm), *options, "-o", page)
    text = page.read_text(encoding="utf-8")
    for words in (
        "Not validated on an unseen motion",
        "<dt>Cutoff</dt><dd>6 Hz</dd>",
        "Physically consistent parameters",
    ):
        assert words in text


def test_inspect_shows_tree_drives_base_parameters_and_sensors(arm: Path) -> None:
    said = done("inspect", *robot_and_drives(arm))
    assert "  upper  <- shoulder: -1.2 to 1.2 rad, stiff; gear_ratio 50.0" in said.out
    assert "    lower  <- elbow: -1.2 to 1.2 rad, series_elastic; gear_ratio 100.0" in said.out
    assert "6 base parameters" in said.out
    assert "  Iyy_upper + 0.09 m_lower" in said.out
    assert "joint_position, joint_torque" in said.out
    assert "  with their derivatives" in said.out


@pytest.mark.slow  # 0.6 s
def test_inspect_measures_planned_motions(arm: Path, tmp_path: Path) -> None:
    robot = seaid.load_robot(arm / "arm.urdf", arm / "arm.toml")
    basis = seaid.excitation.make_basis("bspline", 4.0, 10)
    files = tmp_path / "one.json", tmp_path / "other.json"
    for seed, file in enumerate(files):
        values = np.random.default_rng(seed).uniform(-0.5, 0.5, (10, robot.n))
        seaid.Trajectory(robot.joint_names, basis, values).save(file)
    options = ("--plan", files[0], "--plan", files[1])
    content = json.loads(done("inspect", *robot_and_drives(arm), *options, "--json").out)
    plans = content["result"]["plans"]
    own = [
        seaid.excitation.excitation_measures(robot, seaid.load_trajectory(file)) for file in files
    ]
    for file, one in zip(files, own, strict=True):
        assert plans[str(file)]["d_value"] == pytest.approx(one.d_value)
        assert plans[str(file)]["d_efficiency"] == pytest.approx(own[0].d_efficiency(one))
    said = done("inspect", *robot_and_drives(arm), *options).out
    assert f"D-efficiency of {files[0]} over {files[1]}: " in said


def test_inspect_lists_inconsistent_links(arm: Path, tmp_path: Path) -> None:
    assert "inconsistent" not in done("inspect", arm / "arm.urdf").out
    text = (arm / "arm.urdf").read_text()
    tensor = re.search(r'<inertia ixx="[^"]*"', text)
    assert tensor is not None
    path = tmp_path / "inconsistent.urdf"
    path.write_text(text.replace(tensor.group(), '<inertia ixx="9.0"', 1))
    said = done("inspect", path)
    assert "Physically inconsistent links" in said.out
    assert "  upper has a principal moment of inertia above the sum of the other two" in said.out
    content = json.loads(done("inspect", path, "--json").out)["result"]
    assert list(content["inconsistent_links"]) == ["upper"]


def test_joints_that_are_not_asked_for_are_said_not_to_move(arm: Path) -> None:
    said = done("inspect", arm / "arm.urdf", "--joints", "elbow")
    assert "upper  <- shoulder: does not move" in said.out
    assert "lower  <- elbow: -1.2 to 1.2 rad, torque known at the joint" in said.out


def test_crosscheck_that_fails_says_so_in_its_exit_code(
    arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    apart = seaid.regressor.CrossCheck(False, False, float("inf"), 1.0, (6, 7))
    monkeypatch.setattr("seaid.regressor.cross_check", lambda *_: apart)
    said = run("inspect", arm / "arm.urdf", "--exact", "--json")
    assert said.code == 1
    assert json.loads(said.out)["result"]["exact"]["max_difference"] is None
    assert "error: numeric and exact base parameters of 'small_arm' differ" in said.err


@pytest.mark.slow  # 0.8 s
def test_check_names_a_mistake_and_fails_on_request(arm: Path, tmp_path: Path) -> None:
    right = done("check", *robot_and_drives(arm), arm / "run.csv")
    assert "nothing contradicts the set-up" in right.out
    assert (
        right.code == run("check", *robot_and_drives(arm), arm / "run.csv", "--fail-on=note").code
    )
    wrong = tmp_path / "wrong.csv"
    log = seaid.read_log(arm / "run.csv", seaid.load_robot(arm / "arm.urdf", arm / "arm.toml"))
    seaid.write_log(replace(log, motor_torque=1e3 * log.motor_torque), wrong)
    said = run("check", *robot_and_drives(arm), wrong, "--fail-on", "doubtful")
    assert said.code == 3
    assert "! unit: the torques of all joints are in mNm" in said.out
    assert '    motor_torque = { column = "elbow.motor_torque_Nm", scale = 0.001 }' in said.out
    content = json.loads(run("check", *robot_and_drives(arm), wrong, "--json").out)
    assert [(one["code"], one["severity"]) for one in content["warnings"]] == [("unit", "wrong")]
    assert set(content["result"]["joints"]) == {"shoulder", "elbow"}
    output = ("-o", tmp_path / "found.json", "--fail-on", "wrong")
    said = run("identify", *robot_and_drives(arm), wrong, *output)
    assert (said.code, said.out.splitlines()[0]) == (
        3,
        "small_arm: do not use this result: unit",
    )
    assert "--fail-on: no severity is named 'bad'" in refused(
        "check", *robot_and_drives(arm), wrong, "--fail-on", "bad"
    )
    said = run("check", *robot_and_drives(arm), arm / "run.csv", "--gravity", "9.81,0,0")
    assert "! gravity: gravity has the direction (0,0,-9.81)" in said.out
    assert run("check", *robot_and_drives(arm), wrong, "--gravity", "down").code == 2


def test_identify_prints_what_decides_first_and_the_rest_with_verbose(
    arm: Path, tmp_path: Path
) -> None:
    identify = (
        "identify",
        *robot_and_drives(arm),
        arm / "run.csv",
        "--force",
        "-o",
        tmp_path / "p",
    )
    short, whole = (done(*identify, *option).out for option in ((), ("--verbose",)))
    found = seaid.load_robot(arm / "arm.urdf", arm / "arm.toml")
    robot = seaid.identify(found, seaid.read_log(arm / "run.csv", found))
    verdict, drives, fit = (
        short.index(text) for text in ("small_arm: ", "\nDrives\n", "\nUnexplained torque")
    )
    assert 0 == verdict < drives < fit
    (stiffness,) = (line.split() for line in short.splitlines() if "  stiffness" in line)
    change = robot.drives["elbow"].value("stiffness") / 250.0 - 1
    assert stiffness[2] == "250"
    assert float(stiffness[5]) == pytest.approx(100 * change, rel=0.05)
    assert "Base parameters\n" not in short
    assert "autocorrelation" not in short
    assert whole.startswith(short.partition("small_arm: 6 base")[0])
    assert "Base parameters\n" in whole
    assert "autocorrelation" in whole


def test_logs_read_in_pieces_give_the_same(arm: Path, tmp_path: Path) -> None:
    found = []
    for more in ((), ("--in-pieces",)):
        file = tmp_path / f"p{len(more)}.json"
        options = ("--method", "two-step", *more, "-o", file)
        done("identify", *robot_and_drives(arm), arm / "run.csv", *options)
        found.append(json.loads(file.read_text())["drives"]["elbow"]["stiffness"]["value"])
    assert found[1] == pytest.approx(found[0], rel=1e-6)


def line_of(options: dict[str, Any]) -> list[str]:
    """Return the options of a saved run as words of the command line."""
    words = [options["urdf"], *options["logs"]]
    for name, value in options.items():
        if name not in ("urdf", "logs"):
            values = value if isinstance(value, list | tuple) else [value]
            option = f"--{name.replace('_', '-')}"
            words += [option] if value is True else [x for y in values for x in (option, str(y))]
    return words


def test_the_options_of_a_saved_run_give_the_same_result_again(arm: Path, tmp_path: Path) -> None:
    more = shlex.split(
        "--payload lower:0.01:0,0,-0.1 --gravity 0,0,-9.8 --known-body upper --known-body lower "
        "--estimator huber --cutoff-hz 8 --encoder-offset-std 0.001 --feasible "
        "--known-std torque=0.03,bodies=0.1 --torque-joints shoulder,elbow"
    )
    first, again = tmp_path / "first.npz", tmp_path / "again.npz"
    done("identify", *robot_and_drives(arm), arm / "run.csv", *more, "-o", first)
    options = dict(seaid.load_run(first).provenance["options"])
    assert {"method", "known_body", "payload", "feasible"} <= {*options}
    done("identify", *line_of(options), "-o", again)
    results = [seaid.load_run(path).identification for path in (first, again)]
    assert np.array_equal(results[0].load.values, results[1].load.values)
    assert seaid.load_run(again).provenance["options"] == options


def test_a_plan_that_ends_in_motion_gets_a_run_in_and_a_ros_file(arm: Path, tmp_path: Path) -> None:
    file, message = tmp_path / "plan.json", tmp_path / "plan.yaml"
    search = ("--duration", "2", "--starts", "1", "--iterations", "5", "--ends-in-motion")
    said = done("excite", arm / "arm.urdf", *search, "--joint-trajectory", message, "-o", file)
    assert said.out.splitlines()[-1] == f"Results: {file}, {file.with_suffix('.csv')}, {message}"
    assert "a motion of 2 s (" in said.out
    motion = seaid.load_trajectory(file)
    begin, end = motion.main_interval
    assert 0 < begin < end < motion.duration
    assert yaml.safe_load(message.read_text())["joint_names"] == ["shoulder", "elbow"]


def test_a_file_that_is_there_is_overwritten_with_force_only(arm: Path, tmp_path: Path) -> None:
    file = tmp_path / "x.toml"
    file.write_text("mine")
    describe = ("describe", arm / "run.csv", "-o", file)
    assert refused(*describe) == f"error: '{file}' is there already: name another file, or add " + (
        "--force"
    )
    assert file.read_text() == "mine"
    done(*describe, "--force")
    assert "time" in tomllib.loads(file.read_text())


@pytest.mark.parametrize("command", ["excite", "export"])
def test_the_file_beside_is_not_overwritten_either(arm: Path, tmp_path: Path, command: str) -> None:
    beside = tmp_path / {"excite": "out.csv", "export": "out.toml"}[command]
    beside.write_text("mine")
    output = tmp_path / {"excite": "out.json", "export": "out.urdf"}[command]
    logs = ("--from", arm / "run.csv") if command == "export" else ()
    assert f"'{beside}' is there already" in refused(
        command, *robot_and_drives(arm), *logs, "-o", output
    )
    assert beside.read_text() == "mine"
    assert not output.exists()


@pytest.mark.parametrize("command", [*MOVED])
def test_a_former_command_names_what_to_write_now(command: str) -> None:
    said = run(command, "arm.urdf", "--anything")
    assert (said.code, said.out) == (2, "")
    (line,) = said.err.splitlines()
    assert line == f"error: 'seaid {command}' is no longer there: {MOVED[command]}"
    for name, *options in re.findall(r"seaid (\w+)[^-]*((?:--?\w+[^-]*)*)", MOVED[command]):
        words = {word for one in command_of(name).params for word in one.opts}
        assert {*re.findall(r"--?[a-z][\w-]*", " ".join(options))} <= words
    content = json.loads(run(command, "--json").out)
    assert content["error"] == {"message": line.removeprefix("error: "), "exit_code": 2}


@pytest.mark.parametrize("option", [*RENAMED])
def test_a_former_option_names_what_to_write_now(option: str) -> None:
    for words in ((option, "x"), (f"{option}=x",)):
        said = run("identify", "arm.urdf", *words)
        line = f"error: '{option}' is no longer there: write {RENAMED[option]}\n"
        assert (said.code, said.out, said.err) == (2, "", line)
    options = {word for name in COMMANDS for one in command_of(name).params for word in one.opts}
    assert RENAMED[option].split()[0] in options


@pytest.mark.parametrize("command", [*COMMANDS])
def test_the_help_of_a_command_explains_options_and_teaches_by_examples(command: str) -> None:
    help_text = done(command, "-h").out
    assert help_text == done(command, "--help").out
    assert f"seaid {command} [OPTIONS]" in help_text
    assert " ".join(help_text.split("\n\n")[1].split()) == COMMANDS[command]
    helps = [one.help or "" for one in command_of(command).params]
    assert [text for text in helps if not re.fullmatch(r"[A-Za-z].{6,}[^.,;]\.", text)] == []
    lines = [line.strip() for line in help_text.splitlines() if line.startswith("  seaid ")]
    assert lines
    assert all(line.startswith(f"seaid {command} ") for line in lines)


def test_help_lists_every_command_once_in_a_section() -> None:
    said = done("--help").out
    listed = re.findall(r"^  ([a-z-]+)  +\S", said.partition("\nProject:\n")[2], re.MULTILINE)
    assert listed == [*COMMANDS]
    assert "\nIdentification:\n  identify " in said


def examples() -> list[str]:
    """Return all commands in helps and in the README, without their comments."""
    helps = [done(command, "--help").out for command in COMMANDS]
    texts = [done("--help").out, *helps, (ROOT / "README.md").read_text(encoding="utf-8")]
    whole = [re.sub(r"\s*\\\n\s*", " ", text) for text in texts]
    lines = [line.strip() for text in whole for line in text.splitlines()]
    return [line.partition("  ")[0] for line in lines if re.match(r"seaid [a-z]+ [\w/]+\.", line)]


@pytest.mark.slow  # 0.6 s
def test_every_example_is_right_usage() -> None:
    found = examples()
    assert len(found) > 20
    for example in found:
        _, name, *arguments = shlex.split(example, comments=True)
        command_of(name).make_context(name, arguments)  # raises for wrong usage


def test_help_and_reference_name_all_estimators() -> None:
    said = re.findall(r"\w+", done("identify", "--help").out)
    for name in get_args(EstimatorName):
        assert name in said
        assert f'"{name}"' in str(seaid.identify.__doc__)


def test_help_and_version_come_at_once() -> None:
    def processor_seconds() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    before = processor_seconds()
    subprocess.run([sys.executable, "-m", "seaid", "--help"], check=True, capture_output=True)
    assert processor_seconds() - before < HELP_SECONDS
    assert done("--version").out == f"seaid {seaid.__version__}\n"
    assert all(command in done("--help").out for command in COMMANDS)


def test_console_script_is_the_command_line() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, _, name = project["scripts"]["seaid"].partition(":")
    assert getattr(importlib.import_module(module), name) is main


def test_nothing_heavy_is_imported_for_the_help() -> None:
    code = "import sys; sys.argv = ['seaid', '--help']\nfrom seaid.cli import main\ntry: main()\n"
    code += "except SystemExit: print(*sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    loaded = said.stdout.splitlines()[-1].split()
    assert "seaid.cli.commands" in loaded
    assert not {"numpy", "pydantic", "rich", "seaid.cli.options", "seaid.cli.signature"} & {*loaded}


def test_no_command_reads_its_words_by_pydantic() -> None:
    """Typer's readers import it, which takes 0.2 s; a Typer without such readers passes as well."""
    words = ["seaid", "simulate", "no.urdf", "no.json", "--seed", "3", "--rate-hz", "1e3"]
    code = f"import sys; sys.argv = {words}\nfrom seaid.cli import main\ntry: main()\n"
    code += "except SystemExit: print(*sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert "no URDF file at 'no.urdf'" in said.stderr
    assert "pydantic" not in said.stdout.splitlines()[-1].split()


@pytest.mark.parametrize(
    ("option", "word", "kind"), [("--seed", "1.5", "int"), ("--rate-hz", "fast", "float")]
)
def test_words_that_are_no_numbers_are_wrong_usage(option: str, word: str, kind: str) -> None:
    said = run("simulate", "no.urdf", "no.json", option, word)
    assert said.code == 2
    assert f"'{word}' is no {kind}" in said.err


def test_arguments_of_the_library_are_named_as_options() -> None:
    first = RobotError(
        "torque_joints= names no joint:\n give feasible=True, or write it with force=True",
        *("torque_joints=", "feasible=True", "write it with force=True"),
    )
    with pytest.raises(LogError) as caught:
        try:
            raise first
        except RobotError as problem:  # as readers do, to say which file it is
            raise LogError(f"'joints=.csv': {problem}") from None
    assert error_text(caught.value) == (
        "'joints=.csv': --torque-joints names no joint: give --feasible, or add "
        "--allow-inconsistent"
    )
    method = IdentificationError(
        'estimator="iv" needs method="two-step"', 'estimator="iv"', 'method="two-step"'
    )
    assert error_text(method) == '--estimator "iv" needs --method "two-step"'
    assert error_text(LogError("use joints=[...]", "joints=[...]")) == "use --joints"


def test_json_has_no_numbers_that_json_has_not() -> None:
    data = {"a": np.array([1.0, np.nan]), "b": (np.inf, Path("x")), 3: np.float64(2)}
    assert plain(data) == {"a": [1.0, None], "b": [None, "x"], "3": 2.0}


def test_export_for_a_simulator_with_ranges(arm: Path, tmp_path: Path) -> None:
    robot, actuators = robot_and_drives(arm), tmp_path / "actuators.py"
    ranges = tmp_path / "ranges.yaml"
    said = done(
        *("export", *robot, "--from", arm / "run.csv", "--format", "isaaclab", "-o", actuators),
        *("--randomization", ranges, "--samples", "3"),
    )
    assert "not determined by the log, and as wide as the prior: " in said.out
    assert "ACTUATORS = {" in actuators.read_text()
    assert ranges.read_text().startswith('format: "seaid randomization 1"')
