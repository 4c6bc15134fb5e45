"""Scalar kernels: expression programs on numbers, and truth values, of one lane."""

import inspect
from typing import NamedTuple

from ..expressions.programs import Values
from ..expressions.values import operand_of

TINY = 2.0**-1000  # the least length or divisor, in place of 0
AT_ONCE = 2.0**-36  # part of the time t: events that are closer than this count as simultaneous
NEARLY = 2.0**-42  # part of the time t: an event less than this after a requested time is at it
EDGE = 2.0**-38  # part of the time t: a solution that ends less than this before a surface is on it


class ScalarKernel(NamedTuple):
    """An expression program with names: of its first values, `inputs`, and of its `results`."""

    inputs: list
    operations: list
    results: dict


def scalar_kernel(function):
    """Return the `ScalarKernel` of a function of `Number`s that returns a dict of results."""
    parameters = inspect.signature(function).parameters.values()
    inputs = [each.name for each in parameters if each.default is each.empty]
    values = Values(len(inputs), ())
    found = function(**{name: values.number(k) for k, name in enumerate(inputs)})
    results = {name: operand_of(a) for name, a in found.items()}
    return ScalarKernel(inputs, values.operations, results)
