"""TOML and JSON of users: what cannot be read is told with the file and the place in it."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid._files import MOST_JSON_BYTES, MOST_TOML_BYTES, numbers, read_json, read_toml
from seaid.drives import Drive, StiffDrive, read_drives, write_drives
from seaid.errors import LogError, RobotError
from seaid.log import LogDescription
from seaid.log.description import Source, description_for


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


NOT_ZERO = "that is not zero, found"


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ({"column": "q", "scale": 1e300}, f"(at most 1e+30 in size) {NOT_ZERO} 1e+300"),
        ({"column": "q", "scale": 10**5000}, f"{NOT_ZERO} a int too long"),
        ({"column": "q", "scale": True}, f"{NOT_ZERO} True"),
        ({"column": ["q"] * 999}, "has 999 columns, needs 1"),
        ({3: "q"}, "no key is named '3'"),
        ([], "needs column (or, for a voltage, servo instead)"),
    ],
)
def test_a_description_of_wrong_types_is_told_in_words(
    tmp_path: Path, source: object, words: str
) -> None:
    with pytest.raises(LogError) as caught:
        description_for(tmp_path / "log.csv", {"joints": {"a": {"joint_position": source}}})
    assert words in str(caught.value)
    assert len(str(caught.value)) < 500
