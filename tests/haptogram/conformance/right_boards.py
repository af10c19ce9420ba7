"""Right boards at random, judged by the suite: none may fail; see ``right_boards.py --help``."""

import argparse
import contextlib
import functools
import json
import os
import random
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path += [str(Path(__file__).parent), str(ROOT), str(ROOT / "protocol")]
BUSY = "while True: pass"
WRONG = ("FAILED", "FLAKY", "INCONCLUSIVE")
MOST_INCONCLUSIVE = 0.02  # of the cases


def identity_of(seed):
    """Return arguments of :func:`identities.identity`: capabilities and limits drawn together."""
    from identities import OwnDefaults

    from haptogram_protocol.messages import Feature
    from sim_device.board.output import BoardOutput
    from sim_device.board.settings import ALL_FEATURES

    pick = random.Random(seed).choice
    grid = pick([(1, 1), (3, 2), (2, 8), (5, 5), (8, 8), (16, 16)])
    count = grid[0] * grid[1]
    lacking = [name for name in ALL_FEATURES if pick([True, False, False, False])]
    longest = pick([max(16, count), 16 * max(16, count), 2000, 32 << 20])
    window, chunk = pick([1, 4, 16]), pick([64, 512, 2048, 4061])
    points = pick([1, 2, 8, 74, 255])
    return {
        "grid": grid,
        "carrier_us": pick([20, 25, 25, 32, 100, 1000]),
        "features": pick(
            [ALL_FEATURES, ALL_FEATURES & ~functools.reduce(int.__or__, lacking, Feature(0))]
        ),
        "output": pick([BoardOutput, BoardOutput, OwnDefaults]),
        "queue_depth": pick([4, 5, 60, 128]),
        "max_horizon_us": pick([100_000, 999_999, 10_000_000, 2**31 - 1]),
        "latch_lead_us": pick([0, 0, 333, 2_000, 20_000, 100_000]),
        "point_time_us": min(pick([0, 0, 100, 2_000, 100_000]), 400_000 // points),
        "max_points": points,
        "trace_ring": pick([16, 60, 4096]),
        "max_sequence_frames": pick([16, 1000, 65_536]),
        "max_upload_bytes": longest,
        "max_stored_bytes": longest * pick([2, 3, 4]) // 2,
        "max_playback_rate_hz": pick([1, 9, 1000, 10_000]),
        "max_unattended_ms": pick([1000, 600_000, 2**32 - 1]),
        "upload_window": window,
        "max_chunk": chunk,
        "rx_window": max(4098, window * (chunk + 60)) * pick([1, 4]),
    }


def tell(line):
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def serve(seed, baud):
    """Be the board of *seed* on a pseudo-terminal, until it is told to end."""
    from identities import identity_port

    from haptogram.settings.board import BoardConfig
    from sim_device.blueprint import blueprint_of
    from sim_device.line.pty_port import PtyPort
    from sim_device.simulation import Simulation
    from sim_device.wallclock import Heartbeat

    plain = blueprint_of(BoardConfig.of(baud=baud, seed=random.getrandbits(32)))
    board = identity_port(**identity_of(seed)).changed(plain)
    link = f"/tmp/right-board-{os.getpid()}"
    with contextlib.closing(PtyPort(link)) as port:
        heartbeat = Heartbeat(Simulation(board.settings, parts=board.parts), port)
        with heartbeat.stopped_by_signals():
            tell(f"listening on {link}")
            heartbeat.run()


def judged(seed, options):
    """Return the verdicts that no right board may have, by case, and how many cases were judged."""
    from boards import run
    from identities import identity

    from haptogram.conformance.case import Depth
    from haptogram.conformance.run.spawning import SpawnAccess

    if options.clock == "virtual":
        access = identity(baud=options.baud, **identity_of(seed))
    else:
        words = f"{sys.executable} {__file__} --serve --first {seed} --baud {options.baud}"
        access = SpawnAccess(words, baudrate=options.baud, boot_timeout_s=60)
    suite = run(access, *options.clause, depth=Depth[options.depth.upper()], seed=seed)
    found = {
        r.case: f"{r.behaviour.value}: {r.detail}"
        for r in suite.results
        if r.behaviour.value in WRONG
    }
    found |= {
        r.case: f"FAILED: not recovered: {r.recovery}" for r in suite.results if not r.recovers
    }
    count = sum(r.behaviour.value not in ("NOT-OBSERVED", "UNIMPLEMENTED") for r in suite.results)
    return seed, found, count


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--last", type=int, default=20, help="last seed")
    parser.add_argument("--baud", type=int, default=3_000_000)
    parser.add_argument("--depth", choices=("quick", "default", "full"), default="quick")
    parser.add_argument("--clock", choices=("virtual", "wall"), default="virtual")
    parser.add_argument("--clause", action="append", default=[], help="only these")
    parser.add_argument("--jobs", type=int, default=1, help="boards at a time")
    parser.add_argument(
        "--busy", type=int, default=0, help="processes beside them that only compute"
    )
    parser.add_argument("--serve", action="store_true", help="be the first board on a pty")
    options = parser.parse_args()
    if options.serve:
        return serve(options.first, options.baud)
    busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(options.busy)]
    failed = unclear = cases = 0
    try:
        with ProcessPoolExecutor(options.jobs, max_tasks_per_child=1) as pool:
            seeds = range(options.first, options.last + 1)
            for future in as_completed([pool.submit(judged, seed, options) for seed in seeds]):
                seed, found, count = future.result()
                tell(f"{seed}: {json.dumps(found, indent=2) if found else 'right'}, {count} cases")
                bad = sum(not text.startswith("INCONCLUSIVE") for text in found.values())
                failed, unclear, cases = failed + bad, unclear + len(found) - bad, cases + count
    finally:
        for process in busy:
            process.kill()
    tell(f"{cases} cases: {failed} FAILED, {unclear} INCONCLUSIVE")
    return int(failed > 0 or unclear > MOST_INCONCLUSIVE * cases)


if __name__ == "__main__":
    sys.exit(main())
