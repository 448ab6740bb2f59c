"""Sphinx: the pages of this folder, and the reference made from the docstrings (numpydoc)."""

import re
import sys
import warnings
from pathlib import Path
from typing import get_origin

FOLDER = Path(__file__).parent
sys.path[:0] = [str(FOLDER.parent), str(FOLDER)]

from architecture import draw  # noqa: E402  beside this file
from constants import write_constants  # noqa: E402
from keys import write_effects, write_keys  # noqa: E402
from tables import write_tables  # noqa: E402

project = "Tolerance study of cycloid reducers"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc", "sphinx_gallery.gen_gallery"]
sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "generated/gallery",
    "filename_pattern": r"/plot_",
    "write_computation_times": False,
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
}
templates_path = ["templates"]
exclude_patterns = ["generated/*.md", "gallery", "generated/gallery/*.ipynb", "templates"]
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
write_constants(FOLDER / "generated")
write_keys(FOLDER / "generated")
write_effects(FOLDER / "generated")


def as_written(_app, _kind, _name, _object, _options, lines):
    """Stars and bars of formulas are no markup, and our section "Source" is what numpydoc calls "References"."""
    for i, line in enumerate(lines):
        bullet, text = re.match(r"(\s*\* )?(.*)", line).groups(default="")
        parts = re.split(r"(`+[^`]*`+)", text)
        parts[::2] = [re.sub(r"(?<![\\*])([*|])(?!\*)", r"\\\1", part) for part in parts[::2]]
        lines[i] = bullet + "".join(parts)
        if line == "Source" and set(lines[i + 1]) == {"-"}:
            lines[i : i + 2] = ["References", "----------"]


def no_alias(_app, _kind, _name, thing, skip, _options):
    """Names of types have no signature."""
    return True if get_origin(thing) else skip


def setup(app):
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", as_written, priority=400)
    app.connect("autodoc-skip-member", no_alias)
