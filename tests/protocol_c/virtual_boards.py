"""The C board and the Python board in virtual time, as callables of time and bytes."""

import select
import subprocess

from haptogram.acoustics import AcousticModel
from haptogram_protocol.export.tables import description_hash
from sim_device.board.board import Board
from sim_device.board.settings import BoardSettings
from sim_device.dialects.haptogram import BoardDialect

_PATIENCE_S = 20


class CBoard:
    """One process of board_steps; every call is one line to it and one line back."""

    def __init__(self, folder, *, grid_nx=2, grid_ny=2, **_):
        self._process = subprocess.Popen(
            [folder / "board_steps", f"{grid_nx}x{grid_ny}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            bufsize=1,
        )

    def __call__(self, at_us, data=b""):
        """Let *data* arrive, or time pass; return what the board sent."""
        return self._step(f"rx {at_us} {data.hex()}" if data else f"at {at_us}")

    def fault(self, at_us):
        """Let the hardware fail."""
        return self._step(f"fault {at_us}")

    def reset(self):
        """Switch it off and on."""
        return self._step("reset")

    def _step(self, line):
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        ready, _, _ = select.select([self._process.stdout], [], [], _PATIENCE_S)
        assert ready, f"no answer to {line[:80]}"
        answer = self._process.stdout.readline().strip()
        assert answer, self._process.stderr.read()
        return b"" if answer == "-" else bytes.fromhex(answer)

    def close(self):
        """End the process; the sanitizers must have nothing to say, of leaks either."""
        _, said = self._process.communicate(timeout=20)
        assert (self._process.returncode, said) == (0, "")


class PythonBoard:
    """The virtual board of this project."""

    def __init__(self, *, grid_nx=2, grid_ny=2, pitch_um=10_000, **limits):
        model = AcousticModel.default(grid_nx, grid_ny, pitch_m=pitch_um * 1e-6)
        settings = BoardSettings(model=model, **limits)
        self._dialect = BoardDialect(Board(settings), description_hash())
        self._boot_us = settings.boot_us

    def __call__(self, at_us, data=b""):
        self._dialect.receive(data, self._boot_us + at_us)
        return self._dialect.take_output()
