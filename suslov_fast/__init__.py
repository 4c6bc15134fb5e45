"""Kahan (Hirota-Kimura) maps of quadratic fields and of the nonholonomic Suslov problem.

Iterate the orbits of a body from two initial angular velocities::

    from suslov_fast import Suslov3D, iterate

    body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    trajectories = iterate(body, [[1.0, 0.5], [0.2, -0.7]], eps=0.2, steps=1000)

The map of the Suslov problem is that of V. Dragovic and B. Gajic, arXiv:0807.2966.
"""

import ast
import os
import sys
from functools import cached_property
from importlib import import_module
from pathlib import Path
from threading import RLock
from types import ModuleType

__version__ = "0.9.0"

# The imports in `__init__.pyi` are the list of public names; by the loader, because the package may
# be in an archive.
_LIST = __loader__.get_data(str(Path(__file__).with_suffix(".pyi"))).decode()
_MODULE_OF = {
    alias.name: f".{node.module}"
    for node in ast.parse(_LIST).body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
}
__all__ = sorted(_MODULE_OF)
_MODULES = ("compiled", "integrability")
_OF_SYMPY = (
    "QuadraticField.from_function(sympy.lambdify([symbols], expressions), [*map(str, symbols)])"
)
# Names in other packages for functions of this one, in lower case without underscores.
_ELSEWHERE = {
    "crossings": "poincare poincaremap poincaresection poincaresos events basins "
    "basinsofattraction",
    "flow, which returns the states at given times, or iterate": "solveivp odeint ode integrate",
    "iterate": "trajectory simulate evolve",
    "iterate, or crossings, with a family of fields": "orbitdiagram bifurcationdiagram bifurcation",
    "iterate(...).plot()": "phaseportrait plot",
    "lyapunov_exponents": "lyapunov lyapunovs lyapunovspectrum maxlyapunov lyapunovexponent",
    "fixed_points": "fixedpoints equilibria equilibrium",
    "QuadraticField.from_function, or Field.from_function": "fromfunction field system",
    _OF_SYMPY: "fromsympy fromexpressions fromequations",
    "QuadraticField.from_hamiltonian": "fromhamiltonian hamiltonianfield hamiltonian",
    "suslov_fast.integrability.report": "report conservedquantities integrals firstintegrals",
    "suslov_fast.integrability.zoo": "zoo examples lorenz lotkavolterra henonheiles",
    "Suslov3D, SuslovGyrostat or SuslovND": "suslov body",
    "Suslov3D.figure(k), k = 1 ... 4": "figure figures picture pictures",
    "animate_body": "animate animation",
    "the argument threads= of each function": "setnumthreads setthreads threads numthreads",
    "the command suslov-fast warm-up": "warmup compile",
    "Trajectories.load, or Crossings.load": "load",
}


def _imported(name: str) -> ModuleType:
    """Import a module of the package; Ctrl-C waits until then."""
    interrupts = import_module(".core.compiling.interrupts", __name__)
    with interrupts.uninterrupted():
        return import_module(name, __name__)


def _here(name: str) -> str:
    """Return what this package has for a name of other packages, or nothing."""
    plain = name.lower().replace("_", "")
    return next((here for here, names in _ELSEWHERE.items() if plain in names.split()), "")


def __getattr__(name: str) -> object:
    """Import the module of a public name when the name is first used."""
    if name in _MODULES:
        return _imported(f".{name}")
    if name not in _MODULE_OF:
        import_module(".keywords", __name__).refuse(sys.modules[__name__], name, _here(name))
    value: object = getattr(_imported(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, *_MODULES, "__version__"]


# Whether this is a forked child without its parent's threads: OpenMP and TBB would hang or abort.
_threads_are_gone = False


def _after_fork() -> None:
    """Note in a forked child that threads are gone, if its parent had started some to compute.

    Threads of a `prange` of the user count as well. Nobody can ask torch whether it started
    threads, so its import counts.
    """
    global _threads_are_gone
    numba, ours = sys.modules.get("numba"), sys.modules.get(f"{__name__}.engine.threads")
    try:
        numba.threading_layer()  # type: ignore[union-attr]
        _threads_are_gone = True
    except (ValueError, AttributeError):  # none were started, or Numba is not imported
        _threads_are_gone |= "torch" in sys.modules
    if hasattr(ours, "renew"):  # else another thread has just begun to import it
        ours.renew()
    if sys.version_info < (3, 12):
        _renew_locks()


def _renew_locks() -> None:
    """Give all cached properties new locks, because threads that are gone may hold the old ones."""
    modules = [module for name, module in sys.modules.items() if name.startswith(f"{__name__}.")]
    for value in [value for module in modules for value in vars(module).values()]:
        for attribute in vars(value).values() if isinstance(value, type) else ():
            if isinstance(attribute, cached_property):
                attribute.lock = RLock()  # type: ignore[attr-defined]


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
