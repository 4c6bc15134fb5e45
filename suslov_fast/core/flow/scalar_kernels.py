"""Scalar kernels: expression programs on numbers, and truth values, of one lane."""

import inspect
import itertools
from typing import NamedTuple

from ..expressions.programs import Values
from ..expressions.values import operand_of


class ScalarKernel(NamedTuple):
    """An expression program with names: of its first values, `inputs`, and of its `results`."""

    inputs: list
    operations: list
    results: dict


def scalar_kernel(function):
    """Return the `ScalarKernel` of a function of `Number`s that returns a dict of results.

    A parameter may have a `NamedTuple` as its annotation: then its fields are inputs.
    """
    parameters = inspect.signature(function).parameters.values()
    given = [each for each in parameters if each.default is each.empty]
    records = {each.name: each.annotation for each in given if each.annotation is not each.empty}
    fields = {each.name: getattr(records.get(each.name), "_fields", (each.name,)) for each in given}
    inputs = [*itertools.chain(*fields.values())]
    values = Values(len(inputs), ())
    numbers = {name: values.number(k) for k, name in enumerate(inputs)}
    of_records = {name: kind(*map(numbers.get, fields[name])) for name, kind in records.items()}
    found = function(**{name: {**numbers, **of_records}[name] for name in fields})
    results = {name: operand_of(a) for name, a in found.items()}
    return ScalarKernel(inputs, values.operations, results)
