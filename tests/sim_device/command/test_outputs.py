"""What a board does with the places that it is to write to, option by option."""

import argparse
import subprocess
import sys
from pathlib import Path

import pytest

from haptogram.cli.boards import open_recording_of_board
from haptogram.errors import ConfigurationError
from haptogram.settings.parser import Parser
from sim_device.command import command, options
from sim_device.line.socket_server import UnixListener

OUTPUTS = ("--backdoor", "--record", "--capture")
PLACES = ("--link", *OUTPUTS)


def board(*words):
    return command.main([*words, "--array", "4x4"], open_recording=open_recording_of_board)


def listening(option):
    return () if option == "--link" else ("--tcp", "0")


def named_places():
    """Return every option of the board whose value is a place: by its name in the help."""
    parser = Parser(prog="board")
    options.set_up_board(parser, open_recording_of_board)
    actions = [a for a in parser._actions if isinstance(a, argparse._StoreAction)]  # noqa: SLF001
    return [a.option_strings[0] for a in actions if a.metavar and is_place(a.metavar)]


def is_place(metavar):
    return any(word in metavar for word in ("PATH", "PORT", "FILE"))


def test_every_output_is_a_place():
    assert {*PLACES, "--tcp", "--serial"} <= set(named_places())


@pytest.mark.parametrize(
    ("option", "name"), [*((option, "") for option in named_places()), ("--backdoor", "unix:")]
)
def test_an_empty_name_is_refused(option, name, capsys):
    port = () if option in ("--tcp", "--serial") else listening(option)
    assert board(*port, option, name) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert f"{option} is {name!r}, must be " in said[0]


@pytest.mark.parametrize("name", ["-", "/dev/stdout"])
@pytest.mark.parametrize("option", PLACES)
def test_standard_output_is_no_place_for_a_board(option, name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert board(*listening(option), option, name) == 2
    told = f"{option} {name}: standard output names the port; name a file\n"
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", OUTPUTS)
def test_a_folder_and_a_place_below_a_file_are_refused(option, tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    for place, why in (
        ("", "it is a folder; name a file"),
        ("file/x", "a folder of its path is a file"),
    ):
        assert board("--tcp", "0", option, str(tmp_path / place)) == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1
        assert f"{option} '{tmp_path / place}' cannot be written: {why}" in said[0]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("option", [*OUTPUTS, "unix"])
def test_a_new_folder_is_made_and_told_before_the_board_starts(option, tmp_path, caplog):
    caplog.set_level("INFO")
    path = tmp_path / "new" / "place"
    words = ("--backdoor", f"unix:{path}") if option == "unix" else (option, str(path))
    # A port that cannot be opened ends the board behind the check, and before its work.
    assert board("--serial", "/dev/no-such-port", *words) == 2
    assert caplog.text.count(f"{path.parent}: a new folder, made for what is written") == 1
    assert path.parent.is_dir()


def test_a_socket_that_cannot_be_is_refused_in_plain_words(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file" / "x", Path("/proc/none/x")):
        told = f"^backdoor unix:{place}: cannot listen there: "
        with pytest.raises(ConfigurationError, match=told) as refusal:
            UnixListener(str(place))
        assert "Errno" not in str(refusal.value)


def test_a_link_on_a_full_disk_is_refused_and_leaves_nothing(tmp_path):
    path = tmp_path / "board"
    code = (
        "import resource, signal, sys\n"
        "from pathlib import Path\n"
        "from haptogram.errors import ConfigurationError\n"
        "from sim_device.line.pty_link import PtyLink\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n"
        "try:\n    PtyLink(Path(sys.argv[1]))\n"
        "except ConfigurationError as error:\n    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, path], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"link '{path}' cannot be made: file too large\n"
    assert list(tmp_path.iterdir()) == []
