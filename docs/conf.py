"""Configuration of the documentation: `ci/docs` builds it into out/docs."""

import sys
from pathlib import Path

from sphinx.addnodes import pending_xref
from sphinx.util.nodes import make_refnode

import haptogram

sys.path.insert(0, str(Path(__file__).parent))
import commands_page

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
highlight_language = "none"  # a block names its language; drawings and output have none
#: Pages of the site that show files of the checkout, by the stems of those files.
_PAGES = {"SPEC": "spec", "firmware": "firmware", "CHANGELOG": "changes"}
autodoc_typehints = "none"  # the docstrings give types, shapes and units
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True


def setup(app):
    """Escape bars in docstrings, link files that are pages, and show every command's options."""
    app.connect("source-read", _add_options)
    app.connect("autodoc-process-docstring", _escape_bars, priority=600)  # after napoleon
    app.connect("doctree-read", _link_files)


def _add_options(app, docname, source):
    """Add the options of every command to their page."""
    if docname == "commands":
        source[0] += "\n" + commands_page.sections()


def _link_files(app, doctree):
    """Make a link to a file of the checkout one to its page, or plain text if it has none."""
    for node in list(doctree.findall(pending_xref)):
        path, _, anchor = node["reftarget"].partition("#")
        is_page = path in app.env.found_docs  # of the documentation, be it in another folder
        if node["reftype"] != "myst" or "/" not in path or is_page:
            continue
        page, text = _PAGES.get(Path(path).stem), node.children[0]
        anchor = anchor or node.get("reftargetid") or ""
        here = app.env.docname
        node.replace_self(make_refnode(app.builder, here, page, anchor, text) if page else text)


def _escape_bars(app, what, name, item, options, lines):
    """Escape the bars of |p|, which reStructuredText would take for a substitution."""
    in_example = False
    for number, line in enumerate(lines):
        in_example = line.lstrip().startswith(">>>") or (in_example and bool(line.strip()))
        if not in_example:
            lines[number] = line.replace("|", r"\|")
