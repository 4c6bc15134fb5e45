"""Scalar kernels: expression programs on numbers, and truth values, of one lane."""

import inspect
from typing import NamedTuple

from ..expressions.programs import Values
from ..expressions.values import operand_of


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
