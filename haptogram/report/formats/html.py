"""Pages of HTML that need no other file: templates filled in, pictures embedded.

The templates lie in ``templates/``; all of them extend ``base.html``, share its style sheet, and
build their tables by the one macro in ``parts.html``.  Every text that goes in is escaped.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from haptogram.errors import missing_extra
from haptogram.machine.files import write_file_atomically

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

    from haptogram.machine.provenance import Provenance

    from .document import Document


_CODE: Final = re.compile("`([^`]+)`")


def check_html_page(*, pictures: bool = False) -> None:
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


def write_document_page(path: Path, document: Document, provenance: Provenance) -> None:
    """Write *document* as a page, as a whole or not at all.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed, or *path* cannot be written.
    """
    page = render_document_page(document, provenance)
    # A port may be named by bytes that are no text; they become question marks.
    write_file_atomically(path, page.encode("utf-8", errors="replace"))


def render_document_page(document: Document, provenance: Provenance) -> str:
    """Return *document* as a page, with *provenance* in its banner.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed.
    """
    return render_html_page(
        document.template,
        provenance,
        title=f"Haptogram: {document.title}",
        heading=document.heading,
        tone=document.tone,
        lead=[f"{text[0].upper()}{text[1:]}." for text in document.lead],
        findings=[(one.level.value, one.name, one.text) for one in document.findings],
        checks=document.checks,
        sections=document.sections,
        **document.content(),
    )


def render_html_page(
    template: str, provenance: Provenance, *, folder: Path | None = None, **content: Any
) -> str:
    """Return one page, of a template in *folder* or of ours.

    Every page has a ``title``, a ``heading``, sentences below it (``lead``) and a ``tone``: "good",
    "bad", "doubt" or "plain".

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed.
    """
    check_html_page()
    page = _html_environment(folder).get_template(template)
    return page.render(content, origin=provenance.rows())


def html_setting_rows(settings: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return name and text of every setting that is set.

    Examples
    --------
    >>> html_setting_rows({"rate_hz": 1000.0, "port": None, "quiet": False, "center_mm": [0, 2.5]})
    [('rate_hz', '1000'), ('quiet', 'no'), ('center_mm', '0, 2.5')]
    """
    texts = ((name, _html_setting_text(value)) for name, value in settings.items())
    return [(name, text) for name, text in texts if text]


def _html_setting_text(value: Any) -> str:
    """Return a setting as a page shows it: None as "", a bool as yes or no, lists by commas.

    A float has 10 digits; a mapping is its names and values.
    """
    match value:
        case None:
            return ""
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.10g}"
        case Mapping():
            return ", ".join(f"{name} {_html_setting_text(item)}" for name, item in value.items())
        case list() | tuple():
            return ", ".join(map(_html_setting_text, value))
    return str(value)


def _html_environment(folder: Path | None) -> Environment:
    """Return the Jinja environment with the package's templates, and of *folder* unless None.

    A template of the package comes before one of the same name in the folder.
    """
    from jinja2 import ChoiceLoader, Environment, FileSystemLoader, PackageLoader, StrictUndefined

    environment = Environment(
        loader=ChoiceLoader(
            [
                PackageLoader("haptogram.report"),
                *([] if folder is None else [FileSystemLoader(folder)]),
            ]
        ),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=StrictUndefined,
    )
    environment.filters["code_spans"] = _html_code_spans
    return environment


def _html_code_spans(text: str) -> Markup:
    """Escape *text*; text between backticks becomes code."""
    from markupsafe import Markup, escape

    return Markup(_CODE.sub(r"<code>\1</code>", str(escape(text))))


def require_report_packages(result: str, *packages: str) -> None:
    """Raise unless *packages* are installed; call this before the work begins.

    Parameters
    ----------
    result : str
        The result that needs them, as the subject of the message in the plural.

    Raises
    ------
    ConfigurationError
        Names what is missing, and how to install it.
    """
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        raise missing_extra(f"{result} need {' and '.join(missing)}", "report")
