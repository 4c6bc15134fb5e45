"""Fields x' = f(x): equations with any right-hand side, and families of equations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..checks import FloatArray, wrong
from ..core.cached import cached_property
from ..core.expressions.tables import is_table
from ..keywords import public, public_class
from . import coefficients, constructors, invariants, right_hand_sides
from .base import frozen
from .equations import Equations
from .exact_numbers import to_lists
from .mechanics import Mechanics
from .names import check_for_map, variables
from .right_hand_sides import Actions, Names, OfMembers
from .subsystem import subsystem
from .terms import Terms, texts_of, without_zeros
from .traced import EQUATIONS, INDICES, LAYOUT, VALUES, Traced, settled
from .typed_equations import equations_of_text


@public_class
@dataclass(frozen=True, eq=False, repr=False, init=False)
class Field(Traced):
    """The equations ``x' = f(x)``, or with a mass matrix ``M(x) x' = f(x)``; or a family of them.

    :func:`flow` computes solutions of any field. If f is a polynomial of degree 2 or less, the
    field also has Kahan's map, which :func:`iterate` iterates: (x_next - x) / eps is equal to f in
    which (x_j x_next_k + x_next_j x_k) / 2 replaces each product x_j x_k, and
    (x_j + x_next_j) / 2 replaces each x_j.

    f is called with symbols, and stored as a list of operations, from which its exact derivative
    follows. It may contain ``+ - * / **``, NumPy's functions of numbers, ``np.where``, comparisons
    joined by ``& | ~``, ``np.interp`` with a table of numbers, and SciPy's ``expit``, ``erf`` and
    ``erfc``.

    Parameters
    ----------
    f : callable
        Takes the state x, an array of D variables, and parameters by name, and returns the D
        derivatives. A function f(t, x) or f(x, t) of SciPy's form is read, too. Then the time,
        an argument t or time, is no variable: states do not contain it, and :func:`flow` begins at
        ``t0=0``. f is called twice, with equal results.
    names : str, sequence of str or int
        The names of the variables, ``"u v w"``, or their number, for x1, ..., xD.
    mass : callable or array_like(float, shape=(D, D)), optional
        The matrix M of equations ``M(x) x' = f(x)``: numbers, or a function of the state, and of
        parameters by name. The equations are solved for x' as formulas, with pivots that are chosen
        once, so solutions end where a pivot becomes 0. A full matrix that depends on x may have up
        to about 12 rows. If f has an argument `mass`, the value is a parameter of f instead.
    complex : bool or str or sequence of str
        True if all variables are complex, or the names of those that are. A complex variable z is
        stored as two components, z.real and z.imag; states of results are complex. If f has an
        argument `complex`, the value is a parameter of f instead.
    **parameters : float or array_like(float, shape=(...))
        Values of the named parameters of f and of `mass`, which may be complex. Arrays broadcast,
        and make a family: a field for each set of values. A parameter cannot have the name of a
        variable, of time, or of a variable in datasets of results.

    Attributes
    ----------
    dimension, names : int, tuple of str
        The number of variables, D, and their names. ``==`` ignores the names.
    parameters : dict
        Named parameters, which are coordinates of datasets. ``==`` ignores their names.
    mechanics : Mechanics
        Only of a field from :meth:`from_lagrangian`: its methods `momenta`, `residuals`,
        `multipliers`, `reactions` and `projected` take states.
    terms : tuple of ndarray(int, shape=(3, T)) and ndarray(float, shape=(..., T))
        Only of a field of degree 2: i, j, k and v of all terms, sorted. x_i' is the sum of its
        terms v x_j x_k, where j <= k and the index D stands for a factor 1.

    Raises
    ------
    TypeError, ValueError
        If f takes other arguments, returns another number of derivatives, calls a function that
        cannot be used, or asks too often whether a symbol is true, as a loop does; if its two
        results differ;
        or if M is singular.

    See Also
    --------
    Map : A map x -> f(x), of any f.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Field
    >>> pendulum = Field(lambda x: (x[1], -np.sin(x[0])), "q p")
    >>> pendulum
    Field(q' = p, p' = -sin(q))
    >>> pendulum([0.5, 2.0]).round(3)
    array([ 2.   , -0.479])
    >>> def lotka_volterra(x, a):
    ...     return x[0] - x[0] * x[1], a * (x[0] * x[1] - x[1])
    >>> family = Field(lotka_volterra, "u v", a=[0.5, 1, 2])
    >>> family
    <Field, a family of shape (3,): variables u v, a: 3 values from 0.5 to 2>
    >>> family.sel(a=2)
    Field(u' = u - u*v, v' = a*(u*v - v), a = 2.0)

    The inertia of a bead on a parabola q**2 / 2 depends on q:

    >>> Field(
    ...     lambda x: (x[1], -x[0] * (x[1] ** 2 + 1)),
    ...     "q v",
    ...     mass=lambda x: [[1, 0], [0, 1 + x[0] ** 2]],
    ... )
    Field(q' = v, v' = -q*(v**2 + 1)/(1 + q**2))
    """

    _axes: ClassVar[Any] = {INDICES: 2, VALUES: 1}
    _texts: ClassVar[tuple[str, ...]] = (*Traced._texts, "H", "quantities")
    _called: ClassVar[str] = "a field"
    _arrow: ClassVar[str] = "' ="

    def __init__(
        self,
        f: Callable[..., Any],
        /,
        names: int | str | Sequence[str] = "",
        *,
        mass: Any = None,
        complex: Any = False,
        **parameters: Any,
    ) -> None:
        self._take(constructors.of_function(f, names, mass, complex, parameters))

    @classmethod
    @public
    def from_hamiltonian(
        cls,
        H: Callable[..., Any],
        /,
        names: int | str | Sequence[str],
        K: Any = None,
        **parameters: Any,
    ) -> Field:
        """Return the Hamiltonian field ``x' = K grad H(x, **parameters)``.

        If H is a polynomial of degree 3 or less, Kahan's map conserves
        :func:`kahan.modified_energy` exactly, so that the energy does not drift; orders 4 to 8 of
        the map do not conserve it.

        Parameters
        ----------
        H : callable
            Takes the state x, an array of D variables, and parameters by name, and returns the
            energy. It may contain the functions that f of a :class:`Field` may contain.
        names : str, sequence of str or int
            As for a :class:`Field`.
        K : array_like(shape=(D, D)), optional
            A constant antisymmetric matrix, of any rank. By default D is even, and K is the
            canonical matrix of x = (q1, ..., qm, p1, ..., pm): first all coordinates, then all
            momenta.
        **parameters : float or array_like(float, shape=(...))
            As for a :class:`Field`.

        Returns
        -------
        Field
            Its method `energy` evaluates H.

        Raises
        ------
        TypeError, ValueError
            As for a :class:`Field`; also if K is not antisymmetric, or if D is odd without K.

        Examples
        --------
        >>> import numpy as np
        >>> from suslov_fast import Field
        >>> Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - np.cos(x[0]), "q p")
        Field(q' = p, p' = -sin(q), H = p**2/2 - cos(q))
        """
        return cls._of(constructors.of_energy(H, names, K, parameters))

    @classmethod
    @public
    def from_lagrangian(
        cls,
        L: Callable[..., Any],
        /,
        coordinates: int | str | Sequence[str],
        velocities: str | Sequence[str] = "",
        *,
        constraints: Callable[..., Any] | None = None,
        forces: Callable[..., Any] | None = None,
        frame: Callable[..., Any] | None = None,
        algebra: Any = None,
        **parameters: Any,
    ) -> Field:
        """Return the equations of motion of a mechanical system, with constraints or without.

        They are the equations of Lagrange and d'Alembert, d/dt L_v - L_q = Q + A^T lambda, where
        the multipliers lambda hold the constraints, and A has their derivatives with respect to v.
        The state has all coordinates q, then all velocities v. If a function takes time t, states
        do not contain it: `t0` of :func:`flow` is the time at x0.

        Parameters
        ----------
        L : callable
            Takes q and v, arrays of n symbols, then t if it depends on time, and parameters by
            name; returns kinetic minus potential energy.
        coordinates, velocities : str or sequence of str
            Names of the n coordinates, and of the velocities; by default "vx vy" for "x y".
        constraints : callable, optional
            Takes the arguments of L, and returns k expressions that are 0 along the motion. One
            without v is holonomic. The others are usually linear in v; if not, reactions follow
            Chetaev's rule. Initial states must satisfy all of them, also the derivatives of
            holonomic ones: `mechanics.projected` moves a state there. Each step of a motion keeps
            all constraints to rounding.
        forces : callable, optional
            The n generalised forces Q.
        frame : callable, optional
            Takes the arguments of L, and returns q', linear in m velocities u with the names
            `velocities`: a moving frame. Then all functions take (q, u) in place of (q, v).
        algebra : str or array_like(shape=(m, m, m)), optional
            "so3", "se3", or structure constants c of the frame, [e_i, e_j] = sum_k c_ijk e_k, for
            the equations of Hamel, or of Euler and Poincare. For "so3" and "se3", u are angular
            velocities, then velocities, in the axes of the body; a vector q fixed in space has the
            rate q x Omega.
        **parameters : float or array_like(float, shape=(...))
            As for a :class:`Field`; each function takes those that it names.

        Returns
        -------
        Field
            Its method `energy` takes states, as do `momenta`, `residuals`, `multipliers`,
            `reactions` and `projected` of its attribute `mechanics`.

        Raises
        ------
        TypeError, ValueError
            As for a :class:`Field`; also if constraints depend on one another.

        Examples
        --------
        A knife edge on an inclined plane slides sideways, and does not descend:

        >>> import numpy as np
        >>> from suslov_fast import Field, flow
        >>> edge = Field.from_lagrangian(
        ...     lambda q, v: (v @ v) / 2 - q[0],
        ...     "x y angle",
        ...     constraints=lambda q, v: v[0] * np.sin(q[2]) - v[1] * np.cos(q[2]),
        ... )
        >>> motion = flow(edge, [0, 0, 0, 0, 0, 1], time=np.pi)  # omega = 1: x = -sin(t)**2 / 2
        >>> motion.states[0, :2].round(9) + 0.0
        array([ 0.        , -1.57079633])
        """
        functions = {"L": L, "constraints": constraints, "forces": forces, "frame": frame}
        names = coordinates, velocities
        return cls._of(constructors.of_mechanics(functions, *names, algebra, parameters))

    @classmethod
    @public
    def from_equations(cls, text: str, /, **parameters: Any) -> Field:
        """Return the field of equations that are written as a text.

        Parameters
        ----------
        text : str
            An equation ``x' = formula`` for each variable, in the order of the state. Lines or
            semicolons separate equations. Formulas are written as in Python, with NumPy's
            functions by their names. ``a = 2`` gives the value of a parameter.
        **parameters : float or array_like(float, shape=(...))
            Values of parameters that the text gives no value; arrays make a family.

        Returns
        -------
        Field

        Raises
        ------
        ValueError
            If the text cannot be read, or uses a name that has no equation and no value.

        Examples
        --------
        >>> from suslov_fast import Field
        >>> Field.from_equations("x' = v; v' = -w**2*sin(x) - v/8", w=2.0)
        Field(x' = v, v' = -w**2*sin(x) - v/8, w = 2.0)
        """
        return cls._read(**equations_of_text(text, parameters))

    @classmethod
    @public
    def from_terms(
        cls,
        quadratic: Any,
        linear: Any = None,
        constant: Any = None,
        names: str | Sequence[str] | None = None,
    ) -> Field:
        """Return the field ``dx_i/dt = sum_jk q_ijk x_j x_k + sum_j l_ij x_j + c_i``.

        Parameters
        ----------
        quadratic : array_like(shape=(..., D, D, D))
            q; only its part that is symmetric in j and k matters. Each coefficient must be 0, or
            have a modulus from 1e-60 to 1e60.
        linear : array_like(shape=(..., D, D)), optional
            l, by default 0.
        constant : array_like(shape=(..., D)), optional
            c, by default 0.
        names : str or sequence of str, optional
            Names of the D variables, by default x1, ..., xD.

        Returns
        -------
        Field
            A single field, or a family if the arrays have more axes.

        Raises
        ------
        TypeError, ValueError
            If shapes do not match, or a coefficient is not a number in this range.

        Examples
        --------
        >>> from suslov_fast import Field
        >>> Field.from_terms([[[0, 1], [0, 0]], [[-1, 0], [0, 0]]], constant=[0, 0.5])
        Field(x1' = x1*x2, x2' = -x1**2 + 1/2)
        """
        terms, D = coefficients.of_arrays(quadratic, linear, constant)
        return cls._of_terms(terms, variables(names, D))

    @classmethod
    def _of_terms(cls, terms: Terms, names: Sequence[str]) -> Field:
        """Return the field of terms that were checked before."""
        return cls._of(constructors.of_terms(terms, names))

    _read = classmethod(constructors.of_entries)

    # ------------------------------------------------------------------------------ parts
    def _take(self, parts: Mapping[str, Any]) -> None:
        if parts.get(EQUATIONS) is None:
            indices, values = without_zeros(parts[INDICES], np.asarray(parts[VALUES]))
            parts = {LAYOUT: parts[LAYOUT], INDICES: indices, VALUES: values}
        super()._take(parts)

    @property
    def _field(self) -> Field:
        return self

    # ------------------------------------------------------------------------------ values
    @property
    def _program(self) -> Equations:
        if self._equations:
            return super()._program
        return right_hand_sides.equations_of(self._parts[INDICES].tobytes(), self.dimension)

    @cached_property
    def _with_table(self) -> tuple[Any, FloatArray]:
        full = None
        if not self._equations:
            full = right_hand_sides.full_quadratic(self._own_terms.floats, self.dimension)
        return full or super()._with_table

    @public
    def energy(self, x: Any, *, t: Any = None) -> FloatArray:
        """Return the energy of a field from :meth:`from_hamiltonian` or :meth:`from_lagrangian`.

        It is H(x), or v L_v - L, Jacobi's integral if L does not depend on time.

        Parameters
        ----------
        x : array_like(float, shape=(..., D))
            States, which broadcast with the batch of the field.
        t : array_like(float, shape=(...)), optional
            The time, by default 0, if L depends on it.

        Returns
        -------
        ndarray(float, shape=(...))

        Raises
        ------
        TypeError
            If the field has no Hamiltonian.

        Examples
        --------
        >>> from suslov_fast import Field
        >>> well = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, 2)
        >>> float(well.energy([2.0, 1.0]))
        6.5
        """
        equations: Any = self._equations
        if "energy" in self._quantities:
            return Mechanics(self).at("energy", self._layout.enter("x", x, t, "t"))[..., 0]
        if not self._is_hamiltonian:
            raise TypeError(
                "system: this field has no Hamiltonian: make it by Field.from_hamiltonian, or for "
                "that of another field call another.energy(run.states)"
            )
        x = self._layout.enter("x", x, t, "t")
        shape = np.broadcast_shapes(x.shape[:-1], self._inputs.shape[1:])
        energies = equations.energy(np.moveaxis(x, -1, 0), self._inputs)
        return np.broadcast_to(energies, shape) + 0.0 * x.sum(axis=-1)  # NaN for states with NaN

    @public
    def subsystem(self, names: str | Sequence[str], **held: float) -> Field:
        """Return the equations of some variables, whose rates do not depend on the others.

        Parameters
        ----------
        names : str or sequence of str
            Names of the variables to keep. Their rates must not depend on the others, for all
            values of the parameters: their formulas do not read them, or these cancel exactly.
        **held : float
            Values of other variables, such as that of a velocity that a constraint keeps at 0.

        Returns
        -------
        Field
            Integrals, and the energy, that depend on these variables alone stay.

        Raises
        ------
        TypeError, ValueError
            If a rate depends on other variables, or there is no variable of a name.

        Examples
        --------
        >>> from suslov_fast import Field
        >>> Field(lambda x: (-x[0], x[0] * x[1]), "x y").subsystem("x")
        Field(x' = -x)
        """
        field = self._with_formulas
        layout, equations = subsystem(field, variables(names), held)
        return type(self)._of({**field.parameters, **settled(layout, equations)})

    @property
    def mechanics(self) -> Mechanics:
        """Momenta, multipliers, reactions, residuals of a field from :meth:`from_lagrangian`."""
        return Mechanics.of(self)

    @public
    def conserving(self, *integrals: Callable[..., Any]) -> Field:
        """Return the field with first integrals that each step of a motion keeps to rounding.

        Parameters
        ----------
        *integrals : callable
            Functions of the state, and of parameters by name, that are constant along each motion;
            each returns one value or several. If f takes the time, they may, too. By default the
            energy. Integrals that the field keeps already stay.

        Returns
        -------
        Field

        Raises
        ------
        TypeError, ValueError
            If the field is not one of formulas, or a function is not constant along motions. That
            is proved where formulas allow it; else it is tested at random states, for all members
            and for new values in :meth:`with_parameters`.

        Warns
        -----
        IntegrationWarning
            In :func:`flow` and the like, if a function changes along f at the start of a step, as
            with a force that acts later, or if a step cannot be moved to the integrals. The status
            of these motions is NOT_KEPT.

        Examples
        --------
        >>> import numpy as np
        >>> from suslov_fast import Field, flow
        >>> field = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - np.cos(x[0]), "q p")
        >>> energy = flow(field.conserving(), [2.0, 0.0], time=[1e2, 1e4]).energy()
        >>> bool(abs(energy + np.cos(2.0)).max() < 1e-15)
        True
        """
        field = self._with_formulas
        layout, equations = invariants.conserving(field, integrals)
        field = type(self)._of({**field.parameters, **settled(layout, equations)})
        invariants.check(field)
        return field

    def _check_kept(self) -> None:
        if "conserved" in self._quantities:
            invariants.check(self)

    @property
    def _is_hamiltonian(self) -> bool:
        return self._equations is not None and self._equations.H is not None

    # ------------------------------------------------------------------------------ motion
    @property
    def _autonomous(self) -> Field:
        """The field without integrals that read the hidden time; TypeError if f reads it."""
        if self._layout.clock is None:
            return self
        equations = self._equations.with_timeless_integrals
        if equations.read_last:
            how = "one that does: periodic_orbit follows a force; for others make t a variable, "
            how += "Field(lambda s: (*f(s[-1], s[:-1]), 1.0), names)"
            raise wrong("system", "one whose f does not read the time", how, TypeError)
        return Field._of({**self._parts, **settled(self._layout, equations)})

    @cached_property
    def _timed(self) -> Field:
        """The field with a hidden time, for functions that read it, unless it is a variable."""
        layout = self._layout.timed
        if layout is self._layout or layout.time_variable:
            return self
        field = self._with_formulas
        equations = field._equations.with_time(layout.components[-1])
        return Field._of({**field._parts, LAYOUT: layout, EQUATIONS: equations})

    @cached_property
    def _with_formulas(self) -> Field:
        """The field as formulas; of a family of terms, coefficients c0, c1, ... are parameters."""
        if self._equations is not None:
            return self
        return Field._of(constructors.with_formulas(self._own_terms, self._layout))

    def _motion_lists(self, wrt: Names = None, actions: Actions = ()) -> list[OfMembers]:
        """Return the right-hand sides of all members, see `right_hand_sides.of_equations`."""
        if self._equations is None:
            return right_hand_sides.of_terms(self._own_terms, self.dimension, wrt, actions)
        return right_hand_sides.of_equations(self._equations, self._inputs, wrt, actions)

    @cached_property
    def _right_hand_sides(self) -> list[OfMembers]:
        return self._motion_lists()

    @cached_property
    def _listed_right_hand_sides(self) -> list[OfMembers]:
        """The right-hand sides for derivatives of motions, as lists of operations."""
        return self._motion_lists(wrt=())

    @cached_property
    def _clocks(self) -> tuple[int, ...]:
        return tuple(self._right_hand_sides[0].f.clocks)

    @cached_property
    def _tables_of_time(self) -> list[tuple[int, float, float]]:
        """The variable, and the first and last knot, of each table over a clock."""
        clocks = self._clocks
        if self._equations is None or not clocks:
            return []
        operations = self._equations.values.operations
        tables = [(args[0], kind.rows[0, 1:]) for kind, _, args in operations if is_table(kind)]
        found = [(k, knots[0], knots[-1]) for k, knots in tables if k in clocks and len(knots)]
        self._common["_tables_of_time"] = found
        return found

    # ------------------------------------------------------------------------------ degree 2
    @property
    def _own_terms(self) -> Terms:
        return Terms(self._parts[INDICES], self._parts[VALUES])

    def _terms_of(self, of_energy: bool = False, exactly: Any = None) -> Terms:
        """Return terms of f, or of H, as `coefficients.of_equations`; TypeError if it has none."""
        equations, values = self._equations, [*self.parameters.values()]
        if equations is None:
            return self._own_terms if exactly is None else self._own_terms.read(exactly)
        results, degree = ([equations.H], 3) if of_energy else (equations.results, 2)
        try:
            return coefficients.of_equations(equations, results, degree, values, exactly)
        except coefficients.NotQuadratic as error:
            what = "H is not of degree 3" if of_energy else "f is not of degree 2"
            raise TypeError(
                f"system: {what} ({error}), so it has no Kahan map: its motion is "
                "flow(field, x0, time=T); to iterate f itself make Map(f, names)"
            ) from None

    @cached_property
    def _terms(self) -> Terms:
        """The terms of f for kernels of maps; TypeError if f is not of degree 2."""
        terms = self._terms_of().floats
        check_for_map(self._layout.components, self._coordinates)
        return terms

    @cached_property
    def _may_escape(self) -> bool:
        """False for linear equations, with solutions that exist at all times."""
        try:
            return bool((self._terms.indices[2] < self._layout.D).any())
        except (TypeError, ValueError):
            return True

    @cached_property
    def _energy_terms(self) -> Terms:
        """The terms of H for kernels of maps."""
        return self._terms_of(of_energy=True).floats

    @cached_property
    def terms(self) -> tuple[Any, FloatArray]:
        """The terms that are not 0: their indices i, j, k (3, T), and their values (..., T)."""
        indices, values = self._terms
        order = np.lexsort(indices[::-1])
        return frozen(indices[:, order]), frozen(values[..., order])

    # ------------------------------------------------------------------------------ texts
    @property
    def _formulas(self) -> Iterator[str]:
        return super()._formulas if self._equations else texts_of(self._own_terms, self.names)

    @property
    def _numbers(self) -> list[tuple[str, Any]]:
        """The Hamiltonian and the parameters of a single field, by name."""
        H = [("H", self._equations.shown(self._equations.H))] if self._is_hamiltonian else []
        return [*H, *super()._numbers]

    def _described(self) -> dict[str, Any]:
        if self._equations is None:
            return to_lists({"indices": self._parts[INDICES], "values": self._parts[VALUES]})
        described, entries = super()._described(), self._equations.K
        if entries is None:
            return described
        i, j, values = np.array(entries, object).reshape(-1, 3).T.tolist()
        K = {"indices": [i, j], "values": to_lists(values)}
        [H] = described.pop("equations")
        return described | {"H": H, "K": K}
