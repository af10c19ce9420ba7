"""The Python board and the C board in virtual time, as callables of time and bytes.

Both have no line: bytes arrive, and leave, at the moment that the caller names.
"""

from __future__ import annotations

import select
import subprocess
from pathlib import Path
from typing import Any, Final, Protocol, Self

from haptogram.acoustics import AcousticModel
from sim_device.assembly import HEALTHY
from sim_device.board.settings import BoardSettings

_PATIENCE_S: Final = 20


class VirtualBoard(Protocol):
    """A board whose time is an argument: microseconds after power-up."""

    def __call__(self, at_us: int, data: bytes = b"") -> bytes:
        """Let *data* arrive at *at_us*, or only time pass; return the bytes that the board sent."""
        ...

    def reset(self) -> None:
        """Switch the board off and on; time begins at 0 again."""
        ...


class PythonBoard:
    """The virtual board of this project.

    Parameters
    ----------
    grid_nx, grid_ny : int, keyword-only
        Elements of the array in either direction.
    pitch_um : int, keyword-only
        Pitch of the array in micrometres.
    **limits
        Fields of :class:`~sim_device.board.settings.BoardSettings`.
    """

    def __init__(
        self, *, grid_nx: int = 2, grid_ny: int = 2, pitch_um: int = 10_000, **limits: Any
    ) -> None:
        model = AcousticModel.default(grid_nx, grid_ny, pitch_m=pitch_um * 1e-6)
        self._settings = BoardSettings(model=model, **limits)
        self.reset()

    def __call__(self, at_us: int, data: bytes = b"") -> bytes:
        """Let *data* arrive at *at_us*, or only time pass; return the bytes that the board sent."""
        self._dialect.receive(data, self._settings.boot_us + at_us)
        return self._dialect.take_output()

    def reset(self) -> None:
        """Switch the board off and on; time begins at 0 again."""
        self._dialect = HEALTHY.assemble(self._settings)

    @property
    def next_event_us(self) -> int | None:
        """Time at which the board next does something by itself; None if it only waits."""
        next_us = self._dialect.next_event_us()
        return None if next_us is None else next_us - self._settings.boot_us


class CBoard:
    """The reference board in C: a process of ``board_steps`` that answers each line with one.

    Parameters
    ----------
    folder : Path
        Where ``board_steps`` was built.
    grid_nx, grid_ny : int, keyword-only
        Elements of the array in either direction; its pitch is 10 mm.
    late_us : int or None, keyword-only
        Give it transducers, whose drives take effect so much later than they are due.
    bytes_per_s : int, keyword-only
        Rate of its line, with *late_us*; 0: as fast as any.
    store_bytes : int, keyword-only
        Memory for its sequences, with *late_us* or *keeps*.
    keeps : bool, keyword-only
        Whether configuration and correction outlive a reset.

    Attributes
    ----------
    radiated : list of str
        What the last step radiated: the time that was due, phase and amplitude of transducer 0, or
        ``off``, joined by colons.
    """

    def __init__(
        self,
        folder: Path,
        *,
        grid_nx: int = 2,
        grid_ny: int = 2,
        late_us: int | None = None,
        bytes_per_s: int = 0,
        store_bytes: int = 96 << 20,
        keeps: bool = False,
    ) -> None:
        machine: tuple[int | str, ...] = ()
        if late_us is not None or keeps:
            machine = (-1 if late_us is None else late_us, bytes_per_s, store_bytes)
        machine += ("keep",) * keeps
        self.radiated: list[str] = []
        self._process = subprocess.Popen(
            [folder / "board_steps", f"{grid_nx}x{grid_ny}", *map(str, machine)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            bufsize=1,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __call__(self, at_us: int, data: bytes = b"") -> bytes:
        """Let *data* arrive at *at_us*, or only time pass; return the bytes that the board sent."""
        return self._step(f"rx {at_us} {data.hex()}" if data else f"at {at_us}")

    def hold_output(self, at_us: int, data: bytes) -> None:
        """Let *data* arrive at *at_us*; the next step reads what the board sends."""
        self._step(f"held {at_us} {data.hex()}")

    def raise_hardware_fault(self, at_us: int) -> bytes:
        """Let the hardware fail; return the bytes that the board sent."""
        return self._step(f"fault {at_us}")

    def overtake(self, at_us: int, count: int) -> bytes:
        """Let MUTE arrive, the last of *count* bytes that come later; return what was sent."""
        return self._step(f"mute {at_us} {count}")

    def reset(self) -> None:
        """Switch the board off and on; time begins at 0 again."""
        self._step("reset")

    def _step(self, line: str) -> bytes:
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write(line + "\n")
        process.stdin.flush()
        ready, _, _ = select.select([process.stdout], [], [], _PATIENCE_S)
        assert ready, f"board_steps did not answer {line[:80]!r} within {_PATIENCE_S} s"
        answer = process.stdout.readline().strip()
        assert answer, process.stderr.read()
        answer, *self.radiated = answer.split(" ")
        return b"" if answer == "-" else bytes.fromhex(answer)

    def close(self) -> None:
        """End the process; the sanitizers must report nothing, not even a leak."""
        _, complaints = self._process.communicate(timeout=_PATIENCE_S)
        assert (self._process.returncode, complaints) == (0, "")
