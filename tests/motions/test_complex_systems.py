"""Systems of physics with complex variables, beside exact solutions, exponentials and NumPy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from suslov_fast import Field, Map, flow, iterate

T = np.array([0.0, 0.4, 1.7, 3.0])


def linear(A, z0):
    """Return a linear system, its initial state, and its exact states."""
    return lambda z: A @ z, z0, [expm(t * A) @ z0 for t in T]


def by_parts(f, z0):
    """Return a system, its initial state, and its states by SciPy."""
    n = len(z0)

    def real(_, y):
        rates = np.array(f(y[:n] + 1j * y[n:]))
        return [*rates.real, *rates.imag]

    y0, options = [*np.real(z0), *np.imag(z0)], {"rtol": 1e-13, "atol": 1e-14}
    y = solve_ivp(real, (0, T[-1]), y0, "DOP853", T, **options).y
    return f, z0, (y[:n] + 1j * y[n:]).T


def bloch_redfield():  # rho_ee, rho_eg: decay 0.3, dephasing 0.5, detuning 1.2, drive 0.8
    def f(z):
        excited, coherence = z
        flux = 0.4j * (coherence - np.conj(coherence))
        return flux - 0.3 * excited, -(0.5 + 1.2j) * coherence + 0.4j * (2 * excited - 1)

    # the same equations of rho_ee and the parts of rho_eg
    A = np.array([[-0.3, 0, -0.8], [0, -0.5, 1.2], [0.8, -1.2, -0.5]])
    rest = -np.linalg.solve(A, [0, 0, -0.4])
    states = [rest + expm(t * A) @ (np.array([1.0, 0, 0]) - rest) for t in T]
    return f, [1 + 0j, 0j], [[e, a + 1j * b] for e, a, b in states]


def order_parameter():  # Ott and Antonsen: |z|**2 is logistic
    K, width, omega, r0 = 3.0, 0.5, 2.0, 0.1
    rate, limit = K - 2 * width, 1 - 2 * width / K
    square = limit / (1 + (limit / r0**2 - 1) * np.exp(-rate * T))

    def f(z):
        return (1j * omega - width) * z + K / 2 * (z - abs(z) ** 2 * z)

    return f, [r0 + 0j], (np.sqrt(square) * np.exp(1j * omega * T))[:, np.newaxis]


def ablowitz_ladik():  # a soliton on a lattice of 41 sites, with width 1/mu and wave number k
    n, mu, k = np.arange(-20, 21), 1.0, 0.7

    def soliton(t):
        speed = 2 * np.sinh(mu) * np.sin(k) / mu
        phase = k * n + 2 * np.cosh(mu) * np.cos(k) * t
        return np.sinh(mu) / np.cosh(mu * (n - speed * t)) * np.exp(1j * phase)

    def f(z):
        ends = np.zeros_like(z[:1])
        near = np.concatenate([z[1:], ends]) + np.concatenate([ends, z[:-1]])
        return 1j * near * (1 + abs(z) ** 2)

    return f, soliton(0), [soliton(t) for t in T]


def transmission_line():  # voltage and current along a line
    series, shunt = 0.2 + 1.5j, 0.1 + 0.9j
    return linear(np.array([[0, -series], [-shunt, 0]]), np.array([1.0, 0.5j]))


def driven_cavity():
    decay, drive = 0.25 + 1.3j, 0.7
    a = drive / decay * (1 - np.exp(-decay * T))
    return lambda a: -decay * a + drive, [0j], a[:, np.newaxis]


def stuart_landau():  # with shear: the modulus is logistic, and the phase its integral
    mu, omega, shear, r0 = 0.8, 1.3, 0.6, 0.3
    square = mu / (1 + (mu / r0**2 - 1) * np.exp(-2 * mu * T))
    integral = np.log(np.exp(2 * mu * T) - 1 + mu / r0**2) / 2 - np.log(mu / r0**2) / 2
    phase = omega * T - shear * integral

    def f(z):
        return (mu + 1j * omega) * z - (1 + 1j * shear) * abs(z) ** 2 * z

    return f, [r0 + 0j], (np.sqrt(square) * np.exp(1j * phase))[:, np.newaxis]


def vortices(n):
    z0 = np.exp(2j * np.pi * np.arange(n) / n) * np.linspace(1, 1.3, n)
    strengths = np.linspace(1, 2, n)

    def f(z):
        sums = [sum(strengths[j] / (z[i] - z[j]) for j in range(n) if j != i) for i in range(n)]
        return [np.conj(a / (2j * np.pi)) for a in sums]

    return by_parts(f, z0)


def three_waves():
    return by_parts(
        lambda a: (1j * np.conj(a[1]) * a[2], 1j * np.conj(a[0]) * a[2], 1j * a[0] * a[1]),
        [1 + 0.2j, 0.5j, 0.7 + 0j],
    )


def ginzburg_landau():
    x = 2 * np.pi * np.arange(64) / 64

    def f(z):
        bend = (np.roll(z, 1) - 2 * z + np.roll(z, -1)) * 4.0
        return z + (1 + 0.5j) * bend - (1 - 1.2j) * abs(z) ** 2 * z

    return by_parts(f, 0.5 * np.exp(1j * x) + 0.1 * np.cos(2 * x))


def schroedinger(is_dense):
    x = np.linspace(-8, 8, 128)
    h = x[1] - x[0]
    bend = (np.eye(128, k=1) - 2 * np.eye(128) + np.eye(128, k=-1)) / h**2
    H = -0.5 * bend + np.diag(0.5 * x**2)
    psi = np.exp(-((x - 1) ** 2) + 2j * x)
    exact = [expm(-1j * t * H) @ psi for t in T]
    if is_dense:
        return lambda z: -1j * (H @ z), psi, exact

    def f(z):
        ends = np.zeros_like(z[:1])
        near = np.concatenate([z[1:], ends]) + np.concatenate([ends, z[:-1]])
        return -1j * (-0.5 * (near - 2 * z) / h**2 + 0.5 * x**2 * z)

    return f, psi, exact


SYSTEMS = {
    "Stuart and Landau": stuart_landau,
    "3 vortices": lambda: vortices(3),
    "4 vortices": lambda: vortices(4),
    "three waves": three_waves,
    "Ginzburg and Landau": ginzburg_landau,
    "Schroedinger": lambda: schroedinger(False),
    "Schroedinger, dense": lambda: schroedinger(True),
    "Lorenz and Haken": lambda: by_parts(
        lambda s: (
            3 * (s[1] - s[0]), s[0] * s[2] - s[1],
            -0.3 * (s[2] - 4 + (np.conj(s[0]) * s[1]).real),
        ),
        [0.5 + 0.1j, 0.2j, 1 + 0j],
    ),
    "Rabi": lambda: linear(-1j * np.array([[0.3, 0.5], [0.5, -0.3]]), np.array([1.0 + 0j, 0])),
    "Bloch and Redfield": bloch_redfield,
    "Ott and Antonsen": order_parameter,
    "Ablowitz and Ladik": ablowitz_ladik,
    "transmission line": transmission_line,
    "driven cavity": driven_cavity,
    "Jones vectors": lambda: linear(1j * np.array([[1.0, 0.3j], [-0.3j, 2.0]]), np.array([1, 1j])),
    "Jaynes and Cummings": lambda: linear(
        -1j * np.array([[0.2, 0.5 * np.sqrt(3)], [0.5 * np.sqrt(3), -0.2 - 0.1j]]),
        np.array([1.0 + 0j, 0]),
    ),
    "complex Lorenz": lambda: by_parts(
        lambda s: (
            2 * (s[1] - s[0]), (8 + 0.5j) * s[0] - (1 - 0.3j) * s[1] - s[0] * s[2].real,
            -0.8 * s[2] + (np.conj(s[0]) * s[1]).real,
        ),
        [1 + 0.5j, 0.2j, 1 + 0j],
    ),
    "FitzHugh and Nagumo, v + i w": lambda: by_parts(
        lambda z: (
            z[0].real - z[0].real ** 3 / 3 - z[0].imag + 0.5
            + 1j * 0.08 * (z[0].real + 0.7 - 0.8 * z[0].imag),
        ),
        [-1 + 1j],
    ),
    "Moebius": lambda: (
        lambda z: 1 + z**2, [0.3j], (np.tan(T + np.arctan(0.3j)))[:, np.newaxis],
    ),
    "1/z": lambda: (lambda z: 1j / z, [1 + 1j], np.sqrt(2j * T + 2j)[:, np.newaxis]),
}  # fmt: skip


@pytest.mark.slow_cases("Ginzburg and Landau", "Schroedinger", "Schroedinger, dense")
@pytest.mark.parametrize("name", SYSTEMS)
def test_solutions(name):
    f, z0, expected = SYSTEMS[name]()
    motion = flow(Field(f, len(z0), complex=True), z0, time=T, rtol=1e-11)
    atol = 1e-7 if name == "Ablowitz and Ladik" else 1e-9  # the soliton meets the lattice's end
    np.testing.assert_allclose(motion.states, expected, rtol=1e-8, atol=atol)


def test_landau_and_zener():
    """The probability to stay, for a sweep from -60 to 60, differs by the order of 1/60."""
    f = Field(lambda t, z: (-0.5j * t * z[0] - 0.3j * z[1], 0.5j * t * z[1] - 0.3j * z[0]), 2,
              complex=True)  # fmt: skip
    run = flow(f, [1, 0], time=120.0, t0=-60.0)
    assert abs(run.final[0]) ** 2 == pytest.approx(np.exp(-2 * np.pi * 0.3**2), abs=0.02)
    assert (abs(run.final) ** 2).sum() == pytest.approx(1, abs=1e-7)


def test_maps_of_ikeda_and_julia_are_those_of_numpy():
    def ikeda(z):
        return 0.9 + 0.8 * z * np.exp(1j * (0.4 - 6 / (1 + abs(z) ** 2)))

    z = np.array([0.3 + 0.1j, -0.5 + 1j, 1.2 - 0.7j])
    run = iterate(Map(lambda s: (ikeda(s[0]),), "z", complex=True), z[:, np.newaxis], steps=5)
    expected = [z := ikeda(z) for _ in range(5)]
    np.testing.assert_allclose(run["z"][1:], expected, rtol=1e-11)

    def julia(s):
        z, count = s
        is_in = abs(z) <= 2
        return np.where(is_in, z**2 - 0.8 + 0.156j, z), count + np.where(is_in, 1, 0)

    z = np.linspace(-1.5, 1.5, 40) + 1j * np.linspace(-1.2, 1.2, 25)[:, np.newaxis]
    starts = np.stack([z, 0 * z], axis=-1)
    counts = iterate(Map(julia, "z n", complex="z"), starts, steps=60).final[..., 1].real
    expected = np.zeros(z.shape)
    for _ in range(60):
        is_in = abs(z) <= 2
        expected += is_in
        z = np.where(is_in, z**2 - 0.8 + 0.156j, z)
    assert (counts == expected).mean() > 0.99
