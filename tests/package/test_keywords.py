"""Unknown keywords and attributes are answered with what to use."""

import copy
import dataclasses
import importlib.util
import inspect
import pickle
import re

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast import maps
from suslov_fast.keywords import advice, public
from suslov_fast.runs.periodic import PeriodicOrbit

FIELD = sf.QuadraticField.from_function(lambda x, rho: (x[1], -rho * x[0]), "u w", rho=2.0)
RUN = sf.iterate(FIELD, [1.0, 0.0], 0.1, 10)
FAMILY = sf.QuadraticField.from_function(lambda x, rho: (x[1], -rho * x[0]), 2, rho=[1, 2])
# Without a crossing: nothing is compiled when tests are collected.
POINTS = sf.crossings(FIELD, [1.0, 0.0], 0.1, 100, lambda x: x[..., 0] - 9)
ORBIT = PeriodicOrbit(np.ones(2), 1.0, np.ones(2, complex), 0.0)
CLOSED = sf.ClosedForm(0.1, -0.4, -0.7, 0.04)
SMOOTH = sf.Field.from_function(lambda x: (x[1], -np.sin(x[0])), "q p")
XY = sf.QuadraticField.from_function(lambda x: (x[1], -x[0] + x[0] * x[1]), "x y")
ALONG_X = sf.crossings(XY, [1.0, 0.0], 0.1, 100, lambda x: x[..., 0] - 9)
COFACTOR = sf.integrability.cofactors(sf.integrability.kahan(XY), 1)[-1]
STEPPED = (FIELD, [1.0, 0.0], 0.1, 10)


# Functions, the words of other packages that they are called with, and the argument that they name.
WORDS = [
    (sf.iterate, STEPPED, "save_evry every stride thin", "pass save_every="),
    (sf.iterate, (FIELD, [1, 0]), "dt h epsilon step_size", "pass eps="),
    (sf.iterate, (FIELD, [1, 0], 0.1), "n_steps iterations", "pass steps="),
    (sf.iterate, STEPPED, "order integrator solver", "pass method="),
    (sf.iterate, STEPPED, "verbose callback timeout", "pass progress="),
    (sf.iterate, STEPPED, "nonsense", "attitude, eps, method"),
    (sf.iterate, (FIELD,), "x0 y0 omega0 states", "second argument"),
    (sf.iterate, (FIELD, [1, 0]), "t_span t_eval t_max", "steps"),
    (sf.iterate, STEPPED, "rtol atol RelTol", "flow"),
    (sf.iterate, STEPPED, "events terminal", "crossings"),
    (sf.iterate, STEPPED, "args params", "field or body"),
    (sf.iterate, STEPPED, "seed rng", "RandomStarts"),
    (sf.iterate, STEPPED, "color", "plots"),
    (sf.crossings, STEPPED, "events event condition value", "pass surface="),
    (sf.crossings, (*STEPPED, sum), "terminal k", "pass most="),
    (sf.crossings, STEPPED, "Ttr burn_in", "pass transient="),
    (sf.lyapunov_exponents, STEPPED, "n_jobs workers", "pass threads="),
    (sf.lyapunov_exponents, STEPPED, "k", "all exponents"),
    (sf.ensemble, STEPPED, "n_jobs n_workers", "pass client="),
    (sf.ensemble, STEPPED, "overwrite", "store"),
    (sf.flow, (FIELD, [1, 0]), "t t_span t_eval saveat", "pass time="),
    (sf.flow, (FIELD, [1, 0]), "tol RelTol", "pass rtol="),
    (sf.flow, (FIELD, [1, 0]), "dt eps steps method", "rtol="),
    (sf.flow, (FIELD,), "x0", "second argument"),
    (sf.energy, (FIELD,), "omega", "second argument"),
    (sf.fixed_points, (FIELD,), "tol", "no argument by name"),
    (sf.periodic_orbit, (FIELD, [1, 0]), "T", "pass period="),
    (sf.integrability.report, (FIELD,), "budget timeout", "pass time_limit="),
    (sf.RandomStarts, (3, 1.0), "seeds rng random_state", "pass seed="),
    (sf.Suslov3D, (), "I11", "pass I1="),
    (sf.Suslov3D, (), "I31", "pass I13="),
    (sf.Suslov3D, (), "I12 inertia", "from_inertia"),
    (sf.Suslov3D, (), "omega0", "I1"),
    (sf.SuslovND, (), "tensor", "from_mass_tensor"),
    (sf.SuslovND, (), "n", "J and I"),
    (sf.compiled.system, (FIELD,), "dt h", "pass eps="),
    (sf.Trajectories.load, (), "filename file", "pass path="),
    (RUN.save, (), "filename", "pass path="),
    (RUN.extend, (), "n", "pass steps="),
    (RUN.plot, (), "nonsense", "ax, color, components, lines, title"),
    (RUN.plot, (), "colour c", "pass color="),
    (RUN.plot, (), "xlim figsize grid", "pass ax="),
    (RUN.plot, (), "x axis", "pass components="),
    (POINTS.of, (), "k", "index"),
]


@pytest.mark.parametrize(
    ("function", "arguments", "word", "answer"),
    [
        pytest.param(f, arguments, word, answer, id=f"{f.__name__} {word}")
        for f, arguments, words, answer in WORDS
        for word in words.split()
    ],
)
def test_unknown_keywords(function, arguments, word, answer):
    """The answer names the argument of this package."""
    with pytest.raises(
        TypeError, match=f"{function.__name__} has no argument '{word}': .*{answer}"
    ):
        function(*arguments, **{word: 3})


def test_all_unknown_keywords_are_named_at_once():
    answer = r"iterate has no argument 'dt': pass eps=; no argument 'a', 'b': it has .* or body$"
    with pytest.raises(TypeError, match=answer):
        sf.iterate(FIELD, [1, 0], dt=0.1, a=1, steps=10, b=2)


@pytest.mark.parametrize(
    ("function", "arguments", "answer"),
    [
        (
            sf.flow,
            (FIELD, [1, 0], 3.0, 1e-6),
            r"takes 2 arguments by position \(system, x0\), not 4; by name: time=",
        ),
        (
            sf.energy,
            (FIELD, [1, 0], 3),
            r"energy takes 2 arguments by position \(body, omega\), not 3$",
        ),
        (
            RUN.extend,
            (3, 4),
            r"extend takes 1 argument by position \(steps\), not 2; by name: threads=",
        ),
        (
            sf.QuadraticField.from_function,
            (lambda x, rho: (x[1], -rho * x[0]), 2, 28),
            r"takes 2 arguments by position \(f, dimension\), not 3; by name: parameters, such as",
        ),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_arguments_that_are_passed_by_name(function, arguments, answer):
    with pytest.raises(TypeError, match=answer):
        function(*arguments)


def test_arguments_by_position_and_by_name():
    with pytest.raises(TypeError, match=r"^iterate got steps twice, by position and by name"):
        sf.iterate(*STEPPED, steps=3)
    for make in (sf.QuadraticField.from_function, sf.Field.from_function):
        with pytest.raises(ValueError, match=r"'dimension' clashes .* rename it, to dimension_"):
            make(lambda x, dimension: (dimension * x[0],), 1, dimension=2.0)
    with pytest.raises(ValueError, match=r"'K' clashes .* rename it, to K_"):
        sf.QuadraticField.from_hamiltonian(lambda x, K: K * x[0] ** 2, 2, None, K=2.0)


@pytest.mark.parametrize(
    ("function", "arguments", "missing"),
    [
        (sf.iterate, STEPPED[:3], "steps"),
        (sf.periodic_orbit, (FIELD, [1, 0], 1.0), "steps"),
        (sf.jacobian, STEPPED[:2], "eps"),
        (sf.ensemble, STEPPED, "store"),
        (sf.energy, (), "body"),
        (sf.Suslov3D, (4, 1), "I13"),
        (sf.Suslov3D.from_inertia, (np.eye(3),), "a"),
        (sf.SuslovND, ([1.0, 2.0],), "I"),
        (sf.QuadraticField, (), "quadratic"),
        (sf.QuadraticField.from_function, (len,), "dimension"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_missing_arguments(function, arguments, missing):
    with pytest.raises(TypeError, match=rf"^{function.__name__} needs {missing}\b"):
        function(*arguments)


def with_symbol():
    sympy = pytest.importorskip("sympy")
    sf.QuadraticField.from_function(lambda x, a: (a * x[0],), 1, a=sympy.Symbol("a"))


@pytest.mark.parametrize(
    ("call", "kind", "argument"),
    [
        (lambda: sf.iterate(FIELD, [1.0, 0.0, 0.0], 0.1, 10), ValueError, "x"),
        (lambda: sf.iterate(FIELD, [1, 0], 100, 0.1), TypeError, "steps"),
        (lambda: sf.iterate(FIELD, [1, 0], 0.1, 10, a=2), TypeError, "iterate .*'a'"),
        (lambda: sf.iterate(*STEPPED, method="RK45"), ValueError, "method"),
        (lambda: sf.iterate(*STEPPED, method=8), ValueError, "method"),
        (lambda: sf.exact(sf.Suslov3D(4, 1, 0, 0), [1, 0], 0.1, np.inf), ValueError, "n .*limits"),
        (lambda: sf.iterate((FIELD, 0.1), [1, 0], 0.1, 10), TypeError, "body"),
        (lambda: sf.iterate(FIELD.to_dict(), [1, 0], 0.1, 10), TypeError, "body"),
        (lambda: sf.ensemble(*STEPPED, store=3), TypeError, "store"),
        (lambda: sf.ensemble(*STEPPED, store="a.h5"), ValueError, "store"),
        (lambda: sf.ensemble(*STEPPED, store="a.csv"), ValueError, "store"),
        (lambda: sf.RandomStarts(3, (-1, 2)), (ValueError, TypeError), "extent"),
        (lambda: sf.Suslov3D.from_inertia([4, 2, 3], [0, 0, 1]), ValueError, "I"),
        (lambda: sf.QuadraticField.from_function("p, -q", "q p"), TypeError, "f"),
        (lambda: sf.QuadraticField.from_function(lambda x, v: (-x,), 1), TypeError, "f .*v"),
        (
            lambda: sf.QuadraticField.from_function(lambda x, p: (p["k"] * x[0],), 1, p={"k": 2}),
            TypeError,
            "p",
        ),
        (lambda: sf.QuadraticField.from_hamiltonian(len, 3, K=len), TypeError, "K"),
        (with_symbol, TypeError, "a"),
        (lambda: sf.SuslovND(np.diag([1.0, 2]), 1), ValueError, "J"),
        (lambda: sf.Suslov3D(np.diag([1.0, 2]), 1, 1, 1), ValueError, "I1"),
        (lambda: sf.crossings(*STEPPED, "u"), TypeError, "surface"),
        (lambda: sf.plot_phase(sf.Suslov3D(4, 2, -0.5, -0.3), [[1, 0.5]]), ValueError, "eps"),
        (lambda: sf.integrability.report(len), TypeError, "field"),
        (lambda: COFACTOR([[1, 2]] * 3, 1), ValueError, "x|point"),
        (lambda: COFACTOR.subs({"x": 1}), TypeError, "eps"),
        (lambda: FIELD.sel(rho=2), ValueError, "sel"),
        (lambda: FAMILY["rho"], TypeError, "index 'rho'"),
        (lambda: RUN.plot("run.png"), ValueError, "components"),
        (lambda: RUN.plot("time", "energy"), ValueError, "components"),
        (lambda: RUN.plot("rho", "u"), ValueError, "components"),
        (lambda: POINTS.plot("rho", "u"), ValueError, "components"),
        (lambda: RUN.plot(color=[1, 2]), ValueError, "color"),
    ],
)
def test_errors_name_the_argument(call, kind, argument):
    with pytest.raises(kind, match=rf"^({argument})(?!\w)"):
        call()


# Classes that users make by a call; all others are results, errors, or made by functions.
MADE_FOR_MAPS = maps.Map, maps.Steps, maps.Formula, maps.Plane
BODIES = sf.QuadraticField, sf.Suslov3D, sf.SuslovGyrostat, sf.SuslovND
MADE_BY_USERS = *BODIES, sf.RandomStarts, *MADE_FOR_MAPS
# Methods of the laboratory that pages mention; the others are for searches.
IN_LABORATORY = "jacobian determinant subs symbols to_dict __call__".split()


def callables():
    """Yield all public functions, constructors and methods, with their names."""
    modules = [sf, sf.compiled, *([sf.integrability] if importlib.util.find_spec("flint") else [])]
    things = [getattr(module, name) for module in modules for name in module.__all__]
    things += [maps.register, maps.steps_of]
    for thing in {id(each): each for each in [*things, *MADE_BY_USERS]}.values():
        # Functions of users' loops, which are such in interpreted runs, have other qualified names.
        if inspect.isfunction(thing) and thing.__qualname__ == thing.__name__:
            yield thing.__name__, thing
        if thing in MADE_BY_USERS:
            yield thing.__name__, thing
        if not inspect.isclass(thing) or thing in MADE_FOR_MAPS:
            continue
        in_laboratory = thing.__module__.startswith("suslov_fast.integrability")
        for name in IN_LABORATORY if in_laboratory else dir(thing):
            method = getattr(thing, name, None)
            ours = (getattr(method, "__module__", "") or "").startswith("suslov_fast")
            if ours and inspect.isroutine(method) and (in_laboratory or not name.startswith("_")):
                called = method.__qualname__.split(".")[0] if name == "__call__" else name
                yield f"{thing.__name__}.{called}", method


CALLABLES = [pytest.param(name, each, id=name) for name, each in callables()]


@pytest.mark.parametrize(("name", "function"), CALLABLES)
def test_every_public_callable_answers(name, function):
    called = name.rpartition(".")[-1]
    signature = inspect.signature(function)
    kinds = {parameter.kind for parameter in signature.parameters.values()}
    if inspect.Parameter.VAR_KEYWORD not in kinds:
        with pytest.raises(TypeError, match=f"{called} has no argument 'epz': "):
            function(epz=1)
    if inspect.Parameter.VAR_POSITIONAL not in kinds:
        with pytest.raises(TypeError, match=rf"{called} takes .* by position.*, not (19|20)"):
            function(*[1] * 20)


def test_answers_are_tested_for_all_callables():
    names = {each.id for each in CALLABLES}
    assert len(names) > 90
    assert {"iterate", "Map", "Formula", "Suslov3D.admissible_I3"} <= names


def test_functions_stay_what_they_were():
    assert pickle.loads(pickle.dumps(sf.iterate)) is sf.iterate is copy.deepcopy(sf.iterate)
    assert str(inspect.signature(sf.step)).startswith("(body: 'BodyOrField', omega: 'ArrayLike', /")
    functions = filter(inspect.isfunction, (getattr(sf, name) for name in sf.__all__))
    assert max(len(str(inspect.signature(each))) for each in functions) <= 600

    @public
    def raising(a=1):
        raise TypeError("its own")

    with pytest.raises(TypeError, match="its own"):
        raising(a=2)


def test_known_names_come_before_sentences():
    assert advice("t", {"time", "steps"}) == "pass time="
    assert advice("color", {"ax", "color"}) == "pass color="


@pytest.mark.parametrize(
    ("thing", "name", "answer"),
    [
        (RUN, "rho", r"run\.body\.parameters\['rho'\]"),
        (RUN, "parameters", r"run\.body\.parameters"),
        (RUN, "u", r"run\.x\[\.\.\., 0\]"),
        (RUN, "finl", "use final"),
        (RUN, "resume", r"use run\.extend\(steps\)"),
        (POINTS, "index", r"use crossings\.trajectory"),
        (ALONG_X, "x", r"crossings\.states, or crossings\.states\[:, 0\] for the variable x$"),
        (ALONG_X, "y", r"use crossings\.states\[:, 1\]$"),
        (FIELD, "from_sympy", r"from_function\(sympy\.lambdify\(\[symbols\]"),
        (sf, "from_expressions", r"QuadraticField\.from_function\(sympy\.lambdify\("),
        (POINTS, "rho", r"crossings\.body\.parameters\['rho'\]"),
        (POINTS, "w", r"crossings\.states\[:, 1\]"),
        (POINTS, "parameters", r"crossings\.body\.parameters"),
        (POINTS, "fractions", "use fraction"),
        (POINTS, "values", r"crossings\.states"),
        (POINTS, "success", r"crossings\.ok"),
        (RUN, "t_events", "crossings, which finds"),
        (RUN.body, "to_latex", r"str\(field\)"),
        (RUN.body, "states", "the states of a run"),
        (RUN.body, "with_parameters", "from_function again, with the new parameters"),
        (RUN.body, "dim", "use dimension"),
        (RUN.body, "to_json", r"json\.dump\(body\.to_dict\(\), file\)"),
        (RUN, "errors", "run.status and run.failed_at"),
        (ORBIT, "plot", r"use iterate\(field, orbit\.state, orbit\.period / steps, steps, "),
        (ORBIT, "x", r"use orbit\.state"),
        (ORBIT, "stable", r"abs\(orbit\.multipliers\)"),
        (
            ORBIT,
            "nothing",
            "has no attribute 'nothing': it has multipliers, period, residual, state$",
        ),
        (RUN, "dt", r"run\.eps"),
        (RUN, "T", r"run\.x\.T"),
        (RUN, "last", r"use run\.final"),
        (RUN, "lyapunov", "use lyapunov_exponents"),
        (sf, "zoo", r"use suslov_fast\.integrability\.zoo"),
        (sf.integrability.kahan(FIELD, 1), "iterate", r"a map has no .* use map\(x\)"),
        (RUN.body, "subs", "from_function again, with the new parameters"),
        (POINTS, "energy", r"suslov_fast\.energy\(crossings\.body, crossings\.states\)"),
        (RUN.body, "rhs", r"use field\(x\)"),
        (RUN.body, "integrate", "use flow, which returns the states at given times"),
        (RUN.body, "plot", r"use iterate\(\.\.\.\)\.plot\(\)"),
        (RUN.body, "params", "use parameters$"),
        (RUN.body, "sigma", "has no attribute 'sigma'$"),
        (sf.Suslov3D(4, 1, 0, 0), "jac", r"QuadraticField\.of\(body\)\.jacobian\(x\)"),
        (sf.RandomStarts(3, 1.0), "sample", r"random starts has no .* states\(count"),
        (CLOSED, "rate", "it has h, k1, k2, t$"),
        (CLOSED, "x", "use exact, which returns states"),
        (sf, "load", "use Trajectories.load, or Crossings.load"),
        (sf, "report", "use suslov_fast.integrability.report"),
        (sf, "set_num_threads", "use the argument threads= of each function"),
        (sf.integrability, "fixed_points", "use suslov_fast.fixed_points"),
        (sf.integrability, "nothing", "has no attribute 'nothing'$"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_unknown_attributes(thing, name, answer):
    with pytest.raises(AttributeError, match=answer):
        getattr(thing, name)


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("from suslov_fast.integrability import fixed_points", "use suslov_fast.fixed_points"),
        ("from suslov_fast import iterate, report", "use suslov_fast.integrability.report"),
        ("from suslov_fast import lyapunov", "use lyapunov_exponents"),
        ("from suslov_fast import nothing", "cannot import name 'nothing'"),
    ],
)
def test_imports_of_unknown_names(line, answer):
    with pytest.raises(ImportError, match=answer):
        exec(line)
    assert not hasattr(sf.integrability, "fixed_points")  # the error of an attribute


def test_components_of_bodies_are_named_in_any_case():
    run = sf.iterate(sf.Suslov3D(4, 2, -0.5, -0.3), [1.0, 0.5], 0.1, 2)
    with pytest.raises(AttributeError, match=r"use run\.omega\[\.\.\., 0\]"):
        run.omega1  # noqa: B018
    with pytest.raises(TypeError, match=r"run\['u'\]: use run\.x\[\.\.\., 0\]"):
        RUN["u"]
    with pytest.raises(TypeError, match=r"run\['time'\]: use run\.time$"):
        RUN["time"]
    with pytest.raises(TypeError, match=r"run\['x'\]: use run\.x\[\.\.\., 0\]$"):
        sf.iterate(XY, [1.0, 0.0], 0.1, 2)["x"]
    with pytest.raises(TypeError, match=r"crossings\['w'\]: use crossings\.states\[:, 1\]"):
        POINTS["w"]
    with pytest.raises(TypeError, match=r"crossings\[0\]: use crossings\.states\[k\], or of\(i\)"):
        POINTS[0]
    with pytest.raises(TypeError, match=r"crossings\[.*\]: use crossings\.states\[k\], or of\(i\)"):
        POINTS[POINTS.valid]


@pytest.mark.parametrize(
    ("thing", "name", "answer"),
    [
        (FIELD, "rho", "QuadraticField cannot be changed: make it again with rho=3$"),
        (SMOOTH, "q", "Field cannot be changed: make it again with q=3$"),
        (sf.Suslov3D(4, 2, -0.5, -0.3), "I1", "make it again with I1=3$"),
        (RUN, "eps", r"Trajectories cannot be changed: .* such as run\.final\.copy\(\)$"),
        (POINTS, "steps", "Crossings cannot be changed"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_assignments(thing, name, answer):
    with pytest.raises(dataclasses.FrozenInstanceError, match=answer):
        setattr(thing, name, 3)


def test_missing_files(tmp_path):
    with pytest.raises(FileNotFoundError, match=rf"no such file in {re.escape(str(tmp_path))}"):
        sf.Trajectories.load(tmp_path / "run.npz")
    RUN.save(tmp_path / "run1.npz")
    with pytest.raises(FileNotFoundError, match=r"did you mean run1\.npz\?"):
        sf.Trajectories.load(tmp_path / "run.npz")
    with pytest.raises(FileNotFoundError, match=r"there is no folder .*nowhere"):
        sf.Trajectories.load(tmp_path / "nowhere" / "run.npz")


def test_numbers_of_numpy_print_as_numbers():
    constants = sf.closed_form(sf.Suslov3D(4, 1, -0.5, -0.3), [1.0, 0.5], 0.2)
    assert repr(constants).startswith(f"ClosedForm(h={float(constants.h)}, k1=-0.40")
    with pytest.raises(TypeError, match=r"not the float64 2\.0: pass 2$"):
        sf.iterate(FIELD, [1, 0], 0.1, np.float64(2))


def test_values_at_one_state_are_numbers():
    body = sf.Suslov3D(4, 2, -0.5, -0.3)
    for function in (sf.criticality, sf.first_integral, sf.modified_energy, sf.rotation_number):
        assert isinstance(function(body, [1.0, 0.5], 0.1), np.float64), function
    nd = sf.SuslovND([2.0, 2.0, 2.0], [0.4, -0.7, 0.5])
    assert isinstance(sf.criticality(nd, [1.0, 0.5, 0.2], 0.1), np.float64)


BODY = sf.Suslov3D(4, 1, -0.5, -0.3)


def rotating():
    return sf.iterate(BODY, [[1.0, 0.5], [0.2, 0.3]], 0.2, 3)


ATTRIBUTES = [
    (lambda: rotating().sel(eps=0.1), r"to_xarray\(\).sel\(...\).* or run.omega\[:, k\]"),
    (lambda: rotating().t, "run.time"),
    (lambda: rotating().y, "run.omega.T"),
    (lambda: rotating().x, "omega"),
    (lambda: RUN.omega, "x"),
    (lambda: rotating().Omega2, r"run.omega\[..., 1\]"),
    (
        lambda: rotating().lyapunov_exponents,
        r"suslov_fast.lyapunov_exponents\(run.body, run.omega, ...\)",
    ),
    (lambda: FIELD.rho, r"parameters\['rho'\]"),
    (lambda: FIELD.trajectory(100), r"suslov_fast.iterate\(body, ...\)"),
    (lambda: POINTS.x, "crossings.states"),
    (lambda: POINTS.t_events, "crossings.time"),
    (lambda: BODY.energy([1, 2]), r"suslov_fast.energy\(body, ...\)"),
]


@pytest.mark.parametrize(("look", "advice"), ATTRIBUTES)
def test_attributes_that_users_of_other_packages_look_for(look, advice):
    with pytest.raises(AttributeError, match=rf"(expected|use|states of this run are) .*{advice}"):
        look()


def test_close_names_are_suggested():
    """Python suggests a name where an AttributeError says what was asked of which object."""
    for thing in (sf, BODY, rotating()):
        with pytest.raises(AttributeError) as caught:
            _ = thing.no_such_name
        assert (caught.value.name, caught.value.obj) == ("no_such_name", thing)
