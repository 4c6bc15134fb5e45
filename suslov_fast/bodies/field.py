"""Quadratic vector fields, whose Kahan maps the package iterates and analyses.

A field is one table of coefficients. With x = (x1, ..., xD, 1) it is

    dx_i/dt = sum_jk table[i, j, k] x_j x_k,    symmetric in j and k,

and a Hamiltonian of degree 3 is a symmetric tensor, H(x) = sum_ijk H[i, j, k] x_i x_j x_k, whose
gradient is 3 H[:D]. Tables of a single field hold fractions, those of a batch floats.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from numbers import Rational
from typing import Any, ClassVar

import numpy as np

from .. import checks
from ..checks import FloatArray, wrong
from .base import Body, frozen
from .polynomials import as_given, coefficients, from_lists, named, numbers, polynomial_of, traced


class Hamiltonian:
    """A polynomial of degree 3, or a batch: ``H(x) = sum_ijk H_ijk x_i x_j x_k``, x_(D+1) = 1.

    Called with a state it returns a fraction if all numbers are exact, else floats (...).
    """

    def __init__(self, tensor: Any) -> None:
        self.tensor = tensor

    @cached_property
    def terms(self) -> tuple[Any, FloatArray]:
        """The nonzero terms v x_i x_j x_k: i <= j <= k (3, T), where D is the 1, and v (..., T)."""
        return sparse(self.tensor, 3)

    def __call__(self, x: Any) -> Any:
        return at_points(self.tensor, x, 3)

    def __repr__(self) -> str:
        if self.tensor.ndim > 3:
            return f"<polynomials of shape {self.tensor.shape[:-3]}>"
        return repr(polynomial_of(self.tensor))


@dataclass(frozen=True, eq=False, repr=False, init=False)
class QuadraticField(Body):
    """A quadratic vector field, ``dx_i/dt = sum_jk q_ijk x_j x_k + sum_j l_ij x_j + c_i``.

    :func:`iterate` and the functions of a state take it like a body; the state is x. Its map is the
    discretization of Kahan. `suslov_fast.integrability` analyses that map exactly.

    Parameters
    ----------
    quadratic : array_like(shape=(..., D, D, D))
        q, made symmetric in j and k. All coefficients are 0 or between 1e-60 and 1e60 in modulus.
        Those of a single field may be integers, fractions or floats, and remain exact: 0.1 is the
        binary number, not 1/10, which is ``Fraction(1, 10)``. Those of a batch are floats.
    linear, constant : array_like(shape=(..., D, D)), array_like(shape=(..., D)), optional
        l and c, by default 0.

    Attributes
    ----------
    H, K
        The Hamiltonian of :meth:`from_hamiltonian`, which can be called with a state, and its
        matrix (D, D), or None.
    parameters : dict
        The named parameters of :meth:`from_function` and :meth:`from_hamiltonian`, which are
        coordinates of datasets and stores. ``==`` and hash do not look at them.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, Suslov3D
    >>> QuadraticField([[[0, 1], [0, 0]], [[-1, 0], [0, 0]]], constant=[0, 0.5])
    QuadraticField(x1' = x1*x2, x2' = -x1^2 + 1/2)
    >>> QuadraticField.of(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25))
    QuadraticField(x1' = 1/8*x1*x2 + 1/16*x2^2, x2' = -1/2*x1^2 - 1/4*x1*x2)
    """

    _axes: ClassVar[dict[str, int]] = {"quadratic": 3, "linear": 2, "constant": 1, "H": 3, "K": 2}

    quadratic: Any
    linear: Any
    constant: Any
    H: Hamiltonian | None = None
    K: Any = None

    def __init__(self, quadratic: Any, linear: Any = None, constant: Any = None) -> None:
        parts = {"quadratic": as_given("quadratic", quadratic)}
        D = (0, *parts["quadratic"].shape)[-1]
        for name, each in (("linear", linear), ("constant", constant)):
            zeros = np.zeros((D,) * self._axes[name])
            parts[name] = zeros if each is None else as_given(name, each)
        for name, array in parts.items():
            axes = self._axes[name]
            if D == 0 or array.shape[-axes:] != (D,) * axes:
                raise wrong(name, f"shape (..., {', '.join('D' * axes)})", array.shape)
        batch = self._batch(parts)
        for name, array in parts.items():
            found = coefficients(name, array, bool(batch))
            parts[name] = np.broadcast_to(found, (*batch, *(D,) * self._axes[name]))
        parts["quadratic"] = (parts["quadratic"] + parts["quadratic"].swapaxes(-2, -1)) / 2
        self._take(parts)

    def _take(self, parts: Mapping[str, Any]) -> None:
        is_batch, kept = bool(self._batch(parts)), {}
        for name, each in parts.items():
            kept[name] = frozen(numbers(name, each, is_batch) if name in self._axes else each)
        own = {name: each for name, each in kept.items() if name in self._axes}
        if "H" in own:
            own["H"] = Hamiltonian(own["H"])
        D, others = own["constant"].shape[-1], tuple(name for name in kept if name not in own)
        vars(self).update(own, _parts=kept, dimension=D, _labels=labels(D), _coordinates=others)

    @classmethod
    def _of_table(cls, table: Any, /, **parts: Any) -> QuadraticField:
        """Return the field of a table, besides which H, K and named parameters may be given."""
        q, l, c = table[..., :-1, :-1], 2 * table[..., :-1, -1], table[..., -1, -1]
        return cls._of({"quadratic": q, "linear": l, "constant": c, **parts})

    @classmethod
    def from_function(
        cls, f: Callable[..., Any], /, dimension: int, **parameters: Any
    ) -> QuadraticField:
        """Return the field with components ``f(x, **parameters)``.

        Parameters
        ----------
        f : callable
            It maps a tuple x of D variables to D polynomials of degree 2 or less. It is called with
            symbolic variables, so its coefficients remain exact; floats are binary numbers.
        dimension : int
            The number of variables, D.
        **parameters : float or array_like(float, shape=(...))
            Named parameters, with names that nothing else has. Numbers remain exact; arrays
            broadcast, and make a batch of fields.

        Returns
        -------
        QuadraticField

        Examples
        --------
        >>> from suslov_fast import QuadraticField
        >>> fields = QuadraticField.from_function(lambda x, a: (a - x[0] ** 2,), 1, a=[1, 2, 3])
        >>> fields.parameters, fields.sel(a=2)
        ({'a': array([1., 2., 3.])}, QuadraticField(x1' = -x1^2 + 2))
        """
        D = checks.integer("dimension", dimension, 1)
        values = named(parameters)
        return cls._of_table(traced("f", f, D, 2, values), **values)

    @classmethod
    def from_hamiltonian(
        cls, H: Callable[..., Any], /, dimension: int, K: Any = None, **parameters: Any
    ) -> QuadraticField:
        """Return the field ``x' = K grad H(x, **parameters)``, which carries H and K.

        Parameters
        ----------
        H : callable
            It maps a tuple x of D variables to a polynomial of degree 3 or less.
        K : array_like(shape=(D, D)), optional
            A constant antisymmetric matrix, of any rank. By default, for even D, it is the
            canonical one of coordinates and momenta x = (q1, ..., qm, p1, ..., pm).
        dimension, **parameters
            As in :meth:`from_function`.

        Returns
        -------
        QuadraticField

        Examples
        --------
        >>> from suslov_fast import QuadraticField
        >>> QuadraticField.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, 2)
        QuadraticField(x1' = x2, x2' = -3*x1^2 + 1, H = x1^3 + 1/2*x2^2 - x1)
        """
        D = checks.integer("dimension", dimension, 1)
        values = named(parameters)
        return cls._of_hamiltonian(traced("H", H, D, 3, values), K, **values)

    @classmethod
    def _of_hamiltonian(cls, tensor: Any, K: Any, /, **values: Any) -> QuadraticField:
        """Return the field of a tensor and a matrix, which is checked."""
        D = tensor.shape[-1] - 1
        if K is None:
            if D % 2:
                raise wrong("dimension", "an even number without K", D)
            K = np.eye(D, k=D // 2, dtype=np.int64) - np.eye(D, k=-D // 2, dtype=np.int64)
        matrix = coefficients("K", K, False)
        if matrix.shape != (D, D) or (matrix != -matrix.T).any():
            received = checks.short(matrix.astype(float).tolist())
            raise wrong("K", f"an antisymmetric matrix ({D}, {D})", received)
        table = checks.within("H", rates(tensor, matrix), checks.OTHERS)
        return cls._of_table(table, H=tensor, K=matrix, **values)

    @classmethod
    def of(cls, body: Any) -> QuadraticField:
        """Return the equations of motion of a body of any class: its ``field()``.

        Parameters
        ----------
        body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
            A single one, whose parameters are taken exactly, or a batch.

        Returns
        -------
        QuadraticField
        """
        checks.instance("body", body, Body)
        field: QuadraticField = body.field()
        return field

    @property
    def _field(self) -> QuadraticField:
        return self

    @property
    def parameters(self) -> dict[str, Any]:
        """The named parameters."""
        return {name: self._parts[name] for name in self._coordinates}

    @cached_property
    def table(self) -> Any:
        """The coefficients in homogeneous coordinates (..., D, D + 1, D + 1)."""
        D = self.dimension
        table = np.full((*self.shape, D, D + 1, D + 1), Fraction(0), self.quadratic.dtype)
        table[..., :-1, :-1], table[..., -1, -1] = self.quadratic, self.constant
        table[..., :-1, -1] = table[..., -1, :-1] = self.linear / 2
        return frozen(table)

    @cached_property
    def terms(self) -> tuple[Any, FloatArray]:
        """The nonzero terms v x_j x_k of all f_i: i and j <= k (3, T), and v (..., T).

        The index D stands for the 1; the terms with k = D are last. Values are rounded once.
        """
        return sparse(self.table, 2)

    @property
    def components(self) -> tuple[Any, ...]:
        """The components as ``flint.fmpq_mpoly`` in x1, ..., xD; needs python-flint."""
        import flint

        every = range(self.dimension)
        context = flint.fmpq_mpoly_ctx.get(self._labels, ordering="deglex")

        def polynomial(row: Any) -> Any:
            terms = polynomial_of(row).terms.items()
            ratios = {indices: flint.fmpq(*c.as_integer_ratio()) for indices, c in terms}
            return context.from_dict({tuple(map(i.count, every)): c for i, c in ratios.items()})

        return tuple(map(polynomial, self.table))

    def __call__(self, x: Any) -> Any:
        """Return the field at a point: fractions if all numbers are exact, else floats (..., D)."""
        found = at_points(self.table, x, 2)
        return tuple(found) if found.dtype == object else found

    def __repr__(self) -> str:
        if self.shape:
            names = "".join(f", {n}={np.shape(a) or a}" for n, a in self.parameters.items())
            return f"<QuadraticField of shape {self.shape}: D={self.dimension}{names}>"
        equations = [f"x{i}' = {polynomial_of(row)}" for i, row in enumerate(self.table, 1)]
        equations += [] if self.H is None else [f"H = {self.H}"]
        short = textwrap.shorten(", ".join(equations), 300, placeholder=" ...")
        return f"QuadraticField({short})"

    def to_dict(self) -> dict[str, Any]:
        found = super().to_dict()
        values = {name: found.pop(name) for name in self._coordinates}
        return found | ({"parameters": values} if values else {})

    @classmethod
    def from_dict(cls, parameters: Mapping[str, Any]) -> QuadraticField:
        checks.instance("parameters", parameters, Mapping)
        given = dict(parameters)
        H, K, values = (given.pop(name, None) for name in ("H", "K", "parameters"))
        whole = super().from_dict(given)
        checks.instance("parameters", values or {}, Mapping)
        values = named({name: from_lists(name, each) for name, each in (values or {}).items()})
        if H is None:
            return cls._of({**whole._parts, **values})
        tensor = coefficients("H", from_lists("H", H), bool(whole.shape))
        if tensor.shape != (*whole.shape, *(whole.dimension + 1,) * 3):
            raise wrong("H, K", "those of the coefficients", f"shape {tensor.shape}")
        found = cls._of_hamiltonian(tensor, from_lists("K", K), **values)
        size = abs(found.table).max(initial=0)
        if not (abs(found.table - whole.table) <= 1e-9 * size).all():
            raise wrong("H, K", "those of the coefficients", "others")
        return cls._of({**found._parts, **whole._parts})  # in a batch H is rounded


def labels(D: int) -> tuple[str, ...]:
    return tuple(f"x{i}" for i in range(1, D + 1))


def rates(H: Any, K: Any) -> Any:
    """Return the table of K grad H; most entries of K are 0."""
    table, K = np.full_like(H[..., :-1, :, :], Fraction(0)), K.astype(H.dtype)
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


def at_points(tensor: Any, x: Any, degree: int) -> Any:
    """Return the values at x of polynomials, whose variables are the last `degree` axes.

    They are fractions if all numbers are exact, else floats.
    """
    D = tensor.shape[-1] - 1
    is_list = isinstance(x, (tuple, list)) or (isinstance(x, np.ndarray) and x.ndim == 1)
    are_exact = tensor.dtype == object and is_list and all(isinstance(a, Rational) for a in x)
    if are_exact and len(x) == D:
        point = np.array([*numbers("x", x, False), Fraction(1)])
    else:
        x = checks.states("x", x, labels(D))
        point = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)
        tensor = np.asarray(tensor, np.float64)
    with np.errstate(all="ignore"):
        for axes in ("ijk", "ij", "i")[:degree]:
            tensor = np.einsum(f"...{axes},...{axes[-1]}->...{axes[:-1]}", tensor, point)
    return tensor
