"""Quadratic vector fields."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from numbers import Rational
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray, instance, integer, real_array, vectors, wrong
from .base import Body
from .body_3d import Suslov3D
from .body_gyrostat import SuslovGyrostat
from .body_nd import SuslovND
from .polynomial import Polynomial, exact_array, plain

IntArray = NDArray[np.int64]
# Numbers of axes of the coefficients.
_AXES = {"quadratic": 3, "linear": 2, "constant": 1}
# Length of the text of a single field.
_LINE = 300


@dataclass(frozen=True, eq=False, repr=False, init=False)
class QuadraticField(Body):
    """A quadratic vector field, ``dx_i/dt = sum_jk q_ijk x_j x_k + sum_j l_ij x_j + c_i``.

    :func:`iterate` and the functions of a state take it like a body; the state is x. Its map is the
    discretization of Kahan. `suslov_fast.integrability` analyses that map exactly.

    Parameters
    ----------
    quadratic : array_like(shape=(..., D, D, D))
        q, made symmetric in j and k, which does not change the field. The coefficients of a single
        field may be integers, fractions or floats, and remain exact: 0.1 is the binary number, not
        1/10, which is ``Fraction(1, 10)``. Those of a batch are floats.
    linear : array_like(shape=(..., D, D)), optional
        l, by default 0.
    constant : array_like(shape=(..., D)), optional
        c, by default 0.

    Attributes
    ----------
    quadratic, linear, constant : ndarray
        The coefficients, read-only: of fractions for a single field, of floats for a batch.
    H, K
        The Hamiltonian, which can be called, and the matrix (D, D), if the field was made by
        :meth:`from_hamiltonian`, else None.

    Raises
    ------
    TypeError, ValueError
        If a coefficient is not a finite rational number, or a shape is not as above.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, Suslov3D, iterate
    >>> QuadraticField([[[0, 1], [0, 0]], [[-1, 0], [0, 0]]], constant=[0, 0.5])
    QuadraticField(x1' = x1*x2, x2' = -x1^2 + 1/2)
    >>> QuadraticField.of(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25))
    QuadraticField(x1' = 1/8*x1*x2 + 1/16*x2^2, x2' = -1/2*x1^2 - 1/4*x1*x2)
    >>> QuadraticField.from_function(lambda x: (x[1] * x[2], x[2] * x[0], x[0] * x[1]), 3)
    QuadraticField(x1' = x2*x3, x2' = x1*x3, x3' = x1*x2)
    """

    quadratic: Any
    linear: Any
    constant: Any

    _couplings: ClassVar[tuple[str, ...]] = tuple(_AXES)
    _meanings: ClassVar[dict[str, str]] = {name: f"{name} coefficients" for name in _AXES}
    # What messages say of fields in place of bodies.
    _kind: ClassVar[str] = (
        "QuadraticField; fields have step, iterate, vector_field, jacobian, matrix and "
        "lyapunov_exponents, and those from a Hamiltonian energy, modified_energy and "
        "invariant_density"
    )
    H: ClassVar[Polynomial | None] = None
    K: ClassVar[Any] = None

    def __init__(self, quadratic: Any, linear: Any = None, constant: Any = None) -> None:
        given = {"quadratic": quadratic, "linear": linear, "constant": constant}
        shapes = {
            name: (each if isinstance(each, np.ndarray) else np.array(each, dtype=object)).shape
            for name, each in given.items()
        }
        D = (0, *shapes["quadratic"])[-1]
        for name, axes in _AXES.items():
            if given[name] is None and name != "quadratic":
                shapes[name] = (D,) * axes
                given[name] = np.zeros(shapes[name], np.int64)
            if D == 0 or shapes[name][-axes:] != (D,) * axes:
                letter = "D" if name == "quadratic" else str(D)
                raise wrong(name, f"shape (..., {', '.join([letter] * axes)})", shapes[name])
        if any(len(shapes[name]) > axes for name, axes in _AXES.items()):
            half = 0.5 * real_array("quadratic", quadratic)
            self._set(**given | {"quadratic": half + half.swapaxes(-2, -1)})
            return
        for name in _AXES:
            array = exact_array(name, given[name])
            if name == "quadratic":
                for i, j, k in np.argwhere(array):
                    array[i, j, k] = array[i, k, j] = (array[i, j, k] + array[i, k, j]) / 2
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @classmethod
    def from_function(cls, f: Callable[[Any], Any], dimension: int) -> QuadraticField:
        """Return the field with components ``f(x)``.

        Parameters
        ----------
        f : callable
            It maps a tuple x of D variables to D polynomials of degree 2 or less. It is called with
            symbolic variables, so its coefficients remain exact: integers, fractions, or floats,
            which are taken as the binary numbers that they are.
        dimension : int
            The number of variables, D.

        Returns
        -------
        QuadraticField

        Raises
        ------
        TypeError, ValueError
            If f does not return D such polynomials.

        Examples
        --------
        >>> from suslov_fast import QuadraticField
        >>> QuadraticField.from_function(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2)
        QuadraticField(x1' = -x1*x2 + x1, x2' = x1*x2 - x2)
        """
        n = integer("dimension", dimension, 1)
        return cls._of_components(_values_of("f", f, n, n, 2))

    @classmethod
    def from_hamiltonian(
        cls, H: Callable[[Any], Any], dimension: int, K: Any = None
    ) -> QuadraticField:
        """Return the field ``x' = K grad H(x)``, which carries H and K.

        Parameters
        ----------
        H : callable
            It maps a tuple x of D variables to a polynomial of degree 3 or less, as the function
            of :meth:`from_function` does.
        dimension : int
            The number of variables, D.
        K : array_like(shape=(D, D)), optional
            A constant antisymmetric matrix, of any rank. By default, for even D, it is the
            canonical one of coordinates and momenta x = (q1, ..., qm, p1, ..., pm).

        Returns
        -------
        QuadraticField

        Raises
        ------
        TypeError, ValueError
            If H does not return such a polynomial, K is not antisymmetric, or D is odd and there
            is no K.

        Examples
        --------
        >>> from suslov_fast import QuadraticField
        >>> QuadraticField.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, 2)
        QuadraticField(x1' = x2, x2' = -3*x1^2 + 1, H = x1^3 + 1/2*x2^2 - x1)
        """
        n = integer("dimension", dimension, 1)
        if K is None:
            if n % 2:
                raise wrong("dimension", "an even number without K", n)
            K = np.eye(n, k=n // 2, dtype=np.int64) - np.eye(n, k=-n // 2, dtype=np.int64)
        K = exact_array("K", K, (n, n))
        if (K != -K.T).any():
            i, j = np.argwhere(K != -K.T)[0]
            received = f"{K[i, j]} at [{i}, {j}] and {K[j, i]} at [{j}, {i}]"
            raise wrong("K", "an antisymmetric matrix", received)
        [energy] = _values_of("H", lambda x: (H(x),), n, 1, 3)
        gradient = [energy.derivative(i) for i in range(n)]
        components = [
            sum((gradient[j] * row[j] for j in np.flatnonzero(row)), Polynomial({})) for row in K
        ]
        return cls._of_components(components, energy, K)

    @classmethod
    def of(cls, body: Any) -> QuadraticField:
        """Return the equations of motion of a body, or of a batch of bodies.

        The variables are Omega_1 and Omega_2, or Omega_1n, ..., Omega_(n-1)n; the parameters of a
        single body are taken exactly. Raises TypeError for anything else.
        """
        if isinstance(body, cls):
            return body
        instance("body", body, (Suslov3D, SuslovND, SuslovGyrostat))
        of: Any = np.asarray if body.shape else lambda each: exact_array("body", each)
        if isinstance(body, SuslovND):
            J, I = of(body.J), of(body.I)
        else:
            parts = np.broadcast_arrays(body.I1, body.I2, body.I23, np.negative(body.I13))
            J, I = of(np.stack(parts[:2], axis=-1)), of(np.stack(parts[2:], axis=-1))
        unit = np.eye(body.dimension, dtype=np.int64)
        # J_i x_i' = sum_j I_j x_j x_i - I_i sum_j x_j x_j
        q = unit[:, :, np.newaxis] * I[..., np.newaxis, np.newaxis, :]
        q = (q - I[..., np.newaxis, np.newaxis] * unit) / J[..., np.newaxis, np.newaxis]
        if not isinstance(body, SuslovGyrostat):
            return cls(q)
        turn = np.array([[0, -1], [1, 0]])
        return cls(q, turn * (of(body.k)[..., np.newaxis] / J)[..., np.newaxis])

    @classmethod
    def _of_components(
        cls, components: Sequence[Polynomial], H: Polynomial | None = None, K: Any = None
    ) -> QuadraticField:
        n = len(components)
        constant, linear, quadratic = (np.full((n,) * k, Fraction(0)) for k in (1, 2, 3))
        for i, each in enumerate(components):
            for powers, c in each.terms.items():
                (constant, linear, quadratic)[len(powers)][(i, *powers)] = c
        return _remade(cls, (quadratic, linear, constant), H, K)

    @classmethod
    def _axes(cls, name: str) -> int:
        return _AXES[name]

    @classmethod
    def _of(cls, values: Mapping[str, Any]) -> QuadraticField:
        return cls(**values)

    @property
    def _text(self) -> str | None:
        numbers = () if self.shape else (c for p in self.polynomials for c in p.terms.values())
        if self.H is None and all(isinstance(plain(c), float) for c in numbers):
            return None
        return json.dumps(self.to_dict())

    @property
    def dimension(self) -> int:
        """The number of variables."""
        return int(self.constant.shape[-1])

    @property
    def _labels(self) -> tuple[str, ...]:
        return tuple(f"x{i}" for i in range(1, self.dimension + 1))

    @cached_property
    def polynomials(self) -> tuple[Polynomial, ...]:
        """The components of a single field."""
        terms: list[dict[tuple[int, ...], Fraction]] = [{} for _ in range(self.dimension)]
        for name in _AXES:
            array = getattr(self, name)
            for i, *powers in np.argwhere(array).tolist():
                if powers == sorted(powers):
                    times = len({*powers}) or 1
                    terms[i][tuple(powers)] = times * array[(i, *powers)]
        return tuple(map(Polynomial, terms))

    @cached_property
    def terms(self) -> tuple[tuple[IntArray, ...], tuple[FloatArray, ...]]:
        """The nonzero terms: indices (i, j, k), (i, j) and (i,), as columns, and coefficients.

        The coefficients are (T,), or (..., T) of a batch, rounded once.
        """
        if self.shape:
            q, l, c = (getattr(self, name) for name in _AXES)
            q = np.triu(q) + np.triu(q, 1)
            tables = [
                (np.argwhere(each.any(tuple(range(each.ndim - k)))), each)
                for each, k in zip((q, l, c), (3, 2, 1), strict=True)
            ]
            return (
                tuple(np.ascontiguousarray(index.T) for index, _ in tables),
                tuple(each[(..., *index.T)] for index, each in tables),
            )
        found: list[dict[Any, float]] = [{}, {}, {}]
        try:
            for i, each in enumerate(self.polynomials):
                for powers, a in each.terms.items():
                    found[2 - len(powers)][(i, *powers)] = float(a)
        except OverflowError:
            raise wrong("body", "coefficients in the range of float64", self) from None
        return (
            tuple(
                np.array([*each], np.int64).reshape(-1, 3 - k).T.copy()
                for k, each in enumerate(found)
            ),
            tuple(np.array([*each.values()], np.float64) for each in found),
        )

    @cached_property
    def gradient(self) -> QuadraticField:
        """The gradient of H, as a field."""
        return self._of_components([self._energy.derivative(i) for i in range(self.dimension)])

    @cached_property
    def quotients(self) -> QuadraticField:
        """A field g with x.g(x) = H(x) - H(0): each term of H, without its first variable."""
        parts: list[dict[Any, Fraction]] = [{} for _ in range(self.dimension)]
        for (i, *others), c in ((p, c) for p, c in self._energy.terms.items() if p):
            parts[i][tuple(others)] = c
        return self._of_components([Polynomial(each) for each in parts])

    @property
    def _energy(self) -> Polynomial:
        if self.H is None:
            expected = "a field made by QuadraticField.from_hamiltonian"
            raise wrong("body", expected, "a field without a Hamiltonian", TypeError)
        return self.H

    @property
    def components(self) -> tuple[Any, ...]:
        """The components as ``flint.fmpq_mpoly`` in x1, ..., xD."""
        import flint  # optional: only the laboratory needs it

        n = self.dimension
        context = flint.fmpq_mpoly_ctx.get([f"x{i}" for i in range(1, n + 1)], ordering="deglex")
        return tuple(
            context.from_dict(
                {
                    tuple(map(powers.count, range(n))): flint.fmpq(c.numerator, c.denominator)
                    for powers, c in each.terms.items()
                }
            )
            for each in self.polynomials
        )

    def __call__(self, x: Any) -> Any:
        """Return the field at a point: fractions if all numbers are exact, else floats (..., D)."""
        if not self.shape and np.ndim(x) == 1 and all(isinstance(a, Rational) for a in x):
            point = exact_array("x", x, (self.dimension,))
            return tuple(each(point) for each in self.polynomials)
        state = vectors("x", x, self.dimension, allow_nan=True)
        q, l, c = (np.asarray(getattr(self, name), np.float64) for name in _AXES)
        with np.errstate(all="ignore"):
            slopes = l + (q @ state[..., np.newaxis, :, np.newaxis])[..., 0]
            return (slopes @ state[..., np.newaxis])[..., 0] + c

    def __eq__(self, other: object) -> bool:
        same = super().__eq__(other)
        if same is not True or not isinstance(other, QuadraticField):
            return same
        return self.H == other.H and np.array_equal(self.K, other.K)

    def __hash__(self) -> int:
        return super().__hash__() if self.shape else hash((self.polynomials, self.H))

    def __reduce__(self) -> tuple[Any, ...]:
        return _remade, (type(self), tuple(self._values.values()), self.H, self.K)

    def __repr__(self) -> str:
        if self.shape:
            return super().__repr__()
        equations = [f"x{i}' = {each}" for i, each in enumerate(self.polynomials, start=1)]
        equations += [] if self.H is None else [f"H = {self.H}"]
        return (
            f"QuadraticField({textwrap.shorten(', '.join(equations), _LINE, placeholder=' ...')})"
        )

    def _repr_latex_(self) -> str:
        if self.shape or self.dimension > _LINE // 20:
            return super()._repr_latex_()
        style = "x_{{{}}}", " ", "^{{{}}}", r"\frac{{{}}}{{{}}}"
        texts = enumerate((each.text(*style) for each in self.polynomials), start=1)
        return "$" + r",\quad ".join(rf"\dot x_{{{i}}} = {text}" for i, text in texts) + "$"

    def to_dict(self) -> dict[str, Any]:
        """Return the coefficients as nested lists, without loss, for JSON.

        Numbers that are not floats are strings "p/q". A field made from a Hamiltonian also has K,
        and H as a list of terms [c, i, j, k], each for c x[i] x[j] x[k].
        """
        values: dict[str, Any] = {"body": type(self).__name__}
        values |= {name: _plain(getattr(self, name)) for name in _AXES}
        if self.H is not None:
            values["H"] = [[plain(c), *powers] for powers, c in self.H.terms.items()]
            values["K"] = _plain(self.K)
        return values

    @classmethod
    def from_dict(cls, parameters: Mapping[str, Any]) -> QuadraticField:
        """Return the field that :meth:`to_dict` describes."""
        instance("parameters", parameters, Mapping)
        given = dict(parameters)
        kind, H, K = (given.pop(name, None) for name in ("body", "H", "K"))
        if kind != cls.__name__:
            raise wrong("body", repr(cls.__name__), repr(kind))
        if not {"quadratic"} <= given.keys() <= _AXES.keys():
            raise wrong("parameters", f"the names {[*_AXES]}", sorted(given))
        field = cls(**{name: _read(name, each) for name, each in given.items()})
        if H is None:
            return field
        terms = {tuple(powers): exact_array("H", _read("H", c)).item() for c, *powers in H}
        made = cls.from_hamiltonian(Polynomial(terms), field.dimension, _read("K", K))
        if any((getattr(made, name) != getattr(field, name)).any() for name in _AXES):
            raise ValueError("H, K: expected those of the coefficients, got others")
        return made


def _remade(cls: type[QuadraticField], coefficients: Any, H: Any, K: Any) -> QuadraticField:
    """Return a field, with its Hamiltonian if it has one."""
    field = cls(*coefficients)
    if H is not None:
        K.flags.writeable = False
        object.__setattr__(field, "H", H)
        object.__setattr__(field, "K", K)
    return field


def _values_of(
    name: str, f: Callable[[Any], Any], n: int, count: int, degree: int
) -> list[Polynomial]:
    """Return the polynomials in n variables that a function of the user returns."""
    kinds = f"polynomials of degree at most {degree}"
    try:
        found = [*f(Polynomial.variables(n))]
    except TypeError as error:
        how = f"{kinds}, by +, -, * and divisions by numbers"
        raise wrong(name, how, f"an error: {error}", TypeError) from error
    if len(found) != count:
        raise wrong(name, f"{count} components", len(found))
    polynomials = [Polynomial.of(f"the value of {name}", each) for each in found]
    if (highest := max(each.degree for each in polynomials)) > degree:
        raise wrong(name, kinds, f"degree {highest}")
    return polynomials


def _plain(array: Any) -> Any:
    """Return nested lists for JSON."""
    return array.tolist() if array.dtype != object else np.vectorize(plain, "O")(array).tolist()


def _read(name: str, value: Any) -> Any:
    """Return nested lists of numbers whose strings "p/q" are fractions."""
    if isinstance(value, list):
        return [_read(name, each) for each in value]
    if not isinstance(value, str):
        return value
    try:
        return Fraction(value)
    except (ValueError, ZeroDivisionError):
        raise wrong(name, 'numbers or strings "p/q"', repr(value)) from None
