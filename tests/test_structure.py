"""The rules that the package is built by, and the examples of its docstrings."""

import ast
import doctest
import graphlib
import importlib
import inspect
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import children
import pytest

import suslov_fast

PACKAGE = Path(suslov_fast.__file__).parent
FORMULAS, KERNELS = (sorted((PACKAGE / room).glob("*.py")) for room in ("_formulas", "_kernels"))
MODULES = [
    name
    for _, name, _ in pkgutil.walk_packages(suslov_fast.__path__, "suslov_fast.")
    if not name.endswith("__main__")
]
PUBLIC = [getattr(suslov_fast, name) for name in suslov_fast.__all__]


def imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level if node.level else node.module.split(".")[0]


def test_options_of_numba_live_in_one_file():
    for path in PACKAGE.rglob("*.py"):
        if path.parts[-2:] != ("_jit", "options.py"):
            text = path.read_text(encoding="utf-8")
            assert not any(word in text for word in ("njit(", "fastmath", "error_model", "nogil"))


def test_one_file_speaks_llvm_through_the_documented_interface():
    speaking = {path.name for path in PACKAGE.rglob("*.py") if "llvmlite" in set(imports(path))}
    assert speaking <= {"instructions.py", "cache.py"}
    for path in PACKAGE.rglob("*.py"):
        internal = re.findall(r"numba\.(?:core\.(?!errors|types)|np)\w*", path.read_text("utf-8"))
        assert not internal, path


@pytest.mark.parametrize("path", [*FORMULAS, *KERNELS], ids=lambda path: path.stem)
def test_formulas_and_kernels_are_numbers_only(path):
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    assert set(imports(path)) <= {"math", "numba", "numpy", "typing", ".", ".."}
    assert not any(isinstance(node, ast.Raise) for node in nodes)
    if path in FORMULAS:
        assert not any(isinstance(node, (ast.For, ast.While)) for node in nodes)


def calls(nodes):
    """The calls in some parts of a file, as they are written."""
    for node in nodes:
        for inner in ast.walk(node):
            if isinstance(inner, ast.Call):
                yield ast.unparse(inner.func)


def parallel_loops(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.For) and ast.unparse(node.iter).startswith("prange("):
            yield node


# Memory that is not there ends a process in a loop over `prange`.
ALLOCATING = {"empty", "zeros", "ones", "full", "array", "copy", "any", "all", "sum", "tile"}


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.stem)
def test_parallel_loops_allocate_nothing(path):
    for loop in parallel_loops(path):
        names = {name.rpartition(".")[2] for name in calls(loop.body) if "." in name}
        assert not names & ALLOCATING


def test_parallel_loops_are_found():
    assert sum(1 for path in KERNELS for _ in parallel_loops(path)) > 3


def importing(path):
    """The modules of the package that a file imports, but for those that only types need."""
    parts = [PACKAGE.name, *path.relative_to(PACKAGE).with_suffix("").parts]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    checking = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and id(node) not in checking:
            base = parts[: len(parts) - node.level] if node.level else []
            base = [*base, *(node.module or "").split(".")] if node.module else base
            for alias in node.names:
                whole = ".".join([*base, alias.name])
                module = whole if whole in FILES else ".".join(base)
                if module in FILES:
                    yield module


def module_name(path):
    parts = [PACKAGE.name, *path.relative_to(PACKAGE).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_name(path): path for path in PACKAGE.rglob("*.py")}


def test_no_two_modules_import_each_other():
    """Be it through others, or where a function is called; all may ask for the version."""
    graph = {name: set(importing(path)) - {PACKAGE.name} for name, path in FILES.items()}
    assert sum(map(len, graph.values())) > 100
    graphlib.TopologicalSorter(graph).prepare()


def layer(name):
    """The folder of a module, or its name where it lies in none."""
    return name.split(".")[1] if "." in name else ""


# The rooms from the bottom up: a module imports from its own room and from those below.
ROOMS = """
    _docs _checks _jit _formulas _kernels _bodies _engine _maps _states _space _runs _ensemble _show
    integrability _cli __main__
""".split()
# The method `Trajectories.plot`.
EXCEPTIONS = {("_runs", "_show")}


def test_imports_point_down():
    for name, path in FILES.items():
        own = layer(name)
        for other in {layer(each) for each in importing(path)} - {own, ""} if own else ():
            down = ROOMS.index(other) < ROOMS.index(own)
            assert down or (own, other) in EXCEPTIONS, f"{name} imports from {other}"


def test_the_reference_imports_nothing_from_the_package():
    assert set(imports(Path(__file__).parent / "naive.py")) <= {"fractions", "itertools", "mpmath"}


@pytest.mark.parametrize("name", MODULES)
def test_examples(name):
    module = importlib.import_module(name)
    assert doctest.testmod(module).failed == 0


@pytest.mark.parametrize("thing", PUBLIC, ids=lambda thing: thing.__name__)
def test_public_docstrings(thing):
    text = inspect.getdoc(thing)
    assert text
    assert "%(" not in text
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
    ours = ("_cli", "_ensemble", "_show", "_states", "_runs.schema")
    slow = {"matplotlib", "scipy.linalg", "tqdm"}
    assert "suslov_fast._runs.iterate" not in loaded
    assert not (slow | {f"suslov_fast.{name}" for name in ours}) & set(loaded)


def test_names_are_imported_when_they_are_asked_for():
    code = """
        import sys, suslov_fast
        assert set(suslov_fast.__all__) <= set(dir(suslov_fast))
        assert "suslov_fast._space.vectors" not in sys.modules
        momentum = suslov_fast.momentum
        assert momentum is sys.modules["suslov_fast._space.vectors"].momentum
        from suslov_fast import *
        assert all(name in globals() for name in suslov_fast.__all__)
    """
    children.run(code)
    with pytest.raises(AttributeError, match="module 'suslov_fast' has no attribute 'nothing'"):
        _ = suslov_fast.nothing
