"""pynamicalsys: ensembles of a discrete map."""

import functools

import formulas
import numba
import numpy as np
from pynamicalsys import DiscreteDynamicalSystem

_step = numba.njit(formulas.step_as_printed)


@numba.njit
def _mapping(u, parameters):
    return np.array(_step(u[0], u[1]))


@functools.cache
def _system():
    return DiscreteDynamicalSystem(mapping=_mapping, system_dimension=2, number_of_parameters=0)


def final(omega0, steps, threads):
    """The map as printed; all states but the last count as transient."""
    return _system().trajectory(omega0, steps, transient_time=steps - 1)
