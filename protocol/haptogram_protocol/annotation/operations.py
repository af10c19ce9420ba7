"""The wire of another board, cut into operations, each with its place in the stream."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Final

from ..dialects.codec import Dialect, Operation, Reply
from .frames import Annotated, annotated_fields_of

_MOST_SILENT: Final = 65_536  # bytes without an operation that are reported as one piece
_SHOWN: Final = 8  # items of a sequence in one line


class OperationAnnotator:
    """Annotates what one end of a line sends, in the dialect of another board.

    A byte that completes two operations is the second one: the codes before a command end with
    the byte in front of the command.

    Parameters
    ----------
    dialect : Dialect
        The wire.
    from_board : bool
        Whether the bytes are those of the board; by default they are the host's.
    options : mapping, optional
        Options of the dialect's end.
    """

    def __init__(
        self,
        dialect: Dialect,
        *,
        from_board: bool = False,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        make = dialect.host if from_board else dialect.board
        self._end = make(**(options or {}))
        self._counted: Counter[str] = Counter()
        self._begin = 0  # offset of the first byte that no operation has taken
        self._size = 0  # bytes since then

    def feed(self, chunk: bytes) -> Iterator[Annotated]:
        """Yield a piece for every operation that *chunk* completes."""
        for byte in chunk:
            self._size += 1
            found = self._end.receive_data(bytes((byte,)))
            if found:
                yield from self._take(found)
            elif self._size >= _MOST_SILENT:
                yield from self.end()

    def end(self) -> Iterator[Annotated]:
        """Yield the bytes that no operation has taken, if there are any."""
        if self._size:
            fault = self._new_errors_text() or "the operation has not ended"
            text = f"no operation: {fault}"
            size = self._size
            yield Annotated(self._advance(size), size, "", text, fault)

    def _take(self, found: list[Operation] | list[Reply]) -> Iterator[Annotated]:
        """Yield the annotation of each operation or reply; the first one names the new errors.

        The piece's bytes are shared out: one for each operation but the first, which has the rest;
        none for the last ones if they do not suffice.
        """
        behind = min(len(found) - 1, self._size - 1)
        sizes = [self._size - behind] + [1] * behind + [0] * (len(found) - 1 - behind)
        fault = self._new_errors_text()
        for operation, size in zip(found, sizes, strict=True):
            name, fields = type(operation).__name__, annotated_fields_of(operation)
            inner = ", ".join(_inner_operation_names(operation))
            text = f"{name}{f' of {inner}:' if inner else ''}{_fields_text(fields)}" + (
                f": {fault}" if fault else ""
            )
            yield Annotated(self._advance(size), size, name, text, fault, fields)
            fault = ""

    def _advance(self, size: int) -> int:
        """Return the offset at which an annotation of *size* bytes begins; advance by *size*."""
        begin = self._begin
        self._begin += size
        self._size -= size
        return begin

    def _new_errors_text(self) -> str:
        """Return as text the errors counted since the last call, '' if there are none."""
        counters = self._end.counters
        if counters == self._counted:
            return ""
        new = counters - self._counted
        self._counted = Counter(counters)
        return ", ".join(f"{kind} {count}" for kind, count in new.items())


def _inner_operation_names(value: Any) -> Iterator[str]:
    """Yield the names of operations nested in a message, such as those for devices."""
    for field in dataclasses.fields(value):
        parts = getattr(value, field.name)
        for part in parts if isinstance(parts, tuple | list) else ():
            if isinstance(part, Operation):
                yield type(part).__name__
            elif dataclasses.is_dataclass(part):
                yield from _inner_operation_names(part)


def _fields_text(fields: Mapping[str, Any]) -> str:
    """Return the fields in one line, such as " first 0, codes 16"; '' if there are none."""
    words = [f"{name} {_value_text(value)}" for name, value in fields.items()]
    return f" {', '.join(words)}" if words else ""


def _value_text(value: Any) -> str:
    """Return a value as text; of lists the first 8 items, of hex text the first 8 bytes."""
    if isinstance(value, str) and len(value) > 2 * _SHOWN:
        return f"{value[: 2 * _SHOWN]}... ({len(value) // 2} bytes)"
    if isinstance(value, list):
        items = ", ".join(map(_value_text, value[:_SHOWN]))
        return f"[{items}{', ...' if len(value) > _SHOWN else ''}]"
    if isinstance(value, dict):
        kind = value.get("is", "")
        return f"{kind}{_fields_text({n: v for n, v in value.items() if n != 'is'})}"
    return str(value)
