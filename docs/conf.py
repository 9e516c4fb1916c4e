"""Sphinx builds the site from the pages beside this file: `make docs`."""

import importlib.metadata
import re
import shutil
from pathlib import Path

project = "ddmhe"
author = "The ddmhe developers"
copyright = "The ddmhe developers"
release = importlib.metadata.version("ddmhe")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx_click",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
exclude_patterns = ["_build", "reports"]
html_theme = "pydata_sphinx_theme"
html_title = "ddmhe"
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "show_prev_next": True,
    "header_links_before_dropdown": 6,
}
html_context = {"default_mode": "auto"}
intersphinx_mapping: dict[str, tuple[str, None]] = {}  # the site is built without a network
autodoc_typehints = "none"  # the docstrings give shapes and units
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_param = False
default_role = "code"
suppress_warnings = ["ref.python"]  # `n` and `p` of docstrings are sizes, no names of attributes

sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "within_subsection_order": "FileNameSortKey",
    "remove_config_comments": True,
    "show_memory": False,
    "write_computation_times": False,
    # a figure is the result, not the object that its last line returns
    "capture_repr": (),
}


def without_substitutions(app, what, name, obj, options, lines):
    """Escapes the bars of |x|, which are no substitutions."""
    lines[:] = [re.sub(r"(?<![`|\\])\|(?![`|])", r"\|", line) for line in lines]


ARGUMENT = re.compile(r"(\*?\w+)(, \*?\w+)* : ")


def with_heading(app, what, name, obj, options, lines):
    """Puts the heading above arguments that are described without one."""
    first = next((k for k, line in enumerate(lines) if ARGUMENT.match(line)), None)
    if what == "class" or first is None:
        return
    if not any(line.strip("-") == "" != line for line in lines[:first]):
        lines[first:first] = ["Parameters", "----------"]


def escaped(app, context, lines):
    """The same of the command line's help."""
    without_substitutions(app, None, None, None, None, lines)


def with_reports(app, exception):
    """The pages of runs, which are whole as they are."""
    if exception is None:
        own = Path(app.outdir) / "reports"
        shutil.copytree(Path(__file__).parent / "reports", own, dirs_exist_ok=True)


def setup(app):
    """Called by Sphinx."""
    app.connect("build-finished", with_reports)
    app.connect("autodoc-process-docstring", with_heading, priority=300)
    app.connect("autodoc-process-docstring", without_substitutions)
    app.connect("sphinx-click-process-description", escaped)
    app.connect("sphinx-click-process-options", escaped)
