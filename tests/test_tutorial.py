"""The tutorial as a notebook, run by a Jupyter kernel."""

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import children
import pytest
from test_docs import PRINTED

nbformat = pytest.importorskip("nbformat")
pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")

SCRIPT = Path(__file__).parent.parent / "docs" / "as_notebook.py"
# Objects that a reader may display beside the pages.
SHOWN = {
    "orbits": "orbits",
    "body": "Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3)",
    "bodies": "Suslov3D(I1=np.linspace(1, 4, 200), I2=2, I13=-0.5, I23=-0.3)",
    "of ten": "body",
    "many of ten": "SuslovND(J=np.full((200, 9), 2.0), I=body.I)",
}
BAR = """
import tqdm.auto
from suslov_fast._engine.progress import _tqdm
iterate(body, omega0, eps=0.2, steps=100, progress=True)
print(_tqdm() is tqdm.auto.tqdm)
"""
EXECUTE = """
import sys
import nbclient, nbformat
notebook = nbformat.read(sys.argv[1], as_version=4)
nbclient.NotebookClient(notebook, timeout=200, kernel_name="python3").execute()
nbformat.write(notebook, sys.argv[2])
"""


def load():
    spec = importlib.util.spec_from_file_location("as_notebook", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TUTORIAL = load()


def test_all_pages_are_included(tmp_path):
    """The notebook, and the scripts for a type checker, contain all blocks of all pages."""
    pages = {path.stem for path in TUTORIAL.TUTORIAL.glob("*.md")} - {"index"}
    assert set(TUTORIAL.pages()) == pages
    assert len(TUTORIAL.pages()) == 7
    command = [sys.executable, SCRIPT, tmp_path / "t.ipynb", "--scripts", tmp_path / "scripts"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    notebook = nbformat.read(tmp_path / "t.ipynb", as_version=4)
    nbformat.validate(notebook)
    cells = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    assert cells == [code.strip() for name in TUTORIAL.pages() for code in TUTORIAL.code(name)]
    for name in TUTORIAL.pages():
        text = (TUTORIAL.TUTORIAL / f"{name}.md").read_text(encoding="utf-8")
        assert text.count("```python") == len(TUTORIAL.code(name)) > 2
        script = (tmp_path / "scripts" / f"{name}.py").read_text(encoding="utf-8")
        compile(script, name, "exec")
        assert all(code in script for code in TUTORIAL.code(name))


def test_the_notebook_has_no_sphinx_syntax():
    cells = TUTORIAL.notebook()["cells"]
    texts = ["".join(each["source"]) for each in cells if each["cell_type"] == "markdown"]
    assert sum(text.count("\n# ") + text.startswith("# ") for text in texts) == 8
    for text in texts:
        assert not re.search(r"\{(func|class|doc|ref|download|figure|toctree)\}|:::|\.md\b", text)
        assert not re.search(r"^: ", text, re.MULTILINE)
        assert "Next:" not in text


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """Return the executed cells of the notebook, and of more cells that display its variables."""
    folder = tmp_path_factory.mktemp("notebook")
    notebook = nbformat.from_dict(TUTORIAL.notebook())
    displays = [nbformat.v4.new_code_cell(code) for code in [*SHOWN.values(), BAR]]
    notebook.cells += displays
    nbformat.write(notebook, folder / "tutorial.ipynb")
    names = folder / "tutorial.ipynb", folder / "executed.ipynb"
    children.run(EXECUTE, *names, NUMBA_NUM_THREADS="1")  # parallel loops take long to compile
    return nbformat.read(folder / "executed.ipynb", as_version=4).cells


def printed(cell):
    return "".join(each["text"] for each in cell["outputs"] if each.get("name") == "stdout")


@pytest.mark.compiled
def test_cells_print_the_output_in_their_comments(executed):
    of_tutorial = len(TUTORIAL.notebook()["cells"])
    checked = 0
    for cell in executed[:of_tutorial]:
        if cell["cell_type"] == "code":
            assert all(each.get("name") != "stderr" for each in cell["outputs"]), cell["outputs"]
            expected = [after or below for after, below in PRINTED.findall(cell["source"])]
            if expected:
                assert printed(cell).splitlines() == expected
                checked += len(expected)
    assert checked > 30


@pytest.mark.compiled
def test_displayed_objects_are_short(executed):
    shown = dict(zip(SHOWN, executed[-len(SHOWN) - 1 :], strict=False))
    for name, cell in shown.items():
        (output,) = (each["data"] for each in cell["outputs"])
        line, (rich,) = (
            output["text/plain"],
            [output[kind] for kind in output.keys() - {"text/plain"}],
        )
        assert max(len(rich), 5 * len(line)) < 700, name
        assert "\n" not in line
    assert shown["orbits"]["outputs"][0]["data"]["text/html"].count("<tr>") <= 8
    assert r"$\text{Suslov3D},\quad I_{1} = 4" in shown["body"]["outputs"][0]["data"]["text/latex"]
    many = shown["bodies"]["outputs"][0]["data"]
    assert r"\text{Suslov3D of shape (200,)}" in many["text/latex"]
    assert many["text/plain"] == "<Suslov3D of shape (200,): I1=(200,), I2=2.0, I13=-0.5, I23=-0.3>"


@pytest.mark.compiled
def test_the_progress_bar_of_a_notebook(executed):
    assert printed(executed[-1]) == "True\n"
    shown = json.dumps(executed[-1]["outputs"])
    assert "100%" in shown or "widget" in shown
