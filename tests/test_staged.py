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
    out.reshape((4, small.size - 1, VECTOR // 2))[0] = 7.0
    store(room, 1, 2.0 * load(room, 0) + splat(1.0))
    store_pairs(out, 0, load(room, 0), load(room, 1))
    out[2 * VECTOR : 2 * VECTOR + small.size] = 9.0
    last = out[3 * VECTOR :]
    last[0] = first_of((values[0], 0.25), 2)
    last[1] = small[0]
    small[1], small[2] = np.int8(values[0, 1]), values[0, 1] > 0.0
    last[2] = np.copysign(np.sqrt(values[0, 3]), -1.0) + (values[0, 0] > 0.0)
    last[3] = np.isnan(values[0, 0] / values[0, 0]) & np.isfinite(last[0])
    last[4], last[5] = values.shape[0], values.size
    whole = room.view(np.int64)
    whole[1, 0] = -small[0] - 10
    last[6] = whole[1, 0] // 2
    (last[7], _), _ = ((2.0, 1), small[0]) if small[0] < small[1] else ((1.0 * small[1], 2), 3)


@staged.staged
def doubled(x):
    y = x
    y += x
    return y


@staged.staged
def turns(a, b, out):
    """Names of loops that have other values too, turns that end at once, guarded divisions."""
    i = 7
    for i in range(4):
        while i > 1:
            out[0] += i
            i = i - 1
    out[1] = i
    for row in (2, 3):
        if row == 2:
            continue
        out[row] = a
    out[4] = doubled(a) // (b - 2) if b != 2 else -1
    out[5] = a % (b - 2) if b != 2 else -1
    out[6] = np.int64(2.7 * np.float64(a)) + np.isnan(a / 2.0) * 1.0
    out[6:].reshape((1, 2))[0, 1] = b  # of a slice without an end


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


def _adding(number):
    @staged.apart
    def add(values):
        values[0] = 3.0 * values[0] + number

    return add


ONE, TWO = _adding(1.0), _adding(2.0)


@staged.staged
def namesakes(values):
    ONE(values)
    TWO(values)
    ONE(values)


CALLED = numba.njit(lambda a, b, out: integers(a, b, out))
TURNS = numba.njit(lambda a, b, out: turns(a, b, out))
BRANCHING = numba.njit(lambda n, out: branches(n, out))
NAMESAKES = numba.njit(lambda values: namesakes(values))
APART = numba.njit(lambda values, out: apart(values, out))
ON_ARRAYS = numba.njit(lambda values, small, out: arrays(values, small, out))


@pytest.mark.parametrize("a", [-9, -8, 0, 3, 8, 23])
@pytest.mark.parametrize("b", [-5, -1, 2, 7, 23])
def test_integers(a, b):
    read, called = np.zeros(13, np.int64), np.zeros(13, np.int64)
    CALLED(a, b, read)
    integers(a, b, called)
    assert list(read) == list(called)


@pytest.mark.parametrize("a", [-9, 3])
@pytest.mark.parametrize("b", [-5, 2])
def test_turns(a, b):
    read, called = np.zeros(8), np.zeros(8)
    TURNS(a, b, read)
    turns(a, b, called)
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


@pytest.mark.parametrize("function", [NAMESAKES, namesakes])
def test_functions_of_one_name(function):
    values = np.zeros(1)
    function(values)
    assert values == 16.0


@pytest.mark.compiled
def test_an_array_with_gaps_is_not_taken():
    with pytest.raises(numba.TypingError):
        CALLED(1, 2, np.zeros((13, 2), np.int64)[:, 0])


def writing(out):
    out[0] = 1.0
    return 1.0


staged.staged(writing)


class Refused:
    """What means one thing to Python, and would be compiled to another: n = 3, x = 0.5."""

    def after_a_loop(n, x, out):
        for i in range(n):  # noqa: B007
            out[0] += 1.0
        out[1] = i

    def by_some_turns(n, x, out):
        for each in (0.0, 1.0):
            if each == 0.0 or x > 1.0:
                value = each
        out[0] = value

    def by_turns_that_may_end(n, x, out):
        for each in (0.0, 1.0):
            if each == 1.0 and x < 1.0:
                continue
            value = each
        out[0] = value

    def before_it_has_a_value(n, x, out):
        for _ in range(n):
            out[0] = HEIGHT  # noqa: F823
            HEIGHT = 1.0  # noqa: F841

    def after_all_turns(n, x, out):
        for i in range(n):
            out[i] = 1.0
        else:
            out[3] = 2.0

    def on_one_side(n, x, out):
        out[1] = writing(out) if x > 1.0 else 0.0

    def behind_a_comparison(n, x, out):
        out[1] = 1.0 if 1.0 < x < writing(out) else 0.0

    def zero_of_an_integer(n, x, out):
        zero = 0 if x < 1.0 else x
        out[0] = -zero

    def sum_of_conditions(n, x, out):
        out[0] = (x < 1.0) + (x < 2.0)

    def order_of_conditions(n, x, out):
        out[0] = (x < 1.0) > (x > 2.0)

    def minus_a_condition(n, x, out):
        out[0] = -(x < 1.0)

    def not_an_integer(n, x, out):
        out[0] = not n

    def an_integer_or_another(n, x, out):
        out[0] = n or 1

    def a_condition_as_an_index(n, x, out):
        out[x < 1.0] = 1.0

    def from_the_end(n, x, out):
        out[-1] = 1.0

    def too_many_indices(n, x, out):
        out[0, 1] = 1.0

    def beyond_what_is_known(n, x, out):
        on_stack(4)[4] = 1.0

    def every_other(n, x, out):
        out[::2][1] = 1.0

    def a_length_left_out(n, x, out):
        out[0] = out.reshape(-1).size

    def of_another_length(n, x, out):
        out[0] = on_stack(4).reshape((2, 3)).size

    def as_a_condition(n, x, out):
        out[0] = 1.0 if out else 2.0

    def equal_to_an_array(n, x, out):
        out[0] = out == 1.0

    def over_an_array(n, x, out):
        for each in out:
            each += 1.0

    def nothing_as_a_number(n, x, out):
        out[0] = n == None  # noqa: E711

    def an_array_of_the_interpreter(n, x, out):
        room = np.zeros(1)
        for _ in range(n):
            room[0] += 1.0
        out[0] = room[0]

    def rounded_otherwise(n, x, out):
        out[0] = np.sin(x)

    def root_of_an_integer(n, x, out):
        out[0] = np.sqrt(n)

    def without_end(n, x, out):
        for _ in range(0, 5, 0):
            out[0] = 1.0

    def out_of_all_bits(n, x, out):
        out[0] = n >> 64

    def by_what_is_not_known(n, x, out):
        out[0] = n << n

    def rest_of_nothing(n, x, out):
        out[0] = n % 0

    def of_many_bits(n, x, out):
        out[0] = n & 2**64 + 1

    def left_early(n, x, out):
        for _ in range(n):
            break


@pytest.mark.compiled
@pytest.mark.parametrize("name", [name for name in vars(Refused) if name[0] != "_"])
def test_what_cannot_be_read_is_told(name):
    """Where it is, and before LLVM sees any of it."""
    function = staged.staged(vars(Refused)[name])
    compiled = numba.njit(lambda n, x, out: function(n, x, out))
    with pytest.raises(Exception, match=rf"test_staged.py, line \d+, in {name}: "):
        compiled(3, 0.5, np.zeros(8))


@staged.staged
def first_number(pair):
    return pair[0]


@pytest.mark.compiled
@pytest.mark.parametrize(
    "given",
    [
        np.zeros(2, np.uint8),
        np.zeros(2, np.float32),
        np.zeros(2, bool),
        (np.int32(1), 2),
        (1j, 2),
        1j,
        "a",
    ],
    ids=repr,
)
def test_what_would_be_taken_for_another_type_is_not_taken(given):
    with pytest.raises(numba.TypingError):
        numba.njit(lambda pair: first_number(pair))(given)


@pytest.mark.compiled
def test_arguments_have_no_names():
    with pytest.raises(numba.TypingError):
        numba.njit(lambda a, b, out: integers(a, b, out=out))(1, 2, np.zeros(13, np.int64))


def test_without_its_source_a_part_is_not_read(tmp_path):
    """Nor with another than that it was made of."""
    path = tmp_path / "gone.py"
    space = {}
    exec(compile("def part():\n    return 1.0\n", path, "exec"), space)
    with pytest.raises(staged.Unreadable, match="not at hand"):
        staged._parsed(space["part"])
    path.write_text("def other():\n    return 2.0\n")
    with pytest.raises(staged.Unreadable, match="part is not in"):
        staged._parsed(space["part"])


def test_what_is_read_is_what_runs():
    """Functions are found by the lines of files as they were when they were imported."""
    functions = [each for each in staged._STAGED if each.__module__.startswith("suslov_fast.")]
    assert len(functions) > 100
    for function in functions:
        tree, _ = staged._parsed(function)
        assert tree.name == function.__name__
        assert function.__code__.co_filename in staged.SOURCES
