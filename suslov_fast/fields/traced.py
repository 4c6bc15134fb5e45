"""The base of fields and maps: a traced function of the state, with names and parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from textwrap import shorten
from typing import Any, ClassVar, Self

import numpy as np

from .. import checks
from ..checks import FloatArray, short, wrong
from ..core.cached import cached_property
from ..core.expressions.programs import Program, emitted
from ..keywords import public
from .base import Body, Parameters, frozen, summary
from .complex_symbols import Complex
from .equation_text import values_of
from .equations import Equations
from .exact_numbers import named_parameters, numbers_by_name, to_lists
from .layout import Layout, layout_read, split_values
from .names import labels, variables
from .right_hand_sides import by_code_if_often
from .symbols import Symbol, Symbols
from .tolerances import LONGEST_SHORTENED
from .tracer import Tracer, called_by_name, components

# Keys of the parts of a field or map other than its parameters. They contain spaces, because a
# parameter can have any name that Python accepts.
LAYOUT, EQUATIONS = "layout of variables", "equations of f"
INDICES, VALUES = "indices of f", "values of f"  # parts of a field of terms

_FLOATS = {float}


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Traced(Body):
    """The base of `Field` and `Map`: their function f is stored as a list of operations."""

    _texts: ClassVar[tuple[str, ...]] = ("names", "time", "definitions", "equations")
    _variable: ClassVar[str] = "x"
    _arrow: ClassVar[str]  # what stands between a variable and its formula in texts

    names: tuple[str, ...]
    _equations: Equations | Any  # None if a field is stored as polynomial terms
    _common: dict[str, Any]  # attributes that do not depend on the values of parameters

    @public
    def with_parameters(self, /, **parameters: Any) -> Self:
        """Return the field or map with other values of parameters; f is not called again.

        Parameters
        ----------
        **parameters : float or array_like(float, shape=(...))
            New values; the other parameters keep their values.

        Returns
        -------
        Field or Map
            A single one, or a family.

        Raises
        ------
        TypeError, ValueError
            If there is no such parameter, a value is not a finite number, or an integral that the
            field keeps changes along motions with the new values.

        Examples
        --------
        >>> from suslov_fast import Field
        >>> decay = Field(lambda x, k: (-k * x[0],), "c", k=1.0)
        >>> decay.with_parameters(k=2.0)([3.0])
        array([-6.])
        """
        known = self._coordinates
        parameters = split_values(parameters, known)
        if unknown := [name for name in parameters if name not in known]:
            how = f"it has {', '.join(known) or 'none'}; defaults of f are constants"
            raise TypeError(f"with_parameters: no parameter {', '.join(unknown)}: {how}")
        other = self._with_parts(self._parts | numbers_by_name(parameters))
        other._check_kept()
        return other

    def _check_kept(self) -> None:
        """Raise ValueError if integrals that a field keeps change with its parameters."""

    # ------------------------------------------------------------------------------ parts
    def _take(self, parts: Mapping[str, Any]) -> None:
        kept = {n: frozen(a) for n, a in parts.items() if n not in (LAYOUT, EQUATIONS)}
        layout, equations = parts[LAYOUT], parts.get(EQUATIONS)
        common = {
            "_coordinates": tuple(name for name in kept if name not in self._axes),
            "_layout": layout,
            "dimension": layout.n,
            "names": layout.names,
            "_equations": equations,
            "_quantities": equations.sizes if equations else {},
        }
        vars(self).update(common, _common=common, _parts=kept)

    @property
    def _shared(self) -> dict[str, Any]:
        return {LAYOUT: self._layout, EQUATIONS: self._equations}

    def _with_parts(self, parts: Mapping[str, Any]) -> Any:
        if self.shape or not _FLOATS.issuperset(map(type, parts.values())):
            return super()._with_parts(parts)
        other = object.__new__(type(self))  # this is faster than `_of`
        common = self._common
        vars(other).update(common, _common=common, _parts=parts, shape=())
        return other

    @property
    def _key(self) -> tuple[Any, ...]:
        arrays = [np.asarray(a, np.float64) for a in self._parts.values()]
        values = tuple((a.shape, *a.ravel().tolist()) for a in arrays)
        return self._layout.key, self._equations and self._equations.key, values

    @property
    def parameters(self) -> dict[str, Any]:
        """The named parameters of the function: numbers as they were given, and arrays."""
        return Parameters({name: self._parts[name] for name in self._coordinates})

    # ------------------------------------------------------------------------------ values
    def __call__(self, *x: Any, t: Any = None, **parameters: Any) -> Any:
        """Return f(x) (..., D) at states x (..., D), and at time t if f takes the time."""
        if len(x) != 1 or parameters:
            values = ", ".join(f"{name}={short(value)}" for name, value in parameters.items())
            how = "lambda t, x: system(x), where t is passed too"
            how = "lambda t, x: system(x, t=t)" if self._layout.clock is not None else how
            how = f"system.with_parameters({values})(x)" if parameters else how
            raise TypeError(f"system(x) takes the state alone: pass {how}")
        if isinstance(x[0], Symbols):
            return self._traced_at(x[0], t)
        layout = self._layout
        return layout.leave(self._value(layout.enter("x", x[0], t, "t")))

    def _value(self, x: FloatArray) -> FloatArray:
        """Return f(x) (..., D) at states of the engine."""
        f, table = self._with_table
        if x.ndim == table.ndim == 1 and (one := by_code_if_often(f, "f", x, table)) is not None:
            return one
        return np.moveaxis(f.value(np.moveaxis(x, -1, 0), table), 0, -1)

    @public
    def jacobian(self, x: Any, *, t: Any = None) -> FloatArray:
        """Return the exact derivative f'(x) of the right-hand side, or of the map.

        :func:`kahan.jacobian` is the derivative of a step of Kahan's map of a field.

        Parameters
        ----------
        x : array_like(float, shape=(..., D))
            States, which broadcast with the batch of the system.
        t : array_like(float, shape=(...)), optional
            The time, if f takes it.

        Returns
        -------
        ndarray(float, shape=(..., D, D))
            The derivative of component i with respect to variable j at [..., i, j]. If f has
            branches, as of ``np.where``, it is the derivative of the branch at x. A complex
            variable z counts as two real ones, its parts.

        Examples
        --------
        >>> from suslov_fast import Field
        >>> field = Field(lambda x: (x[0] * x[1], 3 - x[0]), 2)
        >>> field.jacobian([2.0, 5.0])
        array([[ 5.,  2.],
               [-1.,  0.]])
        """
        return self._layout.leave_slopes(self._slopes(self._layout.enter("x", x, t, "t")))

    def _slopes(self, x: FloatArray) -> FloatArray:
        """Return f'(x) (..., D, D) at states of the engine."""
        f, table = self._with_table
        if x.ndim == table.ndim == 1:
            entries = by_code_if_often(f, "derivative", x, table)
            if entries is not None:
                return f.matrix_of(entries)
        slopes = f.jacobian(np.moveaxis(x, -1, 0), table)
        return np.moveaxis(slopes, (0, 1), (-2, -1))

    @property
    def _program(self) -> Equations:
        """The equations of f; for a field of terms, the coefficients are their parameters."""
        return self._equations

    @property
    def _inputs(self) -> FloatArray:
        """The parameters (P, ...) of all members."""
        if self._equations is None:
            return np.moveaxis(np.asarray(self._parts[VALUES], np.float64), -1, 0)
        if not self.shape:
            return np.array([*self._parts.values()], np.float64)
        rows = [np.broadcast_to(a, self.shape) for a in self._arrays.values()]
        return np.array(rows, np.float64).reshape(len(rows), *self.shape)

    @cached_property
    def _with_table(self) -> tuple[Any, FloatArray]:
        """The right-hand side, and its values that depend only on parameters, for all members."""
        f = self._program.with_products
        return f, f.table_of(self._inputs)

    def _traced_at(self, x: Symbols, t: Any) -> Any:
        """Return f(x) of symbols, by default at the time of these symbols."""
        tracer, layout, equations = x[0].tracer, self._layout, self._program
        D, time = layout.D, tracer.time if t is None else t
        new = dict(enumerate(components(tracer, layout, x, time)))
        given = tracer.real_parameters
        for k, (name, value) in enumerate(zip(equations.parameters, self._inputs, strict=True), D):
            if self.shape and name not in given:
                raise TypeError(f"f(x) of a family needs its parameter {name} here")
            new[k] = given[name].operand if name in given else float(value)
        program = Program(equations.values.operations, equations.results)
        symbols = [Symbol(tracer, a) for a in emitted(tracer.values, program, new)]
        return Symbols.of(layout.joined(symbols, Complex.of))

    # ------------------------------------------------------------------------------ texts
    @property
    def _formulas(self) -> Iterator[str]:
        return map(self._equations.shown, self._equations.results[: self._layout.size])

    @property
    def _numbers(self) -> list[tuple[str, Any]]:
        return [*self.parameters.items()]

    def __repr__(self) -> str:
        kind = type(self).__name__
        if self.shape:
            is_named = self.names != labels(self.dimension)
            names = f"variables {' '.join(self.names)}" if is_named else f"D={self.dimension}"
            values = [summary(name, each) for name, each in self.parameters.items()]
            return f"<{kind}, a family of shape {self.shape}: {', '.join([names, *values])}>"
        named = zip(self._layout.parts, self._formulas, strict=True)
        # More rows than LONGEST_SHORTENED // 4 do not fit.
        rows = [
            f"{a}{self._arrow} {formula}" for a, formula in islice(named, LONGEST_SHORTENED // 4)
        ]
        rows += [f"{name} = {value}" for name, value in self._numbers]
        return f"{kind}({shorten(', '.join(rows), LONGEST_SHORTENED, placeholder=' ...')})"

    @public
    def to_dict(self) -> dict[str, Any]:
        entries = {"body": type(self).__name__, **self._layout.entries, **self._described()}
        return entries | ({"parameters": to_lists(self.parameters)} if self.parameters else {})

    def _described(self) -> dict[str, Any]:
        """Return the entries of `to_dict` for f."""
        definitions, texts = self._equations.texts
        count = self._layout.D if self._equations.H is None else 1
        sizes, rest = self._equations.sizes, iter(texts[count:])
        described = {"definitions": definitions} if definitions else {}
        described["equations"] = texts[:count]
        if sizes:
            described["quantities"] = {a: [next(rest) for _ in range(n)] for a, n in sizes.items()}
        return described

    @classmethod
    def _read(
        cls,
        names: Any,
        equations: Any,
        definitions: Any = None,
        parameters: Any = None,
        time: Any = None,
    ) -> Self:
        layout = layout_read(variables(names), time)
        if not isinstance(equations, (list, tuple)) or len(equations) != layout.D:
            raise wrong("equations", f"a list of {layout.D} texts", short(equations))
        tracer, rows, given = operands_of_texts(layout, equations, definitions, parameters)
        return cls._of(parts_of(tracer, rows, given))


def settled(layout: Layout, equations: Equations) -> dict[str, Any]:
    """Return the parts of a field but for parameters; a time that nothing reads is left out."""
    if layout.clock is not None and not equations.read_last:
        layout, equations = layout.untimed, equations.without_last
    return {LAYOUT: layout, EQUATIONS: equations}


def parts_of(
    tracer: Tracer, rows: Sequence[Any], values: Mapping[str, Any], quantities: Any = None
) -> dict[str, Any]:
    """Return the parts of a field or map: operands `rows` are f, `values` are the parameters."""
    layout, ratios = tracer.layout, tracer.ratios
    equations = Equations(
        layout.components, [*values], tracer.values, rows, ratios=ratios, quantities=quantities
    )
    return {**values, **settled(layout, equations)}


def operands_of_texts(
    layout: Layout, rows: Sequence[Any], definitions: Any, parameters: Any
) -> tuple[Tracer, list[Any], dict[str, Any]]:
    """Return the tracer and the operands of the texts `rows`, and the checked parameters."""
    definitions, parameters = definitions or {}, parameters or {}
    checks.instance("parameters", parameters, Mapping)
    checks.instance("definitions", definitions, Mapping)
    given = named_parameters(parameters, layout.components)
    tracer = Tracer(layout, [*given])
    known = tracer.known
    values = values_of([*definitions.items(), *enumerate(rows)], known, called_by_name)
    try:
        return tracer, [tracer.result(values[k]) for k in range(len(rows))], given
    except TypeError as error:
        raise ValueError(f"equations: {error}") from None
