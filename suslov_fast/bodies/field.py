"""Quadratic vector fields, whose Kahan maps the package iterates and analyses.

A field is one table of coefficients. With x = (x1, ..., xD, 1) it is

    dx_i/dt = sum_jk table[i, j, k] x_j x_k,    symmetric in j and k,

and a Hamiltonian of degree 3 is a symmetric tensor, H(x) = sum_ijk H[i, j, k] x_i x_j x_k, whose
gradient is 3 H[:D]. The table of a single field holds fractions, that of a batch floats.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from numbers import Rational
from typing import Any, ClassVar

import numpy as np

from .. import checks
from ..checks import FloatArray, wrong
from .base import Body, frozen, summary
from .names import labels, variables
from .polynomials import as_given, coefficients, named, numbers, polynomial_of, to_lists
from .tracing import traced

# Names of the parts of a field other than its named parameters. They hold spaces, because a named
# parameter can have any name that Python accepts.
TABLE, TENSOR, MATRIX, NAMES = "table of f", "tensor of H", "matrix K", "names of variables"
# Attributes of stores. A parameter with one of these names gets another one there.
_OF_STORES = frozenset(
    "H K body coords dims eps format functions map method names omega0 save_every shared steps "
    "tiled title version attitude".split()
)


class Hamiltonian:
    """A polynomial of degree 3, or a batch: ``H(x) = sum_ijk H_ijk x_i x_j x_k``, x_(D+1) = 1.

    Its value at a state is a fraction if all numbers are exact, else floats (...).
    """

    def __init__(self, tensor: Any, names: Sequence[str] | None = None) -> None:
        self.tensor = tensor
        self._names = tuple(names or labels(tensor.shape[-1] - 1))

    @cached_property
    def terms(self) -> tuple[Any, FloatArray]:
        """The nonzero terms v x_i x_j x_k: i <= j <= k (3, T), where D is the 1, and v (..., T)."""
        return sparse(self.tensor, 3)

    def __call__(self, x: Any) -> Any:
        return at_points(self.tensor, x, 3, self._names)

    def __repr__(self) -> str:
        if self.tensor.ndim > 3:
            return f"<polynomials of shape {self.tensor.shape[:-3]}>"
        return polynomial_of(self.tensor).text(self._names)


@dataclass(frozen=True, eq=False, repr=False, init=False)
class QuadraticField(Body):
    """A quadratic vector field, ``dx_i/dt = sum_jk q_ijk x_j x_k + sum_j l_ij x_j + c_i``.

    Functions that take a body take a field; its state is x. Its map is Kahan's discretization,
    (x_next - x) / eps = f with (x_j x_next_k + x_next_j x_k) / 2 for each x_j x_k and
    (x_j + x_next_j) / 2 for each x_j. :meth:`from_function` makes a field from a function.

    Parameters
    ----------
    quadratic : array_like(shape=(..., D, D, D))
        q, of which only the part symmetric in j and k counts. Coefficients are 0 or between 1e-60
        and 1e60 in modulus, in any units. A single field keeps integers, fractions and floats
        exactly: 0.1 is the double nearest to 1/10, which is ``Fraction(1, 10)``. A batch of fields
        has floats.
    linear, constant : array_like(shape=(..., D, D)), array_like(shape=(..., D)), optional
        l and c, by default 0.
    names : str or sequence of str, optional
        Names of the D variables, by default x1, ..., xD: ``"u v w"``, ``"u, v, w"`` or a list.

    Attributes
    ----------
    names : tuple of str
        Names of the variables in equations, plots, datasets and reports. ``==`` ignores them.
    H, K : Hamiltonian and ndarray(shape=(D, D)), or None
        The Hamiltonian of :meth:`from_hamiltonian`, a function of a state, and its matrix.
    parameters : dict
        Named parameters, which are coordinates of datasets and stores. ``==`` ignores them.

    Raises
    ------
    TypeError, ValueError
        If shapes do not match, or a coefficient is not a number in its range.

    Examples
    --------
    >>> from suslov_fast import QuadraticField
    >>> QuadraticField([[[0, 1], [0, 0]], [[-1, 0], [0, 0]]], constant=[0, 0.5])
    QuadraticField(x1' = x1*x2, x2' = -x1^2 + 1/2)
    """

    _axes: ClassVar[Any] = {
        "quadratic": 3, "linear": 2, "constant": 1, TABLE: 3, TENSOR: 3, MATRIX: 2,
    }  # fmt: skip
    _texts: ClassVar[Any] = ("names",)

    quadratic: Any
    linear: Any
    constant: Any
    table: Any  # in homogeneous coordinates (..., D, D + 1, D + 1)
    H: Hamiltonian | None
    K: Any
    names: tuple[str, ...]
    _coefficients: dict[str, Any]

    def __init__(
        self, quadratic: Any, linear: Any = None, constant: Any = None, names: Any = None
    ) -> None:
        if callable(quadratic):
            received = "a function: use QuadraticField.from_function(f, dimension)"
            raise wrong("quadratic", "an array (..., D, D, D)", received, TypeError)
        arrays = {"quadratic": as_given("quadratic", quadratic)}
        D = (0, *arrays["quadratic"].shape)[-1]
        for name, each, axes in (("linear", linear, 2), ("constant", constant, 1)):
            arrays[name] = np.zeros((D,) * axes) if each is None else as_given(name, each)
        shapes = {}
        for name, array in arrays.items():
            axes = self._axes[name]
            if D == 0 or array.shape[-axes:] != (D,) * axes:
                raise wrong(name, f"have the shape (..., {', '.join('D' * axes)})", array.shape)
            shapes[name] = array.shape[:-axes]
        batch = checks.common_shape(shapes)
        q, l, c = (coefficients(name, array, bool(batch)) for name, array in arrays.items())
        table = np.zeros((*batch, D, D + 1, D + 1), q.dtype)
        table[..., :-1, :-1], table[..., :-1, -1], table[..., -1, -1] = q, l, c
        names = variables("names", names, D)
        self._take({TABLE: (table + table.swapaxes(-2, -1)) / 2, NAMES: names})

    def _take(self, parts: Mapping[str, Any]) -> None:
        """Store a table, or H and K with or without theirs, the names, and named parameters."""
        table: Any = parts.get(TABLE)
        # The table of a Hamiltonian field follows from H and K, unless a family has a rounded one.
        if TENSOR in parts and np.ndim(table) <= 3:
            table = rates(parts[TENSOR], parts[MATRIX])
        table = frozen(numbers("table", table, table.ndim > 3))
        D = table.shape[-3]
        names = parts.get(NAMES) or labels(D)
        others = {name: frozen(a) for name, a in parts.items() if name not in (TABLE, NAMES)}
        parameters = tuple(name for name in others if name not in self._axes)
        q, l, c = table[..., :-1, :-1], frozen(2 * table[..., :-1, -1]), table[..., -1, -1]
        qlc = {"quadratic": q, "linear": l, "constant": c}
        H = Hamiltonian(others[TENSOR], names) if TENSOR in others else None
        vars(self).update(qlc, table=table, H=H, K=others.get(MATRIX), _coefficients=qlc)
        vars(self).update(_parts={TABLE: table, **others}, _coordinates=parameters)
        vars(self).update(dimension=D, names=names, _labels=names)

    def _with(self, parts: Mapping[str, Any]) -> QuadraticField:
        return self._of({**parts, NAMES: self.names})

    def __reduce__(self) -> tuple[Any, ...]:
        return self._of, ({**self._parts, NAMES: self.names},)

    @property
    def _arrays(self) -> dict[str, FloatArray]:
        arrays = self._coefficients | self.parameters
        return {name: np.asarray(a, np.float64) for name, a in arrays.items()}

    @property
    def _described(self) -> dict[str, Any]:
        arrays = self._coefficients
        if self.H is not None:
            arrays = arrays | {"H": self.H.tensor, "K": self.K}
        names = (f"parameter {n}" if n in _OF_STORES else n for n in self._coordinates)
        arrays = arrays | dict(zip(names, self.parameters.values(), strict=True))
        texts = {} if self.names == labels(self.dimension) else {"names": ", ".join(self.names)}
        return {name: np.asarray(a, np.float64) for name, a in arrays.items()} | texts

    @classmethod
    def from_function(
        cls, f: Callable[..., Any], /, dimension: int | str | Sequence[str], **parameters: Any
    ) -> QuadraticField:
        """Return the field ``x' = f(x, **parameters)``, or a family of fields.

        Parameters
        ----------
        f : callable
            Maps a tuple x of D variables to D polynomials of degree 2 or less. It is called with
            symbols, so that coefficients are exact: 0.1 is the double nearest to 1/10.
        dimension : int, str or sequence of str
            The number of variables, D, or their names, such as ``"u v w"``.
        **parameters : float or array_like(float, shape=(...))
            Named parameters of f. Numbers remain exact; arrays broadcast, and make a batch of
            fields. Names of variables, eps, t and those of datasets are refused.

        Raises
        ------
        TypeError, ValueError
            If f does not take the state as one tuple, lacks a parameter, or a component is not such
            a polynomial. The message says how to change f.

        Examples
        --------
        >>> from suslov_fast import QuadraticField
        >>> def lotka_volterra(x, a):
        ...     return x[0] - x[0] * x[1], a * (x[0] * x[1] - x[1])
        >>> QuadraticField.from_function(lotka_volterra, "u v", a=0.5)
        QuadraticField(u' = -u*v + u, v' = 1/2*u*v - 1/2*v)
        >>> family = QuadraticField.from_function(lotka_volterra, "u v", a=[0.5, 1, 2])
        >>> family.shape, family.sel(a=2)
        ((3,), QuadraticField(u' = -u*v + u, v' = 2*u*v - 2*v))
        """
        names = variables("dimension", dimension)
        values = named(parameters, names)
        table, _ = traced("f", f, names, values)
        return cls._of({TABLE: table, NAMES: names, **values})

    @classmethod
    def from_hamiltonian(
        cls,
        H: Callable[..., Any],
        /,
        dimension: int | str | Sequence[str],
        K: Any = None,
        **parameters: Any,
    ) -> QuadraticField:
        """Return the Hamiltonian field ``x' = K grad H(x, **parameters)``.

        Its map conserves :func:`modified_energy` exactly, and so is free of energy drift.

        Parameters
        ----------
        H : callable
            Maps a tuple x of D variables to a polynomial of degree 3 or less.
        K : array_like(shape=(D, D)), optional
            A constant antisymmetric matrix, of any rank. By default D is even, and K is the
            canonical matrix of coordinates and momenta, x = (q1, ..., qm, p1, ..., pm).
        dimension, **parameters
            As in :meth:`from_function`.

        Raises
        ------
        TypeError, ValueError
            As :meth:`from_function`; also if K is not antisymmetric, or D odd without K.

        Examples
        --------
        >>> from suslov_fast import QuadraticField
        >>> QuadraticField.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, 2)
        QuadraticField(x1' = x2, x2' = -3*x1^2 + 1, H = x1^3 + 1/2*x2^2 - x1)
        """
        names = variables("dimension", dimension)
        values = named(parameters, names)
        matrix = structure(K, len(names))
        tensor, table = traced("H", H, names, values, matrix)
        tables = {} if table is None else {TABLE: table}
        return cls._of_hamiltonian(tensor, matrix, {NAMES: names, **tables, **values})

    @classmethod
    def _of_hamiltonian(cls, tensor: Any, K: Any, others: Mapping[str, Any]) -> QuadraticField:
        """Return the field of an exact tensor H and a matrix K, if its table is in range."""
        field = cls._of({TENSOR: tensor, MATRIX: K, **others})
        checks.within("H", field.table, checks.OTHERS)
        return field

    @classmethod
    def of(cls, body: Any) -> QuadraticField:
        """Return the equations of motion of a body, or of a batch, as a field.

        Coefficients of a single body are exact functions of its parameters, which are doubles.

        Examples
        --------
        >>> from suslov_fast import QuadraticField, Suslov3D
        >>> QuadraticField.of(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25))
        QuadraticField(x1' = 1/8*x1*x2 + 1/16*x2^2, x2' = -1/2*x1^2 - 1/4*x1*x2)
        """
        checks.instance("body", body, Body)
        field: QuadraticField = body.field()
        return field

    @property
    def _field(self) -> QuadraticField:
        return self

    @property
    def parameters(self) -> dict[str, Any]:
        """The named parameters of the function: numbers as they were given, and arrays."""
        return {name: self._parts[name] for name in self._coordinates}

    @property
    def _may_escape(self) -> bool:  # type: ignore[override]
        return bool((self.terms[0][2] < self.dimension).any())

    @cached_property
    def terms(self) -> tuple[Any, FloatArray]:
        """The nonzero terms v x_j x_k of all f_i: i and j <= k (3, T), and v (..., T).

        The index D stands for the 1; the terms with k = D are last. Values are rounded once.
        """
        return sparse(self.table, 2)

    @property
    def components(self) -> tuple[Any, ...]:
        """The components as ``flint.fmpq_mpoly`` in the variables; needs python-flint.

        If a name is not ASCII, which flint refuses, the variables are x1, ..., xD.
        """
        flint = checks.extra("flint", "algebra")
        names = self.names if all(map(str.isascii, self.names)) else labels(self.dimension)
        context = flint.fmpq_mpoly_ctx.get(names, ordering="deglex")
        x = np.fromiter([*context.gens(), context.constant(1)], object)
        ratios = np.vectorize(lambda c: flint.fmpq(*c.as_integer_ratio()), "O")(self.table)
        return tuple(ratios @ x @ x)

    def __call__(self, x: Any) -> Any:
        """Return f(x): a tuple of fractions if all numbers are exact, else floats (..., D)."""
        found = at_points(self.table, x, 2, self.names)
        return tuple(found) if found.dtype == object else found

    def __repr__(self) -> str:
        if self.shape:
            names = f"D={self.dimension}"
            if self.names != labels(self.dimension):
                names = f"variables {' '.join(self.names)}"
            values = [summary(name, each) for name, each in self.parameters.items()]
            return f"<QuadraticField of shape {self.shape}: {', '.join([names, *values])}>"
        texts = (polynomial_of(row).text(self.names) for row in self.table)
        equations = [f"{name}' = {text}" for name, text in zip(self.names, texts, strict=True)]
        equations += [] if self.H is None else [f"H = {self.H}"]
        short = textwrap.shorten(", ".join(equations), 300, placeholder=" ...")
        return f"QuadraticField({short})"

    def to_dict(self) -> dict[str, Any]:
        arrays = self._coefficients if self.H is None else {"H": self.H.tensor, "K": self.K}
        values = {"parameters": self.parameters} if self.parameters else {}
        texts = {} if self.names == labels(self.dimension) else {"names": [*self.names]}
        return {"body": type(self).__name__, **to_lists(arrays | values), **texts}

    @classmethod
    def _read(
        cls,
        quadratic: Any = None,
        linear: Any = None,
        constant: Any = None,
        H: Any = None,
        K: Any = None,
        parameters: Any = None,
        names: Any = None,
    ) -> QuadraticField:
        checks.instance("parameters", parameters or {}, Mapping)
        if H is None and K is None:
            field = cls(quadratic, linear, constant, names)
            values = named(parameters or {}, field.names)
            return field._with({**field._parts, **values})
        if quadratic is not None or linear is not None or constant is not None:
            raise ValueError("the parameters hold both coefficients and H: keep one of them")
        tensor = np.atleast_3d(coefficients("H", H, False))
        twins = tensor.swapaxes(-1, -2), tensor.swapaxes(-1, -3)
        if tensor.shape[-1] < 2 or not all(np.array_equal(tensor, each) for each in twins):
            raise wrong("H", "symmetric in all its axes", checks.short(H))
        names = variables("names", names, tensor.shape[-1] - 1)
        values = named(parameters or {}, names)
        return cls._of_hamiltonian(tensor, structure(K, len(names)), {NAMES: names, **values})


def structure(K: Any, D: int) -> Any:
    """Return the antisymmetric matrix of a Hamiltonian field, exact; by default canonical."""
    if K is None:
        if D % 2:
            raise wrong("dimension", "even where K is left out, the matrix of x' = K grad H", D)
        K = np.eye(D, k=D // 2, dtype=np.int64) - np.eye(D, k=-D // 2, dtype=np.int64)
    matrix = coefficients("K", K, False)
    if matrix.shape != (D, D) or (matrix != -matrix.T).any():
        received = checks.short(matrix.astype(float).tolist())
        raise wrong("K", f"an antisymmetric matrix of shape ({D}, {D})", received)
    return matrix


def rates(H: Any, K: Any) -> Any:
    """Return the table of K grad H, by the entries of K that are not 0."""
    table = np.full_like(H[..., :-1, :, :], Fraction(0))
    for i, j in np.argwhere(K != 0):
        table[..., i, :, :] += 3 * K[i, j] * H[..., j, :, :]
    return table


def sparse(tensor: Any, degree: int) -> tuple[Any, FloatArray]:
    """Return indices (3, T) and values (..., T) of the terms of a tensor symmetric in its axes."""
    places = np.argwhere(np.any(tensor != 0, axis=tuple(range(tensor.ndim - 3))))
    places[:, 3 - degree :].sort(axis=1)
    places, counts = np.unique(places, axis=0, return_counts=True)
    order = np.argsort(places[:, -1] == tensor.shape[-1] - 1, kind="stable")
    indices = np.ascontiguousarray(places[order].T)
    values = (tensor[(..., *indices)] * counts[order]).astype(np.float64)
    return indices, np.ascontiguousarray(values)


def at_points(tensor: Any, x: Any, degree: int, names: Sequence[str]) -> Any:
    """Return the values at x of polynomials: tensors whose last `degree` axes stand for (x, 1).

    Values are fractions if all numbers are exact, else floats.
    """
    D = tensor.shape[-1] - 1
    is_list = isinstance(x, (tuple, list)) or (isinstance(x, np.ndarray) and x.ndim == 1)
    if tensor.ndim == 3 and is_list and len(x) == D and all(isinstance(a, Rational) for a in x):
        x = numbers("x", x, False)
    else:
        x, tensor = checks.states("x", x, names), np.asarray(tensor, np.float64)
    point = np.concatenate([x, np.ones((*x.shape[:-1], 1), x.dtype)], axis=-1)
    with np.errstate(all="ignore"):
        for axes in ("ijk", "ij", "i")[:degree]:
            tensor = np.einsum(f"...{axes},...{axes[-1]}->...{axes[:-1]}", tensor, point)
    return tensor
