"""The loop over bodies of their scattering angle."""

from numba import prange

from ..formulas.scattering import scattering_angle
from ..jit import Loop
from ..staged import staged

# What an angle costs, in steps of the map.
WORK = 100


@staged
def scatter_one(i, I1, I2, I13, I23, unit, out):
    """What `scatter` does for one body."""
    out[i] = scattering_angle(I1[i], I2[i], I13[i], I23[i], unit[i])


def _scatter(I1, I2, I13, I23, unit, out):
    """Angles (B,) of B bodies."""
    for i in prange(out.size):
        scatter_one(i, I1, I2, I13, I23, unit, out)


scatter = Loop(_scatter)
