"""Ends of a case: a check that fails, or one of the other verdicts; and differences in words."""

from __future__ import annotations

import contextlib
import enum
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from itertools import zip_longest
from typing import Final, NoReturn

from haptogram.errors import HaptogramError
from haptogram.records.frame import Evidence
from haptogram_protocol import messages as m

from .verdict import Behaviour

#: Evidence, by the names that cases use.
WIRE: Final = Evidence.WIRE
SELF_REPORTED: Final = Evidence.SELF_REPORTED
EXTERNAL: Final = Evidence.EXTERNAL

_SHOWN: Final = 4  # fields or elements of two values that are named
_WHOLE: Final = 6  # values of a sequence that is shown in full
_HALVES: Final = 2  # parts of a drive: phases, amplitudes
_MISSING: Final = object()
_FORMS: Final = ("", "#x", "#04x", "#06x", "#010x", "016x", "+d")  # formats of a number in messages


@dataclass(slots=True)
class RuleFindings:
    """Findings of the rules that hold in every frame of a run.

    Attributes
    ----------
    judged : set of str
        Clauses that a frame was judged by.
    broken : dict of str to str
        The first finding against each clause, in words.
    """

    judged: set[str] = field(default_factory=set)
    broken: dict[str, str] = field(default_factory=dict)


class CaseEndedError(HaptogramError):
    """Ends a case with a verdict other than OK."""

    def __init__(self, behaviour: Behaviour, text: str) -> None:
        super().__init__(text)
        self.behaviour = behaviour


class HeldUpError(CaseEndedError):
    """Ends a case as INCONCLUSIVE: something on the way held it up, and nothing is judged."""

    def __init__(self, text: str) -> None:
        super().__init__(
            Behaviour.INCONCLUSIVE, f"the host, its line or an emulator was held up: {text}"
        )


def check(holds: bool, text: str) -> None:
    """End the case as FAILED unless *holds*."""
    if not holds:
        fail(text)


def check_equal(got: object, due: object, text: str) -> None:
    """End the case as FAILED unless *got* is *due*; *text* begins the finding."""
    if got == due:
        return
    for form in _FORMS if isinstance(got, int) and type(got) is type(due) else ("",):
        shown = format(got, form) if form else _value_text(got)
        if _is_plain(got) and re.search(rf"(?<![\w.]){re.escape(shown)}(?![\w.])", text):
            fail(f"{text}; due is {format(due, form) if form else _value_text(due)}")
    fail(f"{text}: {record_differences(got, due)}")


def check_fields(record: object, text: str, **due: object) -> None:
    """End the case as FAILED unless the fields of *record* that are named have these values."""
    got = {name: getattr(record, name) for name in due}
    if got != due:
        fail(f"{text}: {record_differences(got, due)}")


def fail(text: str) -> NoReturn:
    """End the case as FAILED: the board does not meet the clause."""
    raise CaseEndedError(Behaviour.FAILED, text)


@contextlib.contextmanager
def named(text: str) -> Iterator[None]:
    """Put *text* before the words of a verdict that ends the case meanwhile."""
    try:
        yield
    except CaseEndedError as error:
        raise CaseEndedError(error.behaviour, f"{text}: {error}") from None


def inconclusive(text: str) -> NoReturn:
    """End the case as INCONCLUSIVE: the observations decide nothing."""
    raise CaseEndedError(Behaviour.INCONCLUSIVE, text)


def not_observed(text: str) -> NoReturn:
    """End the case as NOT-OBSERVED: this board or this line cannot show the behaviour."""
    raise CaseEndedError(Behaviour.NOT_OBSERVED, text)


def require(holds: bool, why_not: str) -> None:
    """End the case as NOT-OBSERVED unless *holds*: it is what the case needs to see something."""
    if not holds:
        not_observed(why_not)


def unimplemented(text: str) -> NoReturn:
    """End the case as UNIMPLEMENTED: the board lacks a capability that the case needs."""
    raise CaseEndedError(Behaviour.UNIMPLEMENTED, text)


def informational(text: str) -> NoReturn:
    """End the case as INFORMATIONAL: the clause allows the behaviour, and a reader may care."""
    raise CaseEndedError(Behaviour.INFORMATIONAL, text)


# --- Differences in words ------------------------------------------------------------------------


def record_differences(got: object, due: object, due_word: str = "due is") -> str:
    r"""Return in words where two values differ: the fields, elements or bytes that do, and no more.

    Examples
    --------
    >>> record_differences(b"\x01\x02\x03", b"\x01\x05\x03")
    '1 of 3 bytes: [1] is 2, due is 5'
    >>> record_differences(b"\x01\x02\x03", b"\x01\x02")
    'bytes: 3 bytes, due is 2; [2] is 3, due is missing'
    >>> record_differences((1, 2), (1, 3), due_word="was")
    'is (1, 2), was (1, 3)'
    """
    found = list(_different_parts("", got, due, due_word))
    more = f"; and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
    return "; ".join(found[:_SHOWN]) + more


def _different_parts(name: str, got: object, due: object, due_word: str) -> Iterator[str]:
    """Yield as text how *got* differs from *due*, part by part; nothing if they are equal.

    *name* is that of the value, *due_word* what is put before the part that is due.
    """
    if got == due:
        return
    if isinstance(got, bytes) and isinstance(due, bytes):
        yield _different_bytes(name or "bytes", got, due, due_word)
    elif _is_drive(got) and _is_drive(due):
        assert isinstance(got, tuple)  # _is_drive
        assert isinstance(due, tuple)
        yield from _different_drives(b"".join(got), b"".join(due), due_word)
    elif type(got) is type(due) and is_dataclass(got) and is_dataclass(due):
        for part in fields(got):
            one, other = getattr(got, part.name), getattr(due, part.name)
            inner = f"{name}.{part.name}".lstrip(".")
            if part.name == "data" and isinstance(got, m.DriveReply | m.TraceDrive):
                yield from _different_drives(one, other, due_word)
            else:
                yield from _different_parts(inner, one, other, due_word)
    elif isinstance(got, dict) and isinstance(due, dict) and got.keys() == due.keys():
        for key, value in got.items():
            yield from _different_parts(f"{name} {key}".lstrip(), value, due[key], due_word)
    elif _is_short(got) and _is_short(due):
        yield f"{name} is {_short_text(got)}, {due_word} {_short_text(due)}".lstrip()
    elif _is_sequence(got) and _is_sequence(due):
        assert isinstance(got, Sequence)  # _is_sequence
        assert isinstance(due, Sequence)
        if len(got) != len(due):
            yield f"{name} {len(got)} of them, {due_word} {len(due)}".lstrip()
        for place, (one, other) in enumerate(zip_longest(got, due, fillvalue=_MISSING)):
            yield from _different_parts(f"{name}[{place}]", one, other, due_word)
    else:
        yield f"{name} is {_value_text(got)}, {due_word} {_value_text(due)}".lstrip()


def _different_drives(got: bytes, due: bytes, due_word: str) -> Iterator[str]:
    """Yield as text how the N phases of *got* and *due* differ, then the N amplitudes.

    *due_word* is put before what is due.
    """
    one, other = len(got) // 2, len(due) // 2
    yield from _different_parts("phases", got[:one], due[:other], due_word)
    yield from _different_parts("amplitudes", got[one:], due[other:], due_word)


def _different_bytes(name: str, got: bytes, due: bytes, due_word: str) -> str:
    """Return as text how many bytes of *got*, called *name*, differ, and the first four of them.

    *due_word* is put before what is due.
    """
    if len(got) != len(due):
        pairs = enumerate(zip_longest(got, due, fillvalue=_MISSING))
        n, (one, other) = next((n, pair) for n, pair in pairs if pair[0] != pair[1])
        values = f"[{n}] is {_value_text(one)}, {due_word} {_value_text(other)}"
        return f"{name}: {len(got)} bytes, {due_word} {len(due)}; {values}"
    wrong = [place for place, (one, other) in enumerate(zip(got, due, strict=True)) if one != other]
    shown = "; ".join(f"[{n}] is {got[n]}, {due_word} {due[n]}" for n in wrong[:_SHOWN])
    more = "; ..." if len(wrong) > _SHOWN else ""
    return f"{len(wrong)} of {len(got)} {name}: {shown}{more}"


def _is_sequence(value: object) -> bool:
    """Return True for a list or tuple; text and bytes are none."""
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _is_drive(value: object) -> bool:
    """Return True for (phases, amplitudes) of as many transducers, as bytes."""
    if not isinstance(value, tuple) or not all(isinstance(part, bytes) for part in value):
        return False
    return [len(part) for part in value] == _HALVES * [len(value[0])] if value else False


def _is_short(value: object) -> bool:
    """Return True for a list or tuple of at most 6 numbers, texts or enum members."""
    if not isinstance(value, Sequence) or isinstance(value, str | bytes) or len(value) > _WHOLE:
        return False
    return all(isinstance(part, int | str | enum.Enum) for part in value)


def _short_text(value: object) -> str:
    """Return a list or tuple of few values as text: in parentheses, with commas."""
    assert isinstance(value, Sequence)  # _is_short
    return f"({', '.join(map(_value_text, value))})"


def _is_plain(value: object) -> bool:
    """Return True for a number, text or enum member."""
    return isinstance(value, int | float | str | enum.Enum) and not isinstance(value, bool)


def _value_text(value: object) -> str:
    """Return one value as text: an enum member by its name, a bool as 0 or 1."""
    if value is _MISSING:
        return "missing"
    if isinstance(value, bool):
        return str(int(value))  # of something that is counted
    return value.name if isinstance(value, enum.Enum) and value.name else str(value)
