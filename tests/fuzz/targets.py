"""Targets: where untrusted content enters seaid, each with the law that holds for what it takes.

A target is a function of a random generator and an empty folder. It writes a damaged case into the
folder and returns what is to be done with it, which ends well, in a SeaidError, or is a finding.
"""

from __future__ import annotations

import csv
import io
import json
import sqlite3
import tomllib
import warnings
import zipfile
from collections.abc import Callable
from contextlib import chdir, closing, suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import tomli_w
from click.testing import CliRunner
from lxml import etree
from scipy.io import savemat

import seaid
from seaid.cli.commands import app
from seaid.drives import read_drives
from seaid.errors import RobotError, SeaidError
from seaid.log import Repairs
from seaid.log.description import description_for
from seaid.log.long_log import iterate_log
from seaid.regressor import actuator_regression
from seaid.robot import Robot
from tests.fuzz import seeds
from tests.fuzz.mutators import (
    EXPRESSIONS,
    NAMES,
    NUMBERS,
    Columns,
    damaged_bytes,
    damaged_columns,
    damaged_samples,
    damaged_text,
    damaged_tree,
    damaged_xml,
    encoded,
    words,
)

Check = Callable[[], None]
Target = Callable[[Random, Path], Check]
LONGEST_MESSAGE = 4000
"""Characters of an error's text: what a person can still be shown."""


class LawError(Exception):
    """Something was taken, or said, that breaks a law."""


def law(holds: bool, text: str) -> None:
    """Raise LawError where a law does not hold."""
    if not holds:
        raise LawError(text)


@dataclass(frozen=True)
class Outcome:
    """How a case ended, "accepted", "refused", "exception" or "memory", and by which exception."""

    kind: str
    problem: BaseException | None = None


def run_case(name: str, seed: int, folder: Path) -> Outcome:
    """Build the case of a target and seed in an empty folder, and run it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check = TARGETS[name](Random(f"{name} {seed}"), folder)
        try:
            check()
            law(not list(folder.rglob("pwned")), "a text of the user was run")
        except SeaidError as problem:
            if len(str(problem)) <= LONGEST_MESSAGE:
                return Outcome("refused", problem)
            long = LawError("a message too long").with_traceback(problem.__traceback__)
            return Outcome("exception", long)
        except MemoryError as problem:
            return Outcome("memory", problem)
        except (Exception, SystemExit) as problem:  # all that is not ours is what is looked for
            return Outcome("exception", problem)
    return Outcome("accepted")


# Robots


def urdf(rng: Random, folder: Path) -> Check:
    """A URDF, its base parameters, its export and that read again."""
    source = rng.choice(seeds.URDFS)
    (folder / "robot.urdf").write_bytes(damaged_xml(rng, source.read_text()))
    drives = rng.choice((None, source.with_suffix(".toml")))

    def check() -> None:
        robot = seaid.load_robot(folder / "robot.urdf", drives)
        seaid.base_parameters(robot)
        _export(robot, folder)

    return check


def drives(rng: Random, folder: Path) -> Check:
    """A drive TOML, written again, and the regressor of its drives."""
    (folder / "drives.toml").write_bytes(_toml(rng, seeds.DRIVES))

    def check() -> None:
        robot = seaid.load_robot(seeds.ARM_URDF, folder / "drives.toml")
        seaid.write_drives(robot.drives, folder / "again.toml")
        again = read_drives(folder / "again.toml")
        law(all(robot.drives[one] == drive for one, drive in again.items()), "drives differ")
        for joint in robot.elastic_joints:
            with suppress(SeaidError):
                actuator_regression(robot, seeds.motion(), joint)

    return check


def parameters(rng: Random, folder: Path) -> Check:
    """A parameters.json and the export of its robot."""
    path = folder / "parameters.json"
    path.write_bytes(_json(rng, seeds.parameters_text()))
    return lambda: _export(seaid.read_parameters(path, seeds.robot()), folder)


def saved_run(rng: Random, folder: Path) -> Check:
    """A saved run, damaged as bytes or in its content, or whole and written anew."""
    whole = seeds.saved_run()
    if rng.random() < 0.4:
        (folder / "run.npz").write_bytes(damaged_bytes(rng, whole))
    else:
        with np.load(io.BytesIO(whole)) as archive:
            arrays = {name: archive[name] for name in archive.files}
        if rng.random() < 0.7:
            content = damaged_tree(rng, json.loads(arrays["content"].tobytes()))
            text = json.dumps(content, default=str).encode("utf-8", "replace")
            arrays["content"] = np.frombuffer(text, np.uint8)
        (folder / "run.npz").write_bytes(_npz(rng, arrays, 0.0))

    def check() -> None:
        run = seaid.project.load_run(folder / "run.npz")
        run.identification.summary()
        [one.summary() for one in run.validations.values()]

    return check


def _export(robot: Robot, folder: Path) -> None:
    """Write a robot as URDF and MJCF; what was written without force must be the same again."""
    law(bool(np.all(np.isfinite(robot.parameters))), "parameters are not finite")
    with suppress(RobotError):
        seaid.write_urdf(robot, folder / "forced" / "robot.urdf", force=True)
        seaid.write_mjcf(robot, folder / "forced" / "robot.xml", force=True)
    written = seaid.write_urdf(robot, folder / "out" / "robot.urdf")
    try:
        again = seaid.load_robot(written.urdf, written.drives, joints=robot.joint_names)
    except SeaidError as problem:
        raise LawError("the written URDF does not load") from problem
    size = float(np.max(np.abs(robot.parameters)))
    same = np.allclose(again.parameters, robot.parameters, rtol=1e-9, atol=1e-9 * size)
    law(same, "parameters of the written URDF differ")
    law(again.drives == robot.drives, "drives of the written URDF differ")
    etree.parse(seaid.write_mjcf(robot, folder / "out" / "robot.xml").path)


# Scenes and plans


def scene(rng: Random, folder: Path) -> Check:
    """A URDF with collision geometry, and a box to keep out of."""
    shape = rng.choice(('<cylinder radius="0.1" length="0.2"/>',) * 9 + (seeds.MESH.format("stl"),))
    (folder / "part.stl").write_bytes(seeds.mesh("stl"))
    (folder / "robot.urdf").write_bytes(damaged_xml(rng, seeds.TWO_URDF.replace("SHAPE", shape)))
    place, size, turn = [1.0, 0.0, 0.0], [0.1, 0.1, 0.1], [0.0, 0.3, 0.0]
    box = [*damaged_tree(rng, [place, size, turn]), rng.choice(NAMES)][:4]
    pairs = damaged_tree(rng, [["ground", "lower"]])
    boxes: Any = rng.choice(((), (), [box]))
    disabled = rng.choice(((), (), pairs))
    return lambda: _scene(folder, boxes, disabled_pairs=disabled)


def mesh(rng: Random, folder: Path) -> Check:
    """A mesh of a collision geometry."""
    kind = rng.choice(seeds.MESHES)
    content, ending = seeds.mesh(kind), kind.partition("_")[0]
    is_text = content.isascii() and rng.random() < 0.6
    content = damaged_text(rng, content.decode()) if is_text else damaged_bytes(rng, content)
    (folder / f"part.{ending}").write_bytes(content)
    text = seeds.TWO_URDF.replace("SHAPE", seeds.MESH.format(ending))
    (folder / "robot.urdf").write_text(text)
    return lambda: _scene(folder, [])


def _scene(folder: Path, boxes: Any, **options: Any) -> None:
    path = folder / "robot.urdf"
    robot = seaid.load_robot(path)
    found = seaid.excitation.load_scene(
        path, robot, keep_out=[seaid.excitation.Box(*one) for one in boxes], **options
    )
    law(len(found.pairs) > 0, "nothing is watched")


def trajectory(rng: Random, folder: Path) -> Check:
    """A trajectory file, sampled and written again."""
    (folder / "plan.json").write_bytes(_json(rng, rng.choice(seeds.trajectory_texts())))

    def check() -> None:
        plan = seaid.load_trajectory(folder / "plan.json")
        states = plan.sample(np.linspace(*plan.main_interval, 50))
        law(all(bool(np.all(np.isfinite(one))) for one in states), "states are not finite")
        plan.save(folder / "again.json")
        again = seaid.load_trajectory(folder / "again.json")
        law(np.array_equal(again.coefficients, plan.coefficients), "the saved plan differs")
        plan.save_joint_trajectory(folder / "plan.yaml", 20.0)
        plan.save_set_points(folder / "plan.csv", 20.0)

    return check


# Logs


def description(rng: Random, folder: Path) -> Check:
    """A log description beside a log that it fits."""
    (folder / "log.toml").write_bytes(_toml(rng, seeds.DESCRIPTION))
    (folder / "log.npz").write_bytes(_npz(rng, seeds.foreign_columns(), 0.0))

    def check() -> None:
        path = folder / "log.npz"
        _check_log(seaid.read_log(path, seeds.robot(), description=folder / "log.toml"))
        _check_description(description_for(path, folder / "log.toml"), folder)

    return check


def csv_log(rng: Random, folder: Path) -> Check:
    """A CSV file."""
    columns = _columns(rng)
    file, delimiter = io.StringIO(), rng.choice(",,;\t")
    writer = csv.writer(file, delimiter=delimiter, lineterminator="\n", escapechar="\\")
    writer.writerow(columns)
    writer.writerows(zip(*(np.ravel(values)[:400] for values in columns.values()), strict=False))
    change = rng.choice((damaged_text, encoded))
    return _log_check(rng, folder / "log.csv", change(rng, file.getvalue()))


def npz_log(rng: Random, folder: Path) -> Check:
    """An NPZ file: with damaged members, or damaged as bytes."""
    content = _npz(rng, _columns(rng), rng.choice((0.0, 0.0, 0.3)))
    return _log_check(rng, folder / "log.npz", _maybe_damaged(rng, content, 0.3))


def mat_log(rng: Random, folder: Path) -> Check:
    """A MATLAB file."""
    file, tree = io.BytesIO(), dict[str, Any]()
    for name, values in _columns(rng).items():
        joint, _, field = name.rpartition(".")
        if np.asarray(values).dtype.kind in "biuf" and name.replace(".", "_").isidentifier():
            place = tree.setdefault(joint, {}) if joint else tree
            if isinstance(place, dict):
                place[field] = values
    savemat(file, tree, do_compression=rng.random() < 0.5, long_field_names=True)
    content = b"MATLAB 5.0 MAT-file".ljust(116) + file.getvalue()[116:]  # without the date
    return _log_check(rng, folder / "log.mat", _maybe_damaged(rng, content, 0.5))


def json_log(rng: Random, folder: Path) -> Check:
    """A JSON file, as records or lists: damaged as a tree or as a text."""
    lists = {name: np.atleast_1d(values)[:60].tolist() for name, values in _columns(rng).items()}
    rows = [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=False)]
    tree: Any = rng.choice((lists, {"kp": 3, "entries": rows}))
    tree = damaged_tree(rng, tree) if rng.random() < 0.5 else tree
    change = rng.choice((damaged_text, encoded))
    return _log_check(rng, folder / "log.json", change(rng, json.dumps(tree, default=str)))


def hdf5_log(rng: Random, folder: Path) -> Check:
    """An HDF5 file."""
    file, packed = io.BytesIO(), rng.choice(({}, {"chunks": True, "compression": "gzip"}))
    with h5py.File(file, "w") as archive:
        for name, values in _columns(rng).items():
            values = np.asarray(values)
            values = values.astype("S") if values.dtype.kind in "UOMm" else values
            with suppress(ValueError, TypeError):  # names and shapes that HDF5 cannot have
                archive.create_dataset(name, data=values, **(packed if values.size else {}))
    content = _maybe_damaged(rng, file.getvalue(), 0.7)
    return _log_check(rng, folder / "log.h5", content)


def parquet_log(rng: Random, folder: Path) -> Check:
    """A Parquet file."""
    columns, found, file = _columns(rng), {}, io.BytesIO()
    count = min(np.asarray(values).size for values in columns.values())
    for name, values in columns.items():
        with suppress(arrow.ArrowException, TypeError, ValueError):  # kinds that it cannot have
            found[_utf8(name)] = arrow.array(np.ravel(np.asarray(values))[:count])
    packing = rng.choice(("none", "snappy", "zstd"))
    parquet.write_table(arrow.table(found), file, compression=packing)
    content = _maybe_damaged(rng, file.getvalue(), 0.7)
    return _log_check(rng, folder / "log.parquet", content)


def bag_log(rng: Random, folder: Path) -> Check:
    """A ROS bag of any kind: one of its files damaged, or one entry of its data base."""
    files = rng.choice(seeds.bags())
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    name = rng.choice(list(files))
    if name.endswith(".yaml"):
        (folder / name).write_bytes(damaged_text(rng, files[name].decode()))
    elif name.endswith(".db3") and rng.random() < 0.6:
        _damage_entry(rng, folder / name)
    else:
        (folder / name).write_bytes(damaged_bytes(rng, files[name]))
    storage = next(folder / one for one in files if not one.endswith(".yaml"))
    path = rng.choice((storage, storage.parent))
    return lambda: _read_as_described(path, seeds.small_robot("shoulder", "elbow"))


def _damage_entry(rng: Random, path: Path) -> None:
    with closing(sqlite3.connect(path)) as connection, connection:
        if rng.random() < 0.5:
            column = rng.choice(("name", "type", "serialization_format", "offered_qos_profiles"))
            value = _utf8(rng.choice((*NAMES, "std_msgs/msg/String")))
            connection.execute(f"UPDATE topics SET {column} = ?", (value,))
        else:
            (data,) = connection.execute("SELECT data FROM messages WHERE id = 7").fetchone()
            rows = rng.choice(("id = 7", "id > 5", "id = 1", "1"))
            new = damaged_bytes(rng, data)
            connection.execute(f"UPDATE messages SET data = ? WHERE {rows}", (new,))


def hebi_log(rng: Random, folder: Path) -> Check:
    """A HEBI log."""
    path = folder / "log.hebilog"
    path.write_bytes(damaged_bytes(rng, seeds.hebi_log()))
    return lambda: _read_as_described(path, seeds.small_robot("shoulder"))


def _columns(rng: Random) -> Columns:
    """Return columns with our names or others, three of four times damaged."""
    columns: Columns = dict(rng.choice((seeds.columns, seeds.foreign_columns))())
    return damaged_columns(rng, columns) if rng.random() < 0.75 else columns


def _npz(rng: Random, columns: Columns, share: float) -> bytes:
    """Return columns as NPZ, a share of the arrays with damaged headers."""
    file = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(file, "w") as archive:
        warnings.simplefilter("ignore")  # of a name that is there twice
        for name, values in columns.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asarray(values), allow_pickle=True)
            content = member.getvalue()
            if rng.random() < share:
                content = damaged_bytes(rng, content[:128]) + content[128:]
            packing = rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))
            entry = zipfile.ZipInfo(f"{_utf8(name)[:60_000]}.npy")
            archive.writestr(entry, content, packing)
    return file.getvalue()


def _maybe_damaged(rng: Random, content: bytes, share: float) -> bytes:
    return damaged_bytes(rng, content) if rng.random() < share else content


def _utf8(name: str) -> str:
    return name.encode("utf-8", "replace").decode()


def _log_check(rng: Random, path: Path, content: bytes) -> Check:
    path.write_bytes(content)
    described = rng.choice((None, tomllib.loads(seeds.DESCRIPTION)))
    return lambda: _read_every_way(path, seeds.robot(), described)


def _read_every_way(path: Path, robot: Robot, description: Any) -> None:
    """Read a log in all ways there are; raise the last refusal where none takes it."""

    def in_pieces() -> None:
        log = seaid.open_long_log(path, robot, chunk_samples=150)
        for part, *_ in iterate_log(path, robot, log.chunk_samples, log.overlap_samples):
            _check_log(part)

    refusals = []
    ways: list[Callable[[], object]] = [
        lambda: _check_log(seaid.read_log(path, robot, description=description)),
        lambda: _check_log(seaid.read_log(path, robot, repair=Repairs())),
        lambda: seaid.describe_log(path),
        lambda: _read_as_described(path, robot),
        in_pieces,
    ]
    for way in ways:
        try:
            way()
        except SeaidError as problem:
            refusals.append(problem)
            if len(str(problem)) > LONGEST_MESSAGE:
                raise
    if len(refusals) == len(ways):
        raise refusals[-1]


def _read_as_described(path: Path, robot: Robot) -> None:
    """Read a log by the description that is guessed for it."""
    guess = seaid.describe_log(path, robot)
    _check_description(guess.description, path.parent)
    _check_log(seaid.read_log(path, robot, description=guess.description))


def _check_log(log: seaid.Log) -> None:
    law(bool(np.all(np.diff(log.time) > 0)), "time does not grow")
    law(all(bool(np.all(np.isfinite(one))) for one in log.columns().values()), "not finite")


def _check_description(found: Any, folder: Path) -> None:
    """Check that a description says the same when it is read again."""
    (folder / "again.toml").write_text(found.to_toml(), encoding="utf-8")
    again = description_for(folder / "x.csv", folder / "again.toml")
    law(again is not None and again.to_dict() == found.to_dict(), "description reads otherwise")


# Identification and command line


def identify(rng: Random, folder: Path) -> Check:
    """A damaged log in memory, repaired or not, identified with any options and exported."""
    robot, repair = seeds.robot(), Repairs() if rng.random() < 0.3 else None
    columns = damaged_samples(rng, {"time_s": seeds.log().time, **seeds.log().columns()})
    options: dict[str, Any] = {"feasible": rng.random() < 0.3}
    options["method"] = rng.choice(("two-step", "two-step", "simultaneous"))
    ways = ("ols", "wls", "huber", "tukey", *(("iv",) if options["method"] == "two-step" else ()))
    options["estimator"] = rng.choice(ways)
    odd = {
        "cutoff_hz": (5.0, 40.0, 1e-3, 1e9, 124.9, float("nan"), -1.0),
        "encoder_offset_std": (1e-3, 1e200, float("nan"), -1.0),
        "torque_joints": (("wrist",), ("telescope", "rail"), (), ("rail", "rail"), ("θ",)),
        "estimator": ("", "IV"),
    }
    key = rng.choice(list(odd))
    options |= {key: rng.choice(odd[key])} if rng.random() < 0.3 else {}

    def check() -> None:
        log = seaid.read_log(columns, robot, repair=repair)
        found = seaid.identify(robot.without_nominal(), log, **options)
        for one in (found.load, *found.drives.values()):
            law(bool(np.all(np.isfinite(one.values))), "estimates are not finite")
            law(not np.any(one.standard_errors < 0), "a standard error is negative")
        found.summary()
        seaid.write_parameters(found, folder / "parameters.json")
        again = seaid.read_parameters(folder / "parameters.json", robot)
        law(np.array_equal(again.parameters, found.robot.parameters), "parameters read otherwise")
        with suppress(RobotError):  # bodies as estimated need not be possible
            _export(found.robot, folder)

    return check


_NEW = ("new.json", "new.urdf", "new.xml", "new.toml", "new.npz", "new.html")
_COMMANDS = (seeds.TEXTS / "commands.txt").read_text("utf-8").splitlines()
_ODD = (
    *words("/ . no/such --json --force -o rail=1 wrist=nan tool:1:0,0,0"),
    *("", "\udcff.npz", *(name for name in NAMES if not name.startswith("/")), *NUMBERS),
)
"""Words for a command line; no place outside of the case's folder, since --force is one of them."""


def command(rng: Random, folder: Path) -> Check:
    """A command line with other words in it."""
    files = {
        "arm.urdf": seeds.ARM_URDF.read_bytes(),
        "arm.toml": seeds.ARM_DRIVES.read_bytes(),
        "parameters.json": seeds.parameters_text().encode(),
        "run.npz": seeds.log_file("run.npz"),
        "other.npz": seeds.log_file("other.npz"),
    }
    for name, content in files.items():
        (folder / name).write_bytes(content)
    asked = rng.choice(_COMMANDS).split()
    for _ in range(rng.randint(0, 3)):
        place = rng.randrange(len(asked) + 1)
        asked[place : place + rng.choice((0, 1, 1))] = rng.choice(([rng.choice(_ODD)], []))
    paths = {name: str(folder / name) for name in (*files, *_NEW)}
    here = folder / "a" / "b"
    here.mkdir(parents=True)

    def check() -> None:
        with chdir(here):  # names without a folder, and those with "../..", stay in the case's
            said = CliRunner().invoke(app, [paths.get(word, word) for word in asked])
        if said.exception is not None and not isinstance(said.exception, SystemExit):
            raise said.exception
        law(said.exit_code in (0, 1, 2), f"exit code {said.exit_code}")
        last = (said.stderr.splitlines() or [""])[-1]
        law(said.exit_code != 1 or last.startswith("Error: "), "no line that says why")
        if said.exit_code:
            raise SeaidError(last)

    return check


def _toml(rng: Random, text: str) -> bytes:
    """Return a text in TOML damaged, as a text or as a tree; TOML has no null."""
    if rng.random() < 0.4:
        return damaged_text(rng, text)

    def plain(one: Any) -> Any:
        if isinstance(one, dict):
            return {str(key): plain(value) for key, value in one.items()}
        if isinstance(one, list):
            return [plain(each) for each in one]
        return "" if one is None else one

    return encoded(rng, tomli_w.dumps(plain(damaged_tree(rng, tomllib.loads(text), EXPRESSIONS))))


def _json(rng: Random, text: str) -> bytes:
    """Return a text in JSON damaged, as a text or as a tree."""
    if rng.random() < 0.4:
        return damaged_text(rng, text)
    return encoded(rng, json.dumps(damaged_tree(rng, json.loads(text), EXPRESSIONS)))


_NAMED: tuple[Any, ...] = (urdf, drives, description, parameters, trajectory, scene, mesh)
_NAMED += (csv_log, npz_log, mat_log, json_log, hdf5_log, parquet_log, bag_log, identify, command)
TARGETS: dict[str, Target] = {target.__name__.removesuffix("_log"): target for target in _NAMED}
TARGETS |= {"run": saved_run, "hebilog": hebi_log}
