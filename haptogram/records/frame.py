"""Intended frames and observed latches: the records that a verdict joins, by their key.

The driver writes :class:`Intended`; trace, read-back and the back door of the virtual board give
:class:`Observation`.  Neither knows the other.

A record carries a drive or a reconstruction and computes nothing with it: only their types come
from :mod:`haptogram.acoustics`, and only for the type checker.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence, Set
from numbers import Real
from typing import TYPE_CHECKING, Any, Final, Self, cast

from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_argument_kind, check_number, shown_argument
from haptogram.settings.frozen import dataclass

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from haptogram.acoustics.model.drive import Drive
    from haptogram.acoustics.reconstruct.estimates import Reconstruction
    from haptogram.acoustics.solvers.several import Method

MAX_PHASE_RAD: Final = 1e6  # largest phase of a focus
STREAM: Final = 0  # sequence id of streamed frames


class Evidence(enum.StrEnum):
    """The witness of a latch.

    Examples
    --------
    >>> [str(evidence) for evidence in Evidence]
    ['wire', 'self-reported', 'external', 'simulated']
    """

    WIRE = "wire"  # seen on the line
    SELF_REPORTED = "self-reported"  # trace, read-back: the firmware's own word
    EXTERNAL = "external"  # back door of the virtual board, capture of the drive pins
    SIMULATED = "simulated"  # drive pins of firmware that runs in a simulator


@dataclass(slots=True, order=True, unsafe_hash=True)  # as Intended
class FrameKey:
    """The key of one drive, by which the records of host and board are joined.

    Attributes
    ----------
    session : int
        Nonce of the session.
    sequence : int
        Sequence id, 0 for the stream.
    loop : int
        Pass of the sequence, from 0; stream: 0.
    index : int
        Frame of the sequence; stream: unwrapped sequence number.
    """

    session: int
    sequence: int
    loop: int
    index: int

    @classmethod
    def of_stream(cls, session: int, index: int) -> Self:
        """Return the key of the stream frame with the unwrapped sequence number *index*."""
        return cls(session, STREAM, 0, index)

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """Return the key among the fields of a record."""
        return cls(record["session"], record["sequence"], record["loop"], record["index"])


@dataclass(frozen=True, slots=True)
class Focus:
    """One intended focal point.

    Attributes
    ----------
    position_m : tuple of 3 float
        x, y, z from the array's centre, in metres.
    amplitude : float
        Share of the drive, 0 to 1.
    phase_rad : float
        Phase of the pressure at the point, lag positive, in radians.

    Raises
    ------
    ConfigurationError
        If *position_m* is not three finite numbers, *amplitude* not within 0 to 1, or *phase_rad*
        not within a million radians.

    Examples
    --------
    >>> Focus((0.0, 0.0, 0.15), amplitude=0.5)
    Focus(position_m=(0.0, 0.0, 0.15), amplitude=0.5, phase_rad=0.0)
    """

    position_m: tuple[float, float, float]
    amplitude: float = 1.0
    phase_rad: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_m", _as_focus_position(self.position_m))
        for name, low, high in (
            ("amplitude", 0.0, 1.0),
            ("phase_rad", -MAX_PHASE_RAD, MAX_PHASE_RAD),
        ):
            value = getattr(self, name)
            if not (type(value) is float and low <= value <= high):  # which is fine as it is
                value = check_number(f"{name} of a focus", value, low, high)
                object.__setattr__(self, name, value)

    @classmethod
    def from_numbers(cls, numbers: Sequence[float]) -> Self:
        """Return the focus that a record holds as x, y, z, amplitude and phase."""
        x, y, z, amplitude, phase_rad = numbers
        return cls((x, y, z), amplitude, phase_rad)

    def as_numbers(self) -> list[float]:
        """Return the five numbers by which every record holds it."""
        return [*self.position_m, self.amplitude, self.phase_rad]

    @classmethod
    def at(cls, position_m: ArrayLike, amplitude: float = 1.0, phase_rad: float = 0.0) -> Self:
        """Return the focus at *position_m* (3,), in metres."""
        return cls(cast("tuple[float, float, float]", position_m), amplitude, phase_rad)


def _as_focus_position(position_m: Any) -> tuple[float, float, float]:
    """Return *position_m* as three finite floats; raise ConfigurationError if it is not."""
    if type(position_m) in (list, tuple) and len(position_m) == 3:
        x, y, z = position_m
        if type(x) is type(y) is type(z) is float and math.isfinite(x + y + z):
            return x, y, z
    try:
        if isinstance(position_m, str | bytes | Mapping | Set) or len(position_m) != 3:
            raise TypeError
        x, y, z = (_as_focus_coordinate(value) for value in position_m)
    except (TypeError, OverflowError) as error:
        raise ConfigurationError(
            f"target {shown_argument(position_m)} is not x, y, z: three finite numbers, in metres"
        ) from error
    return x, y, z


def _as_focus_coordinate(value: Any) -> float:
    """Return a finite number as a float; raise TypeError otherwise."""
    if isinstance(value, float) and math.isfinite(value):
        return float(value)
    if isinstance(value, bool) or not (isinstance(value, Real) and math.isfinite(value)):
        raise TypeError
    return float(value)


@dataclass(slots=True, unsafe_hash=True)  # nobody changes one; frozen would take twice the time
class Intended:
    """One drive that the host intends to be latched.

    Attributes
    ----------
    number : int
        Place among all frames that the host intended, 0 to n - 1.
    key : FrameKey
        Join key.
    t_apply_us : int or None
        Unwrapped device time, microseconds; None: as soon as the frame is complete.
    foci : tuple of Focus
        Focal points of the drive.
    drive : Drive
        Drive that the host expects in the registers, from the foci; phase codes of 8 bits, or more
        where the board has finer ones.
    phase_bits : int
        Resolution of the phases on the wire, in bits.
    phase_steps : int or None
        Steps in a period, where their number is none of *phase_bits*: on other boards.
    board_computed : bool
        True if the board computes the drive from the foci (as rounded on the wire).
    solver : str
        Method by which the host made the drive of several foci, see
        :func:`haptogram.acoustics.solvers.several.solve_foci`.
    t_latest_us : int or None
        Device time by which its last byte had to be at the board, less the error of the clocks;
        None: at no certain time, or not known.
    t_sent_us : int or None
        Device time at which its last byte left the host; None: it did not, or not known.

    Examples
    --------
    >>> with Driver(url, seed=1) as driver:
    ...     state = driver.arm()
    ...     intended = driver.focus((0.0, 0.0, 0.15))
    >>> intended.number, intended.foci[0].position_m, intended.drive.count
    (0, (0.0, 0.0, 0.15), 64)
    """

    number: int
    key: FrameKey
    t_apply_us: int | None
    foci: tuple[Focus, ...]
    drive: Drive
    phase_bits: int
    board_computed: bool = False
    solver: Method = "naive"
    phase_steps: int | None = None
    t_latest_us: int | None = None
    t_sent_us: int | None = None

    @property
    def is_held_up(self) -> bool:
        """True if the host sent it too late, or not at all."""
        if self.t_latest_us is None:
            return False
        return self.t_sent_us is None or self.t_sent_us > self.t_latest_us

    @property
    def steps(self) -> int:
        """Steps of the phases in a period."""
        return self.phase_steps or 1 << self.phase_bits


@dataclass(slots=True, unsafe_hash=True)  # as Intended
class Observation:
    """One observed latch.

    Attributes
    ----------
    key : FrameKey
        Join key.
    t_latch_us : int
        Device time of the latch, microseconds, unwrapped.
    late : bool
        True if the board flagged the latch as late.
    evidence : Evidence
        Witness of the latch.
    drive : Drive or None
        Latched drive, in the codes of the intended one, if it was observed in full.
    drive_crc : int or None
        CRC-32 of the latched drive (:meth:`Drive.digest`), if it was observed.
    reconstruction : Reconstruction or None
        Focus and field rebuilt from the radiated drive.
    radiated : Drive or None
        Radiated drive, if it was observed to differ from the latched one.
    t_received_us : int or None
        Device time at which the frame was complete at the board, if it was observed.

    Examples
    --------
    >>> with Driver(url, seed=1) as driver:
    ...     state = driver.arm()
    ...     intended = driver.focus((0.0, 0.0, 0.15))
    ...     driver.hold(0.01)
    ...     observed = driver.read_drive()
    >>> observed.drive == intended.drive, str(observed.evidence)
    (True, 'self-reported')
    """

    key: FrameKey
    t_latch_us: int
    late: bool
    evidence: Evidence
    drive: Drive | None = None
    drive_crc: int | None = None
    reconstruction: Reconstruction | None = None
    radiated: Drive | None = None
    t_received_us: int | None = None

    @property
    def output(self) -> Drive | None:
        """The drive that was radiated, as far as it was observed."""
        return self.radiated or self.drive

    def shows_by_crc(self, intended: Intended) -> bool | None:
        """Return True if the CRC is that of the intended drive, and False if it is of another.

        None: the drive itself was observed, or nothing of it, or the board computed it.
        """
        if self.drive is not None or self.drive_crc is None or intended.board_computed:
            return None
        return self.drive_crc == intended.drive.digest()


def check_intended(intended: Sequence[Intended]) -> None:
    """Refuse what is no sequence of :class:`Intended`, before anything is judged by it.

    Raises
    ------
    ConfigurationError
        Naming the first entry that is none.
    """
    check_argument_kind(
        "intended", intended, Sequence, "a sequence of Intended, such as Driver.intended"
    )
    for number, entry in enumerate(intended):
        if not isinstance(entry, Intended):
            check_argument_kind(
                f"intended[{number}]", entry, Intended, "an Intended, as of the driver"
            )
