"""Parts of loops compiled by being read: what they do is what Python does."""

from typing import NamedTuple

import numba
import numpy as np
import pytest

from suslov_fast._core import staged
from suslov_fast._core.cpu import equal_steps, map_3d  # noqa: F401  (are staged)
from suslov_fast._core.cpu.vector import VECTOR, load, on_stack, splat, store, store_pairs

HEIGHT = 3


@staged.staged
def integers(a, b, out):
    """Rounding of divisions, conditions, and names that are given several values."""
    out[0], out[1], out[2], out[3] = a // b, a % b, a // 8, a % 8
    out[4], out[5], out[6], out[7] = 17 // b, 17 % b, -a // b, -a % b
    out[8], out[9] = min(a, b), max(a, 3)
    out[10] = 1 if a < b <= 7 else -1
    out[11] = a if not a > b and (b > 2 or a > 2) else 0
    k = 5
    k += a
    a = k - b
    out[12] = a
    out[12] *= 2


@staged.staged
def branches(n, out):
    """Loops, in which some turns end early; what is known beforehand; and results."""
    count, total, found = 0, 0.0, False
    for i in range(n):
        if i % 3 == 1:
            continue
        for j in range(i, -1, -2):
            total += 1.0 * i - j
        if i == 7:
            found = True
        else:
            count += 1
    while count > 4:
        count -= 3
        if count == 5:
            continue
        total = total / 2
    for row, weight in ((0, 1.0), (1, 0.5)):
        if n == 5 and row == 0:
            continue
        out[row] = weight * total
    if HEIGHT == 3:
        out[2] = count
    else:
        unknown(out)  # noqa: F821  (what is not taken is not read)
    return count, found


@staged.staged
def first_of(pair, index):
    return pair[0][index] + pair[1]


@staged.staged
def arrays(values, small, out):
    """Rows, slices, vectors, memory of its own, and tuples of arrays."""
    room = on_stack(2, VECTOR)
    for i in range(VECTOR):
        room[0, i] = values[1, i]
    store(room, 1, 2.0 * load(room, 0) + splat(1.0))
    store_pairs(out, 0, load(room, 0), load(room, 1))
    out[2 * VECTOR : 2 * VECTOR + small.size] = 9.0
    last = out[3 * VECTOR :]
    last[0] = first_of((values[0], 0.25), 2)
    last[1] = small[0]
    small[1] = np.int8(values[0, 1])
    last[2] = np.copysign(np.sqrt(values[0, 3]), -1.0) + (values[0, 0] > 0.0)
    last[3] = np.isnan(values[0, 0] / values[0, 0]) & np.isfinite(last[0])
    last[4], last[5] = values.shape[0], values.size


class Row(NamedTuple):
    numbers: np.ndarray
    which: int


@staged.apart
def add_to(row, factor, height):
    """Arrays, numbers, what is known beforehand, and tuples of them with names or without."""
    total = 0.0
    for i in range(row.numbers.size):
        total += factor * row.numbers[i]
    row.numbers[row.which] = total
    return (total, height), row


@staged.apart
def clear(row):
    row[1:3].fill(-1.0)


@staged.staged
def apart(values, out):
    (first, height), row = add_to(Row(out[0], 2), values[0], HEIGHT)
    (second, _), _ = add_to(Row(out[1], 0), 2.0 * first, HEIGHT)
    (third, _), _ = add_to(Row(out[0], row.which - 1), 2.0, None)
    clear(out[2:5])
    row.numbers[0] = first + second + third + height


CALLED = numba.njit(lambda a, b, out: integers(a, b, out))
BRANCHING = numba.njit(lambda n, out: branches(n, out))
APART = numba.njit(lambda values, out: apart(values, out))
ON_ARRAYS = numba.njit(lambda values, small, out: arrays(values, small, out))


@pytest.mark.parametrize("a", [-9, -8, 0, 3, 8, 23])
@pytest.mark.parametrize("b", [-5, -1, 2, 7, 23])
def test_integers(a, b):
    read, called = np.zeros(13, np.int64), np.zeros(13, np.int64)
    CALLED(a, b, read)
    integers(a, b, called)
    assert list(read) == list(called)


@pytest.mark.parametrize("n", [0, 1, 5, 8, 20])
def test_branches(n):
    read, called = np.zeros(3), np.zeros(3)
    assert BRANCHING(n, read) == branches(n, called)
    assert list(read) == list(called)


def test_arrays():
    values = np.arange(2.0 * VECTOR).reshape(2, VECTOR)
    results = []
    for function in (ON_ARRAYS, arrays):
        small, out = np.array([-3, 0, 0], np.int8), np.zeros(4 * VECTOR)
        with np.errstate(all="ignore"):
            function(values, small, out)
        results.append([*small, *out])
    np.testing.assert_array_equal(*results)


def test_functions_of_their_own():
    results = []
    for function in (APART, apart):
        out = np.arange(24.0).reshape(6, 4)
        function(np.array([0.5]), out)
        results.append(out)
    np.testing.assert_array_equal(*results)


@pytest.mark.compiled
def test_an_array_with_gaps_is_not_taken():
    with pytest.raises(numba.TypingError):
        CALLED(1, 2, np.zeros((13, 2), np.int64)[:, 0])


def test_what_is_read_is_what_runs():
    """Functions are found by the lines of files as they were when they were imported."""
    functions = [each for each in staged._STAGED if each.__module__.startswith("suslov_fast.")]
    assert len(functions) > 100
    for function in functions:
        tree, _ = staged._parsed(function)
        assert tree.name == function.__name__
        assert function.__code__.co_filename in staged.SOURCES
