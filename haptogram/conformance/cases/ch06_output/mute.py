"""HG-6.4, HG-6.5, HG-6.6, HG-6.12: MUTE, DISARM, silence after them and without a program."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.state import MuteReason, OutputState

from ...case import case, case_about_host, unobservable_case
from ...client import latching
from ...client.board_client import BoardClient
from ...outcome import EXTERNAL, SELF_REPORTED, check, check_fields
from ..ch07_configuration.playback import judge_ended_playback

_STATES: Final = (OutputState.DISARMED, OutputState.ARMED, OutputState.MUTED)


host_keeps_room = case_about_host("HG-6.4/3")


hangs_silently = unobservable_case(
    "HG-6.12/1", "no frame makes the program of a board hang: stop it in a debugger", EXTERNAL
)


resets_silently = unobservable_case(
    "HG-6.12/2", "a board that is being reset says nothing; its drive pins do (--capture)", EXTERNAL
)


@case("HG-6.4/1")
def mutes_in_every_output_state(board: BoardClient) -> None:
    """MUTE mutes in every state, without a session and with a payload; frames are dropped"""
    foreign = board.link.session ^ 0x1111
    headers: tuple[dict[str, int], ...] = (
        {},
        {"session": 0},
        {"session": foreign},
        {"flags": 0xF0},
    )
    for state, header in itertools.product(_STATES, headers):
        board.bring_to(state)
        if state is OutputState.ARMED:
            latching.latch_now(board)
        answer = board.link.ask_raw(m.Mute.TYPE, b"\x01\x02\x03", **header)
        text = f"MUTE with {header} while {state.name}"
        reply = board.link.reply_in(answer, m.MuteReply, m.Mute.TYPE)
        board.check_status(text, state=OutputState.MUTED)
        check_fields(reply, f"{text}: MUTE_REPLY", state=OutputState.MUTED)
        with board.counting(dropped_state=None, latched=0):
            latching.latch_now(board)
        latching.check_silent(board, "MUTE is acknowledged")


def check_flushes(board: BoardClient, end: Callable[[], object]) -> None:
    """FAILED unless *end* of the output flushes queued frames."""
    board.arm()
    t_us = board.clock.soon_us(bytes(2000), ahead_us=10_000)
    with board.counting(flushed=3, latched=0):
        latching.queue_frames(board, t_us, 3)
        board.link.barrier()  # or MUTE may overtake them (HG-3.8/2)
        end()
        board.arm()
        board.clock.wait_until(t_us + 4000)


def _check_request_ends(board: BoardClient, message: m.Message) -> None:
    """FAILED unless the request *message* flushes the queue and, if supported, ends a playback."""
    end = partial(board.link.ask, message)
    check_flushes(board, end)
    if board.has(m.Feature.SEQUENCE_PHASES):
        judge_ended_playback(board, lambda _: end(), message.TYPE.name)


@case("HG-6.4/2", evidence=SELF_REPORTED)
def mute_flushes(board: BoardClient) -> None:
    """MUTE flushes 3 queued frames and ends a playback"""
    _check_request_ends(board, m.Mute())


@case("HG-6.5/1", evidence=SELF_REPORTED)
def disarm_flushes_the_output(board: BoardClient) -> None:
    """DISARM flushes 3 queued frames and ends a playback"""
    _check_request_ends(board, m.Disarm())


@case("HG-6.4/4", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def mute_takes_the_reason(board: BoardClient) -> None:
    """MUTE, with and without a session, after a timer has muted: the reason becomes MUTE"""
    for session in (board.link.session, 0):
        since = board.arm(hold_ms=20)
        latching.latch_now(board)
        board.link.await_event(m.StateChanged, since, 40_000)
        board.check_status("the hold ran out", reason=MuteReason.HOLD_EXPIRED)
        board.mute(session=session)
        board.check_status("MUTE while MUTED", reason=MuteReason.MUTE)


@case("HG-6.5/2")
def disarm_leaves_muted_state(board: BoardClient) -> None:
    """DISARM while MUTED: DISARM_REPLY and STATUS say MUTED"""
    board.mute()
    reply = board.link.call(m.Disarm(), m.DisarmReply)
    check_fields(reply, "DISARM while MUTED: DISARM_REPLY", state=OutputState.MUTED)
    board.check_status("DISARM while MUTED", state=OutputState.MUTED)


@case("HG-6.6/1", needs=m.Feature.READ_RADIATED, evidence=SELF_REPORTED)
def output_is_off_at_once(board: BoardClient) -> None:
    """the radiated drive, read back right behind MUTE, DISARM and HELLO, is silent"""
    for message in (m.Mute(), m.Disarm(), board.hello_message(board.new_nonce())):
        board.prepare()
        board.arm()
        latching.latch_now(board)
        check(latching.read_back_radiated(board).loudest > 0, "a latch is not radiated")
        session = 0 if isinstance(message, m.Hello) else board.link.session
        order, _ = board.link.request_wire(message, session=session)
        board.link.session = getattr(message, "nonce", board.link.session)
        read = m.ReadDrive(m.DriveKind.RADIATED, 0, board.identity.transducers)
        *_, answer = board.link.exchange(order, board.link.request_wire(read)[0])
        shown = latching.client_drive_of_reply(
            board.link.reply_in(answer, m.DriveReply, m.ReadDrive.TYPE)
        )
        check_fields(shown, f"right behind {message.TYPE.name}", loudest=0)


@case("HG-6.6/2", needs=m.Feature.READ_RADIATED, evidence=SELF_REPORTED)
def output_is_off_unless_armed(board: BoardClient) -> None:
    """in DISARMED and MUTED nothing is radiated, whatever was latched before"""
    for message in (m.Mute(), m.Disarm()):
        board.arm()
        latching.latch_now(board)
        board.link.ask(message)
        for _ in range(3):
            latching.check_silent(board, f"after {message.TYPE.name}")
            board.wire.idle(10_000)
        latching.latch_now(board)
        latching.check_silent(board, f"after {message.TYPE.name} and a stream frame")
