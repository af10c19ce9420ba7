"""HG-7.2, HG-7.4, HG-7.6, HG-7.8, HG-8.4:
several sequences in the store, replaced in every order.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Final

from haptogram_protocol import messages as m

from ...case import Depth, case
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import TRACED_PLAYS
from ...client.stream_kinds import random_points_to_send
from ...judge.events import judge_division, played_keys
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, named, require
from .playback import judge_playback

_IDS: Final = (0x0101, 0x0201, 0x8001)  # the low bytes are alike
_SEEN: Final = 5  # latches of the sequence that plays, at least
_ABSENT: Final = 0x6000  # of no sequence; those behind it are stored
_MANY: Final = 70
_FOCUS: Final = m.FocalPoint(0, 0, 100_000, 0xFFFF, 0).pack()
_AHEAD_US: Final = 5_000_000
_WAITS_US: Final = 300_000
_TRACED_BYTES: Final = 150  # of a trace, and as much of replies
_SIZES: Final = ((3, 1, 2), (1, 3, 2), (2, 2, 2))
_TRACED_DRIVES: Final = m.Feature.TRACE_DRIVE | m.Feature.SEQUENCE_PHASES | m.Feature.CONFIG
_RINGS: Final = m.Feature.TRACE_RING | m.Feature.CONFIG
_PLAYED: Final = 0x0201
#: Frames of the sequence, loops, and period in us (0: the shortest): each wide in one of them.
_SHAPES: Final = (
    (1, 1, 1003),
    (1, 258, 0),
    (3, 100, 0),
    (300, 1, 0),
    (2, 3, 1507),
    (2, 1, 0),
    (2, 1, 70_000),
)
_MOST: Final = 65_537  # frames of a sequence: more than 16 bits
_MANY_PLAYED: Final = 66_000  # frames in a playback: more than 16 bits
_OVER_16_BITS: Final = 66_000  # bytes of a sequence
_SHAPES_MIXED: Final = 5  # different frames of it
_TELLING: Final = 4  # transducers: the codes of fewer may be the same for different points
_BEHIND: Final = 0x0101  # stored behind the other one
_DIVIDER: Final = 260
_MANY_DIVIDER: Final = 40_000  # no divisor of 2^16, and of 16 bits itself
_WINDOW_US: Final = 100_000


@dataclass(slots=True)
class SequenceStore:
    """Sequences that a host has stored, with the CRC-32 of each drive that a playback latches.

    Attributes
    ----------
    board : BoardClient
        The board.
    crcs : dict of int to list of int
        By the id of the sequence.
    """

    board: BoardClient
    crcs: dict[int, list[int]] = field(default_factory=dict)

    def put(self, sequence: int, frames: int) -> None:
        """Upload a sequence of random phases in place of the one with this id."""
        drives = playback.send_phases_to_store(self.board, sequence, frames=frames)
        self.crcs[sequence] = list(map(latching.drive_crc, drives))

    def check_all(self, name: str) -> None:
        """FAILED unless every sequence is played as it was uploaded."""
        for sequence, due in self.crcs.items():
            got = latching.played_crcs(self.board, sequence, len(due))
            text = f"{name}: sequence {sequence:#06x} is not played as it was uploaded: CRC-32"
            check_equal(got, due, text)


@case("HG-7.4/1-store", needs=TRACED_PLAYS, evidence=SELF_REPORTED)
def stored_sequences_are_replaced_in_every_order(board: BoardClient) -> None:
    """3 sequences, each replaced in every order by a longer or shorter one: all are played whole"""
    # in every order, one of them twice
    orders = [(*order, order[0]) for order in itertools.permutations(range(len(_IDS)))]
    for order in orders if board.thorough else orders[3:4]:
        board.configure(trace_mode=m.TraceMode.CRC)
        store = SequenceStore(board)
        for sequence, frames in zip(_IDS, _SIZES[0], strict=True):
            store.put(sequence, frames)
        store.check_all("uploaded")
        for turn, place in enumerate(order):
            store.put(_IDS[place], _SIZES[1 + turn % 2][place] + turn % 3)
            if board.has(m.Feature.CORRECTION) and turn == 1:
                uploads.upload_correction(board, bytes(board.identity.transducers))
            if turn == 2:  # begun, and not gone on with
                form = uploads.upload_forms(board, _IDS[order[0]])[0]
                uploads.announce_upload(board, form.request(4 * form.frame_bytes))
            store.check_all(f"replaced in the order {order[: turn + 1]}")
        board.hello()
        store.check_all(f"replaced in the order {order}, in a new session")


@case("HG-7.2/5-others", needs=TRACED_PLAYS, evidence=SELF_REPORTED)
def other_sequences_are_uploaded_meanwhile(board: BoardClient) -> None:
    """while a sequence plays, waits, or has ended others and the correction are uploaded"""
    first, second, third = _IDS
    board.configure(trace_mode=m.TraceMode.CRC)
    store = SequenceStore(board)
    for sequence in _IDS:
        store.put(sequence, 2)
    since = board.arm()
    period_us = playback.shortest_period_to_play_us(board, _period_to_trace(board))
    playback.play_now(board, second, loops=0, period_us=period_us)
    store.put(first, 3)  # those before and behind the one that plays move it
    store.put(third, 1)
    store.put(first, 1)
    if board.has(m.Feature.CORRECTION):
        uploads.upload_correction(board, bytes(board.identity.transducers))
    board.clock.idle_attended(_SEEN * period_us)
    board.mute()
    got = [
        latch.crc for latch in latching.latches_received_from_board(board, since, m.TraceMode.CRC)
    ]
    due = store.crcs[second] * len(got)
    check(len(got) >= _SEEN, f"{len(got)} latches while others are uploaded")
    check_equal(got, due[: len(got)], "the sequence that plays changes while others are uploaded")
    store.check_all("uploaded while another one played")


def _period_to_trace(board: BoardClient) -> int:
    """Return a playback period in µs, 2000 or what 150 bytes take on the line if that is longer."""
    return board.wire.period_us(_TRACED_BYTES, 2000)


@case("HG-7.2/5-commit", needs=TRACED_PLAYS, evidence=SELF_REPORTED)
def no_upload_replaces_the_sequence_that_plays(board: BoardClient) -> None:
    """an upload begun before PLAY is refused while its sequence waits or plays, and taken after
    it
    """
    board.configure(trace_mode=m.TraceMode.CRC)
    store = SequenceStore(board)
    for waits, end in itertools.product((False, True), (m.Stop(), m.Mute())):
        _judge_commit_of_playing_sequence(store, end, waits=waits)


def _judge_commit_of_playing_sequence(store: SequenceStore, end: m.Message, *, waits: bool) -> None:
    """FAILED unless an upload over the sequence that plays is committed only after *end*.

    If *waits*, the playback is scheduled and has not begun.
    """
    board, sequence = store.board, _IDS[0]
    name = f"a playback that {'waits' if waits else 'plays'}, until {end.TYPE.name}"
    store.put(sequence, 1)
    drive = board.random.randbytes(board.identity.transducers)
    uploads.begin_upload(board, m.UploadKind.PHASES, sequence, drive)
    uploads.send_upload_chunks(board, drive)
    board.arm()
    since, period_us = board.link.mark(), _period_to_trace(board)
    if waits:
        playback.play_later(board, sequence, _WAITS_US, period_us=period_us)
    else:
        playback.play_now(board, sequence, loops=0, period_us=period_us)
    for _ in range(2):
        board.link.refused(m.UploadCommit(sequence), m.ErrorCode.BAD_STATE)
    board.wire.idle(3 * period_us)
    board.link.ask(end)
    got = [
        latch.crc for latch in latching.latches_received_from_board(board, since, m.TraceMode.CRC)
    ]
    check(waits or bool(got), f"{name}: nothing is latched")
    same = got == store.crcs[sequence] * len(got)
    check(same, f"{name}: an upload whose commit is refused is played")
    board.link.call(m.UploadCommit(sequence), m.UploadCommitReply)
    store.crcs[sequence] = [latching.drive_crc(drive)]
    store.check_all(f"committed behind {name}")


@case("HG-7.4/5", needs_reset=True)
def no_sequence_outlives_a_reset(board: BoardClient) -> None:
    """after a reset no sequence of either kind is stored, and no upload is under way"""
    board.hello()
    board.need_any(m.Feature.SEQUENCE_PHASES | m.Feature.SEQUENCE_POINTS)
    stored = [form for form in uploads.upload_forms(board) if form.target]
    frames = {m.UploadKind.PHASES: bytes(board.identity.transducers), m.UploadKind.POINTS: _FOCUS}
    for form in stored:
        replace(form, target=uploads.SEQUENCES[form.kind]).upload(board, frames[form.kind])
        replace(form, target=uploads.SEQUENCES[0]).begin(board, frames[form.kind])
    board = board.restarted()
    board.link.refused(m.UploadChunk(0, b"\x00"), m.ErrorCode.BAD_STATE)
    board.arm()
    for form in stored:
        period_us = playback.period_to_play(board, 1)
        play = playback.play_request(
            board, uploads.SEQUENCES[form.kind], loops=1, period_us=period_us
        )
        board.link.refused(play, m.ErrorCode.NOT_FOUND, 0, flags=m.Flag.IMMEDIATE)


@case("HG-7.6/1-many", needs=TRACED_PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def many_sequences_are_stored(board: BoardClient) -> None:
    """one sequence more at a time, to TOO_LARGE or 70: each is played, NOT_FOUND tells their
    number
    """
    board.configure(trace_mode=m.TraceMode.CRC)
    store, frame = SequenceStore(board), board.identity.transducers
    for sequence in uploads.SEQUENCES:  # later cases find room for theirs
        store.put(sequence, 1)
    board.arm()
    held = _refused_play_of_sequence(board, _ABSENT)
    for sequence in range(_ABSENT + 1, _ABSENT + 1 + _MANY):
        is_new = _refused_play_of_sequence(board, sequence) is not None
        answer = board.link.ask(m.UploadBegin(m.UploadKind.PHASES, 0, sequence, frame, 0))
        if isinstance(answer.message, m.Error):  # no room for one more
            board.link.error_in(answer, m.UploadBegin.TYPE, m.ErrorCode.TOO_LARGE)
            break
        for _ in range(2):  # the second replaces the first
            store.put(sequence, 1)
        due, held = (held or 0) + is_new, _refused_play_of_sequence(board, _ABSENT)
        text = (
            f"sequences that NOT_FOUND tells behind two uploads of {sequence:#06x}, new: {is_new}"
        )
        check_equal(held, due, text)
    store.check_all(f"{len(store.crcs)} sequences")


def _refused_play_of_sequence(board: BoardClient, sequence: int) -> int | None:
    """Play *sequence*; return the detail of NOT_FOUND (how many are stored), None if it plays."""
    start_us = board.clock.ahead_us(_AHEAD_US)
    play = playback.play_request(board, sequence, loops=1, unattended_ms=9_999)
    answer = board.link.ask(play, time_us=start_us)
    if isinstance(answer.message, m.PlayReply):
        board.stop()
        return None
    return board.link.error_in(answer, m.Play.TYPE, m.ErrorCode.NOT_FOUND).detail


def _played_forms(board: BoardClient) -> list[uploads.UploadForm]:
    """Return the sequence forms that the board can play; UNIMPLEMENTED if it can play none."""
    board.need_any(m.Feature.SEQUENCE_PHASES | m.Feature.SEQUENCE_POINTS)
    return [form for form in uploads.upload_forms(board, _PLAYED) if form.target]


def _random_frame(board: BoardClient, form: uploads.UploadForm) -> bytes:
    """Return a random frame of a sequence: points, or a code for each transducer."""
    if form.points:
        return random_points_to_send(board).serialize()
    return board.random.randbytes(form.frame_bytes)


def _shortest_playback_us(board: BoardClient) -> int:
    """Return the shortest period in µs, 200 or more, at which the board can play a point."""
    return playback.shortest_period_to_play_us(board, max(200, board.identity.point_time_us))


@case("HG-7.6/4-sizes", needs=_RINGS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_playback_size_is_played(board: BoardClient) -> None:
    """258 loops, 300 frames, a period of 70 ms, of phases and points: each frame at its time,
    once
    """
    ring = board.identity.trace_ring
    for form, (frames, loops, period_us) in itertools.product(_played_forms(board), _SHAPES):
        if frames * loops > ring or frames > board.identity.max_sequence_frames:
            continue
        board.hello()
        board.configure(trace_mode=m.TraceMode.RING)
        form.upload(board, b"".join(_random_frame(board, form) for _ in range(frames)))
        period = max(period_us or _shortest_playback_us(board), board.identity.point_time_us)
        name = f"{form.kind.name}, {frames} frames, {loops} loops, {period} µs"
        with named(name):
            judge_playback(board, m.TraceMode.RING, _PLAYED, frames, loops, period)


@case("HG-7.6/4-offsets", needs=_RINGS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def frames_of_long_playback_are_those_stored(board: BoardClient) -> None:
    """two sequences of more than 64 KiB, of phases and points: each frame latched is the one
    stored
    """
    for form in _played_forms(board):
        wanted = _OVER_16_BITS // form.frame_bytes + 2
        for sequence in (_PLAYED, _BEHIND):
            stored = _store_mixed_frames(board, replace(form, target=sequence), wanted)
            name = f"{form.kind.name}, {len(stored)} frames of {len(stored[0])} bytes"
            _judge_frames_of_long_playback(board, sequence, stored, name)


@case("HG-7.6/4-most", needs=_RINGS, evidence=SELF_REPORTED, wall_depth=Depth.FULL)
def playback_of_most_frames_begins(board: BoardClient) -> None:
    """a sequence of as many frames as the board takes, 65537 at most, is stored, and its first
    play
    """
    form, stored = _store_most_frames(board)
    since = _begin_traced_playback(board)
    period_us, seen_us = _shortest_playback_us(board), 20_000
    text = f"the last of {len(stored)} frames at most is played within {seen_us} µs"
    require((len(stored) - 1) * period_us > seen_us, text)
    playback.play_now(board, _PLAYED, loops=1, period_us=period_us)
    board.wire.idle(seen_us)
    board.stop()
    ended = playback.await_playback_end(board, since, 0)
    name = f"{form.kind.name}, {len(stored)} frames"
    check_fields(ended, f"{name}: PLAYBACK_ENDED within 20 ms", loops=0)
    seen = latching.latches_received_from_board(board, since, m.TraceMode.RING)
    got = [(latch.loop, latch.index) for latch in seen]
    due = [(0, index) for index in range(ended.frames)]
    check_equal(got, due[-board.identity.trace_ring :], f"{name}: (loop, index) are {got[:3]}...")
    form.upload(board, stored[0])  # makes room


@case("HG-7.6/4-longest", needs=_RINGS, evidence=SELF_REPORTED, depth=Depth.FULL)
def playback_of_most_frames_is_what_was_stored(board: BoardClient) -> None:
    """a sequence of as many frames as the board takes, 65537 at most, is played to its last
    frame
    """
    form, stored = _store_most_frames(board)
    _judge_frames_of_long_playback(
        board, _PLAYED, stored, f"{form.kind.name}, {len(stored)} frames"
    )
    form.upload(board, stored[0])  # makes room


def _store_most_frames(board: BoardClient) -> tuple[uploads.UploadForm, list[bytes]]:
    """Store a sequence, up to 65537 frames, of the form whose frames are shortest; return both."""
    form = min(_played_forms(board), key=lambda form: form.frame_bytes)
    return form, _store_mixed_frames(board, form, _MOST)


def _begin_traced_playback(board: BoardClient) -> int:
    """Open a session, arm with the trace ring on; return the number of the next received frame."""
    board.hello()
    return board.arm(trace_mode=m.TraceMode.RING)


def _store_mixed_frames(board: BoardClient, form: uploads.UploadForm, wanted: int) -> list[bytes]:
    """Store a sequence of up to *wanted* frames, each one of 5 random ones; return its frames.

    It is shorter if the board has no room for all.
    """
    wanted = min(wanted, form.most_frames(board))
    frames = uploads.frames_with_room(board, form.kind, form.target, wanted, form.frame_bytes)
    shapes = [_random_frame(board, form) for _ in range(_SHAPES_MIXED)]
    stored = [board.random.choice(shapes) for _ in range(frames)]
    form.upload(board, b"".join(stored))
    return stored


def _judge_frames_of_long_playback(
    board: BoardClient, sequence: int, stored: list[bytes], name: str
) -> None:
    """Play *sequence*; FAILED unless equal *stored* frames give equal latches, and others do not.

    The trace ring has to hold the last latches, as many as it keeps; *name* begins the finding.
    """
    since = _begin_traced_playback(board)
    ended = playback.play_out(board, sequence, len(stored), period_us=_shortest_playback_us(board))
    check_fields(ended, f"{name}: PLAYBACK_ENDED", loops=1, frames=len(stored))
    seen = latching.latches_received_from_board(board, since, m.TraceMode.RING)
    due_latches = min(len(stored), board.identity.trace_ring)
    check(len(seen) >= due_latches, f"{name}: the ring tells of {len(seen)}, due {due_latches}")
    crcs: dict[bytes, int] = {}
    for latch in seen:
        due = crcs.setdefault(stored[latch.index], latch.crc)
        check_equal(latch.crc, due, f"{name}: frame {latch.index} is latched as another one")
    different = len(set(crcs.values())) == len(crcs)
    text = f"{name}: frames that differ are latched as one"
    check(different or board.identity.transducers < _TELLING, text)


@case(
    "HG-7.8/1-many",
    needs=m.Feature.SEQUENCE_PHASES,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
    wall_depth=Depth.FULL,
)
def many_playback_frames_are_counted(board: BoardClient) -> None:
    """66000 frames are played and counted: more than 16 bits hold"""
    playback.send_phases_to_store(board, _PLAYED, frames=1)
    rings = board.has(m.Feature.TRACE_RING | m.Feature.CONFIG)
    if rings:
        board.configure(trace_mode=m.TraceMode.RING, late_window_us=_WINDOW_US)
    board.arm()
    with board.counting(latched=_MANY_PLAYED):
        event = playback.play_out(
            board,
            _PLAYED,
            1,
            loops=_MANY_PLAYED,
            period_us=playback.shortest_period_to_play_us(board),
        )
    check_fields(event, "PLAYBACK_ENDED", loops=_MANY_PLAYED, frames=_MANY_PLAYED)
    if rings:
        _check_playback_in_the_ring(board)


def _check_playback_in_the_ring(board: BoardClient) -> None:
    """FAILED unless the trace ring numbers latches beyond 65535 and flags a late frame as LATE."""
    last = board.link.stream_next
    board.link.stream(board.flat_phases(), board.late_time_us(5000))
    board.clock.wait_latched()
    reply = board.link.call(m.ReadTrace(_MANY_PLAYED - 2, 9), m.TraceReply)
    due = [(n, _PLAYED, n, 0, 0) for n in (_MANY_PLAYED - 2, _MANY_PLAYED - 1)]
    due.append((_MANY_PLAYED, 0, 0, last, int(m.Flag.LATE)))
    got = [(r.number, r.key.sequence, r.key.loop, r.key.index, r.flags) for r in reply.records]
    text = "(number, sequence, loop, index, flags) of the last latches"
    check_equal(got, due, text)
    check_fields(reply, f"behind {_MANY_PLAYED} latches: TRACE_REPLY", next=_MANY_PLAYED + 1)


@case("HG-8.4/1-divider", needs=_TRACED_DRIVES, evidence=SELF_REPORTED)
def wide_dividers_divide_playback(board: BoardClient) -> None:
    """of 600 latches a divider of 260 traces those of 0, 260 and 520, of stream and playback"""
    playback.send_phases_to_store(board, _PLAYED, frames=3)
    since = board.arm(trace_mode=m.TraceMode.DRIVE, trace_divider=_DIVIDER)
    keys = [m.LatchKey(0, 0, latching.latch_now(board)), *played_keys(_PLAYED, 3, 200)]
    playback.play_out(board, _PLAYED, 3, loops=200, period_us=_shortest_playback_us(board))
    judge_division(board, since, keys, _DIVIDER)


@case("HG-8.4/1-many", needs=_TRACED_DRIVES, evidence=SELF_REPORTED, wall_depth=Depth.FULL)
def a_divider_divides_many_playback_latches(board: BoardClient) -> None:
    """of 66000 latches since SET_CONFIG those 0 and 40000 are traced by a divider of 40000"""
    playback.send_phases_to_store(board, _PLAYED, frames=1)
    since = board.arm(trace_mode=m.TraceMode.DRIVE, trace_divider=_MANY_DIVIDER)
    playback.play_out(
        board, _PLAYED, 1, loops=_MANY_PLAYED, period_us=playback.shortest_period_to_play_us(board)
    )
    judge_division(board, since, played_keys(_PLAYED, 1, _MANY_PLAYED), _MANY_DIVIDER)


@case("HG-8.4/1-kinds", needs=_TRACED_DRIVES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_playback_latch_counts_in_the_division(board: BoardClient) -> None:
    """latches at once, in time, late and played count alike in a division by 2, 3 and 4"""
    playback.send_phases_to_store(board, _PLAYED, frames=1)
    board.clock.require_horizon(board.clock.ready_us(_WINDOW_US // 2))
    for divider in (2, 3, 4):
        board.arm(trace_mode=m.TraceMode.DRIVE, trace_divider=divider, late_window_us=_WINDOW_US)
        since, before = board.link.mark(), board.status().counters
        keys: list[m.LatchKey] = []
        for _ in range(3):
            for lateness_us in (None, _WINDOW_US // 20, -_WINDOW_US // 2):
                keys.append(m.LatchKey(0, 0, board.link.stream_next))
                at_us = None if lateness_us is None else board.late_time_us(lateness_us)
                board.link.stream(board.flat_phases(), at_us)
                board.wire.idle(max(0, -(lateness_us or 0)))
                board.clock.wait_latched()
            keys += played_keys(_PLAYED, 1, 1)
            playback.play_out(board, _PLAYED, 1)
        counted = board.counted_since(before)["latched"]
        check_equal(counted, len(keys), f"of {len(keys)} frames {counted} are latched")
        judge_division(board, since, keys, divider)
