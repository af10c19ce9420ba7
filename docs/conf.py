"""Configuration of the documentation: `ci/docs` builds it into out/docs."""

import haptogram

project = "Haptogram"
author = copyright = "the Haptogram authors"
version = release = haptogram.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = f"Haptogram {release}"
html_static_path: list[str] = []
exclude_patterns = ["ci/**", "examples/**"]
myst_enable_extensions = [
    "fieldlist"
]  # no mathematics: it would be drawn by a script from elsewhere
myst_heading_anchors = 4
# A page links to files of the checkout as they are; on the site those are no pages.
suppress_warnings = ["myst.xref_missing"]
autodoc_typehints = "none"  # the docstrings give types, shapes and units
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True


def setup(app):
    """Escape the bars of |p|, which reStructuredText would take for a substitution."""
    app.connect("autodoc-process-docstring", _escape_bars, priority=600)  # after napoleon


def _escape_bars(app, what, name, item, options, lines):
    in_example = False
    for number, line in enumerate(lines):
        in_example = line.lstrip().startswith(">>>") or (in_example and bool(line.strip()))
        if not in_example:
            lines[number] = line.replace("|", r"\|")
