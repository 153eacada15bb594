"""Formal mistakes on the line: each error names the place, what is allowed, and the option."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.test_cli import arm, refused, run

__all__ = ["arm"]


@pytest.fixture(scope="module", autouse=True)
def files(arm: Path) -> None:
    """Write the files that the lines below name."""
    (arm / "log.toml").write_text('[joints.elbow]\njoint_position = "q"\n')
    (arm / "empty.urdf").write_text("")
    (arm / "empty.csv").write_text("")
    (arm / "bad.toml").write_text("[elbow\n")


MISTAKES = {
    # a file in a wrong place
    "inspect run.csv": "'run.csv' stands where the URDF belongs, and is a log by its name: the",
    "identify run.csv arm.urdf": "the URDF comes first (or a seaid.toml here names it: seaid init)",
    "inspect arm.toml": "'arm.toml' stands where the URDF belongs, and is TOML by its name: the",
    "identify arm.urdf arm.urdf": "'arm.urdf' stands where a log belongs, and is a robot by its",
    "identify arm.urdf run.csv arm.toml": "then the logs; give drives with --drives",
    "inspect arm.urdf --drives run.csv": "--drives: 'run.csv' is a log by its name: --drives takes",
    "inspect arm.urdf --drives log.toml": "'log.toml' describes a log: give it with --description",
    "inspect arm.urdf --drives arm.urdf": "drives 'arm.urdf' is XML, as a URDF is",
    "check arm.urdf run.csv --description arm.toml": "--description: 'arm.toml' has drives: give",
    "check arm.urdf run.csv ./run.csv": "'run.csv' is given twice, which would count its samples",
    "validate arm.urdf other.csv --from run.csv --from run.csv": "'run.csv' is given twice",
    "identify arm.urdf --condition a=run.csv --condition b=run.csv": "'run.csv' is given twice",
    "validate arm.urdf run.csv --from run.csv": "'run.csv' is used for the identification",
    "report arm.urdf --from run.csv --validate run.csv": "is used for the identification",
    "simulate arm.urdf run.csv": "trajectory 'run.csv' is not JSON",
    "export arm.urdf --parameters run_plan.json -o {}/a.urdf": "no file of identified parameters",
    "inspect empty.urdf": "URDF 'empty.urdf'",
    "check arm.urdf empty.csv": "'empty.csv' is empty; a log starts with a line of column names",
    "check arm.urdf weights.csv": "custom columns need --description (seaid describe infers one)",
    "inspect arm.urdf --drives bad.toml": "drives 'bad.toml' is not valid TOML",
    # names that are not there
    "inspect arm.urdf --joints Elbow": "--joints: 'small_arm': no joint is named 'Elbow'; did you",
    "check arm.urdf run.csv --torque-joints elbo": "--torque-joints: no joint is named 'elbo'; did",
    "check arm.urdf run.csv --terms --of elbo -o {}/a.toml": "--of: no joint is named 'elbo'; did",
    "excite arm.urdf --velocity elbo=1 -o {}/p.json": "--velocity limit: no joint is named 'elbo'",
    "simulate arm.urdf run_plan.json --joint-offset elbo=1 -o {}/a.csv": "--joint-offset: no joint",
    "inspect arm.urdf --payload hand:1": "--payload: no link is named 'hand'",
    "check arm.urdf run.csv --known-body uper": "--known-body: no body is named 'uper'; did you",
    "inspect arm.urdf --sensors eye": "no sensor is named 'eye'",
    "identify arm.urdf --condition a=run.csv --condition b=other.csv --specific viscus": (
        "--specific: no parameter is named 'viscus'; did you mean 'viscous_friction'?"
    ),
    "identify arm.urdf run.csv --known-std torqe=0.1 -o {}/a.json": (
        "--known-std: no constant is named 'torqe'; did you mean 'torque'?"
    ),
    "check arm.urdf run.csv --fail-on bad": "--fail-on: no severity is named 'bad'; allowed: wrong",
    "identify arm.urdf run.csv --method twostep": "--method: no method is named 'twostep'; did you",
    # values out of range
    "inspect arm.urdf --payload lower:-1": "payload on 'lower' must have a mass of more than zero",
    "check arm.urdf run.csv --cutoff-hz -3": "--cutoff-hz must be between 0 and half the sampling",
    "validate arm.urdf run.csv --cross": "record more, or raise --cutoff-hz",
    "validate arm.urdf run.csv --cross --parts 1 --cutoff-hz 9": "--parts must be a whole number",
    "check arm.urdf run.csv --delays --largest-s 1": "--largest-s must be above 0 and below a",
    "identify arm.urdf run.csv --encoder-offset-std -1 -o {}/a.json": "--encoder-offset-std must",
    "identify arm.urdf run.csv --estimator iv --method simultaneous -o {}/a.json": (
        '--estimator "iv" needs --method "two-step"'
    ),
    "excite arm.urdf --duration 0 -o {}/p.json": "--duration must be more than zero seconds",
    "excite arm.urdf --starts 0 -o {}/p.json": "--starts must be at least 1, found 0",
    "excite arm.urdf --seed -1 -o {}/p.json": "--seed must be a whole number, zero or more",
    "excite arm.urdf --velocity -1 -o {}/p.json": "give another by --velocity shoulder=...",
    "excite arm.urdf --motor-speed elbow=-1 --drives arm.toml -o {}/p.json": (
        "give another by --motor-speed elbow=..."
    ),
    "excite arm.urdf --lower 1 --upper -1 -o {}/p.json": (
        "give others by --lower shoulder=..., --upper shoulder=..."
    ),
    "simulate arm.urdf run_plan.json --rate-hz 0 -o {}/a.csv": "--rate-hz must be more than zero",
    # results
    "identify arm.urdf run.csv -o run.csv": "'run.csv' is read by this command: name another file",
    "describe run.csv -o log.toml": "'log.toml' is there already: name another file, or add",
    "describe run.csv -o {}": "is a folder: name a file in it",
}
"""{line: words of its error}; {} is an empty folder."""


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_said_in_one_line_with_its_remedy(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    monkeypatch.chdir(arm)
    before = {one: one.stat().st_mtime_ns for one in arm.iterdir()}
    message = refused(*line.format(tmp_path).split())
    assert MISTAKES[line] in message
    assert "= " not in message.partition("option:")[0].replace(" = ", "")  # no argument of Python
    assert {one: one.stat().st_mtime_ns for one in arm.iterdir()} == before
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["inspect", "check"])
def test_a_name_that_is_too_long_for_a_file_is_refused(command: str) -> None:
    name = 300 * "a"
    for path in (name, f"{name}.urdf"):
        logs = ["run.csv"] if command == "check" else []
        assert "File name too long" in refused(command, path, *logs)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("identfy arm.urdf run.csv", "No such command 'identfy'. Did you mean 'identify'?"),
        ("inspect arm.urdf --drive arm.toml", "No such option: --drive"),
        ("inspect arm.urdf --payload lower=1", "is not link:mass:x,y,z, as foot:2.0:0.15,0,0"),
        ("inspect arm.urdf --gravity 9.81", "'9.81' is not x,y,z, as 0,0,-9.81"),
        ("identify arm.urdf run.csv --known-std 3%", "a list as torque=0.03,payload=0.01"),
        ("identify arm.urdf run.csv --cutoff-hz six", "Invalid value for '--cutoff-hz'"),
        ("excite arm.urdf --velocity fast", "a list as knee=2,hip=1"),
        ("simulate arm.urdf run_plan.json -o a.mat", "'a.mat' must end in .csv or .npz"),
        ("identify arm.urdf --condition run.csv", "'run.csv' is not NAME=VALUE, as warm=run.csv"),
        ("compare a.json", "Invalid value for RUN: it is missing: name it"),
    ],
)
def test_wrong_usage_names_its_option(
    arm: Path, monkeypatch: pytest.MonkeyPatch, line: str, words: str
) -> None:
    monkeypatch.chdir(arm)
    said = run(*line.split())
    assert said.code == 2
    assert words in " ".join(said.err.split())
