"""Sphinx: how `make book` builds the site from the stored notebooks, docs/ and the docstrings. Nothing is executed."""

from __future__ import annotations

import base64
import json
import sys
import tomllib
from pathlib import Path

from docutils import nodes
from myst_nb.core.render import MimeData, NbElementRenderer
from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
from docs import hosted, pages  # noqa: E402  # Sphinx reads this file as a program: the folder must be named first.

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
autodoc_mock_imports = ["gradio"]
"""It has an environment of its own: docs/app.txt."""
autodoc_member_order = "bysource"
autodoc_typehints = "description"
napoleon_use_ivar = True

repository_address = hosted.repository()
"""Lessons link to Colab and Binder once the repository has an address."""

html_theme = "sphinx_book_theme"
html_title = "gem_lite"
html_theme_options = {"show_toc_level": 1, "use_download_button": True, "navbar_persistent": []}
html_context = {"default_mode": "auto"}
html_static_path = ["static"]
html_css_files = ["book.css"]
FRAMES = b"acTL"
"""Begins the frames of an animated PNG."""


def prepare_lesson(app: Sphinx, docname: str, source: list[str]) -> None:
    """Change what a lesson needs changed as a page."""
    if not docname.startswith("notebooks/"):
        return
    notebook = json.loads(source[0])
    pages.fold_solutions(notebook)
    pages.replace_widgets(notebook)
    pages.add_links(notebook, app.config.repository_address, f"{Path(docname).name}.ipynb")
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
    app.add_config_value("repository_address", None, "env", (str, type(None)))
    app.connect("source-read", prepare_lesson)
    show_texts_of_pictures()
