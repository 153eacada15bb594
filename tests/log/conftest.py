"""Fixtures for the tests of log files."""

from pathlib import Path

import pytest

from seaid.robot import Robot
from tests.one_joint import one_joint


@pytest.fixture
def arm(tmp_path: Path) -> Robot:
    return one_joint(tmp_path, "continuous")
