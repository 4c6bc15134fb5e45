"""The rules of the architecture, and the examples in docstrings."""

import ast
import doctest
import graphlib
import importlib
import inspect
import re
from collections import Counter
from pathlib import Path
from types import NoneType
from typing import get_args

import children
import pytest

import suslov_fast
from suslov_fast._bodies.base import Body

PACKAGE = Path(suslov_fast.__file__).parent


def parts_of(path):
    return [PACKAGE.name, *path.relative_to(PACKAGE).with_suffix("").parts]


TEXTS = {path: path.read_text(encoding="utf-8") for path in sorted(PACKAGE.rglob("*.py"))}
FILES = {".".join(parts_of(path)).removesuffix(".__init__"): path for path in TEXTS}
NODES = {path: list(ast.walk(ast.parse(text))) for path, text in TEXTS.items()}
FORMULAS = [path for path in TEXTS if path.parent.name == "_formulas"]
KERNELS = [path for path in TEXTS if path.parent.name == "_kernels"]
PUBLIC = [getattr(suslov_fast, name) for name in suslov_fast.__all__]


def imports(nodes):
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level if node.level else node.module.split(".")[0]


def test_options_of_numba_live_in_one_file():
    for path, text in TEXTS.items():
        if path.parts[-2:] != ("_jit", "options.py"):
            assert not any(word in text for word in ("njit(", "fastmath", "error_model", "nogil"))


def test_llvmlite_and_internals_of_numba_are_used_in_one_file_each():
    for path, nodes in NODES.items():
        if path.parts[-2:] != ("_jit", "llvm.py"):
            assert "llvmlite" not in set(imports(nodes)), path
        if path.parts[-2:] != ("_jit", "cache.py"):
            froms = [node for node in nodes if isinstance(node, ast.ImportFrom)]
            named = {f"{node.module}.{each.name}" for node in froms for each in node.names}
            internal = re.compile(r"\bnumba\.(?:core\.(?!errors\b|types\b)|np\b)")
            assert not any(internal.search(each) for each in (*named, TEXTS[path])), path


# Exceptions such as MemoryError are lost in a parallel loop.
ALLOCATING = {"empty", "zeros", "ones", "full", "array", "copy", "any", "all", "sum", "tile"}


def test_formulas_and_kernels_are_pure_numerics_and_allocate_nothing():
    for path in (*FORMULAS, *KERNELS):
        nodes = NODES[path]
        allowed = {"collections", "math", "numba", "numpy", "types", "typing", ".", ".."}
        assert set(imports(nodes)) <= allowed, path
        assert not any(isinstance(node, ast.Raise) for node in nodes), path
        loops = any(isinstance(node, (ast.For, ast.While)) for node in nodes)
        assert not loops or path in KERNELS, path
        calls = {ast.unparse(node.func) for node in nodes if isinstance(node, ast.Call)}
        assert not {name.rpartition(".")[2] for name in calls if "." in name} & ALLOCATING, path


def test_only_inlined_functions_return_memory_on_the_stack():
    """LLVM may use the memory of another function again after its return."""
    functions = [
        (node, {ast.unparse(each) for each in node.decorator_list})
        for path in (*FORMULAS, *KERNELS)
        for node in NODES[path]
        if isinstance(node, ast.FunctionDef)
    ]
    sources = {"stack", "rows_of"}
    for function, how in functions:
        nodes = [*ast.walk(function)]
        calls = {ast.unparse(node.func) for node in nodes if isinstance(node, ast.Call)}
        if calls & {"stack", "rows_of"} and "inlined" in how:
            sources.add(function.name)
        elif calls & sources:
            returned = [node.value for node in nodes if isinstance(node, ast.Return)]
            assert not any(returned), function.name
    assert len(sources) > 2


def importing(path):
    """Yield the modules that a file imports from, also for type checkers only."""
    for node in NODES[path]:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name == PACKAGE.name)
        if isinstance(node, ast.ImportFrom):
            base = parts_of(path)[: -node.level] if node.level else []
            base += filter(None, [node.module])
            for alias in node.names:
                whole = ".".join([*base, alias.name])
                if alias.name != "__version__":
                    yield whole if whole in FILES else ".".join(base)


# Layers from the bottom up: a module imports only from its own layer and those below.
LAYERS = """
    _docs _checks _jit _formulas _kernels _bodies _engine _maps _states _space _runs _ensemble _show
    compiled integrability _cli __main__
""".split()
# The method `Trajectories.plot`.
EXCEPTIONS = {("_runs", "_show")}


def test_imports_follow_the_layers_without_cycles():
    """Imports in functions and for types count, too; any module may import the version."""
    of_package = {n for n, path in FILES.items() if PACKAGE.name in importing(path)}
    assert {name.split(".")[1] for name in of_package} == {"_cli"}
    ours = FILES.keys() - {PACKAGE.name}
    graph = {name: ours & set(importing(path)) for name, path in FILES.items()}
    assert sum(map(len, graph.values())) > 100
    graphlib.TopologicalSorter(graph).prepare()
    for name in ours:
        own = name.split(".")[1]
        for other in {each.split(".")[1] for each in graph[name]} - {own}:
            down = LAYERS.index(other) < LAYERS.index(own)
            assert down or (own, other) in EXCEPTIONS, f"{name} imports from {other}"


# What every map, and every class of bodies, has under the same name.
OF_EACH = {"D", "State", "Constants", "QUANTITIES"}


def names_defined(node):
    if isinstance(node, ast.ClassDef):
        return [node.name]
    stored = ast.walk(node) if isinstance(node, (ast.Assign, ast.AnnAssign)) else ()
    names = (each for each in stored if isinstance(each, ast.Name))
    return [each.id for each in names if isinstance(each.ctx, ast.Store)]


def test_classes_and_constants_of_one_name_are_defined_once():
    nodes = (node for text in TEXTS.values() for node in ast.parse(text).body)
    defined = Counter(name for node in nodes for name in names_defined(node))
    ours = {name for name in defined if name[0] != "_" and name != name.lower()} - OF_EACH
    assert len(ours) > 100
    assert {name for name in ours if defined[name] > 1} == set()


def test_the_reference_imports_nothing_from_the_package():
    text = (Path(__file__).parent / "naive.py").read_text(encoding="utf-8")
    allowed = {"fractions", "functools", "itertools", "mpmath"}
    assert set(imports(ast.walk(ast.parse(text)))) <= allowed


@pytest.mark.parametrize("name", [name for name, path in FILES.items() if ">>>" in TEXTS[path]])
def test_examples(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0


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
    for of_parameter in re.findall(r"^\w+ : .*\n(.*)", text, re.MULTILINE):
        assert of_parameter.startswith(("    ", "Returns")) or not of_parameter, of_parameter


ORDER = ["Suslov3D", "SuslovND", "SuslovGyrostat", "QuadraticField"]


def test_docstrings_name_the_bodies_of_annotations():
    """Where the annotation is `Body`, they name those that the table of quantities has."""
    for thing in filter(inspect.isfunction, PUBLIC):
        function = inspect.unwrap(thing)
        hint = eval(function.__annotations__.get("body", "None"), function.__globals__)
        if hint not in (None, Body):
            classes = {*(get_args(hint) or [hint])} - {NoneType}
            *others, last = sorted((each.__name__ for each in classes), key=ORDER.index)
            kinds = f"{', '.join(others)} or {last}" if others else last
            assert f"\nbody : {kinds}" in inspect.getdoc(thing), thing
    assert "\nbody : Suslov3D, SuslovND or SuslovGyrostat\n" in suslov_fast.criticality.__doc__


def test_without_docstrings(tmp_path):
    """`python -OO`, where `assert` does nothing, either."""
    code = """
        import sys, suslov_fast, suslov_fast.integrability as lab
        from suslov_fast._cli import main
        for module in (suslov_fast, lab):
            print([getattr(module, name).__doc__ for name in module.__all__ if name != "PICTURES"])
        for words in (["--help"], ["run", "--help"], sys.argv[1:]):
            try:
                main(words)
            except SystemExit as end:
                print("status", end.code)
    """
    words = "run --I1=4 --I2=1 --I13=-0.5 --I23=-0.3 --omega0=1,0.5 --eps=0.2 --steps=40 -o"
    settings = {
        "PYTHONOPTIMIZE": "2",
        "NUMBA_DISABLE_JIT": "1",
    }  # other code would be compiled anew
    text = children.run(code, *words.split(), tmp_path / "run.npz", **settings)
    assert text.count("None") > len(PUBLIC) // 2, text
    assert text.count("status 0") == 3, text
    assert (tmp_path / "run.npz").exists()


def test_typed():
    assert (PACKAGE / "py.typed").exists()


def test_names_are_imported_when_they_are_asked_for():
    code = """
        import sys, suslov_fast
        ours = "_runs.iterate", "_cli", "_ensemble", "_show", "_states", "_runs.schema"
        late = {"matplotlib", "scipy.linalg", "tqdm"} | {f"suslov_fast.{name}" for name in ours}
        assert not late & sys.modules.keys()
        modules = "compiled", "integrability"
        assert set(dir(suslov_fast)) == {*suslov_fast.__all__, "__version__", *modules}
        assert "suslov_fast._space.vectors" not in sys.modules
        momentum = suslov_fast.momentum
        assert momentum is sys.modules["suslov_fast._space.vectors"].momentum
        from suslov_fast import *
        assert all(name in globals() for name in suslov_fast.__all__)
    """
    children.run(code)
    with pytest.raises(AttributeError, match="module 'suslov_fast' has no attribute 'nothing'"):
        _ = suslov_fast.nothing
