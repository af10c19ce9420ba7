"""The picture of the README: two pictures of the page of `haptogram verify`, side by side."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Final
from unittest import mock

from PIL import Image

from haptogram.cli import main
from haptogram.report.figures.style import PAGE_DPI, embed_picture, encode_figure
from haptogram.report.formats.document import PagePicture
from haptogram.report.run import document

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURE: Final = Path(__file__).parents[1] / "docs" / "images" / "hemisphere.png"
TITLES: Final = ("Intended and measured foci over the array.", "Pressure around one focus.")
_HEIGHT: Final = 800  # pixels


def draw() -> Image.Image:
    """Run the hemisphere in virtual time, and return the two pictures of its page."""
    drawn: dict[str, bytes] = {}

    def kept(figure: Figure, title: str, caption: str = "") -> PagePicture:
        drawn[title] = encode_figure(figure, ".png", PAGE_DPI)
        return embed_picture(figure, title, caption)

    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch.object(document, "embed_picture", kept),
    ):
        html = Path(folder) / "run.html"
        if main(["verify", "--virtual-time", "--quiet", "--html", str(html)]):
            raise SystemExit("the run did not pass")
    shown = [_scaled(Image.open(io.BytesIO(drawn[title])).convert("RGB")) for title in TITLES]
    whole = Image.new("RGB", (sum(image.width for image in shown), _HEIGHT), "white")
    whole.paste(shown[0], (0, 0))
    whole.paste(shown[1], (shown[0].width, 0))
    return whole


def _scaled(image: Image.Image) -> Image.Image:
    width = round(image.width * _HEIGHT / image.height)
    return image.resize((width, _HEIGHT), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    draw().save(PICTURE, optimize=True)
