"""A record in bounded memory: the newest entries, and the number of all entries."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from typing import Any, Final, TypeVar, overload

from haptogram.settings.arguments import check_whole

_T = TypeVar("_T")

#: How many entries are kept unless the caller says otherwise: 200 s of frames at 1 kHz, 60 MB where
#: the frames repeat and 0.3 GB where each of 256 transducers is its own.
MOST_KEPT: Final = 200_000


_MOST_EVER: Final = 10**9  # entries that a caller can ask to be kept


def check_kept_records(keep: int | None) -> int | None:
    """Return a number of entries to keep, or raise unless it is None or 1 to 1e9."""
    return None if keep is None else check_whole("keep", keep, 1, _MOST_EVER)


class KeptRecords(Sequence[_T]):
    """The newest entries of a record; to be read like a list.

    Parameters
    ----------
    most : int or None
        Number of entries to keep; None: all.
    sink : callable, optional
        Called with every entry as it comes.

    Attributes
    ----------
    total : int
        Number of all entries so far.
    """

    def __init__(
        self, most: int | None = MOST_KEPT, sink: Callable[[_T], object] | None = None
    ) -> None:
        self.total = 0
        self._entries: deque[_T] = deque(maxlen=most)
        self._sink = sink

    @property
    def dropped(self) -> int:
        """Number of the oldest records, which are not kept any more."""
        return self.total - len(self._entries)

    def append(self, entry: _T) -> None:
        """Keep *entry*, hand it to the sink, and drop the oldest if there is no room."""
        self.total += 1
        self._entries.append(entry)
        if self._sink is not None:
            self._sink(entry)

    def extend(self, entries: Iterable[_T]) -> None:
        """Keep each of *entries*."""
        for entry in entries:
            self.append(entry)

    def since(self, number: int) -> Iterator[_T]:
        """Yield the kept entries that came after the first *number* entries."""
        return islice(self._entries, max(0, number - self.dropped), None)

    def clear(self) -> None:
        """Drop all entries; they count as dropped."""
        self._entries.clear()

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[_T]:
        return iter(self._entries)

    @overload
    def __getitem__(self, place: int) -> _T: ...
    @overload
    def __getitem__(self, place: slice) -> list[_T]: ...
    def __getitem__(self, place: int | slice) -> _T | list[_T]:
        if isinstance(place, slice):
            return list(self._entries)[place]
        return self._entries[place]

    def __eq__(self, other: Any) -> bool:
        return list(self) == list(other) if isinstance(other, Sequence) else NotImplemented

    __hash__ = None  # type: ignore[assignment]  # it changes

    def __repr__(self) -> str:
        return f"<{len(self)} of {self.total} entries>"


def only_kept_records(entries: Sequence[_T], wanted: Callable[[_T], bool]) -> Sequence[_T]:
    """Return the *entries* that are *wanted*; a :class:`KeptRecords` keeps its count."""
    if not isinstance(entries, KeptRecords):
        return [entry for entry in entries if wanted(entry)]
    some: KeptRecords[_T] = KeptRecords(None)
    some.extend(entry for entry in entries if wanted(entry))
    some.total += entries.dropped
    return some
