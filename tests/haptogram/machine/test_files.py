from __future__ import annotations

import os
import stat
import threading
from pathlib import Path

import pytest

from haptogram.errors import ConfigurationError
from haptogram.machine.files import check_file_writable, write_file_atomically


def test_a_file_is_written_into_a_folder_that_is_made_for_it(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "down" / "result.json"
    write_file_atomically(path, b"new")
    assert path.read_bytes() == b"new"
    assert os.listdir(path.parent) == ["result.json"]


def test_the_file_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "other").write_bytes(b"")
    write_file_atomically(tmp_path / "result", b"new")
    modes = {stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("other", "result")}
    assert len(modes) == 1


def test_a_failing_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "result.json"
    path.write_bytes(b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ConfigurationError, match=r"result\.json: .*No space left on device"):
        write_file_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["result.json"]


def test_a_path_below_a_file_is_refused_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(ConfigurationError, match=r"file/result\.json: cannot be written: "):
        write_file_atomically(tmp_path / "file" / "result.json", b"new")


def test_a_folder_is_not_replaced(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot be written"):
        write_file_atomically(tmp_path, b"new")
    assert os.listdir(tmp_path) == []


def test_a_path_with_a_null_character_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="cannot be written"):
        write_file_atomically(Path("a\0b"), b"new")


def test_a_link_keeps_pointing_to_the_result(tmp_path: Path) -> None:
    link, path = tmp_path / "link", tmp_path / "result"
    link.symlink_to(path)
    write_file_atomically(link, b"new")
    assert link.is_symlink()
    assert path.read_bytes() == b"new"


def test_what_is_no_regular_file_is_written_to_and_stays() -> None:
    write_file_atomically(Path(os.devnull), b"new")
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)


def test_a_named_pipe_keeps_its_reader_through_the_check(tmp_path: Path) -> None:
    path, read = tmp_path / "pipe", []
    os.mkfifo(path)
    reader = threading.Thread(target=lambda: read.append(path.read_bytes()), daemon=True)
    reader.start()
    check_file_writable(path)
    write_file_atomically(path, b"all of it")
    reader.join(10.0)
    assert read == [b"all of it"]
