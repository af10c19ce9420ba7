"""A virtual board for the test of a driver that is not ours: it judges what the driver sent.

The driver says nothing of what it means, so the test does: the foci that are expected, in order.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from numpy.typing import ArrayLike

from haptogram.acoustics import AcousticModel
from haptogram.acoustics.arrays import FloatArray
from haptogram.errors import ConfigurationError, VerificationError
from haptogram.evidence.backdoor import why_observations_incomplete
from haptogram.evidence.dialects.watched_board import WatchedBoard
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.machine.closing import ClosedByWith
from haptogram.settings.arguments import check_whole
from haptogram.verification import Tolerance, Verdict
from haptogram.verification.watch import Expectation, Watch
from haptogram.verification.watch.result import WatchResult

_QUIET_S: Final = 0.3  # time without a new record after which the driver is done
_LONGEST_S: Final = 10.0
_POLL_S: Final = 0.05
_MOST_ROUNDS: Final = 10**9
_SHOWN: Final = 5  # frames of a kind that are named
_VIRTUAL_TIME: Final = (
    "time      is virtual: it passes while the driver reads its port or calls time.sleep; a driver "
    'with threads or a clock of its own needs @pytest.mark.haptogram_board(clock="wall")'
)


class VerifiedBoard(ClosedByWith):
    """A virtual board, and the foci that a test expects on it.

    Parameters
    ----------
    **options : object
        Options of :class:`~haptogram.evidence.virtual_board.VirtualBoard`: ``array``, ``pitch_mm``,
        ``temperature_c``, ``seed``, ``dialect``, ``clock``, ...

    Attributes
    ----------
    port : str
        Port for the driver under test: in virtual time a URL of pyserial, else the path of a
        pseudo-terminal.
    is_virtual : bool
        Whether its time is virtual: then it passes while the driver waits for bytes.
    model : AcousticModel
        Array and air of the board.

    Examples
    --------
    >>> with VerifiedBoard(array="8x8") as board:
    ...     with Driver(board.port, seed=1) as driver:
    ...         state = driver.arm()
    ...         report = driver.stream([(0.0, 0.0, 0.1), (0.01, 0.0, 0.1)], rate_hz=100)
    ...     board.expect([(0.0, 0.0, 0.1), (0.01, 0.0, 0.1)])
    ...     board.check()
    """

    def __init__(self, **options: Any) -> None:
        self._board = VirtualBoard(**({"reconstruct": False} | options))
        self.is_virtual = self._board.is_virtual
        self._frames_m: list[FloatArray] = []
        self._tolerance = Tolerance()
        self._rounds: int | None = None
        self._most_late = 0
        self._may_stay_armed = False
        self._problems: list[str] | None = None

    @property
    def port(self) -> str:
        """Name of the port that the driver under test opens."""
        return self._board.url

    def sleep(self, seconds: float) -> None:
        """Let time pass on the clock of the board."""
        self._board.sleep(seconds)

    @property
    def model(self) -> AcousticModel:
        """Array and air of the board."""
        return self._board.model

    def expect(
        self,
        frames_m: Sequence[ArrayLike],
        *,
        rounds: int | None = None,
        tolerance_mm: float = 0.0,
        most_late: int = 0,
        may_stay_armed: bool = False,
    ) -> None:
        """Say which foci the driver is to show, frame after frame.

        Parameters
        ----------
        frames_m : sequence of (3,) or (F, 3) array_like
            Focus or foci of each frame, in metres from the array's centre, in the axes of the
            board's own clients.
        rounds : int, optional
            How often all of them are shown; by default any whole number of times, at least once.
        tolerance_mm : float
            Misses that pass on top of those of rounding of the phases.
        most_late : int
            Frames that may be latched late.
        may_stay_armed : bool
            Whether the driver may leave the output on.

        Raises
        ------
        ConfigurationError
            A point that is no place, or an argument out of its limits.
        """
        if rounds is not None:
            check_whole("rounds", rounds, 1, _MOST_ROUNDS)
        check_whole("most_late", most_late, 0, _MOST_ROUNDS)
        self._tolerance = Tolerance(miss_mm=tolerance_mm)
        checked = Expectation(self.model, frames_m, tolerance=self._tolerance)
        self._frames_m = list(checked.frames)
        self._rounds, self._most_late = rounds, most_late
        self._may_stay_armed = may_stay_armed

    def check(self) -> None:
        """End the board and judge what the driver sent; the second time the result is known.

        Raises
        ------
        VerificationError
            If something was not as expected; the text says what.
        ConfigurationError
            If nothing was expected.
        """
        if self._problems is None:
            self._problems = list(self._judge())
        if self._problems:
            raise VerificationError("\n".join(self._problems))

    def close(self) -> None:
        """End the board and remove what it left behind."""
        self._board.close()

    # --- verdict -------------------------------------------------------------------------------

    def _judge(self) -> Iterator[str]:
        """Yield the verdict and each problem as lines; nothing if there is no problem.

        Refuses a test that did not say which foci it expects.
        """
        if not self._frames_m:
            raise ConfigurationError(
                "verified_board: the test did not say which foci it expects: call "
                "verified_board.expect([(x, y, z), ...]), in metres"
            )
        records = self._records()
        result, frames = self._watched(records)
        problems = [
            *_verified_focus_problems(result, len(self._frames_m), frames, self._rounds),
            *_verified_late_problems(records, self._most_late),
            *_verified_lost_problems(records),
        ]
        if not self._may_stay_armed:
            problems += _verified_armed_problems(records)
        if problems:
            head = str(result).replace(result.verdict.upper(), Verdict.FAIL.upper(), 1)
            yield f"verified_board: {head}"
            yield from (f"  {problem}" for problem in problems)
            if self.is_virtual:
                yield f"  {_VIRTUAL_TIME}"

    def _records(self) -> list[dict[str, Any]]:
        """Wait for 0.3 s without a new record (10 s at most), stop the board, return them all."""
        waited_s = quiet_s = 0.0
        count = len(self._board.records())
        while waited_s < min(_LONGEST_S, quiet_s + _QUIET_S):
            self._board.sleep(_POLL_S)
            waited_s += _POLL_S
            if len(self._board.records()) > count:
                count, quiet_s = len(self._board.records()), waited_s
        self._board.finish()
        return self._board.records()

    def _watched(self, records: Sequence[Mapping[str, Any]]) -> tuple[WatchResult, int]:
        """Return the verdict on all latches against the expected foci, and how many were judged."""
        board = WatchedBoard(records[0])
        frames_m = [board.ours_m(frame) for frame in self._frames_m]
        expected = Expectation(board.model, frames_m, tolerance=self._tolerance)
        watch = Watch(board.model, channels=board.channels, expectation=expected)
        frames = 0
        for record in records:
            latch = board.latch(record)
            if latch is not None:
                frames += watch.take(latch).verdict is not None
        return watch.result(why_observations_incomplete(records)), frames


def _verified_focus_problems(
    result: WatchResult, count: int, frames: int, rounds: int | None
) -> Iterator[str]:
    """Yield a line for foci off target, and one if not *rounds* x *count* frames latched.

    None for *rounds*: any whole number of times *count*, but 0, is right.
    """
    if result.verdict is not Verdict.PASS:
        yield "foci      not all are where they were expected"
    if rounds is not None and frames != rounds * count:
        yield f"frames    {frames} were latched, {rounds} x {count} were expected"
    elif rounds is None and (frames % count or not frames):
        yield f"frames    {frames} were latched, a whole number of times {count} was expected"


def _verified_late_problems(records: Sequence[Mapping[str, Any]], most: int) -> Iterator[str]:
    """Yield a line if more than *most* frames were latched late, with their indices."""
    late = [record["index"] for record in records if record["kind"] == "latch" and record["late"]]
    if len(late) > most:
        yield f"late      {len(late)} frames were latched late: {_indices_text(late)}"


def _verified_lost_problems(records: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a line on stream frames that are missing between two that latched; else nothing."""
    last: dict[int, int] = {}
    lost: list[int] = []
    for record in records:
        if record["kind"] == "latch" and record["sequence"] == 0:
            session, index = record["session"], record["index"]
            lost += range(last.get(session, index) + 1, index)
            last[session] = index
    if lost:
        named = _indices_text(lost)
        yield f"lost      {len(lost)} frames of the stream were never latched: {named}"


def _verified_armed_problems(records: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a line if the output was on before power-down, or the board muted it by itself."""
    states: list[Mapping[str, Any]] = []
    for record in records:
        if record.get("event") == "power_down":
            break
        if record.get("event") == "state":
            states.append(record)
    if not states:
        return
    last = states[-1]
    if last["state"] == "ARMED":
        yield "output    was left on: the driver did not mute the board at its end"
    elif not last["requested"]:
        yield f"output    was muted by the board itself ({last['reason']}), not by the driver"


def _indices_text(indices: Sequence[int]) -> str:
    """Return the first 5 indices as text, and how many more there are."""
    more = f" and {len(indices) - _SHOWN} more" if len(indices) > _SHOWN else ""
    return f"index {', '.join(map(str, indices[:_SHOWN]))}{more}"
