"""Elimination by columns of sparse matrices, beside SciPy's."""

import numpy as np
import pytest
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from suslov_fast.core.expressions.sparse_elimination import Sparse
from suslov_fast.core.expressions.symbolic_elimination import elimination_order, filled, work_of
from suslov_fast.core.llvm.compiler import call, compiled
from suslov_fast.core.llvm.sparse_solver import add_factors, add_solution
from suslov_fast.core.llvm.text import Code, Integers


def lattice(n, m, fields):
    cells = np.arange(n * m).reshape(n, m)
    near = [np.roll(cells, shift, axis) for axis in (0, 1) for shift in (-1, 0, 1)]
    pairs = {(i, j) for other in near for i, j in zip(cells.flat, other.flat, strict=True)}
    pairs = sorted((int(i), int(j)) for i, j in pairs)
    return [(fields * i + a, fields * j + b) for i, j in pairs for a in range(fields)
            for b in range(fields) if i == j or a == b], fields * n * m  # fmt: skip


def scattered(D, count):
    pairs = np.random.default_rng(D).integers(0, D, (count, 2)).tolist()
    return sorted({(i, j) for i, j in pairs}), D


PATTERNS = {
    "nothing": ([], 3),
    "one": ([(0, 0)], 1),
    "cascade": ([(i, i - 1) for i in range(1, 30)], 30),
    "arrow": ([(i, j) for i in range(40) for j in range(40) if 7 in (i, j)], 40),
    "dense": ([(i, j) for i in range(23) for j in range(23)], 23),
    "scattered": scattered(60, 200),
    "ring of two fields": lattice(1, 40, 2),
    "lattice": lattice(9, 11, 1),
    "lattice of two fields": lattice(6, 8, 2),
}


def solve(plan, entries, right):
    """Return the solutions (D, W) of (1 - s J) v = g, for entries of J and s (-, W)."""
    D, W = right.shape

    def text_of(name):
        text = Code(W)
        for kind, add in (("factors", add_factors), ("solution", add_solution)):
            add(text, f"{name}_{kind}", plan)
        text.begin(name, "arguments")
        entries, factors, v, scratch = (Integers(text, "%arguments")[k] for k in range(4))
        text.invoke(f"{name}_factors", entries, 0, factors, scratch)
        text.invoke(f"{name}_solution", factors, 0, v, scratch)
        text.add("  ret i64 0")
        return text.finished()

    arrays = entries, np.full((D + plan.size, W), np.nan), right.copy(), np.full((D, W), np.nan)
    call(compiled((plan, W), text_of), np.array([a.ctypes.data for a in arrays]))
    return arrays[2]


@pytest.mark.parametrize("pattern", PATTERNS)
def test_solutions_are_those_of_scipy_in_any_number_of_lanes(pattern):
    (places, D), rng = PATTERNS[pattern], np.random.default_rng(1)
    plan = plan_of(places, D)
    assert sorted(plan.order) == [*range(D)]
    entries, right = rng.uniform(-1.0, 1.0, (len(places) + 1, 8)), rng.normal(size=(D, 8))
    entries[:-1][[i == j for i, j in places]] -= 8.0
    found = solve(plan, entries, right)
    for lane in range(8):
        own = np.ascontiguousarray(entries[:, [lane]]), np.ascontiguousarray(right[:, [lane]])
        np.testing.assert_array_equal(solve(plan, *own)[:, 0], found[:, lane])
        matrix = np.eye(D)
        for (i, j), entry in zip(places, own[0][:-1, 0], strict=True):
            matrix[i, j] -= own[0][-1, 0] * entry
        scale = np.linalg.cond(matrix) * abs(found[:, lane]).max()
        wanted = splu(csc_array(matrix)).solve(right[:, lane])
        np.testing.assert_allclose(found[:, lane], wanted, rtol=0.0, atol=1e-12 * scale)


def test_orders_have_little_fill():
    """Of a lattice reverse Cuthill-McKee has 1.9 times as many products, nested dissection 1.0."""
    places, D = lattice(28, 28, 1)
    order = elimination_order(places, D)
    assert work_of(order, filled(places, order), ())[0] < 700_000


def plan_of(places, D):
    order = elimination_order(places, D)
    return Sparse(places, order, filled(places, order))
