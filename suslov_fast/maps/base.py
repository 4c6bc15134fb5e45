"""The record of a map, with all that depends on it, and the map of a body and a method."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies.base import Body
from ..bodies.field import QuadraticField
from ..checks import FloatArray
from ..engine.arguments import WHOLE
from ..engine.derivatives import Growth, growth, growth_by_jacobian
from ..engine.problem import Problem, check
from ..engine.stretches import Report, Steps, check_steps
from ..engine.trial import check_parameters
from .formulas import INSTEAD, KAHAN, PARTS, SERVED, Formula, Plane, check_formulas, rates
from .methods import with_notes

# Those of the package, and of maps that `maps.register` made known.
Method = Literal["auto", "gauss", "rank2", "order4", "order6", "order8"] | str


Rates = Callable[[Problem, FloatArray], NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Map:
    """A map: a discretization of the equations of motion of one class of bodies or fields.

    Runs, files, stores, plots and functions of a state ask this record for all that depends on the
    map; what it lacks raises an error. `register` makes a record known. Several records may have
    the same class: the argument `method` of runs and functions decides between them.

    Attributes
    ----------
    name : str
        The unique name that files contain.
    title : str
        The name that plots and datasets show.
    body : type
        The class of the bodies, derived from `Body`. Subclasses without a record use this one,
        unless they define equations of their own (`field` or `constants`).
    methods : mapping of str to Steps
        Ways to compute the steps, by the values of the argument `method`, the default first.
        `Steps(kernel, arguments, carried, cost, lanes, system)` is described below.
    formulas : mapping of str to Formula
        What public functions need from this map, by their names (see `maps/formulas.py`):
        ``{**KAHAN}`` for Kahan's map of the field of any body, ``{}`` for a map of which only the
        steps are known. In `Formula(compute, check, poles)`, `compute` takes a `Problem` and
        returns the values (...), `check` raises an error for a body that lacks the quantity, and
        `poles` is True where infinite values are meant. With ``"jacobian"``, `lyapunov_exponents`
        and `multipliers` follow.
    random : tuple of callables
        Functions ``random(rng, shape)`` that return a batch of bodies for tests.
    pole : tuple or None
        A body, and a state that has no next one for eps = 1; None if every state has one.
    conserved : tuple of str
        Names of formulas; the first that a body has is conserved, exactly or nearly.
    fractions : tuple of float
        A step is made of steps of Kahan's map by these fractions of eps, one after the other:
        (1.0,) for Kahan's map itself, and for all other discretizations.
    attitude : {"axial", "in_rows"} or None
        How states turn a body: they are Omega1 and Omega2, or (Omega_1n, ..., Omega_n-1,n).
    plane : Plane or None
        How `exact`, `flow` and `limits` reduce a problem to one in three dimensions.
    growth : callable or None
        ``growth(problem, steps, transient, report)`` returns the sums for `lyapunov_exponents`, see
        `engine.derivatives`. None: that of Kahan's map, if ``"jacobian"`` is that of `KAHAN`, or
        else products of ``"jacobian"``.
    rates : callable or None
        ``rates(problem, slopes)`` returns the eigenvalues (..., D) of f' (..., D, D) at steady
        states, from which the `multipliers` of Kahan's map follow. None: those of a field, if
        ``"jacobian"`` is that of `KAHAN`, or else `multipliers` are the eigenvalues of
        ``"jacobian"``.
    serves : tuple of str
        Further public functions for bodies with these states, of those that need no formula:
        "plot_phase", "animate_body", "explore", "frame" of `compiled`, "scattering_angle".
    variable : {"omega", "x"}
        The name of states in runs and datasets.
    meaning : str
        What a state is, for datasets: "angular velocity" or "state".

    Notes
    -----
    **Authors of a step** write the step of one state, decorated with `core.numba.function`:

        step(x, out, eps, work, *row) -> Status as an int

    and ``Steps(steps_of(step), arguments)`` keeps items 2 to 7 below. The step writes the state
    that follows x (D,) to `out` (D,). `row` are the arrays that `arguments` makes, without eps,
    which comes last there: an array of float64 gives the row of this trajectory (a number, if the
    array has one axis), others are whole. Only `out` and `work` are written; `work` is the array of
    a thread, of ``steps_of(step, work=n)`` numbers, of which nothing is left from one step to the
    next. A negative status ends the trajectory (`core.codes`: SINGULAR where there is no next
    state), and so does a state that is not finite; the first positive one is kept, with its n.

    **Authors of a kernel**, which may step several lanes at once, write it whole, decorated with
    `core.numba.kernel`:

        steps(part, parts, arguments, omega0, carry, span, saved, final, status, failed_at)

    `core/one_step.py` has a short one. A kernel neither validates nor raises, and allocates nothing
    inside loops over steps; formulas that it calls are `core.numba.formula` or `function`.

    1. `arguments` is what `Steps.arguments(body, eps, batch)` returned, called once for a run: a
       tuple of arrays, which a kernel only reads. Each has one row if it is common to all B
       trajectories, else B rows: ``array[i % len(array)]`` is that of trajectory i. A negative eps
       steps back. `by_constants` passes ``body.constants`` and eps (1 or B,): I1, I2, I13, I23, k,
       eps in three dimensions, J, I, eps in n. `by_field` passes the terms v x_j x_k of the field,
       with x_D = 1: indices (3, T), the i, j and k, values (1 or B, T), and eps.
    2. `span` is (begin, end, start, stop, every, row). The call takes the trajectories
       begin <= i < end from state `start` to `stop`; ``share`` returns those of part number `part`
       of `parts`, which a thread computes.
    3. State 0 is `omega0` (B, D), read only if start = 0. It counts as a saved state and, if it is
       NaN, as a failure at step 0: status NONFINITE. Calls with start = stop = 0 do nothing else.
    4. A run is cut into calls anywhere, in time and in the batch, and all cuts give the same bits.
       A step is the same at every n. Steps continue from `final` (B, D) and from `carry`
       (carried, B), whose contents the kernel chooses: both are read if start > 0, and written at
       `stop`.
    5. If every > 0, state n is saved if start < n <= stop, or n = start = 0, and n is a multiple of
       `every`: the first to saved[row], the next to saved[row + 1]; `saved` is (rows, B, D).
    6. `final` receives the states at `stop`, saved or not.
    7. A trajectory that fails at state n gets status[i] < 0 (SINGULAR, or NONFINITE beyond
       float64), failed_at[i] = n, and NaN from there on, in `saved` and `final`, in later calls,
       too. Bits of others depend neither on it nor on the batch, its order, or `parts`. With
       `Steps.notes_poles`, the first step from det A < 0 sets PASSED_POLE, and failed_at[i] and
       carry[0, i], which is 0 before, to n of the state after it; a failure leaves carry[0, i].

    **Both** give `Steps` its other parts:

    8. `Steps.cost(D, arguments)` is the time of a step relative to that of the three-dimensional
       map (about 1 ns on one thread), 1 by default. It decides how many steps a call takes, so that
       Ctrl-C is handled within about 0.1 s: a kernel that takes 200 ns a step needs
       ``cost=lambda D, arguments: 200.0``.
    9. A thread takes `Steps.lanes` trajectories at a time, a multiple of 8.
    10. `Steps.system(body, eps)` returns what `compiled.step_system` takes: `field_system`, if the
        steps are those of Kahan's map of the field of the body. Without it `compiled.system`
        refuses the body; loops of your own call your step.

    Before its first run `engine.trial` tries a kernel of others on a few trajectories, and refuses
    one that breaks items 1 to 7. It does not see formulas: ``pytest tests/test_promises.py --maps
    MODULE`` compares steps with "vector_field" for small eps, and "jacobian" with differences.
    """

    name: str
    title: str
    body: type[Any]
    methods: Mapping[str, Steps]
    formulas: Mapping[str, Formula]
    random: tuple[Callable[[np.random.Generator, tuple[int, ...]], Any], ...]
    pole: tuple[Any, tuple[float, ...]] | None
    conserved: tuple[str, ...] = ()
    fractions: tuple[float, ...] = WHOLE
    attitude: Literal["axial", "in_rows"] | None = None
    plane: Plane | None = None
    growth: Callable[[Problem, int, int, Report | None], Growth] | None = None
    rates: Rates | None = None
    serves: tuple[str, ...] = ()
    variable: str = "omega"
    meaning: str = "angular velocity"

    def __post_init__(self) -> None:
        vars(self)["methods"] = with_notes(self.methods)

    @property
    def has_jacobian_of_kahan(self) -> bool:
        """Whether "jacobian" is that of the field of any body; then so are `growth` and `rates`."""
        return self.formulas.get("jacobian") is KAHAN["jacobian"]

    def find_growth(
        self, problem: Problem, steps: int, transient: int, report: Report | None
    ) -> Growth:
        """Return the sums for `lyapunov_exponents`, by `growth` or what is in its place."""
        default = growth if self.has_jacobian_of_kahan else growth_by_jacobian
        return (self.growth or default)(problem, steps, transient, report)

    @property
    def known_rates(self) -> Rates | None:
        """`rates`, or those of Kahan's map in their place; None if neither is known."""
        return self.rates or (rates if self.has_jacobian_of_kahan else None)

    def has(self, name: str) -> bool:
        """Return whether there is what a public function needs, at least for some bodies."""
        if name in PARTS:
            return PARTS[name] in self.formulas or getattr(self, PARTS[name], None) is not None
        return name in self.formulas or name in self.serves

    def functions(self, body: Any) -> list[str]:
        """Return the names of the public functions of states that there are for a body."""
        names = filter(self.has, [*self.formulas, *self.serves, *PARTS])
        return [name for name in names if self._has_for(name, body)]

    def _has_for(self, name: str, body: Any) -> bool:
        try:
            self.require(name, body)
        except (TypeError, ValueError):
            return False
        return True

    def require(self, name: str, body: Any) -> None:
        """Raise an error if there is not what a public function needs for this body."""
        if not self.has(name):
            if self is not map_of(body):
                received = f"{', '.join(map(repr, self.methods))}: {self.title} has no {name}"
                if name == "modified_energy" and "energy" in self.functions(body):
                    received += ": use energy, which varies along orbits"
                raise checks.wrong("method", "'auto'", received, TypeError)
            having = dict.fromkeys(each.body for each in MAPS.values() if each.has(name))
            received, names = checks.kind_of(body), [kind.__name__ for kind in having]
            if isinstance(body, tuple(having)):
                received += f", whose map ({self.title}) has no {name}"
            else:
                received += getattr(body, "_instead", "") or INSTEAD.get(name, "")
            raise checks.wrong("body", " or ".join(names) or "another one", received, TypeError)
        if name in self.formulas and (check := self.formulas[name].check):
            check(body)
        if PARTS.get(name) == "plane" and self.plane and self.plane.check:
            self.plane.check(body, name)

    def formula(self, name: str, body: Any) -> Formula:
        """Return the formula of a public function; an error if there is none for this body."""
        self.require(name, body)
        return self.formulas[name]

    def conserves(self, body: Any) -> str | None:
        """Return the name of a conserved, or nearly conserved, quantity; None without one."""
        known = self.functions(body)
        return next((name for name in self.conserved if name in known), None)

    def __reduce__(self) -> Any:
        return named, (self.name,)


# ------------------------------------------------------------------------------------------ records
MAPS: dict[str, Map] = {}  # by name


def register(record: Map) -> None:
    """Make a map known, for runs, files and functions of a state.

    The first record of a class has the method "auto", the default of runs; further records of the
    same class have methods of other names.

    Raises
    ------
    TypeError, ValueError
        If the name or a method is taken, a part of the record has another type than `Map` says, no
        function asks for a formula of a name, or a parameter of a body is a vector and `_axes` does
        not say so.
    """
    checks.instance("record", record, Map)
    checks.instance("name", record.name, str)
    if record.name in MAPS or not record.name:
        raise checks.wrong("name", "new, and not empty", repr(record.name))
    if not (isinstance(record.body, type) and issubclass(record.body, Body)):
        raise checks.wrong("body", "a class derived from Body", repr(record.body), TypeError)
    checks.one_of("variable", record.variable, ["omega", "x"])
    if record.attitude is not None:
        checks.one_of("attitude", record.attitude, ["axial", "in_rows"])
    if record.plane is not None:
        checks.instance("plane", record.plane, Plane)
    for name, part in (("growth", record.growth), ("rates", record.rates)):
        if part is not None and not callable(part):
            raise checks.wrong(name, "a function, or None", repr(part), TypeError)
    if not {*record.serves} <= {*SERVED}:
        raise checks.wrong("serves", f"some of {SERVED}", repr(record.serves))
    taken = [name for other in MAPS.values() if other.body is record.body for name in other.methods]
    if not record.methods or (clashing := {*record.methods} & {*taken}):
        received = ", ".join(sorted(clashing)) if record.methods else "none"
        raise checks.wrong("methods", f"none of {', '.join(taken)}", received)
    if "auto" not in {*record.methods, *_methods_of(record.body)}:
        why = f"because {record.body.__name__} has no other map"
        raise ValueError(f"methods: name one of {', '.join(record.methods)} auto, {why}")
    for method, steps in record.methods.items():
        check_steps(f"methods[{method!r}]", steps)
    check_formulas(record.formulas, record.conserved)
    if not isinstance(record.random, tuple) or not all(map(callable, record.random)):
        raise checks.wrong("random", "a tuple of functions", repr(record.random), TypeError)
    if record.pole is not None and not isinstance(record.pole[0], record.body):
        expected = f"a {record.body.__name__} and a state, or None"
        raise checks.wrong("pole", expected, repr(record.pole), TypeError)
    check_parameters(record.body, record.random)
    MAPS[record.name] = record


# ------------------------------------------------------------------------------------------- lookup
def map_of(body: Any, method: str = "auto") -> Map:
    """Return the map of a method for a body.

    Records of a class come before those of the classes that it derives from, which hold as far as
    the class has their equations.
    """
    by_method = _methods_of(type(body))
    if type(method) is str and method in by_method:
        return by_method[method]
    if not by_method:
        kinds = [record.body.__name__ for record in MAPS.values()]
        received = checks.kind_of(body) + checks.in_place_of(body)
        if isinstance(body, Body):
            received += ", a class without a record of its own: see maps.register"
        raise checks.wrong("body", " or ".join(dict.fromkeys(kinds)), received, TypeError)
    of_fields = ", ".join(repr(name) for name in _methods_of(QuadraticField) if name != "auto")
    instead = f": QuadraticField.of(body) has the methods {of_fields}"
    instead *= str(method).startswith("order") and "order4" not in by_method
    return by_method[checks.one_of("method", method, by_method, instead)]


def _methods_of(kind: Any) -> dict[str, Map]:
    return _by_method(kind, tuple(MAPS.values()))


_EQUATIONS = {"field", "_field", "terms", "constants"}  # of a class that has its own


@lru_cache(maxsize=64)  # for small calls
def _by_method(kind: type[Any], records: tuple[Map, ...]) -> dict[str, Map]:
    """Return the maps of a class of bodies by the names of their methods."""
    found: dict[str, Map] = {}
    for each in kind.__mro__:
        for record in records:
            if record.body is each:
                for method in record.methods:
                    found.setdefault(method, record)
        if not _EQUATIONS.isdisjoint(vars(each)):
            break  # maps of the classes before have other equations
    return found


def named(name: str) -> Map:
    """Return the map with this name, which files and pickles contain."""
    if name not in MAPS:
        how = "import the module that registers it"
        raise ValueError(f"there is no map {name!r}, only {', '.join(MAPS)}: {how}")
    return MAPS[name]


def problem(
    function: str,
    body: Any,
    omega: Any,
    eps: Any = 0.0,
    threads: int | None = None,
    method: str = "auto",
    **options: Any,
) -> Problem:
    """Check the arguments of a public function, and that the map has what it needs.

    Options are those of `engine.problem.check`.
    """
    map = map_of(body, method)
    map.require(function, body)
    return check(map, body, omega, eps, threads, method=method, **options)
