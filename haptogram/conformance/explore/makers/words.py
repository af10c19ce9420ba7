"""Words for a frame of a dialogue: its message, and all that is odd about it."""

from __future__ import annotations

from haptogram_protocol.messages import Message


def words_of_message(message: Message) -> str:
    """Return name and fields of *message*; of what fills the rest of it only the length.

    Examples
    --------
    >>> from haptogram_protocol.messages import ReadTrace, UploadChunk
    >>> words_of_message(ReadTrace(first=7, count=2))
    'READ_TRACE first=7 count=2'
    >>> words_of_message(UploadChunk(64, b"abc"))
    'UPLOAD_CHUNK offset=64 data: 3'
    """
    shown = [message.TYPE.name, *(f"{name}={getattr(message, name)}" for name in message.WIRE)]
    if message.TAIL is not None:
        shown.append(f"{message.TAIL.name}: {len(getattr(message, message.TAIL.name))}")
    return " ".join(shown)


def words_of_oddities(
    *, number: int = 0, left_out: int = 0, flags: int = 0, session: int = 0, length: int = 0
) -> str:
    """Return words for all in which a frame differs from the one that a host should send.

    Parameters
    ----------
    number : int
        Its number, from the one that is next.
    left_out : int
        Numbers that are left out before it.
    flags : int
        Flags.
    session : int
        Bits of its session that differ from the open one.
    length : int
        Bytes that were added, or cut off.

    Examples
    --------
    >>> words_of_oddities(number=-1, length=300)
    ', number -1, 300 bytes more'
    """
    odd = []
    if number:
        odd.append(f"number {number:+}")
    if left_out:
        odd.append(f"{left_out} numbers left out before it")
    if flags:
        odd.append(f"flags {flags:#04x}")
    if session:
        odd.append(f"session ^ {session:#06x}")
    if length:
        odd.append(f"{abs(length)} bytes {'more' if length > 0 else 'less'}")
    return "".join(f", {text}" for text in odd)
