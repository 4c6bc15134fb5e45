"""Scattering angles of bodies."""

from .._formulas.elementary import scaled
from .._formulas.scattering import scattering_angle
from .._formulas.units import normal_body
from .._jit import inner, kernel, share


@inner
def scatter_one(i, parameters, out):
    """Fill the angle of a body."""
    I1, I2, I13, I23, _, M, P, _ = normal_body(
        parameters[0][i], parameters[1][i], parameters[2][i], parameters[3][i], 1.0
    )
    out[i] = scattering_angle(I1, I2, I13, I23, scaled(1.0, M - P))


@kernel
def scatter(part, parts, parameters, out):
    """Fill the angles (B,) of bodies, four arrays (B,)."""
    first, last = share(len(out), part, parts)
    for i in range(first, last):
        scatter_one(i, parameters, out)
