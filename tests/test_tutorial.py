"""The tutorial as a notebook, run by a Jupyter kernel."""

import json
import re
import subprocess
import sys

import children
import nbformat
import pytest
from test_docs import script_of

TUTORIAL = script_of("as_notebook")
# Objects that a reader may display beside the pages.
SHOWN = [
    "orbits",
    "body",
    "Suslov3D(I1=np.linspace(1, 4, 200), I2=2, I13=-0.5, I23=-0.3)",
    "SuslovND(J=np.full((200, 9), 2.0), I=solved.I)",
]
BAR = "run = iterate(solved, omega0, eps=0.2, steps=100, progress=True)"
EXECUTE = """
import sys
import nbclient, nbformat
notebook = nbformat.read(sys.argv[1], as_version=4)
nbclient.NotebookClient(notebook, timeout=200, kernel_name="python3").execute()
nbformat.write(notebook, sys.argv[2])
"""


def test_all_pages_are_included(tmp_path):
    pages = TUTORIAL.pages()
    assert set(pages) == {path.stem for path in TUTORIAL.TUTORIAL.glob("*.md")} - {"index"}
    command = [
        sys.executable,
        TUTORIAL.__file__,
        tmp_path / "t.ipynb",
        "--scripts",
        tmp_path / "scripts",
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    notebook = nbformat.read(tmp_path / "t.ipynb", as_version=4)
    nbformat.validate(notebook)
    cells = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    assert cells == [code.strip() for name in pages for code in TUTORIAL.code(name)]
    for name in pages:
        text = (TUTORIAL.TUTORIAL / f"{name}.md").read_text(encoding="utf-8")
        assert text.count("```python") == len(TUTORIAL.code(name)) > 2
        script = (tmp_path / "scripts" / f"{name}.py").read_text(encoding="utf-8")
        compile(script, name, "exec")
        assert all(code in script for code in TUTORIAL.code(name))


@pytest.mark.compiled
def test_the_notebook_runs(tmp_path):
    """Cells write no errors; displays are short; there is a progress bar."""
    notebook = nbformat.from_dict(TUTORIAL.notebook())
    notebook.cells += [nbformat.v4.new_code_cell(code) for code in [*SHOWN, BAR]]
    nbformat.write(notebook, tmp_path / "tutorial.ipynb")
    names = tmp_path / "tutorial.ipynb", tmp_path / "executed.ipynb"
    children.run(EXECUTE, *names, NUMBA_NUM_THREADS="1")  # parallel loops take long to compile
    *cells, bar = nbformat.read(names[1], as_version=4).cells
    for cell in cells[: -len(SHOWN)]:
        if cell["cell_type"] == "code":
            assert all(each.get("name") != "stderr" for each in cell["outputs"]), cell["outputs"]
    for cell in cells[-len(SHOWN) :]:
        (output,) = cell["outputs"]
        line = output["data"]["text/plain"]
        assert len(line) < 140
        assert "\n" not in line
        assert all(len(text) < 700 for text in output["data"].values())
    assert re.search("100%|widget", json.dumps(bar["outputs"]))
