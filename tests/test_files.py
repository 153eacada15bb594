"""Files appear whole or not at all."""

import os
from pathlib import Path

import pytest

from seaid.errors import SeaidError
from seaid.files import whole_file


def test_file_appears_at_the_end_and_nothing_else_stays(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "out.csv"
    with whole_file(path) as temporary:
        temporary.write_text("whole")
        assert not path.exists()
        assert temporary.parent == path.parent
        assert temporary.suffix == path.suffix
    assert path.read_text() == "whole"
    assert os.listdir(path.parent) == ["out.csv"]


@pytest.mark.parametrize("error", [ValueError("no"), KeyboardInterrupt(), SeaidError("no")])
def test_old_file_stays_where_writing_fails(tmp_path: Path, error: BaseException) -> None:
    path = tmp_path / "out.json"
    path.write_text("old")
    with pytest.raises(type(error)), whole_file(path) as temporary:
        temporary.write_text("half of the ne")
        raise error
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["out.json"]


def test_full_disk_is_said_with_path_and_advice(tmp_path: Path) -> None:
    path = tmp_path / "out.json"
    path.write_text("old")
    with pytest.raises(SeaidError) as caught, whole_file(path) as temporary:
        temporary.write_text("half")
        raise OSError(28, "No space left on device")
    assert str(caught.value) == (
        f"cannot write '{path}': No space left on device; make room, or name a folder on another "
        "disk"
    )
    assert path.read_text() == "old"


def test_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    path = tmp_path / "file" / "out.json"
    with pytest.raises(SeaidError, match="name a folder you may write to"), whole_file(path):
        pass


def test_path_that_is_a_folder_is_said(tmp_path: Path) -> None:
    (tmp_path / "out.json").mkdir()
    path = tmp_path / "out.json"
    with pytest.raises(SeaidError, match="json': Is a directory"), whole_file(path) as temporary:
        temporary.write_text("text")
    assert os.listdir(tmp_path) == ["out.json"]


def test_folder_without_permission_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "replace", refuse)  # root, who may run this, may write everywhere
    path = tmp_path / "out.json"
    with pytest.raises(SeaidError, match="Permission denied; name"), whole_file(path) as temporary:
        temporary.write_text("text")
    assert os.listdir(tmp_path) == []
