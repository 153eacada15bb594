"""The command line where its streams, its folder or its arguments are not as usual."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.representatives import quick_first

ROOT = Path(__file__).parents[2]
TULIP = ROOT / "models" / "tulip_leg.urdf"


def shell(line: str, folder: Path, **environment: str) -> tuple[int, bytes, bytes]:
    """Run a line of bash in which `seaid` is the command line of this tree."""
    command = f"{shlex.quote(sys.executable)} -m seaid"
    done = subprocess.run(
        ["bash", "-c", f'set -o pipefail; seaid() {{ {command} "$@"; }}\n{line}'],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        timeout=60,
    )
    return done.returncode, done.stdout, done.stderr


def test_full_output_is_said_in_one_line(tmp_path: Path) -> None:
    code, _, error = shell("seaid describe --help > /dev/full", tmp_path)
    assert (code, error) == (1, b"Error: cannot write the output: No space left on device\n")


@pytest.mark.slow  # 1.7 s
@pytest.mark.parametrize(
    ("line", "code"),
    quick_first(  # a process each; those after the first load what a command needs
        [
            ("seaid --help | true", 1),
            ("seaid --help >&-", 0),
            ("seaid --version >&- 2>&- <&-", 0),
            ("seaid compare nothing.json 2> /dev/full", 1),
            ("seaid inspect nothing.urdf 2> /dev/full", 1),
            ("seaid inspect nothing.urdf > /dev/full 2>&1", 1),
            ("seaid inspect nothing.urdf 2>&-", 1),
        ],
        4,
    ),
)
def test_streams_that_are_closed_or_lost_end_it_quietly(
    tmp_path: Path, line: str, code: int
) -> None:
    found, out, error = shell(line, tmp_path)
    assert (found, out, error) == (code, b"", b"")


@pytest.mark.slow  # base parameters by a command, and a second one
def test_a_path_that_is_no_text_is_read_and_named(tmp_path: Path) -> None:
    path = os.fsencode(tmp_path) + b"/caf\xe9.urdf"
    Path(os.fsdecode(path)).write_bytes(TULIP.read_bytes())
    line = "seaid inspect $'caf\\xe9.urdf'; seaid inspect $'no\\xe9.urdf' >&2"
    code, out, error = shell(line, tmp_path, PYTHONIOENCODING="utf-8:strict")
    assert out.startswith(b"tulip_leg: ")
    assert error.startswith(b"Error: no URDF file at 'no\\udce9.urdf' (working folder ")
    assert (code, error.count(b"\n")) == (1, 1)


@pytest.mark.slow  # 1.7 s
def test_a_plain_terminal_gets_letters_it_has_not_as_others(tmp_path: Path) -> None:
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "TERM": "dumb"}
    head = "time,höhe_position\n"
    (tmp_path / "é.csv").write_text(head + "".join(f"{n},{n}\n" for n in range(60)))
    code, out, error = shell("seaid describe é.csv", tmp_path, NO_COLOR="1", **plain)
    assert code == 0, error
    assert b"Traceback" not in error
    assert b"\x1b" not in out + error
