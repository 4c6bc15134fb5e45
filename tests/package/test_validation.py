"""One table of bad calls: what is raised, and the name of the argument that the message has.

A row is (call, exception, name), or a pattern of the name and the advice: words are free. Calls that
compile kernels before they fail are in other files: this one, the longest, runs first, while another
process compiles them.
"""

import inspect
import json
import math
import pickle
import re
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
import sympy
import xarray
from numba import njit
from pandas import NA, DataFrame, Series
from scipy.interpolate import interp1d

import suslov_fast as sf
from suslov_fast import QuadraticField, Suslov3D, SuslovGyrostat, SuslovND, checks

NAN, INF, ID = float("nan"), float("inf"), np.eye(3)
OMEGA, ONES = [[1.0, 0.5], [0.2, 0.3]], np.ones((4, 2))
BODY, ND = Suslov3D(4, 1, -0.5, -0.3), SuslovND([1, 2, 3], [1, 1, 1])
ROTOR = SuslovGyrostat(4, 1, -0.5, -0.3, 0.9)
BATCH = Suslov3D([[4.0], [2.0]], [1, 2, 3], -0.5, -0.3)
FIELD = QuadraticField([[[0, 1], [0, 0]], [[0, 0], [0, -1]]])
FAMILY = QuadraticField.from_function(lambda x, rho: (rho - x[0] ** 2,), 1, rho=[10, 20, 30])
HENON = QuadraticField.from_hamiltonian(lambda x: x[1] ** 2 / 2 + x[0] ** 3, 2)
LIFTED = sf.Field.from_function(lambda x: (x[1], -np.sin(x[0])), 2)
LISTS = {"indices": [[0], [0], [2]], "values": [1.0]}


def body(**given):
    return lambda: Suslov3D(**{"I1": 4, "I2": 1, "I13": -0.5, "I23": -0.3, **given})


def rotor(**given):
    return lambda: SuslovGyrostat(**{"I1": 4, "I2": 1, "I13": -0.5, "I23": -0.3, "k": 1, **given})


def field(f, dimension=2, **parameters):
    return lambda: QuadraticField.from_function(f, dimension, **parameters)


def interpolated(x):
    return interp1d([0, 1], [0, 1])(x[0]), x[1]


def hamiltonian(H, dimension=2, *K, **parameters):
    return lambda: QuadraticField.from_hamiltonian(H, dimension, *K, **parameters)


def inertia(I, a=(0, 0, 1)):
    return lambda: Suslov3D.from_inertia(I, a)


def changed(field=FIELD, **entries):
    return lambda: QuadraticField.from_dict(field.to_dict() | entries)


def run(**given):
    """`iterate` with some arguments replaced; an array `out` is not changed by a bad call."""
    arguments = {"body": BODY, "omega0": OMEGA, "eps": 0.2, "steps": 3, **given}
    body, omega0 = arguments.pop("body"), arguments.pop("omega0")
    return lambda: sf.iterate(body, omega0, **arguments)


def crossings(surface):
    return lambda: sf.crossings(BODY, OMEGA, 0.2, 3, surface)


BODIES = [
    (body(I2=[1, 2, -3]), ValueError, "I2"), (body(I13=[1, INF]), ValueError, "I13"),
    (body(I23=1j), TypeError, "I23"), (body(I23="0.3"), TypeError, "I23.* text: pass numbers"),
    (rotor(k=None), TypeError, "k .*, not None"), (body(I1=[4, True]), TypeError, "I1"),
    (body(I1=[1, 2], I2=[1, 2, 3]), ValueError, "I2"), (body(I1=1e51), ValueError, "I1"),
    (body(I3=9e-51), ValueError, "I3"), (rotor(k=[1, 1e-70]), ValueError, "k"),
    (lambda: SuslovND([1, 2], [1, 2, 3]), ValueError, "J and I"),
    (lambda: SuslovND([1, 0], [1, 2]), ValueError, "J"),
    (lambda: SuslovND([1, 1e61], [1, 2]), ValueError, "J"),
    (lambda: SuslovND.from_mass_tensor(np.diag([1.0, 2.0, -0.1]), [1, 2, 3]), ValueError, "I"),
    (lambda: SuslovND.from_mass_tensor(ID, [1, 2]), ValueError, "a"),
    (inertia(np.eye(2)), ValueError, "I"), (inertia(ID, [0, 1]), ValueError, "a"),
    (inertia(ID, [0, 0, 0]), ValueError, "a"), (inertia(np.triu(np.ones((3, 3)))), ValueError, "I"),
    (inertia(np.diag([1, 1, 1e-17]), [1, 2, 3]), ValueError, "I"),
    (inertia(np.diag([1, 2, 4])), ValueError, "I"),
    (lambda: len(BODY), TypeError, "body"), (lambda: BODY[0], TypeError, "body"),
    (lambda: BATCH["a"], TypeError, "index"), (lambda: BATCH[2], IndexError, "index"),
    (lambda: BATCH[1, 3], IndexError, "index"), (lambda: BATCH[0, 0, 0], IndexError, "index"),
    (lambda: BATCH[[True]], IndexError, "index"), (lambda: BATCH[None], TypeError, "index"),
    (lambda: BATCH[True], IndexError, "index"), (lambda: BATCH[[[0]]], IndexError, "index"),
    (lambda: BATCH.sel(I13=-0.5), ValueError, "I13 is -0.5 for all members; .*: I1, I2"),
    (lambda: BODY.sel(I1=4), ValueError, "this is a single Suslov3D"), (lambda: FAMILY.sel(r=20), ValueError, "no parameter 'r'; choose from: rho"),
    (lambda: BATCH.sel(I2=slice(1, 2, 1)), ValueError, "I2"),
    (lambda: BATCH.sel(I2=slice(1, 2), method="nearest"), ValueError, "I2"),
    (lambda: BATCH.sel(I2=slice("a")), TypeError, "I2"),
    (lambda: BATCH.sel(I2=2.5), ValueError, "I2"), (lambda: BATCH.sel(I2=[1, 2]), ValueError, "I2"),
    (lambda: BATCH.sel(I2=2, method="pad"), ValueError, "method"),
    (lambda: FAMILY.sel(rho=21), ValueError, "rho"),
    (lambda: Suslov3D.from_dict({"body": "Suslov3D", "I1": 4, "I2": 1}), ValueError, "I13"),
    (lambda: Suslov3D.from_dict({**BODY.to_dict(), "mass": 3}), ValueError, "mass"),
    (lambda: Suslov3D.from_dict(ROTOR.to_dict()), ValueError, "body"),
    (lambda: sf.body_from_dict(json.dumps(BODY.to_dict())), TypeError, r"parameters.*json.loads"),
    (lambda: Suslov3D.from_dict("body.json"), TypeError, r"parameters.*json.loads"),
    (lambda: sf.body_from_dict({"body": "Unknown"}), ValueError, "body"),
    (lambda: sf.body_from_dict([1, 2]), TypeError, "parameters must be a dictionary, not list"),
    (lambda: sf.body_from_dict({"body": "QuadraticField", "quadratic": [[["1e99999999"]]]}), ValueError, "quadratic"),
    (lambda: QuadraticField([[[Decimal("1e99999999")]]]), ValueError, "quadratic"),
    (lambda: QuadraticField([[[Decimal("1e-99999999")]]]), ValueError, "quadratic"),
]  # fmt: skip

FIELDS = [
    (lambda: FAMILY[0](0.0, [1.0]), TypeError, r"lambda t, x: field\(x\)"),
    (crossings(lambda x: None), TypeError, "surface .* None: return a value"),
    (lambda: QuadraticField(ID), ValueError, r"quadratic.*lambda x: A @ x, 3"),
    (lambda: sf.iterate(FIELD, [0.1, 0.2], 0.1, 1).to_xarray("a"), ValueError, "dims must be left out"),
    (lambda: QuadraticField([[1, 2], [3, 4]]), ValueError, "quadratic"),
    (lambda: QuadraticField(lambda x: x), TypeError, r"quadratic.*from_function"),
    (lambda: QuadraticField([[["1"]]]), TypeError, "quadratic"),
    (lambda: QuadraticField(np.full((2, 1, 1, 1), NAN)), ValueError, "quadratic"),
    (lambda: QuadraticField([[[10**400]]]), ValueError, "quadratic"),
    (lambda: QuadraticField([[[1]]], [[Fraction(1, 10**61)]]), ValueError, "linear"),
    (lambda: QuadraticField([[[1]]], [1, 2]), ValueError, "linear"),
    (lambda: QuadraticField(np.ones((2, 1, 1, 1)), np.ones((3, 1, 1))), ValueError, "linear"),
    (lambda: QuadraticField.of(3), TypeError, "body"), (lambda: FIELD([1, 2, 3]), ValueError, "x"),
    (lambda: FIELD([True, 1]), TypeError, "x"), (lambda: HENON.H([1, 2, 3]), ValueError, "x"),
    (changed(values=["a", 1]), ValueError, "p/q"), (changed(q=1), ValueError, "q"),
    (changed(values=["1/0", 1]), ValueError, "p/q"),
    (changed(dimension=0), ValueError, "dimension"), (changed(dimension=1), ValueError, "indices"),
    (changed(HENON, H={**LISTS, "indices": [[0], [1], [3]]}), ValueError, "H.* 0 to 2"),
    (changed(HENON, H={**LISTS, "values": [1, 2]}), ValueError, "H.*one for each term"),
    (changed(HENON, H={**LISTS, "values": [[1e70]]}), ValueError, "H.*other units"),
    (changed(HENON, H={"values": [1.0]}), ValueError, "H must have the entries"),
    (changed(HENON, H=[1.0]), TypeError, "H"), (changed(HENON, body="Suslov3D"), ValueError, "body"),
    (changed(HENON, K=[[0, 2], [2, 0]]), ValueError, "K"), (changed(HENON, k=1), ValueError, "k"),
    (changed(HENON, K={"indices": [[0], [2]], "values": [1]}), ValueError, "K.* 0 to 1"),
    (changed(HENON, K={"indices": [[0], [1]], "values": [1]}), ValueError, "K.*antisymmetric"),
    (changed(HENON, values=[1.0, 0.0]), ValueError, "parameters"),
    (changed(HENON, parameters={"x": 1.0}), ValueError, "parameters"),
    (field(lambda x: (x[0] * x[1], x[0]), 3), ValueError, "f"),
    (field(lambda x: (x[0] * x[2], x[0])), ValueError, r"f: x\[2\] is used, but the dimension is 2"), (field(np.sin), TypeError, "f"),
    (field(lambda x: (np.sin(x[0]), x[1])), TypeError, "f.* sin"),
    (field(lambda x: (1 / x[0], x[1])), TypeError, "f divides by x1.* Field.from_function"),
    (field(lambda u: (u[0] / (1 + 3 * u[1]), 0), "u v"), TypeError, r"f divides by 3\*v \+ 1.* Field.from_function"),
    (field(lambda x: (x[0] ** -2, 1)), TypeError, "f divides by x1"),
    (field(lambda x: (np.exp(x[0]), 1)), TypeError, r"f calls exp\(x1\).* Field.from_function"),
    (field(lambda x: (np.tanh(x[0]), 1)), TypeError, r"f calls tanh\(x1\)"),
    (field(lambda x: (np.sqrt(x[0]), 1)), TypeError, r"f calls sqrt\(x1\)"),
    (field(lambda x: (2 ** x[0], 1)), TypeError, "f has x1 in an exponent"),
    (field(lambda x: np.exp(np.array(x))), TypeError, r"f calls exp\(x1\)"),
    (field(lambda x: (abs(x[0]), 1)), TypeError, r"f calls absolute\(x1\)"),
    (field(lambda x: (np.sign(x[0]), 1)), TypeError, r"f calls sign\(x1\)"),
    (field(lambda x: (np.heaviside(x[0], 1), 1)), TypeError, r"f calls heaviside\(x1\)"),
    (field(lambda x: (max(x[0], 1), 1)), TypeError, "f compares x1"),
    (field(lambda x: (None * x[0], 1)), TypeError, "f.* time a variable"),
    (field(lambda x: (math.cos(None), 1)), TypeError, "f"),
    (field(lambda x: np.linalg.solve(ID[:2, :2], x)), TypeError, "inverse of a constant matrix"),
    (field(lambda x: (x[0] / 0, 1)), ValueError, "division by zero"),
    (field(lambda x: [a for a, b, c in [x]]), ValueError, "unpack .* 2 variables were given, x1, x2, and 3"),
    (field(lambda x: (None, 1)), TypeError, "f: x1' must be a polynomial.* None"),
    (field(lambda x: (x[0] if x[0] == 0 else 1, x[1])), TypeError, "f"),
    (field(lambda x: (x[0] and 1, x[1])), TypeError, "f"),
    (field(lambda x: (x[0] ** 0.5, x[1])), ValueError, "f"),
    (field(lambda x: (x[0] * NAN, x[1])), ValueError, "f"),
    (field(lambda x: (x[0] ** 3, x[1])), ValueError, "f.* degree 3.* Field.from_function"),
    (field(lambda x: (x[0] ** 3, 1), "q p"), ValueError, "f: q' has degree 3"),
    (field(lambda x: (x[1], 1), "xyz"), ValueError, "f.* 'xyz' is one name, write 'x y z'"),
    (field(lambda x, A: A @ x, A=ID[:2, :2]), ValueError, "f"),
    (lambda: sf.body_from_dict({"I1": 4}), ValueError, "parameters must have an entry 'body'"),
    (run(body=(BODY, ID)), TypeError, "body.* pass the body alone"),
    (lambda: Suslov3D.from_inertia(np.triu(ID + 0.1), [0, 0, 1]), ValueError, r"I.* np.triu\(I, 1\).T"),
    (lambda: Suslov3D.from_inertia(np.diag([1.0, 1, 3]), [0, 0, 1]), ValueError, "I violates.*off the diagonal"),
    (run(omega0=[[1, 2, 0], [1, 2, 0]]), ValueError, "omega0.* pass the transpose, .*; or for vectors of 3 components"),
    (field(lambda x: (math.sin(x[0]), 1)), TypeError, "f.* math.*np.*Field.from_function"),
    (field(lambda x: np.add(np.zeros(2), float(x[0]))), TypeError, "f"),
    (field(lambda x: (x[:2] ** 2,) * 2), TypeError, "f"),
    (lambda: sf.iterate(sf.QuadraticField.from_function(lambda x: (x[1], -x[0]), 2), {"x": 1.0, "y": 2.0}, 0.1, 1), TypeError, r"x must be an array, not a dict: pass \[\*x\.values"),
    (lambda: sf.iterate(abs, [1.0, 0.5], 0.1, 1), TypeError, r"pass QuadraticField\.from_function\(f, names\)"),
    (field(lambda x: None), ValueError, "f.*not None: return a tuple of 2"),
    (field(lambda *x: x), TypeError, r"f must take the state, as one tuple, not f\(\*x\): pass lambda x: f\(\*x\)$"),
    (field(lambda: 3), TypeError, r"f must take the state, as one tuple, not f\(\): write lambda x"),
    (field(lambda x: (x.u, x.v)), TypeError, r"f"),
    (field(lambda x: (x["u"], 1)), ValueError, r"f"),
    (field(interpolated), ValueError, r"f.*calls scipy, which takes no symbols \(.*: write formulas"),
    (field(sympy.lambdify(sympy.symbols("u v"), [1, 2])), TypeError, r"pass lambda x: f\(\*x\), as"),
    (field([1, 2], [*sympy.symbols("u v")]), TypeError, "names of variables, such as 'u v', not"),
    (field(2, lambda x: x), TypeError, "dimension must be a number or names, not a function, which"),
    (field(lambda x: (x[1], 1), r"\theta w"), ValueError, "not a valid name in Python: call it theta"),
    (field(lambda x: (x[1], 1), ["my angle", "w"]), ValueError, "call it my_angle, for example"),
    (lambda: QuadraticField(["y", "-x"]), TypeError, r"quadratic.*use from_function\(f, dimension\)"),
    (lambda: QuadraticField(np.zeros((2, 2, 2)), np.eye(3)), ValueError, r"linear .* \(\.\.\., 2, 2\), not"),
    (inertia(ID, "z"), TypeError, r"a must be 3 numbers, such as \[0, 0, 1\], not 'z'"),
    (lambda: sf.integrability.zoo()["lorenz"], KeyError, "no field 'lorenz': did you mean 'Lorenz'"),
    (lambda: sf.integrability.zoo()[3], KeyError, "choose from Suslov body, Suslov gyrostat"),
    (lambda: sf.integrability.kahan(LIFTED), TypeError, "not Field"),
    # As written for other packages.
    (field(lambda t, y: y), TypeError, r"f.*not f\(t, y\): pass lambda x: f\(None, x\),"),
    (field(lambda y, t: y), TypeError, r"f.*not f\(y, t\): pass lambda x: f\(x, None\),"),
    (field(lambda x, t=0: x), TypeError, r"f.* pass lambda x: f\(x, None\)"),
    (field(lambda t, y, a: y, a=1), TypeError, r"f.*from_function\(lambda x, a: f\(None, x, a\), 2, a=a\)"),
    (field(lambda t, y: y, y=28), TypeError, r"f.* pass lambda x: f\(None, x\)"),
    (field(lambda u, p, t: u), TypeError, r"f.* pass lambda x: f\(x, p, None\)"),
    (field(lambda x, y, z: (x, y, z), 3), TypeError, r"f.* pass lambda x: f\(\*x\)"),
    (field(lambda S, I, R: (S, I, R), 3), TypeError, r"f.* pass lambda x: f\(\*x\)"),
    (hamiltonian(lambda q, p: q * p), TypeError, r"H.* pass lambda x: H\(\*x\)"),
    (hamiltonian(lambda q, p: q[0] * p[1], 4), TypeError, r"H.* H\(x\[0:2\], x\[2:4\]\)"),
    (field(lambda du, u, p, t: u), TypeError, "f.* return the 2 components"),
    (field(njit(lambda t, u: u)), TypeError, r"f.*not f\(t, u\)"),
    (field(lambda x, p: x, 3), TypeError, "f.* each parameter by its own name"),
    (field(lambda x, p: (p[0], 1), p=[1, 2]), TypeError, "f.* an array is a family"),
    (field(lambda x, p: (sum(p), 1), p=[1, 2]), TypeError, "f.* an array is a family"),
    (field(lambda x, p: (len(p), 1), p=[1, 2]), TypeError, "f.* an array is a family"),
    (field(lambda x, A: A @ np.array(x), A=ID[:2, :2]), ValueError, "f.* an array is a family.* inside f"),
    (field(lambda x: x, names="u v"), TypeError, "names.* in place of the dimension"),
    (field(lambda x, a, t: (1, 2), a=1, t=1), ValueError, "parameters"),
    (lambda: sf.integrability.rational_map(lambda t, y: y, 2), TypeError, r"f.* rational_map\(lambda x: f\(None, x\), 2\)"),
    (lambda: sf.integrability.kahan(lambda x: x), TypeError, "field.*from_function"),
    (lambda: sf.integrability.kahan(BODY), TypeError, r"field.*QuadraticField.of\(body\)"),
    (field(lambda x, *, a: x), TypeError, "f.* pass a="),
    (field(lambda x, eps: x), TypeError, "f.* eps: this name is in use"),
    (field(lambda x: x[0] * x[1]), ValueError, "f"),
    (field(lambda x: ("1", 1)), TypeError, "f"), (field(None), TypeError, "f"),
    (field(lambda x: (1,), 1.5), TypeError, "dimension"),
    (field(lambda x, rho: (rho, x[0])), TypeError, "f.*rho"),
    (field(lambda x, rho=1: (x[0], x[1]), roh=1), TypeError, "f.*roh; choose from: rho"),
    (field(lambda x, mu: (x[0], x[1]), nu=1), TypeError, "f needs mu, not nu"),
    (field(lambda x, r, K: (x[0], x[1]), args=(1, 3)), TypeError, "f needs r, not args: .* by its name, r=…, K=…"),
    (field(lambda x, y: (x, y, 1), 3), TypeError, "f.* one tuple of 3"),
    (hamiltonian(lambda p, q: q * p), TypeError, r"pass lambda x: H\(x\[1\], x\[0\]\), as in"),
    (hamiltonian(lambda p, q: q[0] * p[1], 4), TypeError, r"lambda x: H\(x\[2:4\], x\[:2\]\)"),
    (field(lambda t: (t, t)), TypeError, "f.* one tuple of 2; for a forcing"),
    (hamiltonian(lambda t, q, p: q[0] * p[1], 4), TypeError, r"H.* H\(None, x\[0:2\], x\[2:4\]\)"),
    (field(lambda x, a: (a * x[0], 1), a="1"), TypeError, "a"),
    (field(lambda x, a: (a * x[0], 1), a=[NAN]), ValueError, "a"),
    (field(lambda x, a, b: (a * x[0], b), a=[1, 2], b=[1, 2, 3]), ValueError, "b"),
    (field(lambda x, a: (10**70 * x[0] * a, 1), a=[1, 2]), ValueError, "f"),
    (field(lambda x, attitude: (1, 2), attitude=1), ValueError, "attitude"),
    (field(lambda x, **x1: (1, 2), x1=1), ValueError, "x1"),
    (field(lambda x, **n: (1, 2), n=1), ValueError, "'n' clashes .* n_"),
    (field(lambda x, u: (1, 2), "u v", u=1), ValueError, "'u' clashes .* u_"),
    (field(lambda x, eps: (1, 2), eps=1), ValueError, "'eps' clashes with the step size: .* eps_"),
    (hamiltonian(lambda x, method: 1, method=1), ValueError, "'method' clashes .* sel.* method_"),
    (field(tuple, "u lambda"), ValueError, "dimension.* 'lambda' .* lambda_"),
    (field(tuple, "u u"), ValueError, "dimension.* 'u'"), (field(tuple, ["a b"]), ValueError, "'a b'"),
    (field(tuple, "u eps"), ValueError, "dimension.* 'eps' .* eps_"), (field(tuple, ""), ValueError, "dimension"),
    (field(tuple, "x2 x1"), ValueError, "'x2' .* variable 2"), (field(tuple, ["u", 1]), TypeError, "dimension"),
    (lambda: QuadraticField([[[1]]], names="u v"), ValueError, "names.* 1 variables"),
    (lambda: QuadraticField([[[1]]], names=2), TypeError, "names"),
    (changed(names=["u", "eps"]), ValueError, "names.* 'eps'"),
    (hamiltonian(None), TypeError, "H"), (hamiltonian(lambda x: x[0] ** 4), ValueError, "H"),
    (hamiltonian(lambda x: (x[0], x[1])), TypeError, "H"),
    (hamiltonian(lambda x, K: x[0]), TypeError, "H needs K: this name is in use, for the matrix .* K_"),
    (hamiltonian(lambda q, p, t, K: q), TypeError, r"lambda x, K_: H\(\*x, None, K_\), 2, K_=…"),
    (hamiltonian(lambda x: x[0], 3), ValueError, "dimension"),
    (hamiltonian(lambda x: x[0], "x px y py"), ValueError, "dimension: all coordinates.*'x y px py'"),
    (hamiltonian(lambda x: x[0], "q1 p1 q2 p2"), ValueError, "'q1 q2 p1 p2', not .* pass K"),
    (hamiltonian(lambda x: x[0], 2, np.eye(2)), ValueError, "K"),
]  # fmt: skip

RUNS = [
    (run(omega0=[[1, 2], [3]]), ValueError, "omega0"), (run(omega0=[None, 1]), TypeError, "omega0"),
    (run(omega0=[10**400, 1]), ValueError, "omega0"), (run(eps=[0.2, True]), TypeError, "eps"),
    (run(omega0=np.ma.masked_less([1.0, -1.0], 0)), ValueError, "omega0"),
    (run(omega0=[np.ma.masked_less([1.0, -1.0], 0)] * 2), ValueError, "omega0"),
    (run(steps=-1), ValueError, "steps"), (run(steps=10.0), TypeError, "steps"),
    (run(steps=True), TypeError, "steps"), (run(steps=2**64), ValueError, "steps"),
    (run(save_every=0), ValueError, "save_every"), (run(save_every=1.5), TypeError, "save_every"),
    (run(method="rk4"), ValueError, "method"),
    (run(attitude=1), ValueError, "attitude"),
    (run(attitude=np.stack([np.eye(3)] * 5)), ValueError, "attitude"),
    (run(body=FIELD, attitude=True), TypeError, "attitude"),
    (run(on_singular="stop"), ValueError, "on_singular"), (run(progress=0), TypeError, "progress"),
    (run(out=[[0, 0]]), TypeError, "out"), (run(out=np.zeros((4, 2, 2), "f4")), TypeError, "out"),
    (run(out=np.zeros((3, 2, 2))), ValueError, "out"),
    (run(out=np.frombuffer(bytes(128)).reshape(4, 2, 2)), ValueError, "read-only, as the states of runs are"),
    (run(out=np.zeros((4, 2, 4))[..., ::2]), ValueError, "out"),
    (run(omega0=[1.0, 0.5, 0.2]), ValueError, r"omega0.*\(rotation @ omega\)\[:2\]"),
    (run(body=Suslov3D), TypeError, "body"), (run(body=3), TypeError, "body"),
    (run(body=lambda x: x), TypeError, r"body.*QuadraticField.from_function"),
    (run(omega0=np.ones((2, 5))[:, :3]), ValueError, "omega0.* pass the transpose"),
    (run(body=BATCH, omega0=np.ones((4, 2))), ValueError, r"omega0 .* insert axes of length 1"),
    (lambda: sf.step_full(BODY, [1, 2, 3], 0.1), TypeError, "I3"),
    (lambda: sf.step_full(ROTOR, [1, 2, 0], 0.1), TypeError, "body.*iterate or flow"),
    (lambda: sf.RandomStarts(-1, 1.0), ValueError, "size"),
    (lambda: sf.RandomStarts(3, 0.0), ValueError, "extent"),
]  # fmt: skip

STATES = [
    (lambda: sf.first_integral(ND, [1, 2, 3], 0.1), sf.NotIntegrableError, "modified_energy"),
    (lambda: sf.criticality(ND, [1, 2, 3], 0.1), sf.NotIntegrableError, "iterate"),
    (lambda: sf.invariant_density(SuslovND([1, 2, 3], [1, 1, 0]), [1, 2, 3], 0.1), sf.NotIntegrableError, "jacobian"),
    (lambda: sf.energy(FIELD, [1, 2]), TypeError, "body"),
    (lambda: sf.modified_energy(FIELD, [1, 2], 0.1), TypeError, "body"),
    (lambda: sf.first_integral(HENON, [1, 2], 0.1), TypeError, "body"),
    (lambda: sf.closed_form(ROTOR, [1, 2], 0.1), TypeError, "body"),
    (lambda: checks.extra("nothing.more", "large"), ImportError,
     r"nothing is not installed: pip install nothing, or '.\[large\]'"),
    (lambda: sf.scattering_angle(ROTOR), TypeError, r"body.* iterate\(\.\.\., attitude=True"),
    (lambda: sf.lyapunov_exponents(BODY, [1, 2], 0.1, 0), ValueError, "steps"),
    (lambda: sf.attitude(BODY, [1.0, 0.5], 0.2), ValueError, "omega"),
    (lambda: sf.attitude(BODY, np.ones((0, 2)), 0.2), ValueError, "omega"),
    (lambda: sf.attitude(BODY, np.ones((4, 5, 2)), [1, 2]), ValueError, "eps"),
    (lambda: sf.attitude(BODY, ONES, 0.2, 2 * ID), ValueError, "R0"),
    (lambda: sf.attitude(BODY, ONES, 0.2, -ID), ValueError, "R0"),
    (lambda: sf.attitude(BODY, ONES, 0.2, True), TypeError, "R0"),
    (lambda: sf.to_matrix(BODY, [1, 2], rotation=np.eye(2)), ValueError, "rotation"),
    (lambda: sf.to_matrix(BODY, [1, 2], attitude=np.ones(3)), ValueError, "attitude"),
    (lambda: sf.momentum(BODY, [1, 2], rotation=ID, attitude=ID), (TypeError, ValueError), "attitude"),
    (lambda: sf.to_vector(ND, [1, 2, 3]), TypeError, "body.*to_matrix"),
    (lambda: sf.open_ensemble(3), TypeError, "store"),
]  # fmt: skip


class Tensor:
    """An array of another package, which converts itself, or refuses to."""

    def __init__(self, values):
        self.values = values

    def __array__(self, dtype=None, copy=None):
        if self.values is None:
            raise RuntimeError("call detach() first")
        return np.asarray(self.values, dtype)


RUN = sf.iterate(FIELD, [0.1, 0.2], 0.1, 1)
# What users type by mistake: arrays of other packages, arguments in the wrong order, other objects.
MISTAKES = [
    (run(omega0=[1j, 1]), TypeError, "omega0 .*, which is complex: pass real and imaginary parts"),
    (run(omega0=1.0), ValueError, r"omega0 .*, not \(\): pass one number for each, such as \[1\.0, 1\.0\]"),
    (run(omega0=[[1.0], [2.0]]), ValueError, "omega0.* pass np.ravel of it, for one state"),
    (run(omega0=np.zeros((2, 0))), ValueError, r"omega0 .*, not \(2, 0\)"),
    (run(omega0=[Decimal(1), Decimal(2)]), TypeError, r"omega0.* Decimal\('1'\) is a Decimal: pass float"),
    (run(omega0={1.0, 2.0}), TypeError, "omega0.*: pass a list"),
    (run(omega0=scipy.sparse.csr_matrix(np.eye(2))), TypeError, r"omega0.*: pass its \.toarray\(\)"),
    (run(omega0=np.zeros(3, "f8, f8")), TypeError, r"omega0.* np\.array\(a\.tolist\(\)\)"),
    (run(omega0=np.array([1.0, NA])), TypeError, r"omega0.* \.to_numpy\(float, na_value=np\.nan"),
    (run(eps=Decimal("0.01")), TypeError, r"eps.* pass float\(\.\.\.\) of it"),
    (run(steps=10**20), ValueError, r"steps.* of 0 or more, at most 2\*\*62, not 10+"),
    (lambda: np.asarray(sf.RandomStarts((3, 2), 5.0)), TypeError, r"\.states\(6, dimension=D\)"),
    (lambda: sf.RandomStarts(3, 5.0)[:], TypeError, r"\.states\(3, dimension=D\)"),
    (lambda: sf.Status(-128), ValueError, r"not computed yet: .* status\[status != -128\]"),
    (run(omega0=(x for x in (1.0, 2.0))), TypeError, "omega0.*: pass a list"),
    (run(omega0=Tensor(None)), TypeError, r"omega0 .* not Tensor, which is no array: call detach\(\) first"),
    (run(eps=np.timedelta64(1, "s")), TypeError, "eps.* divide it by np.timedelta64"),
    (run(steps="100"), TypeError, "steps.* not the str '100': pass 100"),
    (run(steps=None), TypeError, "steps .* not None"),
    (run(method=["auto"]), ValueError, "method"),
    (run(out=[]), TypeError, r"out.* pass np.empty\(\(4, 2, 2\)\)"),
    (run(body="lorenz"), TypeError, r"body.* pass an object, such as QuadraticField.from_function"),
    (run(body=None), TypeError, "body .*, not None: pass an object"),
    (run(body=OMEGA, omega0=BODY), TypeError, "body.* the body or field comes first"),
    (run(body=[BODY, BODY]), TypeError, "body.* for a family of them pass arrays of parameters"),
    (run(body=sf.compiled.frame(BODY, 0.1)), TypeError, "body.* pass the body or field itself"),
    (run(body=HENON.H), TypeError, "body.* pass the field, whose Hamiltonian this is"),
    (lambda: sf.lyapunov_exponents(RUN, [0.1, 0.2], 0.1, 3), TypeError, "body.* pass its body, run.body"),
    (lambda: Suslov3D(ID, 1, 0, 0), ValueError, "I1 .*: a body is made from a tensor by from_inertia"),
    (lambda: SuslovND(1, 2), ValueError, r"J and I .* pass n - 1 numbers for each, such as 1.3, 2"),
    (lambda: sf.body_from_dict(Path("body.json")), TypeError, r"parameters.* json.loads\(path.read_text\(\)\)"),
    (lambda: sf.body_from_dict({"body": "Lorenz"}), ValueError, "body: there is no class 'Lorenz', only .*, Field.*: import"),
    (lambda: FAMILY.parameters.__setitem__("rho", 3), TypeError, "parameters .* cannot be changed: make it again with rho=3"),
    (field(lambda x: (x[1], -x[0]), "2"), ValueError, "dimension.* pass the integer 2"),
    (field(lambda x, a: (a * x[1], -x[0]), a=None), TypeError, "a must be integers, fractions or floats, not None"),
    (lambda: RUN.save("run"), ValueError, "path .* pass 'run.npz'"),
    (lambda: RUN.save("run.npz", "yes"), TypeError, "overwrite must be True or False, not 'yes'"),
    (lambda: RUN.save(None), TypeError, "path must be a string or a path, not None"),
    (lambda: RUN.to_xarray(3), TypeError, "dims must be a name, or one for each axis of the batch, not 3"),
    (lambda: sf.criticality(FIELD, [1, 2], 0.1), TypeError, "body.* run.status and run.first_pole"),
    (lambda: sf.integrability.hk_bases(sf.integrability.kahan(FIELD), "2"), TypeError, "monomials .*, not '2'"),
    (crossings(27.0), TypeError, r"surface.* pass lambda x: x\[..., k\] - 27.0"),
    (crossings(lambda x: math.sin(x[..., 0])), TypeError, r"surface must take arrays of states: write NumPy's"),
    (crossings(lambda x: x.z), AttributeError, r"surface .* last axis, as x\[..., 0\]:"),
    (crossings(lambda x: x["z"]), IndexError, r"surface .* last axis, as x\[..., 0\]:"),
]  # fmt: skip

PLOTS = [
    (lambda: sf.iterate(FIELD, [0.1, 0.2], 0.1, 1).plot(components=(0, 2)), ValueError, "components"),
    (lambda: sf.plot_phase(BODY, 10, 4), ValueError, "extent"),
    (lambda: sf.plot_phase(BODY, 0.2, 4, levels=0), ValueError, "levels"),
    (lambda: sf.plot_phase(Suslov3D(1, 2, 0, 0), 0.1, 4), ValueError, "body"),
    (lambda: sf.plot_phase(ND, 0.1, 4), TypeError, "body"),
    (lambda: sf.animate_body(BODY, fps=0), ValueError, "fps"),
    (lambda: sf.animate_body(BODY, eps=[0.1, 0.2]), ValueError, "body, eps"),
    (lambda: sf.animate_body(ND), TypeError, "body"),
    (crossings(lambda t, x: x), TypeError, r"surface.* as lambda x: x\[..., 0\] - 1, not one of t, x"),
    (crossings(lambda x: x[2] - 27), IndexError, r"surface.* last axis, as x\[..., 0\]"),
    (crossings(lambda x: x[0] - 27), ValueError, r"surface.* last axis, as x\[..., 0\]"),
    (lambda: sf.explore(BATCH), ValueError, "body"),
    (lambda: sf.explore(BODY, [1, 2, 3]), ValueError, "omega0"),
    (lambda: sf.explore(BODY, [1, 2], 0.1, 6000), ValueError, "steps"),
]  # fmt: skip

TABLE = [*BODIES, *FIELDS, *RUNS, *STATES, *MISTAKES, *PLOTS]


@pytest.mark.parametrize(("call", "exception", "name"), TABLE)
def test_bad_calls(call, exception, name):
    with pytest.raises(exception) as caught:
        call()
    message = str(caught.value)
    assert re.search(rf"(?<!\w){name}(?!\w)", message)
    assert "\n" not in message


def test_errors_name_a_page_by_its_title():
    title = 'the page "Any equations, to a tolerance" of the documentation'
    assert checks.page("howto/motion") == title
    docs = Path(__file__).parents[2] / "docs"
    for name, words in checks._TITLES.items():
        assert (docs / f"{name}.md").read_text("utf-8").startswith(f"# {words}\n")


def test_sizes_in_words():
    sizes = {1: "1 bytes", 160_016_000_000: "160 GB", 999_700: "1 MB", 8e21: "8,000,000,000 TB"}
    assert {size: checks.in_units(size) for size in sizes} == sizes


@pytest.mark.compiled
def test_compiled_functions_take_no_symbols():
    g = njit(lambda a, b: (a, b))
    for f in (lambda x: g(*x), lambda x: (g(x[0], [])[0], 1), lambda x, a: g(x[0], a)):
        for parameters in {}, {"a": 2}, {"a": np.linspace(1, 2, 9)}:
            if len(parameters) == f.__code__.co_argcount - 1:
                with pytest.raises((TypeError, ValueError), match=r"Numba, .* g.py_func\(\*x\)"):
                    QuadraticField.from_function(f, 2, **parameters)


def test_a_compiled_function_is_traced():
    assert field(njit(lambda x: (x[1], x[0] * x[0])))() == field(lambda x: (x[1], x[0] ** 2))()


def test_arrays_of_other_packages_are_welcome():
    assert (sf.step(BODY, Tensor(OMEGA), 0.1) == sf.step(BODY, OMEGA, 0.1)).all()
    assert field(lambda x, a: (a * x[0], 1), a=Tensor(2.0))() == field(lambda x: (2 * x[0], 1))()


def test_parameters_are_a_dictionary_that_cannot_be_set():
    assert pickle.loads(pickle.dumps(FAMILY.parameters)).keys() == {"rho"}
    assert type(FAMILY.parameters | {"a": 1}) is dict


def test_a_bad_call_changes_nothing():
    out = np.full((4, 2, 2), 7.0)
    for bad in ({"eps": NAN}, {"omega0": [1, INF]}, {"steps": True}):
        with pytest.raises((TypeError, ValueError)):
            run(**{"out": out, **bad})()
        assert (out == 7).all()


def test_values_at_the_ends_of_the_range():
    for size in (1e-50, 1e50):
        body = Suslov3D(size, size, size, 0)
        assert body.parameters["I1"] == size
    for size in (1e-60, 1e60):
        assert SuslovGyrostat(1, 1, size, -size, size).k == size
        assert SuslovND([size, 1], [size, 0]).J[0] == size
        assert QuadraticField([[[size]]], [[size]], [size]).constant == size


def test_unpickled_arrays_are_not_copied():
    """Their type equals that of other arrays, but is another object."""
    x = pickle.loads(pickle.dumps(np.ones(4)))
    assert checks.real_array("x", x) is x


def test_unusual_numbers_are_welcome():
    body = Suslov3D(Fraction(4), np.longdouble(1), np.float16(-0.5), -0.25)
    assert body == Suslov3D(4, 1, -0.5, -0.25)
    expected = FIELD([0.5, 2.0])
    for x in (np.array([0.5, 2], np.longdouble), np.float16([0.5, 2]), np.array([0.5, 2], object)):
        assert (FIELD(x) == expected).all()
    assert FIELD([Fraction(1, 2), 2]) == tuple(expected)
    for x in (FIELD(np.array([1, 2])), HENON.H(np.array([1, 2]))):
        assert x.dtype == np.float64  # integers of NumPy are numbers of an array


class WithUnit(np.ndarray):
    """Array with a unit, like quantities of astropy and unyt; NumPy drops the unit."""

    unit = "ms"


class Quantity(float):
    """Number like those of pint."""

    units, magnitude = "ms", 20.0


def labelled(value, dims=("start", "component")):
    return xarray.DataArray(value, dims=dims[2 - np.ndim(value) :], attrs={"units": "1/s"})


NOT_ARRAYS = [
    (lambda value: np.array(value).view(WithUnit), r"in ms.*\.to\(\.\.\.\)\.value"),
    (Quantity, r"in ms.*\.to\(\.\.\.\)\.magnitude"),
    (lambda value: [Quantity(each) for each in np.atleast_1d(value)], "in ms"),
    (np.vectorize(Quantity, otypes=[object]), "in ms"),
    (lambda value: labelled(value, ("component", "start")), r"\.to_numpy\(\)"),
    (lambda value: Series(np.atleast_1d(value)), r"\.to_numpy\(\)"),
    (lambda value: (Series(np.atleast_1d(value)),), r"\.to_numpy\(\)"),
    (lambda value: DataFrame({"a": np.atleast_1d(value)}), r"\.to_numpy\(\)"),
]
CALLS = {
    "I1": lambda value: Suslov3D(value, 1, -0.5, -0.3),
    "J": lambda value: SuslovND([value], [1.0]),
    "quadratic": lambda value: QuadraticField([[[value]]]),
    "a": lambda value: QuadraticField.from_function(lambda x, a: (a,), 1, a=value),
    "x": lambda value: FIELD([value, value]),
    "eps": lambda value: sf.iterate(BODY, OMEGA, value, 3),
    "n": lambda value: sf.exact(BODY, [1.0, 0.5], 0.2, value),
    "time": lambda value: sf.flow(BODY, [1.0, 0.5], time=value),
    "omega": lambda value: sf.energy(BODY, [value, value]),
    "period": lambda value: sf.periodic_orbit(FIELD, [1.0, 1.0], value, 10),
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize(("wrap", "message"), NOT_ARRAYS)
def test_units_and_labels_are_refused(wrap, message, name):
    """20 ms must never be read as 20, and labels are neither guessed nor ignored."""
    with pytest.raises(TypeError, match=rf"{name} must .* not \w+ .*{message}"):
        CALLS[name](wrap(20.0))


def test_a_number_of_steps_has_no_unit():
    with pytest.raises(TypeError, match=r"steps must be numbers without a unit, not .* in ms"):
        sf.iterate(BODY, OMEGA, 0.1, Quantity(20.0))


@pytest.mark.parametrize("name", ["n", "time"])
def test_times_have_one_axis(name):
    with pytest.raises(
        ValueError, match=rf"^{name} must .*1-D array, not an array of shape \(1, 2\)"
    ):
        CALLS[name]([[1, 2]])


def test_variables_of_our_datasets_are_arrays():
    names = ["Omega1", "Omega2"]
    states = xarray.DataArray([OMEGA] * 3, dims=("n", "start", "component"))
    for value in (states, states.assign_coords(component=names), states.variable, states.chunk()):
        assert (sf.energy(BODY, value) == sf.energy(BODY, [OMEGA] * 3)).all()
    for value in (
        states.assign_coords(component=names[::-1]), states.transpose("component", ...),
        states.transpose("start", "n", "component"), states.rename(component="Omega"), [states],
        states.to_dataset(name="omega"),
    ):  # fmt: skip
        with pytest.raises(TypeError, match=r"omega.*\.to_numpy\(\)"):
            sf.energy(BODY, value)


def test_lazy_arrays_are_computed():
    dask = pytest.importorskip("dask.array")
    assert (sf.energy(BODY, dask.asarray(OMEGA)) == sf.energy(BODY, OMEGA)).all()
    assert Suslov3D(dask.asarray([4.0, 3.0]), 1, -0.5, -0.3).shape == (2,)


# Without those that loops of users call: they are functions only where nothing is compiled.
FUNCTIONS = [
    (f"{module.__name__}.{name}", getattr(module, name))
    for module in (sf, sf.compiled, sf.integrability)
    for name in module.__all__
    if inspect.isfunction(getattr(module, name)) and getattr(module, name).__qualname__ == name
]


@pytest.mark.parametrize(("name", "function"), FUNCTIONS, ids=[name for name, _ in FUNCTIONS])
def test_body_and_state_are_positional_only(name, function):
    """A state is omega for a body and x for a field: no name of the argument would fit both."""
    for parameter in inspect.signature(function).parameters.values():
        is_first = parameter.name in {"body", "field", "system", "omega", "omega0", "x", "x0", "xy"}
        assert is_first == (parameter.kind == parameter.POSITIONAL_ONLY), parameter
    if name == "suslov_fast.iterate":
        with pytest.raises(TypeError, match="the second argument"):
            function(BODY, omega0=OMEGA, eps=0.2, steps=3)


@pytest.mark.parametrize(("name", "function"), FUNCTIONS, ids=[name for name, _ in FUNCTIONS])
def test_signatures_are_short(name, function):
    """`help(iterate)` begins with a signature that a reader can take in."""
    assert len(str(inspect.signature(function))) <= 600, name


def test_boxes_of_random_starts():
    for low, high, message in (
        (1, 1, "low must be below high, not 1 with high = 1$"),
        ((0, 2), 1, "not 2 with high = 1, in component 1: exchange them"),
        (-1.7e308, 1.7e308, "less than 1.8e308 apart"),
    ):
        with pytest.raises(ValueError, match=message):
            sf.RandomStarts(3, low=low, high=high)


def test_messages_print_numbers_of_numpy_as_numbers_and_leave_equations_as_they_are():
    assert checks.short([np.float64(2.0), np.int64(3)]) == "[2.0, 3]"
    assert checks.short("np.sin(x)") == "'np.sin(x)'"
