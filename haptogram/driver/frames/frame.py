"""One frame, ready but for its number and its time, and the checks that it fits a board."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, Literal, TypeAlias, TypeGuard, TypeVar

from haptogram.acoustics import AcousticModel, Drive
from haptogram.acoustics.model.drive import FULL_AMPLITUDE
from haptogram.acoustics.solvers.several import Method
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Focus, FrameKey, Intended
from haptogram.settings.arguments import shown_argument
from haptogram.settings.frozen import dataclass
from haptogram_protocol.messages import Drives, Feature, FocalPoint, HelloReply, Phases, Points

_F = TypeVar("_F")
Mode: TypeAlias = Literal["phases", "drives", "points"]

REGISTER_BITS: Final = 8  # resolution of a board's phase registers
MODE_OF: Final[Mapping[type, Mode]] = {Phases: "phases", Drives: "drives", Points: "points"}
NEEDED_FEATURE: Final = {"drives": Feature.AMPLITUDE, "points": Feature.POINTS}


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame, ready but for its number and its time.

    Attributes
    ----------
    foci : tuple of Focus
        Focal points of the frame; as the wire rounds them where the board computes the drive.
    drive : Drive
        Drive that is expected in the registers.
    message : Phases, Drives or Points
        Message that is sent.
    geometry_hash : int
        Digest of the array that it was made for.
    solver : str
        Method that made the drive.
    sound_speed_mm_s : int or None
        Speed of sound that a board must assume to compute the drive; None: the host did.
    """

    foci: tuple[Focus, ...]
    drive: Drive
    message: Phases | Drives | Points
    geometry_hash: int
    solver: Method = "naive"
    sound_speed_mm_s: int | None = None

    @property
    def mode(self) -> Mode:
        """Kind of its message: ``phases``, ``drives`` or ``points``."""
        return MODE_OF[type(self.message)]

    def computing_us(self, identity: HelloReply) -> int:
        """Return the time that the board needs to compute the drive."""
        points = len(self.message.points) if isinstance(self.message, Points) else 0
        return points * identity.point_time_us

    def ready_after_us(self, identity: HelloReply) -> int:
        """Return the time from the arrival at the board until it can be latched.  HG-5.7."""
        return identity.latch_lead_us + self.computing_us(identity)

    @property
    def board_computed(self) -> bool:
        """True if the board computes the drive."""
        return isinstance(self.message, Points)

    @property
    def payload_bytes(self) -> int:
        """Length of the payload."""
        if isinstance(self.message, Points):
            return len(self.message.points) * FocalPoint.LAYOUT.size
        return len(self.message.data)

    def intended(
        self,
        number: int,
        key: FrameKey,
        t_apply_us: int | None,
        *,
        t_latest_us: int | None = None,
        t_sent_us: int | None = None,
    ) -> Intended:
        """Return the record that it is to be latched."""
        return Intended(
            number,
            key,
            t_apply_us,
            self.foci,
            self.drive,
            REGISTER_BITS,
            self.board_computed,
            self.solver,
            None,
            t_latest_us,
            t_sent_us,
        )


def are_driver_frames(targets: object, kind: type[_F]) -> TypeGuard[Sequence[_F]]:
    """Return True if *targets* are frames of this *kind* already.

    Raises
    ------
    ConfigurationError
        If some are and some are not.
    """
    if not isinstance(targets, Sequence) or isinstance(targets, str | bytes):
        return False
    ready = sum(isinstance(target, kind) for target in targets)
    if 0 < ready < len(targets):
        raise ConfigurationError(
            f"{ready} of {len(targets)} targets are frames; all must be, or none"
        )
    return ready > 0


def check_frame_request(frames: Sequence[Frame], mode: Mode | None, solver: Method | None) -> None:
    """Refuse a mode or a solver that is not the one by which *frames* were made.

    Raises
    ------
    ConfigurationError
        Naming both.
    """
    for name, asked in (("mode", mode), ("solver", solver)):
        made = {getattr(frame, name) for frame in frames}
        if asked is not None and made != {asked}:
            raise ConfigurationError(
                f"{name} is {shown_argument(asked)}; "
                f"the frames were made with {', '.join(sorted(made))}: "
                f"leave {name} out"
            )


def check_frames_to_send(
    frames: Sequence[Frame], model: AcousticModel, identity: HelloReply
) -> None:
    """Refuse frames that were made for another board or array.

    Raises
    ------
    ConfigurationError
        Naming the frame.
    """
    geometry_hash = model.array.digest()
    for number, frame in enumerate(frames):
        if frame.geometry_hash != geometry_hash or not _is_supported(frame, identity):
            raise ConfigurationError(
                f"frame {number} was made for another board or array; make it anew with frames()"
            )
    speeds = sorted({f.sound_speed_mm_s for f in frames if f.sound_speed_mm_s is not None})
    if len(speeds) > 1:
        raise ConfigurationError(
            f"frames of points for speeds of sound of {speeds[0] / 1000:g} and "
            f"{speeds[-1] / 1000:g} m/s; a board has one: make them anew with frames()"
        )


def _is_supported(frame: Frame, identity: HelloReply) -> bool:
    """Return True if the board supports the frame's mode, number of foci and amplitudes."""
    if frame.mode in NEEDED_FEATURE and not identity.features & NEEDED_FEATURE[frame.mode]:
        return False
    if not isinstance(frame.message, Points):
        return True
    is_full = frame.drive.amplitude_codes.min() == FULL_AMPLITUDE
    fits = len(frame.message.points) <= identity.max_points
    return fits and bool(is_full or identity.features & Feature.AMPLITUDE)
