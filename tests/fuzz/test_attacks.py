"""Attacks made by hand: what no mutator finds. Each is refused in our words, at once and whole."""

from __future__ import annotations

import os
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any

import pytest

import seaid
from seaid.drives import read_drives
from seaid.errors import SeaidError
from seaid.log.readers.opening import READERS as OF_LOGS
from tests.fuzz import seeds

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
    "scene": lambda path: seaid.excitation.load_scene(path, seeds.robot()),
    "parameters": lambda path: seaid.read_parameters(path, seeds.robot()),
    "trajectory": seaid.load_trajectory,
    "description": lambda path: seaid.read_log("/dev/null", seeds.robot(), description=path),
    **{ending: read_as(ending) for ending in ENDINGS},
}


@contextmanager
def limited() -> Iterator[None]:
    """Let nothing take 2 GB more than now, or more than ten seconds."""

    def too_long(*_: object) -> None:
        raise TookTooLong(f"more than {SECONDS} s")

    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    signal.signal(signal.SIGALRM, too_long)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEMORY_BYTES, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
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
    """Whatever stands in the place of a file keeps no reader waiting."""
    path = tmp_path / "x"
    PLACES[place](path.with_name(f"x{reader}") if reader in ENDINGS else path)
    refused(lambda: READERS[reader](path))


@pytest.mark.parametrize("reader", READERS)
def test_names_that_no_file_has_are_refused(tmp_path: Path, reader: str) -> None:
    """Zero bytes, names that are too long, and bytes that are no text raise nothing else."""
    for name in ("a\0b", "x" * 300, "\udcff", "x/" * 3000 + "x"):
        refused(lambda name=name: READERS[reader](tmp_path / name))  # type: ignore[misc]


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


@pytest.mark.parametrize("bomb", [bomb_entities, bomb_external, bomb_depth])
def test_xml_bombs_are_refused(tmp_path: Path, bomb: Callable[[Path], None]) -> None:
    """Entities and depth take no memory, and no other file is shown."""
    bomb(tmp_path / "x")
    said = refused(lambda: READERS["urdf"](tmp_path / "x"))
    assert "root:" not in said
