"""Sphinx: how `make book` builds the site from the stored notebooks, docs/ and the docstrings. Nothing is executed."""

from __future__ import annotations

import base64
import json
import tomllib
from pathlib import Path

from docutils import nodes
from myst_nb.core.render import MimeData, NbElementRenderer
from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]

project = "gem_lite"
author = "gem_lite developers"
release = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
root_doc = "docs/index"
include_patterns = [
    "docs/*.md",
    "build/api/*.rst",
    "notebooks/*.ipynb",
    "experiments/*/README.md",
    "data/*/README.md",
    "experiments/benchmark/README.md",
    "*.md",
]
extensions = [
    "myst_nb",
    "sphinx.ext.apidoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx-mathjax-offline",
]
"""The last one brings MathJax into the site: the equations need no network."""

nb_execution_mode = "off"
myst_enable_extensions = ["amsmath", "dollarmath"]
myst_heading_anchors = 3
default_role = "code"
apidoc_modules = [{"path": "../gem_lite", "destination": "build/api"}]
suppress_warnings = ["ref.python"]
"""Several classes have a field of one name: Sphinx then cannot choose where a link to it leads."""
autodoc_member_order = "bysource"
autodoc_typehints = "description"
napoleon_use_ivar = True

html_theme = "sphinx_book_theme"
html_title = "gem_lite"
html_theme_options = {"show_toc_level": 1, "use_download_button": True, "navbar_persistent": []}
html_context = {"default_mode": "auto"}
html_static_path = ["static"]
html_css_files = ["book.css"]
FRAMES = b"acTL"
"""Begins the frames of an animated PNG."""


def fold_solutions(_: Sphinx, docname: str, source: list[str]) -> None:
    """Fold the code that is folded in the notebook, too: the solutions of the exercises. myst-nb does it by a tag."""
    if not docname.startswith("notebooks/"):
        return
    notebook = json.loads(source[0])
    for cell in notebook["cells"]:
        if cell["metadata"].get("jupyter", {}).get("source_hidden"):
            cell["metadata"].setdefault("tags", []).append("hide-input")
    source[0] = json.dumps(notebook)


def show_texts_of_pictures() -> None:
    """Give each picture of a notebook the alternative text of its output, which myst-nb leaves out.

    A moving picture stays inside the page: its slider reads it there, also when the page is opened from the disk.
    """
    plain = NbElementRenderer.render_image

    def with_text(self: NbElementRenderer, data: MimeData) -> list[nodes.Element]:
        elements = plain(self, data)
        for element in elements:
            element["alt"] = data.output_metadata.get(data.mime_type, {}).get("alt", "")
            if data.mime_type == "image/png" and FRAMES in base64.b64decode(data.string):
                element["uri"] = f"data:image/png;base64,{''.join(data.string.split())}"
        return elements

    NbElementRenderer.render_image = with_text


def setup(app: Sphinx) -> None:
    """What Sphinx calls first."""
    app.connect("source-read", fold_solutions)
    show_texts_of_pictures()
