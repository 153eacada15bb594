"""The scripts as a user runs them: files, figures of the issue, one-line errors."""

import json
import os
import runpy
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import seaid

ROOT = Path(__file__).parents[2]
TULIP_FILES = (
    "excitation.csv",
    "identification_log.csv",
    "validation_log.csv",
    "parameters.json",
    "actuator_side.png",
    "load_side.png",
    "report.html",
    "tulip_leg_identified.urdf",
    "tulip_leg_identified.toml",
)


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a script of the project in a fresh interpreter, on one thread."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="session")
def tulip(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The main job, run once: about 20 s, since it is what the project is for."""
    output = tmp_path_factory.mktemp("tulip")
    done = run("scripts/identify_tulip_leg.py", "--output", str(output))
    assert done.returncode == 0, done.stderr
    return output, done.stdout


@pytest.mark.slow
def test_main_job_writes_every_file(tulip: tuple[Path, str]) -> None:
    """Its figures are claims."""
    output, text = tulip
    assert sorted(path.name for path in output.iterdir()) == sorted(TULIP_FILES)
    assert text.rstrip().endswith(f"Results: {output}/")
    assert "? weak-spring: stiffness of ankle_pitch is poorly identified" in text
    assert "21 base parameters are identifiable, from all five 29" in text
    assert len(json.loads((output / "parameters.json").read_text())["load"]) == 29


@pytest.mark.slow
def test_project_of_the_leg_gives_the_result_of_the_main_job(
    tulip: tuple[Path, str], tmp_path: Path
) -> None:
    text = (ROOT / "models/tulip_leg_project.toml").read_text()
    text = text.replace("../out/tulip_leg/runs", str(tmp_path / "runs"))
    text = text.replace("../out/tulip_leg", str(tulip[0]))
    text = text.replace('"tulip_leg.', f'"{ROOT}/models/tulip_leg.')
    (tmp_path / "seaid.toml").write_text(text)
    done = seaid.run_project(seaid.load_project(tmp_path))
    assert done.notes == ()
    drives = json.loads((tulip[0] / "parameters.json").read_text())["drives"]
    for joint, estimate in done.runs[""].identification.drives.items():
        values = {name: entry["value"] for name, entry in drives[joint].items()}
        assert dict(zip(estimate.names, estimate.values, strict=True)) == pytest.approx(values)


SCRIPTS = ROOT / "scripts"
SHORT_FORMS = {
    "benchmarks/bias.py": ("--quick --pairs 1",),
    "benchmarks/command_delays.py": ("--quick 1",),
    "benchmarks/commanded_arms.py": ("--quick 2 1",),
    "benchmarks/contact_backlash.py": ("--quick --motions 1",),
    "benchmarks/cutoff.py": ("--quick --draws 1",),
    "benchmarks/excitation_measures.py": ("--choices 2",),
    "benchmarks/excitation_peer.py": ("",),
    "benchmarks/excitation_value.py": ("--quick --draws 1",),
    "benchmarks/false_terms.py": ("--quick --logs 1 --motions 1",),
    "benchmarks/feasible.py": ("--quick", "--programs 5 --output OUT"),
    "benchmarks/frequency.py": ("--quick --draws 1 --leg 1",),
    "benchmarks/frequency_coverage.py": ("--quick --draws 1",),
    "benchmarks/halves.py": ("--quick", "--quick --json"),
    "benchmarks/humanoid_time.py": ("1",),
    "benchmarks/hysteresis.py": (
        "--quick --draws 1 --motions 1",
        "--quick --draws 1 --motions 1 --selection",
    ),
    "benchmarks/inferred_ratio.py": ("--quick --motions 1 --noises 1",),
    "benchmarks/installed_size.py": ("",),
    "benchmarks/interval_coverage.py": ("--quick --experiments 1 --duration 2",),
    "benchmarks/short_logs.py": ("--quick --experiments 1",),
    "benchmarks/journey.py": ("--quick --repeats 1",),
    "benchmarks/legged.py": ("--quick 1 1",),
    "benchmarks/legged_findings.py": ("--help", "1 'feet slip'"),
    "benchmarks/legged_logs.py": ("--quick hips",),
    "benchmarks/limits_kept.py": ("--cases 1",),
    "benchmarks/log_headers.py": ("",),
    "benchmarks/long_log.py": ("--quick 2000",),
    "benchmarks/motor_side.py": ("--quick 1", "--quick --coverage 1 0", "--quick --lacking 1 0"),
    "benchmarks/peer_least_squares.py": ("",),
    "benchmarks/randomization_coverage.py": ("--robots 1",),
    "benchmarks/refined_terms.py": ("--quick 1 cubic",),
    "benchmarks/sensitivity.py": ("--quick --draws 1",),
    "benchmarks/speed_held.py": ("--quick --against HEAD",),
    "benchmarks/static_calibration.py": ("--draws 10",),
    "benchmarks/temperature.py": ("--quick --draws 1", "--quick --draws 1 --warm-up"),
    "benchmarks/term_selection.py": ("--quick --draws 1", "--quick --draws 1 --findings"),
    "benchmarks/two_step_or_simultaneous.py": ("--quick --runs 1", "--quick --runs 1 --mistakes"),
    "benchmarks/unseen_plants.py": ("--quick --seeds 1",),
    "coverage.py": ("--quick --experiments 1 --others 1 --jobs 1 --output OUT",),
    "cross_check.py": ("--only kinova --output OUT",),
    "design_excitation.py": (
        "ROOT/tests/data/mixed_arm.urdf ROOT/tests/data/mixed_arm.toml --ends-in-motion "
        "--duration 4 --starts 1 --iterations 3 --output OUT",
    ),
    "design_table.py": ("--quick --draws 1 --only rate",),
    "gallery.py": ("excitation --output OUT",),
    "gauntlet.py": ("--quick --only 'tilted by 20' --workers 1 --output OUT",),
    "identifiability.py": ("ROOT/models/tulip_leg.urdf ROOT/models/tulip_leg.toml",),
    "identify_biped.py": ("--duration 2 --output OUT",),
    "identify_philips_arm.py": ("--quick --output OUT",),
    "look.py": ("--quick --output OUT",),
    "mutants.py": ("--count 1 --only estimation/par --tests test_parameters --output OUT",),
    "real_data.py": ("--data OUT/none --output OUT", "--named"),
    "ship_measured_logs.py": ("--originals OUT/none",),
    "so101.py": ("--logs OUT/none",),
}
"""Arguments of the short forms of scripts; OUT is the folder of the test, ROOT the project.

All others, but for those in RUN_ELSEWHERE, have the short form `--quick`.
"""
RUN_ELSEWHERE = {
    "claims.py": "tests/repository/test_claims.py",
    "fuzz.py": "tests/repository/test_scripts.py",
    "golden.py": "tests/repository/test_golden.py",
    "identify_tulip_leg.py": "tests/repository/test_scripts.py",
    "notebook.py": "tests/repository/test_documents.py",
    "pages.py": "tests/repository/test_documents.py",
    "architecture.py": "tests/repository/test_documents.py",
    "warnings_page.py": "tests/repository/test_documents.py",
}
"""Scripts that other tests run."""


FILES = {
    path.relative_to(SCRIPTS).as_posix()
    for path in SCRIPTS.rglob("*.py")
    if "\nif __name__ == " in path.read_text(encoding="utf-8")
}
FORMS = [
    (file, form)
    for file in sorted(FILES - RUN_ELSEWHERE.keys())
    for form in SHORT_FORMS.get(file, ("--quick",))
]


def test_every_script_has_a_short_form() -> None:
    """Or another test runs it; whether it has `--quick` shows the run."""
    assert SHORT_FORMS.keys() | RUN_ELSEWHERE.keys() <= FILES
    assert not SHORT_FORMS.keys() & RUN_ELSEWHERE.keys()
    for file, test in RUN_ELSEWHERE.items():
        assert file.removesuffix(".py") in (ROOT / test).read_text(encoding="utf-8")


@pytest.mark.slow  # 3 s: a process and its worker, which takes the types of the script from it
def test_fuzzer_runs_two_cases(tmp_path: Path) -> None:
    cases = ("--target", "urdf", "--cases", "2", "--workers", "1", "--output", str(tmp_path))
    done = run("scripts/fuzz.py", *cases)
    assert done.returncode == 0, done.stderr
    assert "2 cases in " in done.stdout


@pytest.mark.slow  # every script
@pytest.mark.filterwarnings("ignore::seaid.SeaidWarning")
@pytest.mark.parametrize(("file", "arguments"), FORMS)
def test_script_runs_in_its_short_form(
    file: str, arguments: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = arguments.replace("OUT", str(tmp_path)).replace("ROOT", str(ROOT))
    words = shlex.split(places)
    monkeypatch.setattr(sys, "argv", [file, *words])
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.chdir(tmp_path)  # results without a stated folder
    code: object = None
    try:
        runpy.run_path(str(SCRIPTS / file), run_name="__main__")
    except SystemExit as end:
        code = end.code
    assert not code


def test_bench_compares_with_an_earlier_commit_that_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The one of a day ago once needed a package that was no longer installed."""
    from scripts.benchmarks import speed_held

    monkeypatch.setattr(speed_held, "ROOT", tmp_path)
    (tmp_path / "seaid").mkdir()
    (tmp_path / "seaid/__init__.py").touch()
    speed_held.git("init", "--quiet")
    hour, now = 3600, 1_700_000_000
    for age, line in ((48, "import no_such_package"), (10, "print()"), (1, "print(1)"), (0, "")):
        (tmp_path / "seaid/__main__.py").write_text(line)
        for name in ("AUTHOR", "COMMITTER"):
            monkeypatch.setenv(f"GIT_{name}_DATE", f"{now - age * hour} +0000")
            monkeypatch.setenv(f"GIT_{name}_NAME", "a")
            monkeypatch.setenv(f"GIT_{name}_EMAIL", "a@b")
        speed_held.git("add", ".")
        speed_held.git("commit", "--quiet", "-m", str(age))
    commit = speed_held.earlier_commit()
    assert speed_held.git("show", "--no-patch", "--format=%s", commit) == "10"
    assert "No module named 'no_such_package'" in capsys.readouterr().out
    monkeypatch.setattr(speed_held, "refusal", lambda _: "no reason")
    with pytest.raises(SystemExit, match="no earlier commit starts"):
        speed_held.earlier_commit()


def test_a_long_row_that_is_refused_prints_why() -> None:
    from scripts.benchmarks.fast import LongRow, measured_once

    words = ["-c", "import sys; sys.exit('Error: 300 joints are too many\\nand more')"]
    text = measured_once(LongRow("refused", None, None, lambda _: words))
    assert text.endswith(": Error: 300 joints are too many")


def test_claims_that_are_ratios_to_a_peer_are_measured_again() -> None:
    """Without a ratio in them `--claims` would hold nothing."""
    from scripts.benchmarks.speed_held import claimed

    assert claimed().keys() >= {"regressor", "samples", "planning"}
