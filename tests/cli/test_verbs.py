"""Commands that pass on a function of the library: their results are the library's own."""

from __future__ import annotations

import json
import re
import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from tests.cli.test_cli import arm, done, refused, robot_and_drives, run

__all__ = ["arm"]


def robot_of(arm: Path) -> seaid.Robot:
    return seaid.load_robot(arm / "arm.urdf", arm / "arm.toml")


def log_of(arm: Path, name: str = "run.csv") -> seaid.Log:
    return seaid.read_log(arm / name, robot_of(arm))


def result_of(*arguments: str | Path) -> dict[str, object]:
    content = json.loads(done(*arguments, "--json").out)["result"]
    assert isinstance(content, dict)
    return content


@pytest.mark.slow  # 2.0 s
def test_refine_is_that_of_the_library_and_starts_from_a_run_too(
    arm: Path, runs: tuple[Path, Path], tmp_path: Path
) -> None:
    log, file = log_of(arm), tmp_path / "refined.json"
    said = done("identify", *robot_and_drives(arm), arm / "run.csv", "--refine", "-o", file)
    refined = seaid.refine(seaid.identify(robot_of(arm), log), log)
    assert json.loads(file.read_text())["drives"] == refined.to_dict()["drives"]
    assert "\nDrives\n" in said.out
    assert said.out.splitlines()[-1] == f"Results: {file}"
    done("identify", arm / "run.csv", "--refine", "--run", runs[0], "-o", tmp_path / "again.npz")
    saved = seaid.load_run(tmp_path / "again.npz")
    used = {"iterations": 20, "run": str(runs[0]), "logs": (str(arm / "run.csv"),)}
    assert used.items() <= saved.provenance["options"].items()
    again = saved.identification.to_dict()["drives"]
    for joint, values in json.loads(file.read_text())["drives"].items():
        for name, one in values.items():
            assert again[joint][name]["value"] == pytest.approx(one["value"], rel=1e-9)
    iterations = ("--refine", "--iterations", "0", "-o", tmp_path / "no.json")
    assert "did not converge" in refused(
        "identify", *robot_and_drives(arm), arm / "run.csv", *iterations
    )


def test_delays_are_those_of_the_library_and_are_corrected(arm: Path, tmp_path: Path) -> None:
    log = log_of(arm)
    late = np.array(log.motor_position)
    late[5:, 0] = late[:-5, 0]  # the motor encoder of the shoulder is 5 ms late
    seaid.write_log(replace(log, motor_position=late), tmp_path / "late.csv")
    output = tmp_path / "corrected.csv"
    line = (
        "check",
        *robot_and_drives(arm),
        tmp_path / "late.csv",
        "--delays",
        "--largest-s",
        "0.02",
    )
    found = result_of(*line, "-o", output)["delays"]
    robot = robot_of(arm)
    own = seaid.estimate_delays(robot, seaid.read_log(tmp_path / "late.csv", robot), largest_s=0.02)
    assert isinstance(found, list)
    assert [one["delay_s"] for one in found] == pytest.approx([one.delay_s for one in own])
    assert [one["is_significant"] for one in found] == [one.is_significant for one in own]
    assert found[0]["channel"] == "motor_position"
    assert found[0]["delay_s"] == pytest.approx(0.005, abs=5e-4)
    corrected = seaid.read_log(output, robot)
    place = corrected.time.searchsorted(1.0)
    time = corrected.time[place : place + 500]
    true = np.interp(time, log.time, log.motor_position[:, 0])
    np.testing.assert_allclose(
        corrected.motor_position[place : place + 500, 0], true, atol=0.05 * np.ptp(true)
    )
    assert "is 5" in done(*line).out


def test_check_shows_gear_ratios_and_delays_of_torques(arm: Path) -> None:
    line = ("check", *robot_and_drives(arm), arm / "run.csv", arm / "other.csv")
    joints = result_of(*line)["joints"]
    assert isinstance(joints, dict)
    found, error = joints["elbow"]["gear_ratio"], joints["elbow"]["gear_ratio_error"]
    assert found == pytest.approx(100.0, abs=4 * error)
    text = done(*line).out
    assert f"{found:.4g} +- {error:.2g}" in text
    assert "torque delay [ms]" in text


@pytest.mark.slow  # 0.7 s
def test_cross_validation_is_that_of_the_library(arm: Path) -> None:
    robot, logs = robot_of(arm), [log_of(arm), log_of(arm, "other.csv")]
    options = ("--estimator", "ols", "--cutoff-hz", "6")
    files = (arm / "run.csv", arm / "other.csv")
    found = result_of("validate", "--cross", *robot_and_drives(arm), *files, *options)[
        "validations"
    ]
    own = seaid.cross_validate(robot, logs, estimator="ols", cutoff_hz=6.0)
    assert isinstance(found, list)
    assert [one.pop("log") for one in found] == list(map(str, files))
    assert found == [json.loads(json.dumps(one.to_dict())) for one in own]
    parts = ("--parts", "2", "--cutoff-hz", "12")
    text = done("validate", "--cross", *robot_and_drives(arm), arm / "run.csv", *parts).out
    assert f"part 2 of {arm / 'run.csv'}\n" in text
    assert "--parts must be a whole number of at least 2, found 1" in refused(
        *("validate", "--cross", *robot_and_drives(arm), arm / "run.csv", "--parts", "1")
    )


def test_conditions_are_those_of_the_library(arm: Path, tmp_path: Path) -> None:
    output = tmp_path / "conditions.json"
    both = ("--condition", f"cold={arm / 'run.csv'}", "--condition", f"warm={arm / 'other.csv'}")
    line = ("identify", *robot_and_drives(arm), *both, "--specific", "viscous_friction")
    found = result_of(*line, "-o", output)
    robot = robot_of(arm)
    own = seaid.identify_conditions(
        {"cold": (robot, log_of(arm)), "warm": (robot, log_of(arm, "other.csv"))},
        condition_specific=("viscous_friction",),
    )
    conditions = found["conditions"]
    assert isinstance(conditions, dict)
    for name, one in own.identifications.items():
        assert conditions[name]["drives"] == one.to_dict()["drives"]
    assert json.loads(output.read_text()) == found
    differences = found["differences"]
    assert isinstance(differences, list)
    assert {one["parameter"] for one in differences} == {str(name) for name in own.differences}
    assert "2 conditions: condition-specific parameters" in done(*line).out


@pytest.mark.slow  # simulates the arm with its load, and identifies three pairs of logs
def test_a_condition_has_its_own_payload(arm: Path, tmp_path: Path) -> None:
    load = "lower:0.4:0.1,0,0"
    log, drives = tmp_path / "loaded.csv", robot_and_drives(arm)
    noise = ("--torque-std", "0.001", "--seed", "3")
    done("simulate", *drives, arm / "other_plan.json", *noise, "--payload", load, "-o", log)
    both = ("--condition", f"bare={arm / 'run.csv'}", "--condition", f"loaded={log}")
    line = ("identify", *drives, *both, "--specific", "")
    found = result_of(*line, "--condition-payload", f"loaded={load}")["conditions"]
    payload = seaid.Payload("lower", 0.4, (0.1, 0.0, 0.0))
    loaded = seaid.load_robot(arm / "arm.urdf", arm / "arm.toml", payloads=[payload])
    own = seaid.identify_conditions(
        {"bare": (robot_of(arm), log_of(arm)), "loaded": (loaded, seaid.read_log(log, loaded))},
        condition_specific=(),
    )
    assert isinstance(found, dict)
    for name, one in own.identifications.items():
        assert found[name]["load"] == one.to_dict()["load"]
    # Without the payload the motions contradict each other.
    blind = result_of(*line)["conditions"]
    assert isinstance(blind, dict)
    assert blind["bare"]["load"] != found["bare"]["load"]


@pytest.mark.parametrize(
    ("conditions", "words"),
    [
        (("cold",), "'cold' is not NAME=VALUE, as warm=run.csv"),
        (("=run.csv",), "is not NAME=VALUE"),
        (("cold=run.csv", "cold=other.csv"), "it takes two conditions at least, found cold"),
        (("a=run.csv", "b=other.csv"), "'c' is no condition: they are a, b"),
    ],
)
def test_wrong_conditions(
    arm: Path, monkeypatch: pytest.MonkeyPatch, conditions: tuple[str, ...], words: str
) -> None:
    monkeypatch.chdir(arm)
    options = [part for one in conditions for part in ("--condition", one)]
    options += ["--condition-payload", "c=lower:1"]
    said = run("identify", "arm.urdf", *options)
    assert said.code == 2
    assert words in " ".join(said.err.split())


def test_comparison_of_files_is_that_of_the_identifications(arm: Path, tmp_path: Path) -> None:
    robot = robot_of(arm)
    one, other = (seaid.identify(robot, log_of(arm, name)) for name in ("run.csv", "other.csv"))
    files = tmp_path / "cold.json", tmp_path / "warm.json"
    for found, file in zip((one, other), files, strict=True):
        found.save(file)
    content = result_of("compare", *files)
    own = seaid.report.comparison_of(one, other)
    assert content["names"] == ["cold", "warm"]
    differences = content["differences"]
    assert isinstance(differences, list)
    assert [x["name"] for x in differences] == [x.name for x in own.differences]
    for key in ("first", "second", "first_error", "second_error", "significance"):
        np.testing.assert_allclose(
            [np.nan if x[key] is None else x[key] for x in differences],
            [getattr(x, key) for x in own.differences],
        )
    np.testing.assert_allclose(
        [x["p_value"] for x in differences], [x.p_value for x in own.differences], rtol=1e-4
    )
    assert [x["is_significant"] for x in differences] == [x.is_significant for x in own.differences]
    text = done("compare", *files).out
    assert "cold and warm: value +- standard error" in text
    assert re.search(r"\belbow +stiffness ", text)


def test_what_cannot_be_compared_is_said(arm: Path, tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    found = seaid.identify(robot_of(arm), log_of(arm))
    found.save(file)
    assert "is no file of identified parameters" in refused("compare", arm / "run_plan.json", file)
    other = json.loads(file.read_text())
    other["drives"], other["load"] = {}, []
    (tmp_path / "b.json").write_text(json.dumps(other))
    assert "have no parameter in common" in refused("compare", file, tmp_path / "b.json")
    other["load"] = [{"expression": "m_upper"}]
    (tmp_path / "c.json").write_text(json.dumps(other))
    assert "are not as seaid identify writes them" in refused("compare", file, tmp_path / "c.json")


@pytest.mark.parametrize("suffix", [".py", ".c"])
def test_code_is_that_of_the_library(arm: Path, tmp_path: Path, suffix: str) -> None:
    output, own = tmp_path / f"arm{suffix}", tmp_path / f"own{suffix}"
    content = result_of("export", arm / "arm.urdf", "-o", output)
    form = seaid.symbolic.rigid_body(seaid.load_robot(arm / "arm.urdf"))
    robot = seaid.load_robot(arm / "arm.urdf")
    writer = seaid.symbolic.export_c if suffix == ".c" else seaid.symbolic.export_numpy
    writer(form, own, robot.parameters)
    assert output.read_text() == own.read_text()
    assert content["base_parameters"] == list(form.base.expressions)
    if suffix == ".py":
        module = runpy.run_path(str(output))
        states = np.random.default_rng(5).normal(size=(3, 4, 2))
        torques = module["regressor"](*states) @ robot.parameters
        expected = seaid.regressor.rigid_body_regressor(robot, *states) @ robot.parameters
        np.testing.assert_allclose(np.ravel(torques), np.ravel(expected), atol=1e-12)
        seaid.identify(robot_of(arm), log_of(arm)).save(tmp_path / "found.json")
        known = ("--parameters", tmp_path / "found.json")
        loaded = ("--payload", "lower:2:0.1,0,0", *known)
        done("export", arm / "arm.urdf", *loaded, "-o", tmp_path / "loaded.py")
        found = runpy.run_path(str(tmp_path / "loaded.py"))["inverse_dynamics"](*states)
        robot = seaid.load_robot(
            arm / "arm.urdf", payloads=[seaid.Payload("lower", 2.0, (0.1, 0.0, 0.0))]
        )
        robot = seaid.export.read_parameters(tmp_path / "found.json", robot)
        np.testing.assert_allclose(found, seaid.regressor.joint_torques(robot, *states), atol=1e-9)
    assert (
        "must end in .urdf or .xml or .usda or .py or .c"
        in run("export", arm / "arm.urdf", "-o", "arm.m").err
    )


@pytest.mark.slow  # 0.9 s
def test_encoder_offsets_of_a_simulation(arm: Path, tmp_path: Path) -> None:
    line = ("simulate", *robot_and_drives(arm), arm / "short_plan.json")
    noise = ("--joint-offset", "elbow=0.02", "--motor-offset", "0.3", "--torque-std", "0.001")
    done(*line, *noise, "--seed", "1", "-o", tmp_path / "off.csv")
    robot, plan = robot_of(arm), seaid.load_trajectory(arm / "short_plan.json")
    off = seaid.read_log(tmp_path / "off.csv", robot)
    motors = seaid.Noise(motor_offset_rad=(0.3, 0.3), torque_std_Nm=0.001)
    own = seaid.simulate(robot, plan, noise=motors, seed=1)
    np.testing.assert_allclose(off.motor_position, own.motor_position)
    np.testing.assert_allclose(off.motor_torque, own.motor_torque)
    shift = off.joint_position - own.joint_position
    np.testing.assert_allclose(shift, np.tile([0.0, 0.02], (len(shift), 1)), atol=1e-9)
    assert "--joint-offset: no joint is named 'elbo'; did you mean 'elbow'?" in refused(
        *line, "--joint-offset", "elbo=1", "-o", tmp_path / "no.csv"
    )


@pytest.mark.slow  # 1.1 s
def test_every_limit_of_the_library_is_an_option(arm: Path, tmp_path: Path) -> None:
    from dataclasses import fields

    help_text = done("excite", "--help").out
    for one in fields(seaid.Limits):
        assert f"--{one.name.replace('_', '-')} " in help_text
    search = ("--duration", "2", "--starts", "1", "--iterations", "3", "--seed", "1")
    limits = ("--motor-speed", "elbow=60", "--deflection", "elbow=0.02")
    done("excite", *robot_and_drives(arm), *search, *limits, "-o", tmp_path / "plan.json")
    robot, plan = robot_of(arm), seaid.load_trajectory(tmp_path / "plan.json")
    simulated = seaid.simulate(robot, plan)
    speed = np.gradient(simulated.motor_position[:, 1], simulated.time)
    assert np.max(np.abs(speed)) < 62
    wide = np.gradient(log_of(arm).motor_position[:, 1], log_of(arm).time)
    assert np.max(np.abs(wide)) > 62


def test_gravity_is_an_option_where_the_robot_is(arm: Path) -> None:
    from seaid.cli.commands import COMMANDS, command_of

    for name in COMMANDS:
        options = {option for one in command_of(name).params for option in one.opts}
        assert ("--gravity" in options) == ("urdf" in options), name
    none = result_of("inspect", arm / "arm.urdf", "--gravity", "0,0,0")["base_parameters"]
    some = result_of("inspect", arm / "arm.urdf")["base_parameters"]
    assert none != some


@pytest.fixture(scope="module")
def runs(arm: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return two saved runs."""
    folder = tmp_path_factory.mktemp("runs")
    for name in ("run", "other"):
        log = arm / f"{name}.csv"
        done("identify", *robot_and_drives(arm), log, "-o", folder / f"{name}.npz")
    return folder / "run.npz", folder / "other.npz"


def test_comparison_of_runs_is_that_of_the_library(runs: tuple[Path, Path], tmp_path: Path) -> None:
    page = tmp_path / "comparison.html"
    content = result_of("compare", *runs, "-o", page)
    own = seaid.report.comparison_of(
        *(seaid.load_run(one).identification for one in runs), names=("run", "other")
    )
    assert content["names"] == ["run", "other"]
    differences: Any = content["differences"]
    assert [one["change"] for one in differences] == [one.change for one in own.differences]
    groups = content["groups"]
    assert isinstance(groups, dict)
    assert {name: one["chi_square"] for name, one in groups.items()} == pytest.approx(
        {name: one.chi_square for name, one in own.groups.items()}
    )
    assert content["dependence"] == "independent"
    assert content["d_efficiency"] == pytest.approx(own.efficiency)
    assert "D-efficiency" in page.read_text(encoding="utf-8")
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert "run and other: value +- standard error" in done("compare", *runs).out


def test_runs_and_parameters_are_not_mixed(
    arm: Path, runs: tuple[Path, Path], tmp_path: Path
) -> None:
    file = tmp_path / "a.json"
    done("identify", *robot_and_drives(arm), arm / "run.csv", "-o", file)
    said = run("compare", file, runs[0])
    assert said.code == 2
    assert "give two runs, or two files of parameters" in said.err
    assert "give runs, for a page" in run("compare", file, file, "-o", tmp_path / "a.html").err


@pytest.mark.slow  # two replays of a log by two sets of drives
def test_replay_compares_the_given_drives_with_the_identified_ones(
    arm: Path, tmp_path: Path
) -> None:
    other, own = arm / "other.csv", ("--from", arm / "run.csv")
    page = tmp_path / "replay.html"
    options = ("--nominal", arm / "arm.toml", "-o", page)
    found = result_of("replay", *robot_and_drives(arm), other, *own, *options)
    robot = seaid.load_robot(arm / "arm.urdf", arm / "arm.toml")
    identified = seaid.identify(robot, seaid.read_log(arm / "run.csv", robot))
    moved = seaid.compare_replays(robot, identified.robot, seaid.read_log(other, robot))
    assert found == {"log": str(other), **moved.to_dict()}
    text = page.read_text(encoding="utf-8")
    assert text.count("Replayed position of") == len(robot.joint_names)
    assert 'id="replay"' in text
    assert 'href="#replay"' in text


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
def test_frequency_is_that_of_the_library_and_has_a_figure(
    arm: Path, sines: tuple[Path, Path], tmp_path: Path
) -> None:
    """From the plan to the spring, through simulation with its run-in, stick-slip and encoders."""
    plan, log = sines
    figure = tmp_path / "response.png"
    line = ("frequency", *robot_and_drives(arm), log, "--plan", plan, "--figure", figure)
    (elbow,) = result_of(*line)["drives"].values()  # type: ignore[attr-defined]
    found = {one["name"]: one["value"] for one in elbow}
    assert found["stiffness"] == pytest.approx(250.0, rel=0.03)
    measured = seaid.read_log(log, robot_of(arm))
    own = seaid.frequency_response(
        robot_of(arm), measured, plan=seaid.load_trajectory(plan)
    ).drives["elbow"]
    assert found == pytest.approx(dict(zip(own.names, own.values, strict=True)))
    assert figure.read_bytes()[:4] == b"\x89PNG"
    other = ("--band", "0.6,0.7")
    assert "excited frequencies from 0.6 to 0.7 Hz" in refused(*line[:4], log, *other)
    wrong = run("frequency", *robot_and_drives(arm), log, "--plan", arm / "run_plan.json")
    assert "--plan must be a multisine" in wrong.err


@pytest.mark.slow  # plan, simulation and several fits
def test_a_multisine_in_the_report_and_an_identification_that_it_contradicts(
    arm: Path, sines: tuple[Path, Path], runs: tuple[Path, Path], tmp_path: Path
) -> None:
    plan, log = sines
    page = tmp_path / "page.html"
    done("report", "--run", runs[0], "--multisine", log, "--plan", plan, "-o", page)
    text = page.read_text(encoding="utf-8")
    assert "Size of the frequency response of elbow" in text
    assert "antiresonance" in text
    said = run("report", "--run", runs[0], "--plan", plan, "-o", tmp_path / "no.html")
    assert "a plan needs its --multisine" in said.err
    content = result_of("frequency", *robot_and_drives(arm), log, "--plan", plan, "--run", runs[0])
    assert content["identified"] is not None

    found = seaid.load_run(runs[0]).identification
    drive = found.drive_side["elbow"]
    values = np.array(drive.values)
    values[drive.names.index("stiffness")] *= 1.3
    stiffer = replace(found, drive_side={"elbow": replace(drive, values=values)})
    response = seaid.frequency_response(
        robot_of(arm),
        seaid.read_log(log, robot_of(arm)),
        plan=seaid.load_trajectory(plan),
        identification=stiffer,
    )
    (one,) = [x for x in response.warnings if x.code == "estimator-disagrees"]
    assert (one.joint, one.severity) == ("elbow", "doubtful")
    assert "by its frequency response" in one.message
    with pytest.raises(seaid.SeaidError, match="give a response of the same robot"):
        seaid.write_report(found, page, frequency=replace(response, joints=("knee", "ankle")))
