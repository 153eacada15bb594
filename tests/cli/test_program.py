"""The command line: every command, what it says where, what it writes, and odd streams."""

import importlib
import json
import os
import re
import resource
import shlex
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

import seaid
from seaid.cli.commands import COMMANDS, MOVED, RENAMED, command_of, summary_of
from seaid.cli.messages import error_text
from seaid.cli.program import main
from seaid.errors import IdentificationError, LogError, RobotError
from tests.cli.small_arm import done, log_of, refused, robot_and_drives, robot_of, run
from tests.representatives import quick_first

ROOT = Path(__file__).parents[2]
HELP_SECONDS = 0.5


def test_inspect_shows_tree_drives_base_parameters_and_sensors(arm: Path, tmp_path: Path) -> None:
    """What a robot file has: joints that move and others, drives, and bodies that cannot be."""
    said = done("inspect", *robot_and_drives(arm)).out
    for words in (
        "  upper  <- shoulder: -1.2 to 1.2 rad, stiff; gear_ratio 50.0",
        "    lower  <- elbow: -1.2 to 1.2 rad, series_elastic; gear_ratio 100.0",
        "  Iyy_upper + 0.09 m_lower",
        "joint_position, joint_torque",
        "  with their derivatives",
    ):
        assert words in said
    assert "inconsistent" not in said
    path = tmp_path / "inconsistent.urdf"
    path.write_text((arm / "arm.urdf").read_text().replace('ixx="0.025"', 'ixx="9.0"'))
    said = done("inspect", path, "--joints", "elbow").out
    assert "upper  <- shoulder: does not move" in said
    assert "  upper has a principal moment of inertia above the sum of the other two" in said


def test_crosscheck_that_fails_says_so_in_its_exit_code(
    arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    apart = seaid.regressor.CrossCheck(False, False, float("inf"), 1.0, (6, 7))
    monkeypatch.setattr("seaid.regressor.cross_check", lambda *_: apart)
    said = run("inspect", arm / "arm.urdf", "--exact", "--json")
    assert said.code == 1
    assert json.loads(said.out)["result"]["exact"]["max_difference"] is None
    assert "Error: numeric and exact base parameters of 'small_arm' differ" in said.err


@pytest.mark.slow  # 0.8 s
def test_a_mistake_decides_the_exit_code_on_request(arm: Path, tmp_path: Path) -> None:
    """A right log has no finding, and a factor of 1000 in its torques fails by --fail-on."""
    right = done("check", *robot_and_drives(arm), arm / "run.csv", "--fail-on=note")
    assert "nothing contradicts the set-up" in right.out
    wrong, log = tmp_path / "wrong.csv", log_of(arm)
    seaid.write_log(replace(log, motor_torque=1e3 * log.motor_torque), wrong)
    said = run("check", *robot_and_drives(arm), wrong, "--fail-on", "doubtful")
    assert said.code == 3
    assert '    motor_torque = { column = "elbow.motor_torque_Nm", scale = 0.001 }' in said.out
    content = json.loads(run("check", *robot_and_drives(arm), wrong, "--json").out)
    assert [(one["code"], one["severity"]) for one in content["warnings"]] == [("unit", "wrong")]
    output = ("-o", tmp_path / "found.json", "--fail-on", "wrong")
    said = run("identify", *robot_and_drives(arm), wrong, *output)
    assert said.code == 3
    assert said.out.startswith("small_arm: do not use this result: unit\n")


def test_identify_prints_what_decides_first_and_the_rest_with_verbose(
    arm: Path, tmp_path: Path
) -> None:
    """The change from the nominal value stands next to the estimate."""
    identify = ("identify", *robot_and_drives(arm), arm / "run.csv", "-o", tmp_path / "p")
    short, whole = (done(*identify, *more).out for more in ((), ("--verbose", "--force")))
    verdict, drives, fit = map(short.index, ("small_arm: ", "\nDrives\n", "\nUnexplained torque"))
    assert 0 == verdict < drives < fit
    found = seaid.identify(robot_of(arm), log_of(arm))
    (stiffness,) = (line.split() for line in short.splitlines() if "  stiffness" in line)
    change = found.drives["elbow"].value("stiffness") / 250.0 - 1
    assert stiffness[2] == "250"
    assert float(stiffness[5]) == pytest.approx(100 * change, rel=0.05)
    assert whole.startswith(short.partition("small_arm: 6 base")[0])
    for words in ("Base parameters\n", "autocorrelation"):
        assert words in whole
        assert words not in short


def test_the_options_of_a_saved_run_are_those_that_were_given(arm: Path, tmp_path: Path) -> None:
    line = "--payload lower:0.01:0,0,-0.1 --estimator huber --known-std payload=0.1 --feasible"
    saved = tmp_path / "first.npz"
    done("identify", *robot_and_drives(arm), arm / "run.csv", *line.split(), "-o", saved)
    options = dict(seaid.project.load_run(saved).provenance["options"])
    own = ("payload", "estimator", "known_std", "feasible")
    assert options.keys() == {"urdf", "drives", "logs", *own}
    assert options["payload"][0]["mass"] == 0.01
    assert (options["estimator"], dict(options["known_std"])) == ("huber", {"payload": 0.1})


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


@pytest.mark.parametrize(
    ("command", "output", "beside"),
    [
        ("describe", "out.toml", "out.toml"),
        ("excite", "out.json", "out.csv"),
        ("export", "out.urdf", "out.toml"),
    ],
)
def test_a_file_that_is_there_is_overwritten_with_force_only(
    arm: Path, tmp_path: Path, command: str, output: str, beside: str
) -> None:
    """The file that a command writes beside its output counts too."""
    (tmp_path / beside).write_text("mine")
    words = {
        "describe": (arm / "run.csv",),
        "excite": (*robot_and_drives(arm), "--starts", "1", "--iterations", "1"),
        "export": (*robot_and_drives(arm), "--from", arm / "run.csv"),
    }
    line = (command, *words[command], "-o", tmp_path / output)
    assert f"'{tmp_path / beside}' is there already: name another" in refused(*line)
    assert [one.read_text() for one in tmp_path.iterdir()] == ["mine"]
    done(*line, "--force")
    assert (tmp_path / beside).read_text() != "mine"


def test_an_error_of_the_robot_comes_before_that_of_the_output(arm: Path, tmp_path: Path) -> None:
    """The output is compared with files that exist; bad drives are the first thing to repair."""
    output, drives = tmp_path / "parameters.json", tmp_path / "drives.toml"
    output.write_text("mine")
    drives.write_text('[elbow]\ntype = "elastic"\n')
    line = ("identify", arm / "arm.urdf", arm / "run.csv", "--drives", drives, "-o", output)
    assert "is there already" not in refused(*line)


@pytest.mark.parametrize("former", [*MOVED, *RENAMED])
def test_a_former_word_names_what_to_write_now(former: str) -> None:
    """What is named instead exists, and the JSON of a former command has the same error."""
    instead = MOVED.get(former) or RENAMED[former]
    words = ["identify", "arm.urdf", f"{former}=x"] if former in RENAMED else [former, "arm.urdf"]
    words = former.split() if " " in former or "completion" in former else words
    name = former if former in RENAMED else f"seaid {former}"
    message = f"'{name}' is no longer there: {instead}"
    said = run(*words)
    assert (said.code, said.out, said.err) == (2, "", f"Error: {message}\n")
    content = json.loads(run(*words, "--json").out)
    assert content["error"] == {"message": message, "exit_code": 2}
    named = re.findall(r"seaid (\w+)[^-]*((?:--?\w+[^-]*)*)", instead)
    for command, *options in named or [("", instead)]:
        commands = [command] if command else [*COMMANDS]
        known = {word for one in commands for x in command_of(one).params for word in x.opts}
        assert {*re.findall(r"(?<!\w)--?[a-z][\w-]*", " ".join(options))} <= known


@pytest.mark.parametrize("command", [*COMMANDS])
def test_the_help_of_a_command_explains_options_and_teaches_by_examples(command: str) -> None:
    help_text = done(command, "-h").out
    assert help_text == done(command, "--help").out
    assert f"seaid {command} [OPTIONS]" in help_text
    assert not re.search(r"<(class|function|object)|_empty|Sentinel", help_text)
    assert " ".join(help_text.split("\n\n")[1].split()) == summary_of(command)
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
    assert done("--version").out == f"seaid {seaid.__version__}\n"


@pytest.mark.slow  # 0.6 s
def test_every_example_is_right_usage() -> None:
    """The commands in helps, in the README and on the page of the view."""
    texts = [done(*command, "--help").out for command in ((), *((name,) for name in COMMANDS))]
    texts += [(ROOT / name).read_text("utf-8") for name in ("README.md", "docs/view.md")]
    whole = [re.sub(r"\s*\\\n\s*", " ", text) for text in texts]
    lines = [line.strip().removeprefix("$ ") for text in whole for line in text.splitlines()]
    examples = [
        line.partition("  ")[0] for line in lines if re.match(r"seaid [a-z]+ [\w/]+\.", line)
    ]
    assert len(examples) > 20
    for example in examples:
        _, name, *arguments = shlex.split(example, comments=True)
        command_of(name).make_context(name, arguments)  # raises for wrong usage


HEAVY = {"numpy", "rich", "seaid.cli.options", "seaid.cli.signature"}


def test_the_help_comes_at_once() -> None:
    code = "import sys; sys.argv = ['seaid', '--help']\nfrom seaid.cli import main\ntry: main()\n"
    code += "except SystemExit: print(*sys.modules)"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    loaded = said.stdout.splitlines()[-1].split()
    assert "seaid.cli.commands" in loaded
    assert not HEAVY & {*loaded}
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < HELP_SECONDS


def test_console_script_is_the_command_line() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, _, name = project["scripts"]["seaid"].partition(":")
    assert getattr(importlib.import_module(module), name) is main


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


def test_export_for_a_simulator_with_ranges(arm: Path, tmp_path: Path) -> None:
    robot, actuators = robot_and_drives(arm), tmp_path / "actuators.py"
    ranges = tmp_path / "ranges.json"
    said = done(
        *("export", *robot, "--from", arm / "run.csv", "--format", "isaaclab", "-o", actuators),
        *("--randomization", ranges, "--samples", "3"),
    )
    assert "not determined by the log, and as wide as the prior: " in said.out
    assert "ACTUATORS = {" in actuators.read_text()
    assert json.loads(ranges.read_text())["format"] == "seaid randomization 1"


TULIP = ROOT / "models" / "tulip_leg.urdf"


def shell(line: str, folder: Path, **environment: str) -> tuple[int, bytes, bytes]:
    """Run a line of bash in which `seaid` is the command line of this tree."""
    command = f"{shlex.quote(sys.executable)} -m seaid"
    done = subprocess.run(
        ["bash", "-c", f'set -o pipefail; seaid() {{ {command} "$@"; }}\n{line}'],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        timeout=60,
    )
    return done.returncode, done.stdout, done.stderr


def test_full_output_is_said_in_one_line(tmp_path: Path) -> None:
    code, _, error = shell("seaid describe --help > /dev/full", tmp_path)
    assert (code, error) == (1, b"Error: cannot write the output: No space left on device\n")


@pytest.mark.slow  # 1.7 s
@pytest.mark.parametrize(
    ("line", "code"),
    quick_first(  # a process each; those after the first load what a command needs
        [
            ("seaid --help | true", 1),
            ("seaid --help >&-", 0),
            ("seaid --version >&- 2>&- <&-", 0),
            ("seaid compare nothing.json 2> /dev/full", 1),
            ("seaid inspect nothing.urdf 2> /dev/full", 1),
            ("seaid inspect nothing.urdf > /dev/full 2>&1", 1),
            ("seaid inspect nothing.urdf 2>&-", 1),
        ],
        4,
    ),
)
def test_streams_that_are_closed_or_lost_end_it_quietly(
    tmp_path: Path, line: str, code: int
) -> None:
    found, out, error = shell(line, tmp_path)
    assert (found, out, error) == (code, b"", b"")


@pytest.mark.slow  # base parameters by a command, and a second one
def test_a_path_that_is_no_text_is_read_and_named(tmp_path: Path) -> None:
    path = os.fsencode(tmp_path) + b"/caf\xe9.urdf"
    Path(os.fsdecode(path)).write_bytes(TULIP.read_bytes())
    line = "seaid inspect $'caf\\xe9.urdf'; seaid inspect $'no\\xe9.urdf' >&2"
    code, out, error = shell(line, tmp_path, PYTHONIOENCODING="utf-8:strict")
    assert out.startswith(b"tulip_leg: ")
    assert error.startswith(b"Error: no URDF file at 'no\\udce9.urdf' (working folder ")
    assert (code, error.count(b"\n")) == (1, 1)


@pytest.mark.slow  # 1.7 s
def test_a_plain_terminal_gets_letters_it_has_not_as_others(tmp_path: Path) -> None:
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "TERM": "dumb"}
    head = "time,höhe_position\n"
    (tmp_path / "é.csv").write_text(head + "".join(f"{n},{n}\n" for n in range(60)))
    code, out, error = shell("seaid describe é.csv", tmp_path, NO_COLOR="1", **plain)
    assert code == 0, error
    assert b"Traceback" not in error
    assert b"\x1b" not in out + error
