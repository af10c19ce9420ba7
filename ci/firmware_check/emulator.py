"""Firmware in QEMU: started, reset, asked for its memory, ended."""

from __future__ import annotations

import os
import re
import select
import shlex
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Final, Self

from haptogram.driver.line.port import Transport, open_transport
from haptogram.errors import ConfigurationError, LinkError
from haptogram_protocol.export.tables import description_hash
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import Hello, HelloReply, build_body, parse_body

from .ports import EMULATE

_START_S: Final = 10.0
_STOP_S: Final = 5.0
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

    Attributes
    ----------
    url : str
        Port of the board.
    reset_command : str
        Shell command that restarts the firmware.
    """

    def __init__(self, machine: str, firmware: Path) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="haptogram-qemu-")
        self._monitor = Path(self._folder.name) / "monitor"
        self.url = ""
        self.reset_command = shlex.join([str(EMULATE), "--reset", str(self._monitor)])
        command = [EMULATE, "--with-parent", "--monitor", self._monitor, machine, firmware]
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
        assert self._process.stdout is not None  # PIPE
        printed, end_s = b"", time.monotonic() + _START_S
        while time.monotonic() < end_s:
            ready, _, _ = select.select([self._process.stdout], [], [], 0.1)
            piece = os.read(self._process.stdout.fileno(), 4096) if ready else b""
            printed += piece
            if found := re.search(rb"socket://\S+(?=\n)", printed):
                return found[0].decode()
            if ready and not piece:
                break
        said = " ".join(printed.decode(errors="replace").split())[-200:] or "nothing"
        raise ConfigurationError(f"QEMU did not start: it printed {said}")

    def wait_for_board(self, timeout_s: float) -> HelloReply:
        """Ask for a session until the firmware answers.

        Raises
        ------
        ConfigurationError
            If it does not within *timeout_s*: it hangs, or it is not what runs on this machine.
        """
        hello = Hello(1, 0, _NONCE, description_hash())
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

    def memory(self, address: int, count: int) -> bytes:
        """Return *count* bytes of the chip's memory."""
        file = Path(self._folder.name) / "memory"
        command = [EMULATE, "--memory", self._monitor, f"{address:#x}", count, file]
        done = subprocess.run(
            [str(part) for part in command], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise ConfigurationError(done.stderr.strip())
        return file.read_bytes()


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
