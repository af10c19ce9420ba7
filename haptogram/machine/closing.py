"""The base of what a ``with`` statement closes at its end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from haptogram.errors import HaptogramError


class ClosedByWith(ABC):
    """A resource that its ``with`` statement closes.

    An error in the block is the one that goes on; if closing fails as well, it gets a note of that.

    Examples
    --------
    >>> class Door(ClosedByWith):
    ...     def close(self):
    ...         print("closed")
    >>> with Door():
    ...     print("open")
    open
    closed
    """

    __slots__ = ()

    @abstractmethod
    def close(self) -> None:
        """Let go of the resource; more than once is no error."""

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
        except HaptogramError as unclosed:
            if error is None:
                raise
            error.add_note(str(unclosed))  # the first error is the one that tells more
