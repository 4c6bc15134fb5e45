"""A multi-valued discretization beside this map.

Fedorov and Zenkov (Nonlinearity 18 (2005) 2211) discretize the body in space after Moser and
Veselov: W_k, the rotation from orientation k to k + 1, is about an axis orthogonal to e3, and

    W_k J - J W_k^T = J W_{k-1} - W_{k-1}^T J + a multiple of e3,    J = tr(I)/2 - I,

determines W_k up to finitely many roots: from (-0.8, 1.3), two with an angle below pi. The root
next to W_{k-1} is followed here. Both maps go from one half of the line of steady states to the
other; no explicit solution of theirs is known. Theirs keeps an energy, the kinetic energy of the
first two components of the discrete momentum; this map keeps the first integral F.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from suslov_fast import Suslov3D, flow, iterate

body, eps, steps = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3, I3=4), 0.5, 120
inertia = np.array([[4, 0, -0.5], [0, 2, -0.3], [-0.5, -0.3, 4]])
J = np.trace(inertia) / 2 * np.eye(3) - inertia


def rotation(omega):
    """Return the rotation by eps omega, about an axis orthogonal to e3."""
    return Rotation.from_rotvec([eps * omega[0], eps * omega[1], 0]).as_matrix()


def momentum(A):
    """Return the first two components of the vector of A - A^T."""
    B = A - A.T
    return np.array([B[2, 1], B[0, 2]])


def following(omega):
    """Return the angular velocity of W_k from that of W_{k-1}: the root next to it."""
    given = momentum(J @ rotation(omega))
    found = root(lambda new: momentum(rotation(new) @ J) - given, omega, tol=1e-13)
    assert abs(found.fun).max() < 1e-11, found.message
    return found.x


starts = np.array([[-1.2, 1.0], [-0.8, 1.3], [-0.5, 1.2]])
roots = [starts]
for _ in range(steps):
    roots.append(np.array([following(omega) for omega in roots[-1]]))
roots = np.array(roots)
kahan = iterate(body, starts, eps, steps).states
motion = flow(body, starts, time=np.linspace(0, eps * steps, 1000)).states

figure, (plane, conserved) = plt.subplots(1, 2, figsize=(8, 3.8), layout="constrained")
line = np.array([[-0.3, 0.3], [0.5, -0.5]]) * 3.4
plane.plot(*line, color="crimson", linewidth=1, label="steady states")
for k in range(len(starts)):
    plane.plot(*motion[:, k].T, color="0.7", label="continuous motion" if k == 0 else None)
    plane.plot(*kahan[:, k].T, "k.", markersize=4, label="this map" if k == 0 else None)
    name = "Fedorov and Zenkov, one root" if k == 0 else None
    plane.plot(*roots[:, k].T, "o", color="tab:blue", markersize=4, fillstyle="none", label=name)
plane.set(xlabel=r"$\Omega_1$", ylabel=r"$\Omega_2$", ylim=(-2.4, 2.7))
plane.set_title(rf"three orbits of both maps, $\epsilon$ = {eps}")
plane.legend(fontsize=7, loc="upper center", ncols=2)


def momentum_energy(omega):
    """Return the kinetic energy of the first two components of W J - J W^T, per eps squared."""
    M = momentum(rotation(omega) @ J)
    return (M[0] ** 2 / body.I1 + M[1] ** 2 / body.I2) / (2 * eps**2)


reduced = np.array([momentum_energy(omega) for omega in roots[:, 0]])
for name, values, look in (
    ("this map: first integral F", body.first_integral(kahan[:, 0], eps), "k-"),
    ("this map: energy", body.energy(kahan[:, 0]), "k--"),
    ("Fedorov and Zenkov: energy of the momentum", reduced, "C0-"),
    ("Fedorov and Zenkov: energy", body.energy(roots[:, 0]), "C0--"),
):
    change = np.maximum(abs(values / values[0] - 1), 1e-16)
    width = 1 if look.startswith("k") else 2.5
    conserved.semilogy(change, look, linewidth=width, label=name)
conserved.set(
    xlabel="step",
    ylabel="relative change",
    title="quantities of the outer orbit",
    ylim=(3e-17, 1e6),
)
conserved.legend(fontsize=7, loc="upper right")
