"""Opening a session, and saying why it failed."""

from __future__ import annotations

from typing import NoReturn

from haptogram.driver.line.link import Link
from haptogram.errors import DeviceError, NoAnswerError, VersionMismatchError, WrongProtocolError
from haptogram_protocol import VERSION_MAJOR
from haptogram_protocol.messages import ErrorCode, HelloReply


def open_line_session(link: Link) -> HelloReply:
    """Say HELLO and return the board's answer.

    Raises
    ------
    NoAnswerError
        The port is silent.
    WrongProtocolError
        Something answers, but no board.
    VersionMismatchError
        A board of another major version.
    LinkLostError
        The port closed.
    """
    deadline_ns = link.now_ns() + link.timeout_ns
    seq = link.connection.send_hello(link.now_us())
    try:
        return link.wait_for(seq, HelloReply, deadline_ns)
    except NoAnswerError as error:
        _explain_line_silence(link, error)
    except DeviceError as error:
        if error.code == ErrorCode.VERSION:
            raise VersionMismatchError(
                f"{link.url}: the board speaks version {error.detail} of the protocol, "
                f"this host version {VERSION_MAJOR}"
            ) from error
        raise


def _explain_line_silence(link: Link, error: NoAnswerError) -> NoReturn:
    connection = link.connection
    seconds = f"{link.timeout_ns / 1e9:g} s"
    if not connection.bytes_received:
        raise NoAnswerError(f"{link.url}: nothing came back within {seconds}") from error
    if not connection.frames_received:
        raise WrongProtocolError(
            f"{link.url}: {connection.bytes_received} bytes came within {seconds}, but no "
            f"Haptogram frame: another device, or another rate than {link.line.baudrate} baud"
        ) from error
    if connection.counters["unknown_type"] == connection.frames_received:
        raise WrongProtocolError(
            f"{link.url}: the port sends back what is written to it; no board answers"
        ) from error
    raise NoAnswerError(
        f"{link.url}: frames came within {seconds}, but no answer to HELLO"
    ) from error
