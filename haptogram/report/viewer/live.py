"""The scene of a board that runs: the latches that came out of its back door."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Mapping
from itertools import islice
from typing import Any, Final

from haptogram.acoustics import Drive, NotSingle, Reconstruction, saturated_weights
from haptogram.errors import ConfigurationError, reads_as
from haptogram.evidence.backdoor import board_model_of_evidence, observation_of_record
from haptogram.evidence.dialects.latches import PulseObservation, pulse_observation_of
from haptogram.machine.terminal import printable_on_terminal
from haptogram.records.frame import Observation

from .frames import LATE, TIMELY, ViewerFrame, found_fields_of_viewer
from .scene import ViewerScene, other_axes_of_viewer

KEPT: Final = 10_000  # frames: 10 s at 1 kHz, some 20 MB
_OF_THE_WATCH: Final = frozenset({"wire_compared", "client_left"})  # events that are not counted
_LONGEST_NAME: Final = 80  # characters of the name of a board
_AT_ONCE: Final = 2_000  # frames in one answer: a megabyte


class LiveViewerScene:
    """Keeps the last frames that a board radiated; a page asks for what it has not drawn yet.

    Parameters
    ----------
    board : mapping
        The ``board`` record, the first one of a back door.
    kept : int
        Number of frames that are kept, the newest ones.

    Attributes
    ----------
    shown : int
        Number of frames so far.
    ended : bool
        Whether the board has ended.

    Raises
    ------
    ConfigurationError
        It is no such record.
    """

    def __init__(self, board: Mapping[str, Any], kept: int = KEPT) -> None:
        if board["kind"] != "board" or "firmware" not in board:
            raise ConfigurationError("the first record of a back door must be of the board")
        self.model = board_model_of_evidence(board)
        name = printable_on_terminal(str(board.get("dialect") or board["firmware"]))
        self.firmware = name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}…"
        self._channels = board.get("channels", ())
        self._client_axes = other_axes_of_viewer(board.get("client_axes"))
        self._has_states = "dialect" not in board  # those of other dialects have none
        self._remark = ""
        self.shown = 0
        self.ended = False
        self._frames: deque[ViewerFrame] = deque(maxlen=kept)
        self._counters: Counter[str] = Counter()
        self._state = ""

    def take(self, records: Iterable[Mapping[str, Any]]) -> None:
        """Take records as they come."""
        for record in records:
            with reads_as("a record"):
                self._take(record)

    def _take(self, record: Mapping[str, Any]) -> None:
        """Take a record of the board: show a latch, note an event or the end; ignore others."""
        if record["kind"] == "latch":
            self._latch(observation_of_record(record))
        elif record["kind"] == "pulses":
            self._pulses(pulse_observation_of(record, self._channels))
        elif record["kind"] == "output":
            self._output(record)
        elif record["kind"] == "end":
            self.ended = True
            self._counters["dropped by the back door"] += record["dropped"]

    def since(self, frames: int) -> bytes:
        """Return the scene of the frames after the first *frames*, the newest if they are many."""
        scene = self._newest(min(self.shown - frames, _AT_ONCE))
        header = {**scene.header, "shown": self.shown, "ended": self.ended}
        return ViewerScene(header, scene.columns).pack()

    def whole(self) -> ViewerScene:
        """Return the scene of all frames that are kept."""
        return self._newest(len(self._frames))

    @property
    def lead(self) -> list[str]:
        """Sentences that say what is shown."""
        dropped = self.shown - len(self._frames)
        last = f", the last of {self.shown}" if dropped else ""
        return [f"{self.model.array.count} transducers, {len(self._frames)} latches{last}."]

    def _newest(self, count: int) -> ViewerScene:
        """Return a scene of the newest *count* frames; of none if it is 0 or less."""
        newest = list(islice(reversed(self._frames), max(0, count)))[::-1]
        return ViewerScene.of(
            self.model, newest, counters=self._shown_counters(), client_axes=self._client_axes
        )

    def _latch(self, seen: Observation) -> None:
        """Show a latch of a board with the Haptogram wire, and count it if it was late."""
        self._counters["late"] += seen.late
        self._show(
            seen.output,
            seen.t_latch_us,
            seen.reconstruction,
            timing=LATE if seen.late else TIMELY,
            received_us=seen.t_received_us,
        )

    def _pulses(self, seen: PulseObservation) -> None:
        """Show a latch of a board of another dialect, and add what that board counted."""
        # As fine as a page draws; the verdict knows the pulses themselves.
        drive = Drive.from_weights(saturated_weights(seen.weights))
        self._counters += Counter(seen.counted)
        self._show(drive, seen.t_latch_us, seen.reconstruction)

    def _show(
        self,
        drive: Drive | None,
        t_latch_us: int,
        field: Reconstruction | None,
        *,
        timing: int = TIMELY,
        received_us: int | None = None,
    ) -> None:
        """Append a latch to the scene, and count it: latched, muted, no single focus.

        *drive* None: it is not known. *field* is what was found in it; *timing* says if it was
        late; *received_us* when the frame came (None: not known). ValueError for a drive of another
        number of elements than the array.
        """
        if drive is not None and drive.count != self.model.array.count:
            raise ValueError(f"{drive.count} codes, the array has {self.model.array.count}")
        self._frames.append(
            ViewerFrame(
                number=self.shown,
                timing=timing,
                latched_us=t_latch_us,
                received_us=received_us,
                drive=drive,
                **found_fields_of_viewer(field),
            )
        )
        self.shown += 1
        self._counters["latched"] += 1
        self._counters["muted"] += drive is not None and drive.is_muted
        self._counters["no single focus"] += isinstance(field, NotSingle)

    def _output(self, record: Mapping[str, Any]) -> None:
        """Take an event: an output state or remark is shown, others are counted."""
        if record["event"] == "state":
            self._state = f"{record['state']} ({record['reason']})"
        elif record["event"] == "remark":
            self._remark = printable_on_terminal(record["text"])
        elif record["event"] not in _OF_THE_WATCH:
            self._counters[record["event"].replace("_", " ")] += 1

    def _shown_counters(self) -> dict[str, Any]:
        """Return what the view lists: counters that are not 0, firmware, state and last remark.

        A board of another dialect has no state; without a remark there is none.
        """
        counted = {name: count for name, count in self._counters.items() if count}
        shown = counted | {"board": self.firmware}
        if self._has_states:
            shown["state"] = self._state or "as at power-up"
        return shown | ({"remark": self._remark} if self._remark else {})
