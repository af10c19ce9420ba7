"""HG-4.6: HELLO with the nonce of the session, and with a new one."""

from __future__ import annotations

import dataclasses
import itertools

from haptogram_protocol.messages import (
    Arm,
    ErrorCode,
    Feature,
    HelloReply,
    Mute,
    Ping,
    Pong,
    TraceMode,
    UploadChunk,
    UploadCommit,
    UploadKind,
    signed_difference,
)
from haptogram_protocol.state import MuteReason, OutputState

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import latch_now, latch_random, read_ring
from ...client.playback import (
    play_out,
    send_phases_to_store,
)
from ...client.uploads import begin_upload
from ...outcome import SELF_REPORTED, check, check_equal
from ..ch06_output.mute import check_ends_playback, check_flushes


@case("HG-4.6/1")
def same_nonce(board: BoardClient) -> None:
    """HELLO with the open nonce: same reply; ARMED, queue and numbers stay; repeated + 1"""
    first = board.hello()
    board.arm()
    t_us = board.clock.soon_us(bytes(2000))
    with board.counting(repeated=1, latched=2):
        board.link.stream(board.flat_phases(), t_us)
        again = board.hello(board.link.session)
        board.clock.wait_until(t_us)
        latch_now(board)
    check_equal(again, first, "HELLO again has another reply than the first")
    board.check_state(OutputState.ARMED, "HELLO of the open session has led to")


@case("HG-4.6/1-time")
def same_nonce_keeps_time(board: BoardClient) -> None:
    """HELLO with the open nonce: its own number, and a time between those of two PONGs around it"""
    greeting = board.hello_message(board.link.session)
    first = board.link.ask(greeting)
    board.wire.idle(20_000)
    answers = [board.link.ask(message) for message in (Ping(1), greeting, Ping(2))]
    check_equal(answers[1].message, first.message, "a repeated HELLO has another reply")
    times = [answer.frame_header.time_us for answer in answers]
    steps = [signed_difference(b, a, 32) for a, b in itertools.pairwise(times)]
    check(min(steps) >= 0, f"times of PONG, HELLO_REPLY and PONG in a row: {times}")


@case("HG-4.6/1-fields")
def same_nonce_other_fields(board: BoardClient) -> None:
    """HELLO with the open nonce, another minor version, description or number: the same greeting"""
    first = board.hello()
    board.arm()
    index = latch_now(board)
    same = board.hello_message(board.link.session)
    others = ({"minor": same.minor + 1}, {"minor": 255}, {"reserved": 0xFFFFFFFF}, {"reserved": 1})
    with board.counting(repeated=len(others)):
        for fields in others:
            again = board.link.call(dataclasses.replace(same, **fields), HelloReply)
            check_equal(again, first, f"HELLO with {fields}: another reply than the first")
    status = board.status()
    found = (status.state, status.last_seq)
    check_equal(found, (OutputState.ARMED, index), f"HELLO of the open session has led to {found}")


@case("HG-4.6/2")
def new_nonce_and_state(board: BoardClient) -> None:
    """a new nonce: ARMED becomes DISARMED (NEW_SESSION), MUTED stays MUTED"""
    board.arm()
    latch_now(board)
    board.hello()
    status = board.status()
    found = (status.state, status.reason)
    due = (OutputState.DISARMED, MuteReason.NEW_SESSION)
    check_equal(found, due, f"ARMED, then a new session: {found[0].name}, {found[1].name}")
    board.link.ask(Mute())
    state = board.hello().state
    check_equal(state, OutputState.MUTED, f"MUTED, then a new session: {state.name}")
    board.link.ask(Arm())


@case("HG-4.6/3", evidence=SELF_REPORTED)
def new_nonce_flushes(board: BoardClient) -> None:
    """a new nonce flushes the queue; no queued frame is latched"""
    check_flushes(board, board.hello)


@case("HG-4.6/3-playback", needs=Feature.SEQUENCE_PHASES)
def new_nonce_ends_playback(board: BoardClient) -> None:
    """a new nonce ends playback and abandons an upload"""
    check_ends_playback(board, board.hello, "HELLO")
    data = bytes(board.identity.transducers)
    begin_upload(board, UploadKind.PHASES, 4, data)
    board.hello()
    board.link.refused(UploadChunk(0, data[:1]), ErrorCode.BAD_STATE)
    board.link.refused(UploadCommit(4), ErrorCode.BAD_STATE)


@case("HG-4.6/4")
def new_nonce_starts_anew(board: BoardClient) -> None:
    """a new nonce: requests and stream count anew, an old reply is forgotten"""
    board.arm()
    latch_random(board, 20)
    board.link.seq = 500
    nonce = board.new_nonce()
    board.hello(nonce, seq=3)
    board.link.call(Ping(1), Pong, seq=4)  # far behind 500
    board.arm_at(5)
    with board.counting(latched=1):
        index = latch_now(board)
    last = board.status().last_seq
    check_equal(last, index, f"first frame of a session has the number {index}, last_seq is {last}")


@case("HG-4.6/4-ring", needs=Feature.TRACE_RING | Feature.CONFIG, evidence=SELF_REPORTED)
def new_nonce_empties_ring(board: BoardClient) -> None:
    """a new nonce empties the trace ring"""
    board.arm(trace_mode=TraceMode.RING)
    latch_random(board, 3)
    board.hello()
    reply = read_ring(board)
    check(not reply.records and reply.next == 0, f"the ring still holds {len(reply.records)}")


@case("HG-4.6/5", needs=Feature.CONFIG)
def new_nonce_keeps_settings(board: BoardClient) -> None:
    """a new nonce keeps configuration and counters"""
    sent = board.configure(hold_ms=4321, ramp_ms=77)
    before = board.status()
    board.hello()
    after = board.status()
    check_equal(board.read_config(), sent, "HELLO has changed the configuration")
    crc, due = after.config_crc, before.config_crc
    check_equal(crc, due, "config_crc has changed: the correction is gone")
    grown = after.counters.requests - before.counters.requests
    check_equal(grown, 2, f"requests went up by {grown} over HELLO and GET_STATUS")


@case("HG-4.6/5-sequences", needs=Feature.SEQUENCE_PHASES)
def new_nonce_keeps_sequences(board: BoardClient) -> None:
    """a new nonce keeps stored sequences"""
    send_phases_to_store(board, 3, frames=2)
    board.hello()
    board.arm()
    with board.counting(latched=2):
        play_out(board, 3, 2)


@case("HG-4.6/6")
def hello_of_any_number(board: BoardClient) -> None:
    """HELLO is accepted with number 0, 0x8000, 0xFFFF, ...; the next request counts from there"""
    for seq in (0, 0x8000, 0xFFFF, 0x7FFF, 1):
        board.hello(seq=seq)
        board.link.seq = seq
        board.link.refused_as_used(Ping(1))
        board.link.call(Ping(2), Pong)
