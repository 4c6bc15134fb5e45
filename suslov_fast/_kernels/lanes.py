"""Trajectories side by side: a block of up to LANES of them advances together."""

from .._jit import LINE, formula

# In loops over steps 64 lanes lose a quarter to the outer loop; 256 are no faster.
LANES = 128


@formula
def whole(width):
    """Return the number of lanes in use, rounded up to whole vectors."""
    return (width + LINE - 1) // LINE * LINE


@formula
def entry(parameter, i):
    """Return the parameter of trajectory i, which may be one number for all."""
    return parameter[min(i, parameter.size - 1)]


@formula
def body_at(parameters, i):
    """Return I1, I2, I13, I23 and eps of trajectory i."""
    I1, I2, I13, I23, eps = parameters
    return entry(I1, i), entry(I2, i), entry(I13, i), entry(I23, i), entry(eps, i)


@formula
def all_share(parameters):
    """Return True if each parameter is one number for all trajectories."""
    shared = True
    for k in range(len(parameters)):
        shared &= parameters[k].size == 1
    return shared


@formula
def spread(parameter, first, width, lanes):
    """Fill lanes with the parameter of `width` trajectories, or the one of all."""
    if parameter.size == 1:
        for l in range(width):
            lanes[l] = parameter[0]
    else:
        # LLVM knows that indices from 0 on are not negative.
        numbers = parameter[first : first + width]
        for l in range(width):
            lanes[l] = numbers[l]
