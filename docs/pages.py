"""What a lesson changes when it becomes a page of the book. Each function changes the notebook that it is given."""

from __future__ import annotations

from typing import Any

from docs import hosted

Notebook = dict[str, Any]
"""A notebook as JSON stores it."""

WIDGET = "application/vnd.jupyter.widget-view+json"
NO_WIDGET = "Here a running notebook (make lab) has controls. A page of the book cannot run Python."
"""What stands in the page in a widget's place."""


def fold_solutions(notebook: Notebook) -> None:
    """Fold the code that is folded in the notebook, too: the solutions of the exercises. myst-nb does it by a tag."""
    for cell in notebook["cells"]:
        if cell["metadata"].get("jupyter", {}).get("source_hidden"):
            cell["metadata"].setdefault("tags", []).append("hide-input")


def replace_widgets(notebook: Notebook) -> None:
    """Put a sentence in the place of a cell's widgets.

    A widget needs Python for its answers, and scripts from the network for its looks: the book has neither.
    """
    notebook["metadata"].pop("widgets", None)
    for cell in notebook["cells"]:
        outputs = cell.get("outputs", [])
        others = [output for output in outputs if WIDGET not in output.get("data", {})]
        if len(others) < len(outputs):
            sentence = {"output_type": "stream", "name": "stdout", "text": NO_WIDGET}
            cell["outputs"] = [sentence, *others]


def add_links(notebook: Notebook, address: str | None, file_name: str) -> None:
    """Put links to Colab and Binder below the title.

    Args:
        notebook: a lesson, whose first cell begins with its title.
        address: of the repository, as from `hosted.repository`. None leaves the links out.
        file_name: of the lesson, such as "00_quickstart.ipynb".
    """
    if address is None:
        return
    places = {"Open in Colab": hosted.colab(address, file_name), "Open in Binder": hosted.binder(address, file_name)}
    links = " ".join(f'<a href="{place}">{label}</a>' for label, place in places.items())
    first = notebook["cells"][0]
    title, _, rest = "".join(first["source"]).partition("\n")
    first["source"] = f'{title}\n\n<p class="hosted">{links}</p>\n{rest}'
