"""Legged robots on the command line and in a project file."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import seaid
from seaid.cli.kinds import contacts_of
from seaid.log.base_log import moving_base
from tests.cli.small_arm import done, refused
from tests.legged.test_base import STANDING, swayed

FEET = "FL_foot,FR_foot,RL_foot,RR_foot"
GO2 = ("go2", "--base", "floating", "--contact", FEET)


def test_contacts_are_those_of_their_text() -> None:
    texts = [f"{FEET}:radius=0.02", "sole:0.1,0,-0.05:flat", "hand"]
    found = [one for text in texts for one in contacts_of(text)]
    assert [one.link for one in found] == [*FEET.split(","), "sole", "hand"]
    assert found[3].radius_m == 0.02
    assert found[4] == seaid.robot.Contact("sole", (0.1, 0.0, -0.05), is_flat=True)
    assert "give --base 'floating' with them" in refused("inspect", "go2", "--contact", "FL_foot")
    far = ("--stance", FEET, "--posture", "FL_thigh_joint=2.2,FR_thigh_joint=2.2")
    said = refused("excite", *GO2, *far, "-o", "plan.json")
    assert "give a --posture with the weight over the feet" in said


@pytest.mark.slow  # 1.2 s
def test_inspect_shows_what_stances_determine() -> None:
    found = json.loads(done("inspect", *GO2, "--json").out)["result"]["stances"]
    assert [one["base_parameters"] for one in found.values()] == [94, 93, 93, 93, 93, 90]
    assert all(one["agree"] for one in found.values())
    text = done("inspect", *GO2, "--stance", FEET, "--stance", "hanging").out
    assert "together" in text.splitlines()[-2]
    assert " 94 " in text.splitlines()[-2]


@pytest.mark.slow  # simulates and identifies a quadruped
def test_a_saved_run_and_its_report_have_the_floating_base(tmp_path: Path) -> None:
    seaid.write_log(swayed(), tmp_path / "sway.csv")
    run = tmp_path / "go2.npz"
    line = (*GO2, tmp_path / "sway.csv", "--cutoff-hz", "4", "--feasible")
    done("identify", *line, "-o", run)
    found = seaid.project.load_run(run).identification
    assert moving_base(found.robot).contacts == moving_base(STANDING).contacts
    again = seaid.validate(found, swayed())
    assert np.max(again.load.relative_error) < 0.01
    page = tmp_path / "go2.html"
    done("report", "--run", run, "--validate", tmp_path / "sway.csv", "-o", page)
    text = page.read_text(encoding="utf-8")
    assert '<th scope="row">base</th>' in text  # among the links, and forces of the feet
    assert all(f'<th scope="row">{foot}</th>' in text for foot in FEET.split(","))
    done("export", "--run", run, "-o", tmp_path / "go2.xml")
    assert "freejoint" in (tmp_path / "go2.xml").read_text(encoding="utf-8")


@pytest.mark.slow  # simulates and identifies a quadruped
def test_a_log_without_flags_has_contacts_that_are_found(tmp_path: Path) -> None:
    log = swayed()
    assert log.base is not None
    seaid.write_log(replace(log, base=replace(log.base, contacts={})), tmp_path / "sway.csv")
    said = done("init", *GO2, tmp_path / "sway.csv", "--folder", tmp_path)
    assert "no column says when they touch the ground: found from torques" in said.out
    file = tmp_path / "seaid.toml"
    text = file.read_text()
    assert "find_contacts = true" in text
    file.write_text(text.replace('["parameters", "report", "urdf"]', "[]"))
    told = " ".join(done("run", file).err.split())
    for foot in FEET.split(","):
        assert f"{foot}.contact: samples of unclear load, " in told
    assert told.count("found from torques and motion, ") == 4


PROJECT = """
urdf = "go2"
base = "floating"
imu_link = "imu"
contacts = ["FL_foot", { link = "FR_foot", radius_m = 0.02 },
            { link = "RR_foot", position_m = [0, 0, -0.02], is_flat = true }]
"""


def test_a_project_file_has_the_base_and_its_contacts(tmp_path: Path) -> None:
    file = tmp_path / "seaid.toml"
    file.write_text(PROJECT)
    project = seaid.load_project(file)
    base = moving_base(project.robot())
    assert base.contacts == (
        seaid.robot.Contact("FL_foot"),
        seaid.robot.Contact("FR_foot", radius_m=0.02),
        seaid.robot.Contact("RR_foot", (0.0, 0.0, -0.02), is_flat=True),
    )
    assert base.imu_link == "imu"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"FL_foot"', "3", r"contacts\[0\]\]: 'link' must be a text, found 3"),
        ("{ link = ", "{ links = ", "no key is named 'links'; did you mean 'link'"),
        ('link = "RR_foot", ', "", r"contacts\[2\]\]: key 'link' is missing"),
        ("floating", "flying", "no value is named 'flying'"),
    ],
)
def test_messages_of_a_project_file(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "seaid.toml"
    file.write_text(PROJECT.replace(old, new))
    with pytest.raises(seaid.SeaidError, match=message):
        seaid.load_project(file)


@pytest.mark.slow  # a search of a motion in stance
def test_excite_writes_the_motion_of_legs_and_base(tmp_path: Path) -> None:
    posture = ",".join(f"{leg}_{x}" for leg in ("FL", "FR", "RL", "RR") for x in POSTURE)
    line = ("--stance", FEET, "--posture", posture, "--duration", "3", "--starts", "1")
    plan = tmp_path / "plan.json"
    done("excite", *GO2, *line, "--iterations", "3", "--criterion", "d_optimality", "-o", plan)
    assert seaid.load_trajectory(plan).joint_names == STANDING.joint_names
    base = (tmp_path / "plan_base.csv").read_text().splitlines()
    assert base[0].startswith("time_s,base_x.position_m,base_x.velocity_m_s")
    assert len(base) == 3002


POSTURE = ("thigh_joint=0.8", "calf_joint=-1.6")
