"""Files appear whole or not at all."""

import ast
import os
import stat
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import seaid
from seaid._files import (
    followed,
    is_replaced,
    owned_folder,
    point_latest,
    real_path,
    whole_file,
    working_folder,
    write_csv,
    write_whole,
)
from seaid.errors import SeaidError
from tests.sources import tree_of


def test_file_appears_at_the_end_and_nothing_else_stays(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "out.csv"
    with whole_file(path) as temporary:
        temporary.write_text("whole")
        assert not path.exists()
        assert temporary.parent == path.parent
        assert temporary.suffix == path.suffix
    assert path.read_text() == "whole"
    assert os.listdir(path.parent) == ["out.csv"]


@pytest.mark.parametrize(
    "error", [ValueError("no"), KeyboardInterrupt(), SystemExit(1), SeaidError("no")]
)
def test_old_file_stays_where_writing_fails(tmp_path: Path, error: BaseException) -> None:
    path = tmp_path / "out.json"
    path.write_text("old")
    with pytest.raises(type(error)), whole_file(path) as temporary:
        temporary.write_text("half of the ne")
        raise error
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["out.json"]


def test_full_disk_is_said_with_path_and_advice(tmp_path: Path) -> None:
    path = tmp_path / "out.json"
    path.write_text("old")
    with pytest.raises(SeaidError) as caught, whole_file(path) as temporary:
        temporary.write_text("half")
        raise OSError(28, "No space left on device")
    assert str(caught.value) == (
        f"cannot write '{path}': No space left on device; make room, or name a folder on another "
        "disk"
    )
    assert path.read_text() == "old"


def test_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    path = tmp_path / "file" / "out.json"
    with pytest.raises(SeaidError, match="name a folder you may write to"), whole_file(path):
        pass


def test_path_that_is_a_folder_is_said_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "out.json").mkdir()
    path = tmp_path / "out.json"
    with pytest.raises(SeaidError, match="json': Is a directory"), whole_file(path):
        pytest.fail("nothing is to be written")
    assert os.listdir(tmp_path) == ["out.json"]


def test_folder_without_permission_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "replace", refuse)  # root, who may run this, may write everywhere
    path = tmp_path / "out.json"
    with pytest.raises(SeaidError, match="Permission denied; name"), whole_file(path) as temporary:
        temporary.write_text("text")
    assert os.listdir(tmp_path) == []


# What is at the path already


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.parametrize("old", [0o600, 0o640, 0o664, 0o444])
def test_an_older_file_keeps_its_mode(tmp_path: Path, old: int) -> None:
    path = tmp_path / "out.json"
    path.write_text("old")
    path.chmod(old)
    with whole_file(path) as temporary:
        assert mode(temporary) == 0o600
        temporary.write_text("new")
    assert (path.read_text(), mode(path)) == ("new", old)


@pytest.mark.parametrize(("mask", "expected"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_new_file_has_the_mode_that_the_umask_leaves(
    tmp_path: Path, mask: int, expected: int
) -> None:
    before = os.umask(mask)
    try:
        write_whole(tmp_path / "out.json", "new")
    finally:
        os.umask(before)
    assert mode(tmp_path / "out.json") == expected


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may give a file to another user")
def test_an_older_file_keeps_its_owner(tmp_path: Path) -> None:
    path = tmp_path / "out.json"
    path.write_text("old")
    os.chown(path, 1234, 5678)
    write_whole(path, "new")
    assert (path.stat().st_uid, path.stat().st_gid) == (1234, 5678)


def test_a_link_stays_and_its_target_is_written(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / "target.json", tmp_path / "out.json"
    link.symlink_to(Path("there") / "target.json")
    for text in ("new", "newer"):  # first where it points to nothing
        write_whole(link, text)
        assert link.is_symlink()
        assert target.read_text() == text
    assert os.listdir(target.parent) == ["target.json"]


def test_a_folder_on_the_way_is_made_though_the_path_leaves_it(tmp_path: Path) -> None:
    write_whole(tmp_path / "new" / ".." / "out.json", "text")
    assert (tmp_path / "new" / ".." / "out.json").read_text() == "text"


def test_links_in_a_circle_are_said(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(SeaidError, match=r"cannot write '.*a': Too many levels of symbolic links"):
        write_whole(tmp_path / "a", "text")


def test_a_device_gets_the_bytes_and_stays(tmp_path: Path) -> None:
    write_whole("/dev/null", "text")
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
    with pytest.raises(SeaidError, match="cannot write '/dev/full': No space left on device; make"):
        write_whole("/dev/full", "text")


def test_a_pipe_gets_the_bytes_and_stays(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with ThreadPoolExecutor(1) as reader:
        text = reader.submit(pipe.read_text)
        write_whole(pipe, "through the pipe")
        assert text.result(timeout=10) == "through the pipe"
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert os.listdir(tmp_path) == ["pipe"]


TO_STDOUT = """
from seaid._files import write_whole
print("before")
write_whole("/dev/stdout", "text\\n")
print("after")
"""


@pytest.mark.parametrize("to_file", [True, False])
def test_the_own_output_is_written_to_in_order(tmp_path: Path, to_file: bool) -> None:
    command = [sys.executable, "-c", TO_STDOUT]
    if to_file:
        with (tmp_path / "out").open("wb") as file:
            subprocess.run(command, stdout=file, check=True)
        assert os.listdir(tmp_path) == ["out"]
        assert (tmp_path / "out").read_text() == "before\ntext\nafter\n"
        return
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    assert done.stdout == "before\ntext\nafter\n"


def test_what_would_be_replaced_is_told(tmp_path: Path) -> None:
    (tmp_path / "old").write_text("")
    (tmp_path / "link").symlink_to("old")
    found = {name: is_replaced(tmp_path / name) for name in ("old", "link", "new")}
    assert found == {"old": True, "link": True, "new": False}
    assert not is_replaced("/dev/null")
    with pytest.raises(SeaidError, match="Is a directory"):
        is_replaced(tmp_path)


# Names


def test_nobody_foresees_the_temporary_name(tmp_path: Path) -> None:
    path, names = tmp_path / "out.json", set()
    for _ in range(20):
        with whole_file(path) as temporary:
            assert not temporary.is_symlink()
            names.add(temporary.name)
            temporary.write_text("")
    assert len(names) == 20
    assert not any("out" in name or str(os.getpid()) in name for name in names)


def test_a_temporary_file_that_is_there_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("secrets.token_hex", lambda _: "guessed")
    (tmp_path / "victim").write_text("kept")
    (tmp_path / ".seaid-guessed.json").symlink_to("victim")
    with pytest.raises(SeaidError, match="File exists"):
        write_whole(tmp_path / "out.json", "text")
    assert (tmp_path / "victim").read_text() == "kept"


@pytest.mark.parametrize("name", ["n" * 250 + ".json", "n." + "s" * 253, "é" * 127, "\udcff\udcfe"])
def test_a_name_may_be_as_long_and_odd_as_the_disk_allows(tmp_path: Path, name: str) -> None:
    write_whole(tmp_path / name, "text")
    assert (tmp_path / name).read_text() == "text"
    assert len(os.listdir(tmp_path)) == 1


@pytest.mark.parametrize("name", ["n" * 256, "a\0b", "", "."])
def test_a_name_that_cannot_be_is_said(tmp_path: Path, name: str) -> None:
    with pytest.raises(SeaidError, match="cannot write '"):
        write_whole(str(tmp_path / name) if name else "", "text")
    assert os.listdir(tmp_path) == []


def test_text_that_is_no_unicode_is_written_with_question_marks(tmp_path: Path) -> None:
    write_whole(tmp_path / "a.txt", "x\udcffy")
    write_csv(tmp_path / "a.csv", {"\udcff": np.zeros(1)})
    assert (tmp_path / "a.txt").read_text() == "x?y"
    assert (tmp_path / "a.csv").read_text() == "?\n0\n"


def test_threads_on_one_path_leave_one_whole_file(tmp_path: Path) -> None:
    path, begin = tmp_path / "out.txt", threading.Barrier(4)

    def write(letter: str) -> None:
        begin.wait(timeout=10)
        for _ in range(10):
            write_whole(path, letter * 100_000)

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(write, "abcd"))
    assert path.read_text() in {letter * 100_000 for letter in "abcd"}
    assert os.listdir(tmp_path) == ["out.txt"]


# The working folder


def test_a_deleted_working_folder_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert working_folder() == f"working folder {Path.cwd()}"
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(SeaidError, match="the working folder has been deleted: change to one that"):
        real_path("out.json")
    with pytest.raises(SeaidError, match=r"cannot write 'out\.json'"):
        write_whole("out.json", "text")
    with pytest.raises(
        seaid.RobotError, match=r"no URDF file at 'a.urdf' \(the working folder has"
    ):
        seaid.load_robot("a.urdf")


@pytest.mark.parametrize("path", ["a\0b", "x" * 5000])
def test_what_no_path_can_be_is_said(path: str) -> None:
    with pytest.raises(seaid.RobotError, match="no URDF file at"):
        seaid.load_robot(path)


# All of seaid


def calls() -> Iterator[tuple[str, ast.Call]]:
    package = Path(seaid.__file__).parent
    for path in package.rglob("*.py"):
        for node in ast.walk(tree_of(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                yield path.relative_to(package).as_posix(), node


def writes(name: str, call: ast.Call) -> bool:
    """Tell whether a call of a name writes a file: Path.write_text(...), open(..., "w")."""
    values = [*call.args, *(word.value for word in call.keywords)]
    modes = [one.value for one in values if isinstance(one, ast.Constant)]
    opened = name == "open" and any(mode in ("w", "wb", "a", "ab", "x", "xb") for mode in modes)
    return opened or name in ("write_text", "write_bytes", "tofile")


@pytest.mark.slow  # 0.7 s
def test_files_are_written_in_one_place() -> None:
    """Elsewhere only what `whole_file` gave is written to, what closed streams say, and messages
    between a process and its child, in a temporary folder of theirs.
    """
    found, whole = set(), set()
    for path, call in calls():
        name = call.func.attr if isinstance(call.func, ast.Attribute) else ast.unparse(call.func)
        if writes(name, call):
            found.add(path)
        if name == "whole_file" and isinstance(call.func, ast.Name):
            whole.add(path)
    assert "_files.py" in found
    assert found - whole == {"cli/messages.py", "log/readers/child_process.py"}


def test_folders_of_killed_processes_are_removed_and_those_of_living_ones_stay(
    tmp_path: Path,
) -> None:
    (tmp_path / ".seaid-killed" / "inputs").mkdir(parents=True)
    (tmp_path / "2026-01-01_12-00-00").mkdir()
    with owned_folder(tmp_path) as first:
        assert not (tmp_path / ".seaid-killed").exists()
        with owned_folder(tmp_path) as second:
            assert first.is_dir()
            second.rename(tmp_path / "done")
        assert first.is_dir()
    assert sorted(os.listdir(tmp_path)) == ["2026-01-01_12-00-00", "done"]


def test_latest_may_be_a_text(tmp_path: Path) -> None:
    (tmp_path / "runs" / "first").mkdir(parents=True)
    (tmp_path / "runs" / "first" / "a.json").write_text("{}")
    link = tmp_path / "runs" / "latest"
    assert followed(link / "a.json") == link / "a.json"
    link.write_text("first\n")
    assert followed(link) == tmp_path / "runs" / "first"
    assert followed(link / "a.json").read_text() == "{}"
    for text in ("", "none", "a" * 300):
        link.write_text(text)
        assert followed(link / "a.json") == link / "a.json"


def test_latest_is_a_text_where_there_are_no_links(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    for name in ("first", "second"):
        (tmp_path / name).mkdir()
    with monkeypatch.context() as patch:
        patch.setattr("os.symlink", refused)
        point_latest(tmp_path / "first")
        assert (tmp_path / "latest").read_text() == "first"
        with pytest.raises(SeaidError, match=r"no saved run at '.*first'"):
            seaid.load_run(tmp_path / "latest")
        point_latest(tmp_path / "second")
        assert (tmp_path / "latest").read_text() == "second"
    point_latest(tmp_path / "first")
    assert (tmp_path / "latest").resolve() == tmp_path / "first"
    (tmp_path / "latest").unlink()
    (tmp_path / "latest").write_text("notes of mine")
    point_latest(tmp_path / "second")
    assert (tmp_path / "latest").read_text() == "notes of mine"
