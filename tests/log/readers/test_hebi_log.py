"""HEBI logs: cut off, with bytes between records, and measured ones."""

import struct
from pathlib import Path

import numpy as np
import pytest

import seaid.log.readers.hebi_log as hebi_log
from seaid.log.readers.opening import open_table
from tests.log.readers.files import error_of

HEBI_X5 = Path(__file__).parents[3] / "models/logs/hebi_x5_unloaded/exampleLog.hebilog"


def hebilog(samples: int = 3) -> bytes:
    """Return what stands around the messages of a HEBI log of two modules."""
    address = struct.pack(">II", 0x4119, 1)
    message = address + struct.pack(">I", 10) + bytes(8) + b"x" * 10
    return (
        struct.pack(">HHI", 0x73B1, 2, 2)
        + 2 * address
        + struct.pack(">HHQ", 0x73B1, 4, 5)
        + samples * (struct.pack(">HH", 0x73B1, 1) + message)
    )


def test_bytes_between_the_records_of_a_hebi_log_are_no_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are passed over, and what ends within a record is cut off."""
    monkeypatch.setattr(hebi_log, "check_installed", lambda *_: None)
    monkeypatch.setattr(hebi_log, "read_in_child", lambda *_, **__: (2, {}))
    path, whole = tmp_path / "log.hebilog", hebilog()
    for place in (24, 36, 70, len(whole)):  # behind the modules, the start, a sample, all
        more = whole[:place] + b"\0\0\0\x01\x73\xb1\xff\xfe" + whole[place:]
        path.write_bytes(more)
        assert len(open_table(path).names) == 36
        if place < len(whole):
            for cut in (1, 20, 33):
                path.write_bytes(more[:-cut])
                assert f"the file has {len(more) - cut} bytes" in error_of(path)


@pytest.mark.hebi
def test_a_hebi_log_with_bytes_between_its_records_is_read_whole(tmp_path: Path) -> None:
    """HEBI's own reader passes over them, too."""
    path, whole = tmp_path / "log.hebilog", HEBI_X5.read_bytes()
    place = whole.index(b"\x73\xb1\x00\x04")
    path.write_bytes(whole[:place] + bytes(8) + whole[place:])
    columns = ["motor_position[0]", "time[0]"]
    for name, values in open_table(HEBI_X5).load(columns).items():
        np.testing.assert_array_equal(open_table(path).load(columns)[name], values)
