"""Quadratic vector fields, whose Kahan maps the package iterates and analyses.

A field is a list of terms: with x_D = 1, component i is the sum of v x_j x_k over its terms. A
Hamiltonian of degree 3 is a list of terms v x_i x_j x_k. The values of a single field are floats or
fractions, those of a family floats.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ... import checks
from ...checks import FloatArray, short, wrong
from ...keywords import public, public_class
from ..base import Body
from .calls import operands_of_function
from .coefficients import of_array, of_file, of_hamiltonian, of_terms, structure_matrix, with_arrays
from .field_of_terms import (
    H_INDICES,
    H_VALUES,
    INDICES,
    MATRIX,
    NAMES,
    TYPED,
    VALUES,
    _FieldOfTerms,
    parts_of,
)
from .names import labels, variables
from .polynomials import as_given, named_parameters, to_lists
from .terms import (
    Terms,
    components_of,
    polynomial_in,
    slopes_at,
    values_at,
)
from .tracing import terms_of


@public_class
@dataclass(frozen=True, eq=False, repr=False, init=False)
class QuadraticField(_FieldOfTerms):
    """A quadratic vector field, ``dx_i/dt = sum_jk q_ijk x_j x_k + sum_j l_ij x_j + c_i``.

    Make it with :meth:`from_function` or :meth:`from_hamiltonian`; the constructor takes arrays.
    Its map is Kahan's discretization, (x_next - x) / eps = f with (x_j x_next_k + x_next_j x_k) / 2
    for each x_j x_k and (x_j + x_next_j) / 2 for each x_j.

    Parameters
    ----------
    quadratic : array_like(shape=(..., D, D, D))
        q, of which only the part symmetric in j and k counts. Coefficients are 0 or between 1e-60
        and 1e60 in modulus, in any units. A single field keeps integers, fractions and floats
        exactly: 0.1 is the double nearest to 1/10, which is ``Fraction(1, 10)``. A batch of fields
        has floats.
    linear : array_like(shape=(..., D, D)), optional
        l, by default 0.
    constant : array_like(shape=(..., D)), optional
        c, by default 0.
    names : str or sequence of str, optional
        Names of the D variables, by default x1, ..., xD: ``"u v w"``, ``"u, v, w"`` or a list.

    Attributes
    ----------
    names : tuple of str
        Names of the variables in equations, plots, datasets and reports. ``==`` ignores them.
    terms : tuple of ndarray(int, shape=(3, T)) and ndarray(float, shape=(..., T))
        i, j, k and v of the terms v x_j x_k of x_i', with D for a factor 1; see :meth:`from_terms`.
    quadratic, linear, constant : ndarray
        q, l and c, made when they are first used. MemoryError if D is too large for q. Exact
        fractions, if given so: ``field.linear.astype(float)`` is an array for NumPy.
    H, K : Hamiltonian and ndarray(shape=(D, D)), or None
        Of :meth:`from_hamiltonian`: the Hamiltonian, a function of a state, and the matrix K.
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

    texts: ClassVar[Any] = "names", "typed"

    def __init__(
        self, quadratic: Any, linear: Any = None, constant: Any = None, names: Any = None
    ) -> None:
        if callable(quadratic):
            received = "a function: use QuadraticField.from_function(f, dimension)"
            raise wrong("quadratic", "an array (..., D, D, D)", received, TypeError)
        array = as_given("quadratic", quadratic)
        D = (0, *array.shape)[-1]
        if any(isinstance(each, str) for each in array.flat):
            received = f"{short(quadratic)}: use from_function(f, dimension) for equations"
            raise wrong("quadratic", "an array (..., D, D, D)", received, TypeError)
        if array.ndim == 2:
            how = f"for x' = A x pass QuadraticField.from_function(lambda x: A @ x, {D})"
            raise wrong("quadratic", "have the shape (..., D, D, D)", f"{array.shape}: {how}")
        terms = with_arrays({"quadratic": of_array("quadratic", array, 3, D)}, linear, constant, D)
        self._take(parts_of(terms, variables("names", names, D)))

    @classmethod
    @public
    def from_terms(
        cls,
        indices: Any,
        values: Any,
        dimension: int | str | Sequence[str],
        *,
        linear: Any = None,
        constant: Any = None,
    ) -> QuadraticField:
        """Return the field with given terms, such as one of many variables with few terms.

        Time and memory grow with the number of terms, not with D**3 as for arrays of coefficients.

        Parameters
        ----------
        indices : array_like(int, shape=(3, T))
            i, j, k of each term v x_j x_k of the derivative of x_i, counted from 0. The index D
            stands for a factor 1: (i, j, D) is a linear term, (i, D, D) a constant. The order of j
            and k does not matter, and repeated terms are added.
        values : array_like(shape=(..., T))
            v of each term. A single field keeps integers, fractions and floats exactly.
        dimension : int, str or sequence of str
            The number of variables, D, or their names.
        linear : array_like(shape=(..., D, D)), optional
            Coefficients of linear terms, which are added.
        constant : array_like(shape=(..., D)), optional
            Constants, which are added.

        Returns
        -------
        QuadraticField
            Its coefficients are the sums of the terms, rounded once in a batch.

        Examples
        --------
        A lattice of 1000 variables, with the derivative x_(i-1) (x_(i+1) - x_(i-2)) - x_i + 8:

        >>> import numpy as np
        >>> from suslov_fast import QuadraticField
        >>> D = 1000
        >>> i = np.arange(D)
        >>> products = [[*i, *i], [*(i - 1) % D] * 2, [*(i + 1) % D, *(i - 2) % D]]
        >>> values, damping = np.repeat([1, -1], D), [i, i, np.full(D, D)]
        >>> indices = np.hstack([products, damping])
        >>> field = QuadraticField.from_terms(
        ...     indices, [*values, *-np.ones(D)], D, constant=np.full(D, 8)
        ... )
        >>> field.terms[0].shape
        (3, 4000)
        """
        names = variables("dimension", dimension)
        D = len(names)
        terms = with_arrays({"values": of_terms(indices, values, D)}, linear, constant, D)
        return cls._of(parts_of(terms, names))

    @classmethod
    def _by_function(
        cls, f: Any, names: tuple[str, ...], values: dict[str, Any], M: None
    ) -> QuadraticField:
        from .general import Equations

        tracer, rows = operands_of_function("f", f, names, values)
        typed = Equations(names, [*values], tracer.values, rows)
        terms = terms_of("f", typed, typed.results, values)
        field = cls._of({**parts_of(terms, names), **values, TYPED: typed})
        return field._made_by(cls.from_function, f, names)

    @classmethod
    def _by_hamiltonian(
        cls, H: Any, names: tuple[str, ...], values: dict[str, Any], K: Any
    ) -> QuadraticField:
        matrix = structure_matrix(K, len(names), names)
        from .general import of_hamiltonian as equations_of_hamiltonian

        tracer, [energy] = operands_of_function("H", H, names, values)
        typed = equations_of_hamiltonian(tracer, names, [*values], energy, matrix)
        own = _of_energy(typed)
        energy = terms_of("H", own, [own.H], values)
        typed = own.__class__(names, [*values], typed.values, typed.results)
        field = cls._of_hamiltonian(energy, matrix, {NAMES: names, **values, TYPED: typed})
        return field._made_by(cls.from_hamiltonian, H, names, K)

    @classmethod
    def _of_hamiltonian(cls, H: Terms, K: Any, others: Mapping[str, Any]) -> QuadraticField:
        """Return the field of the exact terms of H and a matrix K, if its terms are in range."""
        field = cls._of({H_INDICES: H.indices, H_VALUES: H.values, MATRIX: K, **others})
        checks.within("H", field.parts[VALUES], checks.OTHERS)
        return field

    @classmethod
    @public
    def of(cls, body: Any) -> QuadraticField:
        """Return the equations of motion of a body, or of a batch, as a field.

        Coefficients of a single body are exact functions of its parameters, which are doubles.

        Parameters
        ----------
        body : Suslov3D, SuslovGyrostat, SuslovND or QuadraticField
            The body, or a batch; a field is returned as it is.

        Returns
        -------
        QuadraticField
            In the components of the angular velocity.

        Raises
        ------
        TypeError
            If `body` is no body, or a `Field`, whose equations need not be quadratic.

        Examples
        --------
        >>> from suslov_fast import QuadraticField, Suslov3D
        >>> QuadraticField.of(Suslov3D(I1=4, I2=1, I13=-0.5, I23=0))
        QuadraticField(Omega1' = 1/8*Omega1*Omega2, Omega2' = -1/2*Omega1^2)
        """
        checks.instance("body", body, Body)
        return body.field()

    @public
    def field(self) -> QuadraticField:
        return self

    def _value_at(self, x: Any) -> Any:
        """Return f(x): a tuple of fractions if all numbers are exact, else floats (..., D)."""
        terms = Terms(self.parts[INDICES], self.parts[VALUES])
        found = values_at(terms, x, self.names, 2)
        return tuple(found) if isinstance(found, list) else found

    def _slopes_at(self, x: FloatArray) -> FloatArray:
        return slopes_at(self._exact, x)

    @property
    def _formulas(self) -> Iterator[str]:
        for row in components_of(self._exact, self.dimension):
            yield polynomial_in(row, self.dimension).text(self.names)

    @public
    def to_dict(self) -> dict[str, Any]:
        parts = self.parts
        found = {"indices": parts[INDICES], "values": parts[VALUES]}
        if self.H is not None:
            H = {"indices": parts[H_INDICES], "values": parts[H_VALUES]}
            indices, values = parts[MATRIX][:2].astype(np.int64), parts[MATRIX][2]
            found = {"H": H, "K": {"indices": indices, "values": values}}
        values = {"parameters": self.parameters} if self.parameters else {}
        named = self.names != labels(self.dimension)
        texts: dict[str, Any] = {"names": [*self.names]} if named else {}
        if (field := self._as_typed[1]) is not None:
            written = field.to_dict()
            own = {n: written[n] for n in ("definitions", "equations") if n in written}
            texts["typed"] = own
        size = {"body": type(self).__name__, "dimension": self.dimension}
        return {**size, **to_lists(found | values), **texts}

    @classmethod
    def read(
        cls,
        dimension: Any,
        indices: Any = None,
        values: Any = None,
        H: Any = None,
        K: Any = None,
        parameters: Any = None,
        names: Any = None,
        typed: Any = None,
    ) -> QuadraticField:
        checks.instance("parameters", parameters or {}, Mapping)
        D = len(variables("dimension", dimension))
        names = variables("names", names, D)
        others = {NAMES: names, **named_parameters(parameters or {}, names)}
        if typed is not None:
            checks.instance("typed", typed, Mapping)
            from .general import Field

            others[TYPED] = Field.read(names, **typed, parameters=parameters)._equations
        if H is None and K is None:
            terms = with_arrays({"values": of_file(indices, values, D)}, None, None, D)
            return cls._of({**parts_of(terms, names), **others})
        if indices is not None or values is not None:
            raise ValueError("the parameters hold both coefficients and H: keep one of them")
        energy, matrix = of_hamiltonian(H, D), structure_matrix(K, D)
        return cls._of_hamiltonian(energy, matrix, others)


def _of_energy(equations: Any) -> Any:
    """Return equations with the list of H alone."""
    from .general import Equations

    names, parameters = equations.names, equations.parameters
    return Equations(names, parameters, equations.values, [], equations.H)
