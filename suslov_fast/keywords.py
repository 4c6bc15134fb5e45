"""Unknown keywords and attributes: the nearest name here, or what another package's word is."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Collection
from dataclasses import FrozenInstanceError
from difflib import get_close_matches
from functools import wraps
from importlib.util import find_spec
from typing import Any, ParamSpec, TypeVar

import suslov_fast

P = ParamSpec("P")
R = TypeVar("R")

# Words of other packages, in lower case without underscores; what they are called here, of which a
# function or an object may have one, such as `states` for states[0]; and what to do where it has
# none.
_TABLE = (
    ("eps epsilon", "eps", "iterate(system, x0, eps, steps), along the map; flow has rtol="),
    ("dt h stepsize deltat firststep", "eps",
     "time=np.arange(0, T, dt), at which states are wanted; steps follow from rtol="),
    ("t time teval tend tmax tf tfinal duration", "time period steps",
     "flow(system, x0, time=t), or the steps n of a map"),
    ("tspan t0", "",
     "time=np.linspace(0, T, n) of flow, counted from x0; iterate runs to eps * steps"),
    ("backward reverse inverse", "", "-eps, which undoes a step"),
    ("tol rtol reltol", "rtol tol", "flow(..., rtol=); steps of a map have no tolerance"),
    ("atol abstol", "atol", "flow(..., atol=); steps of a map have no tolerance"),
    ("order integrator solver alg algorithm scheme method", "method",
     "rtol= of flow, which chooses its steps, and stiff or not unless stiff= says; iterate has "
     "method="),
    ("n nsteps numsteps iterations maxsteps maxiter steps samples size", "steps trajectories n J",
     "time=np.linspace(0, T, n) for n times; flow chooses its steps by rtol="),
    ("denseoutput interp interpolate interpolant resample at sol", "",
     "flow(system, x0, time=t), at any times t; for a table np.interp(t, times, values) in f"),
    ("nfev nstep naccepted", "steps", ""),
    ("x0 y0 u0 z0 omega0 ic start initial initialstate initialcondition", "states[0] state omega0",
     "the second argument, without a name, for states"),
    ("omega x state states", "states state components omega0",
     "the second argument, without a name, for states"),
    ("body system field fun rhs model", "body vector_field", "the first argument, without a name"),
    ("f", "first_integral body", "the first argument, without a name"),
    ("arg p param parameter", "parameters",
     "field.with_parameters(a=1), or make a body again; an array makes a family"),
    ("withparameters setparameters set replace subs", "with_parameters",
     "a new system, with the new parameters; arrays make a family"),
    ("frequencyresponse sweep parametersweep resonance", "",
     "flow(field.with_parameters(a=array), x0, time=t), all values of a parameter at once"),
    ("fit curvefit leastsquares estimate", "",
     "scipy.optimize.least_squares with flow(field.with_parameters(a=a), x0, time=t)"),
    ("table lookup lookuptable interp1d input timeseries", "",
     "np.interp(t, times, values) in f, with a variable t of the rate 1"),
    ("event section condition value trigger", "surface",
     "crossings(system, x0, time=T, surface=lambda x: x[..., 0], direction=0), or "
     "changes=Change(lambda x: x[0], to=lambda x: ...) of flow, where the state changes there"),
    ("jump dose impulse dosetime tstop schedule bolus infusion presettime", "times",
     "changes=Change(times=[1, 2], to=lambda x: (x[0] + 1, x[1])) of flow"),
    ("reset bounce impact affect effect action spike kick", "to",
     "changes=Change(lambda x: x[0], direction=-1, to=lambda x: (x[0], -x[1])) of flow"),
    ("callback cb callbackset", "",
     "changes=Change(lambda x: x[0], to=lambda x: ...) of flow, where the state changes, or "
     "progress=f, which is told how far a run is"),
    ("poincare poincaremap poincaresection poincaresos tevents yevents", "crossings", ""),
    ("maxima peak localmaxima extrema", "",
     "crossings(field, x0, time=T, surface=lambda x: -field(x)[..., 0]), maxima of component 0"),
    ("stroboscopic stroboscope stroboscopicmap", "",
     "flow(field, x0, time=T * np.arange(n)), T the period of the force"),
    ("limitcycle cycle", "", "periodic_orbit(field, flow(field, x0, time=100).x[-1])"),
    ("period frequency", "period", "periodic_orbit(field, x0).period"),
    ("floquet floquetmultipliers", "multipliers", ""),
    ("monodromy variational", "",
     "flow(field, x0, time=T, derivatives='x0').derivative('x0'), of which [-1] is that of T"),
    ("count maxevents maxcrossings", "most", ""),
    ("terminal stop until firstpassage escape escapetime exittime firsthit firstreturn",
     "ends most",
     "changes=Change(lambda x: x[0], ends=True) of flow, or crossings(system, x0, time=T, "
     "surface=lambda x: x[..., 0], direction=0, most=1)"),
    ("basin basinsofattraction", "", "flow(field, grid, time=T).x[-1], or crossings(..., most=1)"),
    ("burnin ntransient transienttime ttr discard", "transient", ""),
    ("every stride thin sample saveat", "save_every",
     "time=np.arange(0, T, dt), at which states are wanted"),
    ("njobs nworkers workers numthreads setnumthreads setthreads cores", "threads client",
     "threads= of each function"),
    ("timeout maxtime budget timelimit", "time_limit progress", ""),
    ("verbose", "progress", ""),
    ("seed rng randomstate", "seed RandomStarts", "RandomStarts(size, seed=...) as states"),
    ("path filename file", "path store", ""),
    ("out output csv", "out output", "ensemble(..., store=), which writes to disk"),
    ("exact rational fractions", "exact",
     "map = suslov_fast.integrability.kahan(field, eps), and x = map(x), in fractions"),
    ("overwrite mode", "force", "another name, or delete the folder of the store"),
    ("c color colour colors", "color constant", ""),
    ("y z", "components", "states, of the shape (times, ..., D)"),
    ("figsize xlim ylim xlabel ylabel grid legend", "ax", ""),
    *((f"i{k}{k}", f"I{k}", "") for k in (1, 2, 3)),
    *((f"i3{k}", f"I{k}3", "") for k in (1, 2)),
    ("i inertia inertiamatrix tensor i12 i21", "parameters",
     "from_inertia(I, a), or from_mass_tensor(I, a) in n dimensions"),
    ("u values data trajectories points shape tonumpy select max min mean", "states",
     "iterate, whose result has states"),
    ("solution explicitsolution", "states exact", ""),
    ("k1 k2 closedform", "closed_form", ""),
    ("index idx orbit member which", "trajectory", "states[:, i], of trajectory i"),
    ("success retcode", "ok", ""),
    ("message error failed failedat", "status", ""),
    ("last end final finalstate laststate", "final states[-1]", ""),
    ("resume restart continue extend", "extend",
     "the same call again, which goes on with a store, or its last states as x0"),
    ("tonetcdf tozarr sel isel", "to_xarray", ""),
    ("savefig figure", "figures plot", "plot().figure.savefig(path)"),
    ("save tojson tofile dump", "save", "json.dump(body.to_dict(), file)"),
    ("load", "load", "Trajectories.load, or Crossings.load, or Motion.load"),
    ("equation", "body", "str(...), the formula"),
    ("symbolic symbol", "", "eps, which is symbolic if it is left out: all else is numbers"),
    ("latex tolatex tosympy sympify", "",
     "str(...), the formula; of an integral F sympy.sympify(F), for sympy.latex"),
    ("lambdify", "compiled", "field(x), or compiled.system in loops of your own"),
    ("dim ndim d", "dimension", ""),
    ("jac dx derivative linearize", "",
     "field.jacobian(x), of its right-hand side; for a body QuadraticField.of(body).jacobian(x)"),
    ("eigenvalues stability stable isstable linearstability", "",
     "np.linalg.eigvals(field.jacobian(x)), or multipliers(system, x, eps), of a map"),
    ("parameterjacobian dfdp inputmatrix", "",
     "(field.with_parameters(a=a + h)(x) - field(x)) / h"),
    ("quadratic linear constant term coefficient", "quadratic",
     "QuadraticField.of(body), whose terms they are"),
    ("variable", "names labels", ""),
    ("solveivp odeint ode integrate solve exactflow", "flow run", ""),
    ("flow iterate ensemble", "run", ""),
    ("trajectory simulate evolve", "run states",
     "suslov_fast.flow(system, x0, time=t), or suslov_fast.iterate along the map"),
    ("orbitdiagram bifurcationdiagram bifurcation continuation", "",
     "a family, from_function(f, names, c=array), and c[points.trajectory] of its crossings"),
    ("phaseportrait plotphaseportrait", "plot", "flow(field, grid, time=t).plot()"),
    ("plot3d", "", "plot(a, b, c), with the names of three components"),
    ("plot", "plot",
     "iterate(...).plot(), or flow(field, x0, time=np.linspace(0, T, 201)).plot()"),
    ("sensitivity sensitivities", "",
     "flow(..., derivatives=('x0', 'a')), and derivative('a') of its result"),
    ("lyapunov lyapunovspectrum sali gali megno ftle", "lyapunov_exponents", ""),
    ("maxlyapunov largestlyapunov lyapunovexponent", "",
     "suslov_fast.lyapunov_exponents(system, x0, time=T)[..., 0], the largest"),
    ("fixedpoint equilibria equilibrium steadyline steadystate", "",
     "suslov_fast.fixed_points(system), points in an array, or of a Field "
     "scipy.optimize.root(field, x0, jac=field.jacobian), one by one"),
    ("frominertia frommatrix fromtensor", "from_inertia from_mass_tensor",
     "from_function(lambda x: A @ x, len(A))"),
    ("inn iii", "", "J, of J_i = I_ii + I_nn, and I, of I_i = I_in, or from_mass_tensor"),
    ("hamiltonian", "energy", "QuadraticField.from_hamiltonian"),
    ("modifiedhamiltonian", "modified_energy", ""),
    ("plotenergy energydrift energyerror", "", "plot(run.time, run.energy()) of Matplotlib"),
    ("theorem1 theorem", "exact", ""),
    ("lemma1", "first_integral", ""),
    ("xy", "to_xy", ""),
    ("lambda torque multiplier", "reaction multipliers", ""),
    ("orientation rotation rotationmatrix", "attitude", "iterate(..., attitude=True)"),
    ("scattering heteroclinicangle rotationangle turningangle", "scattering_angle", ""),
    ("gyrostat suslovrotor rotor", "k SuslovGyrostat",
     "SuslovGyrostat(I1, I2, I13, I23, k), where k is along the constrained axis"),
    ("suslov", "", "Suslov3D, or Suslov3D.from_inertia(I, a)"),
    ("from3d fromsuslov3d", "", "SuslovND([I2, I1], [-I13, -I23]), for states (Omega2, -Omega1)"),
    ("a", "matrix",
     "from_inertia(I, a), or from_mass_tensor(I, a) in n dimensions"),
    ("residual", "", "matrix(body, x, eps) @ x_next - x, which is 0 along the map"),
    ("fromsympy fromexpressions", "",
     "from_function(sympy.lambdify([symbols, *parameters], expressions), names, a=1.0)"),
    ("fromstring fromtext fromequations fromsecondorder", "",
     "from_function(lambda x, k: (x[1], -k * x[0]), 'q p', k=1.0)"),
    ("fromfunction", "from_function", "QuadraticField.from_function, or Field.from_function"),
    ("figures picture", "figures figure", "plot_phase(*suslov_fast.Suslov3D.figure(k))"),
    ("animate animation", "",
     "FuncAnimation of Matplotlib, as docs/examples/turning_body.py for a body"),
    ("darboux darbouxpolynomial", "polynomials darboux_polynomials", ""),
    ("fromnambu", "", "from_function(lambda x: ..., names), of the product of two gradients"),
    ("fromsuslov frombody", "", "QuadraticField.of(body)"),
    ("report integrals firstintegrals conservedquantities countintegrals", "integrals",
     "suslov_fast.integrability.report(field)"),
    ("fromarray fromcoefficient frommatrices", "", "QuadraticField(quadratic, linear, constant)"),
    ("map kahanmap", "", "suslov_fast.step(system, x, eps), or integrability.kahan(field, eps)"),
    ("zoo example systems lorenz roessler rossler henonheiles lotkavolterra vanderpol eulertop", "",
     "from_function(f, names), or field, eps = suslov_fast.integrability.zoo()[name]"),
    ("kahan rationalmap rationalorbit exactmap", "",
     "map = suslov_fast.integrability.kahan(field, eps), and x = map(x), in fractions"),
    ("algebraicentropy entropy degreegrowth degreesofiterates", "proved_entropy",
     "suslov_fast.integrability.planar_entropy(kahan(field)), or growth(degrees(map, 6))"),
    ("singularityconfinement confinement singularities", "",
     "suslov_fast.integrability.planar_entropy(kahan(field)), whose result has the orbits"),
    ("invariantmeasure measure density", "measures",
     "invariant_density(system, x, eps), or suslov_fast.integrability.report(field).measures"),
    ("hirotakimurabasis hkbasis rankofintegrals rank", "hk_bases",
     "suslov_fast.integrability.hk_bases(kahan(field), degree)"),
    ("checkintegral isintegral isconserved verify", "",
     "F(x) == F(map(x)) for fractions x, of map = suslov_fast.integrability.kahan(field, eps)"),
    ("lax laxpair", "", "suslov_fast.integrability.report(field), which finds integrals"),
    ("summary describe", "", "print(...)"),
    ("warmup compile", "warm_up", "the command suslov-fast warm-up"),
)  # fmt: skip
_OWN = {"self", "cls", "_cls"}  # which a caller does not pass
_WORDS = {word: (names.split(), how) for words, names, how in _TABLE for word in words.split()}


def listed(word: str) -> tuple[list[str], str]:
    """Return the names for a word of other packages, and what to do where there is none of them."""
    plain = word.lower().replace("_", "")
    return _WORDS.get(plain, _WORDS.get(plain.removesuffix("s"), ([], "")))


def instead(word: str, known: Collection[str]) -> str:
    """Return what to use for a word: a known name, or a sentence, or nothing."""
    names, how = listed(word)
    found = [each for each in known if each.lower() == word.lower()]
    found += [name for name in names if name.partition("[")[0] in known]
    near = get_close_matches(word, known, 1, 0.75)
    return (found or [how] * bool(how) or near or [""])[0]


def lacking(thing: Any, name: str, called: str, here: str = "") -> AttributeError:
    """Return the error of an object without an attribute; `here` is what to use, if it is known."""
    if not here and not name.startswith("_"):
        own = [each for each in dir(thing) if not each.startswith("_")]
        functions = dir(suslov_fast)
        here = instead(name, own + functions)
        if "argument" in here:  # advice on keywords
            here = ""
        if here in functions and here not in own:
            here = f"suslov_fast.{here}{_call_of(getattr(suslov_fast, here))}"
    text = f"{called} has no attribute {name!r}"
    if here:
        return AttributeError(f"{text}: use {here}")
    return AttributeError(text, name=name, obj=thing)


def _call_of(function: Any) -> str:
    """Return how a function is called at least, as (system, x, eps); nothing for a class."""
    if not inspect.isfunction(function):
        return ""
    needed = []
    for name, each in inspect.signature(function).parameters.items():
        if name == "time":
            needed.append("time=T")
        elif each.default is each.empty:
            needed.append(f"{name}=" if each.kind is each.KEYWORD_ONLY else name)
    return f"({', '.join(needed)})"


def lacking_in_module(module: str, name: str) -> Exception:
    """Return the error of a module without a name, for its `__getattr__`."""
    error = lacking(sys.modules[module], name, f"module {module!r}")
    # `from module import name` replaces an AttributeError by an error of its own.
    is_from = sys._getframe(2).f_code.co_name == "_handle_fromlist"
    return ImportError(str(error)) if is_from and not find_spec(f"{module}.{name}") else error


def with_answers(kind: type[R]) -> type[R]:
    """Let the objects of a class answer an attribute that they lack."""

    def answer(self: Any, name: str) -> Any:
        raise lacking(self, name, f"{type(self).__name__!r} object")

    kind.__getattr__ = answer  # type: ignore[attr-defined]
    return kind


def public(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function answer a keyword that it does not have with the one to use.

    Other calls that do not fit are answered with the arguments that it takes.
    """
    *_, owner, called = ("", *function.__qualname__.split("."))
    called = owner if called.startswith("__") else called

    @wraps(function)
    def answering(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except TypeError:  # of Python if the call is wrong: looked at only now, for speed
            if mistake := _mistake(called, inspect.signature(function), args, kwargs):
                raise TypeError(mistake) from None
            raise

    return answering


def public_class(kind: type[R]) -> type[R]:
    """Let the constructor of a dataclass, or of a named tuple, answer as a public function.

    A frozen dataclass answers an assignment with what makes another object.
    """
    if issubclass(kind, tuple):
        kind.__new__ = staticmethod(public(kind.__new__))  # type: ignore[method-assign]
        return kind
    kind.__init__ = public(kind.__init__)  # type: ignore[method-assign]
    if "__setattr__" in vars(kind):
        kind.__setattr__ = _unchanged  # type: ignore[method-assign]
    return kind


def _unchanged(self: Any, name: str, value: Any) -> None:
    how = f"make it again with {name}=..."
    raise FrozenInstanceError(f"{type(self).__name__} cannot be changed: {how}")


def _of_call(word: str, known: Collection[str]) -> str:
    """Return what to use for a word that means another thing in a call with these arguments."""
    names = listed(word)[0]
    if "eps" in names and "map" in known:
        return "kahan(field, eps) as the map"
    if "eps" in names and {"period", "steps"} <= {*known}:
        return "period=T and steps=N, of which eps is T / N, and method='auto' for Kahan's map"
    if "eps" in names and {"eps", "time"} <= {*known}:
        return "eps= and steps= for the map, counted in steps, or time=T for the motion, in time"
    if "trajectories" in names and "store" in known:
        return "steps= for the map, or RandomStarts(n, extent) as x0 for n trajectories"
    return ""


def _of_system(name: str, system: Any = None) -> str:
    """Return what to use for a parameter of a system; nothing for another word."""
    parameters = getattr(system, "parameters", None)
    if not isinstance(parameters, dict) or name not in parameters:
        return ""
    how = f"system.with_parameters({name}=...)"
    if "with_parameters" not in dir(system):
        how = f"a system that is made with {name}=..."
    return f"{how}, where an array makes a family"


def _mistake(called: str, signature: inspect.Signature, args: Any, kwargs: Any) -> str:
    """Return what is wrong with the arguments of a call, or nothing if they fit."""
    parameters = [*signature.parameters.values()]
    by_name = {each.name for each in parameters if each.kind is not each.POSITIONAL_ONLY}
    takes_any = any(each.kind is each.VAR_KEYWORD for each in parameters)
    if unknown := [] if takes_any else [name for name in kwargs if name not in by_name]:
        names = sorted(by_name - _OWN)
        known = f"use one of {', '.join(names)}" if names else "it takes none by name"
        here = {
            name: _of_system(name, *args[:1]) or _of_call(name, names) or instead(name, names)
            for name in unknown
        }
        told = [f"{name!r}: use {here[name]}" for name in unknown if here[name]]
        rest = [repr(name) for name in unknown if not here[name]]
        told += [f"{', '.join(rest)}: {known}"] * bool(rest)
        return f"{called} has no argument {', and no '.join(told)}"
    try:
        signature.bind(*args, **kwargs)
    except TypeError as error:
        shown = [p.replace(annotation=p.empty) for p in parameters if p.name not in _OWN]
        how = ""
        unnamed = sum(p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD) for p in parameters)
        after_star = [p for p in shown if p.kind is p.KEYWORD_ONLY]
        missing = [p for p in after_star if p.default is p.empty and p.name not in kwargs]
        named = ", ".join(f"{p.name}=" for p in missing or after_star[:3])
        if missing or (len(args) > unnamed and (named or takes_any)):
            how = f", pass {'parameters, as a=1,' if takes_any else named} by name"
        takes = signature.replace(parameters=shown, return_annotation=inspect.Signature.empty)
        if called == "flow" and args and inspect.isroutine(args[0]):
            how += ", and for the function pass Field.from_function(f, names)"
        if args and getattr(args[0], "called", "") == "a run":
            first = "[0]" * ("0'" in str(error))  # of x0 or omega0
            how += f", for a run pass run.body, run.states{first}"
        kind = type(args[0]) if args else None
        if kind and kind.__name__ == called:  # of a constructor
            makers = [f"{called}.{each}" for each in dir(kind) if re.match("from_(?!dict)", each)]
            makers = [
                f"body, rotation = {each}(I, ...)" if each.endswith(("inertia", "tensor")) else each
                for each in makers
            ]
            how += f", or use {' or '.join(makers)}" * bool(makers)
        return f"{called}: {error}{how}: the call is {called}{takes}"
    return ""
