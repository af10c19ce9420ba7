"""One verification run on boards of another dialect: object -> codes -> what was latched."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

from haptogram.acoustics import Calibration, TransducerArray
from haptogram.driver.dialect_driver import DialectDriver
from haptogram.errors import DeviceError, LinkError
from haptogram.evidence.boards import BoardUnderTest
from haptogram.evidence.dialects.latches import upload_loss_text
from haptogram.evidence.run_record import (
    RunRecord,
    calibration_of_run,
    close_driver_of_run,
    note_calibration_of_run,
    recorded_port_of_run,
)
from haptogram.objects import run_frames
from haptogram.settings.arguments import Progress
from haptogram.settings.run.verify import VerifyConfig
from haptogram.verification import Cut, check_frame_tolerance, tolerance_of
from haptogram_protocol.dialects.codec import Dialect

if TYPE_CHECKING:
    from haptogram.acoustics.solvers.several import Method
    from haptogram.evidence.recordings.writer import RecordingWriter


@dataclass(frozen=True, slots=True)
class DialectBoardsUnderTest:
    """The boards on a line, as their own programs have them.

    Attributes
    ----------
    dialect : Dialect
        Their wire.
    array : TransducerArray
        Their emitters.
    channels : tuple of int
        Channel that drives each of them.
    mounting : Calibration or None
        How they are mounted, if not all alike.
    """

    dialect: Dialect
    array: TransducerArray
    channels: tuple[int, ...]
    mounting: Calibration | None = None

    @property
    def count(self) -> int:
        """Boards that have so many channels."""
        return max(self.channels) // self.dialect.channels + 1

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame for all of them."""
        return self.dialect.frame_bytes(self.count)


def measure_run_of_dialect(
    config: VerifyConfig,
    boards: DialectBoardsUnderTest,
    board: BoardUnderTest,
    progress: Progress | None,
    settling: Progress | None = None,
    *,
    writer: RecordingWriter | None = None,
) -> RunRecord:
    """Display the object on *boards* and collect what *board* latched.

    As :func:`~haptogram.evidence.run_record.measure_run` on Haptogram's own boards. At a port that
    tells nothing, the observations are what the bytes that left the host are.
    """
    shown = run_frames.frames_of_run(config.shape, config.pace, config.modulation)
    model = run_frames.host_model_of_run_frames(config.array, boards.array)
    if boards.mounting is not None:
        model = model.calibrated(boards.mounting)
    elements = calibration_of_run(config)
    tap = None if writer is None else recorded_port_of_run(board, config.link.baud, writer)
    driver = DialectDriver(
        tap or board.port,
        dialect=boards.dialect,
        baudrate=config.link.baud if boards.dialect.bauds else None,
        model=model,
        calibration=elements if config.elements.compensate else None,
        channels=boards.channels,
        keep=run_frames.MOST_FRAMES,
    )
    about = {
        "dialect": boards.dialect.name,
        "boards": boards.count,
        "phase_steps": driver.phase_steps,
        "transducers": boards.array.count,
        "carrier_hz": model.frequency_hz,
    }
    found = RunRecord(board.label, board.model or driver.model, about, warnings=driver.warnings)
    found.intended = driver.intended
    total = shown.count * config.pace.repeat
    try:
        if elements is not None:
            note_calibration_of_run(found, elements, driver.model)
        check_frame_tolerance(found.model, shown.points_m, tolerance_of(config.tolerance))
        with _cut_of_dialect_run(found, driver, total):
            frames = driver.frames(
                run_frames.targets_of_run(config, shown),
                solver=cast("Method", config.solver_of_host),
            )
            found.report = driver.stream(
                frames, config.pace.rate_hz, loops=config.pace.repeat, progress=progress
            )
    finally:
        close_driver_of_run(driver, found)
    board.settle(driver, settling, skip_fields=found.interrupted)
    found.observations = board.observations(driver)
    if (loss := upload_loss_text(board.records())) is not None:
        found.warnings.append(loss)
    if tap is not None:
        tap.tell(board.records())
    found.unseen, found.fault_counts = board.unseen, board.fault_counts
    return found


@contextlib.contextmanager
def _cut_of_dialect_run(found: RunRecord, driver: DialectDriver, total: int) -> Iterator[None]:
    """Convert an interrupt, a broken link or a refusal into the end of the run."""
    try:
        yield
    except KeyboardInterrupt:
        sent = driver.intended.total
        found.interrupted = True
        found.cut = Cut(f"interrupted after {sent} of {total} frames", not_sent=total - sent)
        with contextlib.suppress(LinkError, DeviceError):
            driver.mute()
    except (LinkError, DeviceError) as error:
        found.cut = Cut(str(error), not_sent=total - driver.intended.total)
