"""Kahan maps of the Suslov problem and of quadratic ODEs, and solutions of any ODEs, in batches.

Solve the equations of a pendulum for three values of its friction::

    import numpy as np
    from suslov_fast import Field, flow

    pendulum = Field(
        lambda x, c: (x[1], -np.sin(x[0]) - c * x[1]), "angle velocity", c=[0, 0.1, 0.2]
    )
    motion = flow(pendulum, [2.5, 0.0], time=np.linspace(0, 20, 201))

Iterate the map of a body from two initial angular velocities::

    from suslov_fast import Suslov3D, iterate

    body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    run = iterate(body, [[1.0, 0.5], [0.2, -0.7]], eps=0.2, steps=1000)

The map of the Suslov problem is from V. Dragovic and B. Gajic, arXiv:0807.2966.
"""

import ast
import os
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType

__version__ = "2.2.0"

# The imports in `__init__.pyi` list the public names. The loader reads that file, not `open`,
# because the package may be in an archive.
_LIST = __loader__.get_data(str(Path(__file__).with_suffix(".pyi"))).decode()
MODULE_OF = {
    alias.name: f".{node.module}"
    for node in ast.parse(_LIST).body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
}
__all__ = sorted(MODULE_OF)
_MODULES = ("compiled", "integrability", "kahan")


def _imported(name: str) -> ModuleType:
    """Import a module of the package; Ctrl-C waits until then."""
    interrupts = import_module(".core.numba.interrupts", __name__)
    with interrupts.uninterrupted():
        return import_module(name, __name__)


def __getattr__(name: str) -> object:
    """Import the module of a public name when the name is first used."""
    if name in _MODULES:
        return _imported(f".{name}")
    if name not in MODULE_OF:
        raise import_module(".keywords", __name__).missing_in(__name__, name)
    value: object = getattr(_imported(MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, *_MODULES, "__version__"]


# True in a forked child, which lacks the threads of its parent: OpenMP and TBB would hang or abort.
_threads_are_gone = False


def _after_fork() -> None:
    """Compute on one thread in a forked child of a process that had threads, or has torch."""
    global _threads_are_gone
    _threads_are_gone |= "torch" in sys.modules
    with suppress(KeyError, ValueError, AttributeError):  # no Numba, or Numba without threads
        sys.modules["numba"].threading_layer()
        _threads_are_gone = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
