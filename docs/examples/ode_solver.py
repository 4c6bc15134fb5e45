"""
Comparison with an ODE solver
=============================

Continuous motion by SciPy's DOP853 at several tolerances and by the map at several step sizes: the
error at time 40 against the number of evaluations of the vector field, or steps of the map. The
exact motion is :func:`~suslov_fast.flow`. The solver has the higher order; a step of the map is
cheaper.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

from suslov_fast import Suslov3D, flow, iterate, vector_field

body, omega0, time = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), [-0.9, 1.3], 40.0
end = flow(body, omega0, time)

calls, errors = [], []
for tolerance in 10.0 ** -np.arange(3, 13):
    solution = solve_ivp(
        lambda _, omega: vector_field(body, omega),
        (0, time),
        omega0,
        method="DOP853",
        rtol=tolerance,
        atol=tolerance,
    )
    calls.append(solution.nfev)
    errors.append(np.hypot(*(solution.y[:, -1] - end)))
steps = [2**k for k in range(5, 20, 2)]
of_map = [
    np.hypot(*(iterate(body, omega0, time / n, n, save_every=None).final - end)) for n in steps
]

figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
axes.loglog(calls, errors, "s-", color="steelblue", label="DOP853, evaluations")
axes.loglog(steps, of_map, "o-", color="black", label="the map, steps")
axes.set(xlabel="evaluations or steps", ylabel="error at time 40")
axes.legend(frameon=False, loc="upper right")
