"""Boards that are wrong, ports that are no boards: a clear verdict, and never a hang."""

import dataclasses
import itertools
import re
import shlex
import sys
from pathlib import Path

import pytest
from boards import BAUD, Dying, Wrapped, port, run, virtual
from identities import identity

from haptogram.conformance.case import Case, Depth
from haptogram.conformance.client import wire
from haptogram.conformance.client.latching import latch_now
from haptogram.conformance.client.recording import DialogueRecording, TransferDirection
from haptogram.conformance.judge.timers import judge_in_time
from haptogram.conformance.outcome import CaseEndedError, check, inconclusive
from haptogram.conformance.run.access import VirtualAccess
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.run.spawning import SpawnAccess
from haptogram.conformance.verdict import Behaviour, CaseResult, suite_exit_status
from haptogram.records.frame import Evidence
from haptogram.report.conformance.text import folded_transcript, marked_transcript, suite_text
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    Arm,
    ArmReply,
    DriveReply,
    Error,
    ErrorCode,
    Feature,
    Flag,
    GetStatus,
    MessageType,
    Phases,
    StopReply,
    build_body,
    parse_body,
)
from haptogram_protocol.state import MuteReason
from sim_device.board.counters import BoardCounters, Drop
from sim_device.board.output import BoardOutput

pytestmark = pytest.mark.sampled(2)

FEW = ("HG-2", "HG-4.3", "HG-6.2")


def behaviours(suite):
    return {result.case: result.behaviour for result in suite.results}


class Rewritten(Wrapped):
    """A board whose frames are changed on their way to the host."""

    def __init__(self, inner, change):
        super().__init__(inner)
        self.change, self.decoder = change, FrameDecoder()

    def read_available(self, deadline_ns):
        bodies = self.decoder.feed(super().read_available(deadline_ns))
        return b"".join(encode_frame(self.change(body)) for body in bodies)


def marked_frames(result):
    return [line.split()[4] for line in folded_transcript(result) if line.startswith("> ")]


def test_the_frames_that_a_finding_speaks_of_are_marked_and_not_those_that_are_due():
    def taken(body):
        header, message = parse_body(body)
        if not isinstance(message, Error) or message.request != MessageType.STOP:
            return body
        keys = {"seq": header.seq, "time_us": header.time_us, "session": header.session}
        return build_body(StopReply(0), flags=0, **keys)

    access = virtual(array="3x2", wrap=lambda inner: Rewritten(inner, taken))
    [result] = run(access, "HG-3.5/1").results
    assert result.detail.endswith(
        "ERROR(UNSUPPORTED), detail 0x10; got STOP_REPLY (state DISARMED)"
    )
    assert marked_frames(result) == ["STOP", "STOP_REPLY"]


def test_frames_sent_before_are_told_with_their_numbers_and_times():
    recording = DialogueRecording()

    def send(message, seq, t_us=0, flags=0):
        body = build_body(message, seq=seq, time_us=t_us, session=7, flags=flags)
        recording.add(0, TransferDirection.HOST, encode_frame(body))

    for seq in (65535, 0, 1):
        send(Phases(b"\0"), seq, t_us=100 + seq)
    for seq in (1, 65500, 2):
        send(Phases(b"\0"), seq, flags=Flag.IMMEDIATE)
    send(Arm(), 8)
    body = build_body(ArmReply(1), seq=8, time_us=0, session=7, flags=0)
    recording.add(0, TransferDirection.BOARD, encode_frame(body))
    send(GetStatus(), 9)
    text = "3 x PHASES 65535 to 1 for t 65635 to 101, 3 x PHASES IMMEDIATE 1, 65500, 2"
    assert recording.before(9) == f"sent before: {text}, ARM -> ARM_REPLY"
    send(GetStatus(), 8)
    assert recording.before(9) == f"sent before: {text}, ARM"  # of which number 8 is unknown


def test_a_failure_shows_its_bytes_and_what_they_mean():
    def armed_for_muted(body):
        lies = body[0] == MessageType.MUTE_REPLY
        return body[:10] + b"\x01" if lies else body

    access = virtual(array="4x4", wrap=lambda inner: Rewritten(inner, armed_for_muted))
    suite = run(access, "HG-6.4/1", "HG-2.3")
    mutes = {"HG-6.4/1": Behaviour.FAILED, "HG-6.4/1-sizes": Behaviour.FAILED}
    assert behaviours(suite) == mutes | {"HG-2.3/1": Behaviour.OK}
    failed = next(r for r in suite.results if r.case == "HG-6.4/1")
    text = "\n".join(failed.transcript)
    assert "= MUTE seq" in text
    assert "= MUTE_REPLY seq" in text
    assert "state ARMED" in text
    assert "02 42" in text
    shown = [line for line in folded_transcript(failed) if line.startswith("> ")]
    assert marked_frames(failed) == ["MUTE", "MUTE_REPLY"]
    assert all(line in suite_text(suite) for line in shown)
    assert len(list(folded_transcript(failed))) <= 14 < len(failed.transcript)
    assert sum(line.startswith("> ") for line in marked_transcript(failed)) < 10
    assert suite.exit_status == 1


def test_a_latch_that_does_not_end_the_ramp_of_the_hold_fails():
    def not_at_full_amplitude(body):
        if body[0] != DriveReply.TYPE:
            return body
        header, reply = parse_body(body)
        dimmed = dataclasses.replace(reply, data=reply.data.replace(b"\xff", b"\xe5"))
        keys = {"seq": header.seq, "time_us": header.time_us, "session": header.session}
        return build_body(dimmed, flags=0, **keys)

    access = virtual(array="3x2", wrap=lambda inner: Rewritten(inner, not_at_full_amplitude))
    [result] = run(access, "HG-6.11/4-latches").results
    assert result.behaviour is Behaviour.FAILED
    assert result.detail.startswith("a frame at once, ")
    text = "the amplitude in DRIVE_REPLY is 229, due at 203.9 ms; the straight line allows 254"
    assert text in result.detail


@pytest.mark.parametrize(
    ("turned", "back", "words"),
    [
        (50, 0, r"1 equal points, lag 0x\w+: phase \d+ is \d+, due is [\d.]+"),
        (50, 1, r"1 equal points, .*: frame 65520 was sent, and DRIVE_REPLY shows frame 65519: ph"),
    ],
)
def test_a_wrong_drive_of_points_is_told_by_its_worst_code_and_its_frame(turned, back, words):
    def wrong(body):
        header, reply = parse_body(body)
        if not isinstance(reply, DriveReply):
            return body
        data = bytes([(reply.data[0] + turned) % 256]) + reply.data[1:]
        key = dataclasses.replace(reply.key, index=reply.key.index - back)
        keys = {"seq": header.seq, "time_us": header.time_us, "session": header.session}
        return build_body(dataclasses.replace(reply, key=key, data=data), flags=0, **keys)

    access = virtual(array="3x2", wrap=lambda inner: Rewritten(inner, wrong))
    [result] = run(access, "HG-5.4/2-sums", depth=Depth.DEFAULT).results
    assert re.match(words, result.detail), result.detail


@pytest.mark.parametrize(
    ("trace", "behaviour"),
    [
        (Feature.TRACE, Behaviour.FAILED),
        (Feature.TRACE_DRIVE, Behaviour.FAILED),
        (Feature.TRACE_RING, Behaviour.NOT_OBSERVED),  # empty in the new session
    ],
)
def test_the_first_latches_of_two_sessions_in_one_carrier_period(trace, behaviour, monkeypatch):
    def boundary_us(output, t_us):
        return on_carrier(output, t_us) if output.latches else max(t_us, output.now_us)

    on_carrier = BoardOutput.boundary_us
    monkeypatch.setattr(BoardOutput, "boundary_us", boundary_us)
    access = identity(carrier_us=1000, features=Feature.CONFIG | trace)
    [result] = run(access, "HG-5.8/3-session", depth=Depth.DEFAULT).results
    assert result.behaviour is behaviour, result.detail


def test_a_counter_that_is_wrong_fails_the_clause_that_asks_for_it(monkeypatch):
    def drop(counters, dropped):
        if dropped is not Drop.STATE:
            count_drop(counters, dropped)

    count_drop = BoardCounters.drop
    monkeypatch.setattr(BoardCounters, "drop", drop)
    asked = ("HG-5.7/1", "HG-6.1", "HG-6.2", "HG-6.4/1", "HG-7.6/1")
    results = run(virtual(array="3x2"), *asked, depth=Depth.DEFAULT).results
    failed = [result for result in results if result.is_failure]
    cases = [f"HG-5.7/1{variant}" for variant in ("", "-fault", "-states", "-types")]
    assert [result.case for result in failed] == cases
    *_, asked, told = marked_frames(failed[0])
    assert (asked, told) == ("GET_STATUS", "STATUS_REPLY")  # which the finding speaks of


class Drowsy(Wrapped):
    """Loses so many writes after one that says so."""

    lost = 0

    def write_some(self, data):
        if data.startswith(b"lose "):
            self.lost = int(data[5:])
        elif self.lost:
            self.lost -= 1
        else:
            return super().write_some(data)
        return len(data)


@pytest.mark.parametrize(("writes", "frames", "status"), [(0, 1, 0), (2, 3, 0), (3, None, 1)])
def test_recovery_is_a_verdict_of_its_own(writes, frames, status):
    case = Case("HG-2.3/1", "loses writes", lambda board: board.link.send(b"lose %d" % writes))
    suite = SuiteRunner(virtual(array="4x4", wrap=Drowsy), SuiteOptions(timeout_s=0.2)).run([case])
    (result,) = suite.results
    assert result.behaviour is Behaviour.OK
    assert (result.recovery.frames, result.recovers) == (frames, status == 0)
    assert suite.exit_status == status


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("behaviour", "why"),
    [
        ({}, "the port is silent"),
        ({"say": lambda data: data}, "sends back what is written"),
        ({"say": lambda _: b"ok\r\n\x00"}, "but no frame"),
        ({"babble": b"login: "}, "is flooded"),
        ({"babble": b"\x00\x01" * 4000}, "is flooded"),
    ],
)
def test_a_port_that_is_no_board(behaviour, why):
    suite = run(port(**behaviour), *FEW, timeout_s=0.1)
    assert why in suite.cut_short
    assert set(behaviours(suite).values()) == {Behaviour.INCONCLUSIVE, Behaviour.NOT_OBSERVED}
    assert suite.exit_status == 3


def test_a_board_of_another_version():
    def version_1(body):
        if body[0] == MessageType.HELLO_REPLY:
            return bytes([MessageType.ERROR]) + body[1:10] + b"\x40\x07\x01\x00\x00\x00"
        return body

    suite = run(virtual(wrap=lambda inner: Rewritten(inner, version_1)), *FEW)
    assert "another major version" in suite.cut_short
    found = behaviours(suite)
    assert found["HG-2.4/1"] is found["HG-6.2/1"] is Behaviour.INCONCLUSIVE
    assert Behaviour.FAILED not in found.values()
    assert suite.exit_status == 3


def test_a_board_that_floods_has_failed_and_the_suite_ends():
    event = encode_frame(bytes([0xC3]) + bytes(9 + 11 + 4000))
    flood = virtual(array="4x4", wrap=lambda inner: Flooding(inner, 40 * event))
    flood.can_reset = False
    suite = run(flood, "HG-2.3", "HG-2.6", timeout_s=0.2)
    assert any("is flooded" in result.detail for result in suite.results if result.is_failure)
    assert suite.exit_status == 1


@pytest.mark.nightly
def test_a_flood_at_a_wall_clock_ends_cases_and_not_the_suite(monkeypatch):
    monkeypatch.setattr(wire, "_FLOOD_BYTES", 1500)
    words = [sys.executable, str(Path(__file__).with_name("right_boards.py")), "--serve"]
    access = SpawnAccess(
        shlex.join([*words, "--first", "2"]), baudrate=3_000_000, boot_timeout_s=60
    )
    suite = run(access, "HG-5.1", "HG-5.2", seed=2)
    assert "is flooded" in {r.case: r.detail for r in suite.results}["HG-5.2/6-slots"]
    assert suite.cut_short == ""


class Flooding(Wrapped):
    """A board that says the same thing at every look, once a host has greeted it."""

    def __init__(self, inner, said):
        super().__init__(inner)
        self.said, self.writes = said, 0

    def write_some(self, data):
        self.writes += 1
        return super().write_some(data)

    def read_available(self, deadline_ns):
        return super().read_available(deadline_ns) + (self.said if self.writes > 4 else b"")


def test_a_board_that_dies_in_mid_suite_keeps_the_results_so_far():
    access = virtual(array="4x4", wrap=lambda inner: Dying(inner, 150))
    access.can_reset = False
    starts = access.open
    opened = []

    def open_once():
        opened.append(1)
        if len(opened) > 1:
            raise CaseEndedError(Behaviour.FAILED, "no such port")
        return starts()

    access.open = open_once
    suite = run(access, "HG-2", "HG-3")
    found = [result.behaviour for result in suite.results]
    assert found[0] is Behaviour.OK
    assert found[-1] is Behaviour.INCONCLUSIVE
    assert "the board is gone" in suite.cut_short
    assert suite.exit_status == 1  # the case in which it died


def test_a_mixed_result_is_flaky_and_counts_as_failed():
    seen = []

    def body(_):
        seen.append(1)
        check(len(seen) != 2, "this time")

    case = Case("HG-2.3/1", "fails every second time", body)
    suite = SuiteRunner(virtual(array="4x4"), SuiteOptions(repeat=3)).run([case])
    (result,) = suite.results
    assert result.behaviour is Behaviour.FLAKY
    assert result.seen == (Behaviour.OK, Behaviour.FAILED, Behaviour.OK)
    assert suite.exit_status == 1


def test_a_result_that_is_right_or_not_judged_is_inconclusive():
    ends = iter([lambda: None, lambda: inconclusive("held up"), lambda: None])
    case = Case("HG-2.3/1", "is held up every second time", lambda _: next(ends)())
    suite = SuiteRunner(virtual(array="4x4"), SuiteOptions(repeat=3)).run([case])
    assert suite.results[0].behaviour is Behaviour.INCONCLUSIVE
    assert suite.exit_status == 3


@pytest.mark.parametrize(("strict", "due"), [(False, "NON-STRICT"), (True, "FAILED")])
def test_a_should_that_is_not_met(strict, due):
    case = Case("HG-4.11/3", "a SHOULD", lambda _: check(False, "not met"))
    (result,) = SuiteRunner(virtual(array="4x4"), SuiteOptions(strict=strict)).run([case]).results
    assert result.behaviour == due


def test_a_case_that_breaks_off_is_no_verdict_on_the_board():
    case = Case("HG-2.3/1", "divides by zero", lambda _: 1 // 0)
    (result,) = SuiteRunner(virtual(array="4x4"), SuiteOptions()).run([case]).results
    assert result.behaviour is Behaviour.INCONCLUSIVE
    assert "ZeroDivisionError" in result.detail


@pytest.mark.parametrize(("away_ms", "due"), [(20, "FAILED"), (500, "INCONCLUSIVE")])
def test_a_host_that_was_held_up_does_not_blame_the_board(away_ms, due):
    def body(board):
        board.status()
        asleep.late_ns += away_ms * 1_000_000
        board.status()
        check(False, "the board is muted")

    asleep = Late(virtual(array="4x4").open())
    access = VirtualAccess("late", lambda _: asleep, baudrate=BAUD, virtual=False)
    (result,) = (
        SuiteRunner(access, SuiteOptions())
        .run([Case("HG-2.3/1", "sleeps meanwhile", body)])
        .results
    )
    assert result.behaviour == due
    assert ("was held up: for" in result.detail) == (due == "INCONCLUSIVE")


@pytest.mark.parametrize(
    ("waited_ms", "due"), [(0, "FAILED"), (20, "FAILED"), (50, "INCONCLUSIVE")]
)
def test_an_emulator_that_waits_for_a_processor_is_not_blamed(monkeypatch, waited_ms, due):
    waits = itertools.count(0, 1000 * waited_ms)
    monkeypatch.setattr(wire.TerminalProcesses, "waited_us", lambda _: next(waits))
    access = virtual(array="4x4")
    access.virtual = False
    attempts = []
    case = Case("HG-2.3/1", "fails", lambda _: (attempts.append(1), check(False, "it is late")))
    (result,) = SuiteRunner(access, SuiteOptions()).run([case]).results
    assert (result.behaviour, len(attempts)) == (due, 3 if waited_ms else 1)


def held_up(away_ms, *, holds_at, judge):
    """Run a case in which the host is held up at first; return its result and the attempts."""
    attempts = []

    def body(board):
        attempts.append(board.status())
        if len(attempts) <= away_ms[0]:
            asleep.late_ns += away_ms[1] * 1_000_000
        board.status()
        judge(board, len(attempts) >= holds_at, "the timer is late")

    asleep = Late(virtual(array="4x4").open())
    access = VirtualAccess("late", lambda _: asleep, baudrate=BAUD, virtual=False)
    case = Case("HG-2.3/1", "sleeps meanwhile", body)
    (result,) = SuiteRunner(access, SuiteOptions()).run([case]).results
    return result, len(attempts)


def plain_check(_, holds, text):
    check(holds, text)


@pytest.mark.parametrize(
    ("away_ms", "holds_at", "judge", "due", "attempts"),
    [
        ((1, 20), 2, judge_in_time, "OK", 2),  # held up once, and right the second time
        ((1, 20), 2, plain_check, "INCONCLUSIVE", 2),  # a failure may still be of the board
        ((9, 20), 9, plain_check, "FAILED", 3),  # wrong whenever it is tried
        ((0, 0), 2, plain_check, "FAILED", 1),  # the host had the processor: no second chance
        ((9, 20), 9, judge_in_time, "INCONCLUSIVE", 3),  # nor is a timer judged then
        ((0, 0), 9, judge_in_time, "FAILED", 1),
    ],
)
def test_a_case_is_tried_again_if_the_host_was_held_up(away_ms, holds_at, judge, due, attempts):
    result, tried = held_up(away_ms, holds_at=holds_at, judge=judge)
    assert (result.behaviour, tried) == (due, attempts)


@pytest.mark.parametrize(
    ("features", "due"),
    [(Feature(0), Behaviour.INCONCLUSIVE), (Feature.CONFIG, Behaviour.FAILED)],
)
def test_a_hold_that_nothing_extends_ends_while_the_host_is_held_up(features, due):
    def body(board):
        board.arm()
        latch_now(board)
        board.wire.idle(6_000_000)
        check(board.status().reason is MuteReason.NONE, "the board is muted")

    port = identity(features=features).open()
    access = VirtualAccess("late", lambda _: port, baudrate=BAUD, virtual=False)
    case = Case("HG-2.3/1", "waits for too long", body)
    (result,) = SuiteRunner(access, SuiteOptions()).run([case]).results
    assert result.behaviour is due


class NoTimer(BoardOutput):
    """Neither hold nor lease ends."""

    def next_timer(self):
        return None


@pytest.mark.parametrize("features", [Feature(0), Feature.CONFIG])
def test_a_board_whose_timers_never_end_fails_whatever_it_can_do(features):
    cases = ("HG-6.10/1", "HG-12.2/1", "HG-12.3/1")
    board = identity(features=features, output=NoTimer)
    failed = {r.case for r in run(board, *cases).results if r.behaviour is Behaviour.FAILED}
    assert set(cases) <= failed


def test_a_failure_that_another_attempt_does_not_show_is_told():
    result, _ = held_up((1, 20), holds_at=2, judge=plain_check)
    told = r"FAILED while the host was held up for \d+ ms \(the timer is late\), then OK"
    assert re.fullmatch(told, result.detail)
    assert result.seen == (Behaviour.FAILED, Behaviour.OK)
    assert result.transcript


class Late(Wrapped):
    """A port in front of which the host fell asleep for a while."""

    late_ns = 0

    def now_ns(self):
        return super().now_ns() + self.late_ns

    def read_available(self, deadline_ns):
        return super().read_available(deadline_ns - self.late_ns)


def made(behaviour, expected=None):
    return CaseResult("a", "a", "", "", behaviour, Evidence.WIRE, expected=expected)


@pytest.mark.parametrize(
    ("results", "status"),
    [
        ([], 0),
        ([made(Behaviour.OK), made(Behaviour.NON_STRICT), made(Behaviour.UNIMPLEMENTED)], 0),
        ([made(Behaviour.NOT_OBSERVED), made(Behaviour.INFORMATIONAL)], 0),
        ([made(Behaviour.INCONCLUSIVE)], 3),
        ([made(Behaviour.INCONCLUSIVE), made(Behaviour.FAILED)], 1),
        ([made(Behaviour.FLAKY)], 1),
        ([made(Behaviour.FAILED, "FAILED")], 0),
        ([made(Behaviour.OK, "FAILED")], 0),
    ],
)
def test_exit_status(results, status):
    assert suite_exit_status(results) == status


def test_a_refusal_that_should_be_a_reply_is_told_once():
    def refused(body):
        if body[0] != MessageType.ARM_REPLY:
            return body
        header, _ = parse_body(body)
        keys = {"seq": header.seq, "time_us": header.time_us, "session": header.session}
        error = Error(MessageType.ARM, ErrorCode.BAD_STATE, 2)
        return build_body(error, flags=0, **keys)

    access = virtual(array="4x4", wrap=lambda inner: Rewritten(inner, refused))
    [result] = run(access, "HG-6.3/1").results
    assert result.behaviour is Behaviour.FAILED
    text = "ARM was answered by ERROR(BAD_STATE), detail 0x2 (MUTED), not by ARM_REPLY"
    assert result.detail == f"{text}; sent before: nothing"
