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
    Monomial,
    Polynomial,
    antisymmetric,
    coefficients_in,
    exact_array,
    fill,
    from_plain,
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
_AXES = {"quadratic": 3, "linear": 2, "constant": 1}
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
        The Hamiltonian, which can be called, and the matrix (D, D), or None.
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

    _meanings: ClassVar[dict[str, str]] = {name: f"{name} coefficients" for name in _AXES}
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
        for name, axes in _AXES.items():
            if D == 0 or arrays[name].shape[-axes:] != (D,) * axes:
                letter = "D" if name == "quadratic" else str(D)
                shape = f"shape (..., {', '.join([letter] * axes)})"
                raise wrong(name, shape, arrays[name].shape)
        if any(arrays[name].ndim > axes for name, axes in _AXES.items()):
            if H is not None or K is not None:
                raise wrong("H, K", "None for a batch of fields", "others")
            half = 0.5 * real_array("quadratic", quadratic)
            self._set(**arrays | {"quadratic": half + half.swapaxes(-2, -1)})
            return
        made = self._of_components(polynomials_of(arrays))
        if H is not None or K is not None:
            whole = self.from_hamiltonian(H, D, K)
            if whole.polynomials != made.polynomials:
                raise ValueError("H, K: expected those of the coefficients, got others")
            made = whole
        vars(self).update(vars(made))

    @classmethod
    def _names(cls) -> list[str]:
        return [*_AXES]

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
        cls, f: Any, components: named.PolynomialsOf, values: named.Values, n: int
    ) -> QuadraticField:
        """Return the field with the components of a function of x and parameters."""
        if any(map(np.ndim, values.values())):
            self = cls(**named.coefficients_for(f, components, values, n))
        else:
            self = cls._of_components(components(partial(f, **values), 0))
        # A function that looks at a parameter, as `a if a else 1`, does not see symbols as values.
        affine = named.affine_terms(f, components, values, n)
        return self._with_names(values, affine if self._agrees(affine, values) else [])

    def _with_names(self, values: named.Values, affine: named.Affine) -> QuadraticField:
        vars(self).update(_parameters=values, _affine=affine)
        return self

    @classmethod
    @filled
    def from_hamiltonian(
        cls, H: Callable[..., Any], /, dimension: int, K: Any = None, **parameters: Any
    ) -> QuadraticField:
        """Return the field ``x' = K grad H(x, **parameters)``, which carries H and K.

        With arrays of parameters it is a batch of fields, which does not carry them: it has no
        `energy`, `modified_energy` or `invariant_density`.

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

        def energy(of: Callable[[Any], Any], more: int) -> Polynomial:
            return values_of("H", lambda x: (of(x),), n + more, 1, 3 + more)[0]

        def components(of: Callable[[Any], Any], more: int) -> tuple[Polynomial, ...]:
            whole = energy(of, more)
            gradient = [whole.derivative(i) for i in range(n)]
            return tuple(
                sum((gradient[j] * row[j] for j in np.flatnonzero(row)), Polynomial({}))
                for row in K
            )

        self = cls._named(H, components, values, n)
        if not self.shape:
            vars(self).update(H=energy(partial(H, **values), 0), K=K)
        return self

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
        return cls(**values)

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
        swept = type(self)(**named.coefficients_at(self._affine, parameters, self.dimension))
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
        if self.H is None:
            return {}
        terms = sorted(self.H.terms.items())
        return {"H": [[plain(c), *powers] for powers, c in terms], "K": plain_lists(self.K)}

    @property
    def dimension(self) -> int:
        """The number of variables."""
        return int(self.constant.shape[-1])

    @property
    def _labels(self) -> tuple[str, ...]:
        return tuple(f"x{i}" for i in range(1, self.dimension + 1))

    @property
    def _arrays(self) -> dict[str, FloatArray]:
        if not self.shape:
            _ = self.terms  # an error if a coefficient is out of range
        return super()._arrays

    @cached_property
    def terms(self) -> tuple[IntArray, FloatArray]:
        """The nonzero terms v x_j x_k of all f_i, where x_D = 1: i, j and k (3, T), and v.

        Those with k = D are last. The coefficients are (T,), or (..., T) of a batch, rounded once.
        """
        D = self.dimension
        table = np.zeros((*self.shape, D, D + 1, D + 1))
        if self.shape:
            q, table[..., :D, D], table[..., D, D] = self._arrays.values()
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
        slopes = map(self.hamiltonian.derivative, range(self.dimension))
        return self._of_components(tuple(slopes))

    @property
    def hamiltonian(self) -> Polynomial:
        """H; TypeError for a field without one."""
        if self.H is None:
            expected = "a single field made by QuadraticField.from_hamiltonian"
            received = "a batch of fields" if self.shape else "a field without a Hamiltonian"
            raise wrong("body", expected, received, TypeError)
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
        if not self.shape and np.ndim(x) == 1 and all(isinstance(a, Rational) for a in x):
            check_labels("x", x, self._labels)
            point = exact_array("x", x, (self.dimension,))
            return tuple(each(point) for each in self.polynomials)
        state = vectors("x", x, self.dimension, allow_nan=True, labels=self._labels)
        q, l, c = self._arrays.values()
        with np.errstate(all="ignore"):
            slopes = l + (q @ state[..., np.newaxis, :, np.newaxis])[..., 0]
            return (slopes @ state[..., np.newaxis])[..., 0] + c

    @property
    def _key(self) -> tuple[Any, ...]:
        if self.shape:
            return super()._key
        return self.polynomials, self.H, None if self.K is None else tuple(self.K.flat)

    def __reduce__(self) -> tuple[Any, ...]:
        besides = {name: getattr(self, name) for name in ("H", "K", "_parameters", "_affine")}
        if self.shape:
            return self._of, (self._values,), besides
        return self._of_components, (self.polynomials,), besides

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
        and H as a list of terms [c, i, j, k], each for c x[i] x[j] x[k]. Named parameters are under
        "parameters". Where the field is affine in some of them, the terms of its components are
        under "affine", with the names of these as factors: [c, i, j, "a"] is c a x[i] x[j].
        """
        whole = super().to_dict() | self._besides | self._names_and_values
        exact = {} if self.shape else self._values
        return whole | {name: plain_lists(each) for name, each in exact.items()}

    @classmethod
    def from_dict(cls, parameters: Mapping[str, Any]) -> QuadraticField:
        """Return the field that :meth:`to_dict` describes."""
        given = dict(mapping(parameters))
        values, affine = given.pop("parameters", {}), given.pop("affine", [])
        given |= {name: from_plain(name, each) for name, each in given.items() if name != "body"}
        if "H" in given:
            instance("H", given["H"], list)
            terms = (each for each in given["H"] if isinstance(each, list) and each)
            given["H"] = Polynomial({tuple(powers): rational("H", c) for c, *powers in terms})
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
        return all(
            np.allclose(found[name], a, rtol=1e-9, atol=1e-9 * abs(a).max(initial=0))
            for name, a in self._arrays.items()
        )


def _dimension(name: str, f: Any, dimension: int) -> int:
    """Return the dimension of the field that a function gives, both of which it checks."""
    if not callable(f):
        expected = "a function of x, the tuple of variables"
        raise wrong(name, expected, type(f).__name__, TypeError)
    return integer("dimension", dimension, 1)
