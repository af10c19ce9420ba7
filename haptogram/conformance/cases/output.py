"""Chapter 6, output states: the table, MUTE above all, and silence where it is due."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    DisarmReply,
    DriveKind,
    DriveReply,
    ErrorCode,
    Feature,
    Message,
    Mute,
    MuteReply,
    Play,
    PlaybackEnded,
    ReadDrive,
    StateChanged,
    Stop,
    UploadCommit,
)
from haptogram_protocol.state import OUTPUT_TRANSITIONS, MuteReason, OutputInput, OutputState

from ..case import about_host, case, unobservable
from ..client.board_client import Bench
from ..client.latching import is_silent, latch_now, radiated, shown_in
from ..client.playback import play_now, store_phases
from ..outcome import EXTERNAL, SELF_REPORTED, check, fail

_SEQUENCES: Final = Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS
_STATES: Final = (OutputState.DISARMED, OutputState.ARMED, OutputState.MUTED)
_INPUTS: Final[dict[OutputInput, Message]] = {
    OutputInput.ARM: Arm(),
    OutputInput.MUTE: Mute(),
    OutputInput.DISARM: Disarm(),
    OutputInput.STOP: Stop(),
}
_REASONS: Final = {
    OutputInput.ARM: MuteReason.NONE,
    OutputInput.MUTE: MuteReason.MUTE,
    OutputInput.DISARM: MuteReason.DISARM,
    OutputInput.NEW_SESSION: MuteReason.NEW_SESSION,
}

host_keeps_room = about_host("HG-6.4/3")
fault_lasts = unobservable(
    "HG-6.6/3", "a fault of the hardware, which nothing on the line can bring about", EXTERNAL
)


def _bring_to(bench: Bench, state: OutputState) -> None:
    bench.arm()
    if state is OutputState.DISARMED:
        bench.disarm()
    elif state is OutputState.MUTED:
        bench.ask(Mute())


@case(
    "HG-6.1/1",
    "after a reset: DISARMED, NEVER_ARMED, nothing radiated; frames are dropped",
    needs_reset=True,
)
def starts_disarmed(bench: Bench) -> None:
    state = bench.hello().state
    check(state is OutputState.DISARMED, f"after a reset HELLO_REPLY says {state.name}")
    found = bench.status()
    check(found.state is OutputState.DISARMED, f"after a reset the state is {found.state.name}")
    with bench.counting(dropped_state=1, latched=0):
        latch_now(bench, bench.flat_phases())
    if bench.has(Feature.READ_RADIATED):
        check(is_silent(bench), "transducers are driven after a reset")


@case("HG-6.2/1", "ARM, MUTE, DISARM, STOP and HELLO in every state lead where the table says")
def follows_the_table(bench: Bench) -> None:
    for state in _STATES:
        for event in (*_INPUTS, OutputInput.NEW_SESSION):
            if event is OutputInput.STOP and not bench.identity.features & _SEQUENCES:
                continue
            _bring_to(bench, state)
            _do(bench, event)
            due = OUTPUT_TRANSITIONS[state, event]
            found = bench.status()
            check(
                found.state is due,
                f"{event.name} while {state.name}: {found.state.name}, due is {due.name}",
            )
            if due is not state and event in _REASONS:
                check(
                    found.reason is _REASONS[event],
                    f"{event.name} while {state.name}: reason {found.reason.name}",
                )


def _do(bench: Bench, event: OutputInput) -> None:
    if event is OutputInput.NEW_SESSION:
        bench.hello()
        return
    message = _INPUTS[event]
    reply = bench.ask(message).message
    state = getattr(reply, "state", None)
    if state is None:
        fail(f"{event.name} is not answered by its reply")
    told = bench.status().state
    check(state is told, f"the reply to {event.name} says {state.name}, STATUS {told.name}")


@case("HG-6.2/1", "PLAY while DISARMED and MUTED is refused", variant="play")
def plays_only_when_armed(bench: Bench) -> None:
    bench.need(Feature.SEQUENCE_PHASES)
    store_phases(bench, 1, frames=2)
    for state in (OutputState.DISARMED, OutputState.MUTED):
        _bring_to(bench, state)
        bench.refused(Play(1, 1000, 1, 100), ErrorCode.BAD_STATE, int(state), flags=0x10)


@case("HG-6.2/2", "ERROR(BAD_STATE) has the output state as its detail, in each state")
def tells_the_state(bench: Bench) -> None:
    bench.need_any(_SEQUENCES | Feature.CORRECTION)
    for state in _STATES:
        _bring_to(bench, state)
        bench.refused(UploadCommit(1), ErrorCode.BAD_STATE, int(state))


@case(
    "HG-6.2/3",
    "an input that leaves the state, but for MUTE, leaves the reason too",
    evidence=SELF_REPORTED,
)
def keeps_the_reason(bench: Bench) -> None:
    for state in _STATES:
        for event in (OutputInput.ARM, OutputInput.DISARM, OutputInput.NEW_SESSION):
            if OUTPUT_TRANSITIONS[state, event] is not state:
                continue
            _bring_to(bench, state)
            before = bench.status().reason
            _do(bench, event)
            after = bench.status().reason
            check(
                after is before,
                f"{event.name} while {state.name}: the reason was {before.name}, is {after.name}",
            )


@case(
    "HG-6.3/1",
    "after a latch, DISARM and ARM nothing is radiated until the next latch",
    needs=Feature.READ_RADIATED,
    evidence=SELF_REPORTED,
)
def is_silent_until_the_first_latch(bench: Bench) -> None:
    bench.arm()
    check(is_silent(bench), "ARM makes a sound")
    latch_now(bench, bench.flat_phases())
    check(not is_silent(bench), "a latch is not radiated")
    bench.disarm()
    bench.arm()
    check(is_silent(bench), "ARM sounds the drive that was latched before")
    latch_now(bench, bench.flat_phases())
    check(not is_silent(bench), "a latch is not radiated")


@case("HG-6.3/2", "ARM while ARMED keeps the queue and the drive", evidence=SELF_REPORTED)
def arms_again(bench: Bench) -> None:
    bench.arm()
    latch_now(bench, bench.flat_phases())
    t_us = bench.soon_us(bytes(1500))
    with bench.counting(latched=2, flushed=0):
        for number in range(2):
            bench.send(bench.stream_wire(bench.flat_phases(), t_us + number * 1000))
        bench.arm()
        bench.in_time(t_us)
        if bench.has(Feature.READ_RADIATED):
            check(not is_silent(bench), "ARM while ARMED silences the board")
        bench.until(t_us + 2000)


@case("HG-6.4/1", "MUTE in every state, from no session and with a payload, mutes; frames drop")
def mutes_always(bench: Bench) -> None:
    for state in _STATES:
        for header in ({}, {"session": 0}, {"session": bench.session ^ 0x1111}, {"flags": 0xF0}):
            _bring_to(bench, state)
            if state is OutputState.ARMED:
                latch_now(bench, bench.flat_phases())
            answer = bench.ask_raw(Mute.TYPE, b"\x01\x02\x03", **header)
            said = bench.reply_in(answer, MuteReply, Mute.TYPE).state
            found = bench.status()
            check(
                said is found.state is OutputState.MUTED,
                f"MUTE while {state.name}: {said.name}, then {found.state.name}",
            )
            with bench.counting(dropped_state=1, latched=0):
                latch_now(bench, bench.flat_phases())
            if bench.has(Feature.READ_RADIATED):
                check(is_silent(bench), "MUTE is acknowledged, but the board still radiates")


def _check_flush(bench: Bench, message: Message) -> None:
    bench.arm()
    t_us = bench.soon_us(bytes(2000)) + 20_000
    with bench.counting(flushed=3, latched=0):
        for number in range(3):
            bench.send(bench.stream_wire(bench.flat_phases(), t_us + number * 1000))
        bench.ask(message)
        bench.in_time(t_us)
        bench.arm()
        bench.until(t_us + 4000)


def _check_end_of_playback(bench: Bench, message: Message) -> None:
    if not bench.has(Feature.SEQUENCE_PHASES):
        return
    store_phases(bench, 2, frames=3)
    bench.arm()
    since = bench.mark()
    play_now(bench, 2, loops=0)
    bench.wire.idle(5000)
    bench.ask(message)
    event = bench.await_event(PlaybackEnded, since, 20_000 + bench.wire.limits.slack_us)
    check(event is not None, f"{message.TYPE.name} did not end the playback")
    bench.arm()
    with bench.counting(latched=0):
        bench.wire.idle(10_000)


@case("HG-6.4/2", "MUTE flushes 3 queued frames and ends a playback", evidence=SELF_REPORTED)
def mute_flushes(bench: Bench) -> None:
    _check_flush(bench, Mute())
    _check_end_of_playback(bench, Mute())


@case(
    "HG-6.4/4",
    "MUTE, of the session and of none, while a timer has muted: the reason becomes MUTE",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def mute_takes_the_reason(bench: Bench) -> None:
    for session in (bench.session, 0):
        bench.configure(hold_ms=20, ramp_ms=0)
        bench.arm()
        latch_now(bench, bench.flat_phases())
        bench.wire.idle(40_000 + bench.wire.limits.slack_us)
        before = bench.status().reason
        check(before is MuteReason.HOLD_EXPIRED, f"the hold ran out, the reason is {before.name}")
        bench.call(Mute(), MuteReply, session=session)
        after = bench.status().reason
        check(after is MuteReason.MUTE, f"MUTE while MUTED: the reason is {after.name}")


@case("HG-6.5/1", "DISARM flushes 3 queued frames and ends a playback", evidence=SELF_REPORTED)
def disarm_flushes(bench: Bench) -> None:
    _check_flush(bench, Disarm())
    _check_end_of_playback(bench, Disarm())


@case("HG-6.5/2", "DISARM while MUTED: DISARM_REPLY and STATUS say MUTED")
def disarm_leaves_muted(bench: Bench) -> None:
    bench.ask(Mute())
    said, found = bench.call(Disarm(), DisarmReply).state, bench.status().state
    check(said is found is OutputState.MUTED, f"{said.name}, then {found.name}")


@case(
    "HG-6.6/1",
    "a read-back of what is radiated, right behind MUTE, DISARM and HELLO, shows silence",
    needs=Feature.READ_RADIATED,
    evidence=SELF_REPORTED,
)
def is_off_at_once(bench: Bench) -> None:
    for message in (Mute(), Disarm(), bench.hello_message(bench.new_nonce())):
        bench.settle()
        bench.arm()
        latch_now(bench, bench.flat_phases())
        check(radiated(bench).loudest > 0, "a latch is not radiated")
        greets = message.TYPE == bench.hello_message(1).TYPE
        session = getattr(message, "nonce", bench.session)
        order, _ = bench.request_wire(message, session=0 if greets else bench.session)
        read = ReadDrive(DriveKind.RADIATED, 0, bench.identity.transducers)
        look, seq = bench.request_wire(read, session=session)
        since = bench.mark()
        bench.send(order, look)
        answer = bench.answer_to(ReadDrive.TYPE, seq, since)
        bench.session = session
        shown = shown_in(bench.reply_in(answer, DriveReply, ReadDrive.TYPE))
        check(shown.loudest == 0, f"right behind {message.TYPE.name}: amplitude {shown.loudest}")


@case(
    "HG-6.6/2",
    "in DISARMED and MUTED nothing is radiated, whatever was latched before",
    needs=Feature.READ_RADIATED,
    evidence=SELF_REPORTED,
)
def is_off_unless_armed(bench: Bench) -> None:
    for message in (Mute(), Disarm()):
        bench.arm()
        latch_now(bench, bench.flat_phases())
        bench.ask(message)
        for _ in range(3):
            check(is_silent(bench), f"after {message.TYPE.name} the board radiates")
            bench.wire.idle(20_000)
        latch_now(bench, bench.flat_phases())
        check(is_silent(bench), f"after {message.TYPE.name} a stream frame is radiated")


@case("HG-6.8/2", "MUTE of no session and of another one: STATE_CHANGED(MUTED, MUTE)")
def tells_of_a_foreign_mute(bench: Bench) -> None:
    for session in (0, bench.session ^ 0x0AA0):
        bench.arm()
        since = bench.mark()
        bench.ask(Mute(), session=session)
        found = bench.await_event(StateChanged, since, 20_000 + bench.wire.limits.slack_us)
        check(found is not None, f"MUTE of session {session:#06x}: no STATE_CHANGED")
        if found is not None:
            event = found[1]
            check(
                (event.state, event.reason) == (OutputState.MUTED, MuteReason.MUTE),
                f"STATE_CHANGED says {event.state.name}, {event.reason.name}",
            )


@case("HG-6.8/1", "when the lease and the hold run out STATE_CHANGED says so", needs=Feature.CONFIG)
def tells_of_a_timer(bench: Bench) -> None:
    for reason, changes in (
        (MuteReason.HOST_SILENT, {"host_timeout_ms": 100}),
        (MuteReason.HOLD_EXPIRED, {"hold_ms": 50}),
    ):
        bench.configure(**changes)
        bench.arm()
        since = bench.mark()
        latch_now(bench, bench.flat_phases())
        found = bench.await_event(StateChanged, since, 200_000 + bench.wire.limits.slack_us)
        if found is None:
            fail(f"{reason.name}: no STATE_CHANGED within 200 ms")
        got = (found[1].state, found[1].reason)
        check(got == (OutputState.MUTED, reason), f"{reason.name}: {got[0].name}, {got[1].name}")
