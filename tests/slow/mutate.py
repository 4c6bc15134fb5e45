"""Change one thing in the package, run tests, and see whether any of them fails.

    python tests/slow/mutate.py PATH ... [--tests TEST ...] [--sample N] [--seed S] [--seconds T]
    python tests/slow/mutate.py PATH --change BEFORE AFTER
    python tests/slow/mutate.py PATH ... --compiled

PATH is a file or folder of the package, such as suslov_fast/_core/formulas. Printed are the
survivors: a line, what stood there and what stands there now. Each wants a test that fails, or a
reason why both are right.

Kernels run interpreted. All tests run once, to see which functions each of them calls and how long
it takes. Each change is then made in a process forked from there, which exchanges the code of the
functions that are loaded, and runs the tests that call them: first those that noticed a change of
the same function before, then the quickest. With --compiled a copy of the package is changed on
disk and compiled for each change, which takes minutes.
"""

import argparse
import ast
import contextlib
import copy
import gc
import importlib
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import types
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "suslov_fast"
COMPARISONS = {
    ast.Lt: [ast.LtE, ast.GtE],
    ast.LtE: [ast.Lt, ast.Gt],
    ast.Gt: [ast.GtE, ast.LtE],
    ast.GtE: [ast.Gt, ast.Lt],
    ast.Eq: [ast.NotEq],
    ast.NotEq: [ast.Eq],
}
OPERATORS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
SCALES = (0.5, 2.0, 1.001)
MEMORY = 12 * 2**30


class Mutant(NamedTuple):
    path: Path
    line: int
    before: str
    after: str
    tree: ast.Module

    def __str__(self):
        return f"{self.path.relative_to(ROOT)}:{self.line}: {self.before}  ->  {self.after}"


def changes(node):
    """What may stand in the place of an expression."""
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield from (ast.Constant(value) for value in scaled(node.value))
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        for other in COMPARISONS.get(type(node.ops[0]), ()):
            yield ast.Compare(node.left, [other()], node.comparators)
    elif isinstance(node, ast.BoolOp):
        other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield ast.BoolOp(other, node.values)
        yield from (
            ast.BoolOp(node.op, left) if len(left) > 1 else left[0]
            for left in without_one(node.values)
        )
    elif isinstance(node, ast.BinOp):
        if type(node.op) in OPERATORS:
            yield ast.BinOp(node.left, OPERATORS[type(node.op)](), node.right)
        yield node.left
        yield node.right
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
        yield node.operand
    elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("abs", "min", "max"):
        yield from node.args


def scaled(value):
    if isinstance(value, int):
        return (value + 1, value - 1)
    return tuple(dict.fromkeys(value * scale for scale in SCALES)) if value else (1e-9, 1.0)


def without_one(values):
    return [values[:k] + values[k + 1 :] for k in range(len(values))]


class Swap(ast.NodeTransformer):
    def __init__(self, target, replacement):
        self.target, self.replacement = target, replacement

    def visit(self, node):
        if node is self.target:
            return ast.copy_location(self.replacement, node)
        return self.generic_visit(node)


def mutants(path):
    """Every change of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in list(ast.walk(tree)):
        for replacement in changes(node):
            # A copy of both together, so that the node is found again.
            whole, target = copy.deepcopy((tree, node))
            changed = Swap(target, copy.deepcopy(replacement)).visit(whole)
            yield Mutant(
                path,
                node.lineno,
                ast.unparse(node),
                ast.unparse(replacement),
                ast.fix_missing_locations(changed),
            )


def mutant_of_text(path, before, after):
    source = path.read_text(encoding="utf-8")
    if source.count(before) != 1:
        raise SystemExit(f"{path} has {source.count(before)} times {before!r}")
    line = source[: source.index(before)].count("\n") + 1
    return Mutant(path, line, before, after, ast.parse(source.replace(before, after)))


def codes(code):
    """A compiled module or function, and all that are defined in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from codes(constant)


def place_of(code):
    return code.co_filename, code.co_qualname, code.co_firstlineno


class Loaded:
    """The functions and modules of the package in this process."""

    def __init__(self):
        self.functions = defaultdict(list)
        for found in gc.get_objects():
            if isinstance(found, types.FunctionType):
                self.functions[place_of(found.__code__)].append(found)
        self.modules = [
            module
            for module in list(sys.modules.values())
            if str(getattr(module, "__file__", None) or "").startswith(str(PACKAGE))
        ]

    def module_of(self, path):
        return next(each for each in self.modules if each.__file__ == str(path))

    def changed(self, mutant):
        """The places of functions whose code a mutant changes, and the globals that it does."""
        new = compile(mutant.tree, str(mutant.path), "exec")
        old = compile(mutant.path.read_text(encoding="utf-8"), str(mutant.path), "exec")
        before = {place_of(code): code for code in codes(old)}
        functions = {
            place_of(code): code
            for code in codes(new)
            if code.co_name != "<module>" and before.get(place_of(code)) != code
        }
        if functions:
            return functions, {}
        return {}, self.globals_of(mutant.path, old, new)

    def globals_of(self, path, old, new):
        was, becomes = ({"__name__": self.module_of(path).__name__} for _ in range(2))
        for code, namespace in ((old, was), (new, becomes)):
            namespace["__package__"] = namespace["__name__"].rpartition(".")[0]
            exec(code, namespace)
        return {
            name: value
            for name, value in becomes.items()
            if isinstance(value, (int, float, tuple, dict)) and value != was.get(name)
        }

    def users_of(self, names):
        """The places of functions that use one of some globals."""
        return [
            place
            for place in self.functions
            if place[0].startswith(str(PACKAGE))
            and any(names & set(code.co_names) for code in codes(self.functions[place][0].__code__))
        ]

    def apply(self, path, functions, values):
        for place, code in functions.items():
            for function in self.functions[place]:
                function.__code__ = code
        changed, home = set(values), self.module_of(path).__name__
        for module in self.modules:
            for name in changed & set(vars(module)):
                if module.__name__ == home or imports(module, name, home):
                    setattr(module, name, values[name])


def imports(module, name, home):
    """Whether a module has a name from another."""
    for node in ast.walk(ast.parse(Path(module.__file__).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and any(each.name == name for each in node.names):
            package = module.__spec__.parent
            relative = "." * node.level + (node.module or "")
            if importlib.util.resolve_name(relative, package) == home:
                return True
    return False


class Run:
    """A plugin of pytest that tries mutants in the place of a run of tests."""

    def __init__(self, tried, seconds, report):
        self.tried, self.seconds, self.report = tried, seconds, report
        self.failed, self.survivors = False, defaultdict(int)
        self.durations, self.called = {}, defaultdict(set)
        self.killers = defaultdict(list)

    def pytest_runtest_logreport(self, report):
        self.failed |= report.failed

    def pytest_runtestloop(self, session):
        import hypothesis

        # Failures need no smaller example.
        hypothesis.settings.register_profile(
            "mutants", deadline=None, derandomize=True, phases=[hypothesis.Phase.generate]
        )
        hypothesis.settings.load_profile("mutants")
        for item in session.items:
            self.look_at(item)
            if self.failed:
                raise SystemExit(f"{item.nodeid} fails on the package as it is")
        ranks, self.costs = defaultdict(int), {}
        for item in sorted(session.items, key=self.durations.get):
            family = item.nodeid.partition("[")[0]
            # One case of each test before the others.
            self.costs[item] = self.durations[item] * (1 + ranks[family])
            ranks[family] += 1
        self.loaded = Loaded()
        for mutant in self.tried:
            self.try_out(mutant)
        return True

    def look_at(self, item):
        """Run a test on the package as it is."""
        seen = {}

        def trace(frame, event, argument):
            seen.setdefault(id(frame.f_code), frame.f_code)

        begin = time.process_time()
        sys.settrace(trace)
        run_test(item)
        sys.settrace(None)
        self.durations[item] = time.process_time() - begin
        for code in seen.values():
            if code.co_filename.startswith(str(PACKAGE)):
                self.called[place_of(code)].add(item)

    def try_out(self, mutant):
        try:
            functions, values = self.loaded.changed(mutant)
        except (ArithmeticError, LookupError, TypeError, ValueError):
            return  # it cannot be imported
        places = tuple(functions) if functions else self.loaded.users_of(set(values))
        items = set().union(*(self.called[place] for place in places))
        before = self.killers[places[0] if functions else tuple(values)]
        rest = sorted(items - set(before), key=self.costs.get)
        chosen, left = [], self.seconds
        for item in [each for each in before if each in items] + rest:
            left -= self.durations[item]
            if left >= 0 or not chosen:
                chosen.append(item)
        killer = self.killer(mutant.path, functions, values, chosen) if chosen else None
        if killer is None:
            self.survivors[mutant.path] += 1
            self.report(f"{mutant}   [{len(chosen)} of {len(items)} tests]")
        else:
            if chosen[killer] in before:
                before.remove(chosen[killer])
            before.insert(0, chosen[killer])

    def killer(self, path, functions, values, items):
        """The number of the first test that fails."""
        progress, told = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(progress)
            with contextlib.suppress(BaseException):
                items[0].config.pluginmanager.unregister(name="terminalreporter")
                resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
                self.loaded.apply(path, functions, values)
                for item in items:
                    os.write(told, b".")
                    # What never ends is noticed too.
                    signal.alarm(int(5 + 10 * self.durations[item]))
                    run_test(item)
                    if self.failed:
                        os._exit(1)
                os._exit(0)
            os._exit(1)
        os.close(told)
        with open(progress, "rb") as pipe:
            begun = len(pipe.read())
        status = os.waitpid(child, 0)[1]
        return None if status == 0 else max(begun - 1, 0)


def run_test(item):
    item.ihook.pytest_runtest_protocol(item=item, nextitem=None)


def try_interpreted(tried, tests, seconds, report):
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    sys.path.insert(0, str(ROOT))
    import pytest

    run = Run(tried, seconds, report)
    options = ["-q", "-p", "no:cacheprovider", "--rootdir", str(ROOT), *tests]
    if pytest.main(options, plugins=[run]) not in (0, 5):
        raise SystemExit("the tests fail on the package as it is")
    return run.survivors


def try_compiled(tried, tests, report):
    folder, survivors = copied(), defaultdict(int)
    try:
        if told := failure(folder, tests):
            raise SystemExit(f"{told}\nthe tests fail on the package as it is")
        for mutant in tried:
            file = folder / mutant.path.relative_to(ROOT)
            file.write_text(ast.unparse(mutant.tree), encoding="utf-8")
            if not failure(folder, tests):
                survivors[mutant.path] += 1
                report(f"{mutant}")
            shutil.copy(mutant.path, file)
    finally:
        shutil.rmtree(folder)
    return survivors


def failure(folder, tests):
    """What tests say that fail on the copy of the package in a folder; never ending is failing."""
    settings = {"PYTHONPATH": f"{folder}:{folder / 'tests'}", "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=os.environ | settings,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=1200,
        )
    except subprocess.TimeoutExpired:
        return "no end"
    if done.returncode == 5:
        raise SystemExit("no test was found")
    return done.stdout if done.returncode else ""


def copied():
    folder = Path(tempfile.mkdtemp(prefix="mutants-"))
    for part in ("suslov_fast", "tests", "bench"):
        ignored = shutil.ignore_patterns("__pycache__", "slow", "results")
        shutil.copytree(ROOT / part, folder / part, ignore=ignored)
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, folder)
    return folder


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", type=Path, nargs="+", metavar="PATH")
    parser.add_argument("--tests", nargs="+", default=["tests"])
    parser.add_argument("--sample", type=int, help="so many mutants of a file, drawn by chance")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=10.0, help="of tests for one mutant")
    parser.add_argument("--change", nargs=2, action="append", metavar=("BEFORE", "AFTER"))
    parser.add_argument("--compiled", action="store_true")
    options = parser.parse_args()
    files = []
    for path in options.paths:
        files += sorted(path.resolve().rglob("*.py")) if path.is_dir() else [path.resolve()]
    tried, total = [], {}
    for file in files:
        if options.change:
            found = [mutant_of_text(file, *each) for each in options.change]
        else:
            found = list(mutants(file))
            total[file] = len(found)
            random.Random(options.seed).shuffle(found)
        tried += found[: options.sample]
    output = os.dup(1)  # pytest takes the other

    def report(line):
        os.write(output, f"{line}\n".encode())

    if options.compiled:
        survivors = try_compiled(tried, options.tests, report)
    else:
        survivors = try_interpreted(tried, options.tests, options.seconds, report)
    for file in files:
        of_file = sum(mutant.path == file for mutant in tried)
        report(
            f"{file.relative_to(ROOT)}: {survivors[file]} of {of_file} mutants survived, of "
            f"{total.get(file, of_file)} that there are"
        )


if __name__ == "__main__":
    main()
