"""Runs of each kind: of bodies, fields and methods, that fail, with orientations, empty."""

import numpy as np

import suslov_fast as sf

BODY = sf.Suslov3D(4, 1, -0.5, -0.3)
FOUR = sf.SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
GYROSTAT = sf.Suslov3D(2.3, 1.4, 0.5, -0.7, [0.0, 0.9, 1.8])
LOTKA = sf.Field(lambda x, a: (x[0] * (1 - a * x[1]), x[1] * (x[0] - 1)), 2, a=[1, 2, 3])
HENON = sf.Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 + x[0] ** 2 / 2 - x[0] ** 3, 2)
THIRDS = sf.Field(lambda x, rho: (x[0] / 3 - rho * x[0] ** 2,), 1, rho=2)
STARTS = np.random.default_rng(3).normal(size=(5, 2))
RUNS = {
    "batch": (BODY, STARTS, 0.2, 20, {"save_every": 5}),
    "one": (BODY, STARTS[0], -0.2, 3, {}),
    "last": (BODY, STARTS, [0.1, 0.2, 0.3, 0.4, 0.5], 7, {"save_every": None, "attitude": True}),
    "turning": (BODY, STARTS, 0.2, 7, {"save_every": 5, "attitude": True}),
    "empty": (BODY, np.empty((2, 0, 2)), np.full((2, 1), 0.1), 3, {}),
    "failed": (sf.Suslov3D(1, 1, 1, 0), [[np.nan, 0.0], [1.0, -3.0], [0.3, 0.1]], 1, 5, {}),
    "four": (FOUR, [0.3, 0.9, -0.6], 0.4, 6, {"method": "gauss", "attitude": True}),
    "gyrostat": (GYROSTAT, STARTS[:3], 0.35, 6, {"save_every": 4}),
    "field": (LOTKA, [0.5, 0.7], 0.125, 6, {}),
    "hamiltonian": (HENON, [0.1, 0.05], 0.1, 6, {"save_every": 2}),
    "exact field": (THIRDS, [0.1], 0.1, 3, {}),
}


def run_of(name):
    *problem, options = RUNS[name]
    return sf.iterate(*problem, on_singular="ignore", **options)
