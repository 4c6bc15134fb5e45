"""Values of functions of the state and of parameters, given as functions or as formulas."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import arguments_of, either, short, wrong
from ..core.expressions.numpy_evaluation import evaluate
from ..core.hybrid.event_formulas import KeyedProgram
from .equation_text import values_of
from .names import TIME
from .tracer import Tracer, called_by_name
from .user_function import UserFunction


def function_values(system: Any, f: Any, x: Any) -> Any:
    """Return the values (...) of f at states (..., D) of the engine, or (..., m) of m results.

    `system` is a field or a map; f is a function of the state, and of parameters by name, or one or
    more formulas.
    """
    tracer = Tracer(system._layout, system._coordinates)
    program = KeyedProgram.of(tracer.values, _operands(tracer, f))
    values = dict(enumerate([*np.moveaxis(x, -1, 0), *system._inputs]))
    shape = np.broadcast_shapes(x.shape[:-1], system._inputs.shape[1:])
    with np.errstate(all="ignore"):
        evaluate(program.operations, values)
    rows = (each if isinstance(each, float) else values[each] for each in program.results)
    is_none = np.broadcast_to(np.isnan(x[..., 0]), shape)  # there a constant has no value, too
    found = [np.where(is_none, np.nan, row) for row in rows]
    return found[0] if len(found) == 1 else np.stack(found, axis=-1)


def operands_of(argument: str, f: Any, tracer: Tracer) -> list[Any]:
    """Return the results of a function of the state as operands; messages name `argument`."""
    function = UserFunction(argument, f, tracer.parameters)
    needed, known = arguments_of(f), function.takes
    others = [name for name in needed[1:] if name not in known]
    if others and not TIME & {*needed}:
        expected = "a function of the state, and of parameters of the system by name"
        has = either([*tracer.parameters] or ["none"])
        raise wrong(argument, expected, f"one of {others[0]!r}: the system has {has}", TypeError)
    function.check(tracer.layout.names, dict.fromkeys(known, 1.0))
    return function.formulas(tracer)


def _operands(tracer: Tracer, f: Any) -> list[Any]:
    if callable(f):
        return operands_of("values", f, tracer)
    texts = [f] if isinstance(f, str) else f
    is_list = isinstance(texts, (list, tuple)) and len(texts) > 0
    if not is_list or not all(isinstance(a, str) for a in texts):
        raise wrong("values", "a function of the state, or formulas of its names", short(f))
    try:
        values = values_of([*enumerate(texts)], tracer.known, called_by_name)
        return [tracer.result(values[k]) for k in range(len(texts))]
    except (TypeError, ValueError) as error:
        of = either(tracer.names)
        raise ValueError(f"values: {error}; names of this system are {of}") from None
