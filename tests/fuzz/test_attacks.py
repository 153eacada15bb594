"""Attacks made by hand: what no mutator finds. Each is refused in our words, at once and whole."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest

import seaid
from seaid.drives.toml import read_drives
from seaid.errors import SeaidError
from seaid.log.readers.opening import READERS as OF_LOGS
from tests.fuzz import seeds
from tests.representatives import quick_first

Use = Callable[[Path], Any]
MEMORY_BYTES = 2 * 10**9
SECONDS = 10.0
ENDINGS = tuple(OF_LOGS)


class TookTooLong(BaseException):
    """Not one of the exceptions that a reader may take for a fault of the file."""


def read_as(ending: str) -> Use:
    """Return a function that reads a path, whatever its name, as a log of an ending."""
    return lambda path: seaid.read_log(path.with_name(path.name + ending), seeds.robot())


READERS: dict[str, Use] = {
    "urdf": seaid.load_robot,
    "drives": read_drives,
    "scene": lambda path: seaid.load_scene(path, seeds.robot()),
    "srdf": lambda path: seaid.load_scene(seeds.ARM_URDF, seeds.robot(), srdf=path),
    "parameters": lambda path: seaid.read_parameters(path, seeds.robot()),
    "trajectory": seaid.load_trajectory,
    "description": lambda path: seaid.read_log("/dev/null", seeds.robot(), description=path),
    **{ending: read_as(ending) for ending in ENDINGS},
}


@contextmanager
def limits(kind: int, value: int) -> Iterator[None]:
    """Set a limit of the process for a while."""
    before = resource.getrlimit(kind)
    resource.setrlimit(kind, (value, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(kind, before)


@contextmanager
def limited() -> Iterator[None]:
    """Let nothing take 2 GB more than now, or more than ten seconds."""

    def too_long(*_: object) -> None:
        raise TookTooLong(f"more than {SECONDS} s")

    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    signal.signal(signal.SIGALRM, too_long)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        with limits(resource.RLIMIT_AS, in_use + MEMORY_BYTES):
            yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def refused(use: Callable[[], Any]) -> str:
    """Return the words of a refusal, which comes within the limits."""
    with limited(), pytest.raises(SeaidError) as caught:
        use()
    assert len(str(caught.value)) < 10_000
    return str(caught.value)


# Paths that are no files


PLACES: dict[str, Use] = {
    "nothing": lambda path: None,
    "folder": Path.mkdir,
    "fifo": os.mkfifo,
    "endless": lambda path: path.symlink_to("/dev/zero"),
    "loop": lambda path: path.symlink_to(path),
    "dangling": lambda path: path.symlink_to(path.with_name("nowhere")),
    "empty": Path.touch,
    "zeros": lambda path: path.write_bytes(bytes(5000)),
}


IN_CHILDREN = {*product((".db3", ".mcap", ".mat", ".mtx"), ("empty", "zeros"))}
IN_CHILDREN |= {(ending, "folder") for ending in ENDINGS if ending != ".bag"}
"""Files and folders that a process of their own reads; those of .bag are of that kind too."""


@pytest.mark.parametrize(
    ("reader", "place"),
    [
        pytest.param(*pair, marks=pytest.mark.slow if pair in IN_CHILDREN else ())
        for pair in product(READERS, PLACES)
        if pair != ("drives", "empty")  # an empty TOML says that all drives are ideal
    ],
)
def test_what_is_no_file_is_refused(tmp_path: Path, reader: str, place: str) -> None:
    path = tmp_path / "x"
    PLACES[place](path.with_name(f"x{reader}") if reader in ENDINGS else path)
    refused(lambda: READERS[reader](path))


@pytest.mark.parametrize("name", ["a\0b", "x" * 300, "\udcff", "x/" * 3000 + "x"])
@pytest.mark.parametrize("reader", READERS)
def test_names_that_no_file_has_are_refused(tmp_path: Path, reader: str, name: str) -> None:
    refused(lambda: READERS[reader](tmp_path / name))


# Bombs: small files that say they are large, and large ones


def bomb_entities(path: Path) -> None:
    lines = ['<!ENTITY a0 "ha">']
    lines += [f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 12)]
    path.write_text(
        f'<!DOCTYPE robot [{"".join(lines)}]><robot name="&a11;"><link name="b"/></robot>'
    )


def bomb_external(path: Path) -> None:
    text = '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
    path.write_text(text + '<robot name="r"><link name="&x;">&x;</link></robot>')


def bomb_depth(path: Path) -> None:
    path.write_text('<robot name="r">' + "<link>" * 200_000 + "</link>" * 200_000 + "</robot>")


def bomb_joints(path: Path) -> None:
    inside = (
        f'<link name="l{i}"/><joint name="j{i}" type="fixed"><parent link="l{i}"/>'
        f'<child link="l{i + 1}"/></joint>'
        for i in range(300_000)
    )
    path.write_text(f'<robot name="r">{"".join(inside)}<link name="l300000"/></robot>')


XML_BOMBS = (bomb_entities, bomb_external, bomb_depth, bomb_joints)


@pytest.mark.parametrize("bomb", quick_first(XML_BOMBS, 3), ids=lambda one: one.__name__)
@pytest.mark.parametrize("reader", ["urdf", "srdf"])
def test_xml_bombs_are_refused(tmp_path: Path, bomb: Callable[[Path], None], reader: str) -> None:
    bomb(tmp_path / "x")
    said = refused(lambda: READERS[reader](tmp_path / "x"))
    assert "root:" not in said


@pytest.mark.parametrize("text", ["[" * 10**6, '{"a":' * 10**5, "1" * 10**6, '"' + "a" * 10**7])
@pytest.mark.parametrize("reader", ["drives", "parameters", "trajectory", "description", ".json"])
def test_deep_and_endless_texts_are_refused(tmp_path: Path, reader: str, text: str) -> None:
    path = tmp_path / "x"
    path.write_text(text)
    path.with_name("x.json").write_text(text)
    path.with_name("y").write_text(f"a = {text}")
    for one in (path, path.with_name("y")):
        if reader != ".json" or one == path:
            refused(lambda one=one: READERS[reader](one))  # type: ignore[misc]


def bomb_npz(path: Path) -> None:
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (%d,), }"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in seeds.columns():
            text = (header % 500_000_000).ljust(117) + "\n"
            content = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()
            archive.writestr(f"{name}.npy", content + bytes(1_000_000))


def bomb_npz_header(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name in seeds.columns():
            text = "(" * 5000 + "\n"
            content = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()
            archive.writestr(f"{name}.npy", content)


def bomb_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name in seeds.columns():  # never written: no room in the file
            file.create_dataset(name, shape=(10**9,), dtype="f8", chunks=(10**6,))


def bomb_hdf5_outside(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name in seeds.columns():
            file.create_dataset(name, shape=(300,), dtype="u1", external=[("/etc/passwd", 0, 300)])


def bomb_parquet(path: Path) -> None:
    one = arrow.array(np.zeros(10**6))
    table = arrow.table(dict.fromkeys(seeds.columns(), one))
    with parquet.ParquetWriter(path, table.schema, compression="zstd") as writer:
        for _ in range(12):
            writer.write_table(table)


LOG_BOMBS: dict[str, tuple[str, Use]] = {
    "npz": (".npz", bomb_npz),
    "npz_header": (".npz", bomb_npz_header),
    "hdf5": (".h5", bomb_hdf5),
    "hdf5_outside": (".h5", bomb_hdf5_outside),
    "parquet": (".parquet", bomb_parquet),
}


@pytest.mark.slow  # 1.4 s
@pytest.mark.parametrize(
    "bomb",
    # the file of the last is as large as it says: twelve million rows
    [pytest.param(one, marks=pytest.mark.slow if one == "parquet" else ()) for one in LOG_BOMBS],
)
def test_log_bombs_are_refused(tmp_path: Path, bomb: str) -> None:
    ending, make = LOG_BOMBS[bomb]
    path = tmp_path / f"log{ending}"
    make(path)
    robot = seeds.robot()
    for use in (
        lambda: seaid.read_log(path, robot),
        lambda: seaid.describe_log(path, robot),
        lambda: seaid.open_long_log(path, robot),
    ):
        refused(use)


# Faults of the disk, and ends at any moment


@pytest.fixture(scope="module")
def writers() -> dict[str, Use]:
    """Return whatever writes a file, by the ending of that."""
    log, robot = seeds.log(), seeds.robot()
    found = seaid.identify(robot, log)
    return {
        **{e: lambda path: seaid.write_log(log, path) for e in (".csv", ".npz", ".parquet", ".h5")},
        ".json": lambda path: seaid.write_parameters(found, path),
        ".urdf": lambda path: seaid.write_urdf(robot, path),
        ".xml": lambda path: seaid.write_mjcf(robot, path),
        ".usda": lambda path: seaid.write_model(robot, path),
        ".toml": lambda path: seaid.write_drives(robot.drives, path),
        ".html": lambda path: seaid.write_report(found, path),
    }


WRITTEN = (".csv", ".npz", ".parquet", ".h5", ".json", ".urdf", ".xml", ".usda", ".toml", ".html")


@pytest.mark.parametrize("ending", WRITTEN)
def test_a_full_disk_leaves_the_old_file(
    tmp_path: Path, writers: dict[str, Use], ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # it would be cut off too
    path = tmp_path / f"out{ending}"
    path.write_text("old")
    with limits(resource.RLIMIT_FSIZE, 100):
        refused(lambda: writers[ending](path))
    assert [one.name for one in tmp_path.iterdir()] == [path.name]
    assert path.read_text() == "old"


@pytest.mark.parametrize("ending", WRITTEN)
def test_targets_that_are_no_place_are_refused(
    tmp_path: Path, writers: dict[str, Use], ending: str
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / f"folder{ending}").mkdir()
    (tmp_path / f"loop{ending}").symlink_to(tmp_path / f"loop{ending}")
    (tmp_path / f"full{ending}").symlink_to("/dev/full")
    names = ("file/x", "folder", "loop", "full", "a\0b", "x" * 300)
    for name in names if ending != ".html" else names[-1:]:  # whose page takes a second
        refused(lambda name=name: writers[ending](tmp_path / f"{name}{ending}"))  # type: ignore[misc]


WRITE_FOR_EVER = """
import sys
from pathlib import Path
import numpy as np
import seaid
folder, robot = Path(sys.argv[1]), seaid.load_robot(sys.argv[2], sys.argv[3])
samples = np.random.default_rng(0).normal(size=(3000, 4))
log = seaid.Log(np.arange(3000) / 100, robot.joint_names, *[samples] * 3)
print("ready", flush=True)
while True:
    for name in ("out.csv", "out.npz", "out.parquet", "out.h5"):
        seaid.write_log(log, folder / name)
    seaid.write_urdf(robot, folder / "out.urdf")
    seaid.write_mjcf(robot, folder / "out.xml")
"""


@pytest.mark.slow  # three processes that import seaid and write
def test_a_killed_process_leaves_whole_files(tmp_path: Path) -> None:
    whole: dict[str, int] = {}
    arguments = [str(tmp_path), str(seeds.ARM_URDF), str(seeds.ARM_DRIVES)]
    for delay_s in (0.4, 0.03, 0.15):
        process = subprocess.Popen(
            [sys.executable, "-c", WRITE_FOR_EVER, *arguments], stdout=subprocess.PIPE
        )
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        time.sleep(delay_s)
        process.kill()
        process.communicate()
        for path in tmp_path.glob("out*"):
            assert whole.setdefault(path.name, path.stat().st_size) == path.stat().st_size
    assert whole
