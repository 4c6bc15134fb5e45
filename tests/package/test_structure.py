"""The rules of the architecture, and the examples in docstrings."""

import ast
import doctest
import graphlib
import importlib
import inspect
import re
from functools import cache
from importlib.util import find_spec
from itertools import takewhile
from pathlib import Path

import children
import pytest
from last_digits import PROCESSORS, other_last_digits

import suslov_fast

PACKAGE = Path(suslov_fast.__file__).parent
TEXTS = {path: path.read_text(encoding="utf-8") for path in sorted(PACKAGE.rglob("*.py"))}


@cache
def nodes_of(path):
    return list(ast.walk(ast.parse(TEXTS[path])))


def name_of(path):
    parts = [PACKAGE.name, *path.relative_to(PACKAGE).with_suffix("").parts]
    return ".".join(parts).removesuffix(".__init__")


FILES = {name_of(path): path for path in TEXTS}


def importing(path):
    """Yield the modules that a file imports from, in functions, too; not for type checkers alone.

    A public name of the package counts as the module that defines it.
    """
    own = [PACKAGE.name, *path.relative_to(PACKAGE).parts]
    checking = [
        node
        for node in nodes_of(path)
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"
    ]
    unseen = {each for node in checking for part in node.body for each in ast.walk(part)}
    roots = set()  # names of the package in this file
    for node in nodes_of(path):
        if node in unseen:
            continue
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
                roots |= {alias.asname or alias.name} & {"sf", PACKAGE.name}
        elif isinstance(node, ast.ImportFrom):
            base = own[: -node.level] if node.level else []
            base += filter(None, [node.module])
            for alias in node.names:
                whole = ".".join([*base, alias.name])
                yield whole if whole in FILES else ".".join(base)
                if base == [PACKAGE.name]:
                    yield defining(alias.name)
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "import_module":
            yield from (each.value for each in node.args if isinstance(each, ast.Constant))
    for node in nodes_of(path):
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") in roots:
            yield defining(node.attr)


def defining(name):
    """Return the module that defines a public name."""
    return PACKAGE.name + suslov_fast.MODULE_OF.get(name, "")


# Rooms from the bottom up, and those from which each imports: all below it, and no others.
ARROWS = {
    "core": "",
    "words": "",
    "checks": "core",
    "keywords": "words",
    "errors": "",
    "versions": "keywords",
    "status": "core checks",
    "calls": "checks",
    "fields": "core words checks keywords",
    "maps": "core checks calls status fields",
    "bodies": "core checks keywords calls errors status fields maps",
    "kahan": "checks keywords fields maps bodies",
    "results": "core checks keywords errors status fields maps bodies",
    "orbits": "core checks keywords calls maps bodies kahan results",
    "motions": "core checks keywords calls errors status fields maps bodies results",
    "ensembles": "checks keywords calls status fields orbits results motions",
    "plots": "checks keywords status fields bodies results orbits motions",
    "integrability": "core checks keywords fields bodies",
    "compiled": "core checks keywords fields maps motions",
    "waiting": "",
    "command": "words waiting fields bodies results orbits motions plots integrability",
    "__main__": "command",
}


# The same for the rooms of the core.
IN_CORE = {
    "cached": "",
    "expressions": "cached",
    "hybrid": "cached expressions",
    "numba": "cached expressions",
    "suslov": "numba",
    "llvm": "expressions numba",
    "maps": "cached expressions numba llvm",
    "flow": "cached expressions hybrid numba llvm maps",
}


@pytest.mark.parametrize(("place", "table"), [("", ARROWS), (".core", IN_CORE)])
def test_imports_follow_the_arrows_without_cycles(place, table):
    """An arrow that no import uses any more goes from the table, too."""
    ours = FILES.keys() - {PACKAGE.name}
    graph = {name: ours & set(importing(path)) for name, path in FILES.items()}
    graphlib.TopologicalSorter(graph).prepare()
    inside = f"{PACKAGE.name}{place}."

    def room(name):
        return name.removeprefix(inside).split(".")[0]

    arrows = {name: set() for name in table}
    for name in (name for name in ours if name.startswith(inside)):
        others = {room(other) for other in graph[name] if other.startswith(inside)}
        arrows[room(name)] |= others - {room(name)}
    assert arrows == {name: set(names.split()) for name, names in table.items()}
    rooms = list(table)
    for name, others in arrows.items():
        assert all(rooms.index(other) < rooms.index(name) for other in others), name


IN_TICKS = re.compile(r"(?<![`:\w])`([A-Za-z_][\w/]*(?:\.\w+)+)`(?!`)")
# Parts of what a text calls by a letter or a word of its own.
OF_OBJECTS = "body f work carried np numba dataclasses xarray".split()


def test_names_in_ticks_are_there():
    """Files, and dotted names, in docstrings and pages for developers: none has moved or gone."""
    files = [path.relative_to(children.ROOT).as_posix() for path in (children.ROOT).glob("docs/*")]
    files += [path.relative_to(PACKAGE.parent).as_posix() for path in PACKAGE.rglob("*.py*")]
    files += [path.relative_to(children.ROOT).as_posix() for path in children.HERE.rglob("*.py")]
    pages = [children.ROOT / f"docs/{name}.md" for name in ("architecture", "extend")]
    documents = [(page, page.read_text("utf-8")) for page in pages]
    words = {*OF_OBJECTS, *(word for name in FILES for word in name.split("."))}
    for path in TEXTS:
        for node in nodes_of(path):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
                documents.append((path, ast.get_docstring(node) or ""))
            words |= {str(getattr(node, key, None)) for key in ("name", "attr", "id", "arg")}
    found = [(path.name, name) for path, text in documents for name in IN_TICKS.findall(text)]
    assert len(found) > 100
    for _, name in found:
        parts = name.split(".")
        is_file = any(f"/{file}".endswith(f"/{name}") for file in [*files, "CHANGELOG.md"])
        assert is_file or parts[0] in OF_OBJECTS or {*parts} <= words, name


OF_NUMBA = "decorators threads interrupts cache arrays intrinsics".split()
COMPILING = [PACKAGE / "core/llvm/compiler.py"]
COMPILING += [PACKAGE / f"core/numba/{name}.py" for name in OF_NUMBA]


def test_numba_is_chosen_in_one_file():
    """Only core/numba/decorators.py names options; four others speak LLVM."""
    words = re.compile(r"njit\(|numba\.(gu)?vectorize|error_model|nogil|llvmlite|numba\.core\b")
    for path, text in TEXTS.items():
        if path not in [*COMPILING, PACKAGE / "versions.py"]:
            assert not words.search(text), path
    loops = [path for path, text in TEXTS.items() if "prange(" in text]
    assert [path.name for path in loops] == ["decorators.py"]


# What the core takes of the standard library: nothing that reads, writes or waits.
PURE = (
    "array collections contextlib enum functools hashlib heapq inspect itertools math operator "
    "struct threading types typing"
).split()


def test_the_core_is_pure_numerics():
    for path in TEXTS:
        if path.is_relative_to(PACKAGE / "core") and path not in COMPILING:
            assert not any(isinstance(node, ast.Raise) for node in nodes_of(path)), path
            modules = {each.split(".")[0] for each in importing(path)}
            assert modules <= {"suslov_fast", "numba", "numpy", "scipy", *PURE}


# Files that call LAPACK or BLAS, whose last digits depend on the processor, and for what: no orbit
# goes on from them. `maps/ordered_algebra.py` has products and decompositions with one order of
# sums.
OF_LAPACK = {
    "bodies/adapted_basis": "checks of tensors; the sign of a determinant",
    "bodies/body": "results: vectors in space",
    "bodies/formulas_nd": "results: eigenvalues",
    "bodies/rigid": "results: an interval of I3",
    "checks": "a check: rotations",
    "core/maps/superlu": "solutions that are refined with twice as many digits",
    "fields/lagrangian": "products of symbols; a decision: whether a matrix is definite",
    "fields/linear_algebra": "products of symbols",
    "fields/mass": "a check: the condition number",
    "fields/script_functions": "functions that f calls",
    "fields/symbols": "products of symbols",
    "integrability/degrees_of_iterates": "products of integers",
    "integrability/symmetries": "products of integers",
    "integrability/zoo": "products of symbols",
    "kahan": "a check: fixed points",
    "maps/derivatives": "results: growth of tangent vectors along orbits of large maps",
    "maps/formulas": "results: determinants and eigenvalues",
    "motions/equations_at_rest": "roots by Newton's method, ranks",
    "motions/equilibria": "eigenvalues",
    "motions/periodic_orbits": "multipliers, ranks",
    "motions/shooting": "roots by Newton's method, ranks",
    "motions/tangents": "a shift, rounded to a power of 2",
    "plots/phase": "points of planes",
    "results/figures": "lengths of lines",
}


def test_no_orbit_goes_on_from_last_digits_of_lapack():
    found = set()
    for path in TEXTS:
        for node in nodes_of(path):
            is_product = isinstance(getattr(node, "op", None), ast.MatMult)
            of_module = isinstance(node, ast.ImportFrom) and "linalg" in (node.module or "")
            if is_product or of_module or getattr(node, "attr", "") in ("linalg", "einsum"):
                found.add(path.relative_to(PACKAGE).with_suffix("").as_posix())
    assert found == {*OF_LAPACK}


# Numbers in rooms with `tolerances.py` that stand beside their formulas: tables, marks, masks.
BESIDE_FORMULAS = {
    "core/expressions/dense_product": "ROWS_AT_ONCE",
    "core/expressions/elementary": "LARGE_ANGLE _LEAST_NORMAL _ONE _ROOT_HALF _SHIFT",
    "core/expressions/orthonormal_frame": "SHIFT",
    "core/flow/events/actions": "LEAST_POSITIVE STAYS",
    "core/flow/events/branch_choice": "_BEFORE",
    "core/flow/growing_components": "RELATIVE",
    "core/flow/held": "OF_ANOTHER _ENDLESS",
    "core/flow/memory": "BEGINS UNKEPT",
    "core/hybrid/double_crossings": "MIDDLE",
    "core/maps/dense": "LANES",
    "core/maps/superlu": "SPLITTER",
    "core/hybrid/event_formulas": "GAP OF_SURFACE",
    "fields/equation_text": "_CALL _UNARY",
    "fields/identities": "_FIRST_ROOT",
    "fields/latex": "_ATOM",
    "fields/namespaces": "_OF_PYTHON",
    "maps/orders": "_SUZUKI",
}


def numbers_of(path):
    """Yield the names of the numbers that a file defines; numbers in tables have no name."""
    for node in ast.parse(TEXTS[path]).body:
        if isinstance(node, ast.Assign):
            [target] = node.targets
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = zip(target.elts, node.value.elts, strict=True)
            for name, value in pairs:
                parts = [*ast.walk(value)]
                kinds = ast.Constant, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop
                constants = [part.value for part in parts if isinstance(part, ast.Constant)]
                is_number = constants and all(type(a) in (int, float) for a in constants)
                if is_number and all(isinstance(part, kinds) for part in parts):
                    yield name.id


def test_tolerances_have_one_place_and_one_name():
    rooms = [path for path in TEXTS if path.name == "tolerances.py"]
    owners = [(name, path) for path in rooms for name in numbers_of(path)]
    assert len({name for name, _ in owners}) == len(owners) > 100
    read = {
        a for path, text in TEXTS.items() if path not in rooms for a in re.findall(r"\w+", text)
    }
    assert {name for name, _ in owners} <= read
    beside = {}
    for path in TEXTS:
        in_room = path not in rooms and any(path.is_relative_to(room.parent) for room in rooms)
        if names := in_room and " ".join(sorted(numbers_of(path))):
            beside[path.relative_to(PACKAGE).with_suffix("").as_posix()] = names
    assert beside == BESIDE_FORMULAS


def test_arrays_live_longer_than_those_without_reference_counts():
    """Numba frees an array after its last use, which has to be `keep` where a function made it."""
    kept_somewhere = set()
    for path in (path for path, text in TEXTS.items() if "uncounted(" in text):
        for each in (node for node in nodes_of(path) if isinstance(node, ast.FunctionDef)):
            calls = [node for node in ast.walk(each) if isinstance(node, ast.Call)]
            calls = [call for call in calls if ast.unparse(call.func) == "uncounted"]
            made = {part.id for call in calls for part in ast.walk(call) if hasattr(part, "id")}
            if {"kernel", "for_users"} & {ast.unparse(word) for word in each.decorator_list}:
                made -= {argument.arg for argument in each.args.args}
            ends = takewhile(lambda line: "keep(" in line, reversed(ast.unparse(each).split("\n")))
            kept = {line.strip()[len("keep(") : -1] for line in ends}
            assert kept == made - {"uncounted"}, (path, each.name)
            kept_somewhere |= kept
    assert kept_somewhere


def test_the_architecture_names_each_room_of_the_core():
    page = (Path(__file__).parents[2] / "docs/architecture.md").read_text("utf-8")
    assert re.findall(r"\n\| `core/(\w+)(?:/|\.py)`", page) == [*IN_CORE]


def test_files_that_workflows_name_exist():
    root = Path(__file__).parents[2]
    texts = [path.read_text("utf-8") for path in (root / ".github/workflows").glob("*.yml")]
    named = re.findall(r"\b(?:tests|bench)/[\w/]+\.py", "".join(texts))
    assert named
    assert [file for file in named if not (root / file).exists()] == []


def test_the_reference_imports_nothing_from_the_package():
    text = (Path(__file__).parents[1] / "naive.py").read_text(encoding="utf-8")
    imports = [n for n in ast.walk(ast.parse(text)) if isinstance(n, (ast.Import, ast.ImportFrom))]
    modules = {getattr(node, "module", None) or node.names[0].name for node in imports}
    assert modules <= {"fractions", "functools", "itertools", "mpmath", "collections", "math"}


WITH_EXAMPLES = [name for name, path in FILES.items() if ">>>" in TEXTS[path]]
# A long report, and loops of users that take long to compile.
LONG = "suslov_fast.compiled", "suslov_fast.integrability.linear_relations"


@pytest.mark.sampled(10)
@pytest.mark.slow_cases(*LONG)
@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples(name):
    """What docstrings print, they print on other processors."""
    for seed in PROCESSORS:
        with other_last_digits(seed) as called:
            assert doctest.testmod(importlib.import_module(name)).failed == 0
        if not called:
            break


def documented():
    """Yield public functions, classes and the methods of public classes, with their names."""
    modules = [suslov_fast, *([suslov_fast.integrability] if find_spec("flint") else [])]
    things = [getattr(module, name) for module in modules for name in module.__all__]
    for thing in {id(thing): thing for thing in things}.values():
        yield thing.__name__, thing
        for name in dir(thing) if inspect.isclass(thing) else ():
            method = getattr(thing, name)
            if not name.startswith("_") and hasattr(method, "__wrapped__"):
                yield f"{thing.__name__}.{name}", getattr(method, "__func__", method)


SECTIONS = [
    *"Parameters Attributes Returns Raises Warns".split(),
    *("See Also", "Notes", "References", "Examples"),
]


@pytest.mark.parametrize(
    ("name", "thing"), [pytest.param(*each, id=each[0]) for each in documented()]
)
def test_public_docstrings(name, thing):
    """A line for a summary, parameters in the order of the signature, and what is returned."""
    text = inspect.getdoc(thing)
    assert text
    assert text.partition("\n\n")[0].endswith("."), text[:100]
    assert "\n" not in text.partition("\n\n")[0]
    found = [each for each in re.findall(r"\n([\w ]+)\n---", text) if each in SECTIONS]
    assert found == sorted(found, key=SECTIONS.index)
    if not inspect.isfunction(thing):
        return
    if "." in name and ("\n" not in text or re.search(r", as :\w+:`[\w.]+` do", text)):
        return  # methods that a line explains, or that do as another one
    assert "Examples" in found
    signature = inspect.signature(thing)
    assert ("Returns" in found) == (signature.return_annotation not in (None, "None"))
    parameters = [each for each in signature.parameters if each not in ("self", "cls")]
    assert ("Parameters" in found) == bool(parameters)
    if parameters:
        part = re.split(r"\n\n\w+\n---+\n", text.split("\nParameters\n", 1)[1])[0]
        heads = [line.split(" : ")[0] for line in part.split("\n")[1:] if line[:1] not in ("", " ")]
        assert re.findall(r"\w+", ", ".join(heads)) == parameters


def test_names_are_imported_when_they_are_asked_for():
    code = """
        import sys, suslov_fast
        ours = {name for name in sys.modules if name.startswith("suslov_fast.")}
        assert not ours and not {"numba", "numpy", "xarray"} & sys.modules.keys()
        modules = "compiled", "integrability", "kahan"
        assert set(dir(suslov_fast)) == {*suslov_fast.__all__, "__version__", *modules}
        suslov_fast.Field(lambda x: (x[1], -x[0]), 2)([1, 2])
        assert not {"numba", "matplotlib", "scipy", "xarray", "flint"} & sys.modules.keys()
        from suslov_fast import *
        assert all(name in globals() for name in suslov_fast.__all__)
    """
    children.run(code)
    with pytest.raises(AttributeError, match="nothing"):
        _ = suslov_fast.nothing
    assert (PACKAGE / "py.typed").exists()
