"""The picture of the README: the view of a run of `haptogram verify`, as a browser shows it."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

from PIL import Image

from haptogram.cli import main

PICTURE: Final = Path(__file__).parents[1] / "docs" / "images" / "hemisphere.png"
BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome", "chrome")
_FRAME: Final = 400
_WINDOW: Final = (1280, 900)
_BOX: Final = (130, 206, 1136, 821)  # of the window: the view with its time line


def draw() -> Image.Image:
    """Run the hemisphere in virtual time, and return the view of its recording."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise SystemExit("the picture needs Chromium: ci/browser installs it")
    with tempfile.TemporaryDirectory() as folder:
        record, html, png = (Path(folder, name) for name in ("run.mcap", "run.html", "run.png"))
        if main(["verify", "--virtual-time", "--quiet", "--record", str(record)]):
            raise SystemExit("the run did not pass")
        main(["view", str(record), "--html", str(html)])
        subprocess.run(
            [
                *(browser, "--headless", "--no-sandbox", "--virtual-time-budget=10000"),
                *(f"--window-size={_WINDOW[0]},{_WINDOW[1]}", f"--screenshot={png}"),
                f"{html.as_uri()}#view-{_FRAME}",
            ],
            check=True,
            capture_output=True,
        )
        return Image.open(png).convert("RGB").crop(_BOX)


if __name__ == "__main__":
    draw().save(PICTURE, optimize=True)
