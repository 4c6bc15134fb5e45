"""Errors: one table of bad calls, with the class of the error and the argument that it names.

Words are free. Calls that compile kernels before they fail are in other files: this one runs first,
while another process compiles them.
"""

import json
import random
import re
from decimal import Decimal
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
import xarray
from pandas import DataFrame, Series
from samples import Tensor
from scipy.special import gamma

import suslov_fast as sf
from suslov_fast import Field, Suslov3D, SuslovND, checks

NAN, INF, ID = float("nan"), float("inf"), np.eye(3)
OMEGA = [[1.0, 0.5], [0.2, 0.3]]
BODY, ND = Suslov3D(4, 1, -0.5, -0.3), SuslovND(J=[1, 2, 3], I=[0.5, 0.5, 0.5])
ROTOR = Suslov3D(4, 1, -0.5, -0.3, 0.9)
BATCH = Suslov3D([[4.0], [2.0]], [1, 2, 3], -0.5, -0.3)
FIELD = Field.from_terms([[[0, 1], [0, 0]], [[0, 0], [0, -1]]])
FAMILY = Field(lambda x, rho: (rho - x[0] ** 2,), 1, rho=[10, 20, 30])
HENON = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 + x[0] ** 3, 2)
SMOOTH = sf.Field(lambda x: (x[1], -np.sin(x[0])), 2)


@cache
def a_run():
    return sf.iterate(FIELD, [0.1, 0.2], 0.1, 1)


@cache
def a_motion():
    return sf.flow(BODY, [1.0, 0.5], time=[0.0, 1.0])


def body(**given):
    return lambda: Suslov3D(**{"I1": 4, "I2": 1, "I13": -0.5, "I23": -0.3, **given})


def field(f, dimension=2, **parameters):
    return lambda: Field(f, dimension, **parameters)


def hamiltonian(H, dimension=2, *K, **parameters):
    return lambda: Field.from_hamiltonian(H, dimension, *K, **parameters)


def inertia(I, a=(0, 0, 1)):
    return lambda: Suslov3D.from_inertia(I, a)


def changed(field=FIELD, **entries):
    return lambda: Field.from_dict(field.to_dict() | entries)


def run(**given):
    """`iterate` with some arguments replaced."""
    arguments = {"body": BODY, "omega0": OMEGA, "eps": 0.2, "steps": 3, **given}
    body, omega0 = arguments.pop("body"), arguments.pop("omega0")
    return lambda: sf.iterate(body, omega0, **arguments)


def motion(system=SMOOTH, x0=(1.0, 0.5), **given):
    return lambda: sf.flow(system, [*x0], **{"time": 1.0} | given)


def section(**given):
    arguments = {"surface": lambda x: x[..., 0], "time": 1.0} | given
    return lambda: sf.crossings(SMOOTH, [1.0, 0.0], **arguments)


def exponents(**given):
    return lambda: sf.lyapunov_exponents(SMOOTH, [1.0, 0.5], **given)


def changed_by(*surface, **given):
    return lambda: sf.flow(SMOOTH, [1.0, 0.5], time=1.0, events=sf.Event(*surface, **given))


def orbit(start=(1.0, 2.0), period=6.5, **given):
    return lambda: sf.periodic_orbit(FIELD, [*start], period, **given)


TABLE = [
    (TypeError, "a", inertia(ID, "z"), field(lambda x, a: (a * x[0], 1), a="1"),
     lambda: sf.iterate(FIELD, [1, 0], 0.1, 10, a=2)),
    (ValueError, "a", lambda: SuslovND.from_mass_tensor(ID, [1, 2]), inertia(ID, [0, 1]),
     inertia(ID, [0, 0, 0]), field(lambda x, a: (a * x[0], 1), a=[NAN])),
    (TypeError, "attitude", run(body=FIELD, attitude=True)),
    (ValueError, "attitude", run(attitude=1),
     run(attitude=np.stack([np.eye(3)] * 5)),
     lambda: BODY.momentum([1, 2], attitude=np.ones(3))),
    (ValueError, "atol", motion(atol=-1.0), motion(atol=[1.0, 2.0, 3.0])),
    (ValueError, "b", field(lambda x, a, b: (a * x[0], b), a=[1, 2], b=[1, 2, 3])),
    (TypeError, "(?:body|system)", lambda: len(BODY), lambda: BODY[0],
     run(body=(BODY, ID)),
     lambda: FIELD.energy([1, 2]),
     lambda: sf.kahan.modified_energy(FIELD, [1, 2], 0.1),
     lambda: sf.lyapunov_exponents(a_run(), [0.1, 0.2], 0.1, 3),
     lambda: sf.plot_phase(ND, 0.1, 4),
     lambda: sf.compiled.system(4, 0.1)),
    (ValueError, "(?:body|system)", lambda: Suslov3D.from_dict(ND.to_dict()),
     lambda: sf.plot_phase(Suslov3D(1, 2, 0, 0), 0.1, 4)),
    (TypeError, "events", motion(events=3), motion(events=[None])),
    (ValueError, "events", lambda: sf.lyapunov_exponents(
        SMOOTH, [1.0, 0.5], time=1.0, events=sf.Event(lambda x: x[0] - 1, terminal=True))),
    (ValueError, "color", lambda: a_run().plot(color=[1, 2])),
    (ValueError, "components", lambda: a_run().plot(0, 2)),
    (ValueError, "constant", lambda: Field.from_terms(np.zeros((2, 2, 2)), None, [1])),
    (sf.NotIntegrableError, "criticality", lambda: ND.criticality([1, 2, 3], 0.1)),
    (TypeError, "derivatives", motion(derivatives=3)),
    (ValueError, "derivatives", motion(derivatives="c"), motion(derivatives=("x0", "x0")),
     lambda: sf.flow(Field(lambda s, x0: (x0,), "s", x0=2), [1.0], time=1, derivatives="x0")),
    (TypeError, "names", field(2, lambda x: x),
     field(lambda x: (1,), 1.5)),
    (ValueError, "names", field(lambda x: (x[1], 1), r"\theta w"), hamiltonian(lambda x: x[0], 3),
     hamiltonian(lambda x: x[0], "x px y py"), field(lambda x: x, 0), field(lambda x: x, "u u")),
    (TypeError, "direction", section(direction="left")),
    (ValueError, "direction", section(direction=2), changed_by("x1", direction=2),
     changed_by(times=[1.0], direction=1)),
    (TypeError, "eps", lambda: sf.integrability.kahan(FIELD, "eps")),
    (TypeError, "eps", exponents(), exponents(time=1.0, eps=0.1),
     run(eps=[0.2, True]), run(eps=Decimal("0.01")), run(eps=np.timedelta64(1, "s"))),
    (ValueError, "eps", lambda: sf.compiled.system(BODY, [[0.1], [0.2]]),
     *(lambda eps=eps: sf.compiled.system(BODY, eps) for eps in (INF, 5e-324)),
     lambda: sf.plot_phase(BODY, [[1, 0.5]])),
    (ValueError, "extent", lambda: sf.plot_phase(BODY, 10, 4),
     lambda: sf.plot_phase(BODY, 0.1, OMEGA)),
    (TypeError, "f", field(lambda x: (None, 1)), field(None)),
    (TypeError, "^f", field(lambda x: (x["u"], x[1]), "u v"),
     field(lambda x: (int(x[0]), x[1])), field(lambda x: (gamma(x[0]), x[1])),
     field(lambda x: np.exp(x, where=x > 0)),
     field(lambda x: (x[x > 0], x[1])), field(lambda x: (x[0] & 1, x[1])),
     field(lambda x: (np.interp(x[0], [1, 0], [1, 2]), x[1]))),
    (ValueError, "^f", field(lambda x: (x[0],)), field(lambda x: None), field(lambda *x: x),
     field(lambda x: (x[0] * random.random(), x[1])),
     field(lambda x, kept=[]: (kept.append(1) or len(kept) * x[0], x[1]))),
    (ValueError, "f", field(lambda x: (x[0] * x[1], x[0]), 3),
     field(lambda x: (x[0] * x[2], x[0]))),
    (TypeError, "field", lambda: sf.integrability.kahan(SMOOTH),
     lambda: sf.integrability.KahanMap(BODY, 0.1), lambda: sf.integrability.kahan(lambda x: x),
     lambda: sf.integrability.report(len)),
    (sf.NotIntegrableError, "first_integral", lambda: ND.first_integral([1, 2, 3], 0.1)),
    (TypeError, "H", hamiltonian(lambda q, p: q * p), hamiltonian(None),
     hamiltonian(lambda x: (x[0], x[1]))),
    (ValueError, "equations", changed(HENON, H="x1 +"), changed(HENON, equations=["x1"])),
    (ValueError, "I", lambda: SuslovND.from_mass_tensor(np.diag([1.0, 2.0, -0.1]), [1, 2, 3]),
     lambda: SuslovND.from_mass_tensor([[1.0]]), inertia(np.eye(2)),
     inertia(np.triu(np.ones((3, 3)))), inertia(np.diag([1, 1, 1e-17]), [1, 2, 3]),
     inertia(np.diag([1, 2, 4]))),
    (TypeError, "I1", body(I1=[4, True])),
    (ValueError, "I1", body(I1=1e51), lambda: Suslov3D(ID, 1, 0, 0)),
    (ValueError, "I13", body(I13=[1, INF]), lambda: BATCH.sel(I13=-0.5),
     lambda: Suslov3D.from_dict({"body": "Suslov3D", "I1": 4, "I2": 1})),
    (TypeError, "I2", lambda: BATCH.sel(I2=slice(1, 2))),
    (ValueError, "I2", body(I2=[1, 2, -3]), body(I1=[1, 2], I2=[1, 2, 3]),
     lambda: BATCH.sel(I2=[1, 2])),
    (KeyError, "I2", lambda: BATCH.sel(I2=2.5)),
    (TypeError, "I23", body(I23=1j)),
    (TypeError, "I3", lambda: BODY.step_full([1, 2, 3], 0.1)),
    (ValueError, "I3", body(I3=9e-51)),
    (IndexError, "index", lambda: BATCH[2]),
    (TypeError, "index", lambda: BATCH["a"]),
    (ValueError, "indices", changed(names=["x"]), changed(indices=[[0.5], [0], [0]])),
    (sf.NotIntegrableError, "invariant_density",
     lambda: sf.kahan.invariant_density(SuslovND(J=[1, 2, 3], I=[0.5, 0.5, 0]), [1, 2, 3], 0.1)),
    (ValueError, "J", lambda: SuslovND(J=[1, 0], I=[0.5, 1]),
     lambda: SuslovND(J=[1, 1e61], I=[0.5, 1])),
    (ValueError, "J and I", lambda: SuslovND(J=[1, 2], I=[1, 2, 3])),
    (TypeError, "k", body(k=None), lambda: Suslov3D.figure("1")),
    (ValueError, "K", hamiltonian(lambda x: x[0], 2, np.eye(2)), hamiltonian(len, 3, len)),
    (ValueError, "k", body(k=[1, 1e-70]), lambda: Suslov3D.figure(5)),
    (ValueError, "levels", lambda: sf.plot_phase(BODY, 0.2, 4, levels=0)),
    (ValueError, "linear", lambda: Field.from_terms(np.zeros((2, 2, 2)), np.eye(3)),
     lambda: Field.from_terms([[[1]]], [[Fraction(1, 10**61)]]),
     lambda: Field.from_terms(np.ones((2, 1, 1, 1)), np.ones((3, 1, 1)))),
    (KeyError, "lorenz", lambda: sf.integrability.zoo()["lorenz"]),
    (TypeError, "map", lambda: sf.integrability.rational_map(len)),
    (ValueError, "mass", lambda: Suslov3D.from_dict({**BODY.to_dict(), "mass": 3})),
    (ValueError, "max_step", motion(max_step=0.0)),
    (TypeError, "method", orbit(method="order8"), exponents(time=1.0, method="order4")),
    (ValueError, "method", run(method="rk4"), run(method=np.ones(2)), run(method="order4"),
     lambda: sf.kahan.jacobian(ROTOR, [1, 0.5], 0.1, method="order6"),
     lambda: sf.compiled.system(ND, 0.1, method="order8")),
    (TypeError, "monomials",
     lambda: sf.integrability.hk_bases(sf.integrability.kahan(FIELD), "2")),
    (TypeError, "terminal", changed_by("x1", terminal=1)),
    (ValueError, "most", section(most=0), changed_by("x1", most=0),
     changed_by("x1", terminal=True, most=2)),
    (ValueError, "limits", lambda: BODY.exact([1, 0], 0.1, n=np.inf)),
    (ValueError, "\u03c6", field(lambda x: x, "\u03d5 v")),
    (TypeError, "use chunks", lambda: sf.ensemble(BODY, OMEGA, "run", time=1, chunk=2)),
    (TypeError, "not function", lambda: sf.ensemble(lambda x: x, OMEGA, "run", eps=0.1, steps=2)),
    (TypeError, "parameter a is complex", lambda: sf.Field(lambda x, a: a * x, 1, a=2j)),
    (TypeError, "imaginary parts", lambda: sf.Field.from_equations("x' = a*x", a=2j)),
    (TypeError, "imaginary parts", lambda: sf.Field.from_equations("x' = x", complex=True)),
    (ValueError, "n", lambda: BODY.exact([1, 0], 0.1, [np.inf]),
     lambda: BODY.exact([1.0, 0.5], 0.2, [[1, 2]])),
    (TypeError, "names", field(lambda x: x, names="u v"),
     lambda: Field.from_terms([[[1]]], names=2)),
    (ValueError, "names", lambda: Field.from_terms([[[1]]], names="u v")),
    (ImportError, "nothing", lambda: checks.extra("nothing.more", "large")),
    (TypeError, "omega0", run(omega0=[None, 1]), run(omega0=Tensor(None))),
    (ValueError, "omega0", run(omega0=[[1, 2], [3]]),
     run(omega0=np.ma.masked_less([1.0, -1.0], 0)),
     run(omega0=[np.ma.masked_less([1.0, -1.0], 0)] * 2), run(omega0=[1.0, 0.5, 0.2]),
     run(body=BATCH, omega0=np.ones((4, 2)))),
    (ValueError, "on_singular", run(on_singular="stop"), ),
    (TypeError, "overwrite", lambda: a_run().save("run.npz", "yes")),
    (TypeError, "parameters", lambda: Suslov3D.from_dict(json.dumps(BODY.to_dict())),
     lambda: FAMILY.parameters.__setitem__("rho", 3)),
    (TypeError, "path", lambda: a_run().save(None)),
    (ValueError, "path", lambda: a_run().save("run")),
    (ValueError, "period", orbit(period=[6.5, NAN]), orbit(period=[6.5, -6.5]),
     orbit(period=-6.5)),
    (TypeError, "progress", run(progress=0), motion(progress=3)),
    (TypeError, "quadratic",
     lambda: Field.from_terms([[["1"]]])),
    (ValueError, "quadratic", lambda: Field.from_terms(lambda x: x),
     lambda: Field.from_terms([[[Decimal("1e99999999")]]]), lambda: Field.from_terms(ID),
     lambda: Field.from_terms(np.full((2, 1, 1, 1), NAN)), lambda: Field.from_terms([[[10**400]]])),
    (ValueError, "r", lambda: FAMILY.sel(r=20)),
    (TypeError, "rho", lambda: FAMILY["rho"]),
    (KeyError, "rho", lambda: FAMILY.sel(rho=21)),
    (TypeError, "rtol", motion(rtol=None),  # also the number that is the default
     lambda: sf.lyapunov_exponents(FIELD, [1.0, 0.0], 0.1, 4, rtol=1e-9)),
    (ValueError, "rtol", motion(rtol=0), motion(rtol=NAN), orbit(rtol=0.5), section(rtol=0.0),
     exponents(time=1.0, rtol=1.0)),
    (ValueError, "rotor", lambda: ROTOR.to_xy([1.0, 0.5]), lambda: ROTOR.scattering_angle(),
     lambda: ROTOR.closed_form([1.0, 0.5], 0.1), lambda: ROTOR.step_full([1, 0, 0], 0.1, 3),
     lambda: Suslov3D(4, 1, -0.5, -0.3, [0.0, 0.5]).to_xy([1.0, 0.5])),
    (KeyError, "run", lambda: a_run()["time"]),
    (FileNotFoundError, "run.npz", lambda: sf.load("nowhere/run.npz")),
    (TypeError, "save_every", run(save_every=1.5)),
    (ValueError, "save_every", run(save_every=0)),
    (ValueError, "sel", lambda: BODY.sel(I1=4)),
    (ValueError, "x0", orbit([1.0, NAN]), orbit([1.0, 2.0, 3.0])),
    (TypeError, "steps", exponents(time=1.0, steps=3), run(steps=10.5), run(steps=True)),
    (ValueError, "steps", run(steps=-1), run(steps=2**64),
     lambda: sf.lyapunov_exponents(BODY, [1, 2], 0.1, 0)),
    (TypeError, "stiff", motion(stiff="auto"), motion(stiff=np.ones(2))),
    (TypeError, "surface", section(surface=27.0), section(surface=lambda t, x: x),
     section(surface=lambda x: x[..., 0] > 1)),
    (ValueError, "surface",  section(surface="Omega1 = 1"), section(surface="Omega3")),
    (ValueError, "threads", motion(threads=0)),
    (ValueError, "surface or times", changed_by()),
    (ValueError, "surface", changed_by("x9"), changed_by("x1 +"), changed_by(lambda x: 1.0)),
    (TypeError, "surface", changed_by(3.0), changed_by(lambda x: (x[0], x[1])),
     changed_by(lambda x, a: x[0] - a)),
    (TypeError, "times", changed_by(times=["a"])),
    (ValueError, "times of events", lambda: sf.flow(
        SMOOTH, np.zeros((3, 2)), time=1.0, events=sf.Event(times=np.ones((4, 2))))),
    (TypeError, "to", changed_by("x1", to={}), changed_by("x1", to=lambda x, a: (x[0], a))),
    (ValueError, "to", changed_by("x1", to=lambda x: (x[0],)), changed_by("x1", to=("x1",)),
     changed_by("x1", to=("x1", "y")), changed_by("x1", to=lambda x: x * random.random())),
    (TypeError, "to_dict", lambda: sf.Event(lambda x: x[0]).to_dict()),
    (TypeError, "time",  section(steps=4)),
    (IndexError, "time", lambda: motion(time=[])().final),
    (ValueError, "time", motion(time=[[1.0]]), motion(time=INF), motion(time=[-1.0, 1.0]),
     section(time=[1.0, 2.0]), section(time=NAN), exponents(time=-1.0)),
    (ValueError, "transient", section(transient=-1.0), exponents(time=1.0, transient=-1.0)),
    (ValueError, "u", field(lambda x, u: (1, 2), "u v", u=1)),
    (ValueError, "which", lambda: sf.Field(lambda x, which: x, 1, which=1)),
    (ValueError, "values", changed(values=[1, 2, 3]), changed(values=[1e70, 1])),
    (TypeError, "x", lambda: FIELD([True, 1])),
    (ValueError, "x", lambda: FIELD([1, 2, 3]), lambda: HENON.energy([1, 2, 3])),
    (ValueError, "x0", lambda: sf.iterate(FIELD, {"x": 1.0, "y": 2.0}, 0.1, 1),
     motion(x0=[1.0, 2.0, 3.0]), motion(FAMILY[:2], np.ones((3, 1)))),
    (ValueError, "x1", field(lambda x, **x1: (1, 2), x1=1)),
]  # fmt: skip


@pytest.mark.parametrize(
    ("exception", "name", "call"),
    [
        pytest.param(exception, name, call, id=f"{name}-{k}")
        for exception, name, *calls in TABLE
        for k, call in enumerate(calls)
    ],
)
def test_a_bad_call_names_its_argument(exception, name, call):
    with pytest.raises(exception) as caught:
        call()
    message = str(caught.value)
    assert re.search(rf"(?<!\w){name}(?!\w)", message), message
    assert "\n" not in message


PAIR = Field(lambda x: (x[1], -x[0] / 2), "u v")


def test_states_by_name():
    """Names of all components leave no doubt about their order."""
    states, named = [[1.0, 2.0], [3.0, 4.0]], {"v": [2.0, 4.0], "t": [0.0, 0.0], "u": [1.0, 3.0]}
    expected = PAIR(states)
    assert (PAIR(DataFrame(named)) == expected).all()
    assert (PAIR(Series({"v": 2.0, "u": 1.0})) == expected[0]).all()
    assert (a_run()["x2"] == a_run().states[..., 1]).all()
    assert (a_motion().final == a_motion().states[-1]).all()
    with pytest.raises(ValueError, match=r"^x .* u, v"):
        PAIR(named)
    rows = [Series({"v": 2.0, "u": 1.0}), Series({"v": 4.0, "u": 3.0})]
    assert (PAIR(rows) == expected).all()
    assert (PAIR({"v": [2.0, 4.0], "u": 1.0}) == PAIR([[1.0, 2.0], [1.0, 4.0]])).all()
    motion = sf.flow(lambda x: (x[1], -x[0]), {"q": 1.0, "p": 0.0}, time=np.pi / 2)
    assert (motion.names, motion["p"][0]) == (("q", "p"), pytest.approx(-1.0))


class WithUnit(np.ndarray):
    """Array with a unit, like quantities of astropy and unyt; NumPy drops the unit."""

    unit = "ms"


class Quantity(float):
    """Number like those of pint."""

    units, magnitude = "ms", 20.0


NOT_ARRAYS = [
    lambda value: np.array(value).view(WithUnit),
    Quantity,
    lambda value: [Quantity(each) for each in np.atleast_1d(value)],
    np.vectorize(Quantity, otypes=[object]),
    lambda value: xarray.DataArray(value, dims=("component", "start")[2 - np.ndim(value) :]),
]
CALLS = {
    "I1": lambda value: Suslov3D(value, 1, -0.5, -0.3),
    "J": lambda value: SuslovND(J=[value], I=[0.0]),
    "quadratic": lambda value: Field.from_terms([[[value]]]),
    "a": lambda value: Field(lambda x, a: (a,), 1, a=value),
    "x": lambda value: FIELD([value, value]),
    "eps": lambda value: sf.iterate(BODY, OMEGA, value, 3),
    "n": lambda value: BODY.exact([1.0, 0.5], 0.2, value),
    "time": lambda value: sf.flow(BODY, [1.0, 0.5], time=value),
    "omega": lambda value: BODY.energy([value, value]),
    "period": lambda value: sf.periodic_orbit(FIELD, [1.0, 1.0], value),
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("wrap", NOT_ARRAYS)
def test_units_and_labels_are_refused(wrap, name):
    """20 ms must never be read as 20, and labels are neither guessed nor ignored."""
    value = wrap(20.0)
    with pytest.raises(TypeError, match=rf"\b{name}\b"):
        CALLS[name](value)


def test_errors_that_tell_of_the_mathematics_have_one_base_class():
    assert issubclass(sf.NoConvergence, sf.SuslovError)
    assert {*sf.SingularStepError.__mro__} >= {sf.SuslovError, ArithmeticError}
    assert {*sf.NotIntegrableError.__mro__} >= {sf.SuslovError, ValueError}
