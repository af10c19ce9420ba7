from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from haptogram.errors import ConfigurationError
from haptogram.machine.files import (
    Kind,
    check_distinct_files,
    check_file_writable,
    kind_of_file,
    make_folder_of,
    write_file_atomically,
    write_json_file,
)


def test_a_file_is_written_into_a_folder_that_is_made_for_it(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "down" / "result.json"
    write_file_atomically(path, b"new")
    assert path.read_bytes() == b"new"
    assert os.listdir(path.parent) == ["result.json"]


def test_a_folder_that_another_process_makes_meanwhile_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Path, "exists", lambda _: False)  # as it was a moment ago
    make_folder_of(tmp_path / "result")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(NotADirectoryError):
        make_folder_of(tmp_path / "file" / "result")


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
    with pytest.raises(ConfigurationError, match=r"result\.json' cannot be written: the disk"):
        write_file_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["result.json"]


def test_a_path_below_a_file_is_refused_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(ConfigurationError, match=r"file/result\.json' cannot be written: a"):
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


#: Kinds of places, and how each comes to be in a folder.
PLACES = {
    Kind.FILE: lambda path: path.write_bytes(b"old"),
    Kind.FOLDER: lambda path: path.mkdir(),
    Kind.PIPE: os.mkfifo,
    Kind.DEVICE: lambda path: path.symlink_to(os.devnull),
}


@pytest.mark.parametrize("kind", PLACES)
@pytest.mark.parametrize("is_link", [False, True])
def test_the_kind_is_that_of_what_a_path_leads_to(
    kind: Kind, is_link: bool, tmp_path: Path
) -> None:
    path = tmp_path / "place"
    PLACES[kind](path)
    if is_link:
        (tmp_path / "link").symlink_to(path)
        path = tmp_path / "link"
    assert kind_of_file(path) is kind


def test_what_is_not_there_yet_is_a_file(tmp_path: Path) -> None:
    assert kind_of_file(tmp_path / "new") is Kind.FILE
    (tmp_path / "link").symlink_to(tmp_path / "new")
    assert kind_of_file(tmp_path / "link") is Kind.FILE


SHOW = (
    "import sys; from pathlib import Path; "
    "from haptogram.machine.files import kind_of_file, write_file_atomically\n"
    "for name in sys.argv[1:]: print(kind_of_file(Path(name)).value, file=sys.stderr)\n"
)


@pytest.mark.parametrize("is_pipe", [False, True])
def test_standard_output_is_known_by_every_name(is_pipe: bool, tmp_path: Path) -> None:
    out = tmp_path / "out"
    names = ["-", "/dev/stdout", *([] if is_pipe else [str(out), "/dev/null"])]
    with out.open("wb") as file:
        target = subprocess.PIPE if is_pipe else file
        done = subprocess.run(
            [sys.executable, "-c", SHOW, *names], stdout=target, stderr=subprocess.PIPE, check=True
        )
    told = done.stderr.decode().splitlines()
    assert told == ["standard output"] * (len(names) - (not is_pipe)) + ["device"] * (not is_pipe)


def test_text_and_result_to_one_file_lose_neither(tmp_path: Path) -> None:
    out = tmp_path / "out"
    code = (
        "import sys; from pathlib import Path\n"
        "from haptogram.machine.files import write_file_atomically\n"
        "print('text'); write_file_atomically(Path(sys.argv[1]), b'result\\n'); print('more')\n"
    )
    with out.open("wb") as file:
        subprocess.run([sys.executable, "-c", code, str(out)], stdout=file, check=True)
    assert out.read_text() == "text\nresult\nmore\n"


def test_a_check_leaves_no_file_and_touches_none(tmp_path: Path) -> None:
    (tmp_path / "old").write_bytes(b"old")
    for name in ("old", "new", "deep/new"):
        check_file_writable(tmp_path / name)
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"old": b"old"}


def test_json_is_ascii_of_one_form_and_refuses_what_is_no_number(tmp_path: Path) -> None:
    write_json_file(tmp_path / "a.json", {"é": [1.5, None]})
    assert (tmp_path / "a.json").read_bytes() == (
        b'{\n  "\\u00e9": [\n    1.5,\n    null\n  ]\n}\n'
    )
    with pytest.raises(ValueError, match="Out of range"):
        write_json_file(tmp_path / "b.json", {"x": float("nan")})
    assert not (tmp_path / "b.json").exists()


def test_two_names_of_one_file_are_one_file(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    one, other = tmp_path / "folder" / "a.json", tmp_path / "link" / "a.json"
    with pytest.raises(ConfigurationError, match="--json and --html are both the same file"):
        check_distinct_files({"--json": one, "--html": other})
    check_distinct_files({"--json": one, "--html": tmp_path / "link" / "b.json"})
    check_distinct_files({"--json": Path(os.devnull), "--html": Path(os.devnull)})


def test_a_link_to_a_device_is_no_file_that_two_may_not_share(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(os.devnull)
    check_distinct_files({"--json": tmp_path / "link", "--html": Path(os.devnull)})
