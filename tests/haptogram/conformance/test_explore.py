"""Random dialogues beside a model: a healthy board lives like it, a wrong one does not."""

import io
import json
import random
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from boards import Wrapped, run, virtual
from hypothesis import given, settings
from hypothesis import strategies as st

from haptogram.conformance.cases.ch01_conformance import every_dialogue
from haptogram.conformance.cases.ch04_session.identity import LEAST_LIMITS
from haptogram.conformance.explore import model as model_module
from haptogram.conformance.explore.actions import (
    FAULT,
    PARTS,
    REST,
    SLOT_US,
    STORED_PHASES,
    UPLOADED,
    DialogueAction,
)
from haptogram.conformance.explore.broken_clauses import (
    BROKEN_FRAME_CLAUSES,
    COUNTER_CLAUSES,
    DUE_CLAUSES,
    FIELD_CLAUSES,
    LINK_REFUSAL_CLAUSES,
    MESSAGE_FIELD_CLAUSES,
    REFUSAL_CLAUSES,
)
from haptogram.conformance.explore.comparison import (
    DialogueAnswers,
    DialogueBase,
    DialogueComparison,
    DialogueMemory,
    FrameInDialogue,
)
from haptogram.conformance.explore.generator import DialogueGenerator
from haptogram.conformance.explore.host import DialogueHost
from haptogram.conformance.explore.lockstep import Played
from haptogram.conformance.explore.makers.conditions import DialogueConditions, DialogueCoverage
from haptogram.conformance.explore.makers.requests import RandomRequests
from haptogram.conformance.explore.model import (
    DialogueModels,
    HostLateError,
    limits_of_lockstep_model,
)
from haptogram.conformance.explore.opening import DialogueOpening
from haptogram.conformance.explore.scenes.inputs import SceneInputs
from haptogram.conformance.explore.scenes.scenes import RandomScenes
from haptogram.conformance.explore.scenes.states import QUICK_STATES, TIMED_STATES
from haptogram.conformance.explore.shrinking import shrink_dialogue
from haptogram.conformance.explore.stepped_process import LockstepProcess
from haptogram.conformance.run.stepping import SteppedAccess
from haptogram.conformance.verdict import Behaviour
from haptogram_protocol.framing import HEADER_BYTES, decode_frame, encode_frame
from haptogram_protocol.messages import (
    RESPONSE_RANGE,
    VERSION_MAJOR,
    Arm,
    ArmReply,
    Config,
    Counters,
    Disarm,
    DriveKind,
    DriveReply,
    Error,
    ErrorCode,
    Feature,
    Flag,
    GetGeometry,
    GetStatus,
    Header,
    Hello,
    HelloReply,
    LatchKey,
    MessageType,
    Phases,
    Ping,
    Play,
    PlaybackEnded,
    Pong,
    ReadDrive,
    ReadTrace,
    SetConfig,
    StatusReply,
    Trace,
    TraceMode,
    UploadBegin,
    build_body,
)
from haptogram_protocol.rules import UPLOADS
from haptogram_protocol.state import MuteReason, OutputState
from protocol_c.building import compiler, make
from sim_device.driven.stepped_board import run_stepped_board

CASE = "HG-1.2/1-dialogues"
ROOT = Path(__file__).resolve().parents[3]
#: Of dialogues, with every commit and every night.
NUMBERS = pytest.mark.parametrize("number", [6, pytest.param(60, marks=pytest.mark.nightly)])


@pytest.fixture(autouse=True)
def few_dialogues(monkeypatch):
    monkeypatch.setattr(every_dialogue, "_DIALOGUES_VIRTUAL", 6)


@pytest.fixture
def model_process(model_here, monkeypatch):  # noqa: ARG001  in its place
    """The model in a process of its own, as for a user."""
    monkeypatch.setattr(model_module, "LockstepProcess", LockstepProcess)


@NUMBERS
@pytest.mark.usefixtures("model_process")
def test_the_virtual_board_lives_like_its_model(number, monkeypatch):
    monkeypatch.setattr(every_dialogue, "_DIALOGUES_VIRTUAL", number)
    (result,) = run(virtual(array="3x2"), CASE, seed=3).results
    assert (result.behaviour, result.detail) == (Behaviour.OK, "")


def latched_as_it_comes(host):
    """A frame due in half a slot, but for its flags: IMMEDIATE, and one that may be ignored."""
    host.stream_next += 1
    time_us = host.slot_us + SLOT_US // 2
    frame = Phases(bytes([host.stream_next & 0xFF]))
    flags, seq = Flag.IMMEDIATE | 0x08, host.stream_next
    return build_body(frame, flags=flags, seq=seq, time_us=time_us, session=host.session)


def disarm(host):
    return host.request(Disarm())


def arm(host):
    return host.request(Arm())


def dialogues(monkeypatch, baud, slots):
    """What two dialogues of these bodies, with and without timers, find on a right board."""

    config = Config(8200, 0, 8200, 0, 70_000, trace_mode=TraceMode.CRC, trace_divider=1)

    class Told(DialogueGenerator):
        def config(self):
            return config

        def actions(self, most):
            told = enumerate(slots[:most])
            return [DialogueAction(slot, "", body) for slot, bodies in told for body in bodies]

    monkeypatch.setattr(every_dialogue, "DialogueGenerator", Told)
    monkeypatch.setattr(every_dialogue, "_DIALOGUES_VIRTUAL", 2)
    (result,) = run(virtual(array="1x1", baud=baud), CASE).results
    return result


@pytest.mark.sampled(1)
@pytest.mark.parametrize("behind", [[], [latched_as_it_comes] * 2, [latched_as_it_comes, disarm]])
def test_the_time_of_a_latch_is_free_where_it_depends_on_the_line(behind, monkeypatch):
    """A frame takes 75 us at 3 Mbaud: two carrier periods and more, which the model has not."""
    result = dialogues(monkeypatch, 3_000_000, [[arm, latched_as_it_comes, *behind]] * 8)
    assert (result.behaviour, result.detail) == (Behaviour.OK, "")


def test_a_frame_is_as_late_for_the_model_as_the_line_makes_it_for_the_board(monkeypatch):
    """Its late window ends while the frames before it, 16 ms of the line, come."""

    def late(host):
        host.stream_next += 1
        seq, time_us = host.stream_next, host.slot_us - 60_000
        frame = Phases(b"a")
        return build_body(frame, flags=0, seq=seq, time_us=time_us, session=host.session)

    pings = [lambda host: host.request(Ping(1))] * 60
    result = dialogues(monkeypatch, 921_600, [[arm], [*pings, late], [arm]])
    assert (result.behaviour, result.detail) == (Behaviour.OK, "")


def test_traces_that_find_no_room_on_a_slow_line_are_no_difference(monkeypatch):
    """HG-8.7/2: such a dialogue is not compared."""

    def play(host):
        return host.request(Play(STORED_PHASES, 450, 300, 10_000), flags=Flag.IMMEDIATE)

    result = dialogues(monkeypatch, 115_200, [[arm, play], *[[]] * 8, [arm]])
    assert result.behaviour is Behaviour.NOT_OBSERVED, result.detail


@pytest.fixture(scope="module")
def c_board(tmp_path_factory):
    """The command of the C board in virtual time."""
    compiler()
    folder = tmp_path_factory.mktemp("board")
    status, output = make(folder, folder / "board_steps", CFLAGS="-O0 -w")
    assert status == 0, output
    return [str(folder / "board_steps"), "3x2"]


@NUMBERS
@pytest.mark.usefixtures("model_process")
def test_the_c_board_lives_like_the_model(number, c_board, monkeypatch):
    monkeypatch.setattr(every_dialogue, "_DIALOGUES_VIRTUAL", number)
    (result,) = run(SteppedAccess(c_board), CASE).results
    assert (result.behaviour, result.detail) == (Behaviour.OK, "")


class WrappedSteps(SteppedAccess):
    """A board in virtual time behind a transport that changes what comes or goes."""

    wrapper = Wrapped
    opened = 0

    def open(self):
        self.opened += 1
        return self.wrapper(super().open())


class ForgetsInPause(Wrapped):
    """A board that forgets the beginning of a frame when no byte comes for a second."""

    begun, last_ns = False, 0

    def write_some(self, data):
        is_late = self.inner.now_ns() - self.last_ns > 1_000_000_000
        kept = data[data.index(0) :] if is_late and self.begun and 0 in data else data
        self.begun, self.last_ns = not data.endswith(b"\0"), self.inner.now_ns()
        self.inner.write_some(kept)
        return len(data)


@pytest.mark.nightly
def test_a_board_that_forgets_a_frame_in_a_pause_is_found(c_board, monkeypatch):
    monkeypatch.setattr(every_dialogue, "_DIALOGUES_VIRTUAL", 120)
    monkeypatch.setattr(WrappedSteps, "wrapper", ForgetsInPause)
    (result,) = run(WrappedSteps(c_board), CASE).results
    assert result.behaviour is Behaviour.FAILED
    paused_us = max(int(text) for text in re.findall(r"the rest, (\d+) µs later", result.detail))
    assert paused_us > 1_000_000


class DeafBeforeHello(Wrapped):
    """A board that says nothing for 20 ms after it was switched on a second time."""

    def read_available(self, deadline_ns):
        data = self.inner.read_available(deadline_ns)
        is_deaf = WrappedSteps.opened > 1 and self.inner.now_ns() < 20_000_000
        return b"" if is_deaf else data


def test_what_a_board_says_before_the_first_hello_is_compared(c_board, monkeypatch):
    class Opened(WrappedSteps):
        wrapper = DeafBeforeHello

        def open(self):
            WrappedSteps.opened = self.opened + 1
            return super().open()

    monkeypatch.setattr(WrappedSteps, "opened", 0)
    monkeypatch.setattr(every_dialogue, "_DIALOGUES_VIRTUAL", 2)
    (result,) = run(Opened(c_board), CASE).results
    assert result.behaviour is Behaviour.FAILED
    assert "before the first HELLO" in result.detail


@pytest.mark.parametrize("left_out", [Feature(0), Feature.POINTS | Feature.SEQUENCE_POINTS])
def test_each_sequence_that_a_dialogue_may_leave_is_stored_before_the_next(left_out):
    fields = dict.fromkeys(HelloReply.WIRE, 9) | {"firmware": "x", "max_upload_bytes": 9999}
    identity = HelloReply(**fields | {"features": sum(Feature) - left_out})
    opening = DialogueOpening(SimpleNamespace(identity=identity), None)
    begun = [m for m in opening.preamble(Config(), 1) if isinstance(m, UploadBegin)]
    assert sorted(message.target for message in begun) == [0, *UPLOADED]


@pytest.mark.nightly
def test_a_wrong_board_is_found_by_short_dialogues_printed_as_bytes_one_a_clause():
    (result,) = run(
        virtual(array="3x2", mutant="mutants.latching:OrderIgnored"), CASE, seed=1
    ).results
    assert result.behaviour is Behaviour.FAILED
    assert re.search("dropped_order|accepted|queued|TRACE", result.detail)
    differences = re.sub(r"^\d+ differences in \d+ dialogues: ", "", result.detail).split(" || ")
    clauses = [re.match(r"HG-\S+/\d+(?=: )", text)[0] for text in differences]
    assert len(set(clauses)) == len(clauses) > 1
    for text in differences:
        number = int(re.search(r" of (\d+) frames", text)[1])
        assert 2 <= number <= 20
        assert len(re.findall(r"\d+ µs  [A-Z].*?: (?:00)?[0-9a-f]+00", text)) == number


class WrongOnce(Wrapped):
    """A board that sends one wrong byte, in a dialogue."""

    reads = 0

    def read_available(self, deadline_ns):
        data = self.inner.read_available(deadline_ns)
        self.reads += len(data) > 4
        if self.reads == 200 and len(data) > 4:
            return data[:-2] + bytes([data[-2] ^ 0x40 or 1]) + data[-1:]
        return data


@pytest.mark.nightly
def test_a_difference_that_does_not_come_again_fails_in_virtual_time():
    (result,) = run(virtual(array="3x2", wrap=WrongOnce), CASE, seed=3).results
    assert result.behaviour is Behaviour.FAILED
    assert re.match(r"HG-\S+/\d+: .* dialogue \d+, seen once, not again", result.detail)


class LateAnswers(Wrapped):
    """A board that sends 0.2 s late what it says from some time on."""

    FROM_NS, LATE_NS = 3_000_000_000, 200_000_000

    def __init__(self, inner):
        super().__init__(inner)
        self.held = []

    def read_available(self, deadline_ns):
        while not self.held or self.held[0][0] > self.now_ns():
            until_ns = min([deadline_ns, *(ready_ns for ready_ns, _ in self.held[:1])])
            data = self.inner.read_available(until_ns)
            late_ns = self.LATE_NS if self.now_ns() > self.FROM_NS else 0
            if data:
                self.held.append((self.now_ns() + late_ns, data))
            elif self.now_ns() >= deadline_ns:
                return b""
        return self.held.pop(0)[1]


@pytest.mark.nightly
def test_a_board_whose_answers_are_late_fails_in_virtual_time():
    (result,) = run(virtual(array="3x2", wrap=LateAnswers), CASE, seed=3).results
    assert result.behaviour is Behaviour.FAILED
    assert re.search("no [A-Z_]+.* comes|due is [0-9]+", result.detail)


def played(text, *, slot=7, held_up_us=0):
    return Played(text, (), slot, held_up_us)


@pytest.mark.parametrize(
    ("first", "again", "is_of_board"),
    [
        (played("a 1"), [], True),
        (played("a 1", held_up_us=9000), [None], False),
        (played("a 1", held_up_us=9000), [played("")], False),
        (played("a 1", held_up_us=9000), [played("b", held_up_us=9000)], False),
        (played("a 1", held_up_us=9000), [played("a 2", held_up_us=9000, slot=8)], False),
        (played("a 1", held_up_us=9000), [played("b")], True),
        (played("a 1", held_up_us=9000), [played("a 2", held_up_us=9000)] * 4, True),
    ],
)
def test_a_board_is_blamed_for_a_difference_that_nothing_else_explains(first, again, is_of_board):
    replays = iter(again)
    assert every_dialogue.is_difference_of_board(first, lambda: next(replays)) is is_of_board


def test_the_same_seed_gives_the_same_dialogue():
    identity = HelloReply(**dict.fromkeys(HelloReply.WIRE, 1) | {"firmware": "x"})
    first, second = (DialogueGenerator(identity, 7) for _ in range(2))
    assert first.config() == second.config()
    texts = [[(a.slot, a.name, a.damage) for a in g.actions(20)] for g in (first, second)]
    assert texts[0] == texts[1]
    assert max(slot for slot, _, _ in texts[0]) < 20 + 16  # a scene may end later


def every_frame(seed=1, features=2047, **conditions):
    """Makers of a dialogue at a board of all capabilities."""
    fields = dict.fromkeys(HelloReply.WIRE, 9) | {"features": features, "firmware": "x"}
    source, coverage = random.Random(seed), DialogueCoverage()
    return RandomRequests(DialogueConditions(HelloReply(**fields), source, coverage, **conditions))


@pytest.mark.parametrize("timed", [False, True])
def test_each_state_meets_each_group_of_inputs_before_any_does_again(timed):
    makers = every_frame(timed=timed, exact=True)
    makers.configs.with_timers = timed
    coverage, inputs = makers.conditions.coverage, SceneInputs(makers)
    scenes = RandomScenes(inputs)
    assert {*scenes.quick} == {*QUICK_STATES}
    assert {*scenes.timed} == {*TIMED_STATES}
    assert {"a fault", "foreign MUTE", "HELLO", "another ", "nothing"} < set(inputs.groups)
    kind = "states with timers" if timed else "states"
    due = met = 0
    while not met or due:
        assert any(scenes.scene())
        met, due = met or kind in coverage.due, len(coverage.due.get(kind, "not yet"))
    assert coverage.due[kind] == []
    assert sum(map(len, inputs.groups.values())) == len(inputs.names) > 60


@pytest.mark.sampled(1)
@pytest.mark.parametrize("exact", [True, False])
def test_what_happens_within_microseconds_is_met_where_bytes_take_no_time(exact):
    changes = {"features": 2047, "queue_depth": 16, "firmware": "x"}
    identity = HelloReply(**dict.fromkeys(HelloReply.WIRE, 9) | changes)
    coverage, actions = DialogueCoverage(), []
    for seed in range(100):
        generator = DialogueGenerator(identity, seed, coverage, timed=seed % 2 == 0, exact=exact)
        actions += [*generator.before_hello(), *generator.actions(60)]
    waits = {action.wait_us for action in actions}
    damages = {action.damage for action in actions}
    everywhere = {"kinds of trios", "times of trios", "values of fields", "steps of sessions"}
    assert everywhere <= set(coverage.due)
    moments = {"turns", "pauses with timers: True", "pauses with timers: False"}
    assert moments <= set(coverage.due) if exact else not moments & set(coverage.due)
    assert {*range(27), 75 * SLOT_US} <= waits if exact else waits == {0}
    assert {PARTS, FAULT, REST} <= damages if exact else not {PARTS, FAULT, REST} & damages


def test_a_state_is_a_row_of_inputs_and_a_board_without_them_lacks_it():
    inputs = SceneInputs(every_frame(timed=True))
    row = TIMED_STATES["in the ramp of the hold, the lease out too"]
    (first, *silent) = inputs.slots(row)
    assert [told.name for told in first[:3]] == ["DISARM", "SET_CONFIG", "ARM"]
    assert first[3].ends_slot
    assert silent == [[]] * 4
    assert inputs.makers.configs.last.ramp_ms == 178
    lacks = SceneInputs(every_frame(timed=True, features=Feature.CONFIG))
    assert not any("playback" in state for state in RandomScenes(lacks).timed)
    assert not lacks.knows("ARM + PLAY once")


def test_fields_of_every_frame_have_values_at_limits_but_where_timers_would_end():
    inputs = SceneInputs(every_frame(timed=False, exact=True))
    every = inputs.values()
    values = {}
    for message, offset, value in every:
        values.setdefault((type(message), offset), set()).add(int.from_bytes(value, "little"))

    def of(kind, name):
        return values.get((kind, HEADER_BYTES + kind.WIRE[name].offset))

    assert {Hello, GetGeometry, ReadDrive, ReadTrace, UploadBegin, Play} < {
        kind for kind, _ in values
    }
    for kind, name in ((ReadDrive, "kind"), (UploadBegin, "points_per_frame"), (Hello, "major")):
        assert len(of(kind, name)) >= 255  # and its own
    assert values[Ping, 0] == values[Phases, 0] == set(range(256))  # type
    assert values[Arm, 1] == {1 << bit for bit in range(8)}  # flags
    assert {0, 1, 8, 10, 17, 18, 0xFFFF} <= of(ReadDrive, "count")  # of 9
    hold_ms = HEADER_BYTES + Config.WIRE["hold_ms"].offset
    assert (SetConfig, hold_ms) not in values
    assert of(Hello, "nonce") is None
    assert of(Play, "unattended_ms") == {0, 10, 0xFFFFFFFF}
    told = [inputs.with_any_value() for _ in every]
    assert {action.wait_us for action in told} == {0, 1}  # MUTE has a write of its own


def radiated(data):
    return DriveReply(DriveKind.RADIATED, LatchKey(0, 0, 1), 0, 0, data)


def status_reply(**counted):
    counters = Counters(**dict.fromkeys(Counters.WIRE, 0) | counted)
    state = OutputState.ARMED, MuteReason.NONE
    return StatusReply(*state, *[0] * 7, 0, counters)


COUNTERS = Counters(*[0] * len(Counters.WIRE))


@pytest.mark.parametrize(
    ("mine", "due", "words"),
    [
        (Error(0x4D, ErrorCode.NOT_FOUND, 6), Error(0x4D, ErrorCode.NOT_FOUND, 5), "HG-7.6/1: "),
        (ArmReply(OutputState.ARMED), Error(0x41, ErrorCode.BAD_STATE, 3), "HG-6.2/1: due is ERR"),
        (Pong(1, 2, 300), Pong(1, 2, 3), "HG-6.9/2: PONG .* t_tx_us is 300, due is 3"),
        (radiated(b"\1\2"), radiated(b"\1\0"), "HG-6.6/2: DRIVE_REPLY: amplitude 0 is 2, due is 0"),
        (radiated(b"\3\2"), radiated(b"\1\2"), "HG-7.9/1: DRIVE_REPLY: phase 0 is 3, due is 1"),
        (
            status_reply(accepted=2, latched=1),
            status_reply(accepted=1, dropped_late=1),
            "HG-5.7/5: STATUS_REPLY: dropped_late has grown by 0, due is 1; latched .*; accepted",
        ),
    ],
)  # fmt: skip
def test_a_difference_names_the_clause_of_which_it_speaks(mine, due, words):
    base, host = DialogueBase(COUNTERS), DialogueHost(None, 7, 1, 0)
    ours, theirs = (
        DialogueAnswers.of([FrameInDialogue(Header(message.TYPE, 0, 1, 0, 7), message)], base)
        for message in (mine, due)
    )
    assert re.match(words, DialogueComparison(ours, theirs, host, 10).difference())
    missing = DialogueComparison(DialogueAnswers([], [], base), theirs, host, 10).difference()
    assert re.match(r"HG-\d+\.\d+/\d+: no [A-Z_]+.* comes", missing)


@pytest.mark.parametrize(
    ("mine", "mine_us", "words"),
    [
        (Trace(4, 0), 100, "HG-8.1/1: TRACE .* for t 100 comes and is not due; next is TRACE"),
        (PlaybackEnded(1, 1, 1), 4000, "HG-7.8/1: PLAYBACK_ENDED .* is not due; next is TRACE"),
        (PlaybackEnded(1, 1, 1), 9000, "HG-8.1/1: due is TRACE {'index': 5, .*, there comes PLAY"),
        (
            Trace(5, 0),
            4100,
            "HG-8.3/1: TRACE .*: time_us of the header is 4100, \\+100 µs from what",
        ),
    ],
)
def test_an_event_that_comes_instead_of_another_is_named(mine, mine_us, words):
    base, host = DialogueBase(COUNTERS), DialogueHost(None, 7, 1, 0)

    def answers(*told):
        frames = [FrameInDialogue(Header(m.TYPE, 0, 0, t_us, 7), m) for m, t_us in told]
        return DialogueAnswers.of(frames, base)

    due = answers((Trace(5, 0), 4000), (PlaybackEnded(1, 1, 1), 9000))
    found = DialogueComparison(answers((mine, mine_us)), due, host, 10).difference()
    assert re.match(words, found), found


def test_every_counter_and_every_message_of_a_board_has_a_clause():
    assert set(COUNTER_CLAUSES) == set(Counters.WIRE)
    spec = (ROOT / "protocol" / "SPEC.md").read_text("utf-8")
    tables = [COUNTER_CLAUSES, DUE_CLAUSES, REFUSAL_CLAUSES, LINK_REFUSAL_CLAUSES]
    tables += [FIELD_CLAUSES, MESSAGE_FIELD_CLAUSES, BROKEN_FRAME_CLAUSES]
    for clause in {clause for table in tables for clause in table.values()}:
        assert f"- **{clause}** " in spec
    codes = {kind.TYPE for kind in DUE_CLAUSES} | {Error.TYPE}
    assert codes == {kind for kind in MessageType if kind >= RESPONSE_RANGE.start}
    codes_of_refusals = {code for _, code in REFUSAL_CLAUSES} | set(LINK_REFUSAL_CLAUSES)
    assert codes_of_refusals == set(ErrorCode) - {ErrorCode.BUSY}


def test_a_remembered_reply_is_sent_again_as_it_was():
    memory = DialogueMemory()

    def reply(body):
        return [FrameInDialogue(Header(0x81, 0, 1, 0, 7), Arm(), body)]

    assert memory.first_altered(reply(b"a"), reply(b"due")) == ""
    assert memory.first_altered(reply(b"a"), reply(b"due")) == ""
    assert "first sending" in memory.first_altered(reply(b"b"), reply(b"due"))


def test_an_event_before_the_response_of_its_request_differs():
    reply = FrameInDialogue(Header(0x82, 0, 1, 0, 7), Disarm())
    ended = FrameInDialogue(Header(0xC2, 0, 0, 0, 7), PlaybackEnded(1, 0, 2))
    base, host = DialogueBase(Counters(*[0] * len(Counters.WIRE))), DialogueHost(None, 7, 1, 0)
    due, wrong = (DialogueAnswers.of(frames, base) for frames in ([reply, ended], [ended, reply]))
    assert DialogueComparison(due, due, host, 200).difference() == ""
    text = DialogueComparison(wrong, due, host, 200).difference()
    assert text.startswith("HG-4.11/5: ")


@given(st.sets(st.integers(0, 30), min_size=1, max_size=3))
def test_a_dialogue_shrinks_to_what_it_needs(needed):
    short = shrink_dialogue(list(range(31)), lambda part: needed <= set(part), tries=500)
    assert set(short) == needed


def test_shrinking_ends_after_its_tries():
    calls = []
    shrink_dialogue(list(range(64)), lambda part: calls.append(len(part)), tries=9)
    assert len(calls) == 9


@pytest.fixture
def model():
    limits = {"grid_nx": 2, "grid_ny": 1, "pitch_um": 10_000, "features": 2047}
    process = subprocess.Popen(
        [sys.executable, "-m", "sim_device.driven.stepped_board", json.dumps(limits)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    yield process
    process.communicate(timeout=20)


def test_the_model_answers_each_step_with_a_line(model):
    hello = "0002400101010101010101020108ed5e04030201"  # cut off: counted, not answered
    steps = ["through 1000", f"rx 2000 {hello}00", f"through {SLOT_US}", "reset 77", "next"]
    steps += ["through 9", "fault 10", "through 11;through 12;next"]
    model.stdin.write("\n".join(steps) + "\n")
    model.stdin.flush()
    answers = [model.stdout.readline().strip() for _ in steps]
    assert answers == ["-", "-", "-", "-", "-", "-", "-", "-;-;-"]


@given(st.data())
@settings(max_examples=30, deadline=None)
def test_the_model_takes_the_identity_of_every_board(data):
    features = data.draw(st.integers(0, 2047), "features")
    fixed = {"grid_nx": 1, "grid_ny": 2, "pitch_um": 10_000, "transducers": 2, "features": features}
    fixed |= {"carrier_hz": 40_000, "firmware": "x"}
    most = {"latch_lead_us": 100_000, "point_time_us": 100_000, "max_horizon_us": 2**31 - 1}
    least = {name: low for name, low, users in LEAST_LIMITS if not users or users & features}
    least["max_upload_bytes"] = 16 if features & UPLOADS else 0
    limits = {
        name: data.draw(st.integers(least.get(name, 0), most.get(name, 256**field.size - 1)), name)
        for name, field in HelloReply.WIRE.items()
        if name not in fixed
    }
    identity = HelloReply(**fixed | limits)
    hello = encode_frame(
        build_body(Hello(VERSION_MAJOR, 0, 7, 0), flags=0, seq=0, time_us=0, session=0)
    )
    answers = io.StringIO()
    run_stepped_board([limits_of_lockstep_model(identity)], [f"rx 0 {hello.hex()}"], answers)
    reply = HelloReply.unpack(decode_frame(bytes.fromhex(answers.getvalue())[1:-1])[HEADER_BYTES:])
    told = json.loads(limits_of_lockstep_model(identity)).keys() & HelloReply.WIRE.keys()
    assert {name: getattr(reply, name) for name in told} == {
        name: getattr(identity, name) for name in told
    }


@pytest.fixture
def models():
    limits = {"grid_nx": 2, "grid_ny": 1, "pitch_um": 10_000, "features": 2047, "transducers": 2}
    limits |= {
        "queue_depth": 16,
        "max_horizon_us": 10_000_000,
        "trace_ring": 64,
        "carrier_hz": 40_000,
    }
    identity = HelloReply(**dict.fromkeys(HelloReply.WIRE, 1) | limits | {"firmware": "x"})
    host = DialogueHost(identity, 0, 0, SLOT_US)
    pair = DialogueModels(identity, knows_time=False)
    pair.reset(0)
    for body in (host.hello(Hello(VERSION_MAJOR, 0, 7, 0)), host.request(Arm())):
        pair.ask(10, encode_frame(body))
    yield host, pair
    pair.close()


def phases(host, *, ahead_us=0, flags=0):
    host.stream_next += 1
    seq, time_us = host.stream_next & 0xFFFF, SLOT_US + ahead_us
    message = Phases(b"ab")
    return encode_frame(
        build_body(message, flags=flags, seq=seq, time_us=time_us, session=host.session)
    )


def test_what_no_delay_changes_is_due_and_the_rest_is_not_compared(models):
    host, pair = models
    base = DialogueBase(Counters(*[0] * len(Counters.WIRE)))
    later_us = SLOT_US + 30_000
    pair.receive(SLOT_US, [encode_frame(host.request(Ping(n))) for n in (1, 2)], [later_us] * 2)
    pair.advance(2 * SLOT_US)
    due = pair.due(host, base, 30_000)
    assert [(frame.message.TYPE.name, frame.header.time_us) for frame in due] == [
        ("PONG", SLOT_US),
        ("PONG", SLOT_US),
    ]
    host.slot_us = 2 * SLOT_US
    in_time = phases(host, ahead_us=SLOT_US + 20_000)
    status = encode_frame(host.request(GetStatus()))
    pair.receive(2 * SLOT_US, [in_time, status], [2 * SLOT_US + 25_000])
    pair.advance(3 * SLOT_US)
    with pytest.raises(HostLateError, match="STATUS_REPLY"):
        pair.due(host, base, 30_000)


def test_a_frame_that_is_latched_or_flushed_or_late_is_not_compared(models):
    host, pair = models
    wires = [phases(host, ahead_us=SLOT_US + 20_000), phases(host, flags=Flag.IMMEDIATE)]
    pair.receive(SLOT_US, wires, [SLOT_US + 50_000])  # in time, whenever it came
    wires = [phases(host, ahead_us=3 * SLOT_US), phases(host, flags=Flag.IMMEDIATE)]
    with pytest.raises(HostLateError, match="flushed or late"):
        pair.receive(3 * SLOT_US, wires, [4 * SLOT_US + 10])


def test_a_frame_that_comes_just_when_it_is_late_is_not_compared(models):
    host, pair = models
    pair.receive_near(SLOT_US, phases(host, ahead_us=SLOT_US), 200)
    with pytest.raises(HostLateError, match="in time, or late"):
        pair.receive_near(SLOT_US, phases(host, ahead_us=100), 200)
