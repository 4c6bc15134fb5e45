"""Parameters far apart, and components in units far apart: results that depend on neither."""

import naive
import numpy as np
import pytest
from mpmath import mpf

import suslov_fast as sf

exactly = np.vectorize(mpf, otypes=[object])


def numbers(rng, spread, shape):
    return 10.0 ** rng.uniform(-spread, spread, shape) * rng.choice([-1.0, 1.0], shape)


def in_units(u, q, l, c, x):
    """Coefficients and a state whose component i is u_i times as large."""
    u, columns = u[..., np.newaxis], u[..., np.newaxis, :]
    q = q * u[..., np.newaxis] / (u * columns)[..., np.newaxis, :, :]
    return q, l * u / columns, c * u[..., 0], x * u[..., 0]


@pytest.mark.parametrize("D", [2, 3, 4])
@pytest.mark.parametrize(("low", "high", "tolerance"), [(-9, -1, 1e-14), (-1, 2, 1e-11)])
def test_components_in_other_units(rng, D, low, high, tolerance):
    q, l, c, x = (rng.normal(size=(400, *(D,) * axes)) for axes in (3, 2, 1, 1))
    u, eps = 2.0 ** rng.integers(-25, 25, (400, D)), 10.0 ** rng.uniform(low, high, 400)
    found = []
    for *field, state in ((q, l, c, x), in_units(u, q, l, c, x)):
        field = sf.QuadraticField(*field)
        exponents = sf.lyapunov_exponents(field, state, eps, 1)
        found.append([sf.jacobian(field, state, eps), sf.step(field, state, eps)])
        found[-1] += sf.matrix(field, state, eps), exponents.sum(axis=-1)
    plain, (derivatives, steps, matrices, sums) = found
    over = u[:, np.newaxis] / u[:, :, np.newaxis]
    for a, b in zip(plain, (derivatives * over, steps / u, matrices * over, sums), strict=True):
        axes = tuple(range(1, a.ndim))
        errors = abs(a - b).max(axis=axes, initial=0.0)
        assert (errors <= tolerance * np.maximum(abs(a).max(axis=axes, initial=0.0), 1.0)).all()


def test_densities_in_other_units(rng):
    """H = x1 x2 x3 in units of momenta and of positions, at states next to no pole."""
    K, units = np.array([[0, 1, -2], [-1, 0, 3], [2, -3, 0]]), 2.0 ** np.array([40, -30, 10])
    x = rng.uniform(0.5, 2, (50, 3))

    def H(v):
        return v[0] * v[1] * v[2] / units.prod() + v[0] ** 2 / units[0] ** 2

    plain = sf.QuadraticField.from_hamiltonian(lambda v: v[0] * v[1] * v[2] + v[0] ** 2, 3, K)
    moved = sf.QuadraticField.from_hamiltonian(H, 3, K * np.multiply.outer(units, units))
    for quantity in (sf.invariant_density, sf.modified_energy):
        expected = quantity(plain, x, 0.3)
        np.testing.assert_allclose(quantity(moved, x * units, 0.3), expected, rtol=1e-12)


@pytest.mark.parametrize("method", ["rank2", "gauss"])
@pytest.mark.parametrize(("m", "size"), [(2, 150), (3, 150), (6, 40)])
def test_steps_in_n_dimensions(rng, m, size, method):
    """The equations hold to 1e-13 of their terms, for J and I up to 1e96 apart each."""
    problems = []
    for _ in range(size):
        spread = rng.choice([1, 4, 20, 48])
        J, I, omega = abs(numbers(rng, spread, m)), *numbers(rng, min(spread, 24), (2, m))
        if rng.random() < 0.5:
            omega = numbers(rng, 0.5, m) / np.sqrt(J)
        I[rng.random(m) < 0.15] = 0.0
        I[0] = I[0] or 1.0
        eps = numbers(rng, rng.choice([0.5, 8]), 1)[0] / (abs(I).max() * abs(omega) / J).max()
        problems.append((J, I, omega, eps))
    J, I, omega, eps = (np.array(each) for each in zip(*problems, strict=True))
    run = sf.iterate(sf.SuslovND(J, I), omega, eps, 1, method=method, on_singular="ignore")
    assert ((run.status < 0) == np.isnan(run.final).any(axis=-1)).all()
    assert (run.status < 0).mean() < 0.05
    for (J, I, omega, eps), final in zip(problems, run.final, strict=True):
        if not np.isnan(final).any():
            J, I, omega, final, (eps,) = map(exactly, (J, I, omega, final, [eps]))
            error = np.abs(naive.dsn(J, I, eps, omega, final))
            p, p_next, q = abs(I) @ abs(omega), abs(I) @ abs(final), abs(omega) @ abs(final)
            terms = J * (abs(omega) + abs(final)) + abs(eps) * (
                abs(I) * q + (p_next * abs(omega) + p * abs(final)) / 2
            )
            assert (error < 1e-13 * terms).all()
