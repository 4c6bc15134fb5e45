"""Functions of NumPy with complex symbols: the values of numbers, or an error."""

import itertools
import warnings

import numpy as np
import pytest

from suslov_fast import Field

Z = np.array([0.3 + 0.4j, -1.2 + 0.5j, 0.7 - 0.9j])
OF_STRINGS_AND_FILES = {
    *"array2string array_repr array_str base_repr binary_repr byte_bounds info save savetxt savez "
    "savez_compressed typename".split(),
}


ANSWERED = {
    *"sum mean prod dot vdot inner outer kron trace einsum cumsum convolve correlate roll std var "
    "norm angle real imag conjugate exp log sqrt power arctan arcsinh concatenate stack".split(),
}


def matrix(z):
    return np.stack([z, z[::-1] * 2, z * z])


ARGUMENTS = [
    lambda z: (z,),
    lambda z: (matrix(z),),
    lambda z: (z[0],),
    lambda z: (z, z * z),
    lambda z: (z[0], z[1]),
    lambda z: (matrix(z), z),
    lambda z: (matrix(z), 2 * matrix(z)),
    lambda z: (z, 2),
    lambda z: (z, 1j),
    lambda z: (z, [0, 2]),
    lambda z: (z, [2], -3),
    lambda z: (z, (3, 1)),
    lambda z: (matrix(z), 0, 1),
    lambda z: (0.0, z[0], 3),
    lambda z: (3, z[0]),
    lambda z: (np.array([1.0, 2, 3]), z),
    lambda z: (z, np.array([1.0, 2, 3])),
    lambda z: (np.array([True, False, True]), z, 2 * z),
    lambda z: ("i,i->i", z, 2 * z),
]


def flat(value):
    if isinstance(value, (tuple, list)):
        return [a for each in value for a in flat(each)]
    return np.asarray(value).ravel().tolist()


def functions():
    """Return functions of NumPy that its arrays can override, and its ufuncs."""
    for module in (np, np.linalg, np.fft):
        for name, function in sorted(vars(module).items()):
            is_open = hasattr(function, "_implementation") or isinstance(function, np.ufunc)
            if is_open and not name.startswith("_") and name not in OF_STRINGS_AND_FILES:
                yield pytest.param(function, id=f"{module.__name__}.{name}")


def values_of(function, given):
    """Return the values of a call with numbers; [] if NumPy raises an error, or has no number."""
    try:
        found = [complex(a) for a in flat(function(*given))]
    except (TypeError, ValueError, IndexError, AttributeError, ArithmeticError):
        return []
    return found if np.isfinite(found).all() else []


@pytest.mark.sampled(60)
@pytest.mark.parametrize("function", [*functions()])
def test_a_function_has_the_values_of_numbers_or_an_error(function):
    compared = 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of NumPy, for arguments of all kinds
        for arguments in ARGUMENTS:
            expected = values_of(function, arguments(Z.copy()))
            if not expected:
                continue

            def f(z, arguments=arguments, expected=expected):
                found = flat(function(*arguments(z)))
                assert len(found) == len(expected)
                numbers = [float(a) if isinstance(a, bool) else a for a in found]
                total = sum((k * a for k, a in zip(itertools.count(1), numbers)), 0j)
                return total, 0j, 0j

            try:
                field = Field(f, 3, complex=True)
            except Exception:
                continue
            total = sum(k * a for k, a in zip(itertools.count(1), expected))
            assert field(Z)[0] == pytest.approx(total, rel=1e-10, abs=1e-10)
            compared += 1
    assert compared or function.__name__ not in ANSWERED
