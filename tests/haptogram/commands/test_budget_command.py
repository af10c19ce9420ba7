"""``haptogram budget --dialect``: frames of other boards over their lines."""

import pytest

from dialect_boards import EXPECTED, capture, dialect_of
from haptogram.cli import main
from haptogram_protocol.dialects.table import DIALECTS

SERIAL = [name for name, dialect in DIALECTS.items() if dialect.bauds]
# Boards on the line, and bytes that the client adds to a frame: amplitudes, off-frames first.
OTHERWISE = {
    "ultraino/chainedfpga_512_ramp": (2, 0),
    "ultraino/simplefpga_ss_amp50_0_120_0": (1, 257),
    "ultraino/megaanim_flat8x8_focus": (1, -4),  # one duration
    "interactlab/levitate_focus_0_0_100": (1, 512),
    "interactlab/levitate_off": (1, 512),
    "sonicsurface/commit": (1, -257),
    "sonicsurface/two_foci_then_4_commits": (1, 258 + 4),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_a_frame_is_as_long_as_its_clients_send_it(name):
    boards, more = OTHERWISE.get(name, (1, 0))
    dialect = DIALECTS[dialect_of(name)[0]]
    assert len(capture(name)) == dialect.frame_bytes(boards) + more


@pytest.mark.parametrize("name", SERIAL)
def test_the_verdict_follows_from_bytes_and_baud(name, capsys):
    dialect = DIALECTS[name]
    most_hz = dialect.bauds[0] / 10 / dialect.frame_bytes(1)
    assert main(["budget", "--dialect", name, "--rate-hz", f"{most_hz * 0.99}"]) == 0
    assert main(["budget", "--dialect", name, "--rate-hz", f"{most_hz * 1.01}"]) == 1
    said = capsys.readouterr().out
    assert f"{most_hz:.1f} frames/s at most" in said
    assert all(str(baud) in said for baud in dialect.bauds)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--dialect", "sonicsurfac"], "sonicsurface"),
        (["--dialect", "autd3"], "no serial line"),
        (["--dialect", "sonicsurface", "--transducers", "8"], "--transducers"),
        (["--boards", "2"], "--dialect"),
    ],
)
def test_what_makes_no_sense_is_refused(words, says, capsys):
    assert main(["budget", *words]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
