"""Saved runs: what is loaded is what was identified, and nothing else is loaded."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid.errors import SeaidError
from seaid.export import content_of
from seaid.identification import Identification, identify, validate
from seaid.identification.validation import compared
from seaid.legged import LeggedValidation, load_robot
from seaid.project import FILE, load_run, save_run
from seaid.project.saved import _checksum, _thinned_validation
from tests import experiments
from tests.measured import LOGS
from tests.one_joint import BODY
from tests.plants import write_robot
from tests.representatives import quick_first

MODELS = experiments.MODELS


@cache
def measured() -> tuple[Identification, seaid.Log]:
    robot = load_robot(MODELS / "hebi_arm_2.urdf", MODELS / "hebi_arm_2.toml")
    log = seaid.read_log(
        LOGS / "hebi_arms/grav_comp_bad.npz", robot, description=LOGS / "hebi_csv_2.toml"
    )
    return identify(robot, log, method="simultaneous", feasible=True), log


@cache
def leg() -> tuple[Identification, seaid.Log]:
    robot = experiments.leg(experiments.TEST_MASS)
    return identify(robot, experiments.leg_log()), experiments.leg_log()


@pytest.mark.parametrize("case", quick_first([measured, leg]))
def test_what_is_loaded_is_what_was_saved(
    case: Callable[[], tuple[Identification, seaid.Log]], tmp_path: Path
) -> None:
    """It predicts and is written as the identification that was saved."""
    found, log = case()
    validation = validate(found, log)
    origin = {"command": ["seaid", "run"], "inputs": []}
    save_run(found, tmp_path / "a.npz", validations={"x.csv": validation}, provenance=origin)
    run = load_run(tmp_path / "a.npz")
    again = run.identification
    assert again.summary() == found.summary()
    assert content_of(again, run.validations["x.csv"]) == content_of(found, validation)
    assert [str(one) for one in again.warnings] == [str(one) for one in found.warnings]
    assert np.array_equal(again.load.covariance, found.load.covariance)
    assert dict(run.provenance) == {"command": ("seaid", "run"), "inputs": ()}
    other = validate(again, log)
    for own, same in ((validation.load, other.load), (validation.actuator, other.actuator)):
        assert np.array_equal(own.computed, same.computed, equal_nan=True)
    files = [
        seaid.write_urdf(x.robot, tmp_path / f"{k}.urdf", force=True).urdf.read_bytes()
        for k, x in enumerate((found, again))
    ]
    assert files[0] == files[1]
    frames = [robot.model.jointPlacements[-1].homogeneous for robot in (found.robot, again.robot)]
    assert np.array_equal(*frames)


@pytest.mark.slow  # 2 s
def test_motions_are_thinned_without_a_change_of_the_fit(tmp_path: Path) -> None:
    """The torques on a base are thinned as those of joints."""
    found, _ = leg()
    save_run(found, tmp_path / "a.npz")
    again = load_run(tmp_path / "a.npz").identification
    (whole,), (thinned,) = found.motions, again.motions
    assert 25 * found.cutoff_hz <= thinned.rate_hz < 0.5 * whole.rate_hz
    before, after = compared(found, whole), compared(again, thinned)
    # the noise below the cutoff stays, up to the samples at which the transients end
    for side in ("actuator", "load"):
        errors = [getattr(one, side).rms_error for one in (before, after)]
        known = np.isfinite(errors[0])
        assert np.allclose(errors[1][known], errors[0][known], rtol=0.08)
    values = {x.name: getattr(before, x.name) for x in fields(before)}
    legged = _thinned_validation(LeggedValidation(**values, base=before.load))
    assert isinstance(legged, LeggedValidation)
    assert legged.base is not None
    assert len(legged.base.measured) == len(legged.time) < len(before.time)
    assert np.array_equal(legged.base.measured, legged.load.measured, equal_nan=True)
    assert legged.base.rms_error is before.load.rms_error
    twice = _thinned_validation(
        replace(
            before,
            motions=(whole, whole),
            time=np.tile(before.time, 2),
            load=replace(before.load, measured=np.tile(before.load.measured, (2, 1))),
        )
    )
    assert len(twice.motions) == 2
    assert len(twice.load.measured) == len(twice.time) == 2 * len(legged.time)


def test_the_axes_and_limits_of_a_robot_stay(tmp_path: Path) -> None:
    joint = 'continuous base a <axis xyz="0.6 -0.8 0"/>'
    robot = load_robot(write_robot(tmp_path / "odd.urdf", {"j": joint}, BODY))
    save_run(replace(measured()[0], robot=robot), tmp_path / "a.npz")
    again = load_run(tmp_path / "a.npz").identification.robot
    axis = again.model.joints[1].extract().axis.tolist()
    assert axis == pytest.approx([0.6, -0.8, 0.0], abs=1e-15)
    assert np.isinf(again.upper_limits[0])
    assert again.urdf == robot.urdf


def test_a_flipped_byte_and_changed_content_are_found(tmp_path: Path) -> None:
    path, arrays, content = saved(tmp_path)
    whole = path.read_bytes()
    for place in range(100, len(whole), len(whole) // 25):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x10]) + whole[place + 1 :])
        with suppress(SeaidError):  # or a byte of a header that nothing reads, as a time
            load_run(path)
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(SeaidError, match="damaged"):
        load_run(path)
    write(path, arrays, content)
    load_run(path)
    name = next(one for one in arrays if arrays[one].dtype == float and arrays[one].size)
    arrays[name] = arrays[name] + 1.0
    np.savez_compressed(path, allow_pickle=False, **arrays)
    with pytest.raises(SeaidError, match="by its checksum"):
        load_run(path)


def test_a_folder_without_a_run(tmp_path: Path) -> None:
    with pytest.raises(SeaidError, match=r"no saved run at .*: name a folder of `seaid run`"):
        load_run(tmp_path)
    with pytest.raises(SeaidError, match=r"must end in \.npz"):
        save_run(measured()[0], tmp_path / "run.json")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"t,q\n0,1\n", "no saved run, which seaid run writes, .*: it is no archive of a run"),
        (b"PK\x03\x04 no archive", "damaged"),
        ({"format": "seaid run 0"}, "has the format 'seaid run 0', not 'seaid run 7'"),
        ({"format": "seaid run 2"}, "damaged"),
        ({"format": "seaid run 7", "run": {"is": "Popen", "fields": {}}}, "damaged"),
    ],
)
def test_a_damaged_file_and_a_foreign_class_are_refused(
    content: bytes | dict[str, object], words: str, tmp_path: Path
) -> None:
    file = tmp_path / FILE
    if isinstance(content, bytes):
        file.write_bytes(content)
    else:
        text = np.frombuffer(json.dumps(content).encode(), dtype=np.uint8)
        np.savez(file, content=text)
    with pytest.raises(SeaidError, match=words):
        load_run(tmp_path)


def test_another_archive_of_numpy_is_no_run(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", q=np.zeros(3))
    with pytest.raises(SeaidError, match=r"is no saved run, .* it is no archive of a run"):
        load_run(tmp_path / "log.npz")


def saved(folder: Path) -> tuple[Path, dict[str, np.ndarray], dict[str, Any]]:
    """Return a saved run, its arrays, and its content."""
    found, log = measured()
    path = folder / "run.npz"
    save_run(found, path, validations={"x.csv": validate(found, log)})
    with np.load(path) as archive:
        arrays = dict(archive)
    return path, arrays, json.loads(arrays["content"].tobytes())


def write(path: Path, arrays: dict[str, Any], content: Any) -> None:
    """Write a run with the checksum of what is in it."""
    arrays = {name: one for name, one in arrays.items() if name != "checksum"}
    arrays["content"] = np.frombuffer(json.dumps(content).encode(), dtype=np.uint8)
    np.savez_compressed(path, checksum=_checksum(arrays), **arrays)


def test_a_small_file_does_not_take_much_memory(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    header = (
        b"\x93NUMPY\x01\x00v\x00"
        + str({"descr": "<f8", "fortran_order": False, "shape": (10**12,)}).encode().ljust(117)
        + b"\n"
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("content.npy", header)
    with pytest.raises(SeaidError, match="damaged: it requests more memory than is available"):
        load_run(path)
    deep = '{"format": ' + "[" * 10**5
    np.savez_compressed(path, content=np.frombuffer(deep.encode(), dtype=np.uint8))
    with pytest.raises(SeaidError, match="damaged"):
        load_run(path)
