"""A session with a board: its identity, its clock, and the messages that it sends unasked."""

from __future__ import annotations

import contextlib
import random
import secrets
from collections.abc import Callable
from typing import Final, TypeAlias

from haptogram.acoustics import AcousticModel, Calibration, Medium
from haptogram.driver.arming import Arming
from haptogram.driver.configuration import SessionConfiguration
from haptogram.driver.identity import assumed_model_of_identity
from haptogram.driver.line.link import NS_PER_S, Link, open_line_session
from haptogram.driver.timing.clock import ClockEstimate
from haptogram.driver.timing.pings import Pinger
from haptogram.driver.trace import DriverTraceReader
from haptogram.errors import HaptogramError, LinkError, WrongProtocolError
from haptogram.records.frame import Intended, Observation
from haptogram.records.kept import KeptRecords
from haptogram.settings.arguments import MOST_SEED, check_argument_kind, check_whole
from haptogram_protocol.connection import EventReceived, FrameDropped, ReplyReceived
from haptogram_protocol.messages import DriveKind, MuteReply, Status, TraceMode, unwrap

#: Called with every frame that is sent, and with every latch that the board reports.
Sink: TypeAlias = Callable[[Intended | Observation], object]

_MOST_WARNINGS: Final = 100
_MUTE_TIMEOUT_NS: Final = NS_PER_S  # of close: the board's own timers mute it soon after


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
    return secrets.randbelow(0xFFFF) + 1


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
    configuration, arming
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
        self.configuration = SessionConfiguration(self.link, self.identity)
        self.arming = Arming(self.link, self.clock, self.configuration)
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
            known = self.configuration.known
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
        if self.configuration.known.trace_mode is TraceMode.RING:
            self.observations.extend(self._traces.read_ring())

    def warn(self, text: str) -> None:
        """Add *text* to the warnings, once, and 100 warnings at most."""
        if text not in self.warnings and len(self.warnings) < _MOST_WARNINGS:
            self.warnings.append(text)

    def time_of_event_us(self, event: EventReceived) -> int:
        """Return the device time of *event*, unwrapped."""
        return unwrap(event.header.time_us, self.clock.to_device_us(event.t_rx_us * 1000), 32)

    def _take(self, event: EventReceived | ReplyReceived | FrameDropped) -> None:
        """Process a message that no request awaits."""
        if isinstance(event, ReplyReceived):
            self.pinger.take(event)
        elif isinstance(event, EventReceived):
            self._take_event(event)

    def _take_event(self, event: EventReceived) -> None:
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
