"""Other ways to do the same work, one module for each library; who lacks one skips it.

Those that iterate the map are compared with its orbit. Those that integrate the motion (s1) to the
same time, `steps * eps`, are compared with the motion; they cannot give the states of the map.
"""

import importlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import pytest


@dataclass(frozen=True)
class Peer:
    """A function of a module here, and how much work it gets, so that it takes some 10 ms."""

    module: str
    function: str
    batch: int
    steps: int
    threads: bool = True  # whether it uses all of them
    divisions: float = 0  # that a step needs, where the divider limits it

    def load(self) -> Callable:
        """The function, called as f(omega0, steps, threads); skips the test without its library."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of libraries being imported
                module = importlib.import_module(f"peers.{self.module}")
        except ImportError as error:
            pytest.skip(f"{self.module.rstrip('_')}: {error}")
        return getattr(module, self.function)


# Final states of the map.
FINAL = {
    "C, parameter-free, one division per four steps": Peer(
        "c", "projective", 65_536, 1000, divisions=0.25
    ),
    "C, parameter-free": Peer("c", "parameter_free", 65_536, 1000, divisions=1),
    "C, (ds2) as printed": Peer("c", "as_printed", 65_536, 1000, divisions=2),
    "heyoka, compiled function, parameter-free, 4 steps a call": Peer(
        "heyoka_", "parameter_free", 65_536, 100
    ),
    "heyoka, compiled function, (ds2)": Peer("heyoka_", "as_printed", 65_536, 40),
    "JAX, `jit`, `fori_loop` over the batch, parameter-free": Peer(
        "jax_", "parameter_free", 65_536, 200
    ),
    "JAX, `jit`, `fori_loop` over the batch, (ds2)": Peer("jax_", "as_printed", 65_536, 100),
    "Numba, `prange` over trajectories, (ds2)": Peer("naive_numba", "final", 16_384, 250),
    "pynamicalsys, `trajectory` of an ensemble, (ds2)": Peer("pynamicalsys_", "final", 2048, 250),
    "NumPy over the batch, (ds2)": Peer("numpy_batch", "final", 4096, 250, threads=False),
    "Python, (ds2)": Peer("python_loop", "final", 64, 1000, threads=False),
}

# One far state by the closed form.
JUMP = {
    "C, `-ffast-math`": Peer("c", "jump", 65_536, 10**6),
    "NumPy over the batch": Peer("numpy_batch", "jump", 65_536, 10**6, threads=False),
}

# The continuous motion after the time of the same steps.
MOTION = {
    "heyoka, Taylor integrator, 16 trajectories at once": Peer("heyoka_", "motion", 4096, 1000),
    "numbalsoda, LSODA, `prange` over trajectories": Peer("numbalsoda_", "motion", 1024, 1000),
    "SciPy, DOP853, all in one system": Peer("scipy_ivp", "stacked", 4096, 1000, threads=False),
    "SciPy, DOP853, one by one": Peer("scipy_ivp", "one_by_one", 8, 1000, threads=False),
}

# All states of the map, into memory that is used again where the library allows it.
STORED = {
    "C, parameter-free, streaming stores": Peer("c", "stored_streaming", 65_536, 256),
    "C, parameter-free, plain stores": Peer("c", "stored", 65_536, 256),
    "Numba, `prange` over trajectories, (ds2)": Peer("naive_numba", "stored", 16_384, 256),
    "JAX, `jit`, `scan` over the batch, parameter-free": Peer("jax_", "stored", 16_384, 256),
    "pynamicalsys, `trajectory` of an ensemble, (ds2)": Peer("pynamicalsys_", "stored", 2048, 256),
    "NumPy over the batch, (ds2)": Peer("numpy_batch", "stored", 16_384, 64, threads=False),
}

# One step in n dimensions: functions of (body, omega0, eps, steps), on one thread.
ND = {
    "C, rank two, 32 trajectories at once": Peer("c", "rank2", 512, 0, threads=False),
    "NumPy, rank two": Peer("numpy_batch", "rank2", 512, 0, threads=False),
    "C, elimination": Peer("c", "eliminate", 512, 0, threads=False),
    "NumPy, `linalg.solve`": Peer("numpy_batch", "solve", 512, 0, threads=False),
}
