"""Errors of the wire, split by who is at fault.

::

    ProtocolError
    +-- LocalProtocolError     the caller broke the protocol
    +-- RemoteProtocolError    the peer broke the protocol
"""

from __future__ import annotations


class ProtocolError(Exception):
    """Root of all errors of this package."""


class LocalProtocolError(ProtocolError, ValueError):
    """The caller broke the protocol: a value does not fit, or the link is in the wrong state."""


class RemoteProtocolError(ProtocolError):
    """The peer broke the protocol: damage, or a wrong type, length or value.

    Parameters
    ----------
    message : str
        One line for a log.
    reason, offset
        See the attributes.

    Attributes
    ----------
    reason : str
        Name of the board counter that counts this kind of damage (SPEC.md chapter 9).
    offset : int
        Byte of the payload at which the wrong value begins; 0 for other reasons.
    """

    def __init__(self, message: str, *, reason: str = "bad_value", offset: int = 0) -> None:
        super().__init__(message)
        self.reason = reason
        self.offset = offset
