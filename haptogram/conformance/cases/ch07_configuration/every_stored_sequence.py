"""HG-7.2, HG-7.4, HG-7.6: several sequences in the store, replaced in every order."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Final

from haptogram_protocol.messages import (
    Error,
    ErrorCode,
    Feature,
    Flag,
    FocalPoint,
    Message,
    Mute,
    Play,
    PlayReply,
    Stop,
    StopReply,
    TraceMode,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import TRACED_PLAYS
from ...client.latching import drive_crc, latches_received_from_board, played_crcs
from ...client.playback import (
    period_to_play,
    play_later,
    play_now,
    play_request,
    send_phases_to_store,
    shortest_period_to_play_us,
)
from ...client.uploads import (
    SEQUENCES,
    announce_upload,
    begin_upload,
    send_upload_chunks,
    upload_correction,
    upload_forms,
)
from ...outcome import SELF_REPORTED, check, check_equal

_IDS: Final = (0x0101, 0x0201, 0x8001)  # the low bytes are alike
_SEEN: Final = 5  # latches of the sequence that plays, at least
_ABSENT: Final = 0x6000  # of no sequence; those behind it are stored
_MANY: Final = 70
_FOCUS: Final = FocalPoint(0, 0, 100_000, 0xFFFF, 0).pack()
_AHEAD_US: Final = 5_000_000
_WAITS_US: Final = 300_000
_TRACED_BYTES: Final = 150  # of a trace, and as much of replies
_SIZES: Final = ((3, 1, 2), (1, 3, 2), (2, 2, 2))


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
        drives = send_phases_to_store(self.board, sequence, frames=frames)
        self.crcs[sequence] = list(map(drive_crc, drives))

    def check_all(self, name: str) -> None:
        """FAILED unless every sequence is played as it was uploaded."""
        for sequence, due in self.crcs.items():
            got = played_crcs(self.board, sequence, len(due))
            text = f"{name}: sequence {sequence:#06x} is not played as it was uploaded: CRC-32"
            check_equal(got, due, text)


@case("HG-7.4/1-store", needs=TRACED_PLAYS, evidence=SELF_REPORTED)
def stored_sequences_are_replaced_in_every_order(board: BoardClient) -> None:
    """3 sequences, each replaced in every order by a longer or shorter one: all are played whole"""
    # in every order, one of them twice
    orders = [(*order, order[0]) for order in itertools.permutations(range(len(_IDS)))]
    for order in orders if board.thorough else orders[3:4]:
        board.configure(trace_mode=TraceMode.CRC)
        store = SequenceStore(board)
        for sequence, frames in zip(_IDS, _SIZES[0], strict=True):
            store.put(sequence, frames)
        store.check_all("uploaded")
        for turn, place in enumerate(order):
            store.put(_IDS[place], _SIZES[1 + turn % 2][place] + turn % 3)
            if board.has(Feature.CORRECTION) and turn == 1:
                upload_correction(board, bytes(board.identity.transducers))
            if turn == 2:  # begun, and not gone on with
                form = upload_forms(board, _IDS[order[0]])[0]
                announce_upload(board, form.request(4 * form.frame_bytes))
            store.check_all(f"replaced in the order {order[: turn + 1]}")
        board.hello()
        store.check_all(f"replaced in the order {order}, in a new session")


@case("HG-7.2/5-others", needs=TRACED_PLAYS, evidence=SELF_REPORTED)
def other_sequences_are_uploaded_meanwhile(board: BoardClient) -> None:
    """while a sequence plays, waits, or has ended others and the correction are uploaded"""
    first, second, third = _IDS
    board.configure(trace_mode=TraceMode.CRC)
    store = SequenceStore(board)
    for sequence in _IDS:
        store.put(sequence, 2)
    since = board.arm()
    period_us = shortest_period_to_play_us(board, _period_to_trace(board))
    play_now(board, second, loops=0, period_us=period_us)
    store.put(first, 3)  # those before and behind the one that plays move it
    store.put(third, 1)
    store.put(first, 1)
    if board.has(Feature.CORRECTION):
        upload_correction(board, bytes(board.identity.transducers))
    board.wire.idle(_SEEN * period_us)
    board.link.ask(Mute())
    got = [latch.crc for latch in latches_received_from_board(board, since, TraceMode.CRC)]
    due = store.crcs[second] * len(got)
    check(len(got) >= _SEEN, f"{len(got)} latches while others are uploaded")
    check_equal(got, due[: len(got)], "the sequence that plays changes while others are uploaded")
    store.check_all("uploaded while another one played")


def _period_to_trace(board: BoardClient) -> int:
    """Return a period in which a slow line brings the trace of a latch beside the replies."""
    return board.wire.period_us(_TRACED_BYTES, 2000)


@case("HG-7.2/5-commit", needs=TRACED_PLAYS, evidence=SELF_REPORTED)
def no_upload_replaces_the_sequence_that_plays(board: BoardClient) -> None:
    """an upload begun before PLAY is refused while its sequence waits or plays, and taken after
    it
    """
    board.configure(trace_mode=TraceMode.CRC)
    store = SequenceStore(board)
    for waits, end in itertools.product((False, True), (Stop(), Mute())):
        _judge_commit_of_playing_sequence(store, end, waits=waits)


def _judge_commit_of_playing_sequence(store: SequenceStore, end: Message, *, waits: bool) -> None:
    """Complete an upload, play the sequence that it is to replace, and commit it before *end*."""
    board, sequence = store.board, _IDS[0]
    name = f"a playback that {'waits' if waits else 'plays'}, until {end.TYPE.name}"
    store.put(sequence, 1)
    drive = board.random.randbytes(board.identity.transducers)
    begin_upload(board, UploadKind.PHASES, sequence, drive)
    send_upload_chunks(board, drive)
    board.arm()
    since, period_us = board.link.mark(), _period_to_trace(board)
    if waits:
        play_later(board, sequence, _WAITS_US, period_us=period_us)
    else:
        play_now(board, sequence, loops=0, period_us=period_us)
    for _ in range(2):
        board.link.refused(UploadCommit(sequence), ErrorCode.BAD_STATE)
    board.wire.idle(3 * period_us)
    board.link.ask(end)
    got = [latch.crc for latch in latches_received_from_board(board, since, TraceMode.CRC)]
    check(waits or bool(got), f"{name}: nothing is latched")
    same = got == store.crcs[sequence] * len(got)
    check(same, f"{name}: an upload whose commit is refused is played")
    board.link.call(UploadCommit(sequence), UploadCommitReply)
    store.crcs[sequence] = [drive_crc(drive)]
    store.check_all(f"committed behind {name}")


@case("HG-7.4/5", needs_reset=True)
def no_sequence_outlives_a_reset(board: BoardClient) -> None:
    """after a reset no sequence of either kind is stored, and no upload is under way"""
    board.hello()
    board.need_any(Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS)
    stored = [form for form in upload_forms(board) if form.target]
    frames = {UploadKind.PHASES: bytes(board.identity.transducers), UploadKind.POINTS: _FOCUS}
    for form in stored:
        replace(form, target=SEQUENCES[form.kind]).upload(board, frames[form.kind])
        replace(form, target=SEQUENCES[0]).begin(board, frames[form.kind])
    board = board.restarted()
    board.link.refused(UploadChunk(0, b"\x00"), ErrorCode.BAD_STATE)
    board.arm()
    for form in stored:
        period_us = period_to_play(board, 1)
        play = play_request(board, SEQUENCES[form.kind], loops=1, period_us=period_us)
        board.link.refused(play, ErrorCode.NOT_FOUND, 0, flags=Flag.IMMEDIATE)


@case("HG-7.6/1-many", needs=TRACED_PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def many_sequences_are_stored(board: BoardClient) -> None:
    """one sequence more at a time, to TOO_LARGE or 70: each is played, NOT_FOUND tells their
    number
    """
    board.configure(trace_mode=TraceMode.CRC)
    store, frame = SequenceStore(board), board.identity.transducers
    for sequence in SEQUENCES:  # later cases find room for theirs
        store.put(sequence, 1)
    board.arm()
    held = _refused_play_of_sequence(board, _ABSENT)
    for sequence in range(_ABSENT + 1, _ABSENT + 1 + _MANY):
        is_new = _refused_play_of_sequence(board, sequence) is not None
        answer = board.link.ask(UploadBegin(UploadKind.PHASES, 0, sequence, frame, 0))
        if isinstance(answer.message, Error):  # no room for one more
            board.link.error_in(answer, UploadBegin.TYPE, ErrorCode.TOO_LARGE)
            break
        for _ in range(2):  # the second replaces the first
            store.put(sequence, 1)
        told, due = _refused_play_of_sequence(board, _ABSENT), (held or 0) + is_new
        text = f"NOT_FOUND told {held or 0} stored sequences before two uploads"
        check_equal(told, due, f"{text} of {'a new' if is_new else 'the same'} one, then {told}")
        held = told
    store.check_all(f"{len(store.crcs)} sequences")


def _refused_play_of_sequence(board: BoardClient, sequence: int) -> int | None:
    """Return the detail of NOT_FOUND, the number of stored sequences; None if this one is there."""
    start_us = board.clock.ahead_us(_AHEAD_US)
    play = play_request(board, sequence, loops=1, unattended_ms=9_999)
    answer = board.link.ask(play, time_us=start_us)
    if isinstance(answer.message, PlayReply):
        board.link.call(Stop(), StopReply)
        return None
    return board.link.error_in(answer, Play.TYPE, ErrorCode.NOT_FOUND).detail
