"""The times of recorded frames, moved to the clock of another board."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("mcap")

from haptogram.errors import NoAnswerError
from haptogram.evidence.recordings import replay
from haptogram.evidence.recordings.channels import LINK
from haptogram.evidence.recordings.reader import Recording
from haptogram.evidence.recordings.replay import ReplayFrameShifter
from haptogram.evidence.recordings.writer import RecordingWriter
from haptogram_protocol.annotation.frames import FrameAnnotator
from haptogram_protocol.framing import MAX_ENCODED_BYTES, encode_frame
from haptogram_protocol.messages import STREAM_RANGE, Flag, Header, MessageType
from strategies_protocol import chunkings, headers, messages, noise

WRAP = 1 << 32
frames = st.builds(
    lambda message, fields: (Header(type=message.TYPE, **fields), message), messages, headers
)


def moved(shifter, chunks):
    return b"".join(shifter.feed(chunk) for chunk in chunks)


@given(st.lists(frames, max_size=4), st.integers(0, WRAP - 1), st.data())
def test_frames_with_a_time_are_moved_and_nothing_else(sent, shift_us, data):
    line = b"".join(encode_frame(header.pack() + message.pack()) for header, message in sent)
    shifter = ReplayFrameShifter()
    shifter.shift_us = shift_us
    found = list(FrameAnnotator().feed(moved(shifter, data.draw(chunkings(line)))))
    assert [piece.message for piece in found] == [message for _, message in sent]
    for piece, (header, _) in zip(found, sent, strict=True):
        timed = header.type in STREAM_RANGE or header.type == MessageType.PLAY
        add_us = shift_us if timed and not header.flags & Flag.IMMEDIATE else 0
        assert piece.header == dataclasses.replace(header, time_us=(header.time_us + add_us) % WRAP)


@given(noise, st.data())
def test_what_is_no_frame_stays_as_it_is(line, data):
    shifter = ReplayFrameShifter()
    shifter.shift_us = 5
    line += b"\0"
    assert moved(shifter, data.draw(chunkings(line))) == line


def test_a_line_without_an_end_is_not_kept_and_the_frame_behind_it_is_moved():
    shifter = ReplayFrameShifter()
    shifter.shift_us = 5
    frame = encode_frame(Header(MessageType.PLAY, 0, 1, 77, 2).pack() + b"\0" * 12).strip(b"\0")
    line = b"\x01" * 5 * MAX_ENCODED_BYTES
    passed = b"".join(shifter.feed(line[at : at + 100]) for at in range(0, len(line), 100))
    assert len(line) - len(passed) <= MAX_ENCODED_BYTES
    passed += shifter.feed(frame + b"\0")
    assert passed == line + frame + b"\0"  # boards take no frame from behind such a line
    (moved_on,) = FrameAnnotator().feed(shifter.feed(frame + b"\0"))
    assert moved_on.header.time_us == 77 + 5


def test_a_time_cannot_be_moved_before_the_board_has_answered():
    header = Header(MessageType.PLAY, 0, 1, 77, 2)
    with pytest.raises(NoAnswerError, match="has not answered"):
        ReplayFrameShifter().feed(encode_frame(header.pack() + b"\0" * 12))


class SilentPort:
    """A port whose board takes every byte and never answers; a look costs a millisecond."""

    url = "silent"

    def __init__(self):
        self.now, self.sent = 0, b""

    def now_ns(self):
        self.now += 1_000_000
        return self.now

    def read_available(self, deadline_ns):
        self.now = max(self.now, deadline_ns)
        return b""

    def write_some(self, data):
        self.sent += data
        return len(data)

    def close(self):
        pass


@pytest.mark.parametrize(
    ("events", "sent", "notes"),
    [
        (["opened"], b"0", []),
        (["opened", "opened", "opened"], b"0", ["the first board of the recording was fed; "]),
        (["excerpt", "excerpt"], b"", ["an excerpt of a soak is not replayed: ", "the first b"]),
        ([], b"", []),
    ],
)
def test_the_first_board_alone_is_fed(events, sent, notes, tmp_path, monkeypatch):
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        for number, event in enumerate(events):
            told = {"event": event, "board": None, "boot_ns": None, "paced": 0, "text": "late"}
            writer.document(LINK, number * 1_000_000, told)
            writer.to_board(number * 1_000_000, b"%d\0" % number)
    port = SilentPort()
    monkeypatch.setattr(replay, "open_transport", lambda *_, **__: port)
    result = replay.replay_to_port(Recording(tmp_path / "run.mcap"), "silent", baudrate=9600)
    assert port.sent.strip(b"\0") == sent
    assert len(result.notes) == len(notes)
    assert all(map(str.startswith, result.notes, notes))
    assert result.exit_status == 3
