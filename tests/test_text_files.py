"""TOML and JSON of users: what cannot be read is told with the file and the place in it."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid._files import MOST_JSON_BYTES, MOST_TOML_BYTES, numbers, read_json, read_toml
from seaid.drives.drives import Drive, StiffDrive
from seaid.drives.toml import read_drives, write_drives
from seaid.errors import LogError, RobotError, shortened, shown, unknown_name
from seaid.log.description import LogDescription, Source, description_for


def toml_error(path: Path) -> str:
    with pytest.raises(RobotError) as caught:
        read_toml(path, "drives", RobotError)
    text = str(caught.value)
    assert len(text) < 400 + len(str(path))
    assert text.isprintable()
    return text


def json_error(path: Path) -> str:
    with pytest.raises(LogError) as caught:
        read_json(path, "notes", LogError)
    assert len(str(caught.value)) < 400 + len(str(path))
    return str(caught.value)


def test_what_can_be_read_is_plain_data(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b'\xef\xbb\xbfa = 1\n[b."c.d"]\ne = [1.5, "x", true]\n')
    expected = {"a": 1, "b": {"c.d": {"e": [1.5, "x", True]}}}
    assert read_toml(path, "drives", RobotError) == expected
    path.write_text('{"a": [null, 1e3, "x"]}')
    assert read_json(path, "notes", LogError) == {"a": [None, 1000.0, "x"]}


def test_files_that_are_not_there_are_told(tmp_path: Path) -> None:
    assert toml_error(tmp_path / "no.toml").endswith("no.toml': No such file or directory")
    assert toml_error(tmp_path).endswith("Is a directory")
    assert "embedded null byte" in toml_error(Path("a\0b"))
    assert json_error(tmp_path / "no.json").startswith("cannot read notes '")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"[a\n", "is not valid TOML: Expected"),
        (b"a = 1\na = 2\n", "is not valid TOML: Cannot overwrite a value"),
        (b"\xff\xfe\x00", "is not valid TOML: 'utf-8' codec can't decode byte 0xff in position 0"),
        (b"a = nan\n", "a must be a finite number"),
        (b"[a.b]\nc = [1, -inf]\n", "a.b.c[1] must be a finite number"),
        (b"a = 1" + b"0" * 400, "a must be a finite number"),
        (b"a = " + b"9" * 5000, "is not valid TOML: Exceeds the limit"),
        (b"a = 0x" + b"f" * 5000, "a must be a finite number"),
        (b"a = 1979-05-27\n", "a must be a number, a text, a list or a table, found '1979-05-27'"),
        (b"a = " + b"[" * 40 + b"]" * 40, "is more than 32 levels deep"),
        (b"a = " + b"[" * 100_000, "tables or lists have too many levels"),
        (b"a = " + b"{a=" * 100_000, "tables or lists have too many levels"),
        (b"a" + b".a" * 300 + b" = 1\n", "is not valid TOML: more than 200 dots (at line 1)"),
        (b"#" + b"x" * MOST_TOML_BYTES, "is longer than the 1 MB"),
        (b'"\\u001b[31m\\n" = nan\n', "'\\x1b[31m\\n' must be a finite number"),
        (b'"' + b"k" * 9000 + b'" = nan\n', "must be a finite number"),
    ],
)
def test_toml_that_cannot_be_used_is_named_with_its_place(
    tmp_path: Path, text: bytes, words: str
) -> None:
    path = tmp_path / "file.toml"
    path.write_bytes(text)
    error = toml_error(path)
    assert error.startswith(f"drives '{path}'")
    assert words in error


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"{", "is not JSON: Expecting"),
        (b"\xff", "is not JSON: 'utf-8' codec"),
        (b"[NaN]", "NaN is not a JSON number"),
        (b"[1, -Infinity]", "-Infinity is not a JSON number"),
        (b'{"a": [1e999]}', "a[0] must be a finite number"),
        (b"[1" + b"0" * 400 + b"]", "[0] must be a finite number"),
        (b"9" * 5000, "is not JSON: Exceeds the limit"),
        (b'{"a": 1, "a": 2}', "duplicate key 'a' in one object"),
        (b"[" * 40 + b"]" * 40, "is more than 32 levels deep"),
        (b"[" * 100_000, "tables or lists have too many levels"),
        (b'{"a":' * 100_000, "tables or lists have too many levels"),
        (b'["\\ud800"]', "[0] is not Unicode: an unpaired surrogate"),
        (b'{"\\ud800": 1}', "is not Unicode: an unpaired surrogate"),
        (b" " * (MOST_JSON_BYTES + 1), "is longer than the 16 MB"),
    ],
)
def test_json_that_cannot_be_used_is_named_with_its_place(
    tmp_path: Path, text: bytes, words: str
) -> None:
    path = tmp_path / "file.json"
    path.write_bytes(text)
    assert words in json_error(path)


def test_numbers_are_no_texts_and_no_truths() -> None:
    assert numbers("x", [[1, 2.5], []], LogError) == [[1, 2.5], []]
    for wrong in (True, "1", None, [[1, True]], {"a": 1}):
        with pytest.raises(LogError, match="x must be a number, found"):
            numbers("x", wrong, LogError)


def test_what_a_message_shows_of_a_user_is_short_and_printable() -> None:
    assert shown([1, "a"]) == "[1, 'a']"
    assert len(shown("x" * 10_000)) == len(shortened("x" * 10_000)) == 80
    assert shown(10**5000) == "a int too long to show"
    assert shortened("a\x1b[31m\nb") == r"a\x1b[31m\nb"
    text = unknown_name("joint", "kn\u202ee" + "x" * 10_000, ["knee"])
    assert text.isprintable()
    assert len(text) < 200
    assert len(unknown_name("joint", "a", [f"column {i}" for i in range(1000)])) < 1600


ODD = st.text(st.characters(codec="utf-8"), max_size=20)


@given(ODD)
def test_names_of_any_letters_come_back_from_the_drives(
    tmp_path_factory: pytest.TempPathFactory, name: str
) -> None:
    path = tmp_path_factory.mktemp("drives") / "drives.toml"
    drives: dict[str, Drive] = {name: StiffDrive(gear_ratio=3.0, transmission={name: 2.0})}
    write_drives(drives, path)
    assert read_drives(path) == drives


@given(ODD, ODD)
def test_names_of_any_letters_come_back_from_a_description(
    tmp_path_factory: pytest.TempPathFactory, joint: str, column: str
) -> None:
    path = tmp_path_factory.mktemp("description") / "log.toml"
    given_one = LogDescription({joint: {"joint_position": Source(column)}}, where=column)
    path.write_text(given_one.to_toml(), encoding="utf-8")
    back = description_for(path.with_suffix(".csv"), path)
    assert back is not None
    assert back.to_dict() == given_one.to_dict()


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (
            {"column": "q", "scale": 1e300},
            "(at most 1e+30 in size) that is not zero, found 1e+300",
        ),
        ({"column": "q", "scale": 10**5000}, "that is not zero, found a int too long"),
        ({"column": "q", "scale": True}, "that is not zero, found True"),
        ({"column": ["q"] * 999}, "must be the name of a column, found ['q', 'q'"),
        ({3: "q"}, "no key is named '3'"),
        ([], "must be a table, found []"),
    ],
)
def test_a_description_of_wrong_types_is_told_in_words(
    tmp_path: Path, source: object, words: str
) -> None:
    with pytest.raises(LogError) as caught:
        description_for(tmp_path / "log.csv", {"joints": {"a": {"joint_position": source}}})
    assert words in str(caught.value)
    assert len(str(caught.value)) < 500
