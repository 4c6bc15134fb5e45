"""The parts of fields: from functions, arrays, and the entries of `to_dict`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ..checks import arguments_of, short, wrong
from . import coefficients, lagrangian
from .equations import check_equalities, of_hamiltonian
from .exact_numbers import named_parameters
from .layout import Layout, layout_of, layout_read, split_values
from .mass import check_both, rates
from .names import laid_out, variables
from .terms import Terms
from .traced import EQUATIONS, INDICES, LAYOUT, VALUES, operands_of_texts, parts_of
from .tracer import Tracer
from .user_function import UserFunction, check_callable

Parts = dict[str, Any]  # the layout, the equations or the terms, and the parameters


def of_function(
    f: Callable[..., Any], names: Any, mass: Any, is_complex: Any, parameters: Mapping[str, Any]
) -> Parts:
    """Return the parts of the field M x' = f(x); `mass` is M."""
    check_callable("f", f)  # first: if f is a text, this error helps more than missing `names`
    if mass is not None and "mass" in arguments_of(f):
        parameters, mass = {**parameters, "mass": mass}, None
    of_f = UserFunction("f", f, parameters)
    of_mass = UserFunction("mass", mass, parameters) if callable(mass) else None
    has_time = of_f.has_time or (of_mass is not None and of_mass.has_time)
    layout, parameters = laid_out(f, names, is_complex, has_time, parameters)
    check_both(of_f, of_mass, layout.names, parameters)
    values = named_parameters(split_values(parameters), layout.components)
    tracer = Tracer(layout, [*values], has_products=mass is None)
    rows = of_f.formulas(tracer)
    if mass is not None:
        rows[: layout.size] = rates(tracer, of_mass or mass, rows[: layout.size])
    check_equalities(tracer.values, layout.components, rows)
    return parts_of(tracer, rows, values)


def of_energy(H: Callable[..., Any], names: Any, K: Any, parameters: Mapping[str, Any]) -> Parts:
    """Return the parts of the field x' = K grad H."""
    names = variables(names)
    of_H = UserFunction("H", H, parameters)
    of_H.check(names, parameters)
    values = named_parameters(parameters, names)
    matrix = coefficients.structure_matrix(K, len(names), names)
    tracer = Tracer(layout_of(names), [*values])
    [energy] = of_H.formulas(tracer)
    equations = of_hamiltonian(tracer, names, [*values], energy, matrix)
    return {**values, LAYOUT: tracer.layout, EQUATIONS: equations}


def of_mechanics(
    functions: Mapping[str, Any],
    coordinates: Any,
    velocities: Any,
    algebra: Any,
    parameters: Mapping[str, Any],
) -> Parts:
    """Return the parts of the field of a Lagrangian; `functions` are None if not given."""
    q, u = lagrangian.names_of(coordinates, velocities, functions["frame"] is not None)
    values = named_parameters(parameters, [*q, *u])
    tracer, rows, quantities = lagrangian.of_lagrangian(functions, q, u, values, algebra)
    check_equalities(tracer.values, tracer.layout.components, rows)
    return parts_of(tracer, rows, values, quantities)


def of_terms(terms: Terms, names: Sequence[str]) -> Parts:
    """Return the parts of the field of terms that were checked before."""
    return {INDICES: terms.indices, VALUES: terms.values, LAYOUT: layout_of(tuple(names))}


def with_formulas(terms: Terms, layout: Layout) -> Parts:
    """Return parts with formulas; of a family, coefficients c0, c1, ... are parameters."""
    names, given = {*layout.names}, terms.values
    letter = next(a for a in "cdabefghijkl" if not any(name.startswith(a) for name in names))
    is_family = given.ndim > 1
    values = {f"{letter}{k}": given[..., k] for k in range(given.shape[-1] * is_family)}
    tracer = Tracer(layout, [*values])
    factors, rows = [*tracer.state, 1.0], [0.0] * layout.n
    coefficients = [*tracer.parameters.values()] if values else given.tolist()
    for (i, j, k), c in zip(terms.indices.T.tolist(), coefficients, strict=True):
        rows[i] = rows[i] + c * factors[j] * factors[k]
    return parts_of(tracer, [*map(tracer.result, rows)], values)


def of_entries(
    cls: Any,
    names: Any,
    equations: Any = None,
    definitions: Any = None,
    parameters: Any = None,
    time: Any = None,
    H: Any = None,
    K: Any = None,
    indices: Any = None,
    values: Any = None,
    quantities: Any = None,
) -> Any:
    """Return the field of a class `cls` with these entries of `to_dict`."""
    names = variables(names)
    if indices is not None and H is None and equations is None and not parameters:
        return cls._of(of_terms(coefficients.of_file(indices, values, len(names)), names))
    layout = layout_read(names, time)
    if H is not None and equations is not None:
        raise wrong("equations", "left out beside H", short(equations))
    if H is None and (not isinstance(equations, (list, tuple)) or len(equations) != layout.D):
        raise wrong("equations", f"a list of {layout.D} texts", short(equations))
    first, quantities = equations if H is None else [H], quantities or {}
    rows = [*first, *(a for of in quantities.values() for a in of)]
    tracer, rows, given = operands_of_texts(layout, rows, definitions, parameters)
    count, rest = len(first), iter(rows[len(first) :])
    read = {name: [next(rest) for _ in of] for name, of in quantities.items()}
    if H is None:
        return cls._of(parts_of(tracer, rows[:count], given, read))
    matrix = coefficients.structure_matrix(K, len(names))
    of_H = of_hamiltonian(tracer, names, [*given], rows[0], matrix, read)
    return cls._of({**given, LAYOUT: layout, EQUATIONS: of_H})
