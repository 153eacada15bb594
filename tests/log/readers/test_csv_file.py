"""Tables of text in any of their formats, and what is no table."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import seaid.log.readers.table as limits
from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log import describe_log, read_log
from seaid.log.readers.opening import open_table
from seaid.robot import Robot
from tests.log.readers.files import error_of, loaded, one_log, save, write

TIME: Array = np.linspace(0.0, 1.99, 200)
ROWS: Array = np.column_stack([TIME, np.sin(3 * TIME), np.cos(2 * TIME)])
NAMES = ["t", "q", "tau"]


def text_of(delimiter: str, decimal: str = ".", head: str = "") -> str:
    lines = (delimiter.join(f"{one:.6f}" for one in row) for row in ROWS)
    return head + "\n".join(lines).replace(".", decimal) + "\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty; a log starts with a line of column names"),
        (b"a,b\n", "has column names but no samples"),
        (b"a,b\n\n \n", "has column names but no samples"),
        (bytes(range(256)), "is not a text file in UTF-8"),
        ("a,b\n1,2\n".encode("utf-16"), "in UTF-8 (invalid start byte at byte 0)"),
        ("a,b\n1,2\n".encode("utf-16-le"), "is not a text file in UTF-8 (it has zero bytes)"),
        (b"a,b\n1,\xff\n", "(invalid start byte at byte 6)"),
        (b"PK\x03\x04junk", "not a text file in UTF-8 but a spreadsheet or an archive; save the"),
        (b"\x1f\x8bjunk", "is not a text file in UTF-8 but compressed; unpack it first"),
        (b"version https://git-lfs.github.com/spec/v1\nsize 12\n", "fetch the file with git lfs"),
        (b'a,b\n"' + b"x" * 140_000 + b'",1\n', "is not a table: field larger than field limit"),
        (b'"' + b"x" * 140_000 + b'",b\n', "is not a table: field larger than field limit"),
        (b"a,b\n1," + b"2" * 2_000_000, "line 2 has more than 1,000,000 characters"),
        (b",".join([b"x"] * 20_000), "has 20,000 columns or more, allowed are 10,000"),
        (b"a," + b"b" * 5_000, "the name of a column has 5,000 characters, allowed are 1,000"),
        (b"a,a,b\n1,2,3\n", "column named twice: a"),
        (b"a,b\n1,2\n3\n", "is not a table: line 3 has 1 cell, the first line 2 column names"),
        (b"a,b\n1,2,3,4\n", "2 column names; decimal commas? Delimit the columns by"),
        (b"a,b\n1,2,3\n1,2\n", "line 3 has 2 cells, the first line 3 column names"),
        (b"1.5,2\n3,4,5\n", "line 2 has 3 cells, the first line 2 numbers"),
        (b"a,b\n" + b"y" * 5_000 + b",1\n", "has 'yyy"),
        (b"a,b\n1\x00,2\n", "is not a number"),
        (b"a,b\n1,2\n" + bytes(40) + b"\n", "line 3: has zero bytes, as a file that was not wri"),
        (b"a,b\n2024-05-01 12:00:00,2\n", "is not a number; write the time as seconds"),
        (b"a,b\n1,2\n\nlost,3\n", "line 4: column 'a' has 'lost', which is not a number: empty it"),
        (b'a,b\n1,2\n"2,5",3\n', "is not a number; write a decimal point"),
        (b'a\n"[1, 2, 3]"\n"[1, 2]"\n', "line 3: column 'a' has '[1, 2]', and a list of 3 numb"),
        (b't,a\n1,"[1, 2, 3]"\n2,5\n', "line 3: column 'a' has '5', and a list of 3 numbers bef"),
        (b't,a\n1,"[1, 2, 3]"\n2,"[1, x, 2]"\n', "column 'a[1]' has 'x', which is not a number"),
    ],
)  # fmt: skip
def test_what_is_no_table_is_named_with_its_place(
    tmp_path: Path, content: bytes, words: str
) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    text = error_of(path, "1" if content[:1] == b"1" else "a[1]" if b"[1, " in content else "a")
    assert text.startswith(f"'{path}'")
    assert words in text


@pytest.mark.parametrize(
    ("content", "names"),
    [
        (text_of(",", head="t,q,tau\n"), NAMES),
        (text_of(";", ",", head="t;q;tau\n"), NAMES),
        (text_of("\t", ",", head="t\tq\ttau\n"), NAMES),
        (text_of(" ", ",", head="t q tau\n"), NAMES),
        (text_of("  ", head="t   q tau\n"), NAMES),
        (text_of(",", head="% t, q, tau\n"), NAMES),
        (text_of(",", head="\n# ramp\n# kp=1,kd=2\nt,q,tau\n"), NAMES),
        (text_of(" ", head="# made by a bench\n# t q tau\n"), NAMES),
        (text_of(";", ",", head='"t";"q";"tau"\n'), NAMES),
        (text_of(";", head="t, in s;q;tau\n"), ["t, in s", "q", "tau"]),
        (text_of(",", head="0,1,2\n"), ["0", "1", "2"]),
        (text_of(","), ["1", "2", "3"]),
        (text_of("\t"), ["1", "2", "3"]),
        (text_of(" ", ","), ["1", "2", "3"]),
        (text_of(",", head="# made by a bench\n# on a Monday\n"), ["1", "2", "3"]),
        (text_of("|", head="t|q|tau\n"), NAMES),
        (text_of(",", head="t,|q|,tau\n"), ["t", "|q|", "tau"]),
        (text_of(";", ",", head="sep=;\nt;q;tau\n"), NAMES),
        (text_of(",", head='"sep=,"\n'), ["1", "2", "3"]),
        (text_of(",", head='"t","q","tau"\n').replace("\n", "\r\n"), NAMES),
        (text_of(",", head="t,q,tau\ns,rad,Nm\n"), ["t [s]", "q [rad]", "tau [Nm]"]),
        (text_of(";", ",", head="t;q;tau\n[s];;(Nm)\n"), ["t [s]", "q", "tau [Nm]"]),
        (text_of(",", head="Log of the arm, run 3\nt,q,tau\n"), NAMES),
        (text_of(";", ",", head="Bench 3\n\nrate: 100 Hz\nt;q;tau\n"), NAMES),
        (text_of(" ", head="a bench with an arm\nt q tau\n"), NAMES),
        (text_of(",", head='"Robot, arm 1, of 2"\nt,q,tau\n'), NAMES),
        (text_of(",", head="Bench\nt,q,tau\n\ns,,Nm\n"), ["t [s]", "q", "tau [Nm]"]),
    ],
)
def test_a_table_of_text_is_read_in_its_own_format(
    tmp_path: Path, content: str, names: list[str]
) -> None:
    """The delimiter, the decimal mark and the header are found; in pieces it is the same."""
    table = open_table(save(tmp_path / "log.txt", content))
    assert table.names == names
    assert table.blocks is not None
    parts = list(table.blocks(names, 60))
    assert [len(one[names[0]]) for one in parts] == [60, 60, 60, 20]
    for place, name in enumerate(names):
        np.testing.assert_allclose(table.load([name])[name], ROWS[:, place], atol=1e-6)
        np.testing.assert_allclose(
            np.concatenate([one[name] for one in parts]), ROWS[:, place], atol=1e-6
        )


BLANK = [None] * 7
CELLS: tuple[tuple[str, dict[str, list[float | None]]], ...] = (
    ("a,b\n1,2\nNA,3\nn/a,3\n#N/A,3\nnull,3\nNone,3\nnan,3\n,3\n", {"a": [1.0, *BLANK]}),
    ("on,off\nTrue,false\nFALSE,true\n", {"on": [1.0, 0.0], "off": [0.0, 1.0]}),
    ("1.5\n2.5\n", {"1": [1.5, 2.5]}),
    ("a,state,state\n1,running,\n2,,off\n", {"a": [1.0, 2.0]}),  # what is not asked for
    ("\ufeffa,b\n1,2\n3,4\n\n\n", {"a": [1.0, 3.0], "b": [2.0, 4.0]}),
    ("t,q\n0,1,7\n0.1,2,8\n", {"t": [0.0, 0.1], "q": [1.0, 2.0], "unnamed": [7.0, 8.0]}),
    ('t,q\n"1",0,1\n"2",0.1,2\n', {"t": [0.0, 0.1], "q": [1.0, 2.0], "unnamed": [1.0, 2.0]}),
    ("t q\n1 0 1\n2 0.1 2\n3 0.2 3\n", {"t": [0.0, 0.1, 0.2], "unnamed": [1.0, 2.0, 3.0]}),
    ("t\tq\n0\t0\t1\n1\t0.1\t2\n2\t0.2\t3\n", {"t": [0.0, 0.1, 0.2], "q": [1.0, 2.0, 3.0]}),
    ('"t" "q"\n"5" 0 1\n"7" 0.1 2\n', {"t": [0.0, 0.1], "q": [1.0, 2.0], "unnamed": [5.0, 7.0]}),
    ("t,q\n1,0,\n2,0.1,\n3,0.2,\n", {"t": [1.0, 2.0, 3.0], "q": [0.0, 0.1, 0.2]}),
    ("t,q\n1,0,1\n2,0.1,2\n4,0.2,3\n", {"t": [1.0, 2.0, 4.0], "unnamed": [1.0, 2.0, 3.0]}),
    ("t,q\n[s],[rad]\n0,1,7\n", {"t [s]": [0.0], "q [rad]": [1.0], "unnamed": [7.0]}),
    (
        't,positions,"raw [V]"\n0.5,"[0.25, -1e-3, 3]",[7 8]\n1.0,"[0.5, nan, 4]",[9 10]\n',
        {
            "t": [0.5, 1.0],
            "positions[0]": [0.25, 0.5],
            "positions[1]": [-1e-3, None],
            "positions[2]": [3.0, 4.0],
            "raw [V][0]": [7.0, 9.0],
            "raw [V][1]": [8.0, 10.0],
        },
    ),
)


@pytest.mark.parametrize(("content", "columns"), CELLS)
def test_cells_of_any_kind_are_numbers(
    tmp_path: Path, content: str, columns: dict[str, list[float | None]]
) -> None:
    """Missing numbers, truths, lists, and cells more than names, as R writes them, are read."""
    path = save(tmp_path / "log.csv", content)
    assert loaded(path, columns) == columns
    assert {*open_table(path).names} >= columns.keys()
    assert csv.field_size_limit() == 131_072  # as it was: it is everybody's


GROUPED: tuple[tuple[str, list[float]], ...] = (
    ("t;q\n0,001;1.234,5\n0,002;999,5\n0,003;-12.345,25\n", [1234.5, 999.5, -12345.25]),
    ("t;q\n0,001;999\n0,002;1.000\n0,003;1.234.567\n", [999.0, 1000.0, 1234567.0]),
    ("t;q\n1;999\n2;1.000,5\n", [999.0, 1000.5]),
    ("t;q\n0,001;1.234\n0,002;1.5\n", [1.234, 1.5]),
    ("t;q\n0,000;1,234\n0,001;-1,235\n", [1.234, -1.235]),
    ('t,q\n0.001,"1,234.5"\n0.002,999.5\n', [1234.5, 999.5]),
    ("t\tq\n0.001\t1,234.5\n0.002\t1,235\n", [1234.5, 1235.0]),
    ("t;q\n0.001;12'345.6\n0.002;345.6\n", [12345.6, 345.6]),
    ("t;q\n0,001;12\u202f345,6\n0,002;345,6\n", [12345.6, 345.6]),
    ("t,q\n0.001,12'345\n0.002,-345\n", [12345.0, -345.0]),
    ("0,001;1.234,5\n0,002;1.235,5\n", [1234.5, 1235.5]),
    ("0.1,234,567\n0.2,235,568\n", [567.0, 568.0]),
    ("t;q\n1;998\n2;0.5\n3;999\n4;1.000\n", [998.0, 0.5, 999.0, 1.0]),
    ("t;q\n1;99.999\n2;100\n3;100.001\n", [99.999, 100.0, 100.001]),
)


@pytest.mark.parametrize(("content", "numbers"), GROUPED)
def test_separators_of_thousands_are_read_where_a_column_leaves_no_doubt(
    tmp_path: Path, content: str, numbers: list[float]
) -> None:
    """Points, commas, apostrophes and thin spaces separate thousands, signs of decimals do not."""
    table = open_table(save(tmp_path / "log.csv", content))
    last = table.names[-1]
    assert table.load([last])[last].tolist() == numbers


@pytest.mark.parametrize(
    ("content", "line", "words"),
    [
        ("t;q\n0,001;1.234\n0,002;1.240\n", 2, "'1.234', which may be 1.234 or"),
        ("t\tq\n0.001\t1,234\n0.002\t1,235\n", 2, "'1,234', which may be 1.23"),
        ('t,q\n0.001,"1,234"\n0.002,"1,235"\n', 2, "may be 1.234 or 1234; write a decimal point"),
        ("t;q\n1;998\n2;999\n3;1.000\n", 4, "'1.000', which may be 1 or 1000"),
        ("t;q\n0,001;1,5\n0,002;1.5\n", 3, "'1.5', which is not a number; writ"),
        ("t;q\n0,001;1.23,5\n0,002;1,5\n", 2, "'1.23,5', which is not a number"),
    ],
)
def test_a_separator_of_two_meanings_is_refused_with_its_place(
    tmp_path: Path, content: str, line: int, words: str
) -> None:
    """A point that may be of thousands or of decimals is not taken for either."""
    text = error_of(save(tmp_path / "log.csv", content), "q")
    assert f"line {line}: column 'q' has " in text
    assert words in text


def test_a_line_of_truths_dates_or_nothing_is_none_of_units(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    for line in ("true,False", "NaN,", ",", "12:00:01,x", '"[1, 2]",x', "left"):
        path.write_text(f"a,b\n{line}\n1,2\n")
        assert not any("[true]" in name or "[x]" in name for name in open_table(path).names)


def test_columns_of_a_file_without_header_are_described_by_their_numbers(
    arm: Robot, tmp_path: Path
) -> None:
    path = save(tmp_path / "log.csv", text_of(";", ","))
    words = r"found: 1, 2, 3; the first line is .*no header\? Name the columns by their numbers"
    with pytest.raises(LogError, match=words):
        read_log(path, arm)
    joints = {"arm": {"joint_position": {"column": 2, "unit": "deg"}, "motor_torque": 3}}
    log = read_log(path, arm, description={"time": 1, "joints": joints})
    np.testing.assert_allclose(log.joint_position[:, 0], np.deg2rad(ROWS[:, 1]), atol=1e-6)
    text = "time = 1\n[joints.arm]\njoint_position = 2\nmotor_torque = 3\n"
    save(tmp_path / "log.toml", text)
    np.testing.assert_array_equal(read_log(path, arm).motor_torque, log.motor_torque)
    with pytest.raises(LogError, match=r"no column is named '4'.*the first line is numbers: no he"):
        read_log(path, arm, description={"time": 4, "joints": joints})
    with pytest.raises(LogError, match=r"no column looks like.*first line is numbers: no header"):
        describe_log(path)


def test_csv_too_large_for_the_memory_is_sent_to_the_long_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.csv"
    write(one_log(), path)
    with path.open("r+b") as file:
        file.truncate(2 * 10**9)  # sparse: takes no room on the disk
    monkeypatch.setattr(limits, "free_memory", lambda: 7.9e9)
    text = error_of(path)
    assert "takes 2 GB of memory, too much for the 7.9 GB that are free" in text
    assert "read it in pieces with seaid.open_long_log" in text


def test_a_long_file_is_read_in_parts_like_a_short_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.csv"
    path.write_text("a,b\n" + "".join(f"{k},{k if k % 7 else 'nan'}\n" for k in range(500)))
    whole = open_table(path).load(["b", "a"])
    monkeypatch.setattr("seaid.log.readers.csv_file._CELLS", 128)
    parts = open_table(path).load(["b", "a"])
    np.testing.assert_array_equal(parts["b"], whole["b"])
    assert parts["a"].tolist() == list(range(500))
