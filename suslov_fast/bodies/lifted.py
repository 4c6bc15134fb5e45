"""Fields whose right-hand side is smooth and not quadratic: `LiftedField`."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from .. import checks
from ..checks import FloatArray
from ..core.lift import polynomial_at, slopes_at, words_at
from ..keywords import public, unchanging
from .base import frozen, summary
from .coefficients import structure_matrix
from .definitions import Definitions
from .equations import value_of
from .expressions import as_polynomial, state_of
from .field import QuadraticField
from .field_of_terms import FieldOfFunction, parts_of
from .names import variables
from .parameters import Parameter
from .polynomials import Polynomial, named, to_lists
from .smooth import traced
from .structure import SmoothHamiltonian, Structure, structure_of
from .terms import collected

NUMBERS, VALUES = "coefficients of definitions", "values of the lifted field"
STRUCTURE, NAMES = "structure", "names of variables"


@unchanging
@dataclass(frozen=True, eq=False, repr=False, init=False)
class LiftedField(FieldOfFunction):
    """A field with a smooth right-hand side, ``x' = f(x)``, that need not be quadratic.

    Variables are added until all derivatives are quadratic: u = 1 / (1 + x) has the derivative
    ``-u**2 x'``. A step computes them from the state, takes one step of the method for all
    variables, and keeps the state: it has the order of the method, but no exact inverse and no
    invariants.

    Attributes
    ----------
    dimension, names : int, tuple of str
        The number of given variables, D, and their names.
    lifted : QuadraticField
        The field in all M variables.
    added : dict of str to str
        Names and definitions of the added variables.
    H, K : SmoothHamiltonian and ndarray(shape=(D, D)), or None
        Of :meth:`from_hamiltonian`: the Hamiltonian, a function of a state, and the matrix K.
    parameters : dict
        Named parameters, which are coordinates of datasets and stores. ``==`` ignores them.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import LiftedField, iterate
    >>> pendulum = LiftedField.from_function(lambda x: (x[1], -np.sin(x[0])), "q p")
    >>> pendulum, pendulum.added
    (LiftedField(q' = p, p' = -sin(q)), {'u1': 'sin(q)', 'u2': 'cos(q)'})
    >>> iterate(pendulum, [2.5, 0.0], eps=0.5, steps=40, method="order8").x[-1].round(3)
    array([2.372, 0.408])
    """

    _axes: ClassVar[Any] = {NUMBERS: 1, VALUES: 1}
    _texts: ClassVar[tuple[str, ...]] = ("names", "definitions", "equations", "H")
    _called: ClassVar[str] = "a lifted field"
    _instead: ClassVar[str] = ", whose steps conserve nothing: use energy, or field.lifted"

    H: SmoothHamiltonian | None
    _structure: Structure

    def __init__(self, *_: Any, **__: Any) -> None:
        raise TypeError("LiftedField: use LiftedField.from_function(f, dimension)")

    def _take(self, parts: Mapping[str, Any]) -> None:
        names, shared = parts[NAMES], parts[STRUCTURE]
        kept = {n: frozen(a) for n, a in parts.items() if n not in (NAMES, STRUCTURE)}
        vars(self).update(
            _parts=kept,
            _structure=shared,
            _coordinates=tuple(name for name in kept if name not in self._axes),
            dimension=len(names),
            names=names,
            _labels=names,
            H=None if shared.H is None else SmoothHamiltonian(self),
        )

    def _with(self, parts: Mapping[str, Any]) -> LiftedField:
        return self._of({**parts, NAMES: self.names, STRUCTURE: self._structure})

    def __reduce__(self) -> tuple[Any, ...]:
        return self._of, ({**self._parts, NAMES: self.names, STRUCTURE: self._structure},)

    @property
    def _key(self) -> tuple[Any, ...]:
        return self._structure.key, *super()._key

    @property
    def _described(self) -> dict[str, Any]:
        arrays = {"numbers": self._numbers, "values": np.asarray(self._parts[VALUES], np.float64)}
        shared = self._structure
        texts = {"names": ", ".join(self.names), "H": shared.energy}
        texts["equations"] = "; ".join(shared.equations)
        texts["definitions"] = "; ".join(f"{n} = {t}" for n, t in shared.texts)
        return arrays | self._arrays | texts

    @property
    def _numbers(self) -> FloatArray:
        return np.asarray(self._parts[NUMBERS], np.float64)

    _may_escape = True

    def _without_value(self, x: Any, which: Any) -> str:
        """Return which definition has no value at the first of some states (...), or nothing."""
        index, D = checks.first_index(which), self.dimension
        added = np.broadcast_to(self._lift(x)[..., D:], (*which.shape, len(self.added)))
        why = self._structure.without_value(added[index], self._numbers)
        where = f"the start of trajectory {checks.spell(index)}"
        return why and f"{why[0]} has no finite value at {where}{why[1]}"

    @public
    def field(self) -> Any:
        """Refuse, because the equations are not quadratic in the given variables.

        Raises
        ------
        TypeError
            Always; the attribute `lifted` is a quadratic field in more variables.
        """
        how = "pass field.lifted, whose equations are; for fixed points use scipy.optimize.root"
        raise TypeError(f"body: the equations of a LiftedField are not quadratic: {how}")

    @property
    def _terms(self) -> Any:
        return self.lifted._terms

    @property
    def added(self) -> dict[str, str]:
        """Names and definitions of the added variables."""
        return dict(self._structure.added)

    @cached_property
    def lifted(self) -> QuadraticField:
        """The quadratic field in all variables, whose first D are those of the state."""
        names = (*self.names, *self.added)
        indices = np.array(self._structure.indices, np.int64).reshape(-1, 3).T
        terms = collected(indices, np.asarray(self._parts[VALUES]), len(names), 2)
        return QuadraticField._of(parts_of(terms, names))

    @property
    def K(self) -> Any:
        """The matrix of a Hamiltonian field; None for other fields."""
        if self._structure.K is None:
            return None
        matrix = np.zeros((self.dimension, self.dimension))
        for i, j, value in self._structure.K:
            matrix[i, j] = value
        return matrix

    @public
    def lift(self, x: Any) -> FloatArray:
        """Return all variables, the given and the added ones, at states.

        Parameters
        ----------
        x : array_like(float, shape=(..., D))
            States.

        Returns
        -------
        ndarray(float, shape=(..., M))
            x, and the added variables; NaN or infinite where a definition has no value.

        Raises
        ------
        TypeError, ValueError
            If x has another shape, or numbers that are infinite or not real.

        Examples
        --------
        >>> from suslov_fast import LiftedField
        >>> field = LiftedField.from_function(lambda x: (1 / (1 + x[0]),), "x")
        >>> field.added, field.lift([[1.0], [3.0]])
        ({'u1': '1/(x + 1)', 'u2': 'u1**2'}, array([[1.    , 0.5   , 0.25  ],
               [3.    , 0.25  , 0.0625]]))
        """
        return self._lift(checks.states("x", x, self.names))

    def _lift(self, x: FloatArray) -> FloatArray:
        lift, numbers = self._structure.lift, self._numbers
        state = [x[..., i] for i in range(lift.given)]
        columns: Any = np.broadcast_arrays(*state, *words_at(lift, numbers, x))
        return np.asarray(np.stack(columns, axis=-1))

    def _slopes(self, x: FloatArray) -> FloatArray:
        """Return the derivatives (..., M, D) of all variables by the state."""
        slopes: FloatArray = slopes_at(self._structure.lift, self._numbers, x)
        return slopes

    def _steepest(self, x: FloatArray, place: Any, batch: tuple[int, ...]) -> tuple[str, float]:
        """Return the definition with the largest modulus at a state of one trajectory."""
        numbers = np.broadcast_to(self._numbers, (*batch, self._numbers.shape[-1]))
        sizes = [float(abs(a)) for a in words_at(self._structure.lift, numbers[place], x)]
        k = int(np.argmax(sizes))
        return self._structure.added[k][1], sizes[k]

    def _energy(self, x: FloatArray) -> Any:
        shared = self._structure
        energy = polynomial_at(shared.lift, shared.H, self._numbers, x) if shared.H else 0.0
        with np.errstate(all="ignore"):
            return energy + 0.0 * x.sum(axis=-1)

    def _value_at(self, x: Any) -> FloatArray:
        """Return f(x), floats (..., D), NaN where it has no value."""
        added = self.lift(x)
        exists = np.isfinite(added).all(axis=-1, keepdims=True)
        z: FloatArray = np.asarray(self.lifted(np.where(exists, added, np.nan)), np.float64)
        return np.where(exists, z[..., : self.dimension], np.nan)

    @classmethod
    @public
    def from_function(
        cls, f: Callable[..., Any], /, dimension: int | str | Sequence[str], **parameters: Any
    ) -> LiftedField:
        """Return the field ``x' = f(x, **parameters)``, or a family of fields.

        Parameters
        ----------
        f : callable
            Maps a tuple x of D variables to D smooth expressions: + - * /, powers, and NumPy's
            exp, log, sqrt, sin, cos, tan, sinh, cosh, tanh, arctan, square, power, reciprocal,
            hypot, cbrt, exp2, expm1, log2, log10 and log1p. The result of SymPy's `lambdify` is
            such a function.
        dimension : int, str or sequence of str
            The number of variables, D, or their names, such as ``"u v w"``.
        **parameters : float or array_like(float, shape=(...))
            Named parameters of f; arrays broadcast, and make a batch of fields.

        Returns
        -------
        LiftedField
            A single field, or a batch of the shape of the parameters.

        Raises
        ------
        TypeError, ValueError
            As :meth:`QuadraticField.from_function`; also if f calls a function that is not smooth
            or has no rule, or more than 200 variables would be added for products, or the
            derivatives of added variables would have more than 200,000 terms.

        Examples
        --------
        >>> from suslov_fast import LiftedField
        >>> def predator_prey(x, K):
        ...     N, P = x
        ...     return N * (1 - N / K) - N * P / (1 + N), N * P / (1 + N) - P / 3
        >>> field = LiftedField.from_function(predator_prey, "N P", K=4.0)
        >>> field.added
        {'u1': '1/(N + 1)', 'u2': 'P*u1**2', 'u3': 'P*u1'}
        >>> family = LiftedField.from_function(predator_prey, "N P", K=[2.0, 3.0, 4.0])
        >>> family.shape, len(family.sel(K=slice(3, None)))
        ((3,), 2)
        """
        names = variables("dimension", dimension)
        values = named(parameters, names)
        definitions, columns = cls._start(names, values)
        rows = traced("f", f, definitions, columns, f"{cls.__name__}.from_function")
        field = cls._made(definitions, values, rows, None, None)
        return field._made_by(cls.from_function, f, names)

    @classmethod
    @public
    def from_hamiltonian(
        cls,
        H: Callable[..., Any],
        /,
        dimension: int | str | Sequence[str],
        K: Any = None,
        **parameters: Any,
    ) -> LiftedField:
        """Return the Hamiltonian field ``x' = K grad H(x, **parameters)``.

        Steps do not conserve H, nor a modified energy: :func:`energy` varies with their error.

        Parameters
        ----------
        H : callable
            Maps a tuple x of D variables to a smooth expression, see :meth:`from_function`.
        dimension : int, str or sequence of str
            As in :meth:`from_function`.
        K : array_like(shape=(D, D)), optional
            As in :meth:`QuadraticField.from_hamiltonian`: x = (q1, ..., qm, p1, ..., pm) without K.
        **parameters : float or array_like(float, shape=(...))
            As in :meth:`from_function`.

        Returns
        -------
        LiftedField
            It has the attributes `H` and `K`.

        Raises
        ------
        TypeError, ValueError
            As :meth:`from_function`; also if K is not antisymmetric, or D odd without K.

        Examples
        --------
        >>> import numpy as np
        >>> from suslov_fast import LiftedField, energy
        >>> pendulum = LiftedField.from_hamiltonian(lambda x: x[1] ** 2 / 2 - np.cos(x[0]), "q p")
        >>> pendulum
        LiftedField(q' = p, p' = -sin(q), H = 1/2*p**2 - cos(q))
        >>> float(energy(pendulum, [0.0, 1.0]))
        -0.5
        """
        names = variables("dimension", dimension)
        values = named(parameters, names)
        matrix = structure_matrix(K, len(names), names)
        definitions, columns = cls._start(names, values)
        [energy] = traced("H", H, definitions, columns, f"{cls.__name__}.from_hamiltonian")
        field = cls._made(definitions, values, None, energy, matrix)
        return field._made_by(cls.from_hamiltonian, H, names, K)

    @staticmethod
    def _start(
        names: Sequence[str], values: Mapping[str, Any], all_columns: Sequence[str] = ()
    ) -> tuple[Definitions, dict[str, Any]]:
        """Return definitions, and the parameters as f is called with them."""
        definitions = Definitions(names)
        columns = {
            name: Parameter(np.asarray(a, np.float64), definitions, name)
            if np.ndim(a) or name in all_columns
            else a
            for name, a in values.items()
        }
        return definitions, columns

    @classmethod
    def _made(
        cls,
        definitions: Definitions,
        values: Mapping[str, Any],
        rows: Sequence[Polynomial] | None,
        energy: Polynomial | None,
        matrix: Any,
    ) -> LiftedField:
        """Return the field of traced equations, or of an energy and its matrix."""
        shared, numbers, coefficients = structure_of(definitions, values, rows, energy, matrix)
        parts = {NUMBERS: numbers, VALUES: coefficients, NAMES: definitions.names}
        return cls._of({**parts, **values, STRUCTURE: shared})

    def __repr__(self) -> str:
        if self.shape:
            values = [summary(name, each) for name, each in self.parameters.items()]
            parts = [f"variables {' '.join(self.names)}", *values]
            return f"<LiftedField of shape {self.shape}: {', '.join(parts)}>"
        shown = zip(self.names, self._structure.shown, strict=True)
        equations = [f"{name}' = {text}" for name, text in shown]
        equations += [] if self.H is None else [f"H = {self.H}"]
        short = textwrap.shorten(", ".join(equations), 300, placeholder=" ...")
        return f"LiftedField({short})"

    @public
    def to_dict(self) -> dict[str, Any]:
        shared = self._structure
        found: dict[str, Any] = {"body": type(self).__name__, "names": [*self.names]}
        found |= {"definitions": dict(shared.texts)} if shared.texts else {}
        if shared.K is None:
            found["equations"] = [*shared.equations]
        else:
            i, j, values = map(list, zip(*shared.K, strict=True)) if shared.K else ([], [], [])
            K = {"indices": [i, j], "values": to_lists(np.array(values, object))}
            found |= {"H": shared.energy, "K": K}
        return found | ({"parameters": to_lists(self.parameters)} if self.parameters else {})

    @classmethod
    def _read(
        cls,
        names: Any,
        equations: Any = None,
        definitions: Any = None,
        H: Any = None,
        K: Any = None,
        parameters: Any = None,
    ) -> LiftedField:
        names = variables("names", names)
        checks.instance("parameters", parameters or {}, Mapping)
        checks.instance("definitions", definitions or {}, Mapping)
        values = named(parameters or {}, names)
        texts: Mapping[str, Any] = definitions or {}
        rows = [H] if H is not None else equations
        is_list = isinstance(rows, (list, tuple)) and (H is not None or len(rows) == len(names))
        if not is_list or (H is None) == (equations is None):
            expected = f"a list of {len(names)} texts, or left out beside H"
            raise checks.wrong("equations", expected, checks.short(equations))
        # Members of families keep their parameters by name.
        found, columns = cls._start(names, values, [*values])
        known = dict(zip(names, state_of(found), strict=True)) | columns
        for k, (name, text) in enumerate(texts.items()):
            known[name] = value_of(text, known)
            if len(found.list) <= k:
                raise ValueError(f"definitions: {checks.short(text)} adds no variable")
        polynomials = [as_polynomial(value_of(row, known)) for row in rows]
        if H is None:
            return cls._made(found, values, polynomials, None, None)
        return cls._made(found, values, None, polynomials[0], structure_matrix(K, len(names)))
