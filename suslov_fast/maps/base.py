"""Records of maps: the class `Map`, the registry, and the map for a body and a method."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

from numpy.typing import NDArray

from .. import checks
from ..bodies.base import Body
from ..bodies.fields.field import QuadraticField
from ..bodies.fields.general import NO_MAP, Field
from ..checks import FloatArray
from ..core.fields.stages import WHOLE, Stages
from ..engine.derivatives import Growth, growth, growth_by_jacobian
from ..engine.problem import Problem, check
from ..engine.stretches import Report, Steps, check_steps
from ..keywords import public, public_class
from .formulas import INSTEAD, KAHAN, PARTS, SERVED, Formula, Plane, check_formulas, eigenvalues
from .methods import with_notes

# The methods of the package; `str` stands for those that `maps.register` adds.
Method = Literal["auto", "gauss", "rank2", "order4", "order6", "order8"]


Eigenvalues = Callable[[Problem, FloatArray], NDArray[Any]]  # returns eigenvalues of f'


@public_class
@dataclass(frozen=True, eq=False)
class Map:
    """A map: one discretization of the equations of motion of a class of bodies or fields.

    Runs, files, stores, plots and functions of a state get everything that depends on the map from
    this record; a function that the record does not support raises an error. :func:`register` makes
    a record available. Several records may be for the same class: the argument `method` of runs and
    functions chooses one of them. :func:`register` has an example.

    Attributes
    ----------
    name : str
        The unique name, which files contain.
    title : str
        The name in plots and datasets.
    body : type
        The class of the bodies, derived from `Body`. Subclasses use this record unless they have
        one, or define equations of their own (`field` or `constants`).
    methods : mapping of str to Steps
        Ways to compute the steps, by the values of the argument `method`, the default first: those
        of the package (`maps.FIELD`), or `Steps(steps_of(step), arguments)`, see below.
    formulas : mapping of str to Formula
        How to compute the public functions of a state that the map supports, by their names (see
        `maps/formulas.py`): ``{**KAHAN}`` for Kahan's map of the field of any body, ``{}`` if only
        the steps are known. In `Formula(compute, check, poles)`, `compute` takes a `Problem` and
        returns the values (...), of the shape `problem.batch` to which its `body`, `omega` and
        `eps` broadcast; `check` raises an error for a body without the quantity, and `poles` is
        True if infinite values are results. ``"jacobian"`` is enough for `lyapunov_exponents` and
        `multipliers`.
    conserved : tuple of str
        Names of formulas: the first one that a body has is conserved, exactly or nearly.
    stages : Stages
        Stages of a composition: a step consists of Kahan steps by these fractions of eps. WHOLE for
        Kahan's map itself, and for maps that are not made of it.
    order : int
        The order of the method: the error of a step is O(eps**(order + 1)).
    attitude : {"axial", "in_rows"} or None
        How states rotate a body: they are Omega1 and Omega2, or (Omega_1n, ..., Omega_n-1,n). None
        if they do not.
    plane : Plane or None
        How `exact`, `flow` and `limits` reduce a problem to a solved one in three dimensions.
    growth : callable or None
        ``growth(problem, steps, transient, report)`` returns the `Growth` of `engine.derivatives`,
        for `lyapunov_exponents`. By default that of Kahan's map if ``"jacobian"`` is that of
        `KAHAN`, else that of products of ``"jacobian"``.
    eigenvalues : callable or None
        ``eigenvalues(problem, slopes)`` returns those of f', the `slopes` (..., D, D), at steady
        states, as an array (..., D) from which the `multipliers` of Kahan's map follow. By default
        those of a field if ``"jacobian"`` is that of `KAHAN`; else `multipliers` are the
        eigenvalues of ``"jacobian"``.
    serves : tuple of str
        Public functions that the map supports without a formula, among "plot_phase",
        "animate_body", "explore", "frame" of `compiled`, and "scattering_angle".
    variable : {"omega", "x"}
        The name of the state variable in runs and datasets.
    meaning : str
        What a state is, for datasets: "angular velocity" or "state".

    Notes
    -----
    A method is a function that steps one state, compiled by `core.compiling.numba.function` or
    `numba.njit`:

        step(x, out, eps, work, *row) -> Status as an int

    ``Steps(steps_of(step), arguments)`` makes runs of it, which can be cut anywhere, in time and in
    the batch. The step writes the state after x (D,) to `out` (D,) and returns a status: 0, or a
    negative one, which ends the trajectory (SINGULAR of `core.compiling.codes` if there is no next
    state). A state that is not finite ends it, too; an exception, such as that of
    ``np.linalg.solve`` for a singular matrix, ends the whole run. The first positive status is
    kept, with its n. The step writes to `out` and `work` alone; `work` is scratch memory of n
    numbers, with ``steps_of(step, work=n)``, whose contents do not survive the step. The next step
    of a state must depend on nothing else: not on n, and not on steps before.

    `Steps.arguments(body, eps, batch)` returns a tuple of arrays, once for a run: of float64, with
    one row if all B trajectories share it, else B rows, the last of them eps (1 or B,); a negative
    eps steps back. `row` holds all but eps: of a float64 array the row of this trajectory (a number
    if the array has one axis), and other arrays whole. `by_constants` returns ``body.constants``
    and eps: I1, I2, I13, I23, k, eps in three dimensions, J, I, eps in n. `by_field` returns the
    terms v x_j x_k of the field, with x_D = 1: indices (3, T), which are i, j and k, values
    (1 or B, T), and eps.

    Other parts of `Steps` have defaults:

    - `cost(D, arguments)` is the time of a step relative to that of the three-dimensional map
      (about 1 ns on one thread), 1 by default. It decides how many steps are taken at a time, so
      that Ctrl-C is handled within about 0.1 s: a step of 200 ns needs
      ``cost=lambda D, arguments: 200.0``.
    - `lanes` is the number of trajectories that a thread takes at a time, a multiple of 8.
    - `system(body, eps)` returns the argument of `compiled.step_system`: `field_system` if the
      steps are those of Kahan's map of the field of the body. Without it `compiled.system` refuses
      the body, and compiled loops of users call the step itself.

    Before its first run, `engine.trial` tries a step from one state, and refuses one that
    reads or writes beyond its arrays, changes what it is given, or remembers another step.
    ``pytest tests/package/test_promises.py --maps MODULE`` measures the order, and compares
    "jacobian" with differences.
    """

    name: str
    title: str
    body: type[Any]
    methods: Mapping[str, Steps]
    formulas: Mapping[str, Formula]
    conserved: tuple[str, ...] = ()
    stages: Stages = WHOLE
    order: int = 2
    attitude: Literal["axial", "in_rows"] | None = None
    plane: Plane | None = None
    growth: Callable[[Problem, int, int, Report | None], Growth] | None = None
    eigenvalues: Eigenvalues | None = None
    serves: tuple[str, ...] = ()
    variable: str = "omega"
    meaning: str = "angular velocity"

    def __post_init__(self) -> None:
        vars(self)["methods"] = with_notes(self.methods)

    @property
    def has_jacobian_of_kahan(self) -> bool:
        """True if "jacobian" is that of Kahan's map; so are `growth`, `eigenvalues` by default."""
        return self.formulas.get("jacobian") is KAHAN["jacobian"]

    def find_growth(
        self, problem: Problem, steps: int, transient: int, report: Report | None
    ) -> Growth:
        """Return the sums for `lyapunov_exponents`, by `growth` or its default."""
        default = growth if self.has_jacobian_of_kahan else growth_by_jacobian
        return (self.growth or default)(problem, steps, transient, report)

    @property
    def known_eigenvalues(self) -> Eigenvalues | None:
        """`eigenvalues` or its default; None if eigenvalues of "jacobian" are used instead."""
        return self.eigenvalues or (eigenvalues if self.has_jacobian_of_kahan else None)

    def has(self, name: str) -> bool:
        """Return whether the map supports a public function, at least for some bodies."""
        if name in PARTS:
            return PARTS[name] in self.formulas or getattr(self, PARTS[name], None) is not None
        return name in self.formulas or name in self.serves

    def functions(self, body: Any) -> list[str]:
        """Return the names of the public functions of a state that the map supports for a body."""
        names = filter(self.has, [*self.formulas, *self.serves, *PARTS])
        return [name for name in names if self._has_for(name, body)]

    def _has_for(self, name: str, body: Any) -> bool:
        try:
            self.require(name, body)
        except (TypeError, ValueError):
            return False
        return True

    def require(self, name: str, body: Any) -> None:
        """Raise an error unless the map supports a public function for this body."""
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
                received += INSTEAD.get(name) or body.instead
            raise checks.wrong(
                "system", checks.either(names or ["another one"]), received, TypeError
            )
        if name in self.formulas and (check := self.formulas[name].check):
            check(body)
        if PARTS.get(name) == "plane" and self.plane and self.plane.check:
            self.plane.check(body, name)

    def formula(self, name: str, body: Any) -> Formula:
        """Return the formula of a public function; raise if there is none for this body."""
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


@public
def register(record: Map) -> None:
    """Make a map available to runs, files and functions of a state.

    The first record of a class has the method "auto", the default of runs; further records of the
    same class have methods of other names.

    Parameters
    ----------
    record : Map
        The map with all its parts.

    Raises
    ------
    TypeError, ValueError
        If the name or a method is taken, a part of the record does not have the type that `Map`
        says, or a formula has a name that no public function has.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, iterate, maps
    >>> def explicit_euler(x, out, eps, work, indices, values):
    ...     out[:] = x
    ...     for (i, j, k), v in zip(indices.T, values):  # x_i' = v x_j x_k, with x_D = 1
    ...         out[i] += eps * v * (x[j] if j < len(x) else 1.0) * (x[k] if k < len(x) else 1.0)
    ...     return 0
    >>> maps.register(
    ...     maps.Map(
    ...         name="Explicit Euler", title="Explicit Euler method", body=QuadraticField,
    ...         methods={"euler": maps.Steps(maps.steps_of(explicit_euler), maps.by_field)},
    ...         formulas={}, variable="x", meaning="state",
    ...     )
    ... )
    >>> decay = QuadraticField.from_function(lambda x: (-x[0],), 1)
    >>> iterate(decay, [1.0], eps=0.1, steps=2, method="euler").x.ravel().round(9)
    array([1.  , 0.9 , 0.81])
    >>> del maps.MAPS["Explicit Euler"]  # only to try it again in the same session
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
    if not {*record.serves} <= {*SERVED}:
        raise checks.wrong("serves", f"names among {SERVED}", repr(record.serves))
    taken = [name for other in MAPS.values() if other.body is record.body for name in other.methods]
    if not record.methods or (clashing := {*record.methods} & {*taken}):
        received = ", ".join(sorted(clashing)) if record.methods else "none"
        raise checks.wrong("methods", f"none of {', '.join(taken)}", received)
    if "auto" not in {*record.methods, *methods_of(record.body)}:
        why = f"because {record.body.__name__} has no other map"
        raise ValueError(f"methods: name one of {', '.join(record.methods)} auto, {why}")
    for method, steps in record.methods.items():
        check_steps(f"methods[{method!r}]", steps)
    check_formulas(record.formulas, record.conserved)
    if "__init__" in vars(record.body) and not hasattr(record.body.__init__, "__wrapped__"):
        public_class(record.body)
    MAPS[record.name] = record


# ------------------------------------------------------------------------------------------- lookup
def map_of(body: Any, method: str = "auto") -> Map:
    """Return the map of a method for a body.

    A class has the maps of its own records, and those of the classes that it derives from as long
    as it does not define equations of its own.
    """
    by_method = methods_of(type(body))
    if type(method) is str and method in by_method:
        return by_method[method]
    if isinstance(body, Field):
        raise TypeError(f"system: {NO_MAP}")
    if not by_method:
        kinds = [record.body.__name__ for record in MAPS.values()]
        received = checks.kind_of(body) + checks.in_place_of(body)
        if isinstance(body, Body):
            received += ", a class without a record of its own: see maps.register"
        raise checks.wrong("system", checks.either([*dict.fromkeys(kinds)]), received, TypeError)
    if f"order{method}" in by_method:
        checks.one_of("method", method, by_method, f": pass 'order{method}'")
    of_fields = ", ".join(repr(name) for name in methods_of(QuadraticField) if name != "auto")
    instead = f": QuadraticField.of(body) has the methods {of_fields}"
    is_of_fields = str(method) in methods_of(QuadraticField) or str(method).startswith("order")
    instead *= is_of_fields and "order8" not in by_method
    if "order8" in by_method and not is_of_fields:
        instead = ": Kahan's map is 'auto'; flow(field, x0, time=...) integrates to a tolerance"
    return by_method[checks.one_of("method", method, by_method, instead)]


def methods_of(kind: Any) -> dict[str, Map]:
    """Return the maps of a class of bodies by the names of their methods."""
    return _by_method(kind, tuple(MAPS.values()))


# A class that defines one of these attributes has equations of its own.
_EQUATIONS = {"field", "_terms", "constants"}


@lru_cache(maxsize=64)  # for speed in small calls
def _by_method(kind: type[Any], records: tuple[Map, ...]) -> dict[str, Map]:
    by_method: dict[str, Map] = {}
    for base in kind.__mro__:
        for record in records:
            if record.body is base:
                for method in record.methods:
                    by_method.setdefault(method, record)
        if not _EQUATIONS.isdisjoint(vars(base)):
            break  # the classes above have other equations
    return by_method


def named(name: str) -> Map:
    """Return the map with this name, which files and pickles contain."""
    if name not in MAPS:
        how = "import the module that registers it"
        raise ValueError(f"there is no map {name!r}, only {', '.join(map(repr, MAPS))}: {how}")
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
    """Return the checked problem of a public function, if the map supports the function.

    Options are those of `engine.problem.check`.
    """
    map = map_of(body, method)
    map.require(function, body)
    return check(map, body, omega, eps, threads, method=method, **options)
