"""Maps x -> f(x) of one's own, and families of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NoReturn

import numpy as np

from ..checks import FloatArray, arguments_of
from ..core.cached import cached_property
from ..core.expressions.programs import in_order
from ..core.maps.map_step import MapStep, map_step
from ..keywords import public_class
from .equations import Equations
from .exact_numbers import named_parameters
from .field import Field
from .layout import split_values
from .names import TIME, check_for_map, laid_out
from .traced import EQUATIONS, LAYOUT, Traced, parts_of
from .tracer import Tracer
from .user_function import UserFunction


@public_class
@dataclass(frozen=True, eq=False, repr=False, init=False)
class Map(Traced):
    """A map of one's own, ``x -> f(x)``, or a family of maps.

    :func:`iterate` and :func:`lyapunov_exponents` iterate it, ``map(x)`` is one step, and
    :func:`equilibria` finds its fixed points. A step has no length in time: there is no eps, and
    ``run.time`` counts steps. The module ``integrability`` accepts a rational map. f may contain
    the functions that f of a :class:`Field` may contain, such as ``np.mod`` and ``np.where``.

    Parameters
    ----------
    f : callable
        Takes the state x, an array of D variables, and parameters by name, and returns the D
        components of the next state. f is called with symbols, twice, with equal results.
    names, complex, **parameters
        As for a :class:`Field`.

    Attributes
    ----------
    dimension, names, parameters
        As for a :class:`Field`.

    Raises
    ------
    TypeError, ValueError
        As for a :class:`Field`.

    See Also
    --------
    Field : Equations x' = f(x), with Kahan's map if f is of degree 2.

    Examples
    --------
    >>> from suslov_fast import Map, iterate, lyapunov_exponents
    >>> henon = Map(lambda x, a, b: (1 - a * x[0] ** 2 + x[1], b * x[0]), "x y", a=1.4, b=0.3)
    >>> henon
    Map(x -> 1 - a*x**2 + y, y -> b*x, a = 1.4, b = 0.3)
    >>> iterate(henon, [0.0, 0.0], steps=3)["x"]
    array([ 0.   ,  1.   , -0.4  ,  1.076])
    >>> lyapunov_exponents(henon, [0.0, 0.0], steps=100_000, transient=1000).round(2)
    array([ 0.42, -1.62])
    """

    _called: ClassVar[str] = "a map"
    _arrow: ClassVar[str] = " ->"
    _left: ClassVar[str] = r"\tilde{%s}"
    _has_eps: ClassVar[bool] = False

    def __init__(
        self,
        f: Callable[..., Any],
        /,
        names: int | str | Sequence[str],
        *,
        complex: Any = False,
        **parameters: Any,
    ) -> None:
        layout, parameters = laid_out(f, names, complex, False, parameters)
        if TIME & {*arguments_of(f), *parameters}:
            call = "Map(lambda s: (*f(s[:-1], s[-1]), s[-1] + 1), names)"
            how = "the number of the step is a variable that grows by 1"
            raise TypeError(f"f: {how}, as in {call}, and no argument t")
        of_f = UserFunction("f", f, parameters)
        of_f.check(layout.names, parameters)
        values = named_parameters(split_values(parameters), layout.components)
        check_for_map((), [name for name in values if name != "eps"])
        tracer = Tracer(layout, [*values])
        rows = of_f.formulas(tracer)
        self._take(parts_of(tracer, rows, values))

    def _value(self, x: FloatArray) -> FloatArray:
        found = super()._value(x)
        exists = np.isfinite(found) & ~np.isnan(x)
        return np.where(exists.all(axis=-1, keepdims=True), found, np.nan)

    @property
    def _field(self) -> NoReturn:
        how = "iterate(map, x0, steps=N); for x' = f(x) make a Field"
        raise TypeError(f"system: a Map is x -> f(x), without a motion or Kahan's map: use {how}")

    @property
    def _displacement(self) -> Field:
        """The field f(x) - x; its equilibria are the fixed points of the map."""
        parts = self._equations
        values, results = in_order(parts.values, parts.results)  # a copy, as `emit` adds to it
        rates = [values.emit("fsub", a, i) for i, a in enumerate(results)]
        equations = Equations(parts.names, parts.parameters, values, rates)
        return Field._of({**self._parts, LAYOUT: self._layout, EQUATIONS: equations})

    @property
    def _operations(self) -> MapStep:
        """The list of operations of a step."""
        return map_step(self._equations.right_hand_side)

    @cached_property
    def _rows(self) -> Any:
        """The parameters (..., P) of all members."""
        return np.moveaxis(self._inputs, 0, -1)
