"""Files appear whole or not at all; TOML and JSON that cannot be used are named with the place."""

import ast
import os
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import seaid
from scripts.sources import tree_of
from seaid._files import (
    MOST_JSON_BYTES,
    MOST_TOML_BYTES,
    followed,
    is_replaced,
    numbers,
    owned_folder,
    point_latest,
    read_json,
    read_toml,
    real_path,
    whole_file,
    working_folder,
    write_csv,
    write_whole,
)
from seaid.drives import Drive, StiffDrive, read_drives, write_drives
from seaid.errors import LogError, RobotError, SeaidError
from seaid.log import LogDescription
from seaid.log.description import Source, description_for


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


def test_what_can_be_read_is_plain_data(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b'\xef\xbb\xbfa = 1\n[b."c.d"]\ne = [1.5, "x", true]\n')
    expected = {"a": 1, "b": {"c.d": {"e": [1.5, "x", True]}}}
    assert read_toml(path, "drives", RobotError) == expected
    path.write_text('{"a": [null, 1e3, "x"]}')
    assert read_json(path, "notes", LogError) == {"a": [None, 1000.0, "x"]}
    path.write_text("[" * 32 + "]" * 32)
    assert len(read_json(path, "notes", LogError)) == 1


ODD = st.text(st.characters(codec="utf-8"), max_size=20)


def error_of(path: Path) -> str:
    """Return the bounded and printable error of reading a file of TOML or JSON."""
    read, noun = (read_json, "notes") if path.suffix == ".json" else (read_toml, "drives")
    with pytest.raises(LogError) as caught:
        read(path, noun, LogError)
    text = str(caught.value)
    assert len(text) < 400 + len(str(path))
    assert text.isprintable()
    return text


def test_files_that_are_not_there_are_told(tmp_path: Path) -> None:
    """So are folders, and paths that cannot be."""
    assert error_of(tmp_path / "no.toml").endswith("no.toml': No such file or directory")
    assert error_of(tmp_path).endswith("Is a directory")
    assert "embedded null byte" in error_of(Path("a\0b"))
    assert error_of(tmp_path / "no.json").startswith("cannot read notes '")


TOML, JSON = ".toml", ".json"
FINITE, LEVELS = "must be a finite number", "tables or lists have too many levels"


@pytest.mark.parametrize(
    ("ending", "text", "words"),
    [
        (TOML, b"[a\n", "is not valid TOML: Expected"),
        (TOML, b"a = 1\na = 2\n", "is not valid TOML: Cannot overwrite a value"),
        (TOML, b"\xff\xfe\x00", "is not valid TOML: 'utf-8' codec can't decode byte 0xff"),
        (TOML, b"a = nan\n", f"a {FINITE}"),
        (TOML, b"[a.b]\nc = [1, -inf]\n", f"a.b.c[1] {FINITE}"),
        (TOML, b"a = 1" + b"0" * 400, f"a {FINITE}"),
        (TOML, b"a = " + b"9" * 5000, "is not valid TOML: Exceeds the limit"),
        (TOML, b"a = 1979-05-27\n", "a must be a number, a text, a list or a table, found '1979"),
        (TOML, b"a = " + b"[" * 32 + b"]" * 32, "is more than 32 levels deep"),
        (TOML, b"a = " + b"[" * 100_000, LEVELS),
        (TOML, b"a" + b".a" * 300 + b" = 1\n", "not valid TOML: more than 200 dots (at line 1)"),
        (TOML, b"#" + b"x" * MOST_TOML_BYTES, "is longer than the 1 MB"),
        (TOML, b'"\\u001b[31m\\n" = nan\n', f"'\\x1b[31m\\n' {FINITE}"),
        (JSON, b"{", "is not JSON: Expecting"),
        (JSON, b"\xff", "is not JSON: 'utf-8' codec"),
        (JSON, b"[NaN]", "[0] must be a finite number"),
        (JSON, b'{"a": [1e999]}', f"a[0] {FINITE}"),
        (JSON, b"[1" + b"0" * 400 + b"]", f"[0] {FINITE}"),
        (JSON, b"9" * 5000, "is not JSON: Exceeds the limit"),
        (JSON, b'{"b": 0, "a": 1, "a": 2}', "duplicate key 'a' in one object"),
        (JSON, b"[" * 33 + b"]" * 33, "is more than 32 levels deep"),
        (JSON, b"[" * 100_000, LEVELS),
        (JSON, b'["\\ud800"]', "[0] is not Unicode: an unpaired surrogate"),
        (JSON, b'{"\\ud800": 1}', "is not Unicode: an unpaired surrogate"),
        (JSON, b" " * (MOST_JSON_BYTES + 1), "is longer than the 16 MB"),
    ],
)
def test_text_that_cannot_be_used_is_named_with_its_place(
    tmp_path: Path, ending: str, text: bytes, words: str
) -> None:
    """What has no end in memory is refused before it is read."""
    path = tmp_path / f"file{ending}"
    path.write_bytes(text)
    assert words in error_of(path)


def test_numbers_are_no_texts_and_no_truths() -> None:
    """Neither in lists within lists."""
    assert numbers("x", [[1, 2.5], []], LogError) == [[1, 2.5], []]
    for wrong in (True, "1", None, [[1, True]], {"a": 1}):
        with pytest.raises(LogError, match="x must be a number, found"):
            numbers("x", wrong, LogError)


@given(ODD, ODD)
def test_names_of_any_letters_come_back_from_drives_and_descriptions(
    tmp_path_factory: pytest.TempPathFactory, joint: str, column: str
) -> None:
    path = tmp_path_factory.mktemp("names") / "log.toml"
    drives: dict[str, Drive] = {joint: StiffDrive(gear_ratio=3.0, transmission={joint: 2.0})}
    write_drives(drives, path.with_name("drives.toml"))
    assert read_drives(path.with_name("drives.toml")) == drives
    written = LogDescription({joint: {"joint_position": Source((column,))}}, where=column)
    path.write_text(written.to_toml(), encoding="utf-8")
    back = description_for(path.with_suffix(".csv"), path)
    assert back is not None
    assert back.to_dict() == written.to_dict()
