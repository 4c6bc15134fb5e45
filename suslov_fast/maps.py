"""One record for each map, with all that depends on it; lookup of maps and of classes of bodies."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from . import checks
from .bodies.base import Body
from .bodies.field import QuadraticField
from .bodies.nd import SuslovND
from .bodies.rigid import Suslov3D, SuslovGyrostat
from .core import steps_3d, steps_field, steps_nd
from .engine import arguments
from .engine.arguments import (
    Problem,
    by_constants,
    by_plan,
    field_system,
    nd_system,
)
from .engine.stretches import Steps
from .formulas import BY_JACOBIAN, GYROSTAT, IN_3D, IN_ND, KAHAN, Formula

# What errors say where the map of a body lacks a function, by its name.
_INSTEAD = {
    **dict.fromkeys(("exact", "flow", "limits"), ", which has no closed form: use iterate"),
    "closed_form": ": use exact, or iterate where there is no closed form",
    "frame": ": call system(body, eps)",
    **dict.fromkeys(
        ("first_integral", "criticality"), ": suslov_fast.integrability.report looks for integrals"
    ),
    **dict.fromkeys(
        ("attitude", "momentum", "reaction", "to_matrix"), ", whose states turn no body"
    ),
    "to_vector": ": in n dimensions use to_matrix",
    **dict.fromkeys(("explore", "plot_phase", "animate_body"), ": use iterate(...).plot()"),
    "step_full": ": use step",
}


@dataclass(frozen=True, eq=False)
class Map:
    """A map: a discretization of the equations of motion of one class of bodies or fields.

    Runs, files, stores, plots and functions of a state ask this record for all that depends on the
    map; what it lacks raises an error. `register` makes a record known. Several records may have
    the same class; the argument `method` of a run decides between them. Functions without this
    argument, such as `jacobian`, are those of the map with the method "auto".

    Attributes
    ----------
    name : str
        The unique name that files contain.
    title : str
        The name that plots and datasets show.
    body : type
        The class of the bodies, derived from `Body`; subclasses without a record use this one.
    methods : mapping of str to Steps
        Ways to compute the steps, by the values of the argument `method`, the default first.
        `Steps(kernel, arguments, carried, cost, lanes, system)` is described below.
    formulas : mapping of str to Formula
        What public functions need from this map, by their names (see `formulas.py`):
        ``{**KAHAN}`` for Kahan's map of the field of any body, ``{}`` for a map of which only the
        steps are known. In `Formula(compute, check, poles)`, `compute` takes a `Problem` and
        returns the values (...), `check` raises an error for a body that lacks the quantity, and
        `poles` is True where infinite values are meant. ``"attitude"`` is `AXIAL` or `IN_ROWS`: how
        states turn a body; without it `attitude` raises an error. A map with ``"jacobian"`` also
        has ``"lyapunov_exponents"`` and ``"multipliers"``.
    random : tuple of callables
        Functions ``random(rng, shape)`` that return a batch of bodies for tests; each is tested.
    pole : tuple or None
        A body, and a state that has no next one for eps = 1; None if every state has one.
    conserved : tuple of str
        Names of formulas; the first that a body has is conserved, exactly or nearly.
    variable : {"omega", "x"}
        The name of states in runs and datasets.
    meaning : str
        What a state is, for datasets: "angular velocity" or "state".

    Notes
    -----
    A kernel of steps is a function of numbers and arrays, decorated with `core.numba.kernel`:

        steps(part, parts, arguments, omega0, carry, span, saved, final, status, failed_at)

    `tests/own.py` has a short one, which steps one trajectory after the other. A kernel neither
    validates nor raises, and allocates nothing inside loops over steps; formulas that it calls are
    decorated with `core.numba.formula` or `core.numba.function`.

    1. `arguments` is what `Steps.arguments(body, eps, batch)` returned, called once for a run: a
       tuple of arrays. Each has one row if it is common to all B trajectories, else B rows:
       ``array[i % len(array)]`` is that of trajectory i. `by_constants` passes ``body.constants``
       and eps (1 or B,), `by_field` the terms v x_j x_k of the field, with x_D = 1: indices (3, T),
       the i, j and k, values (1 or B, T), and eps.
    2. `span` is (begin, end, start, stop, every, row). The call takes the trajectories
       begin <= i < end from state `start` to state `stop`; ``share`` returns those of part number
       `part` of `parts`, which a thread computes.
    3. State 0 is `omega0` (B, D), which is read only if start = 0. It counts as a saved state and,
       if it is NaN, as a failure at step 0: status NONFINITE. Calls with start = stop = 0 do
       nothing else.
    4. A run is cut into calls anywhere, in time and in the batch, and all cuts give the same bits.
       Steps continue from `final` (B, D) and from `carry` (B, carried), whose contents the kernel
       chooses: both are read if start > 0, and written at `stop`.
    5. If every > 0, state n is saved if start < n <= stop, or n = start = 0, and n is a multiple of
       `every`: the first of them to saved[row], the next to saved[row + 1]; `saved` is
       (rows, B, D).
    6. `final` receives the states at `stop`, saved or not.
    7. A trajectory that fails at state n gets status[i] < 0 (`core.codes`: SINGULAR where there is
       no next state, NONFINITE beyond float64), failed_at[i] = n, and NaN from there on, in `saved`
       and in `final`. One with status[i] < 0 at the beginning of a call stays NaN. No other
       trajectory is touched: its bits do not depend on the batch, its order, or `parts`.
    8. `Steps.cost(D, arguments)` is the time of a step relative to that of the three-dimensional
       map (about 1 ns on one thread). It decides how many steps a call takes, so that Ctrl-C
       is handled within about 0.1 s; with an estimate that is too low, it takes longer.
    9. A thread takes `Steps.lanes` trajectories at a time, a multiple of 8.
    10. `Steps.system(body, eps)` returns what `compiled.step_system` takes: `field_system`, if the
        steps are those of Kahan's map of the field of the body. Without it `compiled.system`
        refuses the body; loops of your own call the formulas of your kernel.

    Kernels of the package use `share`, `pick` and `lesser` of `core.numba`; those of pairs of
    numbers use `write_pairs` of `core.rows`. The walk over blocks of lanes and the rule for state 0
    (items 2 and 3) are written in each of them.
    """

    name: str
    title: str
    body: type[Any]
    methods: Mapping[str, Steps]
    formulas: Mapping[str, Formula]
    random: tuple[Callable[[np.random.Generator, tuple[int, ...]], Any], ...]
    pole: tuple[Any, tuple[float, ...]] | None
    conserved: tuple[str, ...] = ()
    variable: str = "omega"
    meaning: str = "angular velocity"

    def __post_init__(self) -> None:
        if "jacobian" in self.formulas:
            vars(self)["formulas"] = {**BY_JACOBIAN, **self.formulas}

    def functions(self, body: Any) -> list[str]:
        """Return the names of the public functions that need a formula and have it for a body."""
        return [name for name, formula in self.formulas.items() if _has(formula, body)]

    def formula(self, name: str, body: Any) -> Formula:
        """Return the formula of a public function; an error if there is none for this body."""
        if name not in self.formulas:
            names = {
                record.body.__name__: None for record in MAPS.values() if name in record.formulas
            }
            received = checks.kind_of(body)
            if self is not map_of(body):
                received = f"{self.title}, which has no {name}"
            else:
                received += getattr(body, "_instead", "") or _INSTEAD.get(name, "")
            raise checks.wrong("body", " or ".join(names) or "another", received, TypeError)
        formula = self.formulas[name]
        if formula.check is not None:
            formula.check(body)
        return formula

    def conserves(self, body: Any) -> str | None:
        """Return the name of a conserved, or nearly conserved, quantity; None without one."""
        known = self.functions(body)
        return next((name for name in self.conserved if name in known), None)

    def symbols(self, body: Any) -> list[str]:
        r"""Return the labels of the components in LaTeX: "Omega1" is `$\Omega_{1}$`."""
        labels = (re.sub(r"(\D+)(.*)", r"$\1_{\2}$", label) for label in body._labels)
        return [label.replace("Omega", r"\Omega") for label in labels]

    def __reduce__(self) -> Any:
        return named, (self.name,)


def _has(formula: Formula, body: Any) -> bool:
    try:
        if formula.check is not None:
            formula.check(body)
    except (TypeError, ValueError):
        return False
    return True


# ---------------------------------------------------------------------------------- of the package
def _random_3d(rng: np.random.Generator, shape: tuple[int, ...]) -> dict[str, Any]:
    """Return parameters of bodies in three dimensions, some with I13 = 0."""
    return {
        "I1": rng.uniform(0.5, 4, shape),
        "I2": rng.uniform(0.5, 4, shape),
        "I13": rng.uniform(-1, 1, shape) * rng.choice([0, 1, 1], shape),
        "I23": rng.uniform(-1, 1, shape),
    }


def _random_with_I3(rng: np.random.Generator, shape: tuple[int, ...]) -> Suslov3D:
    """Return bodies with a third moment of inertia that they can have."""
    moments, products = rng.uniform(2, 4, (2, *shape)), rng.uniform(-0.1, 0.1, (2, *shape))
    I3 = rng.uniform(2.7, 3.3, shape)
    return Suslov3D(moments[0], moments[1], products[0], products[1], I3)


def _random_nd(
    rng: np.random.Generator, shape: tuple[int, ...], m: int = 4, equal: bool = False
) -> SuslovND:
    """Return bodies, with a closed form if all J of a body are equal."""
    J = rng.uniform(0.5, 4, (*shape, 1 if equal else m))
    return SuslovND(J * np.ones(m), rng.uniform(-1, 1, (*shape, m)))


def _random_field(rng: np.random.Generator, shape: tuple[int, ...], D: int = 5) -> QuadraticField:
    return QuadraticField(*(rng.normal(size=(*shape, *(D,) * axes)) / 10 for axes in (3, 2, 1)))


def _cost_of_field(D: int, arguments: Any) -> float:
    """Return the time of a step by `elimination.solve`, which may be that of all lanes."""
    operations, _ = arguments[1]
    return D**3 + 2.5 * len(operations)


def _cost_in_nd(D: int, arguments: Any) -> float:
    """Return a time between those of usual steps and of steps by elimination, for Ctrl-C."""
    return 16.0 * D + D**3 / 30.0


_STEPS_3D = Steps(steps_3d.steps, by_constants, steps_3d.CARRIED, system=field_system)
# Kahan's map of the field of any body.
FIELD = Steps(steps_field.field_steps, by_plan, 0, _cost_of_field, 32, field_system)
_ND = Steps(steps_nd.nd_steps, by_constants, 0, _cost_in_nd, 32, nd_system)
_GAUSS = Steps(steps_nd.gauss_steps, by_constants, 0, lambda D, arguments: D**3 / 3.0, 32)

MAPS: dict[str, Map] = {}  # by name


def register(record: Map) -> None:
    """Make a map known, for runs, files and functions of a state.

    The first record of a class has the method "auto", the default of runs; further records of the
    same class have methods of other names.
    """
    checks.instance("record", record, Map)
    if record.name in MAPS:
        raise checks.wrong("name", "a new one", repr(record.name))
    if not (isinstance(record.body, type) and issubclass(record.body, Body)):
        raise checks.wrong("body", "a class derived from Body", repr(record.body), TypeError)
    checks.one_of("variable", record.variable, ["omega", "x"])
    taken = [name for other in MAPS.values() if other.body is record.body for name in other.methods]
    if not record.methods or (clashing := {*record.methods} & {*taken}):
        received = ", ".join(sorted(clashing)) if record.methods else "none"
        raise checks.wrong("methods", f"other names than {', '.join(taken) or 'none'}", received)
    MAPS[record.name] = record


for _record in (
    Map(  # equation (4) of the paper
        name="Suslov3D",
        title="Discrete Suslov problem",
        body=Suslov3D,
        methods={"auto": _STEPS_3D},
        formulas=IN_3D,
        random=(
            lambda rng, shape: Suslov3D(**_random_3d(rng, shape)),
            _random_with_I3,
        ),
        pole=(Suslov3D(1, 1, 0.25, 0, 1.5), (4.0, -12.0)),
        conserved=("first_integral",),
    ),
    Map(  # equation (15)
        name="SuslovND",
        title="Discrete Suslov problem in n dimensions",
        body=SuslovND,
        methods={"auto": _ND, "gauss": _GAUSS, "rank2": _ND},
        formulas=IN_ND,
        random=(_random_nd, lambda rng, shape: _random_nd(rng, shape, 3, equal=True)),
        pole=(SuslovND([4.0, 1.0, 1.0], [0.5, 0.25, -0.25]), (-2.0, 6.0, -6.0)),
        conserved=("first_integral", "modified_energy"),
    ),
    Map(
        name="SuslovGyrostat",
        title="Discrete Suslov gyrostat",
        body=SuslovGyrostat,
        methods={"auto": _STEPS_3D._replace(cost=lambda D, arguments: 2.0)},
        formulas=GYROSTAT,
        random=(
            lambda rng, shape: SuslovGyrostat(
                **_random_3d(rng, shape), k=rng.uniform(-1, 1, shape)
            ),
        ),
        pole=(SuslovGyrostat(1, 1, 1, 0, 0.5), (1.0, -3.875)),
        conserved=("first_integral",),
    ),
    Map(
        name="Kahan",
        title="Kahan map of a quadratic field",
        body=QuadraticField,
        methods={"auto": FIELD},
        formulas=KAHAN,
        random=(_random_field,),
        pole=(QuadraticField([[[1]]]), (1.0,)),  # x' = x**2
        conserved=("modified_energy",),
        variable="x",
        meaning="state",
    ),
):
    register(_record)


# ------------------------------------------------------------------------------------------- lookup
def map_of(body: Any, method: str = "auto") -> Map:
    """Return the map of a method for a body.

    Records of a class come before those of the classes that it derives from.
    """
    kind: Any = type(body)
    by_method = _by_method(kind, tuple(MAPS.values()))
    if not by_method:
        kinds = [record.body.__name__ for record in MAPS.values()]
        received = checks.kind_of(body) + checks.in_place_of(body)
        raise checks.wrong("body", " or ".join(dict.fromkeys(kinds)), received, TypeError)
    return by_method[checks.one_of("method", method, by_method)]


@lru_cache(maxsize=64)  # for small calls
def _by_method(kind: type[Any], records: tuple[Map, ...]) -> dict[str, Map]:
    """Return the maps of a class of bodies by the names of their methods."""
    found: dict[str, Map] = {}
    for each in kind.__mro__:
        for record in records:
            if record.body is each:
                for method in record.methods:
                    found.setdefault(method, record)
    return found


def named(name: str) -> Map:
    """Return the map with this name, which files and pickles contain."""
    if name not in MAPS:
        expected = f"{' or '.join(MAPS)}, or a map that `maps.register` made known before"
        raise checks.wrong("map", expected, repr(name))
    return MAPS[name]


def problem(
    function: str, body: Any, omega: Any, eps: Any = 0.0, threads: int | None = None, **options: Any
) -> tuple[Problem, Formula]:
    """Check the arguments of a public function; return the problem and the formula for it.

    Options are those of `engine.arguments.check`.
    """
    map = map_of(body)
    formula = map.formula(function, body)
    return arguments.check(map, body, omega, eps, threads, **options), formula


def _classes() -> Iterator[type[Any]]:
    """Yield the classes of bodies that files can name, and then those derived from them."""
    classes = [record.body for record in MAPS.values()]
    yield from classes
    for each in classes:
        subclasses = each.__subclasses__()
        classes.extend(subclasses)
        yield from subclasses


def class_named(name: Any) -> type[Any]:
    """Return the class of bodies of a name, as files hold it."""
    kinds: dict[Any, type[Any]] = {}
    for each in _classes():
        kinds.setdefault(each.__name__, each)
    return kinds[checks.one_of("body", name, kinds)]


def body_from_dict(parameters: Mapping[str, Any]) -> Any:
    """Return the body, of any class, that a dictionary from `to_dict` describes.

    Parameters
    ----------
    parameters : mapping
        What `to_dict` returned.

    Returns
    -------
    Suslov3D, SuslovND, SuslovGyrostat or QuadraticField

    Examples
    --------
    >>> from suslov_fast import SuslovND, body_from_dict
    >>> body_from_dict(SuslovND(J=[1.3, 2.1], I=[0.4, -0.7]).to_dict())
    SuslovND(J=[1.3, 2.1], I=[0.4, -0.7])
    """
    checks.instance("parameters", parameters, Mapping)
    return class_named(parameters.get("body")).from_dict(parameters)
