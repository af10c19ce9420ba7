"""Firmware in QEMU: started, reset, asked for its memory, ended."""

from __future__ import annotations

import contextlib
import os
import re
import select
import shlex
import socket
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Final, Self

from haptogram.driver.line.port import Transport, open_transport
from haptogram.errors import ConfigurationError, LinkError
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import VERSION_MAJOR, Hello, HelloReply, build_body, parse_body

from .debugger import send_processor_to
from .ports import EMULATE

_START_S: Final = 10.0
_STOP_S: Final = 5.0
_POLL_S: Final = 0.02
_ASK_AGAIN_S: Final = 0.25
_NONCE: Final = 0xB007


class Emulator:
    """QEMU with one firmware, as a context manager: it ends with the block, or with this process.

    Parameters
    ----------
    machine : str
        Name of QEMU's machine.
    firmware : Path
        ELF file.
    log : Path or None
        Gets a line for everything that the firmware writes to hardware which QEMU does not have.
    pins : Path or None
        Gets what the transducers are driven with, from firmware that tells it.
    instruction_ns : int or None
        Time of the chip that an instruction takes, a power of two; None: that of the workstation.

    Attributes
    ----------
    url : str
        Port of the board.
    reset_command : str
        Shell command that restarts the firmware.
    """

    def __init__(
        self,
        machine: str,
        firmware: Path,
        log: Path | None = None,
        pins: Path | None = None,
        instruction_ns: int | None = None,
    ) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="haptogram-qemu-")
        self._monitor = Path(self._folder.name) / "monitor"
        self._gdb = Path(self._folder.name) / "gdb"
        self.url = ""
        self._printed = b""
        self.reset_command = shlex.join([str(EMULATE), "--reset", str(self._monitor)])
        more = [] if log is None else ["--log", log]
        more += [] if pins is None else ["--pins", pins]
        more += [] if instruction_ns is None else ["--ns", instruction_ns]
        sockets = ["--monitor", self._monitor, "--gdb", self._gdb]
        command = [EMULATE, "--with-parent", *sockets, *more, machine, firmware]
        self._process = subprocess.Popen(
            [str(part) for part in command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,  # Ctrl-C is for this process, which ends QEMU
        )

    def __enter__(self) -> Self:
        try:
            self.url = self._wait_for_url()
            self._wait_for_monitor()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End QEMU."""
        self._process.kill()
        self._process.wait(_STOP_S)
        assert self._process.stdout is not None  # PIPE
        self._process.stdout.close()
        self._folder.cleanup()

    def _wait_for_url(self) -> str:
        """Return the URL that the program prints first."""
        end_s = time.monotonic() + _START_S
        while time.monotonic() < end_s and not self._has_ended(0.1):
            if found := re.search(rb"socket://\S+(?=\n)", self._printed):
                return found[0].decode()
        raise self._not_started()

    def _wait_for_monitor(self) -> None:
        """Wait until QEMU has made the machine: only then does its monitor answer."""
        end_s = time.monotonic() + _START_S
        while time.monotonic() < end_s and not self._has_ended(_POLL_S):
            with socket.socket(socket.AF_UNIX) as monitor, contextlib.suppress(OSError):
                monitor.settimeout(_START_S)
                monitor.connect(str(self._monitor))
                if monitor.recv(1):
                    return
        raise self._not_started()

    def _has_ended(self, patience_s: float) -> bool:
        """Read what is printed; return True at its end, which is that of QEMU."""
        assert self._process.stdout is not None  # PIPE
        ready, _, _ = select.select([self._process.stdout], [], [], patience_s)
        piece = os.read(self._process.stdout.fileno(), 4096) if ready else b""
        self._printed += piece
        return bool(ready) and not piece

    def _not_started(self) -> ConfigurationError:
        text = re.sub(r"listening on \S+", "", self._printed.decode(errors="replace"))
        said = " ".join(text.split())[-200:] or "nothing"
        return ConfigurationError(f"QEMU did not start; it printed: {said}")

    def wait_for_board(self, timeout_s: float) -> HelloReply:
        """Ask for a session until the firmware answers.

        Raises
        ------
        ConfigurationError
            If it does not within *timeout_s*: it hangs, or it is not what runs on this machine.
        """
        hello = Hello(VERSION_MAJOR, 0, _NONCE)
        wire = encode_frame(build_body(hello, flags=0, seq=0, time_us=0, session=0))
        end_s = time.monotonic() + timeout_s
        transport = open_transport(self.url)
        try:
            decoder = FrameDecoder()
            while time.monotonic() < end_s:
                transport.write_some(wire)
                if reply := _hello_reply(transport, decoder):
                    return reply
        except LinkError as error:
            raise ConfigurationError(f"QEMU ended while the firmware started: {error}") from error
        finally:
            transport.close()
        raise ConfigurationError(
            f"the firmware did not answer HELLO within {timeout_s:g} s: it hangs at its start, or "
            "its UART is not the first serial port of this machine; a debugger sees where: "
            "qemu-system-arm -s -S, then gdb: target remote :1234"
        )

    def reset(self) -> None:
        """Restart the firmware."""
        self._ask("--reset", self._monitor)

    def memory(self, address: int, count: int) -> bytes:
        """Return *count* bytes of the chip's memory."""
        file = Path(self._folder.name) / "memory"
        self._ask("--memory", self._monitor, f"{address:#x}", count, file)
        return file.read_bytes()

    def go_on_at(self, address: int) -> None:
        """Let the processor leave what it does and go on at *address*."""
        send_processor_to(address, self._gdb)

    def _ask(self, *words: object) -> None:
        command = [str(word) for word in (EMULATE, *words)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ConfigurationError(done.stderr.strip())


def _hello_reply(transport: Transport, decoder: FrameDecoder) -> HelloReply | None:
    """Return the reply that comes before it is time to ask again."""
    end_ns = transport.now_ns() + int(_ASK_AGAIN_S * 1e9)
    while transport.now_ns() < end_ns:
        for body in decoder.feed(transport.read_available(end_ns)):
            if isinstance(body, bytes) and body[0] == HelloReply.TYPE:
                message = parse_body(body)[1]
                assert isinstance(message, HelloReply)
                return message
    return None
