"""Fields of any right-hand side: `Field`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np

from ... import checks
from ...checks import FloatArray
from ...core.lists.changes import Act
from ...core.lists.conditions import with_fixed_choices
from ...core.lists.derivative import gradients
from ...core.lists.right_hand_side import RightHandSide, in_order
from ...core.lists.step import evaluate
from ...keywords import public, public_class
from ..base import frozen
from .calls import called_by_name, operands_of_function
from .coefficients import structure_matrix
from .field_of_terms import LONGEST, NAMES, FieldOfFunction, OfMembers
from .mass import rates
from .names import variables
from .polynomials import named_parameters, to_lists
from .symbolic import Symbol, Symbols, Tracer
from .texts import brief, values_of, written

EQUATIONS = "equations"
_MOST_CHANGES = 16  # lists of changes, whose right-hand sides a field keeps
NO_MAP = (
    "a Field has a motion, flow(field, x0, time=T), whose functions take time=T in place of eps "
    "and steps, and no map: for Kahan's map of equations of degree 2 use "
    "QuadraticField.from_function(f, names), and equilibria(field, near=x0)"
)


class Equations:
    """The equations that all members of a family share: lists of f and, if it is there, of H.

    names, parameters  the variables, and the named parameters, in the order of values
    values, results    `Expressions` of f and of H, in an order that these determine, and f
    H, K               the operand of H, and the entries (i, j, value) of its matrix, or None
    """

    def __init__(
        self,
        names: Sequence[str],
        parameters: Sequence[str],
        values: Any,
        results: Sequence[Any],
        H: Any = None,
        K: Any = None,
    ) -> None:
        self.names, self.parameters, self.K = tuple(names), tuple(parameters), K
        self.values, operands = in_order(values, [*results, *([] if H is None else [H])])
        self.results = operands[: len(results)]
        self.H = None if H is None else operands[-1]

    @property
    def all_names(self) -> tuple[str, ...]:
        return (*self.names, *self.parameters)

    @cached_property
    def key(self) -> Any:
        """The part of a field that == compares, without texts and names."""
        sizes = len(self.names), len(self.parameters)
        return repr((sizes, self.values.operations, self.results, self.H, self.K))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Equations) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    @property
    def _identity(self) -> tuple[Any, ...]:
        return self.parameters, self.key

    @cached_property
    def right_hand_side(self) -> RightHandSide:
        values, results = in_order(self.values, self.results)
        return RightHandSide(values, results, len(self.parameters))

    @cached_property
    def texts(self) -> tuple[dict[str, str], list[str]]:
        """Definitions, and the texts of f, or that of H, from which f follows."""
        results = self.results if self.H is None else [self.H]
        return written(self.values, results, self.all_names)

    def shown(self, operand: Any) -> str:
        """Return the text of f_i or H for readers."""
        return brief(self.values, operand, self.all_names, LONGEST)

    def energy(self, x: Any, parameters: Any) -> Any:
        """Return H (...) at states (D, ...)."""
        values, (H,) = in_order(self.values, [self.H])
        known = dict(enumerate([*x, *parameters]))
        with np.errstate(all="ignore"):
            evaluate(values.operations, known)
        return H if isinstance(H, float) else known[H]

    def __reduce__(self) -> Any:
        values = self.values
        lists = values.operations, values.written, self.results, self.H, self.K
        return _restored, (self.names, self.parameters, *lists)


def _restored(names: Any, parameters: Any, operations: Any, texts: Any, *others: Any) -> Equations:
    values = Tracer(names, parameters).values
    for instruction, _, operands in operations:
        values.emit(instruction, *operands)
    values.written |= texts
    return Equations(names, parameters, values, *others)


@public_class
@dataclass(frozen=True, eq=False, repr=False, init=False)
class Field(FieldOfFunction):
    """A field with any right-hand side, ``x' = f(x)``, whose motion :func:`flow` computes.

    f is kept as a list of operations, from which its exact derivative follows. It is a formula of
    + - * / ** and of NumPy's exp, log, sqrt, cbrt, sin, cos, tan, sinh, cosh, tanh, their inverses,
    arctan2, hypot, expm1, log1p, exp2, log2, log10, logaddexp, abs, sign, minimum, maximum, clip,
    heaviside, floor, where, comparisons joined by & | ~, interp with a table of numbers, and
    SciPy's expit and erf. Sums, products and shifts of arrays are made of these. Equations of
    degree 2, of which Kahan's map is made, are a :class:`QuadraticField`.

    Attributes
    ----------
    dimension, names : int, tuple of str
        The number of variables, D, and their names.
    H, K : Energy and ndarray(shape=(D, D)), or None
        Of :meth:`from_hamiltonian`: the Hamiltonian, a function of a state, and the matrix K.
    parameters : dict
        Named parameters, which are coordinates of datasets and stores. ``==`` ignores them.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Field
    >>> pendulum = Field.from_function(lambda x: (x[1], -np.sin(x[0])), "q p")
    >>> pendulum
    Field(q' = p, p' = -sin(q))
    >>> pendulum([0.5, 2.0]).round(3)
    array([ 2.   , -0.479])
    """

    axes: ClassVar[Any] = {}
    texts: ClassVar[tuple[str, ...]] = ("names", "definitions", "equations", "H")
    called: ClassVar[str] = "a field without a map"
    may_escape = True
    has_map: ClassVar[bool] = False

    H: Energy | None
    _equations: Equations

    def __init__(self, *_: Any, **__: Any) -> None:
        raise TypeError("Field: use Field.from_function(f, names)")

    def _take(self, parts: Mapping[str, Any]) -> None:
        equations = parts[EQUATIONS]
        kept = {name: frozen(parts[name]) for name in equations.parameters}
        vars(self).update(
            parts=kept,
            _equations=equations,
            coordinates=tuple(kept),
            dimension=len(parts[NAMES]),
            names=parts[NAMES],
            labels=parts[NAMES],
            H=None if equations.H is None else Energy(self),
        )

    @property
    def _shared(self) -> dict[str, Any]:  # type: ignore[override]
        return {NAMES: self.names, EQUATIONS: self._equations}

    @property
    def _key(self) -> tuple[Any, ...]:
        values = {name: np.asarray(a, np.float64) for name, a in self.parts.items()}
        each = tuple((a.shape, *a.ravel().tolist()) for a in values.values())
        return self._equations.key, each

    @public
    def field(self) -> Any:
        raise TypeError(f"system: {NO_MAP}")

    @property
    def K(self) -> Any:
        """The matrix of a Hamiltonian field; None for other fields."""
        if self._equations.K is None:
            return None
        matrix = np.zeros((self.dimension, self.dimension))
        for i, j, value in self._equations.K:
            matrix[i, j] = value
        return matrix

    @property
    def _inputs(self) -> FloatArray:
        """The parameters (P, ...) of all members."""
        columns = [np.asarray(a, np.float64) for a in self.parts.values()]
        rows = [np.broadcast_to(a, self.shape) for a in columns]
        return np.array(rows).reshape(len(rows), *self.shape)

    @cached_property
    def _table(self) -> FloatArray:
        """The values of f that depend on parameters alone, of all members."""
        return self._equations.right_hand_side.table_of(self._inputs)

    @cached_property
    def right_hand_sides(self) -> list[OfMembers]:
        return self._of_members(_for_motion(self._equations, (), False), self._inputs)

    @cached_property
    def listed_right_hand_sides(self) -> list[OfMembers]:
        return self.derived_by(())

    def derived_by(self, names: tuple[str, ...]) -> list[OfMembers]:
        """Return those of variational equations, with the derivatives of f by parameters."""
        return self._of_members(_for_motion(self._equations, names, True), self._inputs)

    def _of_members(self, f: RightHandSide, parameters: FloatArray) -> list[OfMembers]:
        choices = np.zeros((f.P - len(parameters), *self.shape))  # of no state yet
        count = math.prod(self.shape)
        table = f.table_of(np.concatenate([parameters, choices])).reshape(len(f.table), count)
        return [OfMembers(np.arange(count), f, np.ascontiguousarray(table.T))]

    def _value_at(self, x: Any) -> FloatArray:
        x = checks.states("x", x, self.names, later=True)
        found = self._equations.right_hand_side.value(np.moveaxis(x, -1, 0), self._table)
        return np.moveaxis(found, 0, -1)

    def _traced_at(self, x: Symbols) -> Any:
        tracer, D = x[0].tracer, self.dimension
        known = {i: x[i].operand for i in range(D)}
        for k, (name, value) in enumerate(self.parts.items(), D):
            if self.shape and name not in tracer.parameters:
                raise TypeError(f"f(x) of a family needs its parameter {name} here")
            is_given = name in tracer.parameters
            known[k] = tracer.parameters[name].operand if is_given else float(value)
        equations = self._equations
        for instruction, number, operands in equations.values.operations:
            of = (a if isinstance(a, float) else known[a] for a in operands)
            known[number] = tracer.values.emit(instruction, *of)
        results = [a if isinstance(a, float) else known[a] for a in equations.results]
        return Symbols.of([Symbol(tracer, a) for a in results])

    def _slopes_at(self, x: FloatArray) -> FloatArray:
        found = self._equations.right_hand_side.jacobian(np.moveaxis(x, -1, 0), self._table)
        return np.moveaxis(found, (0, 1), (-2, -1))

    def _value_of(self, name: str, x: Any) -> FloatArray:
        """Return the value of `vector_field` or of `energy` at states."""
        if name == "vector_field":
            return self._value_at(x)
        if self.H is None:
            raise TypeError(
                "system: this field has no Hamiltonian: make it by Field.from_hamiltonian, or for "
                "that of another field call energy(another, run.states)"
            )
        return self.H(x)

    def _energy(self, x: FloatArray) -> Any:
        found = self._equations.energy(np.moveaxis(x, -1, 0), self._inputs)
        return np.asarray(found + 0.0 * x.sum(axis=-1))[()]

    @classmethod
    def _by_function(cls, f: Any, names: tuple[str, ...], values: dict[str, Any], M: Any) -> Field:
        tracer, rows = operands_of_function("f", f, names, values)
        rows = rows if M is None else rates(tracer, M, rows)
        _check_equalities(tracer.values, names, rows)
        equations = Equations(names, [*values], tracer.values, rows)
        return cls._of({**values, NAMES: names, EQUATIONS: equations})

    @classmethod
    def _by_hamiltonian(
        cls, H: Any, names: tuple[str, ...], values: dict[str, Any], K: Any
    ) -> Field:
        matrix = structure_matrix(K, len(names), names)
        tracer, [energy] = operands_of_function("H", H, names, values)
        equations = of_hamiltonian(tracer, names, [*values], energy, matrix)
        return cls._of({**values, NAMES: names, EQUATIONS: equations})

    def remake(self, **parameters: Any) -> Field:
        values = self.parts | named_parameters(parameters, self.names, has_map=False)
        return self._of({**values, **self._shared})

    @property
    def _formulas(self) -> Iterator[str]:
        return map(self._equations.shown, self._equations.results)

    @public
    def to_dict(self) -> dict[str, Any]:
        shared = self._equations
        definitions, texts = shared.texts
        found: dict[str, Any] = {"body": type(self).__name__, "names": [*self.names]}
        found |= {"definitions": definitions} if definitions else {}
        if shared.K is None:
            found["equations"] = texts
        else:
            i, j, values = map(list, zip(*shared.K, strict=True)) if shared.K else ([], [], [])
            K = {"indices": [i, j], "values": to_lists(np.array(values, object))}
            found |= {"H": texts[0], "K": K}
        return found | ({"parameters": to_lists(self.parameters)} if self.parameters else {})

    @classmethod
    def read(
        cls,
        names: Any,
        equations: Any = None,
        definitions: Any = None,
        H: Any = None,
        K: Any = None,
        parameters: Any = None,
    ) -> Field:
        names = variables("names", names, has_map=False)
        checks.instance("parameters", parameters or {}, Mapping)
        checks.instance("definitions", definitions or {}, Mapping)
        values = named_parameters(parameters or {}, names, has_map=False)
        rows = [H] if H is not None else equations
        is_list = isinstance(rows, (list, tuple)) and (H is not None or len(rows) == len(names))
        if not is_list or (H is None) == (equations is None):
            expected = f"a list of {len(names)} texts, or left out beside H"
            raise checks.wrong("equations", expected, checks.short(equations))
        tracer = Tracer(names, [*values])
        known = dict(zip(names, tracer.state, strict=True)) | tracer.parameters
        texts = [*(definitions or {}).items(), *enumerate(rows)]
        found = values_of(texts, known, called_by_name)
        try:
            operands = [tracer.result(found[k]) for k in range(len(rows))]
        except TypeError as error:
            raise ValueError(f"equations: {error}") from None
        if H is None:
            shared = Equations(names, [*values], tracer.values, operands)
        else:
            matrix = structure_matrix(K, len(names))
            shared = of_hamiltonian(tracer, names, [*values], operands[0], matrix)
        return cls._of({**values, NAMES: names, EQUATIONS: shared})


def _check_equalities(values: Any, names: Sequence[str], rows: Sequence[Any]) -> None:
    """Raise ValueError where f asks whether a clock equals a number: a step meets no such time."""
    clocks = {i for i, rate in enumerate(rows) if isinstance(rate, float) and rate != 0.0}
    for name, _, operands in values.operations:
        for a, b in (operands, operands[::-1]) if name == "oeq" else ():
            if type(a) is int and a in clocks and isinstance(b, float) and b != 0.0:
                raise ValueError(
                    f"f: {names[a]} == {b:g} holds at no step of the motion, whatever f is then: "
                    f"what happens at that time is Change(times=[{b:g}], to=...)"
                )


@lru_cache(64)
def _for_motion(
    equations: Equations, names: tuple[str, ...], twice: bool, acts: tuple[Act, ...] = ()
) -> RightHandSide:
    """Return f with choices that are fixed within a step, and its derivatives by parameters.

    `twice` asks for the second derivative, and `acts` are changes of the state.
    """
    values, results = in_order(equations.values, equations.results)
    by = [len(equations.names) + equations.parameters.index(name) for name in names]
    P = len(equations.parameters)
    return with_fixed_choices(values, results, P, by, twice, acts)


def with_changes(
    field: Any, acts: tuple[Act, ...], names: tuple[str, ...] = (), twice: bool = False
) -> list[OfMembers]:
    """Return the right-hand sides of members of any field, with changes of the state.

    `acts` are in the order of code, `names` those of parameters to differentiate by, and `twice`
    asks for what variational equations need.
    """
    key, known = (acts, names, twice), vars(field).setdefault("_with_changes", {})
    if key not in known:
        if len(known) >= _MOST_CHANGES:
            known.clear()
        if isinstance(field, Field):
            f = _for_motion(field._equations, names, twice, acts)
            known[key] = field._of_members(f, field._inputs)
        else:
            known[key] = field._by_lists(
                lambda own: with_changes(own, acts, (), twice), acts, twice
            )
    return known[key]


class Energy:
    """The Hamiltonian of a field, or of a family; H(x) is its value (...) at states x (..., D)."""

    def __init__(self, field: Field) -> None:
        self._of = field

    def __call__(self, x: Any) -> Any:
        return self._of._energy(checks.states("x", x, self._of.names, later=True))

    def __repr__(self) -> str:
        return self._of._equations.shown(self._of._equations.H)


def of_hamiltonian(
    tracer: Tracer, names: Sequence[str], parameters: Sequence[str], energy: Any, matrix: Any
) -> Equations:
    """Return the equations x' = K grad H, by the derivative of the list of H."""
    # A list in its own order, so that the gradient is the same after reading a text of H.
    values, [H] = in_order(tracer.values, [energy])
    [slopes] = gradients(values, [*values.operations], [H], len(names))
    rows: list[Any] = [None] * len(names)  # an operand may be 0, the number of the first variable
    for i, j, c in matrix.T:
        if j in slopes:
            part = values.emit("fmul", float(c), slopes[j])
            rows[i] = part if rows[i] is None else values.emit("fadd", rows[i], part)
    entries = tuple((int(i), int(j), Fraction(c)) for i, j, c in matrix.T)
    rates = [0.0 if row is None else row for row in rows]
    return Equations(names, parameters, values, rates, H, entries)
