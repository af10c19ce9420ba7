"""Uploads, playback, correction.  SPEC.md chapter 7."""

from __future__ import annotations

import zlib

from haptogram_protocol import messages as m
from haptogram_protocol.state import MuteReason, OutputState

from .script import COUNT, Script, phases

_T = m.MessageType
_E = m.ErrorCode
_K = m.UploadKind
_FULL = b"\xff" * COUNT
_ID = 3
_FRAMES = bytes(range(10, 10 + 3 * COUNT))


def scripts() -> list[Script]:
    """Return every dialogue of this part."""
    return [
        _play(),
        _play_at_once(),
        _play_refused(),
        _stop(),
        _while_playing(),
        _unattended(),
        _muted_while_playing(),
        _session_while_playing(),
        _after_playback(),
        _points(),
        _scattered_chunks(),
        _incomplete(),
        _wrong_crc(),
        _begin_refused(),
        _chunk_refused(),
        _atomic(),
        _abandoned(),
        _correction(),
    ]


def _begin(s: Script, kind: _K, data: bytes, *, target: int = _ID, points: int = 0) -> None:
    s.request(m.UploadBegin(kind, points, target, len(data), zlib.crc32(data)))
    s.answer_with(_T.UPLOAD_BEGIN_REPLY, {})


def _chunk(s: Script, offset: int, data: bytes, received: int) -> None:
    s.request(m.UploadChunk(offset, data))
    s.answer(m.UploadChunkReply(received))


def _commit(s: Script, frames: int, *, target: int = _ID) -> None:
    s.request(m.UploadCommit(target))
    s.answer(m.UploadCommitReply(frames))


def _upload(s: Script, data: bytes = _FRAMES) -> None:
    _begin(s, _K.PHASES, data)
    _chunk(s, 0, data, len(data))
    _commit(s, len(data) // COUNT)


def _ready(name: str, clauses: str, flags: str, comment: str) -> Script:
    """Begin a dialogue on an armed board that holds a sequence of three frames."""
    s = Script(name, clauses, flags, comment)
    _upload(s)
    s.configure(trace_mode=m.TraceMode.CRC, host_timeout_ms=10_000, hold_ms=10_000, ramp_ms=0)
    s.arm()
    return s


def _start(s: Script, period_us: int, loops: int, unattended_ms: int = 5000) -> None:
    s.request(m.Play(_ID, period_us, loops, unattended_ms), flags=m.Flag.IMMEDIATE)
    s.answer(m.PlayReply(OutputState.ARMED))


def _latched(s: Script, loop: int, index: int, time_us: int, data: bytes = _FRAMES) -> None:
    codes = data[index * COUNT : (index + 1) * COUNT]
    key = m.LatchKey(_ID, loop, index)
    s.event(m.TracePlayback(key, zlib.crc32(codes + _FULL)), time_us=time_us)


def _play() -> Script:
    s = _ready(
        "play",
        "HG-7.6/4 HG-7.8/1 HG-8.3/1",
        "playback",
        "two passes, each frame on the first carrier period at or after its time",
    )
    s.request(m.Play(_ID, 1010, 2, 5000), time_us=s.wire_us(3000))
    s.answer(m.PlayReply(OutputState.ARMED))
    times = [s.boundary_us(3000 + 1010 * number) for number in range(6)]
    s.wait(20)
    s.look()
    for number, time_us in enumerate(times):
        _latched(s, number // 3, number % 3, time_us)
    s.event(m.PlaybackEnded(_ID, 2, 6), time_us=times[-1])
    s.counts(latched=6, late=0)
    return s


def _play_at_once() -> Script:
    s = _ready(
        "play-at-once", "HG-3.5/2 HG-7.6/3", "playback", "PLAY with IMMEDIATE; the queue is flushed"
    )
    s.stream(phases(1, 1, 1, 1), time_us=s.wire_us(50_000))
    _start(s, 1000, 1)
    _latched(s, 0, 0, s.wire_us())
    s.wait(1)
    s.look()
    _latched(s, 0, 1, s.wire_us())
    s.wait(1)
    s.look()
    _latched(s, 0, 2, s.wire_us())
    s.event(m.PlaybackEnded(_ID, 1, 3))
    s.counts(flushed=1)
    return s


def _play_refused() -> Script:
    s = Script("play-refused", "HG-7.6/1 HG-7.6/2 HG-6.2/2", "playback limits", "what PLAY refuses")
    _upload(s)
    s.request(m.Play(_ID, 1000, 1, 100), time_us=s.wire_us(1000))
    s.refusal(_T.PLAY, _E.BAD_STATE, OutputState.DISARMED)
    s.arm()
    s.request(m.Play(_ID + 1, 1000, 1, 100), time_us=s.wire_us(1000))
    s.refusal(_T.PLAY, _E.NOT_FOUND, 1)
    s.request(m.Play(_ID, 0, 1, 100), time_us=s.wire_us(1000))
    s.refusal(_T.PLAY, _E.BAD_VALUE, m.Play.WIRE["period_us"].offset)
    s.request(m.Play(_ID, 1000, 1, 0), time_us=s.wire_us(1000))
    s.refusal(_T.PLAY, _E.BAD_VALUE, m.Play.WIRE["unattended_ms"].offset)
    s.request(m.Play(_ID, 1000, 1, 100), time_us=s.wire_us(-1))
    s.refusal(_T.PLAY, _E.BAD_VALUE, 0)
    s.request(m.Play(_ID, 1000, 1, 100), time_us=s.wire_us(10_000_001))
    s.refusal(_T.PLAY, _E.BAD_VALUE, 0)
    s.counts(latched=0, bad_value=0)
    return s


def _stop() -> Script:
    s = _ready("stop", "HG-7.7/1 HG-7.7/2 HG-7.8/1", "playback", "STOP ends an endless playback")
    s.request(m.Stop())
    s.answer(m.StopReply(OutputState.ARMED))
    _start(s, 10_000, 0)
    _latched(s, 0, 0, s.wire_us())
    s.wait(5)
    s.request(m.Stop())
    s.answer(m.StopReply(OutputState.ARMED))
    s.event(m.PlaybackEnded(_ID, 0, 1))
    s.drive(_FRAMES[:COUNT], _FULL, m.DriveKind.RADIATED)
    return s


def _while_playing() -> Script:
    s = _ready(
        "while-playing",
        "HG-5.7/1 HG-7.2/5 HG-7.6/1",
        "playback state",
        "no stream, no second PLAY and no upload of this sequence while it plays",
    )
    _start(s, 100_000, 0)
    _latched(s, 0, 0, s.wire_us())
    s.stream(phases(1, 1, 1, 1))
    s.request(m.Play(_ID, 1000, 1, 100), time_us=s.wire_us(1000))
    s.refusal(_T.PLAY, _E.BAD_STATE, OutputState.ARMED)
    s.request(m.UploadBegin(_K.PHASES, 0, _ID, COUNT, 0))
    s.refusal(_T.UPLOAD_BEGIN, _E.BAD_STATE, OutputState.ARMED)
    _begin(s, _K.PHASES, bytes(COUNT), target=_ID + 1)
    s.counts(dropped_state=1, latched=1)
    return s


def _unattended() -> Script:
    s = _ready(
        "unattended",
        "HG-7.6/5 HG-7.6/6 HG-6.8/1 HG-7.8/1",
        "safety timer playback",
        "a playback without a frame from the host ends in MUTED(UNATTENDED)",
    )
    _start(s, 1_000_000, 0, unattended_ms=300)
    _latched(s, 0, 0, s.wire_us())
    s.wait(299)
    s.look()
    due_us = s.wire_us(1000)
    s.wait(2)
    s.look()
    s.event(m.StateChanged(OutputState.MUTED, MuteReason.UNATTENDED), time_us=due_us)
    s.event(m.PlaybackEnded(_ID, 0, 1), time_us=due_us)
    return s


def _muted_while_playing() -> Script:
    s = _ready("mute-ends-playback", "HG-6.4/2 HG-7.8/1", "safety playback", "MUTE ends a playback")
    _start(s, 1000, 0)
    _latched(s, 0, 0, s.wire_us())
    s.t_us += 500
    s.request(m.Mute())
    s.answer(m.MuteReply(OutputState.MUTED))
    s.event(m.PlaybackEnded(_ID, 0, 1))
    s.wait(10)
    s.counts(latched=1)
    return s


def _session_while_playing() -> Script:
    s = _ready(
        "session-ends-playback",
        "HG-4.6/3 HG-7.8/1",
        "session playback",
        "a new session ends a playback, and its host is told",
    )
    _start(s, 1000, 0)
    _latched(s, 0, 0, s.wire_us())
    s.t_us += 500
    s.hello(0x0404)
    s.event(m.PlaybackEnded(_ID, 0, 1))
    s.wait(10)
    s.counts(latched=1)
    return s


def _after_playback() -> Script:
    s = _ready(
        "after-playback",
        "HG-7.8/2 HG-6.10/1",
        "playback timer",
        "the hold runs from the last frame on",
    )
    s.configure(hold_ms=50)
    _start(s, 1000, 1)
    _latched(s, 0, 0, s.wire_us())
    s.wait(2)
    s.look()
    _latched(s, 0, 1, s.wire_us(-1000))
    _latched(s, 0, 2, s.wire_us())
    s.event(m.PlaybackEnded(_ID, 1, 3))
    s.stream(phases(7, 7, 7, 7), time_us=s.wire_us(10_000))
    s.wait(10)
    s.look()
    s.event(m.Trace(m.FIRST_STREAM_SEQ, zlib.crc32(bytes([7] * COUNT) + _FULL)))
    due_us = s.wire_us(50_000)
    s.wait(51)
    s.look()
    s.event(m.StateChanged(OutputState.MUTED, MuteReason.HOLD_EXPIRED), time_us=due_us)
    return s


def _points() -> Script:
    s = Script(
        "sequence-of-points", "HG-7.2/2 HG-7.6/4 HG-5.4/1", "playback point", "points, played"
    )
    point = m.FocalPoint(0, 0, 105_000, 65535, 0)
    silent = m.FocalPoint(0, 0, 105_000, 0, 0)
    data = point.pack() + silent.pack() + silent.pack() + silent.pack()
    _begin(s, _K.POINTS, data, points=2)
    _chunk(s, 0, data, len(data))
    _commit(s, 2)
    s.arm()
    _start(s, 2000, 1)
    s.drive(bytes([188] * COUNT), _FULL)  # as in dialogue/point
    s.wait(2)
    s.look()
    s.event(m.PlaybackEnded(_ID, 1, 2))
    s.drive(bytes(COUNT), bytes(COUNT))
    return s


def _scattered_chunks() -> Script:
    s = Script("scattered-chunks", "HG-7.3/1", "upload", "chunks in any order, some of them twice")
    _begin(s, _K.PHASES, _FRAMES)
    _chunk(s, 8, _FRAMES[8:12], 0)
    _chunk(s, 0, _FRAMES[:3], 3)
    _chunk(s, 8, _FRAMES[8:12], 3)
    _chunk(s, 2, _FRAMES[2:5], 5)
    _chunk(s, 12, b"", 5)
    _chunk(s, 5, _FRAMES[5:8], 12)
    s.raw(m.UploadChunk(0, _FRAMES))  # the number of an earlier chunk does not matter
    s.answer(m.UploadChunkReply(12))
    _commit(s, 3)
    return s


def _incomplete() -> Script:
    s = Script("incomplete", "HG-7.4/2", "upload", "a commit with bytes missing, and then the rest")
    _begin(s, _K.PHASES, _FRAMES)
    _chunk(s, 6, _FRAMES[6:], 0)
    s.request(m.UploadCommit(_ID))
    s.refusal(_T.UPLOAD_COMMIT, _E.INCOMPLETE, 0)
    _chunk(s, 0, _FRAMES[:5], 5)
    s.request(m.UploadCommit(_ID))
    s.refusal(_T.UPLOAD_COMMIT, _E.INCOMPLETE, 5)
    _chunk(s, 5, _FRAMES[5:6], 12)
    _commit(s, 3)
    return s


def _wrong_crc() -> Script:
    s = Script("upload-crc", "HG-7.4/3 HG-7.4/1", "upload", "other bytes than were announced")
    _begin(s, _K.PHASES, _FRAMES)
    wrong = bytes([99]) + _FRAMES[1:]
    _chunk(s, 0, wrong, len(wrong))
    s.request(m.UploadCommit(_ID))
    s.refusal(_T.UPLOAD_COMMIT, _E.CRC_MISMATCH, zlib.crc32(wrong))
    s.arm()
    s.request(m.Play(_ID, 1000, 1, 100), flags=m.Flag.IMMEDIATE)
    s.refusal(_T.PLAY, _E.NOT_FOUND, 0)
    _chunk(s, 0, _FRAMES[:1], len(_FRAMES))
    _commit(s, 3)
    return s


def _begin_refused() -> Script:
    s = Script("begin-refused", "HG-7.2/1 HG-7.2/2 HG-7.2/3", "upload limits", "what cannot begin")
    offsets = {name: field.offset for name, field in m.UploadBegin.WIRE.items()}
    for begin, code, detail in (
        (m.UploadBegin(_K.PHASES, 0, 0, COUNT, 0), _E.BAD_VALUE, offsets["target"]),
        (m.UploadBegin(_K.CORRECTION, 0, 1, COUNT, 0), _E.BAD_VALUE, offsets["target"]),
        (m.UploadBegin(_K.PHASES, 1, 1, COUNT, 0), _E.BAD_VALUE, offsets["points_per_frame"]),
        (m.UploadBegin(_K.POINTS, 0, 1, 16, 0), _E.BAD_VALUE, offsets["points_per_frame"]),
        (m.UploadBegin(_K.POINTS, 255, 1, 16, 0), _E.BAD_VALUE, offsets["points_per_frame"]),
        (m.UploadBegin(_K.PHASES, 0, 1, 0, 0), _E.BAD_LENGTH, COUNT),
        (m.UploadBegin(_K.PHASES, 0, 1, COUNT + 1, 0), _E.BAD_LENGTH, COUNT),
        (m.UploadBegin(_K.POINTS, 2, 1, 48, 0), _E.BAD_LENGTH, 32),
    ):
        s.request(begin)
        s.refusal(_T.UPLOAD_BEGIN, code, detail)
    s.request(m.UploadBegin(_K.PHASES, 0, 1, 0xFFFFFFFC, 0))
    s.answer_with(_T.ERROR, {"request": _T.UPLOAD_BEGIN, "code": _E.TOO_LARGE})
    s.request(m.UploadCommit(1))
    s.answer_with(_T.ERROR, {"request": _T.UPLOAD_COMMIT, "code": _E.BAD_STATE})
    return s


def _chunk_refused() -> Script:
    s = Script(
        "chunk-refused", "HG-7.3/4 HG-7.4/4", "upload limits", "chunks without or past an upload"
    )
    s.request(m.UploadChunk(0, b"1234"))
    s.answer_with(_T.ERROR, {"request": _T.UPLOAD_CHUNK, "code": _E.BAD_STATE})
    _begin(s, _K.PHASES, _FRAMES)
    for offset, data in ((12, b"x"), (9, b"1234"), (0xFFFFFFFF, b"x")):
        s.request(m.UploadChunk(offset, data))
        s.refusal(_T.UPLOAD_CHUNK, _E.BAD_VALUE, 0)
    s.request(m.UploadCommit(_ID + 1))
    s.refusal(_T.UPLOAD_COMMIT, _E.BAD_VALUE, 0)
    _chunk(s, 0, _FRAMES, 12)
    _commit(s, 3)
    return s


def _atomic() -> Script:
    s = _ready(
        "atomic-upload", "HG-7.4/1", "upload playback", "the old sequence plays until the commit"
    )
    new = bytes(range(100, 100 + COUNT))
    _begin(s, _K.PHASES, new)
    _chunk(s, 0, new, COUNT)
    _start(s, 1000, 1)
    _latched(s, 0, 0, s.wire_us())
    s.wait(5)
    s.look()
    _latched(s, 0, 1, s.wire_us(-4000))
    _latched(s, 0, 2, s.wire_us(-3000))
    s.event(m.PlaybackEnded(_ID, 1, 3), time_us=s.wire_us(-3000))
    _commit(s, 1)
    _start(s, 1000, 1)
    _latched(s, 0, 0, s.wire_us(), new)
    s.event(m.PlaybackEnded(_ID, 1, 1))
    return s


def _abandoned() -> Script:
    s = Script("abandoned-upload", "HG-4.6/3 HG-7.2/4", "upload session", "what abandons an upload")
    _begin(s, _K.PHASES, _FRAMES)
    _chunk(s, 0, _FRAMES, 12)
    _begin(s, _K.PHASES, _FRAMES)
    s.request(m.UploadCommit(_ID))
    s.refusal(_T.UPLOAD_COMMIT, _E.INCOMPLETE, 0)
    s.hello(0x0404)
    s.request(m.UploadCommit(_ID))
    s.answer_with(_T.ERROR, {"code": _E.BAD_STATE})
    return s


def _correction() -> Script:
    s = Script(
        "correction",
        "HG-7.9/1 HG-7.1/5",
        "upload",
        "the correction is added modulo 256 to what is radiated; the latched drive stays",
    )
    table = bytes([0, 1, 128, 255])
    _begin(s, _K.CORRECTION, table, target=0)
    _chunk(s, 0, table, COUNT)
    _commit(s, COUNT, target=0)
    s.arm()
    s.stream(phases(200, 255, 200, 1))
    s.drive(bytes([200, 255, 200, 1]), _FULL)
    s.drive(bytes([200, 0, 72, 0]), _FULL, m.DriveKind.RADIATED)
    s.request(m.GetConfig())
    crc = zlib.crc32(s.config.pack() + table)
    s.answer(m.ConfigReply(crc, s.config))
    return s
