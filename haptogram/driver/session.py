"""A session with a board: its identity, clock, configuration and output state, events and latches.

Latches are what the board reports: trace events, trace ring and read-back. All of it is the own
word of the firmware, and marked so (:attr:`Evidence.SELF_REPORTED`).
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import random
from collections.abc import Callable, Iterable
from typing import Any, Final, TypeAlias

import numpy as np

from haptogram.acoustics import AcousticModel, Calibration, Drive, Medium
from haptogram.driver.frames.frame import Frame
from haptogram.driver.identity import assumed_model_of_identity
from haptogram.driver.line.link import NS_PER_S, Link, open_line_session, request_parts
from haptogram.driver.timing.clock import ClockEstimate
from haptogram.driver.timing.pings import Pinger
from haptogram.errors import ConfigurationError, HaptogramError, LinkError, WrongProtocolError
from haptogram.records.frame import Evidence, FrameKey, Intended, Observation
from haptogram.records.kept import KeptRecords
from haptogram.settings.arguments import MOST_SEED, check_argument_kind, check_whole
from haptogram_protocol import LocalProtocolError, messages
from haptogram_protocol.connection import EventReceived, FrameDropped, ReplyReceived
from haptogram_protocol.messages import DriveKind, MuteReply, Status, TraceMode, unwrap
from haptogram_protocol.state import MuteReason, OutputState

_READ_TRIES = 3  # tries to read a drive that is replaced meanwhile
_RING_READ = 0xFFFF  # latches asked for at a time; the board sends as many as fit
_HALF_TURN_NS = 2_100_000_000_000  # of the device clock: what is read back is in the past


class DriverTraceReader:
    """Turns the reports of the board into observations.

    Parameters
    ----------
    link : Link
        The open session.
    transducers : int
        Length of a drive.
    clock : ClockEstimate
        Unwraps the times.
    """

    def __init__(self, link: Link, transducers: int, clock: ClockEstimate) -> None:
        self._link = link
        self._transducers = transducers
        self._clock = clock
        self._next_in_ring = 0

    def take(self, event: EventReceived) -> Observation | None:
        """Return the latch that *event* reports, None if it reports something else."""
        message = event.message
        shown: bytes | int
        if isinstance(message, messages.Trace):
            key, shown = messages.LatchKey(0, 0, message.index), message.crc
        elif isinstance(message, messages.TracePlayback):
            key, shown = message.key, message.crc
        elif isinstance(message, messages.TraceDrive):
            key, shown = message.key, message.data
        else:
            return None
        header = event.header
        return self._latch(key, header.time_us, event.t_rx_us * 1000, shown, header.flags)

    def read_ring(self) -> tuple[list[Observation], int]:
        """Return the latches that were not read before, oldest first, as far as the ring has them.

        And the number of those that it has not.
        """
        found, first = list[Observation](), self._next_in_ring
        while True:
            reply = self._link.request(
                messages.ReadTrace(self._next_in_ring, _RING_READ), messages.TraceReply
            )
            near_ns = self._link.now_ns() - _HALF_TURN_NS
            found += [
                self._latch(record.key, record.t_latch_us, near_ns, record.crc, record.flags)
                for record in reply.records
            ]
            if not reply.records or reply.records[-1].number < self._next_in_ring:
                break
            self._next_in_ring = reply.records[-1].number + 1
            if self._next_in_ring >= reply.next:
                break
        return found, max(0, self._next_in_ring - first - len(found))

    def read_drive(self, kind: messages.DriveKind) -> Observation:
        """Return the drive at the transducers now, latched or radiated.

        Raises
        ------
        DeviceError
            The board cannot read it back, or nothing was latched.
        WrongProtocolError
            Every reading was overtaken by another latch.
        """
        for _ in range(_READ_TRIES):
            replies = request_parts(
                self._link,
                self._transducers,
                functools.partial(messages.ReadDrive, kind),
                messages.DriveReply,
                lambda part: len(part.data) // 2,
            )
            if len({(reply.key, reply.t_latch_us) for reply in replies}) == 1:
                halves = [(r.data[: len(r.data) // 2], r.data[len(r.data) // 2 :]) for r in replies]
                data = b"".join(b"".join(part) for part in zip(*halves, strict=True))
                key, t_us = replies[0].key, replies[0].t_latch_us  # a read-back tells no lateness
                return self._latch(key, t_us, self._link.now_ns() - _HALF_TURN_NS, data)
        raise WrongProtocolError(
            f"{self._link.url}: the drive changed during each of {_READ_TRIES} read-backs"
        )

    def _latch(
        self, key: messages.LatchKey, wire_us: int, near_ns: int, shown: bytes | int, flags: int = 0
    ) -> Observation:
        """Return the observation of the latch of the frame *key*, with the traced drive or CRC.

        *key*: sequence, loop and index of the frame; *shown*: the drive's codes as bytes, or its
        CRC-32. *wire_us* has 32 bits of the device time; *near_ns*, a host time within half a
        period of those, gives the others.
        """
        drive = self._drive(shown) if isinstance(shown, bytes) else None
        crc = shown if isinstance(shown, int) else None
        return Observation(
            key=FrameKey(self._link.connection.session, key.sequence, key.loop, key.index),
            t_latch_us=messages.unwrap(wire_us, self._clock.to_device_us(near_ns), 32),
            late=bool(flags & messages.Flag.LATE),
            evidence=Evidence.SELF_REPORTED,
            drive=drive,
            drive_crc=drive.digest() if drive is not None else crc,
        )

    def _drive(self, data: bytes) -> Drive:
        """Return the drive of N phase codes and N amplitude codes in *data*.

        Raises WrongProtocolError unless N is the number of the board's transducers.
        """
        codes = np.frombuffer(data, dtype=np.uint8)
        count = len(codes) // 2
        if count != self._transducers:
            raise WrongProtocolError(
                f"a drive of {count} transducers; the board has {self._transducers}"
            )
        try:
            return Drive(codes[:count], codes[count:])
        except ConfigurationError as error:
            raise WrongProtocolError(f"a drive that cannot be: {error}") from error


# --- Configuration, output and session -----------------------------------------------------------


_TIMEOUTS: Final = (MuteReason.HOLD_EXPIRED, MuteReason.HOST_SILENT)
_AT_ONCE_US: Final = 2_000  # longest time from a request to the latch of the next frame
_REFRESHES: Final = 4  # requests of the status within the shorter of the two timers
#: Called with every frame that is sent, and with every latch that the board reports.
Sink: TypeAlias = Callable[[Intended | Observation], object]
_MOST_WARNINGS: Final = 100
_MUTE_TIMEOUT_NS: Final = NS_PER_S  # wait for MUTE at close: the board's own timers follow soon


class SessionControl:
    """Keeps configuration and output state of one board as the host wants them.

    Parameters
    ----------
    link : Link
        The open session.
    clock : ClockEstimate
        Tells how long a drive is held already.
    identity : HelloReply
        Its features say whether the board can be configured.

    Attributes
    ----------
    known : Config
        The configuration that the board confirmed last.
    """

    def __init__(self, link: Link, clock: ClockEstimate, identity: messages.HelloReply) -> None:
        self._link, self._clock, self._identity = link, clock, identity
        self._wanted = False  # the output, by the caller: a timeout does not change that
        self.known = self.read()

    # --- output --------------------------------------------------------------------------------

    def arm(self) -> OutputState:
        """Allow output; it stays silent until the first frame is latched."""
        self._wanted = True
        return self._link.request(messages.Arm(), messages.ArmReply).state

    def mute(self) -> OutputState:
        """Switch the output off, ahead of everything that waits."""
        self._wanted = False
        return self._mute()

    def disarm(self) -> OutputState:
        """Switch the output off and forbid it."""
        self._wanted = False
        return self._link.request(messages.Disarm(), messages.DisarmReply).state

    def _mute(self) -> OutputState:
        """Send MUTE; return the output state of the reply."""
        return self._link.mute(messages.MuteReply, self._link.timeout_ns).state

    def rearm_if_timed_out(self, first_us: int) -> None:
        """Arm again a board that a timer muted, or would mute before the next frame is latched.

        Parameters
        ----------
        first_us : int
            Time until the first latch of the frames to come.  A hold that runs out before would
            mute the board under the frames on their way, and all of them would be lost.

        Raises
        ------
        ConfigurationError
            If the board is not armed for any other reason.
        """
        status = self._fresh_status()
        if self._wanted and self._hold_ends_before(first_us, status):
            self._mute()
            self.arm()
        elif self._wanted and status.reason in _TIMEOUTS:
            self.arm()
        elif status.state is not OutputState.ARMED:
            raise ConfigurationError(
                f"the board is {status.state.name} ({status.reason.name}); arm it first"
            )

    @property
    def refresh_ns(self) -> int:
        """Time between two frames that keeps both timers of the board from running out."""
        return min(self.known.hold_ms, self.known.host_timeout_ms) * 1_000_000 // _REFRESHES

    def _fresh_status(self) -> messages.StatusReply:
        """Return the status; ask again, up to 3 times, while an answer takes too long.

        Too long is `refresh_ns` or more: a quarter of the shorter of hold and lease.
        """
        for _ in range(_REFRESHES):
            asked_ns = self._link.now_ns()
            status = self._link.request(messages.GetStatus(), messages.StatusReply)
            if self._link.now_ns() - asked_ns < self.refresh_ns:
                break
        return status

    def _hold_ends_before(self, first_us: int, status: messages.StatusReply) -> bool:
        """Return True if the hold that runs now may expire before the first frame latches.

        The frame is due *first_us* µs from now. It may be late by half of that or, if that is
        longer, by the lesser of 2 ms and a quarter of the hold.
        """
        if status.state is not OutputState.ARMED or not status.counters.latched:
            return False
        known = self.known
        now_us = self._clock.to_device_us(self._link.now_ns())
        held_us = now_us - messages.unwrap(status.last_latch_us, now_us, 32)
        hold_us, ramp_us = known.hold_ms * 1000, known.ramp_ms * 1000
        wait_us = first_us + max(first_us // 2, min(_AT_ONCE_US, hold_us // 4))
        return hold_us - wait_us < held_us <= hold_us + ramp_us  # later: armed, nothing latched yet

    # --- configuration -------------------------------------------------------------------------

    def read(self) -> messages.Config:
        """Ask the board for its configuration and return it."""
        self.known = self._link.request(messages.GetConfig(), messages.ConfigReply).config
        self._in_doubt = False
        return self.known

    def confirmed(self) -> messages.Config:
        """Return the configuration; ask the board if the answer to a change was lost."""
        return self.read() if self._in_doubt else self.known

    def change(self, **changes: Any) -> messages.Config:
        """Change fields of :class:`~haptogram_protocol.messages.Config` and return the result.

        Raises
        ------
        ConfigurationError
            If there is no such field, or a value does not fit its field.
        DeviceError
            If the board refuses a value.
        """
        fields = {field.name for field in dataclasses.fields(messages.Config)}
        if unknown := sorted(set(changes) - fields):
            raise ConfigurationError(
                f"configuration has no {unknown[0]!r}; it has {', '.join(sorted(fields))}"
            )
        for name, value in changes.items():
            check_whole(name, value, 0, 2**32 - 1)
        wanted = messages.SetConfig(dataclasses.replace(self.confirmed(), **changes))
        self._in_doubt = True  # the board may apply the change, and its answer be lost
        try:
            self.known = self._link.request(wanted, messages.SetConfigReply).config
        except LocalProtocolError as error:
            self._in_doubt = False
            raise ConfigurationError(f"configuration {changes} does not fit: {error}") from error
        self._in_doubt = False
        return self.known

    def agree_on_sound_speed(self, frames: Iterable[Frame]) -> None:
        """Set the speed of sound for which *frames* of focal points were made.

        Raises
        ------
        ConfigurationError
            If the board assumes another speed of sound and has no configuration to change.
        """
        known = self.confirmed()
        speeds = (f.sound_speed_mm_s for f in frames if f.sound_speed_mm_s is not None)
        speed_mm_s = next(speeds, None)
        if speed_mm_s is None or speed_mm_s == known.sound_speed_mm_s:
            return
        if not self._identity.features & messages.Feature.CONFIG:
            raise ConfigurationError(
                f"the frames are for a speed of sound of {speed_mm_s / 1000:g} m/s; the board "
                f"assumes {known.sound_speed_mm_s / 1000:g} m/s and cannot be told"
            )
        self.change(sound_speed_mm_s=speed_mm_s)


def choose_session_nonce(nonce: int | None, seed: int | None) -> int:
    """Return *nonce*, else one drawn with *seed*, else one at random.

    Raises
    ------
    ConfigurationError
        If *nonce* or *seed* is no whole number within its limits.
    """
    if nonce is not None:
        return check_whole("nonce", nonce, 1, 0xFFFF)
    if seed is not None:
        return random.Random(check_whole("seed", seed, 0, MOST_SEED)).randint(1, 0xFFFF)
    return random.SystemRandom().randint(1, 0xFFFF)


class DriverSession:
    """One session on an open link, which is closed again where no session can be opened.

    Parameters
    ----------
    link : Link
        Its connection has the nonce of the session.
    keep : int or None
        Number of observations and of events that are kept, each; None: all.
    sink : callable or None
        Called with every observation.

    Attributes
    ----------
    link, identity, clock, pinger
        The open link, the board's answer to HELLO, the estimate of its clock, and the pings that
        feed the estimate.
    control
        Configuration and output state of the board, once the session was started.
    observations, events, last_status, warnings
        See :class:`haptogram.driver.driver.Driver`.
    """

    def __init__(self, link: Link, keep: int | None, sink: Sink | None) -> None:
        self.link = link
        try:
            self.identity = open_line_session(link)
        except BaseException:
            link.close()
            raise
        self.warnings = list(link.connection.warnings)
        self.clock = ClockEstimate(self.identity.clock_ppm)
        self.pinger = Pinger(link, self.clock)
        self._traces = DriverTraceReader(link, self.identity.transducers, self.clock)
        self.observations = KeptRecords[Observation](keep, sink)
        self.events = KeptRecords[EventReceived](keep)
        self.last_status: Status | None = None

    def start(
        self, model: AcousticModel | None, medium: Medium | None, elements: Calibration | None
    ) -> AcousticModel:
        """Compare the board with *model*, synchronise the clock, and read the configuration.

        Returns
        -------
        AcousticModel
            The model that the host assumes, with its calibration.
        """
        assumed, odd = assumed_model_of_identity(self.link, self.identity, model, medium)
        self.warnings += odd
        calibrated = assumed if elements is None else assumed.calibrated(elements)
        self.link.handler = self._take
        self.pinger.synchronise()
        self.control = SessionControl(self.link, self.clock, self.identity)
        return calibrated

    def abandon(self) -> None:
        """Mute the board, if it answers, and close the link: a driver that did not come up."""
        try:
            with contextlib.suppress(HaptogramError):
                self.link.mute(MuteReply, min(_MUTE_TIMEOUT_NS, self.link.timeout_ns))
        finally:
            self.link.close()

    def close(self) -> None:
        """Mute the board and close the link, in bounded time.

        Raises
        ------
        LinkError
            If the board did not confirm that it is mute; its own timers will mute it.
        """
        try:
            self.link.mute(MuteReply, min(_MUTE_TIMEOUT_NS, self.link.timeout_ns))
        except HaptogramError as error:
            known = self.control.known
            raise LinkError(
                f"{self.link.url}: the board did not confirm that it is mute; it mutes itself "
                f"after {max(known.hold_ms, known.host_timeout_ms)} ms without a host"
            ) from error
        finally:
            self.link.close()

    def read_drive(self, kind: DriveKind) -> Observation:
        """Return the present drive at the transducers; see :class:`DriverTraceReader`."""
        check_argument_kind("kind", kind, DriveKind, "a DriveKind")
        return self._traces.read_drive(kind)

    def collect_ring(self) -> None:
        """Add the latches in the board's trace ring, if it keeps one, to the observations."""
        if self.control.known.trace_mode is TraceMode.RING:
            found, missing = self._traces.read_ring()
            self.observations.total += missing  # of a ring that was full, say
            self.observations.extend(found)

    def warn(self, text: str) -> None:
        """Add *text* to the warnings, once, and 100 warnings at most."""
        if text not in self.warnings and len(self.warnings) < _MOST_WARNINGS:
            self.warnings.append(text)

    def time_of_event_us(self, event: EventReceived) -> int:
        """Return the device time of *event*, unwrapped."""
        return unwrap(event.header.time_us, self.clock.to_device_us(event.t_rx_us * 1000), 32)

    def _take(self, event: EventReceived | ReplyReceived | FrameDropped) -> None:
        """Take what no request awaits: a PONG for the clock, an event; drops are ignored."""
        if isinstance(event, ReplyReceived):
            self.pinger.take(event)
        elif isinstance(event, EventReceived):
            self._take_event(event)

    def _take_event(self, event: EventReceived) -> None:
        """Keep an event: STATUS as the newest one, a trace as observation, others in a list.

        A trace that breaks the protocol gives a warning.
        """
        if isinstance(event.message, Status):
            self.last_status = event.message
            return
        try:
            observation = self._traces.take(event)
        except WrongProtocolError as error:
            self.warn(str(error))
            return
        if observation is not None:
            self.observations.append(observation)
            return
        self.events.append(event)
