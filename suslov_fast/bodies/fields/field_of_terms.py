"""The terms that a field keeps, and tables of its coefficients, made where someone asks."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...checks import FloatArray, arguments_of
from ...core.lists.changes import Act
from ...core.lists.conditions import with_fixed_choices
from ...core.lists.dense import DenseRightHandSide, dense_parameters
from ...core.lists.quadratic import expressions_of, parameters_of
from ...core.lists.right_hand_side import RightHandSide
from ...keywords import public
from ..base import Body, Parameters, frozen, summary
from .calls import check_function
from .latex import symbol
from .mass import parted
from .names import labels, variables
from .polynomials import named_parameters
from .symbolic import Symbols
from .terms import Hamiltonian, Terms, rates, table_of, without_zeros

# Names of the parts of a field other than its named parameters. They hold spaces, because a named
# parameter can have any name that Python accepts.
INDICES, VALUES, NAMES = "indices of f", "values of f", "names of variables"
H_INDICES, H_VALUES, MATRIX = "indices of H", "values of H", "matrix K"
TYPED = "f as typed"


LONGEST = 300  # characters of a repr
_LONG = 4000  # terms, above which a dense field is taken by loops


class OfMembers(NamedTuple):
    """The right-hand side of some members of a family, or of a single field."""

    members: NDArray[np.int64]  # their numbers (K,)
    f: Any  # a `RightHandSide`
    table: FloatArray  # its numbers (K, n), see `RightHandSide.table_of`


@dataclass(frozen=True, eq=False, repr=False, init=False)
class FieldOfFunction(Body):
    """A field whose parts include named parameters, those of the function that it is made of."""

    names: tuple[str, ...]
    H: Any
    right_hand_sides: ClassVar[Any]  # f for the motion, for groups of members: `OfMembers`
    listed_right_hand_sides: ClassVar[Any]  # the same for variational equations
    _shared: ClassVar[dict[str, Any]]  # parts that all members share, beside arrays
    _value_at: ClassVar[Any]  # f(x)
    _traced_at: ClassVar[Any]  # the same with symbols
    _slopes_at: ClassVar[Any]  # f'(x) (..., D, D) at checked states
    _formulas: ClassVar[Any]  # the texts of f, component by component

    variable: ClassVar[str] = "x"
    has_map: ClassVar[bool] = True  # whether datasets of runs have the names eps and n
    _by_function: ClassVar[Any]  # makes the field of f, names, checked parameters and M
    _by_hamiltonian: ClassVar[Any]  # makes that of H, names, checked parameters and K

    @classmethod
    @public
    def from_function(
        cls,
        f: Callable[..., Any],
        /,
        dimension: int | str | Sequence[str],
        *,
        mass: Any = None,
        **parameters: Any,
    ) -> Self:
        """Return the field ``x' = f(x, **parameters)``, or a family; with `mass` M x' = f.

        Parameters
        ----------
        f : callable
            Takes the state x, an array of D variables, and returns their D derivatives: formulas
            that the class has, of a `QuadraticField` polynomials of degree 2 or less. Time is a
            variable with the rate 1: ``lambda s: (..., 1.0)`` and names ``"x v t"``. It is called
            with symbols, twice or more, so the coefficients of a `QuadraticField` are exact: 0.1 is
            the double nearest to 1/10.
        dimension : int, str or sequence of str
            The number of variables, D, or their names, such as ``"u v w"``.
        mass : callable or array_like(float, shape=(D, D)), optional
            Of a `Field`: the matrix M of equations ``M(x) x' = f(x)``, numbers, or a function of
            the state, and of parameters by name, that returns it. M is eliminated as formulas,
            without row exchanges: where it depends on x, for D up to some 12, if it is not sparse.
            Where a pivot becomes 0 solutions end. If f itself takes `mass`, it is a parameter.
        **parameters : float or array_like(float, shape=(...))
            Named parameters of f, and of `mass`. Numbers remain exact; arrays broadcast, and make a
            batch of fields. Names of variables, t, those of datasets, and eps with a map, are
            refused.

        Returns
        -------
        QuadraticField or Field
            A single field, or a batch of the shape of the parameters.

        Raises
        ------
        TypeError, ValueError
            If f does not take the state as one argument, lacks a parameter, returns another number
            of derivatives or formulas that the class does not have, asks for the value of a symbol
            as Python's ``if`` does, or returns something else when it is called again; if M is
            singular, or has another shape.

        Examples
        --------
        >>> from suslov_fast import Field, QuadraticField
        >>> def lotka_volterra(x, a):
        ...     return x[0] - x[0] * x[1], a * (x[0] * x[1] - x[1])
        >>> QuadraticField.from_function(lotka_volterra, "u v", a=0.5)
        QuadraticField(u' = -u*v + u, v' = 1/2*u*v - 1/2*v)
        >>> family = QuadraticField.from_function(lotka_volterra, "u v", a=[0.5, 1, 2])
        >>> family.shape, family.sel(a=2)
        ((3,), QuadraticField(u' = -u*v + u, v' = 2*u*v - 2*v))
        >>> import numpy as np
        >>> def thermostat(x, least):
        ...     return (np.where(x[0] < least, 1.0, 0.0) - 0.1 * x[0],)
        >>> Field.from_function(thermostat, "T", least=[18.0, 20.0])([19.0])
        array([[-1.9],
               [-0.9]])

        A bead on a parabola q**2 / 2, whose inertia depends on q:

        >>> Field.from_function(
        ...     lambda x: (x[1], -x[0] * (x[1] ** 2 + 1)),
        ...     "q v",
        ...     mass=lambda x: [[1, 0], [0, 1 + x[0] ** 2]],
        ... )
        Field(q' = v, v' = -q*(v**2 + 1)/(1 + q**2))
        """
        names = variables("dimension", dimension, has_map=cls.has_map)
        if mass is not None and (cls.has_map or "mass" in arguments_of(f)):
            parameters, mass = {**parameters, "mass": mass}, None
        if mass is None:
            check_function("f", f, names, parameters)
        else:
            f, mass = parted(f, mass, names, parameters)
        values = named_parameters(parameters, names, has_map=cls.has_map)
        return cls._by_function(f, names, values, mass)

    @classmethod
    @public
    def from_hamiltonian(
        cls,
        H: Callable[..., Any],
        /,
        dimension: int | str | Sequence[str],
        K: Any = None,
        **parameters: Any,
    ) -> Self:
        """Return the Hamiltonian field ``x' = K grad H(x, **parameters)``.

        The map of a `QuadraticField` conserves :func:`modified_energy` exactly, so that the energy
        does not drift; orders 4 to 8 of the map do not conserve it.

        Parameters
        ----------
        H : callable
            Takes the state x, an array of D variables, and returns a number: of a `QuadraticField`
            a polynomial of degree 3 or less, of a `Field` a formula of its class.
        dimension : int, str or sequence of str
            As in :meth:`from_function`.
        K : array_like(shape=(D, D)), optional
            A constant antisymmetric matrix, of any rank. By default D is even, and K is the
            canonical matrix of x = (q1, ..., qm, p1, ..., pm): first all coordinates, then all
            momenta.
        **parameters : float or array_like(float, shape=(...))
            As in :meth:`from_function`.

        Returns
        -------
        QuadraticField or Field
            It has the attributes `H` and `K`.

        Raises
        ------
        TypeError, ValueError
            As :meth:`from_function`; also if K is not antisymmetric, or D odd without K.

        Examples
        --------
        >>> import numpy as np
        >>> from suslov_fast import Field, QuadraticField
        >>> QuadraticField.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, 2)
        QuadraticField(x1' = x2, x2' = -3*x1^2 + 1, H = x1^3 + 1/2*x2^2 - x1)
        >>> Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - np.cos(x[0]), "q p")
        Field(q' = p, p' = -sin(q), H = p**2/2 - cos(q))
        """
        names = variables("dimension", dimension, has_map=cls.has_map)
        check_function("H", H, names, parameters)
        values = named_parameters(parameters, names, has_map=cls.has_map)
        return cls._by_hamiltonian(H, names, values, K)

    @public
    def with_parameters(self, /, **parameters: Any) -> Self:
        """Return the field with other values of named parameters.

        The function f of a `Field` is not called again.

        Parameters
        ----------
        **parameters : float or array_like(float, shape=(...))
            New values; the other parameters stay as they are.

        Returns
        -------
        QuadraticField or Field
            A single field, or a batch.

        Raises
        ------
        TypeError, ValueError
            If the field has no such parameter, or a value is not a finite number; for a
            `QuadraticField` that does not know its function: a copy, a member, one from a file.

        Examples
        --------
        >>> from suslov_fast import Field
        >>> decay = Field.from_function(lambda x, k: (-k * x[0],), "c", k=1.0)
        >>> decay.with_parameters(k=2.0)([3.0])
        array([-6.])
        """
        known = self.parameters
        if unknown := [name for name in parameters if name not in known]:
            how = f"it has {', '.join(known)}" if known else "it has none"
            how += ": from_function takes the value of each, and defaults of f are constants"
            raise TypeError(f"with_parameters: no parameter {', '.join(unknown)}: {how}")
        if self.remake is None:
            raise TypeError("with_parameters: this field does not know its function: make it again")
        return self.remake(**{**known, **parameters})

    @property
    def arrays(self) -> dict[str, FloatArray]:
        return {name: np.asarray(a, np.float64) for name, a in self.parameters.items()}

    @property
    def parameters(self) -> dict[str, Any]:
        """The named parameters of the function: numbers as they were given, and arrays."""
        return Parameters({name: self.parts[name] for name in self.coordinates})

    def __call__(self, x: Any = None, *others: Any, **named: Any) -> Any:
        """Return f(x): fractions if all numbers of a quadratic field are exact, else floats."""
        if others or named:
            how = "for solve_ivp pass lambda t, x: field(x)"
            if named:
                how = f"for another value field.with_parameters({next(iter(named))}=...)(x)"
            raise TypeError(f"a field takes the state alone, field(x), one array or a dict: {how}")
        return self._traced_at(x) if isinstance(x, Symbols) else self._value_at(x)

    @public
    def jacobian(self, x: Any) -> FloatArray:
        """Return the exact derivative f'(x) of the right-hand side.

        :func:`suslov_fast.jacobian` is the derivative of a step of a map.

        Parameters
        ----------
        x : array_like(float, shape=(..., D))
            States, which broadcast with the batch of the field.

        Returns
        -------
        ndarray(float, shape=(..., D, D))
            The derivative of component i with respect to variable j at [..., i, j]. Where f
            chooses, as ``np.where`` does, it is that of the branch.

        Examples
        --------
        >>> from suslov_fast import QuadraticField
        >>> field = QuadraticField.from_function(lambda x: (x[0] * x[1], 3 - x[0]), 2)
        >>> field.jacobian([2.0, 5.0])
        array([[ 5.,  2.],
               [-1.,  0.]])
        """
        return self._slopes_at(checks.states("x", x, self.names))

    def with_parts(self, parts: Mapping[str, Any]) -> Any:
        return self._of({**parts, **self._shared})

    def _named(self, names: Sequence[str]) -> Any:
        """Return the field with other names of variables."""
        return self._of({**self.parts, **self._shared, NAMES: tuple(names)})

    def __reduce__(self) -> tuple[Any, ...]:
        return self._of, ({**self.parts, **self._shared},)

    def _rows_in_latex(self) -> tuple[list[tuple[str, str]], dict[str, str]]:
        labels = [*map(symbol, self.names)]
        rows = [(rf"\dot{{{a}}}", b) for a, b in zip(labels, self._formulas, strict=True)]
        rows += [] if self.H is None else [("H", str(self.H))]
        numbers = () if self.has_map else self.parameters.items()  # else formulas hold the values
        return rows + [(symbol(name), str(value)) for name, value in numbers], {}

    def __repr__(self) -> str:
        kind, length = type(self).__name__, 0
        if self.shape:
            is_named = self.names != labels(self.dimension)
            names = f"variables {' '.join(self.names)}" if is_named else f"D={self.dimension}"
            values = [summary(name, each) for name, each in self.parameters.items()]
            return f"<{kind} of shape {self.shape}: {', '.join([names, *values])}>"
        equations, formulas = [], iter(self._formulas)
        for name in self.names:
            equations.append(f"{name}' = {next(formulas)}")
            length += len(equations[-1])
            if length > LONGEST:
                break
        equations += [] if self.H is None else [f"H = {self.H}"]
        if not self.has_map:  # else formulas hold the values
            equations += [f"{name} = {value}" for name, value in self.parameters.items()]
        return f"{kind}({textwrap.shorten(', '.join(equations), LONGEST, placeholder=' ...')})"


@dataclass(frozen=True, eq=False, repr=False, init=False)
class _FieldOfTerms(FieldOfFunction):
    """The parts of a field: its terms, those of H, the matrix K, names and named parameters."""

    axes: ClassVar[Any] = {INDICES: 2, VALUES: 1, H_INDICES: 2, H_VALUES: 1, MATRIX: 2}

    _typed: Any  # `Equations`, or None where no function made this field

    def _take(self, parts: Mapping[str, Any]) -> None:
        """Store the terms of f, or those of H and K with or without them, names and parameters."""
        names, typed, H = parts[NAMES], parts.get(TYPED), None
        kept = {name: value for name, value in parts.items() if name not in (NAMES, TYPED)}
        if H_VALUES in kept:
            energy = without_zeros(kept[H_INDICES], np.asarray(kept[H_VALUES]))
            kept |= {H_INDICES: energy.indices, H_VALUES: energy.values}
            H = Hamiltonian(energy, names)
            # The terms of f follow from H and K, unless a family has rounded ones.
            if VALUES not in kept or energy.values.ndim == 1:
                terms = rates(energy, kept[MATRIX], len(names))
                kept |= {INDICES: terms.indices, VALUES: terms.values}
        indices, values = without_zeros(kept[INDICES], np.asarray(kept[VALUES]))
        if values.ndim > 1:
            values = values.astype(np.float64)
        kept |= {INDICES: indices, VALUES: values}
        parts = {name: frozen(value) for name, value in kept.items()}
        vars(self).update(
            parts=parts,
            coordinates=tuple(name for name in parts if name not in self.axes),
            H=H,
            dimension=len(names),
            names=names,
            labels=names,
            _typed=typed,
        )

    @property
    def _shared(self) -> dict[str, Any]:  # type: ignore[override]
        return {NAMES: self.names, TYPED: self._typed}

    @property
    def _key(self) -> tuple[Any, ...]:
        return self.dimension, *super()._key

    def __reduce__(self) -> tuple[Any, ...]:
        typed = None if self._as_typed[1] is None else self._typed
        return self._of, ({**self.parts, NAMES: self.names, TYPED: typed},)

    @property
    def K(self) -> Any:
        """The matrix of a Hamiltonian field, made where it is used; None for other fields."""
        if self.H is None:
            return None
        matrix = self.parts[MATRIX]
        shape = (self.dimension, self.dimension)
        return table_of("K", shape, matrix[:2].astype(np.int64), matrix[2])

    @property
    def may_escape(self) -> bool:
        return bool((self.parts[INDICES][2] < self.dimension).any())

    @cached_property
    def _terms(self) -> Any:
        return Terms(self.parts[INDICES], self.parts[VALUES]).floats

    @property
    def _rows(self) -> FloatArray:
        """The values of terms of all members (K, T)."""
        _, values = self._terms
        return values.reshape(math.prod(self.shape), values.shape[-1])

    @property
    def _named_values(self) -> list[FloatArray]:
        """The named parameters (K,) of all members."""
        return [np.broadcast_to(a, self.shape).ravel() for a in self.arrays.values()]

    @cached_property
    def _as_typed(self) -> tuple[NDArray[np.int64], Any]:
        """The members (K,) whose motion takes f as it was typed, and the `Field` of that f."""
        if self._typed is None:
            return np.zeros(0, np.int64), None
        from .general import EQUATIONS, Field

        parts = {NAMES: self._typed.names, EQUATIONS: self._typed}
        count = math.prod(self.shape)
        values = [row if self.shape else row.item() for row in self._named_values]
        named = dict(zip(self.coordinates, values, strict=True))
        return np.arange(count), Field._of(named | parts)

    @cached_property
    def right_hand_sides(self) -> list[OfMembers]:
        return self._by_lists(lambda field: field.right_hand_sides, longest=_LONG)

    @cached_property
    def listed_right_hand_sides(self) -> list[OfMembers]:
        return self._by_lists(lambda field: field.listed_right_hand_sides, twice=True)

    def _by_lists(
        self,
        of_field: Callable[[Any], list[OfMembers]],
        acts: tuple[Act, ...] | None = None,
        twice: bool = False,
        longest: float = math.inf,
    ) -> list[OfMembers]:
        """Return the right-hand sides of members; dense ones of more terms are no lists.

        ``of_field(field)`` returns those of the field of f as typed. `acts` are changes of the
        state, in the order of code, and `twice` asks for what variational equations need.
        """
        typed, field = self._as_typed
        found = [] if field is None else of_field(field)
        found = [each._replace(members=typed[each.members]) for each in found]
        others = np.setdiff1d(np.arange(math.prod(self.shape)), typed)
        if not len(others):
            return found
        (indices, _), rows, D = self._terms, self._rows[others], self.dimension
        named = [] if acts is None else self._named_values

        def made(indices: Any, values: FloatArray, members: Any) -> tuple[Any, FloatArray]:
            """Return the right-hand side of members with these terms, and its parameters (P, K)."""
            T = indices.shape[1]
            if longest < T and 4 * T > D**3:
                return _dense(D), dense_parameters(indices, values, D)
            units = (values == 1.0).all(axis=0), (values == -1.0).all(axis=0)
            texts = (each.tobytes() for each in (indices, *units))
            f = _of_form(*texts, D, len(named), acts, twice)
            own = [*(row[members] for row in named), *parameters_of(values, *units)]
            own += [np.zeros(len(members))] * (f.P - len(own))  # starts of clocks
            return f, np.array(own).reshape(-1, len(members))

        exists = rows != 0.0
        patterns, which = exists[:1], np.zeros(len(rows), np.int64)
        if not exists.all():  # what a step tests depends on the terms
            patterns, which = np.unique(exists, axis=0, return_inverse=True)
        for k, pattern in enumerate(patterns):
            places = np.flatnonzero(which.reshape(-1) == k)
            own, members = rows[np.ix_(places, pattern)], others[places]
            f, parameters = made(indices[:, pattern], own, members)
            found.append(OfMembers(members, f, np.ascontiguousarray(f.table_of(parameters).T)))
        return found

    def _traced_at(self, x: Symbols) -> Any:
        if self.shape:
            how = "of a single field, or write the formulas with its parameters"
            raise TypeError(f"f(x) of a family has no symbols: take that {how}")
        indices, values = self._terms
        rows: list[Any] = [0.0 * x[0] for _ in range(self.dimension)]
        for (i, *factors), value in zip(indices.T.tolist(), values.tolist(), strict=True):
            part = value
            for k in factors:
                part = part * x[k] if k < self.dimension else part
            rows[i] = rows[i] + part
        return Symbols.of(rows)

    @property
    def _exact(self) -> Terms:
        """The terms with the values of the laboratory: those of a single field are fractions."""
        terms = Terms(self.parts[INDICES], self.parts[VALUES])
        return terms if self.shape else terms.exact

    @cached_property
    def terms(self) -> tuple[Any, FloatArray]:
        """The terms that are not 0: i, j, k, an array (3, T), and v (..., T), rounded once.

        The derivative of x_i is the sum of v x_j x_k, j <= k; the index D stands for a factor 1.
        Terms are sorted by i, j and k.
        """
        indices, values = self._terms
        order = np.lexsort(indices[::-1])
        return frozen(indices[:, order]), frozen(values[..., order])

    def _table(self, name: str, axes: int) -> Any:
        """Return coefficients of terms with `axes` - 1 factors other than 1, as an array."""
        (i, j, k), values = self._exact
        ours = (j < self.dimension) * 1 + (k < self.dimension) == axes - 1
        i, j, k, values = i[ours], j[ours], k[ours], values[..., ours]
        places: Any = [i, j, k][:axes]
        if axes == 3:  # half of a product of two variables stands at j, k, and half at k, j
            places = np.hstack([[i, j, k], [i, k, j]])
            values = np.tile(np.where(j == k, values, values / 2), 2)
        shape = (*values.shape[:-1], *(self.dimension,) * axes)
        return table_of(name, shape, places, values)

    @cached_property
    def quadratic(self) -> NDArray[Any]:
        """q (..., D, D, D), symmetric in j and k; MemoryError where that is too large."""
        return self._table("quadratic", 3)

    @cached_property
    def linear(self) -> NDArray[Any]:
        """l (..., D, D)."""
        return self._table("linear", 2)

    @cached_property
    def constant(self) -> NDArray[Any]:
        """c (..., D)."""
        return self._table("constant", 1)


_dense = lru_cache(16)(DenseRightHandSide)


@lru_cache(256)
def _of_form(
    indices: bytes, one: bytes, minus_one: bytes, D: int, P: int, acts: Any, twice: bool
) -> Any:
    """Return the right-hand side that fields of the same form share.

    With `acts`, changes of the state, which may read P parameters with names.
    """
    places = np.frombuffer(indices, np.int64).reshape(3, -1)
    is_one, is_minus_one = (np.frombuffer(each, bool) for each in (one, minus_one))
    values, results, count = expressions_of(places, D, is_one, is_minus_one, P)
    if acts is None:
        return RightHandSide(values, results, count)
    return with_fixed_choices(values, results, count, (), twice, acts)


def parts_of(terms: Terms | None, names: Sequence[str]) -> dict[str, Any]:
    """Return the parts of a field with these terms, if it has its own, and these names."""
    parts = {} if terms is None else {INDICES: terms.indices, VALUES: terms.values}
    return {**parts, NAMES: names}
