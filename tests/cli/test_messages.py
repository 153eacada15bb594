"""Mistakes at the command line: each error names the place, what is allowed, and the option."""

from pathlib import Path

import pytest

from tests.cli.small_arm import refused, run


@pytest.fixture(scope="module", autouse=True)
def files(arm: Path) -> None:
    """Write the files that the lines below name."""
    (arm / "other_language.csv").write_text("время,положение,момент\n0,1,2\n", "utf-8")
    rows = (arm / "run.csv").read_text("utf-8").splitlines()
    still = [rows[0], *(f"0,{row.partition(',')[2]}" for row in rows[1:])]
    (arm / "no_time.csv").write_text("\n".join(still), "utf-8")
    elbow = '[joints.elbow]\njoint_position = "q"\n'
    (arm / "log.toml").write_text(elbow)
    (arm / "twice.toml").write_text(f'{elbow}motor_torque = "q"\n')


MISTAKES = {
    # a file in a wrong place
    "inspect run.csv": "'run.csv' is not a URDF, by its name a log: the robot's URDF comes first",
    "identify arm.urdf arm.urdf": "'arm.urdf': cannot read '.urdf' logs; allowed: .csv",
    "check arm.urdf run.csv ./run.csv": "'run.csv' is given twice, which would count its samples",
    "validate arm.urdf run.csv --from run.csv": "name each log once, and validate on another",
    "check arm.urdf weights.csv": "custom columns need --description (seaid describe infers one)",
    "describe other_language.csv": "name them in their order by --columns, as t,q,tau",
    "init arm.urdf other_language.csv": "seaid describe writes a description of them",
    # names that are not there
    "inspect arm.urdf --joints Elbow": "--joints: 'small_arm': no joint is named 'Elbow'; did you",
    "check arm.urdf run.csv --terms --of elbo -o {}/a.toml": "--of: no joint is named 'elbo'; did",
    "simulate arm.urdf run_plan.json --joint-offset elbo=1 -o {}/a.csv": "--joint-offset: no joint",
    "inspect arm.urdf --payload hand:1": "--payload: no link is named 'hand'",
    "inspect arm.urdf --payload elbow:1": "--payload: 'elbow' is a joint: name a link",
    "inspect arm.urdf --payload lower:-1": "Error: --payload: mass of the payload on 'lower' must",
    "inspect arm.urdf --payload base:1": "Error: --payload: no joint moves 'base'",
    "check arm.urdf run.csv --known-body uper": "no body that a joint moves is named 'uper'",
    "view --run nowhere": "no saved run at 'nowhere'",
    "identify arm.urdf . -o {}/o": "'.'",
    "run": "cannot read the project 'seaid.toml': seaid init URDF LOG writes one",
    "compare run_plan.json log.json": "'run_plan.json' is no saved run",
    # options before any file is read
    "identify arm.urdf no.csv -o run.csv/p.json": "cannot write 'run.csv/p.json': Not a directory",
    # values out of range
    "check arm.urdf run.csv --cutoff-hz -3": "--cutoff-hz must be between 0 and half the sampling",
    "identify arm.urdf run.csv --cutoff-hz -3 -o {}/p.json": "Error: --cutoff-hz must be a number",
    "describe run.csv --rate-hz 0": "Error: --rate-hz must be a number of 0.001 or more, found 0",
    "init arm.urdf run.csv --rate-hz -1 --folder {}": "Error: --rate-hz must be a number of 0.001",
    "check arm.urdf no_time.csv": "as seaid describe writes it with --rate-hz",
    "validate arm.urdf run.csv --cross": "record more, or raise --cutoff-hz",
    "validate arm.urdf run.csv --cross --parts 1 --cutoff-hz 9": "--parts must be a whole number",
    "identify arm.urdf run.csv --estimator iv --method simultaneous -o {}/a.json": (
        '--estimator "iv" needs --method "two-step"'
    ),
    "identify arm.urdf run.csv --known-std torque=3 -o {}/a.json": "Error: --known-std of 'torque'",
    "identify arm.urdf run.csv --known-std payload=0.1 -o {}/a.json": "--known-std has 'payload'",
    "check arm.urdf run.csv --description no.toml": "Error: --description: cannot read the descr",
    "check arm.urdf run.csv --description twice.toml": "--description: 'twice.toml': column 'q' is",
    "excite arm.urdf --seed -1 -o {}/p.json": "--seed must be a whole number of 0 or more",
    "excite arm.urdf --lower 1 --upper -1 -o {}/p.json": (
        "give others by --lower shoulder=..., --upper shoulder=..."
    ),
    # bases that float
    "inspect go2 --base floating --contact FL_fot": "did you mean 'FL_foot'",
    "inspect go2 --base floating --contact FL_foot --stance FL": "no contact is named 'FL'",
    "excite go2 --stance FL_foot -o {}/p.json": "--stance needs a floating base",
    # results
    "identify arm.urdf run.csv -o run.csv": "'run.csv' is read by this command: name another file",
    "describe run.csv -o log.toml": "'log.toml' is there already: name another file, or add",
    "identify arm.urdf run.csv -o -": "'-' is no file: name one",
    "export arm.urdf --from run.csv -o arm.urdf --force": "is read by this command",
    "identify arm.urdf run.csv -o {}": "is a folder: name a file in it",
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


@pytest.mark.parametrize("command", ["check", "identify"])
def test_a_project_in_place_of_a_robot_is_named(tmp_path: Path, command: str) -> None:
    (tmp_path / "seaid.toml").write_text("")
    said = run(command, tmp_path)
    assert said.code == 2
    assert f"'{tmp_path}' is a project: seaid run {tmp_path} identifies it" in said.err


USAGE = {
    "inspect": "URDF: it is missing: name it, or have a seaid.toml here",
    "export arm.urdf": "Missing option '--output' / '-o'",
    "inspect arm.urdf --drive arm.toml": "No such option '--drive'. Did you mean '--drives'",
    # texts that are no value
    "inspect arm.urdf --payload lower": "is not link:mass:x,y,z, as foot:2.0:0.15,0,0",
    "inspect arm.urdf --gravity 9.81": "'9.81' is not x,y,z, as 0,0,-9.81",
    "inspect go2 --base floating --contact FL_foot:0,1": "is not link:x,y,z:flat or",
    "identify arm.urdf run.csv --known-std 3%": "a list as torque=0.03,payload=0.01",
    "identify arm.urdf run.csv --cutoff-hz six": "'--cutoff-hz': 'six' is not a valid float",
    "simulate arm.urdf run_plan.json --seed 1.5": "'1.5' is not a valid integer",
    "excite arm.urdf --velocity fast": "is neither a number nor a list as knee=2,hip=1",
    "excite arm.urdf --rate-hz 0": "is not more than zero",
    # endings of results
    "simulate arm.urdf run_plan.json -o a.mat": "'a.mat' must end in .csv or .npz",
    "export arm.urdf --from run.csv -o a.toml": "must end in .urdf or .xml or .usda or .py or .c",
    # options that do not go together
    "check arm.urdf run.csv --fail-on bad": "'bad' is not one of 'wrong', 'doubtful', 'note'",
    "inspect go2 --base floating --sensors joint_torque": "it is for a base that is held",
    "identify arm.urdf run.csv --in-pieces --repair": "no --repair, no --description",
    "validate arm.urdf run.csv": "--from, --run: give one of the two",
    "export arm.urdf --from run.csv --parameters p -o found.urdf": "give one of them",
    "check arm.urdf run.csv --of elbow": "--of: it needs --terms",
    "check arm.urdf run.csv -o found.toml": "--output: it needs --terms",
    "identify arm.urdf run.csv --refine --feasible": "--feasible: it is no option of",
    "validate arm.urdf run.csv --from other.csv --parts 3": "--parts: it needs --cross",
    "validate arm.urdf run.csv other.csv --from run.csv": "LOG: give one log, or add --cross",
    "validate arm.urdf run.csv --cross --from other.csv": "--from: --cross identifies from",
    # options of another kind of base
    "inspect go2 --stance air": "--stance: it is for a floating base: add --base floating",
}
"""{line: words of what is wrong with its usage}."""


@pytest.mark.parametrize("line", USAGE)
def test_wrong_usage_has_its_own_exit_code(
    arm: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    monkeypatch.chdir(arm)
    said = run(*line.split())
    assert said.code == 2
    assert USAGE[line] in " ".join(said.err.split())
