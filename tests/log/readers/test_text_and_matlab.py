"""Tables of text in any of their formats, MATLAB files, and columns by number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import io

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log import describe_log, read_log
from seaid.log.readers.opening import open_table
from seaid.robot import Robot
from tests.one_joint import one_joint

TIME: Array = np.linspace(0.0, 1.99, 200)
ROWS: Array = np.column_stack([TIME, np.sin(3 * TIME), np.cos(2 * TIME)])
NAMES = ["t", "q", "tau"]


@pytest.fixture
def arm(tmp_path: Path) -> Robot:
    return one_joint(tmp_path)


def text_of(delimiter: str, decimal: str = ".", head: str = "") -> str:
    lines = (delimiter.join(f"{one:.6f}" for one in row) for row in ROWS)
    return head + "\n".join(lines).replace(".", decimal) + "\n"


@pytest.mark.parametrize(
    ("content", "names"),
    [
        (text_of(",", head="t,q,tau\n"), NAMES),
        (text_of(";", ",", head="t;q;tau\n"), NAMES),
        (text_of("\t", ",", head="t\tq\ttau\n"), NAMES),
        (text_of(" ", ",", head="t q tau\n"), NAMES),
        (text_of("  ", head="t   q tau\n"), NAMES),
        (text_of(" ", head="# t q tau\n"), NAMES),
        (text_of(",", head="% t, q, tau\n"), NAMES),
        (text_of(",", head="\n# ramp\n# kp=1,kd=2\nt,q,tau\n"), NAMES),
        (text_of(" ", head="# made by a bench\n# t q tau\n"), NAMES),
        (text_of(";", ",", head='"t";"q";"tau"\n'), NAMES),
        (text_of(";", head="t, in s;q;tau\n"), ["t, in s", "q", "tau"]),
        (text_of(",", head="0,1,2\n"), ["0", "1", "2"]),
        (text_of(","), ["1", "2", "3"]),
        (text_of(";", ","), ["1", "2", "3"]),
        (text_of("\t"), ["1", "2", "3"]),
        (text_of("   "), ["1", "2", "3"]),
        (text_of(" ", ","), ["1", "2", "3"]),
        (text_of(",", head="# made by a bench\n# on a Monday\n"), ["1", "2", "3"]),
        (text_of("|", head="t|q|tau\n"), NAMES),
        (text_of(",", head="t,|q|,tau\n"), ["t", "|q|", "tau"]),
        (text_of(";", ",", head="sep=;\nt;q;tau\n"), NAMES),
        (text_of(",", head='"sep=,"\n'), ["1", "2", "3"]),
        (text_of(",", head="t,q,tau\ns,rad,Nm\n"), ["t [s]", "q [rad]", "tau [Nm]"]),
        (text_of(";", ",", head="t;q;tau\n[s];;(Nm)\n"), ["t [s]", "q", "tau [Nm]"]),
    ],
)
@pytest.mark.parametrize("suffix", [".csv", ".txt"])
def test_a_table_of_text_is_read_in_its_own_format(
    tmp_path: Path, content: str, names: list[str], suffix: str
) -> None:
    path = tmp_path / f"log{suffix}"
    path.write_text(content)
    table = open_table(path)
    assert table.names == names
    assert table.blocks is not None
    parts = list(table.blocks(names, 60))
    assert [len(one[names[0]]) for one in parts] == [60, 60, 60, 20]
    for place, name in enumerate(names):
        np.testing.assert_allclose(table.load([name])[name], ROWS[:, place], atol=1e-6)
        np.testing.assert_allclose(
            np.concatenate([one[name] for one in parts]), ROWS[:, place], atol=1e-6
        )


def test_words_for_a_missing_number_are_none(tmp_path: Path) -> None:
    path, words = tmp_path / "log.csv", ("NA", "n/a", "#N/A", "null", "None", "nan", "")
    path.write_text("a,b\n1,2\n" + "".join(f"{word},3\n" for word in words))
    values = open_table(path).load(["a"])["a"]
    assert np.array_equal(np.isnan(values), [False, *[True] * len(words)])
    for cell, remedy in (("lost", ": empty it if nothing"), ('"2,5"', "; write a decimal point")):
        path.write_text(f"a,b\n1,2\n{cell},3\n")
        with pytest.raises(LogError, match=f"which is not a number{remedy}"):
            open_table(path).load(["a"])


def test_a_line_of_truths_dates_or_nothing_is_none_of_units(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    for line in ("true,False", "NaN,", ",", "12:00:01,x", '"[1, 2]",x', "left"):
        path.write_text(f"a,b\n{line}\n1,2\n")
        assert not any("[true]" in name or "[x]" in name for name in open_table(path).names)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            b"a,b\n1,2\n" + bytes(40) + b"\n",
            "line 3: has zero bytes, as a file that was not written",
        ),
        (b"version https://git-lfs.github.com/spec/v1\nsize 12\n", "fetch the file with git lfs"),
        (b"a,b\nleft\n1,2\n", "line 2 has 1 cells"),
    ],
)
def test_a_file_that_is_not_whole_is_named(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(LogError, match=words):
        open_table(path).load(["a", "b"])


def test_one_number_a_line_is_one_column(tmp_path: Path) -> None:
    (tmp_path / "q.txt").write_text("\n".join(map(str, ROWS[:, 1])))
    np.testing.assert_allclose(open_table(tmp_path / "q.txt").load(["1"])["1"], ROWS[:, 1])


def test_columns_of_a_file_without_header_are_described_by_their_numbers(
    arm: Robot, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text_of(";", ","))
    description = {
        "time": 1,
        "joints": {"arm": {"joint_position": {"column": 2, "unit": "deg"}, "motor_torque": 3}},
    }
    log = read_log(path, arm, description=description)
    np.testing.assert_allclose(log.joint_position[:, 0], np.deg2rad(ROWS[:, 1]), atol=1e-6)
    (tmp_path / "log.toml").write_text(
        'time = { column = 1 }\n[joints.arm]\njoint_position = { column = 2, unit = "deg" }\n'
        "motor_torque = 3\n"
    )
    np.testing.assert_array_equal(read_log(path, arm).motor_torque, log.motor_torque)
    with pytest.raises(LogError, match=r"no column is named '4'.*the first line is numbers: no he"):
        read_log(path, arm, description={**description, "time": 4})
    with pytest.raises(
        LogError, match=r"no column looks like.*the first line is numbers: no heade"
    ):
        describe_log(path)


def test_a_line_with_a_number_too_many_is_named_without_a_header(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("1.5,2\n3,4,5\n")
    with pytest.raises(LogError, match="line 2 has 3 cells, the first line 2 numbers"):
        open_table(tmp_path / "log.csv").load(["1"])


@pytest.mark.slow  # 2.4 s
@pytest.mark.parametrize("version", ["5", "4", "7.3"])
def test_a_matlab_file_is_read(arm: Robot, tmp_path: Path, version: str) -> None:
    path = tmp_path / "run.mat"
    if version == "7.3":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w", userblock_size=512) as file:
            file["t"] = TIME[None, :]
            file["log/q"] = ROWS.T
            file["#refs#/a"] = 1.0
        content = path.read_bytes()
        head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
        path.write_bytes(head.ljust(512, b"\0") + content[512:])
    elif version == "5":
        io.savemat(path, {"t": TIME, "log": {"q": ROWS}, "name": "a text", "n": 3})
    else:
        io.savemat(path, {"t": TIME[:, None], "log": ROWS}, format="4")
    names = open_table(path).names
    q = "log" if version == "4" else "log.q"
    assert set(names) == {"t", f"{q}[0]", f"{q}[1]", f"{q}[2]"}
    description = {
        "time": "t",
        "joints": {"arm": {"joint_position": f"{q}[1]", "motor_torque": f"{q}[2]"}},
    }
    log = read_log(path, arm, description=description)
    np.testing.assert_allclose(log.joint_position[:, 0], ROWS[:, 1])


@pytest.mark.slow  # 0.7 s
def test_a_matlab_file_without_numbers_or_damaged_is_named(tmp_path: Path) -> None:
    io.savemat(tmp_path / "run.mat", {"name": "a text"})
    with pytest.raises(LogError, match=r"has no array of numbers, found: name; save arrays of num"):
        open_table(tmp_path / "run.mat")
    (tmp_path / "run.mat").write_bytes(b"junk" * 100)
    with pytest.raises(LogError, match="is not a MATLAB file, or a damaged one"):
        open_table(tmp_path / "run.mat")


def test_lists_in_cells_are_a_column_per_number(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(
        'kind,t,positions,ok,"raw [V]"\nSTATE,0.5,"[0.25, -1e-3, 3]",true,[7 8]\n'
        'STATE,1.0,"[0.5, nan, 4]",false,[9 10]\n'
    )
    table = open_table(path)
    assert table.names == [
        *("t", "positions[0]", "positions[1]", "positions[2]", "ok", "raw [V][0]", "raw [V][1]")
    ]
    found = table.load(["positions[2]", "t", "raw [V][1]", "ok", "positions[1]"])
    assert found["positions[2]"].tolist() == [3, 4]
    assert found["raw [V][1]"].tolist() == [8, 10]
    assert found["ok"].tolist() == [1, 0]
    assert found["positions[1]"][0] == -1e-3
    assert np.isnan(found["positions[1]"][1])


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('2,"[1, 2]"', r"line 3: column 'q' has '\[1, 2\]', and a list of 3 numbers before"),
        ("2,5", r"line 3: column 'q' has '5', and a list of 3 numbers before"),
        ('2,"[1, x, 2]"', r"line 3: column 'q\[1\]' has 'x', which is not a number"),
        ('2,"[1, 2, 3]",4', r"line 3 has 3 cells, the first line 2 column names"),
    ],
)
def test_other_lists_are_named(tmp_path: Path, line: str, words: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(f't,q\n1,"[1, 2, 3]"\n{line}\n')
    with pytest.raises(LogError, match=words):
        open_table(path).load(["t", "q[1]"])


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        ("t,q\n0,1,7\n0.1,2,8\n", {"t": 0.1, "q": 2, "unnamed": 8}),
        ('t,q\n"1",0,1\n"2",0.1,2\n', {"t": 0.1, "q": 2, "unnamed": 2}),  # written by R
        ("t,q\n[s],[rad]\n0,1,7\n0.1,2,8\n", {"t [s]": 0.1, "q [rad]": 2, "unnamed": 8}),
    ],
)
def test_a_cell_more_than_names_is_an_unnamed_column(
    rows: str, columns: dict[str, float], tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(rows)
    table = open_table(path)
    loaded = table.load(list(table.names))
    assert {name: values[-1] for name, values in loaded.items()} == columns
