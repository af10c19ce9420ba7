"""Events of a board: latches and changes of its output, each with its device time."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import TypeAlias

from haptogram.acoustics import Drive
from haptogram.acoustics.arrays import ComplexArray
from haptogram.acoustics.model.pulses import PulseDrive
from haptogram.records.latch import Codes, LatchRecord
from haptogram.records.remark import About
from haptogram.settings.frozen import dataclass, field
from haptogram_protocol.messages import LatchKey
from haptogram_protocol.state import MuteReason, OutputState


@dataclass(slots=True)  # frozen would take four times as long to make
class Latch:
    """A drive went from the second buffer to the transducers; it is not changed.

    Attributes
    ----------
    key : LatchKey
        Which frame, within its session.
    session : int
        Session in which it came.
    number : int
        Count of latches in this session, from 0.
    t_latch_us : int
        Device time, unwrapped: a multiple of the carrier period.
    late : bool
        Whether that is after its t_apply, beyond the rounding to the carrier.
    drive : Drive
        Latched codes, in the 8 bits of the registers.
    commanded_bits : int
        Resolution of the phases that were commanded.
    radiated : Drive
        After correction, ceiling and ramp: at this moment; the same object where nothing differs.
    ramping : bool
        Whether a ramp to silence was under way.
    t_received_us : int or None
        When a stream frame was complete at the board; None: it came out of a sequence.
    """

    key: LatchKey
    session: int
    number: int
    t_latch_us: int
    late: bool
    drive: Drive
    commanded_bits: int
    radiated: Drive
    ramping: bool
    t_received_us: int | None = None

    @property
    def index(self) -> int:
        """Number of the frame."""
        return self.key.index

    def weights(self) -> ComplexArray:
        """Return the (N,) complex weights of what is radiated."""
        return self.radiated.weights()

    @property
    def is_unchanged(self) -> bool:
        """True if the latched drive left the transducers as it is."""
        return self.radiated is self.drive or self.radiated == self.drive

    def record(self) -> LatchRecord:
        """Return the latch as records hold it."""
        return LatchRecord(
            self.session,
            self.key.sequence,
            self.key.loop,
            self.key.index,
            self.number,
            self.t_latch_us,
            self.t_received_us,
            self.late,
            self.ramping,
            self.commanded_bits,
            Codes.of(self.drive),
            None if self.is_unchanged else Codes.of(self.radiated),
        )


@dataclass(frozen=True, slots=True)
class Modulation:
    """The amplitude of all channels as it is modulated from a latch on, again and again.

    Attributes
    ----------
    rate_hz : float
        Samples per second.
    samples : bytes
        Share of the amplitude of the pulses, 255: all of it.
    """

    rate_hz: float
    samples: bytes


class CarrierState(enum.Enum):
    """State of the carrier, by its periods, and the level that is left at its frequency."""

    STEADY = "steady", 1.0
    DRAWN_OUT = "drawn out", 0.5
    HALVED = "halved", 0.5

    @property
    def level(self) -> float:
        """Share of the amplitude that a transducer hears."""
        return self.value[1]


@dataclass(frozen=True, slots=True)
class PulseLatch:
    """The pulses of a board of another dialect changed; the intended frame is not known.

    Attributes
    ----------
    t_latch_us : int
        Device time, unwrapped: when the byte that caused the latch was complete, or when the board
        went on by itself.
    pulses : Pulses
        Of every channel of every board, board after board, those without an emitter included.
    cause : str
        Cause of the latch: ``power-up``, or the word of the unit (``swap``, ``frame``,
        ``durations``, ...).
    index : int
        Place in a sequence that the board runs along; 0 without one.
    modulation : Modulation or None
        The board modulates the amplitude in addition.
    phase_steps : int or None
        Steps of a period to half of which the board has computed its phases; None: as exactly as
        every other drive.
    number : int
        Count of latches since power-up, from 0.
    counted : mapping
        What codec and unit counted since the latch before, by kind: bytes that they could not
        understand, frames cut short. Not empty: this latch may be torn.
    radiated : (N,) complex numpy.ndarray or None
        Weight of each emitter of the array, after faults; None until the dialect has set it.
    is_faulty : bool
        Whether faults on purpose, or the carrier, changed *radiated*.
    carrier : CarrierState
        How its periods follow each other.
    """

    t_latch_us: int
    pulses: PulseDrive
    cause: str
    index: int = 0
    modulation: Modulation | None = None
    phase_steps: int | None = None
    number: int = 0
    counted: Mapping[str, int] = field(default_factory=dict)
    radiated: ComplexArray | None = None
    is_faulty: bool = False
    carrier: CarrierState = CarrierState.STEADY

    def weights(self) -> ComplexArray:
        """Return the (N,) complex weights of what is radiated; only a dialect knows them."""
        if self.radiated is None:
            raise TypeError("a latch of a unit, before its dialect has said what it radiates")
        return self.radiated


@dataclass(frozen=True, slots=True)
class StateChange:
    """The output state changed, by request or by itself."""

    t_us: int
    state: OutputState
    reason: MuteReason
    requested: bool


@dataclass(frozen=True, slots=True)
class SessionOpened:
    """A host began a session."""

    t_us: int
    session: int


@dataclass(frozen=True, slots=True)
class RampBegan:
    """The output began to fade, because a timer ran out; unless it is restored, until *end_us*."""

    t_us: int
    reason: MuteReason
    end_us: int


@dataclass(frozen=True, slots=True)
class RadiatedAnew:
    """A new ceiling or correction changed a drive that sounds, without a latch.

    Attributes
    ----------
    radiated : Drive
        From now on.
    full : Drive
        The same at the beginning of a ramp that is under way.
    cut : int
        Largest amplitude code that such a ramp leaves.
    """

    t_us: int
    radiated: Drive
    full: Drive
    cut: int


@dataclass(frozen=True, slots=True)
class RampEnded:
    """A ramp is over: restored to full output, or ended by a change of state."""

    t_us: int
    restored: bool


@dataclass(frozen=True, slots=True)
class PlaybackEnd:
    """A sequence ended, by itself or because something stopped it."""

    t_us: int
    sequence: int
    loops: int
    frames: int


@dataclass(frozen=True, slots=True)
class Counted:
    """Counts at the end.

    Attributes
    ----------
    what : str
        ``faults``: of a plan, that fired; ``line``: bytes that the line lost or damaged by its own
        nature.
    plan : str
        Of faults: the plan and its seed, as TOML, with which the run can be repeated.
    """

    t_us: int
    what: str
    counts: dict[str, int]
    plan: str = ""


@dataclass(frozen=True, slots=True)
class Remark:
    """Something about the client that its user should read: one line."""

    t_us: int
    text: str
    about: About = About.CLIENT


@dataclass(frozen=True, slots=True)
class WireCompared:
    """The bytes of a client were compared with all wires, and look like no other one.

    Attributes
    ----------
    is_own : bool
        Whether they look like that of the board.
    """

    t_us: int
    is_own: bool


@dataclass(frozen=True, slots=True)
class ClientLeft:
    """A client that had sent something has closed the port of a board of another dialect."""

    t_us: int


@dataclass(frozen=True, slots=True)
class StreamDropped:
    """A stream frame that came whole was not queued.

    Attributes
    ----------
    session, index : int
        Which frame.
    counter : str
        Counter that took it.
    """

    t_us: int
    session: int
    index: int
    counter: str


@dataclass(frozen=True, slots=True)
class PowerDown:
    """The board is shutting down: it mutes itself without a request."""

    t_us: int


AnyLatch: TypeAlias = Latch | PulseLatch
Notice: TypeAlias = (
    Counted
    | SessionOpened
    | StateChange
    | RampBegan
    | RampEnded
    | RadiatedAnew
    | PlaybackEnd
    | Remark
    | ClientLeft
    | WireCompared
    | StreamDropped
    | PowerDown
)
