"""The rules that the package is built by, and the examples of its docstrings."""

import ast
import doctest
import importlib
import inspect
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import suslov_fast

PACKAGE = Path(suslov_fast.__file__).parent
CORE = sorted((PACKAGE / "_core").rglob("*.py"))
MODULES = [
    name
    for _, name, _ in pkgutil.walk_packages(suslov_fast.__path__, "suslov_fast.")
    if not name.endswith("__main__")
]
# What files of the core may import from the standard library beside numbers.
STANDARD = {
    "jit": {"types", "contextlib"},
    "cache": {"contextlib", "functools", "hashlib", "os", "pathlib", "pickle", "stat", "sys"},
}
PUBLIC = [getattr(suslov_fast, name) for name in suslov_fast.__all__]


def imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level if node.level else node.module.split(".")[0]


def test_options_of_numba_live_in_one_file():
    for path in PACKAGE.rglob("*.py"):
        if path.name != "jit.py":
            text = path.read_text(encoding="utf-8")
            assert not any(word in text for word in ("njit", "fastmath", "error_model", "nogil"))


@pytest.mark.parametrize("path", CORE, ids=lambda path: path.stem)
def test_the_core_stands_alone(path):
    """The cache on disk watches the files of the core and no others."""
    standard = STANDARD.get(path.stem, set())
    relative = {".", ".."} if path.parent.name != "_core" else {"."}
    numeric = {"llvmlite", "math", "numba", "numpy", "operator"}
    assert set(imports(path)) <= numeric | {"typing"} | relative | standard


@pytest.mark.parametrize("path", CORE, ids=lambda path: path.stem)
def test_formulas_hold_no_loops_and_kernels_do_not_raise(path):
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    assert not any(isinstance(node, ast.Raise) for node in nodes)
    if path.parent.name == "formulas":
        assert not any(isinstance(node, (ast.For, ast.While)) for node in nodes)


def test_the_reference_imports_nothing_from_the_package():
    assert set(imports(Path(__file__).parent / "naive.py")) == {"itertools", "mpmath"}


@pytest.mark.parametrize("name", MODULES)
def test_examples(name):
    module = importlib.import_module(name)
    assert doctest.testmod(module).failed == 0


@pytest.mark.parametrize("thing", PUBLIC, ids=lambda thing: thing.__name__)
def test_public_docstrings(thing):
    text = inspect.getdoc(thing)
    assert text
    if inspect.isfunction(thing):
        for section in ("Parameters", "Returns", "Raises", "Examples"):
            assert f"\n{section}\n---" in text
        for parameter in inspect.signature(thing).parameters:
            assert f"\n{parameter} : " in text or f"\n{parameter}, " in text or parameter == "self"


def test_typed():
    assert (PACKAGE / "py.typed").exists()


def test_import_brings_in_nothing_slow():
    code = "import sys, suslov_fast; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    for name in ("matplotlib", "tqdm", "suslov_fast._cli"):
        assert name not in loaded
