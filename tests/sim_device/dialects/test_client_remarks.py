"""What a board says of its client: another wire, another array, a frame that stops."""

import pytest

from dialect_boards import SENT, DialectBoard
from haptogram_protocol.dialects.looks_like import looks_like_dialect
from haptogram_protocol.dialects.table import DIALECTS
from sim_device.board.events import ClientLeft, WireCompared

pytestmark = pytest.mark.sampled(4)

every_dialect = pytest.mark.parametrize("name", DIALECTS)
SILENCE_US = 600_000
COMMITS = {
    name: "FDh" if "fpga" in name or "sonicsurface" in name else "00h"
    for name in DIALECTS
    if name not in ("interactlab", "autd3")
}
STARTED_US = 1_100_000  # an InteractLab board takes no frame in its first second
#: Wires whose frames a board of another dialect takes as they are.
SAME_FRAMES = {
    "sonicsurface-tactile": {"sonicsurface", "ultraino-fpga"},
    "ultraino-fpga-chained": {"sonicsurface", "ultraino-fpga"},
}


def started(name):
    board = DialectBoard(name)
    board.pass_us(STARTED_US)
    return board


def said_of(board, *lines, gap_us=0):
    """Return what is said of a client that sends *lines* and leaves."""
    before = len(board.remarks)
    for line in lines:
        board.send(line)
        board.pass_us(gap_us)
    board.simulation.unplug()
    return board.remarks[before:]


@pytest.mark.sampled(2)
@every_dialect
@pytest.mark.parametrize("gap_us", [0, SILENCE_US])
def test_every_other_wire_is_told_once_and_nothing_is_said_of_its_frames(name, gap_us):
    board = started(name)
    for wire, line in SENT.items():
        repeated = [line] if wire == "autd3" else [line] * 3  # one handshake a client
        said = said_of(board, *repeated, gap_us=gap_us)
        names = looks_like_dialect(line)
        if name in names or wire in SAME_FRAMES.get(name, ()):
            assert said == [], wire
        else:
            start = f"these bytes look like {' or '.join(names)}, not {name}"
            assert [text[: len(start)] for text in said] == [start], wire
        assert wire in names


def cuts(name):
    """Return where the frames of a client are cut: behind few bytes, in the middle, at the end."""
    size = 512 if name == "interactlab" else len(SENT[name])
    if name == "autd3":  # handshake, geometry, frame
        return [1, 3, 20, 100]
    # The first byte of some selects a board, or a modulation, and no more.
    least = 2 if name in ("ultraino-fpga-chained", "sonicsurface-tactile") else 1
    places = {least, 2, 3, 50, 199, 205, 257, size // 2, size - 2, size - 1}
    return sorted(cut for cut in places if least <= cut < size)


def lacks_only_its_commit(name, cut):
    """Return True if the first *cut* bytes of a frame are all that the boards need but one."""
    if name == "ultraino-fpga-chained":
        return cut in (257, 514)  # of one board, of both
    if name == "ultraino-mega64":
        return cut in (208, 209)  # without the command behind the durations, and with it
    return name in COMMITS and cut == len(SENT[name]) - 1


@every_dialect
def test_a_client_that_is_killed_in_mid_frame_is_told_and_no_cause_is_guessed(name):
    board = started(name)
    frame = SENT[name]
    for number, cut in enumerate(cuts(name), start=1):
        assert said_of(board, frame) == [], cut
        (told,) = said_of(board, frame[:cut])
        if lacks_only_its_commit(name, cut):
            assert told == f"the client left before the commit ({COMMITS[name]}) of a whole frame"
        else:
            bytes_of_frame = cut - (name == "sonicsurface-tactile")  # the step comes before it
            came = "1 byte came" if bytes_of_frame == 1 else f"{bytes_of_frame} bytes came"
            told_bytes = "" if name == "autd3" else f"{came}; a frame has "
            assert told.startswith(f"a frame stops in its middle: {told_bytes}"), cut
        assert board.simulation.dialect.counters["frames_unfinished"] == number
        # The next client's first frame may be torn by it; that shows no other array.
        said = said_of(board, *[frame] * (1 if name == "autd3" else 3), gap_us=50_000)
        assert said == [], cut
        board.pass_us(STARTED_US)


@every_dialect
def test_a_client_that_falls_silent_in_mid_frame_is_told(name):
    board = DialectBoard(name)
    start = {"interactlab": b"\x80", "autd3": b"\x10\x01"}.get(name, b"\xfe\x11\x11\x11")
    board.send(start)
    board.pass_us(3_000_000)
    assert [text for text in board.remarks if "stops in its middle" in text]
    assert board.simulation.dialect.counters["frames_unfinished"] == 1
    board.simulation.unplug()
    board.send(start)


SHORT = "a frame ends before the last channel"
BEYOND = "a frame has more codes than the board has channels"
ARRAYS = [
    ("sonicsurface", b"\xfe" + bytes(64) + b"\xfd", SHORT, "a smaller array"),
    ("sonicsurface", b"\xfe" + bytes(300) + b"\xfd", BEYOND, "a larger array"),
    ("sonicsurface", b"\xfe" + bytes([100] * 256) + b"\xfd", "codes beyond", "more steps"),
    ("ultraino-fpga-128", b"\xfe" + bytes(100) + b"\xfd", BEYOND, "a larger array"),
    ("ultraino-fpga-chained", b"\xc0" + bytes(9) + b"\xfd", SHORT, "a smaller array"),
    ("ultraino-mega64", bytes([0x51] * 90) + b"\x00", SHORT, "a smaller array"),
    (
        "ultraino-mega64",
        bytes([0x51] * 200 + [0x52] * 200) + b"\x00",
        "bytes for a board",
        "a longer chain",
    ),
]


@pytest.mark.parametrize(("name", "line", "fact", "cause"), ARRAYS)
def test_another_array_is_told_when_frame_after_frame_is_alike(name, line, fact, cause):
    board = started(name)
    (told,) = said_of(board, line)
    assert told.startswith(fact)
    assert "the client has" not in told  # of one frame
    (told,) = said_of(board, *[line] * 20)
    assert told.startswith(fact)
    assert f": the client has {cause}" in told
    assert "\n" not in told


@pytest.mark.parametrize(
    "lines",
    [
        # frames that lost bytes: not alike, or hardly smaller
        [b"\xfe" + bytes(64 + n) + b"\xfd" for n in range(9)],
        [b"\xfe" + bytes(250) + b"\xfd"] * 9,
        # one whole frame among them
        [b"\xfe" + bytes(64) + b"\xfd"] * 2 + [b"\xfe" + bytes(256) + b"\xfd"] * 2,
        # whatever else is strange as well
        [b"\xfe" + bytes([77] * 64) + b"\xfd"] * 9,
        [b"\xfe" + bytes(256) + b"\xfb" + bytes(256) + b"\xfd"] * 9,  # amplitudes fall through
    ],
)
def test_a_cause_that_is_not_proven_is_not_named(lines):
    said = said_of(started("ultraino-fpga"), *lines)
    assert said
    assert not [text for text in said if "the client has" in text]


def without_end(name, count=1):
    return SENT[name][:-count]


FOLLOW = "frames follow each other without a commit ({}), which shows one"


@pytest.mark.parametrize("name", COMMITS)
@pytest.mark.parametrize("gap_us", [0, 20_000, SILENCE_US])
def test_a_client_that_never_commits_is_told_while_it_runs(name, gap_us):
    """Bytes enough for a comparison with other wires, or a silence, are enough."""
    board = started(name)
    for _ in range(2 if gap_us == SILENCE_US else 1 + 4096 // len(without_end(name))):
        board.send(without_end(name))
        board.pass_us(gap_us)
    follow = FOLLOW.format(COMMITS[name])
    waits = f"a whole frame waits for its commit ({COMMITS[name]}), which shows it"
    assert board.remarks == ([waits, follow] if gap_us == SILENCE_US else [follow])
    assert "swap" not in [latch.cause for latch in board.latches]
    assert any(isinstance(notice, WireCompared) and notice.is_own for notice in board.notices)


@pytest.mark.parametrize("name", COMMITS)
def test_a_single_missing_commit_is_counted_by_frames(name):
    board = started(name)
    said = said_of(board, SENT[name], without_end(name), SENT[name])
    assert said == ["a frame came before the one ahead of it was shown: its commit is missing"]
    assert {kind: n for kind, n in board.latches[-1].counted.items() if n} == {
        "frames_without_commit": 1
    }


@pytest.mark.parametrize("name", ["sonicsurface", "ultraino-fpga", "ultraino-fpga-128"])
def test_a_client_that_never_sends_a_start_is_told_and_its_frames_are_whole(name):
    board = started(name)
    said = said_of(board, *[SENT[name][1:]] * 3, gap_us=SILENCE_US)
    start = "a frame has no start (FEh): its codes are right only because a swap (FDh) came before"
    assert said == [start]
    right = started(name)
    right.send(SENT[name])
    assert (board.latches[-1].pulses.rises == right.latches[-1].pulses.rises).all()
    assert board.latches[-1].counted == {"frames_without_start": 1}


def test_frames_of_interactlab_without_their_start_bit_are_told():
    frame = bytes([SENT["interactlab"][0] & 0x7F]) + SENT["interactlab"][1:512]
    said = said_of(started("interactlab"), frame, gap_us=SILENCE_US)
    assert said == ["bytes came outside a frame: none of them starts one (bit 7)"]


def test_codes_for_a_board_that_is_not_there_are_told():
    stack = b"\xfe\xc0" + bytes(256) + b"\xc1" + bytes(256) + b"\xfd"
    (told,) = said_of(started("sonicsurface"), stack, stack)
    assert told.startswith("codes came while no board listened: the client has selected one")


def test_a_client_that_sends_nothing_leaves_without_a_word():
    board = started("sonicsurface")
    for _ in range(2):
        board.simulation.unplug()
    assert board.notices == []
    said_of(board, SENT["sonicsurface"])
    assert board.notices[0].is_own
    assert [type(notice) for notice in board.notices] == [WireCompared, ClientLeft]


@pytest.mark.parametrize("name", [name for name in DIALECTS if DIALECTS[name].bauds])
def test_a_client_that_starts_again_on_the_same_line_is_told_from_lost_bytes(name):
    """A serial line does not say that its client left: a pause in mid-frame does."""
    board, frame = started(name), SENT[name]
    board.send(frame)
    board.pass_us(40_000)
    board.send(frame[: len(frame) // 2 - 3])
    board.pass_us(40_000)
    board.send(frame * 2)
    board.pass_us(40_000)
    said_of(board, frame)
    (told,) = board.remarks
    assert told.startswith("a frame stops in its middle: ")
    again = started(name)
    again.send(frame + frame[:40] + frame[43:] + frame)
    assert not [text for text in again.remarks if "stops" in text]


def test_lines_of_text_are_no_frames():
    board = started("sonicsurface")
    (told,) = said_of(board, b"focus=0,120,0,\n", b"off\n", gap_us=50_000)
    assert told.startswith("these bytes are lines of text, not sonicsurface")
    assert said_of(board, SENT["sonicsurface"], SENT["sonicsurface"]) == []


def test_a_pause_behind_a_frame_that_is_nearly_whole_is_no_stop():
    """A client that pauses between its frames lost a byte, and goes on."""
    board, frame = started("interactlab"), SENT["interactlab"][:512]
    board.send(frame)
    for part in (frame[:300] + frame[301:], frame, frame):
        board.pass_us(50_000)
        board.send(part)
    assert [text for text in board.remarks if "stops" in text] == []
    board.pass_us(50_000)
    board.send(frame[:200])  # one of which half is missing stops
    board.pass_us(50_000)
    board.send(frame * 2)
    assert [text for text in board.remarks if "stops" in text]
