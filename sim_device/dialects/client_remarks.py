"""Remarks about a client: the wire that it speaks, the size of its frames, a frame that stops.

A remark is a line for a user. What a frame lacks is told as it was counted, and only after the
bytes were compared with the other wires; a cause is named only if chance would hardly look alike.
"""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from haptogram.records.remark import About
from haptogram_protocol.dialects.codec import Dialect
from haptogram_protocol.dialects.looks_like import LOOKED_AT_BYTES, looks_like_dialect

from ..board.events import ClientLeft, Notice, Remark, WireCompared

_ALIKE: Final = 3  # frames of one size that prove another array
_FEW_LOST: Final = 2  # most bytes that an unfinished frame lost on the line
_FEW: Final = 16  # a frame that lost or gained one in so many bytes is one of this board's

# For what a codec counts: what it is, and what it shows if frame after frame is alike.
_CLUES: Final = {
    "frames_short": ("a frame ends before the last channel", "a smaller array"),
    "codes_beyond_array": ("a frame has more codes than the board has channels", "a larger array"),
    "codes_out_of_range": ("codes beyond those of this board", "more steps in a period"),
    "bytes_beyond_chain": ("bytes for a board that is not there", "a longer chain"),
    "frames_without_commit": (
        "a frame came before the one ahead of it was shown: its commit is missing",
        None,
    ),
    "frames_without_start": (
        "a frame has no start (FEh): its codes are right only because a swap (FDh) came before",
        None,
    ),
    "durations_without_commit": (
        "durations came without their commit (10h): those before them still act",
        None,
    ),
    "codes_unheard": (
        "codes came while no board listened: the client has selected one that is not there",
        None,
    ),
    "refused_not_supported_tag": (
        "the devices have refused an operation (error 1, not supported tag): GainSTM, ForceFan, "
        "PulseWidthEncoder, PhaseCorrection, OutputMask and GPIO are not emulated; for GainSTM "
        "send its gains one by one, or foci as FociSTM",
        None,
    ),
    "bytes_outside_frame": ("bytes came outside a frame: none of them starts one (bit 7)", None),
}
_OF_WHOLE_FRAMES: Final = "codes_out_of_range"
_AT_ONCE: Final = frozenset(
    {"codes_unheard", "bytes_outside_frame", "refused_not_supported_tag"}
)  # latched or not
_REFUSED: Final = frozenset({"refused_not_supported_tag"})
_TEXT: Final = re.compile(rb"([ -~]+[\r\n]+)+[ -~]*")
_NO_FRAMES: Final = frozenset({_OF_WHOLE_FRAMES, "bytes_strange", "bytes_beyond_chain"})


@dataclasses.dataclass(frozen=True, slots=True)
class UnshownToClient:
    """Frames and bytes of a client since the last latch, which show nothing yet.

    Attributes
    ----------
    unfinished : int
        Bytes of a frame that has begun and is not whole.
    whole : int
        Frames that are whole and wait for a command that shows them.
    commit : str
        That command in words; empty for boards that show frames by themselves.
    kinds : collection of str
        Kinds of errors that were counted meanwhile.
    """

    unfinished: int
    whole: int = 0
    commit: str = ""
    kinds: Collection[str] = ()

    @property
    def is_something(self) -> bool:
        """True if the client has begun a frame that is not shown."""
        return bool(self.unfinished or self.whole)

    @property
    def is_without_commit(self) -> bool:
        """True if frames follow each other, and none is shown."""
        return self.whole > 1 and not self.unfinished and not _NO_FRAMES.intersection(self.kinds)


class ClientRemarks:
    """Looks at what one client after the other sends.

    Parameters
    ----------
    dialect : Dialect
        The wire of the board.
    frame_bytes : sequence of int
        Bytes of a frame for each number of boards that may be on the line.
    notices : list of Notice
        Takes the remarks, in order.
    counters : Counter
        Counts ``frames_unfinished`` and ``other_wires``.
    """

    def __init__(
        self,
        dialect: Dialect,
        frame_bytes: Sequence[int],
        notices: list[Notice],
        counters: Counter[str],
    ) -> None:
        self._dialect = dialect
        self._sizes = tuple(frame_bytes)
        self._notices, self._counters = notices, counters
        self._is_stopped = False  # the frames up to the next whole one follow from a part of one
        self._forget()

    def _forget(self) -> None:
        """Reset all that is known of the client, as for a new connection."""
        self._first_bytes = bytearray()
        self._paused = 0  # bytes of a frame before a pause in its middle
        self._is_own = self._is_other = self._came = False
        self._told_own: bool | None = None
        self._said: set[tuple[str, bool]] = set()
        self._strange: dict[str, int] = {}  # kinds that are not reported yet: size of a frame
        self._frames: list[tuple[int, frozenset[str]]] = []

    @property
    def waits(self) -> bool:
        """True if the next silence may tell more."""
        return bool(self._first_bytes) and not self._is_own and not self._is_other

    def pause(self, unfinished: int) -> None:
        """Remember a pause after *unfinished* bytes of a frame: it may never go on.

        One that lacks a byte or two has rather lost them on the line.
        """
        is_nearly_whole = any(0 <= size - unfinished <= _FEW_LOST for size in self._sizes)
        if unfinished and not self._is_stopped and not is_nearly_whole:
            self._paused = unfinished

    def counted(self, kinds: Collection[str], t_us: int) -> None:
        """Learn that *kinds* were counted of a latch: a frame that paused has not gone on."""
        for kind in _REFUSED.intersection(kinds):
            self._strange.setdefault(kind, 0)
        if self._paused:
            self._stop(self._paused, t_us)

    def frame(self, size: int, counted: Mapping[str, int]) -> None:
        """Take down a frame of *size* bytes that the boards have latched."""
        kinds = frozenset(counted)
        if kinds:
            if self._is_stopped:
                return
        elif self._is_of_another_size(size):
            return  # a command of its own
        else:
            self._is_own, self._is_stopped, self._paused = True, False, 0
        if len(self._frames) < _ALIKE:
            self._frames.append((size, kinds))
        told = kinds - {"frames_without_start"} if "codes_unheard" in kinds else kinds
        for kind in filter(told.__contains__, _CLUES):  # an unheard start came all the same
            self._strange.setdefault(kind, size)

    def take(self, data: bytes, unshown: UnshownToClient, t_us: int) -> None:
        """Look at bytes whose frames have been taken down."""
        if not data:
            return
        self._came = True
        if self._is_own:
            self._report_wire(t_us)
        self._first_bytes += data[: LOOKED_AT_BYTES - len(self._first_bytes)]
        if len(self._first_bytes) == LOOKED_AT_BYTES:
            self._compare(unshown, t_us)
            self._remark_missing_commits(unshown, t_us)
            self._remark_foreign_frames(t_us)

    def silent(self, unshown: UnshownToClient, t_us: int) -> None:
        """Look at what came before a silence."""
        self._compare(unshown, t_us)
        if unshown.unfinished:
            self._stop(unshown.unfinished, t_us)
        self._remark_missing_commits(unshown, t_us)
        if unshown.whole == 1 and not unshown.unfinished:
            text = f"a whole frame waits for its commit ({unshown.commit}), which shows it"
            self._say_once("waits", About.CLIENT, text, t_us)
        if not self._is_stopped:
            for kind in filter(_AT_ONCE.__contains__, unshown.kinds):
                self._strange.setdefault(kind, 0)
        self._remark_foreign_frames(t_us)

    def left(self, unshown: UnshownToClient, t_us: int) -> None:
        """Judge all bytes of the client that has left, and start over with the next one."""
        if self._came:
            waits = unshown.whole > 0 and not unshown.unfinished
            is_one = waits and unshown.whole == 1
            self.silent(dataclasses.replace(unshown, whole=0) if is_one else unshown, t_us)
            if waits:
                self._is_stopped = True
                if not self._is_other:
                    self._counters["frames_unfinished"] += 1
                text = f"the client left before the commit ({unshown.commit}) of a whole frame"
                self._say_once("left", About.STOPPED, text, t_us)
            self._notices.append(ClientLeft(t_us))
        self._forget()

    def _stop(self, unfinished: int, t_us: int) -> None:
        """Count and remark a frame that stopped after *unfinished* bytes.

        Neither if the client speaks another wire.
        """
        self._is_stopped, self._paused = True, 0
        if not self._is_other:
            self._counters["frames_unfinished"] += 1
            came = "1 byte came" if unfinished == 1 else f"{unfinished} bytes came"
            whole = f"; a frame has {self._sizes_text}" if self._dialect.bauds else ""
            self._remark(About.STOPPED, f"a frame stops in its middle: {came}{whole}", t_us)

    @property
    def _sizes_text(self) -> str:
        """Return the sizes that a frame of this wire can have, as text."""
        return " or ".join(map(str, self._sizes))

    def _remark_missing_commits(self, unshown: UnshownToClient, t_us: int) -> None:
        """Remark once if frames follow each other without the command that shows one."""
        if unshown.is_without_commit:
            text = f"frames follow each other without a commit ({unshown.commit}), which shows one"
            self._say_once("commits", About.NO_COMMIT, text, t_us)

    def _say_once(self, what: str, about: About, text: str, t_us: int) -> None:
        """Append a remark of the kind *what* once per client; none if it speaks another wire.

        *about* is its topic, *text* what it says.
        """
        if not self._is_other and (what, True) not in self._said:
            self._said.add((what, True))
            self._remark(about, text, t_us)

    def _report_wire(self, t_us: int) -> None:
        """Note if the client speaks this wire: once, and again when it turns out to."""
        if self._told_own is None or self._told_own < self._is_own:
            self._told_own = self._is_own
            self._notices.append(WireCompared(t_us, is_own=self._is_own))

    def _compare(self, unshown: UnshownToClient, t_us: int) -> None:
        """Decide by the first bytes if the client speaks this wire; remark if another one, or text.

        *unshown* is what has not been latched: if it is whole frames without a commit and no other
        wire is recognised, it is this wire.
        """
        if self._is_own or self._is_other or not self._first_bytes:
            return
        names = looks_like_dialect(bytes(self._first_bytes))
        self._is_own = self._dialect.name in names or (not names and unshown.is_without_commit)
        self._is_other = bool(names) and not self._is_own
        if self._is_other:
            self._remark_other_wire(
                f"these bytes look like {' or '.join(names)}, not {self._dialect.name}: "
                "choose the dialect that the client speaks",
                t_us,
            )
        elif not self._is_own and _TEXT.fullmatch(self._first_bytes):
            self._remark_other_wire(
                f"these bytes are lines of text, not {self._dialect.name}: the board takes frames, "
                "and no commands of a controller in front of it",
                t_us,
            )
        else:
            if not self._is_own and self._are_finer_frames():
                self._is_own = True
                fact, cause = _CLUES[_OF_WHOLE_FRAMES]
                self._remark(About.OTHER_ARRAY, f"{fact}: the client has {cause}", t_us)
            self._report_wire(t_us)

    def _remark_other_wire(self, text: str, t_us: int) -> None:
        """Remark, count and note for good that the client speaks another wire."""
        self._is_other = True
        self._counters["other_wires"] += 1
        self._remark(About.OTHER_WIRE, text, t_us)

    def _are_finer_frames(self) -> bool:
        """Return True if the bytes look like frames of this wire by a client with more phase steps.

        Cut at one of the wire's frame sizes they are 3 or more pieces that begin alike and end
        alike, and the first one holds more different bytes than a 16th of its size.
        """
        data = bytes(self._first_bytes)
        for size in self._sizes:
            frames = [data[at : at + size] for at in range(0, len(data) - size + 1, size)]
            ends = {(frame[0], frame[-1]) for frame in frames}
            if len(frames) >= _ALIKE and len(ends) == 1 and len(set(frames[0])) > size // _FEW:
                return True
        return False

    def _remark_foreign_frames(self, t_us: int) -> None:
        """Report once per client which foreign frame formats were seen."""
        strange, self._strange = self._strange, {}
        if self._is_other:
            return
        proven = self._proven()
        for kind in [*strange, *([] if proven is None else [proven])]:
            fact, cause = _CLUES[kind]
            size = strange[kind] if kind in strange else self._frames[0][0]
            is_proven = kind == proven
            if (kind, True) in self._said or (kind, is_proven) in self._said:
                continue
            self._said.add((kind, is_proven))
            is_of_another_size = cause is not None and self._is_of_another_size(size)
            if is_of_another_size:
                fact += f" ({size} bytes; a frame has {self._sizes_text})"
            about = About.CLIENT
            if is_proven and cause:
                fact, about = f"{fact}: the client has {cause}", About.OTHER_ARRAY
            elif is_of_another_size:
                about = About.OTHER_SIZE
            self._remark(about, fact, t_us)

    def _proven(self) -> str | None:
        """Return the kind of error that shows that the client drives another array; None if unsure.

        The last frames, at least 3, all have this kind alone and one size, and it suits the kind.
        """
        if len(self._frames) < _ALIKE or len(set(self._frames)) > 1:
            return None
        size, kinds = self._frames[0]
        if len(kinds) != 1 or not kinds <= _CLUES.keys():
            return None
        (kind,) = kinds
        is_whole = size in self._sizes
        fits = is_whole if kind == _OF_WHOLE_FRAMES else self._is_of_another_size(size)
        return kind if fits else None

    def _is_of_another_size(self, size: int) -> bool:
        """Return True if a frame's size differs by over a 16th from each size of this wire."""
        return all(_FEW * abs(size - whole) > whole for whole in self._sizes)

    def _remark(self, about: About, text: str, t_us: int) -> None:
        """Append a remark about the client."""
        self._notices.append(Remark(t_us, text, about))
