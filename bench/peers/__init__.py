"""Other ways to do the same work, one module for each library; who lacks one skips it.

Those that iterate the map are compared with its orbit. Those that integrate the motion (s1) to the
same time, `steps * eps`, are compared with the motion; they cannot give the states of the map.
"""

import importlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import pytest
from results import Whose

C, NUMPY, OTHER = Whose.C, Whose.NUMPY, Whose.OTHER


@dataclass(frozen=True)
class Peer:
    """A function of a module here, and how much work it gets, so that it takes some 10 ms."""

    label: str
    module: str
    function: str
    batch: int
    steps: int
    whose: Whose = OTHER
    threads: bool = True  # whether it uses all of them
    divisions: float = 0  # that a step needs, where the divider limits it
    cubic: bool = False  # whether a step in n dimensions takes n**3 operations

    def load(self) -> Callable:
        """The function, called as f(omega0, steps, threads); skips the test without its library."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of libraries being imported
                module = importlib.import_module(f"peers.{self.module}")
        except ImportError as error:
            pytest.skip(f"{self.module.rstrip('_')}: {error}")
        return getattr(module, self.function)

    def row(self, key):
        """What of a row of results is known before."""
        return {"key": key, "label": self.label, "whose": self.whose}


def _c(label, function, batch, steps, **more):
    return Peer(f"C, {label}", "c", function, batch, steps, whose=C, **more)


def _numpy(label, function, batch, steps, **more):
    more = {"whose": NUMPY, "threads": False} | more
    return Peer(f"NumPy, {label}", "numpy_batch", function, batch, steps, **more)


# Final states of the map.
FINAL = {
    "c-projective": _c(
        "parameter-free, one division per four steps", "projective", 65_536, 1000, divisions=0.25
    ),
    "c-parameter-free": _c("parameter-free", "parameter_free", 65_536, 1000, divisions=1),
    "c-printed": _c("(ds2) as printed", "as_printed", 65_536, 1000, divisions=2),
    "heyoka-parameter-free": Peer(
        "heyoka, compiled function, parameter-free, 4 steps a call",
        *("heyoka_", "parameter_free", 65_536, 100),
    ),
    "heyoka-printed": Peer("heyoka, compiled function, (ds2)", "heyoka_", "as_printed", 65_536, 40),
    "jax-parameter-free": Peer(
        "JAX, `jit`, `fori_loop` over the batch, parameter-free",
        *("jax_", "parameter_free", 65_536, 200),
    ),
    "jax-printed": Peer(
        "JAX, `jit`, `fori_loop` over the batch, (ds2)", "jax_", "as_printed", 65_536, 100
    ),
    "numba": Peer("Numba, `prange` over trajectories, (ds2)", "naive_numba", "final", 16_384, 250),
    "pynamicalsys": Peer(
        "pynamicalsys, `trajectory` of an ensemble, (ds2)", "pynamicalsys_", "final", 2048, 250
    ),
    "numpy": _numpy("over the batch, (ds2)", "final", 4096, 250),
    "python": Peer("Python, (ds2)", "python_loop", "final", 64, 1000, threads=False),
}

# One far state by the closed form.
JUMP = {
    "c": _c("`-ffast-math`", "jump", 65_536, 10**6),
    "numpy": _numpy("over the batch", "jump", 65_536, 10**6),
}

# The continuous motion after the time of the same steps.
MOTION = {
    "heyoka": Peer(
        "heyoka, Taylor integrator, 16 trajectories at once", "heyoka_", "motion", 4096, 1000
    ),
    "numbalsoda": Peer(
        "numbalsoda, LSODA, `prange` over trajectories", "numbalsoda_", "motion", 1024, 1000
    ),
    "scipy-stacked": Peer(
        "SciPy, DOP853, all in one system", "scipy_ivp", "stacked", 4096, 1000, threads=False
    ),
    "scipy": Peer("SciPy, DOP853, one by one", "scipy_ivp", "one_by_one", 8, 1000, threads=False),
}

# All states of the map, into memory that is used again where the library allows it.
STORED = {
    "c-streaming": _c("parameter-free, streaming stores", "stored_streaming", 65_536, 256),
    "c-plain": _c("parameter-free, plain stores", "stored", 65_536, 256),
    "numba": Peer("Numba, `prange` over trajectories, (ds2)", "naive_numba", "stored", 16_384, 256),
    "jax": Peer("JAX, `jit`, `scan` over the batch, parameter-free", "jax_", "stored", 16_384, 256),
    "pynamicalsys": Peer(
        "pynamicalsys, `trajectory` of an ensemble, (ds2)", "pynamicalsys_", "stored", 2048, 256
    ),
    "numpy": _numpy("over the batch, (ds2)", "stored", 16_384, 64),
}

# One step in n dimensions: functions of (body, omega0, eps, steps), on one thread.
ND = {
    "c-rank2": _c("rank two, 32 trajectories at once", "rank2", 512, 0, threads=False),
    "numpy-rank2": _numpy("rank two", "rank2", 512, 0),
    "c-elimination": _c("elimination", "eliminate", 512, 0, threads=False, cubic=True),
    "numpy-solve": _numpy("`linalg.solve`", "solve", 512, 0, cubic=True),
}
