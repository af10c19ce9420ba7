"""Errors of the wire, split by who is at fault.

::

    ProtocolError
    +-- LocalProtocolError     the caller asked for something that the protocol does not allow
    +-- RemoteProtocolError    the peer sent something that the protocol does not allow
"""

from __future__ import annotations


class ProtocolError(Exception):
    """Root of every error of this package."""


class LocalProtocolError(ProtocolError, ValueError):
    """The caller asked for something that the protocol does not allow."""


class RemoteProtocolError(ProtocolError):
    """The peer sent something that the protocol does not allow.

    Attributes
    ----------
    reason : str
        Name of the board counter that counts this kind of damage (SPEC.md chapter 9).
    offset : int
        Byte of the payload at which a wrong value stands; 0 where that has no meaning.
    """

    def __init__(self, message: str, *, reason: str = "bad_value", offset: int = 0) -> None:
        super().__init__(message)
        self.reason = reason
        self.offset = offset
