"""Trajectories side by side: a block of up to LANES of them advances together."""

from .._jit import LINE, formula

# In loops over steps 64 lanes lose a quarter to the outer loop; 256 are no faster.
LANES = 128


@formula
def whole(width):
    """Return the number of lanes in use, rounded up to whole vectors."""
    return (width + LINE - 1) // LINE * LINE


@formula
def entry(parameter, b):
    """Return the parameter of trajectory b, which may be one number for all."""
    return parameter[min(b, parameter.size - 1)]


@formula
def body_at(parameters, b):
    """Return I1, I2, I13, I23 and eps of trajectory b."""
    I1, I2, I13, I23, eps = parameters
    return entry(I1, b), entry(I2, b), entry(I13, b), entry(I23, b), entry(eps, b)
