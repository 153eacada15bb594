"""What fits into memory."""

from pathlib import Path

import pytest

import seaid.log.readers.table as limits
from seaid.errors import LogError
from seaid.log.readers.table import free_memory


def test_what_fits_depends_on_the_memory_and_on_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.npz"
    path.write_bytes(bytes(1000))
    limits.check_memory(path, 1e8)
    with pytest.raises(LogError, match="declares 2 GB of samples, more than 20 times its size"):
        limits.check_memory(path, 2e9)
    monkeypatch.setattr(limits, "free_memory", lambda: 1e8)
    with pytest.raises(LogError, match=r"takes 0\.1 GB of memory, too much for the 0\.1 GB"):
        limits.check_memory(path, 1e8)


def test_free_memory_is_also_what_the_limit_of_the_process_leaves() -> None:
    resource = pytest.importorskip("resource")
    old = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (60 * 10**9, old[1]))
    try:
        assert free_memory() < 60e9
    finally:
        resource.setrlimit(resource.RLIMIT_AS, old)


def test_free_memory_is_what_the_machine_says() -> None:
    assert 1e6 < free_memory() < 1e14
