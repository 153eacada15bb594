"""HEBI logs: measured ones, with bytes between records."""

from pathlib import Path

import numpy as np
import pytest

from seaid.log.readers.opening import open_table

HEBI_X5 = Path(__file__).parents[3] / "models/logs/hebi_x5_unloaded/exampleLog.hebilog"


@pytest.mark.hebi
def test_a_hebi_log_with_bytes_between_its_records_is_read_whole(tmp_path: Path) -> None:
    """HEBI's own reader passes over them, too."""
    path, whole = tmp_path / "log.hebilog", HEBI_X5.read_bytes()
    place = whole.index(b"\x73\xb1\x00\x04")
    path.write_bytes(whole[:place] + bytes(8) + whole[place:])
    columns = ["motor_position[0]", "time[0]"]
    for name, values in open_table(HEBI_X5).load(columns).items():
        np.testing.assert_array_equal(open_table(path).load(columns)[name], values)
