"""Change one thing in a copy of the package, run tests, and see whether any of them fails.

    python tests/slow/mutate.py PATH [--tests TEST ...] [--limit N] [--seed S] [--compiled]

PATH is a file or folder of the package, such as suslov_fast/_core/formulas. Printed are the
survivors: a line, what stood there and what stands there now. Each wants a test that fails, or a
reason why both are right. Kernels run interpreted, which compiles nothing, unless --compiled.
"""

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
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
    """(line, before, after, source) for each change of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in list(ast.walk(tree)):
        for replacement in changes(node):
            before, after = ast.unparse(node), ast.unparse(replacement)
            # A copy of both together, so that the node is found again.
            whole, target = copy.deepcopy((tree, node))
            yield (
                node.lineno,
                before,
                after,
                ast.unparse(
                    ast.fix_missing_locations(Swap(target, copy.deepcopy(replacement)).visit(whole))
                ),
            )


def failure(folder, tests, compiled):
    """What tests say that fail on the copy of the package in a folder; never ending is failing."""
    settings = {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    if not compiled:
        settings["NUMBA_DISABLE_JIT"] = "1"
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
    parser.add_argument("path", type=Path)
    parser.add_argument("--tests", nargs="+", default=["tests"])
    parser.add_argument("--limit", type=int, help="so many mutants, drawn by chance")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--compiled", action="store_true")
    options = parser.parse_args()
    path = options.path.resolve()
    files = sorted(path.rglob("*.py")) if path.is_dir() else [path]
    found = [(file.relative_to(ROOT), *mutant) for file in files for mutant in mutants(file)]
    total = len(found)
    random.Random(options.seed).shuffle(found)
    found = found[: options.limit]
    folder, survivors = copied(), 0
    try:
        if told := failure(folder, options.tests, options.compiled):
            raise SystemExit(f"{told}\nthe tests fail on the package as it is")
        for file, line, before, after, source in found:
            (folder / file).write_text(source, encoding="utf-8")
            if not failure(folder, options.tests, options.compiled):
                survivors += 1
                print(f"{file}:{line}: {before}  ->  {after}", flush=True)
            shutil.copy(ROOT / file, folder / file)
    finally:
        shutil.rmtree(folder)
    print(f"{survivors} of {len(found)} mutants survived, of {total} that there are")


if __name__ == "__main__":
    main()
