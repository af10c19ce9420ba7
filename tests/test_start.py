"""A start is quick: libraries that take a quarter of a second come when they are needed."""

import subprocess
import sys

CONNECTED = """
import sys, sim_device
from haptogram import Driver, Focus
sim_device.register_url_handler()
with Driver("haptogram://?clock=virtual&array=8x8&seed=1", seed=1) as driver:
    driver.arm()
    {calls}
late = sorted({{name.partition(".")[0] for name in sys.modules}} & {{"scipy", "numba"}})
sys.exit(f"imported: {{late}}" if late else 0)
"""

CALLS = {
    "arm": "pass",
    "focus": "driver.focus((0.0, 0.0, 0.1))",
    "phases of one focus": "driver.stream([(0.0, 0.0, 0.1), (0.01, 0.0, 0.1)], 500)",
    "focal points": """driver.stream(
        [[Focus.at((0.0, 0.0, 0.1)), Focus.at((0.01, 0.0, 0.1))]] * 2, 500, mode="points"
    )""",
    "playback": "driver.play([(0.0, 0.0, 0.1), (0.01, 0.0, 0.1)], 500)",
}


def test_neither_scipy_nor_numba_is_imported_for_any_call():
    calls = "\n    ".join(CALLS.values())
    done = subprocess.run(
        [sys.executable, "-c", CONNECTED.format(calls=calls)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_an_import_would_be_seen():
    call = "driver.frames([[Focus.at((x, 0.0, 0.1)) for x in (0.0, 0.01)]], solver='gradient')"
    done = subprocess.run(
        [sys.executable, "-c", CONNECTED.format(calls=call)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, "'scipy'" in done.stderr) == (1, True), done.stderr
