"""README and pages run and print what their comments say; their pictures and links are there."""

import contextlib
import gc
import io
import json
import math
import re
import runpy
import shutil
import subprocess
import sys
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import matplotlib.pyplot as plt
import pytest
from last_digits import PROCESSORS, other_last_digits
from PIL import Image

import suslov_fast
from suslov_fast.integrability import zoo
from suslov_fast.maps import kernel_calls

DOCS = Path(__file__).parents[2] / "docs"
README = DOCS.parent / "README.md"
PACKAGE = Path(suslov_fast.__file__).parent
BLOCK = re.compile(r"^```(.*?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
IMAGE = re.compile(r"!\[[^\]]+\]\(([^)]+\.png)\)")
HOWTO = (DOCS / "howto" / "index.md").read_text("utf-8")


def order(path):
    """Sort key: how-tos follow the order of their index, since they share a folder."""
    return path.parent, HOWTO.find(f"\n{path.stem}\n"), path


BUILT = {"_build", "reference"}
PAGES = [path for path in sorted(DOCS.rglob("*.md"), key=order) if not BUILT & {*path.parts}]
# Output in comments: after the call, or on separate lines below it.
PRINTED = re.compile(r"^\s*(?:print\(.*)?\)  # (.*)$|^# (.*)$", re.MULTILINE)


# What takes less time and prints the same, by page or script.
SHORTER = {
    "compiled.md": [("parallel=True", "parallel=False")],  # `test_compiled` has parallel loops
    "equations.md": [("20_000, transient=5_000", "200, transient=50")],
    "runs.md": [("range(0, 400, 8)", "range(0, 400, 80)")],
    "kinetics.py": [
        ("np.linspace(0, 900, 3000)", "np.linspace(0, 900, 30)"),
        ("np.linspace(0.6, 1.5, 100)", "np.linspace(0.6, 1.5, 4)"),
        ("range(100)", "range(4)"),
    ],
    "orders.py": [
        ("BATCH, UNTIL, LANES = 1024, 100.0, 16", "BATCH, UNTIL, LANES = 16, 1.0, 16"),
        ("eps, 1_000_000, save_every=100", "eps, 1000, save_every=100"),
        ("range(1, 7)", "range(1, 5)"),
        ('by_steps("order8", 6400)', 'by_steps("order8", 500)'),
    ],
    "sizes.py": [
        ("np.arange(3, 12)", "np.arange(3, 5)"),
        ("[8, 16, 32, 48, 64, 96]", "[8]"),
        ("[16, 64, 256, 576, 1024, 2025]", "[16]"),
        ("200_000 //", "2000 //"),
    ],
    "zoo.py": [("if eps is not None", "if name in ('Suslov body', 'Lorenz')"), ("50_000", "500")],
}


def all_blocks(path):
    """Kinds and texts of the blocks of a page, in their shorter form."""
    text = path.read_text("utf-8")
    for old, new in SHORTER.get(path.name, ()):
        assert old in text, (path, old)
        text = text.replace(old, new)
    return BLOCK.findall(text)


def blocks(path, language):
    return [code for found, code in all_blocks(path) if found == language]


def run(code, name, names):
    """Run a block, and compare what it prints with what its comments say, if they do."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, name, "exec"), names)
    if expected := [after or below for after, below in PRINTED.findall(code)]:
        assert printed.getvalue().splitlines() == expected


def script_of(name):
    return SimpleNamespace(**runpy.run_path(str(DOCS / f"{name}.py")))


def sizes_of_pictures(name):
    files = [path.read_bytes() for path in sorted((DOCS / "images").glob(f"{name}_[0-9].png"))]
    return [Image.open(io.BytesIO(file)).size for file in files]


def sizes_of(figures):
    dpi = script_of("draw").DPI
    return [tuple((dpi * each.get_size_inches()).round()) for each in figures]


@pytest.mark.compiled
def test_the_readme(tmp_path, monkeypatch):
    """Run all blocks of the README in order, as a reader does, and serially.

    Each Python block is a program of its own.
    """
    matplotlib.use("Agg")
    plt.close("all")
    monkeypatch.setattr(kernel_calls, "STEPS_OF_SERIAL_CALL", math.inf)
    monkeypatch.chdir(tmp_path)
    for kind, code in all_blocks(README):
        if kind == "python":
            run(code, "README.md", {})
    drawn = [plt.figure(number) for number in plt.get_fignums()]
    # Home has the same blocks, in another order.
    assert sorted(sizes_of(drawn)) == sorted(sizes_of_pictures("index"))
    plt.close("all")


@pytest.mark.compiled
@pytest.mark.slow
@pytest.mark.parametrize("seed", PROCESSORS[1:])
def test_the_readme_on_other_processors(tmp_path, monkeypatch, seed):
    matplotlib.use("Agg")
    monkeypatch.setattr(kernel_calls, "STEPS_OF_SERIAL_CALL", math.inf)
    monkeypatch.chdir(tmp_path)
    with other_last_digits(seed):
        for code in blocks(README, "python"):
            run(code, "README.md", {})
    plt.close("all")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("howto")


# Pages of long reports, of many orbits, and of loops that take long to compile; other tests have
# shorter forms.
LONG = "report.md", "discretization.md", "compiled.md", "confinement.md"
LONG += "crossings.md", "diagrams.md", "many.md", "large.md", "poles.md", "tolerances.md"
LONG += "letters.md", "stability.md", "theorems-with-letters.md"


@pytest.mark.compiled
@pytest.mark.sampled(6)
@pytest.mark.slow_cases(*LONG)
@pytest.mark.parametrize(
    "path", [path for path in PAGES if blocks(path, "python")], ids=attrgetter("name")
)
def test_page(path, folder, tmp_path, monkeypatch):
    """Run the Python blocks of a page in sequence; how-tos share a folder, as on one machine.

    A page that uses LAPACK prints the same on other processors.
    """
    matplotlib.use("Agg")
    plt.close("all")
    monkeypatch.setattr(
        kernel_calls, "STEPS_OF_SERIAL_CALL", math.inf
    )  # parallel loops take long to compile
    start = folder if path.parent.name == "howto" else tmp_path / "start"
    start.mkdir(exist_ok=True)
    before = shutil.copytree(start, tmp_path / "before")  # a page does not overwrite its files
    for seed in PROCESSORS:
        monkeypatch.chdir(start if seed is None else shutil.copytree(before, tmp_path / str(seed)))
        plt.close("all")
        names = {"__name__": "__main__"}
        with other_last_digits(seed) as called:
            for code in blocks(path, "python"):
                run(code, path.name, names)
        if not called:
            break
    if path.stem in script_of("draw").PAGES:
        figures = [plt.figure(number) for number in plt.get_fignums()]
        assert sizes_of(figures) == sizes_of_pictures(path.stem)


@pytest.mark.parametrize("path", [*PAGES, README], ids=attrgetter("name"))
def test_texts_links_and_kinds_of_blocks(path):
    """Blocks are of known kinds, links and files exist, and nothing needs Sphinx to be read."""
    text = path.read_text(encoding="utf-8")
    if path.stem not in {"README", "changelog"}:  # the first line says for whom a page is
        assert re.match("# .*\n\nFor ", text)
    if path.parent.name in {"howto", "theory"} and path.stem not in {"index", "first_ode"}:
        assert "\n**See also**: [" in text
    kinds = {"python", "py", "sh", "text", "bibtex", "{toctree}", "{include}"}  # py: a fragment
    kinds |= {"{eval-rst}"} if path.stem == "api" else set()
    assert {kind.split()[0] for kind, _ in BLOCK.findall(text)} <= kinds
    assert not re.search(r"\{\w+\}`|^:::", text, re.MULTILINE)
    codes = [code for kind, code in BLOCK.findall(text) if kind != "sh setup"]
    lines = [line for code in codes for line in code.splitlines()]
    assert [line for line in lines if len(line) > 88] == []  # a box of code holds 88
    assert "install 'suslov_fast" not in text  # there is no index to install from
    for file in re.findall(r"`(\w+/\w+\.py)`", text):
        assert (PACKAGE / file).exists() or (DOCS.parent / file).exists(), file
    for target, place in re.findall(r"\]\(([^)#:\s]*)(?:#([^)]*))?\)", text):
        found = path.parent / target if target else path
        assert found.exists(), target
        if place and found.suffix == ".md":
            heads = re.findall(r"^#+ (.*)$", found.read_text("utf-8"), re.MULTILINE)
            anchors = [re.sub(r"[^\w\- ]", "", head).lower().replace(" ", "-") for head in heads]
            assert place in anchors, (target, place)


def test_troubleshooting_has_each_status():
    page = (DOCS / "howto" / "troubleshooting.md").read_text("utf-8")
    found = re.findall(r"^\| ([\u2212\d]+) `(\w+)`", page, re.MULTILINE)
    codes = {name: int(number.replace("\N{MINUS SIGN}", "-")) for number, name in found}
    assert codes == {status.name: status.value for status in suslov_fast.Status}


def test_pictures_are_committed_and_drawn_by_a_script():
    """Each is shown by a page, and named after a script or page; together they are small."""
    draw, images = script_of("draw"), sorted((DOCS / "images").glob("*.png"))
    shown = {
        (path.parent / target).resolve()
        for path in (*PAGES, README)
        for target in IMAGE.findall(path.read_text(encoding="utf-8"))
        if "bench" not in target
    }
    assert shown == {path.resolve() for path in images}
    drawn = {path.stem.rpartition("_")[0] for path in images} - {"explore"}  # of a browser
    assert drawn == {*draw.SCRIPTS, *draw.PAGES}
    assert sum(path.stat().st_size for path in images) <= 3_500_000


@pytest.mark.compiled
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Animation was deleted")
@pytest.mark.parametrize("name", sorted(script_of("draw").SCRIPTS))
def test_picture(name):
    matplotlib.use("Agg")
    script = script_of("draw")
    for seed in PROCESSORS if name == "potentials" else PROCESSORS[:1]:
        printed = io.StringIO()
        plt.close("all")
        with contextlib.redirect_stdout(printed), other_last_digits(seed) as called:
            figures = script.figures_of(script.run(name, SHORTER.get(f"{name}.py", ())))
        if name == "potentials":  # its comments are what it prints
            expected = PRINTED.findall(script.SCRIPTS[name].read_text(encoding="utf-8"))
            assert printed.getvalue().splitlines() == [after or below for after, below in expected]
        if not called:
            break
    for each in figures:
        each.canvas.draw()
    assert sizes_of(figures) == sizes_of_pictures(name) != []
    plt.close("all")
    del figures, each
    gc.collect()  # an animation, while its warning is ignored


@pytest.mark.parametrize("name", ["suslov", "first_ode", "side_by_side"])
def test_a_page_as_a_notebook(tmp_path, name):
    script = DOCS / "as_notebook.py"
    for target in (f"{name}.ipynb", f"{name}.py"):
        subprocess.run([sys.executable, script, tmp_path / target], check=True, timeout=120)
    notebook = json.loads((tmp_path / f"{name}.ipynb").read_text(encoding="utf-8"))
    cells = [each["source"] for each in notebook["cells"] if each["cell_type"] == "code"]
    codes = blocks(script_of("as_notebook").PAGES[name], "python")
    assert cells == [code.strip() for code in codes]
    assert (tmp_path / f"{name}.py").read_text(encoding="utf-8") == "\n".join(codes)


SOME = ("Suslov gyrostat", "Lorenz")
# Other tests have reports of the other systems, of systems with the same formulas, or longer ones.
OTHERS = ["Nahm, octahedral", "Nambu", "Volterra chain, N = 4", "Lotka-Volterra", "McMillan"]
OTHERS += ["Zhukovsky-Volterra, three betas", "body in a fluid", "generic planar field"]
OTHERS += ["Hone-Quispel"]


@pytest.mark.compiled
@pytest.mark.parametrize("names", [SOME, pytest.param(OTHERS, marks=pytest.mark.slow, id="others")])
def test_rows_of_the_zoo(names):
    script = script_of("zoo_table")
    table = script.lines()
    assert [line.split(" | ")[0] for line in table] == [f"| {name}" for name in zoo()]
    for name in names:
        assert script.row(name) in table


def test_the_reference_has_every_public_name():
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^   (\w+)$", text, re.MULTILINE)) == sorted(suslov_fast.__all__)
    named = re.findall(r"^   integrability\.(\w+)$", text, re.MULTILINE)
    assert {*named, "Field"} == {*suslov_fast.integrability.__all__}


def test_the_citation_is_of_this_version():
    text = (DOCS.parent / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", text, re.MULTILINE).group(1) == suslov_fast.__version__
    (year,) = re.findall(r"^date-released: (\d+)", text, re.MULTILINE)
    page = (DOCS / "bibliography.md").read_text("utf-8")
    assert f"version = {{{suslov_fast.__version__}}},\n  year    = {{{year}}}" in page
