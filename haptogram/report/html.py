"""Pages of HTML that need no other file: templates filled in, pictures embedded.

The templates lie in ``templates/``; all of them extend ``base.html``, share its style sheet, and
build their tables by the one macro in ``parts.html``.  Every text that goes in is escaped.
"""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from haptogram.machine.files import write_file_atomically

from .extra import require_report_packages

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup
    from matplotlib.figure import Figure

_CODE: Final = re.compile("`([^`]+)`")


@dataclass(frozen=True, slots=True)
class PagePicture:
    """A picture for a page.

    Attributes
    ----------
    png : bytes
        The picture.
    title : str
        What it is a picture of; read aloud in its place.
    caption : str
        What to see in it.
    """

    png: bytes
    title: str
    caption: str = ""

    @property
    def source(self) -> str:
        """The picture as the address of an image."""
        return f"data:image/png;base64,{base64.b64encode(self.png).decode('ascii')}"


def embed_picture(figure: Figure, title: str, caption: str = "") -> PagePicture:
    """Return *figure* as a picture for a page."""
    from .figures import style  # brings numpy along, which a page without pictures does not need

    return PagePicture(style.encode_figure(figure, ".png", style.PAGE_DPI), title, caption)


def check_html_page(*, pictures: bool = True) -> None:
    """Raise, before the work begins, unless a page can be written.

    Parameters
    ----------
    pictures : bool
        Whether the page holds pictures.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed.
    """
    require_report_packages("HTML pages", "jinja2", *(["matplotlib"] if pictures else []))


def write_html_page(path: Path, template: str, **content: Any) -> None:
    """Write one page, as a whole or not at all.

    Parameters
    ----------
    template : str
        Name of a file in ``templates/``.
    content : Any
        Values for the template.  Every page has a ``title``, a ``heading``, sentences below it
        (``lead``) and a ``tone``: "good", "bad", "doubt" or "plain".

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed, or *path* cannot be written.
    """
    page = render_html_page(template, **content)
    # A port may be named by bytes that are no text; they become question marks.
    write_file_atomically(path, page.encode("utf-8", errors="replace"))


def render_html_page(template: str, **content: Any) -> str:
    """Return one page; parameters and errors are those of :func:`write_html_page`."""
    check_html_page(pictures=False)
    return _environment().get_template(template).render(content)


def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("haptogram.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=StrictUndefined,
    )
    environment.filters["code_spans"] = _code_spans
    return environment


def _code_spans(text: str) -> Markup:
    """Return *text*, escaped, with what stands between backticks as code."""
    from markupsafe import Markup, escape

    return Markup(_CODE.sub(r"<code>\1</code>", str(escape(text))))
