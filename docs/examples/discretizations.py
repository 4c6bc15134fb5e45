"""Five ways to compute one motion.

The map of this package, Runge-Kutta 4, the implicit midpoint rule, a variational nonholonomic
integrator and the exact flow, on one realizable body. Numba compiles all steps with the
same options; each computes one orbit. The figure shows the largest error on the way from one
steady rotation to the other against the processor time; the page "Which discretization?" has the
printed tables.
"""

import time

import matplotlib.pyplot as plt
import numba
import numpy as np

from suslov_fast import Suslov3D, flow

body, omega0, duration = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), np.array([-0.9, 1.3]), 30.0
I1, I2, I13, I23 = body.I1, body.I2, body.I13, body.I23
compiled = numba.njit(error_model="numpy")


@compiled
def field(u, v):
    x = I13 * u + I23 * v
    return -x * v / I1, x * u / I2


@compiled
def kahan(u, v, eps):
    """Solve the 2 x 2 system of the map."""
    p, q = 0.5 * eps / I1, 0.5 * eps / I2
    a11, a12 = 1 + p * I13 * v, p * (I13 * u + 2 * I23 * v)
    a21, a22 = -q * (2 * I13 * u + I23 * v), 1 - q * I23 * u
    d = a11 * a22 - a12 * a21
    return (a22 * u - a12 * v) / d, (a11 * v - a21 * u) / d


@compiled
def runge_kutta_4(u, v, eps):
    k1, l1 = field(u, v)
    k2, l2 = field(u + 0.5 * eps * k1, v + 0.5 * eps * l1)
    k3, l3 = field(u + 0.5 * eps * k2, v + 0.5 * eps * l2)
    k4, l4 = field(u + eps * k3, v + eps * l3)
    return u + eps * (k1 + 2 * (k2 + k3) + k4) / 6, v + eps * (l1 + 2 * (l2 + l3) + l4) / 6


@compiled
def midpoint(u, v, eps):
    """Solve the implicit equation for the midpoint by Newton's method."""
    w, z, h = u, v, 0.5 * eps
    for _ in range(20):
        f, g = field(w, z)
        r, s = w - u - h * f, z - v - h * g
        a11, a12 = 1 + h * I13 * z / I1, h * (I13 * w + 2 * I23 * z) / I1
        a21, a22 = -h * (2 * I13 * w + I23 * z) / I2, 1 - h * I23 * w / I2
        d = a11 * a22 - a12 * a21
        dw, dz = (a22 * r - a12 * s) / d, (a11 * s - a21 * r) / d
        w, z = w - dw, z - dz
        if abs(dw) + abs(dz) < 1e-12:
            break
    return 2 * w - u, 2 * z - v


@compiled
def variational(u, v, eps):
    """Solve G(next; eps) = G(omega; -eps), the discrete Lagrange-d'Alembert equation."""
    h = 0.5 * eps
    x, e = I13 * u + I23 * v, h * h * (I1 * u * u + I2 * v * v)
    right1, right2 = (I1 + e) * u - h * x * v, (I2 + e) * v + h * x * u
    for _ in range(20):
        x, e = I13 * u + I23 * v, h * h * (I1 * u * u + I2 * v * v)
        r, s = (I1 + e) * u + h * x * v - right1, (I2 + e) * v - h * x * u - right2
        a11 = I1 + e + 2 * h * h * I1 * u * u + h * I13 * v
        a12 = 2 * h * h * I2 * u * v + h * (x + I23 * v)
        a21 = 2 * h * h * I1 * u * v - h * (x + I13 * u)
        a22 = I2 + e + 2 * h * h * I2 * v * v - h * I23 * u
        d = a11 * a22 - a12 * a21
        du, dv = (a22 * r - a12 * s) / d, (a11 * s - a21 * r) / d
        u, v = u - du, v - dv
        if abs(du) + abs(dv) < 1e-12:
            break
    return u, v


def orbit_of(step):
    @compiled
    def orbit(omega, eps, steps):
        states = np.empty((steps + 1, 2))
        states[0] = omega
        u, v = omega
        for n in range(steps):
            u, v = step(u, v, eps)
            states[n + 1, 0], states[n + 1, 1] = u, v
        return states

    return orbit


methods = {
    "this map (Kahan)": orbit_of(kahan),
    "Runge-Kutta 4": orbit_of(runge_kutta_4),
    "implicit midpoint": orbit_of(midpoint),
    "variational, Cayley": orbit_of(variational),
}


def best_time(function, *arguments, repeats=7):
    function(*arguments)
    return min(
        -time.perf_counter() + (function(*arguments), time.perf_counter())[1]
        for _ in range(repeats)
    )


def drift(values):
    return abs(values / values[0] - 1).max()


def energy_and_integral(states, eps):
    u, v = states.T
    double_energy = I1 * u**2 + I2 * v**2
    return double_energy, double_energy / (4 * I1 * I2 + eps**2 * (I13 * u + I23 * v) ** 2)


def largest_error(orbit, steps):
    """Largest distance from the exact motion at the same time, until time 30."""
    times = np.linspace(0, duration, steps + 1)
    return np.hypot(
        *(orbit(omega0, duration / steps, steps) - flow(body, omega0, time=times).states).T
    ).max()


_, final = body.limits(omega0, 1e-9)

# %%
# Properties at the step 0.5: the order of the largest error until time 30, and this error; the
# largest relative change of the energy and of the first integral F of the map until time 400; the
# distance from the start after 24 steps and 24 steps back; the distance of the last state from the
# limit of the motion.

eps = 0.5
print(f"{'':20s} order    error   energy        F     back    limit")
for name, orbit in methods.items():
    errors = [largest_error(orbit, n) for n in (60, 480, 960)]
    states = orbit(omega0, eps, 800)
    E, F = energy_and_integral(states, eps)
    back = orbit(orbit(omega0, eps, 24)[-1], -eps, 24)[-1] - omega0
    print(
        f"{name:20s} {np.log2(errors[1] / errors[2]):5.1f} {errors[0]:8.0e} {drift(E):8.0e}"
        f" {drift(F):8.0e} {np.hypot(*back):8.0e} {np.hypot(*(states[-1] - final)):8.0e}"
    )

# %%
# The largest step among 1/4, 1/2, ..., 256 with which the orbit ends on the attracting half of the
# line of steady states.

for name, orbit in methods.items():
    largest = 0.0
    for candidate in 2.0 ** np.arange(-2, 9):
        u, v = orbit(omega0, candidate, 4000)[-1]
        ends = abs(I13 * u + I23 * v) < 1e-6 * np.hypot(u, v) and I23 * I1 * u - I13 * I2 * v < 0
        largest = candidate if ends else largest
    print(f"{name:20s} {largest:g}")

# %%
# Processor time of a step, and the largest error for the cost of 1000 steps of the map.

seconds = {
    name: best_time(orbit, omega0, 0.001, 20_000) / 20_000 for name, orbit in methods.items()
}
budget = 1000 * seconds["this map (Kahan)"]
figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
for (name, orbit), marker in zip(methods.items(), "os^v", strict=True):
    affordable = round(budget / seconds[name])
    error = largest_error(orbit, affordable)
    print(f"{name:20s} {1e9 * seconds[name]:5.0f} ns {affordable:5d} steps: error {error:.0e}")
    counts = 2 ** np.arange(6, 16)
    errors = [largest_error(orbit, n) for n in counts.tolist()]
    axes.loglog(1e6 * counts * seconds[name], errors, marker + "-", fillstyle="none", label=name)
many = np.tile(omega0, (20_000, 1))
state = best_time(lambda: flow(body, many, time=duration, threads=1)) / len(many)
print(f"{'exact flow':20s} {1e9 * state:5.0f} ns a state")
axes.set(xlabel="processor time (microseconds)", ylabel="largest error until time 30")
axes.set_title("error and cost of one orbit of 64 to 32,768 steps")
axes.legend(frameon=False)
