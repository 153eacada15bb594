"""Targets: what untrusted content enters seaid by, each with the law that holds for what it takes.

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
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import tomli_w
from lxml import etree
from typer.testing import CliRunner

import seaid
from seaid.drivetrain.drive_file import read_drivetrains
from seaid.errors import LogError, RobotError, SeaidError
from seaid.logs.channels import Channel
from seaid.logs.description_file import description_for
from seaid.logs.log_columns import column_names
from seaid.logs.mending import repaired
from seaid.logs.repair import Repairs
from seaid.regression import actuator_regression
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
)

Check = Callable[[], None]
Target = Callable[[Random, Path], Check]
LONGEST_MESSAGE = 4000
"""Characters of an error's text: what a person can still be shown."""


class LawError(Exception):
    """Something was taken that breaks the law of its target."""


def law(holds: bool, text: str) -> None:
    """Raise LawError where a law does not hold."""
    if not holds:
        raise LawError(text)


@dataclass(frozen=True)
class Outcome:
    """How a case ended: accepted, refused, exception or memory; the problem, if there was one."""

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
            return Outcome(
                "exception", LawError("a message too long").with_traceback(problem.__traceback__)
            )
        except MemoryError as problem:
            return Outcome("memory", problem)
        except (Exception, SystemExit) as problem:  # whatever is not ours is what is looked for
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
    if rng.random() < 0.4:
        content = damaged_text(rng, tomli_w.dumps(seeds.DRIVES))
    else:
        content = _toml(rng, damaged_tree(rng, seeds.DRIVES, EXPRESSIONS))
    (folder / "drives.toml").write_bytes(content)

    def check() -> None:
        robot = seaid.load_robot(seeds.ARM_URDF, folder / "drives.toml")
        seaid.write_drivetrains(robot.drivetrains, folder / "again.toml")
        again = read_drivetrains(folder / "again.toml")
        law(all(robot.drivetrains[one] == drive for one, drive in again.items()), "drives differ")
        for joint in robot.elastic_joints:
            with suppress(SeaidError):
                actuator_regression(robot, seeds.motion(), joint)

    return check


def parameters(rng: Random, folder: Path) -> Check:
    """A parameters.json and the export of its robot."""
    (folder / "parameters.json").write_bytes(_json(rng, seeds.parameters_text()))

    def check() -> None:
        robot = seaid.read_parameters(folder / "parameters.json", seeds.robot())
        _export(robot, folder)

    return check


def _export(robot: Robot, folder: Path) -> None:
    """Write a robot as URDF and MJCF; what was written without force must be the same again."""
    law(bool(np.all(np.isfinite(robot.parameters))), "parameters are not finite")
    with suppress(RobotError):
        seaid.write_urdf(robot, folder / "forced" / "robot.urdf", force=True)
        seaid.write_mjcf(robot, folder / "forced" / "robot.xml", force=True)
    written = seaid.write_urdf(robot, folder / "out" / "robot.urdf")
    try:
        again = seaid.load_robot(written.urdf, written.drivetrains, joints=robot.joint_names)
    except SeaidError as problem:
        raise LawError("the written URDF does not load") from problem
    size = float(np.max(np.abs(robot.parameters)))
    same = np.allclose(again.parameters, robot.parameters, rtol=1e-9, atol=1e-9 * size)
    law(same, "parameters of the written URDF differ")
    law(again.drivetrains == robot.drivetrains, "drives of the written URDF differ")
    etree.parse(seaid.write_mjcf(robot, folder / "out" / "robot.xml").path)


# Scenes


def scene(rng: Random, folder: Path) -> Check:
    """A URDF with collision geometry, an SRDF and a box to keep out of."""
    text = seeds.COLLISION_URDF.replace("MESH", "stl")
    (folder / "part.stl").write_bytes(seeds.mesh("stl"))
    (folder / "robot.urdf").write_bytes(damaged_xml(rng, text))
    (folder / "robot.srdf").write_bytes(damaged_xml(rng, seeds.SRDF))
    place, size, turn, name = [1.0, 0.0, 0.0], [0.1, 0.1, 0.1], [0.0, 0.3, 0.0], rng.choice(NAMES)
    box = [*damaged_tree(rng, [place, size, turn]), name][:4]
    pairs = damaged_tree(rng, [["ground", "lower"]])
    return lambda: _scene(
        folder,
        rng.choice((None, folder / "robot.srdf")),
        rng.choice((None, None, box)),
        rng.choice(((), (), pairs)),
    )


def mesh(rng: Random, folder: Path) -> Check:
    """A mesh of a collision geometry."""
    kind = rng.choice(seeds.MESHES)
    content, ending = seeds.mesh(kind), kind.partition("_")[0]
    is_text = content.isascii() and rng.random() < 0.6
    content = damaged_text(rng, content.decode()) if is_text else damaged_bytes(rng, content)
    (folder / f"part.{ending}").write_bytes(content)
    (folder / "robot.urdf").write_text(seeds.COLLISION_URDF.replace("MESH", ending))
    return lambda: _scene(folder, None, None, ())


def _scene(folder: Path, srdf: Path | None, box: Any, pairs: Any) -> None:
    path = folder / "robot.urdf"
    robot = seaid.load_robot(path)
    keep_out = [] if box is None else [seaid.Box(*box)]
    found = seaid.load_scene(path, robot, keep_out=keep_out, disabled_pairs=pairs, srdf=srdf)
    law(len(found.pairs) > 0, "nothing is watched")


# Plans


def trajectory(rng: Random, folder: Path) -> Check:
    """A trajectory file, sampled and written again."""
    text = rng.choice(seeds.trajectory_texts())
    (folder / "plan.json").write_bytes(_json(rng, text))

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


def _columns_for(rng: Random) -> tuple[bool, Columns]:
    """Return whether columns have foreign names, and the columns damaged or not."""
    foreign = rng.random() < 0.5
    good = dict(seeds.foreign_columns() if foreign else seeds.columns())
    return foreign, damaged_columns(rng, good)


def csv_log(rng: Random, folder: Path) -> Check:
    """A CSV file: of damaged columns, or damaged as a text."""
    foreign, columns = _columns_for(rng)
    if rng.random() < 0.5:
        columns = dict(seeds.foreign_columns() if foreign else seeds.columns())
    file, delimiter = io.StringIO(), rng.choice(",,;\t")
    rows = [[str(one) for one in np.ravel(values)[:400]] for values in columns.values()]
    writer = csv.writer(file, delimiter=delimiter, lineterminator="\n", escapechar="\\")
    writer.writerow(columns)
    writer.writerows(zip(*rows, strict=False))
    text = file.getvalue()
    content = damaged_text(rng, text) if rng.random() < 0.6 else encoded(rng, text)
    return _log_check(rng, folder, "log.csv", content)


def npz_log(rng: Random, folder: Path) -> Check:
    """An NPZ file: of damaged columns, with damaged members, or damaged as bytes."""
    _, columns = _columns_for(rng)
    way, file = rng.randrange(3), io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(file, "w") as archive:
        warnings.simplefilter("ignore")  # of a name that is there twice
        for name, values in columns.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asarray(values), allow_pickle=True)
            content = member.getvalue()
            if way == 1 and rng.random() < 0.3:
                content = damaged_bytes(rng, content[:128]) + content[128:]
            packing = rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))
            short = name.encode("utf-8", "replace").decode()[:60_000]
            archive.writestr(zipfile.ZipInfo(f"{short}.npy"), content, packing)
    content = file.getvalue()
    return _log_check(rng, folder, "log.npz", damaged_bytes(rng, content) if way == 2 else content)


def json_log(rng: Random, folder: Path) -> Check:
    """A JSON file: of damaged columns, as records or lists, or damaged as a tree or text."""
    _, columns = _columns_for(rng)
    lists = {name: np.atleast_1d(values)[:60].tolist() for name, values in columns.items()}
    tree: Any = lists
    if rng.random() < 0.5:
        rows = zip(*lists.values(), strict=False)
        tree = {"kp": 3, "entries": [dict(zip(lists, row, strict=True)) for row in rows]}
    if rng.random() < 0.5:
        tree = damaged_tree(rng, tree)
    text = json.dumps(tree, default=str)
    content = damaged_text(rng, text) if rng.random() < 0.5 else encoded(rng, text)
    return _log_check(rng, folder, "log.json", content)


def hdf5_log(rng: Random, folder: Path) -> Check:
    """An HDF5 file: of damaged columns, or damaged as bytes."""
    _, columns = _columns_for(rng)
    options = rng.choice(({}, {}, {"chunks": True}, {"chunks": True, "compression": "gzip"}))
    file = io.BytesIO()
    with h5py.File(file, "w") as archive:
        for name, values in columns.items():
            values = np.asarray(values)
            values = values.astype("S") if values.dtype.kind in "UOMm" else values
            with suppress(ValueError, TypeError):  # names and shapes that HDF5 cannot have
                archive.create_dataset(name, data=values, **(options if values.size else {}))
    content = file.getvalue()
    content = damaged_bytes(rng, content) if rng.random() < 0.7 else content
    return _log_check(rng, folder, rng.choice(("log.h5", "log.hdf5")), content)


def parquet_log(rng: Random, folder: Path) -> Check:
    """A Parquet file: of damaged columns, or damaged as bytes."""
    _, columns = _columns_for(rng)
    count = min(np.asarray(values).size for values in columns.values())
    found = {}
    for name, values in columns.items():
        with suppress(arrow.ArrowException, TypeError, ValueError):  # kinds that it cannot have
            key = name.encode("utf-8", "replace").decode()
            found[key] = arrow.array(np.ravel(np.asarray(values))[:count])
    file = io.BytesIO()
    parquet.write_table(
        arrow.table(found), file, compression=rng.choice(("none", "snappy", "zstd"))
    )
    content = file.getvalue()
    content = damaged_bytes(rng, content) if rng.random() < 0.7 else content
    return _log_check(rng, folder, "log.parquet", content)


def bag_log(rng: Random, folder: Path) -> Check:
    """A ROS bag of any kind: one of its files damaged, or one entry of its data base."""
    files = rng.choice(seeds.bags())
    target = rng.choice(sorted(files))
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
        if name != target:
            continue
        if name.endswith(".yaml"):
            path.write_bytes(damaged_text(rng, content.decode()))
        elif name.endswith(".db3") and rng.random() < 0.6:
            _damage_entry(rng, path)
        else:
            path.write_bytes(damaged_bytes(rng, content))
    storage = next(name for name in sorted(files) if not name.endswith(".yaml"))
    path = rng.choice((folder / storage, (folder / storage).parent))
    return lambda: _read_every_way(path, seeds.small_robot("shoulder", "elbow"), None)


def _damage_entry(rng: Random, path: Path) -> None:
    connection = sqlite3.connect(path)
    with connection:
        if rng.random() < 0.5:
            column = rng.choice(("name", "type", "serialization_format", "offered_qos_profiles"))
            value = rng.choice((*NAMES, "std_msgs/msg/String")).encode("utf-8", "replace").decode()
            connection.execute(f"UPDATE topics SET {column} = ?", (value,))
        else:
            (data,) = connection.execute("SELECT data FROM messages WHERE id = 7").fetchone()
            rows = rng.choice(("id = 7", "id > 5", "id = 1", "1"))
            connection.execute(
                f"UPDATE messages SET data = ? WHERE {rows}", (damaged_bytes(rng, data),)
            )
    connection.close()


def hebi_log(rng: Random, folder: Path) -> Check:
    """A HEBI log damaged as bytes."""
    path = folder / "log.hebilog"
    path.write_bytes(damaged_bytes(rng, seeds.hebi_log()))
    return lambda: _read_every_way(path, seeds.small_robot("shoulder"), None)


def description(rng: Random, folder: Path) -> Check:
    """A log description beside a log that it fits."""
    if rng.random() < 0.4:
        content = damaged_text(rng, tomli_w.dumps(seeds.DESCRIPTION))
    else:
        content = _toml(rng, damaged_tree(rng, seeds.DESCRIPTION))
    (folder / "log.toml").write_bytes(content)
    np.savez(folder / "log.npz", **seeds.foreign_columns())  # type: ignore[arg-type]

    def check() -> None:
        path = folder / "log.npz"
        _check_log(seaid.read_log(path, seeds.robot(), description=folder / "log.toml"))
        _check_description(description_for(path, folder / "log.toml"), folder)

    return check


def _log_check(rng: Random, folder: Path, name: str, content: bytes) -> Check:
    path = folder / name
    path.write_bytes(content)
    described = rng.choice((None, seeds.DESCRIPTION))
    return lambda: _read_every_way(path, seeds.robot(), described)


def _read_every_way(path: Path, robot: Robot, description: Any) -> None:
    """Read a log in all ways there are; raise the last refusal where none takes it."""

    def as_described() -> None:
        guess = seaid.describe_log(path, robot)
        _check_description(guess.description, path.parent)
        _check_log(seaid.read_log(path, robot, description=guess.description))

    def in_pieces() -> None:
        long_log = seaid.open_long_log(path, robot, chunk_samples=150)
        for part in long_log.parts():
            _check_log(part.log)

    ways: list[Check] = [
        lambda: _check_log(seaid.read_log(path, robot, description=description)),
        lambda: _check_log(seaid.read_log(path, robot, repair=Repairs())),
        lambda: seaid.describe_log(path) and None,
        as_described,
        in_pieces,
    ]
    refusals = []
    for way in ways:
        try:
            way()
        except SeaidError as problem:
            refusals.append(problem)
            if len(str(problem)) > LONGEST_MESSAGE:
                raise
    if len(refusals) == len(ways):
        raise refusals[-1]


def _check_log(log: seaid.Log) -> None:
    law(bool(np.all(np.diff(log.time) > 0)), "time does not grow")
    law(all(bool(np.all(np.isfinite(one))) for one in log.columns().values()), "not finite")


def _check_description(found: Any, folder: Path) -> None:
    """Check that a description says the same when it is read again."""
    if found is None:
        return
    (folder / "again.toml").write_text(found.to_toml(), encoding="utf-8")
    again = description_for(folder / "x.csv", folder / "again.toml")
    law(again is not None and again.to_dict() == found.to_dict(), "description reads otherwise")


# Identification


def identify(rng: Random, folder: Path) -> Check:
    """A damaged log in memory, identified with any options and exported."""
    robot = seeds.robot()
    columns = {"time_s": seeds.log().time, **seeds.log().columns()}
    columns = damaged_samples(rng, columns)
    mended = rng.random() < 0.3
    options: dict[str, Any] = {"feasible": rng.random() < 0.3}
    options["sides"] = rng.choice(("sequential", "sequential", "joint"))
    ways = ("ols", "wls", "huber", "tukey", *(("iv",) if options["sides"] == "sequential" else ()))
    options["estimator"] = rng.choice(ways)
    if rng.random() < 0.3:
        odd = {
            "cutoff_hz": (5.0, 40.0, 1e-3, 1e9, 124.9, float("nan"), -1.0),
            "joint_zero_std": (1e-3, 1e200, float("nan"), -1.0),
            "rows": (("wrist",), ("telescope", "rail"), (), ("rail", "rail"), ("θ",)),
            "estimator": ("", "IV"),
        }
        key = rng.choice(list(odd))
        options[key] = rng.choice(odd[key])

    def check() -> None:
        log = _log_of(robot, columns, mended)
        found = seaid.identify(robot.without_nominal(), log, **options)
        for one in (found.load, *found.drivetrains.values()):
            law(bool(np.all(np.isfinite(one.values))), "estimates are not finite")
            law(not np.any(one.standard_errors < 0), "a standard error is negative")
        found.summary()
        found.save(folder / "parameters.json")
        again = seaid.read_parameters(folder / "parameters.json", robot)
        law(np.array_equal(again.parameters, found.robot.parameters), "parameters read otherwise")
        with suppress(RobotError):  # bodies as estimated need not be possible
            _export(found.robot, folder)

    return check


def _log_of(robot: Robot, columns: Columns, mended: bool) -> seaid.Log:
    report: Any = ()
    time = columns.pop("time_s")
    if mended:
        channels = [Channel(name, time, values) for name, values in columns.items()]
        time, columns, report = repaired(channels)
    fields: dict[str, Any] = {
        field: np.full((len(time), robot.n), np.nan)
        for field in ("motor_position", "joint_position", "motor_torque")
    }
    for index, joint in enumerate(robot.joint_names):
        for name, field in column_names(joint, robot.is_prismatic[index]).items():
            if name in columns:
                fields[field][:, index] = columns[name]
    return seaid.Log(
        time, robot.joint_names, is_prismatic=robot.is_prismatic, report=report, **fields
    )


# Command line


def command(rng: Random, folder: Path) -> Check:
    """A command line with other words in it."""
    files = {
        "arm.urdf": seeds.ARM_URDF.read_bytes(),
        "arm.toml": seeds.ARM_DRIVES.read_bytes(),
        "parameters.json": seeds.parameters_text().encode(),
        "plan.json": seeds.trajectory_texts()[0].encode(),
        "run.npz": seeds.log_file("run.npz"),
        "other.npz": seeds.log_file("other.npz"),
    }
    for name, content in files.items():
        (folder / name).write_bytes(content)
    words = rng.choice(_COMMANDS).split()
    odd = [
        "",
        "/dev/null",
        "/dev/full",
        "/",
        ".",
        "no/such",
        "\udcff.npz",
        "--json",
        "--force",
        "-o",
    ]
    pool = [*files, *odd, *NAMES[:-1], *NUMBERS, "rail=1", "wrist=nan", "tool:1:0,0,0", "tool:-1:x"]
    for _ in range(rng.randint(0, 3)):
        place = rng.randrange(len(words) + 1)
        words[place : place + rng.choice((0, 1, 1))] = rng.choice(([rng.choice(pool)], []))
    arguments = [str(folder / word) if word in files or word in _NEW else word for word in words]

    def check() -> None:
        said = CliRunner().invoke(seeds.app(), arguments)
        if said.exception is not None and not isinstance(said.exception, SystemExit):
            raise said.exception
        law(said.exit_code in (0, 1, 2), f"exit code {said.exit_code}")
        lines = said.stderr.splitlines()
        if said.exit_code == 1:
            law(lines[-1:] != [] and lines[-1].startswith("error: "), "no line that says why")
        if said.exit_code:
            raise LogError(lines[-1] if lines else "wrong usage")

    return check


_NEW = ("new.json", "new.urdf", "new.xml", "new.toml", "new.npz", "new.html")
_COMMANDS = (
    "inspect arm.urdf --drives arm.toml",
    "inspect arm.urdf --joints rail,wrist --sensors motor_position,motor_torque --json",
    "crosscheck arm.urdf --drives arm.toml",
    "describe run.npz --urdf arm.urdf -o new.toml",
    "identify arm.urdf run.npz --drives arm.toml --payload tool:1.0:0,0,0.1 -o new.json",
    "identify arm.urdf run.npz --drives arm.toml --sides joint --estimator wls --repair -o new.json",
    "validate arm.urdf other.npz --from run.npz --drives arm.toml -o new.json",
    "export arm.urdf --parameters parameters.json --drives arm.toml -o new.urdf",
    "export arm.urdf --from run.npz --drives arm.toml --cutoff-hz 8 -o new.xml",
    "report arm.urdf --from run.npz --validate other.npz --drives arm.toml -o new.html",
)


def _toml(rng: Random, tree: Any) -> bytes:
    """Return a tree as TOML, which has no null."""

    def plain(one: Any) -> Any:
        if isinstance(one, dict):
            return {str(key): plain(value) for key, value in one.items()}
        return (
            [plain(each) for each in one] if isinstance(one, list) else "" if one is None else one
        )

    return encoded(rng, tomli_w.dumps(plain(tree if isinstance(tree, dict) else {"a": tree})))


def _json(rng: Random, text: str) -> bytes:
    if rng.random() < 0.4:
        return damaged_text(rng, text)
    return encoded(rng, json.dumps(damaged_tree(rng, json.loads(text), EXPRESSIONS)))


TARGETS: dict[str, Target] = {
    "urdf": urdf,
    "drives": drives,
    "description": description,
    "parameters": parameters,
    "trajectory": trajectory,
    "scene": scene,
    "mesh": mesh,
    "csv": csv_log,
    "npz": npz_log,
    "json": json_log,
    "hdf5": hdf5_log,
    "parquet": parquet_log,
    "bag": bag_log,
    "hebilog": hebi_log,
    "identify": identify,
    "command": command,
}
