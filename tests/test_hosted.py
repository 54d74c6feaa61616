"""Lessons on Colab and Binder, and what a page of the book changes. Neither service is asked."""

import copy
import os
import re

import nbformat
import pytest

from docs import hosted, pages

ADDRESS = "https://github.com/somebody/gem_lite"
QUICKSTART = "00_quickstart.ipynb"


def project(folder, address):
    """A pyproject.toml with an address."""
    path = folder / "pyproject.toml"
    path.write_text(f'[project]\n[project.urls]\nRepository = "{address}"\n')
    return path


def lesson(*cells):
    return {"cells": list(cells), "metadata": {"widgets": {"state": {}}}}


def test_the_address_of_the_repository_stands_in_one_place_and_its_placeholder_is_no_address(tmp_path):
    assert hosted.repository(project(tmp_path, ADDRESS)) == ADDRESS
    assert hosted.repository(project(tmp_path, f"https://github.com/{hosted.PLACEHOLDER}/gem_lite")) is None
    hosted.repository()  # the stored one is one of the two


@pytest.mark.parametrize("address", ["", "https://example.org/a/b", ADDRESS + ".git", ADDRESS + "/", ADDRESS + "/tree"])
def test_an_address_that_colab_cannot_open_is_refused(tmp_path, address):
    with pytest.raises(ValueError, match=re.escape(f"or a slash at its end, got {address!r}")):
        hosted.repository(project(tmp_path, address))


def test_a_page_links_to_colab_and_binder_below_its_title():
    notebook = lesson({"cell_type": "markdown", "metadata": {}, "source": ["# Title\n", "\n", "Text"]})
    pages.add_links(notebook, ADDRESS, QUICKSTART)
    title, links, text = [line for line in notebook["cells"][0]["source"].split("\n") if line]
    assert (title, text) == ("# Title", "Text")
    assert re.findall('href="(.*?)"', links) == [
        "https://colab.research.google.com/github/somebody/gem_lite/blob/hosted/00_quickstart.ipynb",
        "https://mybinder.org/v2/gh/somebody/gem_lite/HEAD?urlpath=lab/tree/notebooks/00_quickstart.ipynb",
    ]


def test_a_page_has_no_links_while_the_repository_has_no_address():
    notebook = lesson({"cell_type": "markdown", "metadata": {}, "source": "# Title"})
    before = copy.deepcopy(notebook)
    pages.add_links(notebook, None, QUICKSTART)
    assert notebook == before


def test_a_page_has_a_sentence_in_a_widgets_place_and_asks_the_network_for_nothing():
    widget = {"output_type": "display_data", "data": {pages.WIDGET: {}, "text/plain": "HBox(...)"}}
    picture = {"output_type": "display_data", "data": {"image/png": "..."}}
    notebook = lesson(
        {"cell_type": "markdown", "metadata": {}, "source": "# Title"},
        {"cell_type": "code", "metadata": {}, "source": "", "outputs": [widget, widget, picture]},
        {"cell_type": "code", "metadata": {}, "source": "", "outputs": [picture]},
    )
    pages.replace_widgets(notebook)
    (sentence, kept), others = (cell["outputs"] for cell in notebook["cells"][1:])
    assert sentence["text"] == pages.NO_WIDGET and kept == picture and others == [picture]
    assert "widgets" not in notebook["metadata"]


def test_folded_solutions_are_folded_in_the_page():
    cells = [{"metadata": {"jupyter": {"source_hidden": hidden}, "tags": ["old"]}} for hidden in (True, False)]
    pages.fold_solutions(lesson(*cells))
    assert [cell["metadata"]["tags"] for cell in cells] == [["old", "hide-input"], ["old"]]


def test_copies_for_colab_begin_with_the_set_up_and_are_else_the_lessons(tmp_path):
    files = hosted.write(tmp_path / "new", ADDRESS)
    assert [file.name for file in files] == sorted(path.name for path in hosted.LESSONS.glob("*.ipynb"))
    for file in files:
        first, *others = nbformat.read(file, as_version=4).cells
        assert f"git clone --quiet --depth 1 {ADDRESS} gem_lite" in first.source
        assert others == nbformat.read(hosted.LESSONS / file.name, as_version=4).cells


def test_no_copies_are_written_without_an_address(tmp_path, monkeypatch):
    monkeypatch.setattr(hosted, "repository", lambda: None)
    with pytest.raises(SystemExit, match=r"address into \[project.urls\]"):
        hosted.main(tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_binder_installs_the_group_and_the_language_model_of_the_makefile():
    script = hosted.ROOT / ".binder" / "postBuild"
    assert os.access(script, os.X_OK)
    assert "--editable '.[lessons]'" in script.read_text()
    (pattern,) = re.findall(r"sed -n 's/(.*?)//p' Makefile", script.read_text())
    lines = (hosted.ROOT / "Makefile").read_text().splitlines()
    assert [re.sub(pattern, "", line) for line in lines if re.match(pattern, line)] == [hosted.language_model()]
