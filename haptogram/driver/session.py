"""A session with a board: opening, listening, asking, and closing it with the output off."""

from __future__ import annotations

import dataclasses
import random
import secrets
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, TypeAlias

from haptogram.acoustics import AcousticModel, Calibration, Medium, TransducerArray
from haptogram.driver.handshake import open_session
from haptogram.driver.identity import check_model, model_of, read_array, read_geometry
from haptogram.driver.line.link import NS_PER_S, Link
from haptogram.driver.line.port import DEFAULT_BAUDRATE, MOST_BAUDRATE, Transport, open_transport
from haptogram.driver.timing.clock import ClockEstimate
from haptogram.driver.timing.pings import Pinger
from haptogram.driver.trace import TraceReader
from haptogram.driver.upload import check_upload, upload
from haptogram.errors import ConfigurationError, HaptogramError, LinkError, WrongProtocolError
from haptogram.records.frame import Intended, Observation
from haptogram.records.kept import MOST_KEPT, Kept
from haptogram.settings.arguments import (
    MOST_SEED,
    check_callable,
    check_kind,
    check_number,
    check_whole,
    shown,
)
from haptogram_protocol import HostConnection, LocalProtocolError
from haptogram_protocol.connection import EventReceived, FrameDropped, ReplyReceived
from haptogram_protocol.export.tables import description_hash
from haptogram_protocol.framing import fastest_cobs
from haptogram_protocol.messages import (
    Config,
    ConfigReply,
    DriveKind,
    GetConfig,
    GetStatus,
    HelloReply,
    MuteReply,
    SetConfig,
    SetConfigReply,
    Status,
    StatusReply,
    TraceMode,
    UploadKind,
    unwrap,
)
from haptogram_protocol.state import OutputState

#: Is given every frame that is sent, and every latch that the board tells.
Sink: TypeAlias = Callable[[Intended | Observation], object]

_MOST_EVER: Final = 10**9  # entries that anybody can ask to be kept
_MOST_WARNINGS: Final = 100
_MUTE_TIMEOUT_NS: Final = NS_PER_S  # to say goodbye: the board's own timers mute it soon after


class Session:
    """Everything that a host does with a board but output.

    Parameters and attributes are those of :class:`haptogram.driver.driver.Driver`.
    """

    def __init__(
        self,
        port: str | Transport,
        *,
        baudrate: int = DEFAULT_BAUDRATE,
        nonce: int | None = None,
        seed: int | None = None,
        timeout_s: float = 2.0,
        model: AcousticModel | None = None,
        medium: Medium | None = None,
        calibration: Calibration | str | Path | None = None,
        trace: TraceMode | None = None,
        keep: int | None = MOST_KEPT,
        sink: Sink | None = None,
    ) -> None:
        _check_port(port, baudrate, timeout_s)
        _check_model(model, medium)
        if trace is not None:
            check_kind("trace", trace, TraceMode, "a TraceMode, or None")
        if keep is not None:
            check_whole("keep", keep, 1, _MOST_EVER)
        check_callable("sink", sink)
        elements = None if calibration is None else Calibration.of(calibration)
        self.session = _nonce(nonce, seed)
        connection = HostConnection(
            nonce=self.session, description_hash=description_hash(), cobs=fastest_cobs()
        )
        transport = open_transport(port, baudrate=baudrate) if isinstance(port, str) else port
        self._link = Link(transport, connection, baudrate=baudrate, timeout_s=timeout_s)
        self.observations = Kept[Observation](keep, sink)
        self.events = Kept[EventReceived](keep)
        self.last_status: Status | None = None
        self._closed = self._in_doubt = False
        try:
            self._connect(model, medium, elements)
            if trace is not None:
                self.configure(trace_mode=trace)
        except BaseException:
            self._link.close()
            raise

    def _connect(
        self,
        model: AcousticModel | None,
        medium: Medium | None,
        elements: Calibration | None,
    ) -> None:
        link = self._link
        self.identity: HelloReply = open_session(link)
        self.warnings = list(link.connection.warnings)
        if model is None:
            model = model_of(read_array(link, self.identity), self.identity, medium)
        self.warnings += check_model(model, self.identity)
        self.model = model if elements is None else model.calibrated(elements)
        self.clock = ClockEstimate(self.identity.clock_ppm)
        self._pinger = Pinger(link, self.clock)
        self._traces = TraceReader(self.session, self.identity.transducers, self.clock)
        link.handler = self._take
        self._pinger.synchronise()
        self._config = link.request(GetConfig(), ConfigReply).config

    def _take(self, event: EventReceived | ReplyReceived | FrameDropped) -> None:
        """Take what the board sent while nobody waited for it."""
        if isinstance(event, ReplyReceived):
            self._pinger.take(event)
        elif isinstance(event, EventReceived):
            self._take_event(event)

    def _take_event(self, event: EventReceived) -> None:
        if isinstance(event.message, Status):
            self.last_status = event.message
            return
        try:
            observation = self._traces.take(event)
        except WrongProtocolError as error:
            self._warn(str(error))
            return
        if observation is not None:
            self.observations.append(observation)
            return
        self.events.append(event)

    def _warn(self, text: str) -> None:
        """Say *text* among the warnings, once, and not without end."""
        if text not in self.warnings and len(self.warnings) < _MOST_WARNINGS:
            self.warnings.append(text)

    # --- life ----------------------------------------------------------------------------------

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            self.close()
        except HaptogramError as unmuted:
            if error is None:
                raise
            error.add_note(str(unmuted))  # the first error is the one that tells more

    def close(self) -> None:
        """Mute the board and close the port, in bounded time.  Closing twice does no harm.

        Raises
        ------
        LinkError
            If the board did not confirm that it is mute; its own timers will mute it.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._link.mute(MuteReply, min(_MUTE_TIMEOUT_NS, self._link.timeout_ns))
        except HaptogramError as error:
            raise LinkError(
                f"{self.url}: the board did not confirm that it is mute; it mutes itself after "
                f"{max(self._config.hold_ms, self._config.host_timeout_ms)} ms without a host"
            ) from error
        finally:
            self._link.close()

    @property
    def url(self) -> str:
        """What the port was opened by."""
        return self._link.url

    @property
    def link_counters(self) -> dict[str, int]:
        """What the host counted of the frames from the board."""
        return dict(self._link.connection.counters)

    def mute(self) -> OutputState:
        """Switch the output off, ahead of everything that waits."""
        return self._link.mute(MuteReply, self._link.timeout_ns).state

    # --- questions -----------------------------------------------------------------------------

    def device_time_us(self) -> int:
        """Return what the board's clock shows now, unwrapped, as far as the host knows."""
        return self.clock.to_device_us(self._link.now_ns())

    def time_of_event_us(self, event: EventReceived) -> int:
        """Return the device time of *event*, unwrapped."""
        return unwrap(event.header.time_us, self.clock.to_device_us(event.t_rx_us * 1000), 32)

    def status(self) -> StatusReply:
        """Return the board's counters and arrival margin; the margin then starts anew."""
        return self._link.request(GetStatus(), StatusReply)

    def ping(self) -> float:
        """Measure the device clock anew and return the error that is left, in microseconds."""
        self._pinger.synchronise()
        return self.clock.uncertainty_us

    def config(self) -> Config:
        """Return the board's configuration."""
        self._config = self._link.request(GetConfig(), ConfigReply).config
        self._in_doubt = False
        return self._config

    def configure(self, **changes: Any) -> Config:
        """Change fields of the board's configuration and return what is in force then.

        Parameters
        ----------
        **changes
            Fields of :class:`~haptogram_protocol.messages.Config`.

        Raises
        ------
        ConfigurationError
            If there is no such field, or a value does not fit it.
        DeviceError
            If the board refuses a value.
        """
        known = {field.name for field in dataclasses.fields(Config)}
        if unknown := sorted(set(changes) - known):
            raise ConfigurationError(
                f"configuration has no {unknown[0]!r}; it has {', '.join(sorted(known))}"
            )
        for name, value in changes.items():
            check_whole(name, value, 0, 2**32 - 1)
        if self._in_doubt:
            self.config()
        wanted = SetConfig(dataclasses.replace(self._config, **changes))
        self._in_doubt = True  # the board may take it, and its answer be lost
        try:
            self._config = self._link.request(wanted, SetConfigReply).config
        except LocalProtocolError as error:
            self._in_doubt = False
            raise ConfigurationError(f"configuration {changes} does not fit: {error}") from error
        self._in_doubt = False
        return self._config

    def correct_phases(self, codes: bytes) -> None:
        """Set the phase correction of every transducer, in 1/256 turns."""
        check_kind("codes", codes, bytes, "bytes")
        if len(codes) != self.identity.transducers:
            raise ConfigurationError(
                f"{len(codes)} phase corrections; the board has {self.identity.transducers} "
                "transducers"
            )
        check_upload(self.identity, UploadKind.CORRECTION, len(codes))
        upload(self._link, UploadKind.CORRECTION, 0, codes)

    def geometry(self) -> TransducerArray:
        """Return the board's array, read element by element."""
        return read_geometry(self._link, self.identity)

    def read_drive(self, kind: DriveKind = DriveKind.LATCHED) -> Observation:
        """Return the drive at the transducers now; see :class:`TraceReader`."""
        check_kind("kind", kind, DriveKind, "a DriveKind")
        return self._traces.read_drive(self._link, kind)

    def collect_ring(self) -> None:
        """Take what the board kept in its trace ring, if that is where it keeps it."""
        if self._config.trace_mode is TraceMode.RING:
            self.observations.extend(self._traces.read_ring(self._link))


def _check_port(port: str | Transport, baudrate: int, timeout_s: float) -> None:
    """Refuse what is no port, before anything is opened."""
    methods = ("url", "now_ns", "read_available", "write_some", "close")
    if not (port and isinstance(port, str)) and not all(hasattr(port, name) for name in methods):
        raise ConfigurationError(
            f"port is {shown(port)}, must be a URL such as '/dev/ttyUSB0', or an open Transport"
        )
    check_whole("baudrate", baudrate, 1, MOST_BAUDRATE)
    check_number("timeout_s", timeout_s, 0.001, 3600.0)


def _check_model(model: AcousticModel | None, medium: Medium | None) -> None:
    if model is not None:
        check_kind("model", model, AcousticModel, "an AcousticModel, or None")
    if medium is not None:
        check_kind("medium", medium, Medium, "a Medium, or None")
    if model is not None and medium is not None and model.medium != medium:
        raise ConfigurationError(
            f"medium has a speed of sound of {medium.sound_speed_m_s:g} m/s, that of the model "
            f"{model.medium.sound_speed_m_s:g} m/s; the model has its own: leave medium out"
        )


def _nonce(nonce: int | None, seed: int | None) -> int:
    if nonce is not None:
        return check_whole("nonce", nonce, 1, 0xFFFF)
    if seed is not None:
        return random.Random(check_whole("seed", seed, 0, MOST_SEED)).randint(1, 0xFFFF)
    return secrets.randbelow(0xFFFF) + 1
