"""What the last lesson types: how long it is, what it imports, and that it trains and acts."""

import ast
import io
import re
import tokenize

import nbformat
import pytest

from experiments.from_an_empty_file.__main__ import APP
from experiments.from_an_empty_file.typed_lesson import LESSON, TAG, program
from gem_lite.cli import base
from gem_lite.foundations.files import DATA

LONGEST, LONGEST_RIVAL = 400, 60
"""Lines of code of GEM and of Transporter-Lan, without blank lines, comments and docstrings."""
ALLOWED = ("gem_lite.simulation", "gem_lite.tasks", "gem_lite.clip")
NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER,
}  # fmt: skip


def cells(tag):
    lesson = nbformat.read(LESSON, as_version=4)
    return [cell.source for cell in lesson.cells if tag in cell.metadata.get("tags", [])]


def code_lines(source):
    """The numbers of the lines with code."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    lines = {line for one in tokens if one.type not in NO_CODE for line in range(one.start[0], one.end[0] + 1)}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef) and ast.get_docstring(node) is not None:
            lines -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return lines


def imported(source):
    """The full names of all that a program imports."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


COUNTED = '''"""A module's docstring."""

# a comment
def add(one):
    """A docstring
    of two lines."""
    return (one +
            1)
'''


def test_what_is_counted():
    assert code_lines(COUNTED) == {4, 7, 8}


def test_gem_fits_into_400_lines_and_its_rival_into_60():
    of_rival = len(code_lines("\n".join(cells("rival"))))
    assert 10 < of_rival <= LONGEST_RIVAL
    assert 100 < len(code_lines(program())) - of_rival <= LONGEST


def test_it_imports_nothing_of_the_library_but_simulator_tasks_and_clip():
    own = [name for name in imported(program()) if name.partition(".")[0] in ("gem_lite", "experiments", "drawings")]
    assert len(own) >= 3
    assert [name for name in own if not name.startswith(ALLOWED)] == []


def test_the_cells_besides_define_nothing_that_the_program_needs():
    assert set(cells("rival")) < set(cells(TAG))
    compile(program(), LESSON.stem, "exec")


@pytest.mark.release
def test_it_trains_two_steps_and_plays_an_episode(capsys):
    assert base.run(APP, ["--steps", "2", "--episodes", "1", "--demos", "1"]) == 0
    cost, losses, score = capsys.readouterr().out.splitlines()
    assert cost.startswith("2 steps, seed 0, 1 demonstrations: ")
    assert [float(loss) for loss in re.findall(r"[\d.]+\d", losses)] == pytest.approx([12.5, 11.5], abs=2)
    assert re.fullmatch(r"mean score [\d.]+ in 1 test episodes: \d+", score)


def test_the_shipped_weights_play(capsys):
    assert base.run(APP, ["--episodes", "1", "--checkpoint", str(DATA / "gem-put-block-in-bowl.safetensors")]) == 0
    assert capsys.readouterr().out == "mean score 100.0 in 1 test episodes: 100\n"
