"""Sphinx: the pages of this folder, and the reference made from the docstrings (numpydoc)."""

import sys
import warnings
from pathlib import Path

FOLDER = Path(__file__).parent
sys.path[:0] = [str(FOLDER.parent), str(FOLDER)]

from architecture import draw  # noqa: E402  beside this file
from tables import write_tables  # noqa: E402

project = "Tolerance study of cycloid reducers"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.viewcode", "numpydoc"]
templates_path = ["templates"]
exclude_patterns = ["generated/*.md", "templates"]
html_theme = "furo"
html_title = project
html_show_sphinx = False
html_show_copyright = False
myst_heading_anchors = 3

autosummary_ignore_module_all = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"
numpydoc_show_class_members = False
warnings.filterwarnings("ignore", "Unknown section Source")  # of signatures; in the text it is renamed below

draw(FOLDER / "generated")
write_tables(FOLDER / "generated")


def setup(app):
    """Our section "Source" is what numpydoc calls "References"."""

    def renamed(_app, _kind, _name, _object, _options, lines):
        for i, line in enumerate(lines[:-1]):
            if line == "Source" and set(lines[i + 1]) == {"-"}:
                lines[i : i + 2] = ["References", "----------"]

    app.connect("autodoc-process-docstring", renamed, priority=400)
