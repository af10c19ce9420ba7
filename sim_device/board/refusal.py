"""The board's way to say no."""

from __future__ import annotations

from haptogram.errors import HaptogramError
from haptogram_protocol.messages import ErrorCode


class RefusalError(HaptogramError):
    """A request that the board does not carry out; nothing has changed.

    Attributes
    ----------
    code : ErrorCode
        Why, as the wire says it.
    detail : int
        The number that belongs to the code.
    """

    def __init__(self, code: ErrorCode, detail: int) -> None:
        super().__init__(f"{code.name}, detail {detail}")
        self.code = code
        self.detail = detail
