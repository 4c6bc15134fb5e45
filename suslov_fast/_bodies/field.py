"""Quadratic vector fields as bodies of Kahan maps."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, partial
from numbers import Rational
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .._checks import (
    FloatArray,
    check_labels,
    common_shape,
    instance,
    integer,
    real_array,
    vectors,
    wrong,
)
from .._docs import filled
from . import named
from .algebra import (
    BatchPolynomial,
    Monomial,
    Polynomial,
    antisymmetric,
    coefficients_in,
    dense,
    exact_array,
    fill,
    from_plain,
    monomials,
    numbers,
    plain,
    plain_lists,
    polynomials_of,
    rational,
    values_of,
)
from .base import Body, mapping

IntArray = NDArray[np.int64]
# Numbers of axes of the coefficients.
_AXES = {"quadratic": 3, "linear": 2, "constant": 1, "H": 1, "K": 2}
# Length of the text of a single field.
_LINE = 300


@filled
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
    H, K : optional
        The Hamiltonian and the matrix that :meth:`from_hamiltonian` takes, and from which it makes
        these coefficients.

    %(Raises: invalid)s

    Attributes
    ----------
    quadratic, linear, constant : ndarray
        The coefficients, read-only: of fractions for a single field, of floats for a batch.
    H, K
        The Hamiltonian, which can be called, and the matrix (D, D), or None. Those of a batch are
        of floats, and H takes states (..., D), whose shape broadcasts against that of the batch.
    parameters : dict
        The named parameters of :meth:`from_function` and :meth:`from_hamiltonian`. They are
        coordinates of datasets and stores; ``==`` and hash do not look at them, and
        `dataclasses.replace` drops them, as other coefficients need not be theirs.

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
    H: Polynomial | None = None
    K: Any = None

    _meanings: ClassVar[dict[str, str]] = {
        **{name: f"{name} coefficients" for name in ("quadratic", "linear", "constant")},
        "H": "coefficients of the Hamiltonian",
        "K": "structure matrix",
    }
    # What messages say of fields in place of bodies.
    _kind: ClassVar[str] = (
        "QuadraticField; fields have step, iterate, vector_field, jacobian, matrix, multipliers "
        "and lyapunov_exponents, and those from a Hamiltonian energy, modified_energy and "
        "invariant_density"
    )
    # Named parameters, and how the coefficients depend on them.
    _parameters: ClassVar[dict[str, Any]] = {}
    _affine: ClassVar[named.Affine] = []
    # Its components, if it is a single one.
    polynomials: ClassVar[tuple[Polynomial, ...]] = ()

    def __init__(
        self, quadratic: Any, linear: Any = None, constant: Any = None, H: Any = None, K: Any = None
    ) -> None:
        arrays = {"quadratic": numbers("quadratic", quadratic)}
        D = (0, *arrays["quadratic"].shape)[-1]
        for name, given in (("linear", linear), ("constant", constant)):
            zero = np.zeros((D,) * _AXES[name])
            arrays[name] = zero if given is None else numbers(name, given)
        for name, array in arrays.items():
            axes = _AXES[name]
            if D == 0 or array.shape[-axes:] != (D,) * axes:
                letter = "D" if name == "quadratic" else str(D)
                shape = f"shape (..., {', '.join([letter] * axes)})"
                raise wrong(name, shape, array.shape)
        if any(array.ndim > _AXES[name] for name, array in arrays.items()):
            half = 0.5 * real_array("quadratic", quadratic)
            self._set(**arrays | {"quadratic": half + half.swapaxes(-2, -1)})
        else:
            vars(self).update(vars(self._of_components(polynomials_of(arrays))))
        if H is not None or K is not None:
            self._set_hamiltonian(H, K)

    def _set_hamiltonian(self, H: Any, K: Any) -> None:
        """Set H and K, which are to give the coefficients; those in files are rounded."""
        D, of_all = self.dimension, monomials(self.dimension)
        if self.shape:
            known = isinstance(H, Polynomial)
            table = dense(H.terms, D, self.shape) if known else real_array("H", H)
            if table.shape != (shape := (*self.shape, len(of_all))):
                raise wrong("H", f"shape {shape}", table.shape)
            self._set(H=table, K=antisymmetric(K, D).astype(np.float64))
            vars(self)["H"] = BatchPolynomial.of_table(vars(self)["H"], D)
        else:
            if isinstance(H, BatchPolynomial):
                raise wrong("H", "coefficients that are numbers, as of a single field", "lists")
            if isinstance(H, np.ndarray):
                H = Polynomial(dict(zip(of_all, exact_array("H", H, (len(of_all),)), strict=True)))
            whole = self.from_hamiltonian(H, D, K)
            vars(self).update(H=whole.H, K=whole.K)
            if whole == self:
                return
        K, k = self._arrays["K"], len(self.shape)
        for name, a in self._coefficients.items():
            slopes = self.gradient._arrays[name]
            a = np.broadcast_to(a, slopes.shape)
            scale = np.tensordot(abs(K), abs(slopes), (1, k))
            error = np.tensordot(K, slopes, (1, k)) - np.moveaxis(a, k, 0)
            if (abs(error) > 1e-9 * scale).any():
                raise ValueError("H, K: expected those of the coefficients, got others")

    @classmethod
    @filled
    def from_function(
        cls, f: Callable[..., Any], /, dimension: int, **parameters: Any
    ) -> QuadraticField:
        """Return the field with components ``f(x, **parameters)``.

        Parameters
        ----------
        f : callable
            It maps a tuple x of D variables to D polynomials of degree 2 or less. It is called with
            symbolic variables, so its coefficients remain exact; floats are binary numbers. With
            arrays of parameters it is called for each of their values.
        %(dimension)s
        %(named)s

        Returns
        -------
        QuadraticField

        %(Raises: invalid)s

        Examples
        --------
        >>> from suslov_fast import QuadraticField
        >>> QuadraticField.from_function(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2)
        QuadraticField(x1' = -x1*x2 + x1, x2' = x1*x2 - x2)
        >>> fields = QuadraticField.from_function(lambda x, a: (a - x[0] ** 2,), 1, a=[1, 2, 3])
        >>> fields.shape, fields.parameters
        ((3,), {'a': array([1., 2., 3.])})
        """
        n = _dimension("f", f, dimension)

        def components(of: Callable[[Any], Any], more: int) -> tuple[Polynomial, ...]:
            return values_of("f", of, n + more, n, 2 + more)

        return cls._named(f, components, named.check_parameters(parameters), n)

    @classmethod
    def _named(
        cls, f: Any, components: named.PolynomialsOf, values: named.Values, n: int, K: Any = None
    ) -> QuadraticField:
        """Return the field with the components of a function, or a Hamiltonian, of x."""
        if any(map(np.ndim, values.values())):
            arrays = named.coefficients_for(f, components, values, n)
            if K is not None:
                none = np.zeros((*arrays["constant"].shape[:-1], len(monomials(n))))
                arrays = {"H": none, "K": K.astype(np.float64)} | arrays  # H of no fields is absent
            self = cls._of(arrays)
        else:
            found = components(partial(f, **values), 0)
            self = cls._of_components(found[:n])
            vars(self).update(H=None if K is None else found[n], K=K)
        # A function that looks at a parameter, as `a if a else 1`, does not see symbols as values.
        affine = named.affine_terms(f, components, values, n)
        agrees = affine and self._agrees(affine, values)
        return self._with_names(values, affine if agrees else [])

    def _with_names(self, values: named.Values, affine: named.Affine) -> QuadraticField:
        vars(self).update(_parameters=values, _affine=affine)
        return self

    @classmethod
    @filled
    def from_hamiltonian(
        cls, H: Callable[..., Any], /, dimension: int, K: Any = None, **parameters: Any
    ) -> QuadraticField:
        """Return the field ``x' = K grad H(x, **parameters)``, which carries H and K.

        Parameters
        ----------
        H : callable
            It maps a tuple x of D variables to a polynomial of degree 3 or less, as the function
            of :meth:`from_function` does.
        %(dimension)s
        K : array_like(shape=(D, D)), optional
            A constant antisymmetric matrix, of any rank. By default, for even D, it is the
            canonical one of coordinates and momenta x = (q1, ..., qm, p1, ..., pm).
        %(named)s

        Returns
        -------
        QuadraticField

        %(Raises: invalid)s

        Examples
        --------
        >>> from suslov_fast import QuadraticField
        >>> QuadraticField.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, 2)
        QuadraticField(x1' = x2, x2' = -3*x1^2 + 1, H = x1^3 + 1/2*x2^2 - x1)
        """
        n = _dimension("H", H, dimension)
        K, values = antisymmetric(K, n), named.check_parameters(parameters)

        def components(of: Callable[[Any], Any], more: int) -> tuple[Polynomial, ...]:
            (whole,) = values_of("H", lambda x: (of(x),), n + more, 1, 3 + more)
            gradient = [whole.derivative(i) for i in range(n)]
            rates = (
                sum((gradient[j] * row[j] for j in np.flatnonzero(row)), Polynomial({}))
                for row in K
            )
            return *rates, whole

        return cls._named(H, components, values, n, K)

    @classmethod
    def of(cls, body: Any) -> QuadraticField:
        """Return the equations of motion of a body, or of a batch of bodies: its `field()`.

        The variables are the components of a state; the parameters of a single body are taken
        exactly. Raises TypeError for anything else.
        """
        if not isinstance(body, Body):
            expected = "Suslov3D, SuslovND or another body"
            raise wrong("body", expected, type(body).__name__, TypeError)
        field: QuadraticField = body.field()
        return field

    def field(self) -> QuadraticField:
        """Return the field itself."""
        return self

    @classmethod
    def _of_components(cls, components: tuple[Polynomial, ...]) -> QuadraticField:
        self = object.__new__(cls)
        D = len(components)
        table = np.full((D, D + 1, D + 1), Fraction(0))
        fill(table, (each.terms for each in components))
        table.flags.writeable = False
        vars(self).update(coefficients_in(table), polynomials=components, H=None, K=None)
        return self

    @classmethod
    def _axes(cls, name: str) -> int:
        return _AXES[name]

    @classmethod
    def _of(cls, values: Mapping[str, Any]) -> QuadraticField:
        self = super()._of(values)
        if "H" in values:
            vars(self)["H"] = BatchPolynomial.of_table(vars(self)["H"], self.dimension)
        return self

    @property
    def parameters(self) -> dict[str, Any]:  # type: ignore[override]
        """The named parameters: numbers, and read-only arrays whose shapes broadcast."""
        return dict(self._parameters)

    @property
    def _coordinates(self) -> dict[str, FloatArray]:
        return {name: np.asarray(each, np.float64) for name, each in self._parameters.items()}

    def _swept(self, name: str, values: FloatArray) -> QuadraticField:
        factors = {each for terms in self._affine for _, *factors in terms for each in factors}
        if name not in factors:
            names = filter(factors.__contains__, self._parameters)
            expected = "a parameter in which the coefficients are affine"
            raise wrong("body", f"{expected} ({', '.join(names) or 'none'})", name)
        parameters = self._parameters | {name: values}
        arrays = named.coefficients_at(self._affine, parameters, self.dimension)
        swept = type(self)(**arrays, K=self.K)
        return swept._with_names(parameters, self._affine)

    @property
    def _names_and_values(self) -> dict[str, Any]:
        """The named parameters for JSON."""
        return named.plain_parameters(self._parameters, self._affine)

    @property
    def _text(self) -> str | None:
        given = self._besides | self._names_and_values
        if "parameters" in given:  # arrays are stored as such
            values = given["parameters"].items()
            given["parameters"] = {name: None if np.ndim(each) else each for name, each in values}
        exact = (plain(c) for each in self.polynomials for c in each.terms.values())
        if not all(isinstance(c, float) for c in exact):
            given |= {name: plain_lists(each) for name, each in self._values.items()}
        return json.dumps({"body": type(self).__name__} | given) if given else None

    @property
    def _besides(self) -> dict[str, Any]:
        return {} if self.shape else self._structure

    @property
    def _structure(self) -> dict[str, Any]:
        """H and K for JSON."""
        if self.H is None:
            return {}
        terms: list[Any] = sorted(self.H.terms.items())
        H = [[c.tolist() if self.shape else plain(c), *powers] for powers, c in terms]
        return {"H": H, "K": plain_lists(self.K)}

    @property
    def dimension(self) -> int:
        """The number of variables."""
        return int(self.constant.shape[-1])

    @property
    def _labels(self) -> tuple[str, ...]:
        return tuple(f"x{i}" for i in range(1, self.dimension + 1))

    @property
    def _values(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self._required()}

    @property
    def _coefficients(self) -> dict[str, FloatArray]:
        if not self.shape:
            _ = self.terms  # an error if a coefficient is out of range
        return super()._arrays

    @property
    def _arrays(self) -> dict[str, FloatArray]:
        if self.H is None:
            return self._coefficients
        H = dense(self.H.terms, self.dimension, self.shape)
        return self._coefficients | {"H": H, "K": np.asarray(self.K, np.float64)}

    @cached_property
    def terms(self) -> tuple[IntArray, FloatArray]:
        """The nonzero terms v x_j x_k of all f_i, where x_D = 1: i, j and k (3, T), and v.

        Those with k = D are last. The coefficients are (T,), or (..., T) of a batch, rounded once.
        """
        D = self.dimension
        table = np.zeros((*self.shape, D, D + 1, D + 1))
        if self.shape:
            q, table[..., :D, D], table[..., D, D] = self._values.values()
            table[..., :D, :D] = np.triu(q) + np.triu(q, 1)
        try:
            for i, each in enumerate(self.polynomials):
                for powers, c in each.terms.items():
                    table[(i, *powers, D, D)[:3]] = float(c)
        except OverflowError:
            raise wrong("body", "coefficients in the range of float64", self) from None
        indices = np.argwhere(table.any(axis=tuple(range(len(self.shape)))))
        indices = indices[np.argsort(indices[:, 2] == D, kind="stable")].T
        return np.ascontiguousarray(indices), table[(..., *indices)]

    @cached_property
    def gradient(self) -> QuadraticField:
        """The gradient of H, as a field."""
        D = self.dimension
        slopes = tuple(map(self.hamiltonian.derivative, range(D)))
        if not self.shape:
            return self._of_components(slopes)
        table = np.zeros((*self.shape, D, D + 1, D + 1))
        fill(table, (each.terms for each in slopes))
        return self._of(coefficients_in(table))

    @property
    def hamiltonian(self) -> Polynomial:
        """H; TypeError for a field without one."""
        if self.H is None:
            expected = "a field made by QuadraticField.from_hamiltonian"
            raise wrong("body", expected, "a field without a Hamiltonian", TypeError)
        return self.H

    @property
    def components(self) -> tuple[Any, ...]:
        """The components as ``flint.fmpq_mpoly`` in x1, ..., xD."""
        import flint  # optional: only the laboratory needs it

        def exponents(powers: Monomial) -> tuple[int, ...]:
            return tuple(map(powers.count, range(self.dimension)))

        context = flint.fmpq_mpoly_ctx.get(self._labels, ordering="deglex")
        terms = (
            {exponents(powers): flint.fmpq(*c.as_integer_ratio()) for powers, c in p.terms.items()}
            for p in self.polynomials
        )
        return tuple(map(context.from_dict, terms))

    def __call__(self, x: Any) -> Any:
        """Return the field at a point: fractions if all numbers are exact, else floats (..., D)."""
        if not self.shape and np.iterable(x) and all(isinstance(a, Rational) for a in x):
            check_labels("x", x, self._labels)
            point = exact_array("x", x, (self.dimension,))
            return tuple(each(point) for each in self.polynomials)
        state = vectors("x", x, self.dimension, allow_nan=True, labels=self._labels)
        q, l, c = self._coefficients.values()
        with np.errstate(all="ignore"):
            slopes = l + (q @ state[..., np.newaxis, :, np.newaxis])[..., 0]
            return (slopes @ state[..., np.newaxis])[..., 0] + c

    @property
    def _key(self) -> tuple[Any, ...]:
        if self.shape:
            return super()._key
        return self.polynomials, self.H, None if self.K is None else tuple(self.K.flat)

    def __reduce__(self) -> tuple[Any, ...]:
        names = {"_parameters": self._parameters, "_affine": self._affine}
        if self.shape:
            return self._of, (self._arrays,), names
        return self._of_components, (self.polynomials,), names | {"H": self.H, "K": self.K}

    def __repr__(self) -> str:
        if self.shape:
            return super().__repr__()
        equations = [f"x{i}' = {each}" for i, each in enumerate(self.polynomials, start=1)]
        equations += [] if self.H is None else [f"H = {self.H}"]
        short = textwrap.shorten(", ".join(equations), _LINE, placeholder=" ...")
        return f"QuadraticField({short})"

    def to_dict(self) -> dict[str, Any]:
        """Return the coefficients as nested lists, without loss, for JSON.

        Numbers that are not floats are strings "p/q". A field made from a Hamiltonian also has K,
        and H as a list of terms [c, i, j, k], each for c x[i] x[j] x[k]; of a batch c is a list.
        Named parameters are under "parameters". Where the field is affine in some of them, the
        terms of its components, and then those of its H, are under "affine", with the names of
        these as factors: [c, i, j, "a"] is c a x[i] x[j].
        """
        whole = super().to_dict() | self._structure | self._names_and_values
        exact = {} if self.shape else self._values
        return whole | {name: plain_lists(each) for name, each in exact.items()}

    @classmethod
    def from_dict(cls, parameters: Mapping[str, Any]) -> QuadraticField:
        """Return the field that :meth:`to_dict` describes."""
        given = dict(mapping(parameters))
        values, affine = given.pop("parameters", {}), given.pop("affine", [])
        given |= {name: from_plain(name, each) for name, each in given.items() if name != "body"}
        if not isinstance(given.get("H"), np.ndarray | None):  # not that of files
            instance("H", given["H"], list)
            terms = [each for each in given["H"] if isinstance(each, list) and each]
            is_batch = any(isinstance(c, list) for c, *_ in terms)
            kind: Any = BatchPolynomial if is_batch else Polynomial
            read: Any = real_array if is_batch else rational
            given["H"] = kind({tuple(powers): read("H", c) for c, *powers in terms})
        field = super().from_dict({"linear": None, "constant": None} | given)
        instance("parameters", values, Mapping)
        plain_values = {name: from_plain(name, each) for name, each in values.items()}
        values = named.check_parameters(plain_values)
        shapes = {name: np.shape(each) for name, each in values.items()}
        if common_shape({"body": field.shape, **shapes}) != field.shape:
            raise wrong("parameters", f"shapes that broadcast to {field.shape}", f"{shapes}")
        if affine and not field._agrees(affine, values):
            raise ValueError("affine: expected that of the coefficients, got another")
        return field._with_names(values, affine)

    def _agrees(self, affine: named.Affine, values: named.Values) -> bool:
        """Return whether parameters and a dependence on them give the coefficients."""
        try:
            found = named.coefficients_at(affine, values, self.dimension)
        except (LookupError, TypeError, ValueError) as error:
            expected = "terms [c, indices and names of parameters] for each component"
            raise wrong("affine", expected, f"an error: {error!r}") from error
        except OverflowError:  # beyond the range of runs
            return False
        arrays = {name: a for name, a in self._arrays.items() if name != "K"}
        return arrays.keys() == found.keys() and all(
            np.allclose(found[name], a, rtol=1e-9, atol=1e-9 * abs(a).max(initial=0))
            for name, a in arrays.items()
        )


def _dimension(name: str, f: Any, dimension: int) -> int:
    """Return the dimension of the field that a function gives, both of which it checks."""
    if not callable(f):
        expected = "a function of x, the tuple of variables"
        raise wrong(name, expected, type(f).__name__, TypeError)
    return integer("dimension", dimension, 1)
