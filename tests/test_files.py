"""Files appear whole or not at all."""

import ast
import os
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import seaid
from scripts.sources import tree_of
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


def test_file_appears_at_the_end_and_nothing_else_stays(tmp_path: Path) -> None:
    """It is written next to its place, under a name that nobody foresees."""
    path, names = tmp_path / "new" / "folder" / "out.csv", set()
    for number in range(20):
        with whole_file(path) as temporary:
            temporary.write_text(f"whole {number}")
            assert path.exists() == (number > 0)
            assert (temporary.parent, temporary.suffix) == (path.parent, path.suffix)
            names.add(temporary.name)
        assert path.read_text() == f"whole {number}"
    assert os.listdir(path.parent) == ["out.csv"]
    assert len(names) == 20
    assert not any("out" in name or str(os.getpid()) in name for name in names)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ValueError("no"), "no"),
        (KeyboardInterrupt(), "^$"),
        (SystemExit(1), "1"),
        (SeaidError("no"), "no"),
        (
            OSError(28, "No space left on device"),
            "out.json': No space left on device; make room, or name a folder on another disk",
        ),
        (
            PermissionError(13, "Permission denied"),
            "out.json': Permission denied; name a folder you may write to",
        ),
    ],
)
def test_old_file_stays_where_writing_fails(
    tmp_path: Path, error: BaseException, words: str
) -> None:
    """An error of the disk is ours, with the path and what to do."""
    path = tmp_path / "out.json"
    path.write_text("old")
    expected = SeaidError if isinstance(error, OSError) else type(error)
    with pytest.raises(expected, match=words), whole_file(path) as temporary:
        temporary.write_text("half of the ne")
        raise error
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["out.json"]


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("file/out.json", "name a folder you may write to"),
        ("folder", "Is a directory"),
        ("circle", "circle': Too many levels of symbolic links"),
        ("/dev/full", "cannot write '/dev/full': No space left on device; make"),
        *((name, "cannot write '") for name in ("n" * 256, "a\0b", ".")),
    ],
)
def test_a_path_that_cannot_be_written_is_said(tmp_path: Path, path: str, words: str) -> None:
    """Nothing is made on the way to it."""
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "folder").mkdir()
    (tmp_path / "circle").symlink_to("circle")
    before = {*os.listdir(tmp_path)}
    with pytest.raises(SeaidError, match=words):
        write_whole(f"{tmp_path}/{path}" if path[0] != "/" else path, "text")
    assert {*os.listdir(tmp_path)} == before


@pytest.mark.parametrize("old", [0o600, 0o664, 0o444])
def test_an_older_file_keeps_its_mode_and_owner(tmp_path: Path, old: int) -> None:
    """A new file has what the umask leaves, and a temporary one is that of its user alone."""
    path, new = tmp_path / "out.json", tmp_path / "new.json"
    path.write_text("old")
    path.chmod(old)
    is_root = os.geteuid() == 0
    if is_root:  # only root may give a file to another user
        os.chown(path, 1234, 5678)
    before = os.umask(0o027)
    try:
        with whole_file(path) as temporary:
            assert stat.S_IMODE(temporary.stat().st_mode) == 0o600
            temporary.write_text("new")
        write_whole(new, "new")
    finally:
        os.umask(before)
    modes = [stat.S_IMODE(one.stat().st_mode) for one in (path, new)]
    assert modes == [old, 0o640]
    assert not is_root or (path.stat().st_uid, path.stat().st_gid) == (1234, 5678)


def test_a_link_stays_and_its_target_is_written(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / "target.json", tmp_path / "out.json"
    link.symlink_to(Path("there") / "target.json")
    for text in ("new", "newer"):  # first where it points to nothing
        write_whole(link, text)
        assert link.is_symlink()
        assert target.read_text() == text
    assert os.listdir(target.parent) == ["target.json"]


def test_devices_and_pipes_get_the_bytes_and_stay(tmp_path: Path) -> None:
    """They are no files that would be replaced."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with ThreadPoolExecutor(1) as reader:
        text = reader.submit(pipe.read_text)
        write_whole(pipe, "through the pipe")
        assert text.result(timeout=10) == "through the pipe"
    write_whole("/dev/null", "text")
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
    (tmp_path / "old").write_text("")
    (tmp_path / "link").symlink_to("old")
    places = {"old": True, "link": True, "new": False, "/dev/null": False}
    assert {name: is_replaced(tmp_path / name) for name in places} == places
    with pytest.raises(SeaidError, match="Is a directory"):
        is_replaced(tmp_path)


@pytest.mark.parametrize("to_file", [True, False])
def test_the_own_output_is_written_to_in_order(tmp_path: Path, to_file: bool) -> None:
    """Before it and after it stands what else is printed, in a file and in a pipe."""
    code = "from seaid._files import write_whole; print('before'); "
    code += "write_whole('/dev/stdout', 'text\\n'); print('after')"
    with (tmp_path / "out").open("wb") as file:
        output = file if to_file else subprocess.PIPE
        done = subprocess.run([sys.executable, "-c", code], stdout=output, check=True)
    text = done.stdout or (tmp_path / "out").read_bytes()
    assert text == b"before\ntext\nafter\n"


def test_a_temporary_file_that_is_there_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not even where somebody guessed its name."""
    monkeypatch.setattr("secrets.token_hex", lambda _: "guessed")
    (tmp_path / "victim").write_text("kept")
    (tmp_path / ".seaid-guessed.json").symlink_to("victim")
    with pytest.raises(SeaidError, match="File exists"):
        write_whole(tmp_path / "out.json", "text")
    assert (tmp_path / "victim").read_text() == "kept"


@pytest.mark.parametrize("name", ["n" * 250 + ".json", "n." + "s" * 253, "é" * 127, "\udcff\udcfe"])
def test_a_name_may_be_as_long_and_odd_as_the_disk_allows(tmp_path: Path, name: str) -> None:
    """Letters that are no Unicode become question marks in the text alone."""
    write_whole(tmp_path / name, "text of \udcff")
    write_csv(tmp_path / "a.csv", {"\udcff": np.zeros(1)})
    assert (tmp_path / name).read_text() == "text of ?"
    assert (tmp_path / "a.csv").read_text() == "?\n0\n"
    assert len(os.listdir(tmp_path)) == 2


def test_a_deleted_working_folder_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a file is read, and where one is written."""
    assert working_folder() == f"working folder {Path.cwd()}"
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(SeaidError, match="the working folder has been deleted: change to one that"):
        real_path("out.json")
    with pytest.raises(SeaidError, match=r"cannot write 'out\.json'"):
        write_whole("out.json", "text")
    with pytest.raises(
        seaid.errors.RobotError, match=r"no URDF .* 'a.urdf' \(the working folder has"
    ):
        seaid.load_robot("a.urdf")


@pytest.mark.slow  # 0.7 s
def test_files_are_written_in_one_place() -> None:
    """Elsewhere only what `whole_file` gave is written to, and what closed streams say."""
    package = Path(seaid.__file__).parent
    writing, whole = set(), set()
    for path in package.rglob("*.py"):
        place = path.relative_to(package).as_posix()
        calls = ast.walk(tree_of(path.read_text(encoding="utf-8")))
        for call in (node for node in calls if isinstance(node, ast.Call)):
            name = ast.unparse(call.func).rpartition(".")[2]
            values = [*call.args, *(word.value for word in call.keywords)]
            modes = {one.value for one in values if isinstance(one, ast.Constant)}
            opens = name == "open" and modes & {"w", "wb", "a", "ab", "x", "xb"}
            if opens or name in ("write_text", "write_bytes", "tofile"):
                writing.add(place)
            if ast.unparse(call.func) == "whole_file":
                whole.add(place)
    assert "_files.py" in writing
    assert writing - whole == {"cli/program.py"}


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


def test_latest_is_a_link_or_a_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A text where there are no links, which is followed as one; notes of a user stay."""

    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    latest = tmp_path / "latest"
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
    assert followed(latest / "a.json") == latest / "a.json"
    with monkeypatch.context() as patch:
        patch.setattr("os.symlink", refused)
        for name in ("first", "second"):
            point_latest(tmp_path / name)
            assert latest.read_text() == name
            assert followed(latest) == tmp_path / name
            assert followed(latest / "a.json") == tmp_path / name / "a.json"
        with pytest.raises(SeaidError, match=r"no saved run at '.*second'"):
            seaid.project.load_run(latest)
    point_latest(tmp_path / "first")
    assert latest.resolve() == tmp_path / "first"
    latest.unlink()
    for text in ("", "a" * 300, "notes of mine"):
        latest.write_text(text)
        assert followed(latest / "a.json") == latest / "a.json"
    point_latest(tmp_path / "second")
    assert latest.read_text() == "notes of mine"
