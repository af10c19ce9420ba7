"""The client that a case works with: a session, its configuration, output state and counters."""

from __future__ import annotations

import contextlib
import dataclasses
import random
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final, NoReturn, TypeVar

from haptogram_protocol import messages as m
from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES, MAX_ENCODED_BYTES
from haptogram_protocol.state import OutputState

from ..outcome import (
    CaseEndedError,
    RuleFindings,
    check,
    check_equal,
    check_fields,
    fail,
    inconclusive,
    not_observed,
    require,
    unimplemented,
)
from .board_clock import ClockClient
from .recording import DialogueRecording, counter_steps
from .request_client import PROCESSED_US, RequestClient
from .wire import RawFrameClient, ReceivedByClient

_T = TypeVar("_T")
_M = TypeVar("_M", bound=m.Message)
#: Counters that grow although a host did nothing wrong.
_HARMLESS: Final = m.GROWING_COUNTERS | {"late", "trace_dropped"}
#: Counters of what became of the frames that `frames` counts: HG-3.9/2.
PARTS_OF_FRAMES: Final = (
    "accepted",
    "requests",
    "repeated",
    "duplicate",
    "stale_session",
    "bad_length",
    "bad_value",
    "unknown_type",
    "unsupported",
    "dropped_state",
    "dropped_order",
    "dropped_full",
    "dropped_future",
    "dropped_late",
)
#: Times in which the points of a frame come and are computed: more outlast leases and holds.
_CARRIED_US: Final = 20_000
_COMPUTED_US: Final = 100_000
_FAULT_US: Final = 1_000_000  # how long a fault that a user brings about may last
_LONGEST_TIMER_MS: Final = 10_000  # longest timer that a case waits for
_DEEPEST: Final = 512  # queue that a case fills
_STATUS_BYTES: Final = 148  # size of a STATUS on the line


class BoardClient:
    """A session with a board: identity, configuration, output state and counters.

    Parameters
    ----------
    wire : RawFrameClient
        Open port.
    random_source : random.Random
        Source of nonces and contents.
    booted : bool
        Whether the board has just started, so that its unwrapped time is known.

    Attributes
    ----------
    link : RequestClient
        Sends frames and finds their answers.
    clock : ClockClient
        The device clock.
    identity : HelloReply
        The last HELLO_REPLY.
    config : Config
        Configuration in force, as far as the host knows.
    thorough : bool
        Whether cases cover the whole of a product, or for a quick run the least of it.
    exhaustive : bool
        Whether there is time for many random dialogues.
    explore_us : int
        How long random dialogues go on; 0: a fixed number of them.
    correction : bytes or None
        Phase correction in force, as far as the host knows; None: it does not.
    standing : RuleFindings or None
        Findings about all frames of the run so far; None: they are not judged.
    raise_fault : callable or None
        Lets the hardware of the board fail; None: nothing can.
    restart : callable or None
        Switches the board off and on and returns the client of the board that has just started,
        in place of this one; None: nothing can.
    last_boot_id, last_config
        Boot id and configuration before the board was reset.
    nonces : set of int
        Nonces that it drew for sessions.
    dialogue : tuple or None
        Pieces and recording of the dialogue of all requests; None: it was not run yet.
    """

    identity: m.HelloReply
    config: m.Config
    thorough: bool = True
    exhaustive: bool = False
    explore_us: int = 0
    correction: bytes | None = None
    standing: RuleFindings | None = None
    raise_fault: Callable[[], None] | None = None
    restart: Callable[[], BoardClient] | None = None
    last_boot_id: int | None = None
    last_config: m.Config | None = None
    dialogue: tuple[list[ReceivedByClient], DialogueRecording] | None = None

    def __init__(
        self,
        wire: RawFrameClient,
        random_source: random.Random,
        *,
        booted: bool,
    ) -> None:
        self.wire = wire
        self.random = random_source
        self.link = RequestClient(wire, random_source)
        self.clock = ClockClient(self.link, booted=booted)
        self.nonces: set[int] = set()
        self._last_nonce = 0

    # --- session -------------------------------------------------------------------------------

    def new_nonce(self) -> int:
        """Return a nonce that is not that of the open session."""
        nonce = self._last_nonce
        while nonce in (0, self._last_nonce, self.link.session):
            nonce = self.random.randrange(1, 0x10000)
        self._last_nonce = nonce
        self.nonces.add(nonce)
        return nonce

    def hello_message(self, nonce: int) -> m.Hello:
        """Return the HELLO of this version."""
        return m.Hello(m.VERSION_MAJOR, m.VERSION_MINOR, nonce)

    def hello(self, nonce: int | None = None, **header: Any) -> m.HelloReply:
        """Open a session, with a new nonce unless *nonce* is given; FAILED if the board refuses."""
        nonce = self.new_nonce() if nonce is None else nonce
        reply = self.link.call(self.hello_message(nonce), m.HelloReply, session=0, **header)
        self.adopt(reply)
        return reply

    def adopt(self, reply: m.HelloReply) -> None:
        """Go on in the session that a HELLO_REPLY names."""
        if reply.nonce != self.link.session:
            self.link.stream_next = m.FIRST_STREAM_SEQ
        self.link.session, self.identity = reply.nonce, reply
        self.link.rx_window = max(reply.rx_window, MAX_ENCODED_BYTES + 2)  # judged by HG-4.3/8
        self.clock.carrier_us = 1_000_000 // max(1, reply.carrier_hz)
        self.clock.point_time_us = reply.point_time_us
        self.clock.latch_lead_us = reply.latch_lead_us
        self.clock.horizon_us = reply.max_horizon_us
        self.clock.lead_us = self.clock.ready_us(0, self.most_points)
        self.link.processed_us = PROCESSED_US + reply.queue_depth * self.clock.lead_us

    def late_time_us(self, late_us: int, points: int = 0) -> int:
        """Return the t_apply at which a frame that is sent now is ready so late.

        Within the late window it has to come so soon that it stays there: else nothing is judged.
        """
        t_us = self.clock.ready_us(self.clock.device_us(), points) - late_us
        if 0 < late_us < self.config.late_window_us:
            last_us = t_us + self.config.late_window_us - points * self.identity.point_time_us
            self.clock.expect_before(last_us)
        return t_us

    def prepare(self) -> None:
        """Open a session with the board DISARMED and quiet, as every case begins.

        The cases, and not this method, judge the replies.
        """
        self.clock.forget_exchange()
        if self.hello().state is OutputState.FAULT and not self.leaves_fault():
            inconclusive("the board is in FAULT, and DISARM does not lead out")
        self.link.ask(m.Arm())  # the only way out of MUTED
        self.link.ask(m.Disarm())
        self.config = m.Config(sound_speed_mm_s=self.identity.sound_speed_mm_s)
        answer = self.link.ask(m.GetConfig()).message
        if isinstance(answer, m.ConfigReply):
            self.config = answer.config
        if self.has(m.Feature.CONFIG):
            answer = self.link.ask(m.SetConfig(self.base_config)).message
        if isinstance(answer, (m.ConfigReply, m.SetConfigReply)):
            self._prepare_correction(answer)
        with contextlib.suppress(CaseEndedError):
            self.clock.device_us()

    def _prepare_correction(self, reply: m.ConfigReply | m.SetConfigReply) -> None:
        """Keep the configuration of *reply*; upload a zero correction if its CRC shows another."""
        self.config = reply.config
        none = bytes(self.identity.transducers)
        wanted = zlib.crc32(reply.config.pack() + none)
        if self.has(m.Feature.CORRECTION) and reply.config_crc != wanted:
            size = max(1, self.identity.max_chunk)
            starts = range(0, len(none), size)
            self.link.ask(m.UploadBegin(m.UploadKind.CORRECTION, 0, 0, len(none), zlib.crc32(none)))
            for chunk in (m.UploadChunk(start, none[start : start + size]) for start in starts):
                self.link.ask(chunk)
            self.link.ask(m.UploadCommit(0))
        self.correction = none

    # --- phases --------------------------------------------------------------------------------

    def phases(self, registers: bytes) -> m.Phases:
        """Return the PHASES frame after which the registers hold *registers*."""
        return m.Phases(registers)

    def flat_phases(self, code: int = 0) -> m.Phases:
        """Return a PHASES frame with the same code for all."""
        return self.phases(bytes([code]) * self.identity.transducers)

    def shortest_stream(self) -> m.Message:
        """Return the stream frame that takes the least time on the line and to be computed."""
        phases = self.flat_phases()
        if not self.has(m.Feature.POINTS):
            return phases
        point = m.Points((m.FocalPoint(10_000, 5_000, 150_000, 0xFFFF, 0),))
        shorter = len(phases.serialize()) - len(point.serialize())
        is_shorter = self.wire.line_us(max(0, shorter)) > self.clock.point_time_us
        return point if is_shorter else phases

    def bytes_of_frames(self, number: int) -> bytes:
        """Return the size on the line of *number* frames of PHASES and a few requests."""
        return bytes(number * len(self.link.stream_wire(self.flat_phases(), 0, seq=0)) + 300)

    def random_registers(self) -> bytes:
        """Return random phase codes."""
        return self.random.randbytes(self.identity.transducers)

    @property
    def base_config(self) -> m.Config:
        """The configuration that cases begin with."""
        return dataclasses.replace(
            self.config,
            hold_ms=5000,
            ramp_ms=0,
            host_timeout_ms=10_000,
            status_period_ms=0,
            late_window_us=0,
            trace_mode=m.TraceMode.OFF,
            amplitude_ceiling=255,
            trace_divider=1,
        )

    def configure(self, **changes: Any) -> m.Config:
        """Set the base configuration with *changes*; UNIMPLEMENTED without CONFIG."""
        self.need(m.Feature.CONFIG)
        wanted = dataclasses.replace(self.base_config, **changes)
        self.config = self.link.call(m.SetConfig(wanted), m.SetConfigReply).config
        check_equal(
            self.config, wanted, "SET_CONFIG_REPLY shows another configuration than was sent"
        )
        return self.config

    def read_config(self) -> m.Config:
        """Ask for the configuration in force."""
        return self.link.call(m.GetConfig(), m.ConfigReply).config

    @property
    def most_points(self) -> int:
        """Focal points in one frame that a case sends, at most.

        The board takes them, a frame has room for them, the line carries them in 20 ms and the
        board computes them in 100 ms, one at least; 0 if the board takes points neither in the
        stream nor in a sequence.
        """
        if not self.identity.features & (m.Feature.POINTS | m.Feature.SEQUENCE_POINTS):
            return 0
        room = (MAX_BODY_BYTES - HEADER_BYTES) // m.FocalPoint.LAYOUT.size
        computed = _COMPUTED_US // max(1, self.identity.point_time_us)
        carried = _CARRIED_US // max(1, self.wire.line_us(m.FocalPoint.LAYOUT.size))
        return min(self.identity.max_points, room, max(1, computed), max(1, carried))

    def has(self, features: m.Feature) -> bool:
        """Return True if the board advertises all of *features*."""
        return self.identity.features & features == features

    def need(self, features: m.Feature) -> None:
        """End the case as UNIMPLEMENTED unless the board advertises all of *features*."""
        # Among whole numbers: Python 3.11.0 to 3.11.3 invert a flag wrongly.
        lacking = m.Feature(int(features) & ~self.identity.features)
        if lacking:
            unimplemented(f"the board does not advertise {lacking.name or lacking!r}")

    def need_any(self, features: m.Feature) -> None:
        """End the case as UNIMPLEMENTED unless the board advertises one of *features*."""
        if not self.identity.features & features:
            unimplemented(f"the board advertises none of {features.name or features!r}")

    @property
    def quick_status_ms(self) -> int:
        """Status period that leaves nine tenths of the line free (HG-7.1/2)."""
        return max(50, -(-_STATUS_BYTES * 10 * 10 * 1000 // self.wire.baudrate))

    def arm(self, **changes: Any) -> int:
        """Arm, and return the number of the next piece; FAILED unless ARM_REPLY says ARMED.

        With *changes* it sets the base configuration with them before.
        """
        if changes:
            self.configure(**changes)
        state = self.link.call(m.Arm(), m.ArmReply).state
        check_equal(state, OutputState.ARMED, f"ARM_REPLY says {state.name}")
        return self.link.mark()

    @property
    def graded_ramp_ms(self) -> int:
        """Length of the ramp in force; without AMPLITUDE it has none (HG-6.11/3)."""
        return self.config.ramp_ms * self.has(m.Feature.AMPLITUDE)

    def arm_with_timer(self, name: str, length_ms: int) -> int:
        """Arm with a timer of *length_ms*, or without CONFIG of the length in force; return that.

        NOT-OBSERVED if that is not *length_ms* and longer than a case waits.
        """
        if self.has(m.Feature.CONFIG):
            self.arm(**{name: length_ms})
            return length_ms
        length_ms = getattr(self.config, name)
        require(
            length_ms <= _LONGEST_TIMER_MS, f"{name} is {length_ms}, and no SET_CONFIG changes it"
        )
        self.arm()
        return length_ms

    def arm_anew(self) -> None:
        """Arm so that no hold runs before the next latch (HG-12.2/2)."""
        self.disarm()
        self.arm()

    def arm_at(self, seq: int) -> None:
        """Arm by a request with the number *seq*."""
        self.link.call(m.Arm(), m.ArmReply, seq=seq)
        self.link.seq = seq

    def bring_to(self, state: OutputState) -> None:
        """Bring the board to ARMED, DISARMED or MUTED."""
        self.arm()
        if state is OutputState.DISARMED:
            self.disarm()
        elif state is OutputState.MUTED:
            self.link.ask(m.Mute())

    def disarm(self) -> OutputState:
        """Disarm, and return the state; FAILED if it is ARMED."""
        state = self.link.call(m.Disarm(), m.DisarmReply).state
        check(state is not OutputState.ARMED, "DISARM_REPLY says ARMED; due is DISARMED or MUTED")
        return state

    def mute(self, **header: Any) -> m.MuteReply:
        """Mute, whatever the session, and return the reply; FAILED if there is none."""
        return self.link.call(m.Mute(), m.MuteReply, **header)

    def stop(self) -> ReceivedByClient:
        """Send STOP, which a board without playback refuses, and return its answer."""
        return self.link.ask(m.Stop())

    def leaves_fault(self) -> bool:
        """Ask for DISARM until it leads out of FAULT; return False if the fault lasts longer."""
        end_us = self.wire.now_us() + _FAULT_US
        while isinstance(self.link.ask(m.Disarm()).message, m.Error):
            if self.wire.now_us() > end_us:
                return False
            self.wire.idle(_FAULT_US // 50)
        return self.status().state is not OutputState.FAULT

    def restarted(self) -> BoardClient:
        """Switch the board off and on; return the client of its new session."""
        assert self.restart is not None  # the case needs a reset
        board = self.restart()
        board.hello()
        return board

    def read_geometry(self) -> list[m.Element]:
        """Return position and normal of every transducer; FAILED if a reply shows none."""
        elements: list[m.Element] = []
        while len(elements) < self.identity.transducers:
            reply = self.link.call(m.GetGeometry(len(elements), 0xFFFF), m.GeometryReply)
            check(bool(reply.elements), f"GET_GEOMETRY from {len(elements)} shows nothing")
            elements += reply.elements
        return elements

    def depth_to_fill(self) -> int:
        """Return the depth of the queue; NOT-OBSERVED if that is too much to fill."""
        depth = self.identity.queue_depth
        require(depth <= _DEEPEST, f"a queue of {depth} frames is not filled")
        return depth

    def times_in_queue(self, number: int, *, others: int = 0, ahead_us: int = 0) -> list[int]:
        """Return *number* times, a millisecond apart, for frames of :meth:`shortest_stream`.

        With *others* beside them they come in time; NOT-OBSERVED if the last one lies beyond the
        horizon then.
        """
        good = self.shortest_stream()
        frames = number + others
        points = frames * (len(good.points) if isinstance(good, m.Points) else 0)
        size = frames * len(self.link.stream_wire(good, 0, seq=0)) + _STATUS_BYTES
        start_us = self.clock.soon_us(bytes(size), points=points) + ahead_us
        times = [start_us + 1000 * place for place in range(number)]
        self.clock.require_horizon(times[-1] + 1000 - self.clock.device_estimate_us())
        return times

    def within_timers(self, wires: Iterable[bytes]) -> list[bytes]:
        """Return the first of *wires*, one at least, that the line brings before a timer ends.

        Lease and hold of a board without CONFIG are short, and so may be its unattended time.
        """
        timers_ms = (self.config.hold_ms, self.config.host_timeout_ms)
        least_us = 500 * min(*timers_ms, self.identity.max_unattended_ms)
        taken: list[bytes] = []
        made, size = iter(wires), 0
        while True:
            number = self.link.stream_next
            wire = next(made, None)
            size += len(wire or b"")
            if wire is None or (taken and self.wire.line_us(size) > least_us):
                self.link.stream_next = number  # that of a frame which is not sent, too
                return taken
            taken.append(wire)

    # --- status --------------------------------------------------------------------------------

    def last_latch_us(self) -> int:
        """Return the device time of the last latch, by the status."""
        return self.clock.unwrap(self.status().last_latch_us)

    def status(self) -> m.StatusReply:
        """Return the status, without the pauses of the client in its counters."""
        status, pauses = self.link.call(m.GetStatus(), m.StatusReply), self.link.pauses
        if not pauses:
            return status
        counted = {
            name: (getattr(status.counters, name) - pauses) & 0xFFFFFFFF
            for name in ("frames", "requests")
        }
        return dataclasses.replace(status, counters=dataclasses.replace(status.counters, **counted))

    def sample(self, items: Iterable[_T], at_wall: int = 1) -> list[_T]:
        """Return all of *items*, at a wall clock, where each takes its time, the first of them."""
        return list(items) if self.wire.is_virtual else list(items)[:at_wall]

    def check_status(self, text: str, **due: object) -> m.StatusReply:
        """Return the status; FAILED, with *text*, unless the fields named have these values."""
        status = self.status()
        check_fields(status, f"{text}: STATUS_REPLY", **due)
        return status

    def require_no_status(self) -> None:
        """End the case as NOT-OBSERVED if the board sends STATUS, which empties the margins."""
        if self.config.status_period_ms:
            not_observed(
                f"STATUS comes every {self.config.status_period_ms} ms, and begins the margins anew"
            )

    def require_hold(self, lasts_us: int, what: str) -> None:
        """End the case as NOT-OBSERVED if a hold that no SET_CONFIG extends ends within that."""
        if lasts_us >= 1000 * self.config.hold_ms and not self.has(m.Feature.CONFIG):
            hold_ms = self.config.hold_ms
            not_observed(f"{what}, and a hold of {hold_ms} ms that no SET_CONFIG extends")

    @contextlib.contextmanager
    def counting(self, **wanted: int | None) -> Iterator[None]:
        """FAILED unless the counters grew by *wanted* meanwhile, and no counter of an error did.

        ``frames`` and ``requests`` are judged where they are named, less the GET_STATUS of this
        method.  None as number: what the counter has to count is asked by a case of its clause.
        """
        before = self.status().counters
        yield
        counted = self.counted_since(before)
        differs = {
            name: number
            for name, number in counted.items()
            if number != wanted.get(name, number if name in _HARMLESS else 0)
            and wanted.get(name, 0) is not None
        }
        if differs:
            due = ", ".join(f"{name} {wanted.get(name, 0)}" for name in differs)
            got = ", ".join(f"{name} {number}" for name, number in differs.items())
            sent = self.wire.recording.before(self.link.seq & 0xFFFF)
            fail(f"should count {due}; counted {got}; {sent}")

    def due_event(
        self, kind: type[_M], since: int, timeout_us: int, name: str = ""
    ) -> tuple[m.Header, _M]:
        """Return the first event of a kind from piece *since* on; FAILED if none comes in time."""
        found = self.link.await_event(kind, since, timeout_us)
        return found or self.lacks_event(kind, since, timeout_us, name)

    def lacks_event(
        self, kind: type[m.Message], since: int, timeout_us: int, name: str
    ) -> NoReturn:
        """FAILED, as no such event has come; tell what did, and the state."""
        came, status = self.link.text_since(since), self.status()
        text = f"{name and f'{name}: '}no {kind.TYPE.name} within {timeout_us / 1000:g} ms; {came}"
        fail(f"{text}; STATUS_REPLY says {status.state.name}, {status.reason.name}")

    def check_counters_kept(self, before: m.Counters, name: str) -> m.Counters:
        """FAILED unless no counter went back since *before*; return the counters."""
        after = self.status().counters
        fell = [counter for counter, step in counter_steps(before, after).items() if step >> 31]
        less = {counter: (getattr(before, counter), getattr(after, counter)) for counter in fell}
        check(not less, f"{name}: counters went back: {less}")
        return after

    def counted_since(self, before: m.Counters) -> dict[str, int]:
        """Return by how much every counter grew, less the GET_STATUS of this call."""
        after = self.status().counters
        counted = counter_steps(before, after)
        counted["frames"] -= 1
        counted["requests"] -= 1
        return counted

    def check_counted(self, before: m.Counters, text: str, *due: Mapping[str, int]) -> None:
        """FAILED, with *text*, unless the counters have grown as in one of *due* since *before*."""
        counted = self.counted_since(before)
        got = {name: counted[name] for name in due[0]}
        allowed = " or ".join(_counts_text(one) for one in due)
        check(got in due, f"{text}: counted {_counts_text(got)}; due is {allowed}")


def _counts_text(counted: Mapping[str, int]) -> str:
    """Return counters as text, such as "frames 3, late 1"; '' if there are none."""
    return ", ".join(f"{name} {number}" for name, number in counted.items())
