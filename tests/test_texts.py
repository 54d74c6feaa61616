"""`make release` compares what a lesson prints with what it has stored: here a made-up lesson, by the same settings."""

import subprocess
import sys
from pathlib import Path

import nbformat

ROOT = Path(__file__).parent.parent


def stored(code, text, *tags, name="stdout"):
    """An executed cell that printed a text."""
    output = nbformat.v4.new_output("stream", name=name, text=text + "\n")
    return nbformat.v4.new_code_cell(code, outputs=[output], execution_count=1, metadata={"tags": list(tags)})


def test_a_stale_text_is_found_and_named_and_what_may_vary_is_not(tmp_path):
    bar = "import sys; print('100%|###| 1/1 [00:01<00:00,  1.94s/episode]', file=sys.stderr)"
    value = nbformat.v4.new_output("execute_result", {"text/plain": "'41 blocks'"}, execution_count=1)
    lines = "\n".join(map(str, ["one line", *range(30), ""]))
    cells = [
        stored("print('ninety of a hundred')", "ninety of a hundred"),
        stored("print('one line', *range(30), '80 % of the blocks', sep='\\n')", f"{lines}85 % of the blocks"),
        nbformat.v4.new_code_cell("'40 blocks'", outputs=[value], execution_count=1),
        stored("print('trained in 3.2 s')", "trained in 4.7 s"),
        stored(bar, "100%|###| 1/1 [00:02<00:00,  2.89s/episode]", name="stderr"),
        stored("print(f'data:;base64,{300 * \"A\"}==')", f"data:;base64,{300 * 'B'}"),
        stored("print('a draw: 4')", "a draw: 5", "nbval-ignore-output"),
    ]
    lesson = tmp_path / "made_up.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=cells), lesson)
    command = [sys.executable, "-m", "pytest", "--nbval", "--config-file=pyproject.toml", f"--rootdir={tmp_path}"]
    command += ["-p", "no:cacheprovider", "--color=no", str(lesson)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "2 failed, 5 passed" in done.stdout, done.stdout
    for line in ("made_up.ipynb::Cell 1", "+ 85 % of", "- 80 % of", "made_up.ipynb::Cell 2", "+ '41 bl", "- '40 bl"):
        assert line in done.stdout, done.stdout
