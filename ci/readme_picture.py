"""The picture of the README: two pictures of the page of `haptogram verify`, side by side."""

from __future__ import annotations

import base64
import io
import re
import tempfile
from pathlib import Path
from typing import Final

from PIL import Image

from haptogram.cli import main

PICTURE: Final = Path(__file__).parents[1] / "docs" / "images" / "hemisphere.png"
TITLES: Final = ("Intended and measured foci over the array.", "Pressure around one focus.")
_HEIGHT: Final = 800  # pixels


def draw() -> Image.Image:
    """Run the hemisphere in virtual time, and return the two pictures of its page."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "run.html"
        if main(["verify", "--virtual-time", "--quiet", "--html", str(page)]):
            raise SystemExit("the run did not pass")
        text = page.read_text(encoding="utf-8")
    shown = [_scaled(_picture(text, title)) for title in TITLES]
    whole = Image.new("RGB", (sum(image.width for image in shown), _HEIGHT), "white")
    whole.paste(shown[0], (0, 0))
    whole.paste(shown[1], (shown[0].width, 0))
    return whole


def _picture(page: str, title: str) -> Image.Image:
    found = re.search(rf'<img src="data:image/png;base64,([^"]+)" alt="{re.escape(title)}"', page)
    assert found is not None, title
    return Image.open(io.BytesIO(base64.b64decode(found[1]))).convert("RGB")


def _scaled(image: Image.Image) -> Image.Image:
    width = round(image.width * _HEIGHT / image.height)
    return image.resize((width, _HEIGHT), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    draw().save(PICTURE, optimize=True)
