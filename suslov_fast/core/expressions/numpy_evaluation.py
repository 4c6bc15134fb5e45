"""Expression programs evaluated in NumPy: each operation for all states at once."""

import math
import operator

import numpy as np

from .elementary import ELEMENTARY, LARGE_ANGLE, OF_ANGLES, list_of


def _of_library(function):
    """Return `function` of Python's `math`, for arrays; NaN or infinite where it raises."""

    def of_number(*numbers):
        try:
            return function(*numbers)
        except ValueError:
            is_infinite = function is math.atanh and abs(numbers[0]) == 1.0
            return math.copysign(math.inf, numbers[0]) if is_infinite else math.nan

    def of_arrays(*arrays):
        columns = np.broadcast_arrays(*arrays)
        rows = zip(*(column.ravel().tolist() for column in columns), strict=True)
        values = [of_number(*row) for row in rows]
        return np.array(values, np.float64).reshape(columns[0].shape)

    return of_arrays


def _of_bits(function):
    """Return a function of arrays of doubles: `function` of their bits as unsigned integers."""

    def of_arrays(*arrays):
        integers = (np.atleast_1d(np.asarray(array, float)).view(np.uint64) for array in arrays)
        values = function(*integers).view(float)
        return values.reshape(np.broadcast_shapes(*map(np.shape, arrays)))

    return of_arrays


def _sum(*operands):
    """Return s + a b + c d + ..., for s, a, b, c, d, ...; an even number of operands has no s."""
    odd = len(operands) % 2
    products = (a * b for a, b in zip(operands[odd::2], operands[odd + 1 :: 2], strict=True))
    return sum(products, operands[0] if odd else next(products))


def _of_list(name):
    """Return the elementary function `name`, like "exp", for arrays, by its expression program."""

    def of_arrays(*arrays):
        operations, result = list_of(name)
        values = dict(enumerate(arrays))
        with np.errstate(all="ignore"):
            evaluate(operations, values)
        if name in OF_ANGLES and (is_large := np.abs(arrays[0]) >= LARGE_ANGLE).any():
            return np.where(is_large, _of_library(getattr(math, name))(arrays[0]), values[result])
        return values[result]

    return of_arrays


# Functions by their names in the C library. Machine code calls these functions lane by lane.
_NAMES = "asin acos atan asinh acosh atanh atan2 erf erfc".split()
OF_LIBRARY = {name: _of_library(getattr(math, name)) for name in _NAMES}
# Integer instructions; their names in LLVM follow "bits_".
OF_BITS = {
    "bits_and": _of_bits(np.bitwise_and),
    "bits_or": _of_bits(np.bitwise_or),
    "bits_xor": _of_bits(np.bitwise_xor),
    "bits_add": _of_bits(np.add),
    "bits_sub": _of_bits(np.subtract),
    "bits_shl": _of_bits(np.left_shift),
    "bits_lshr": _of_bits(np.right_shift),
}
OF_LISTS = {name: _of_list(name) for name in ELEMENTARY}
# Instructions by their names in LLVM. For one state Python's operators are faster than NumPy's.
# In LLVM "max" and "min" are a comparison and a `select`: the second operand if either is NaN.
OF_NUMBERS = {
    "fadd": operator.add,
    "fsub": operator.sub,
    "fmul": operator.mul,
    "fdiv": np.divide,
    "sum": _sum,
    "fabs": np.absolute,
    "sqrt": np.sqrt,
    "floor": np.floor,
    "copysign": np.copysign,
    "select": np.where,
    "max": lambda a, b: np.where(a > b, a, b),
    "min": lambda a, b: np.where(a < b, a, b),
    **OF_BITS,
    **OF_LISTS,
    **OF_LIBRARY,
}
OF_TRUTH_VALUES = {
    "olt": np.less,
    "ogt": np.greater,
    "oge": np.greater_equal,
    "oeq": np.equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "xor": np.logical_xor,
}


class _Functions(dict):
    def __missing__(self, instruction):
        return instruction  # a `Table` or a `DenseMatrix`


OF_VECTORS = {"entry": lambda vector, i: vector[int(i)]}  # vectors: see `dense_product`
FUNCTIONS = _Functions(OF_NUMBERS | OF_TRUTH_VALUES | OF_VECTORS)


def evaluate(operations, values):
    """Evaluate `operations`; their values are added to `values`, {number: float or array}."""
    for instruction, number, operands in operations:
        numbers = [a if isinstance(a, float) else values[a] for a in operands]
        values[number] = FUNCTIONS[instruction](*numbers)


def results_at(program, inputs, shape):
    """Return the R results (R, *shape) of a `Program`; its inputs are {number: value}."""
    values = dict(inputs)
    with np.errstate(all="ignore"):
        evaluate(program.operations, values)
    results = np.empty((len(program.results), *shape))
    for k, a in enumerate(program.results):
        results[k] = a if isinstance(a, float) else values[a]
    return results
