"""Words of other packages and of users: one table of what is typed and what the error names."""

import inspect
import math
import re
from functools import cache

import numpy as np
import pytest
import sympy

import suslov_fast as sf
from suslov_fast import Field, Suslov3D, flow, integrability

BODY = Suslov3D(4, 1, -0.5, -0.3)
PENDULUM = Field(lambda x, k: (x[1], -k * np.sin(x[0])), "q p", k=1.0)
QUADRATIC = Field(lambda x, rho: (x[1], -rho * x[0]), "u w", rho=2.0)
SINE = sf.Map(np.sin, "x")
FAMILY = Field(lambda x, rho: (rho - x[0] ** 2,), 1, rho=[10, 20, 30])


@cache
def results():
    """Return what the table names, when the first test needs it."""
    motion, of_body = (flow(each, [1.0, 0.5], time=[0.0, 1.0]) for each in (PENDULUM, BODY))
    run, of_family = sf.iterate(QUADRATIC, [0.1, 0.2], 0.1, 1), sf.iterate(FAMILY, [1.0], 0.1, 1)
    return {"RUN": run, "OF_FAMILY": of_family, "MOTION": motion, "OF_BODY": of_body}


# What is typed, some words separated by bars, and what the message has to contain.
ROWS = [
    # names of other packages
    ("sf.solve_ivp | sf.odeint | sf.ode45", r"flow\(system, x0, time="),
    ("from suslov_fast import solve_ivp", r"flow\(system, x0, time="),
    ("sf.lyapunov | from suslov_fast import lyapunov", "lyapunov_exponents"),
    ("Field(lambda x, k: (k[0] * x[1], -x[0]), 'x v', k=[1, 0.5])", "pass k1, k2"),
    ("Field(lambda t, y, params: y, 'x v', params={'k': 1})", r"\*\*params"),
    ("sf.SuslovND(np.eye(3)) | Suslov3D(np.eye(3))", "from_(mass_tensor|inertia) takes a matrix"),
    ("sf.Event('x', 'down')", "direction='down'"),
    ("Field(lambda s: (np.where(s[1] == 10, 5.0, -s[0]), 1.0), 'x t')", r"Event\(times=\[10\]"),
    ("flow(lambda t, y, a: -a * y, [1.0], time=1, a=2)", r"Field\(f, names, a=2\)"),
    ("PENDULUM(0, [1.0, 0.0])", r"lambda t, x: system\(x\)"),
    ("PENDULUM([1.0, 0.0], k=5)", r"with_parameters\(k=5\)\(x\)"),
    ("Field.from_equations('x\\' = v; v\\' = sin(t)')", "t' = 1"),
    ("Field.from_equations('x\\' = x : volt')", "without units"),
    ("sf.Event(times=[[1, 2], [3]], to=lambda x: x)", "filled with nan"),
    ("flow(PENDULUM, [1j, 0.0], time=1)", "complex=True"),
    ("sf.equilibria(PENDULUM, [0.1, 0]).eigenvectors", r"np\.linalg\.eig"),
    ("sf.equilibria(PENDULUM, [0.1, 0]).jacobian", r"field\.jacobian"),
    ("MOTION.jacobian", r"body\.jacobian\(run\.states\)"),
    ("sf.equilibria(PENDULUM, x0=[0.1, 0])", "use near"),
    ("sf.equilibria(SINE, near=[0.1], period=2)", r"Map\(lambda x: f\(f\(x\)\), names\)"),
    ("flow(PENDULUM, [1.0, 0.0], time=1, first_step=1e-3)", "nothing: .* max_step="),
    ("sf.iterate(QUADRATIC, [0.1, 0.2], first_step=0.1, steps=1)", "use eps"),
    ("PENDULUM.nullclines | PENDULUM.quiver | sf.phase_portrait", "plot_phase"),
    ("sf.plot_phase(PENDULUM, 3.0)", "eps must be left out beside a field"),
    ("sf.plot_phase(FAMILY)", r"field\[k\]"),
    ("sf.equilibria(PENDULUM, [0.1, 0]).type", "use kind"),
    ("PENDULUM(k=5)", r"with_parameters\(k=5\)\(x\)"),
    ("Field(lambda s: (s['v'], -s['x']), 'x v')", r"write x\[0\]"),
    ("sf.Event([1, 2], to=lambda s: s) | sf.Event(time=[1, 2])", r"times"),
    ("flow(PENDULUM, [1, 0], time=10, step=0.01)", r"np\.arange"),
    ("RUN.plot(kind=1)", "use names, lines"),
    ("sf.iterate(QUADRATIC, [0.1, 0.2], 0.1, 1, derivatives='x0')", r"map\.jacobian"),
    ("sf.exact | from suslov_fast import exact", r"Suslov3D\.exact"),
    ("sf.first_integral | sf.limits | sf.criticality | sf.momentum | sf.reaction", "Suslov3D"),
    ("sf.closed_form | sf.to_xy | sf.step_full | sf.scattering_angle", "Suslov3D"),
    ("sf.jacobian | sf.matrix | sf.multipliers", r"kahan\.\w+\(system, x, eps"),
    ("sf.modified_energy | from suslov_fast import jacobian", r"kahan\.\w+\(system, x, eps"),
    ("sf.energy | sf.rotation_number", r"\.energy|\.rotation_number"),
    ("sf.Gyrostat", r"Suslov3D\(I1, I2, I13, I23, k\)"),
    ("QUADRATIC.first_integral", "report"),
    ("sf.from_inertia", r"Suslov3D\.from_inertia"),
    ("sf.fixed_points", "equilibria"),
    ("sf.Crossings", "Events"),
    ("sf.RandomStarts", r"default_rng\(seed\)"),
    ("sf.steady_states | Suslov3D.steady_states | BODY.steady_states", r"near=|equilibria"),
    # arguments
    ("Field(lambda s: (s[0],), 'x', mass_matrix=2.0)", r"mass=M"),
    ("Field(lambda s: (s[0],), 'x', Mass=2.0)", r"mass=M"),
    ("flow(PENDULUM, [1, 0], t_span=1 | t_eval=1 | tf=1)", r"\btime\b"),
    ("flow(PENDULUM, [1, 0], tol=1 | RelTol=1)", "rtol"),
    ("sf.iterate(BODY, [1, 0], 0.1, 9, RelTol=1 | t_span=1)", "flow"),
    ("flow(PENDULUM, [1, 0], method=1)", "stiff"),
    ("flow(PENDULUM, [1, 0], dt=1 | h=1)", "rtol="),
    ("flow(PENDULUM, y0=1 | u0=1 | x0=1 | omega0=1)", "second argument, x0"),
    ("sf.iterate(BODY, omega0=1, eps=1, steps=1)", "second argument, x0"),
    ("flow(PENDULUM, [1, 0], args=1 | p=1)", r"Field\(f, names, a=1\)"),
    ("flow(PENDULUM, [1, 0], k=1)", "with_parameters"),
    ("sf.iterate(QUADRATIC, [1, 0], 0.1, 9, rho=1)", "with_parameters"),
    ("flow(PENDULUM, [1, 0], terminal=1 | dose_times=1 | affect=1)", r"Event\("),
    ("flow(PENDULUM, [1, 0], callback=1)", r"Event\("),
    ("sf.Event(affect=1 | action=1)", "'to'|use to"),
    ("sf.crossings(PENDULUM, [1, 0], 'q', terminal=1)", "most"),
    ("sf.iterate(BODY, [1, 0], dt=1 | step_size=1 | epsilon=1)", r"\beps\b"),
    ("sf.iterate(BODY, [1, 0], 0.1, 9, save_evry=1 | stride=1 | thin=1)", "save_every"),
    ("flow(PENDULUM, [1, 0], dense_output=1)", r"motion\(t\)"),
    ("Suslov3D(I11=1)", r"\bI1\b"),
    ("Suslov3D(inertia=1 | I12=1)", "from_inertia"),
    ("sf.plot_phase(BODY, 0.1, 2.0, steps=1)", "use system|use body"),
    ("QUADRATIC.jacobian([1, 0], eps=1)", "use x"),
    ("integrability.report(QUADRATIC, time_limit=1)", "progress"),
    # calls
    ("flow(PENDULUM, (0, 15), [1, 0])", r"flow\(f, y0, time=np\.linspace\(0, 15, 201\)\)"),
    ("flow(PENDULUM, (2, 15), [1, 0])", r"flow\(f, y0, time=np\.linspace\(0, 13, 201\), t0=2\)"),
    ("flow(PENDULUM, [1, 0], np.arange(3.0))", r"flow\(f, y0, time=t\)"),
    ("BODY.exact([1, 0.5], time=1 | t=1)", r"flow\(body, omega0, time=t\)"),
    ("flow(PENDULUM, [1, 0], time=1, method='verlet')", r"field\.conserving\(\) keeps"),
    ("sf.iterate(QUADRATIC, [1, 0], 0.1, 9, method='verlet')", r"flow\(field\.conserving\(\)"),
    ("[*sf.crossings(PENDULUM, [1, 0], 'q', time=9.0)]", r"events\.split\(\)"),
    ("flow(PENDULUM, np.zeros((2, 5)), time=1)", "pass the transpose"),
    ("sf.iterate(BODY, np.zeros((4, 3)), 0.1, 9)", "body.rotation"),
    ("flow(lambda x: (x[1], -x[0]), [1, 0, 0], time=1)", "x0 has 3 components"),
    ("BODY.I1 = 3", "make another Suslov3D"),
    ("PENDULUM.k = 3", r"with_parameters\(k="),
    # attributes
    ("MOTION.sol | MOTION.interpolate", r"motion\(t\)"),
    ("MOTION.y | RUN.y", "states"),
    ("len(MOTION) | len(RUN)", r"len\(run\.time\)"),
    ("Field(lambda p, D: D(p[0]), 'p', D=1)", "parameters are numbers"),
    ("flow(lambda t, y, k: -k*y, [1.0], time=1)", r"Field\(f, names, k=1\.0\)$"),
    ("MOTION.evaluate(lambda x: x[0])", "use values"),
    ("MOTION.to_csv('a.csv')", "to_dataframe"),
    ("sf.equilibria(PENDULUM, [0, 0]).multipliers", "eigenvalues"),
    # what takes no map, or takes it in another way
    ("sf.Map(np.sin, 'x').inverse", r"Map\(g, names\)"),
    ("sf.periodic_orbit(SINE, [0.1])", "equilibria"),
    ("flow(SINE, [0.1], time=1.0)", "iterate"),
    ("sf.crossings(SINE, [0.1], 'x', time=1.0)", "iterate"),
    ("sf.kahan.jacobian(SINE, [0.1], 0.1)", "iterate"),
    ("sf.iterate(SINE, [0.1], 0.1, 100)", "iterate"),
    ("sf.iterate(SINE, [0.1])", "iterate"),
    ("sf.step(SINE, [0.1], 0.1)", "step"),
    ("sf.lyapunov_exponents(SINE, [0.1], time=100.0)", "steps"),
    ("sf.iterate(PENDULUM, [0.1, 0.2], 0.1, 100) | sf.Map(lambda x, t: x + t, 'x')", "Map"),
    ("sf.iterate(QUADRATIC, [0.1, 0.2], 100)", "eps"),
    ("sf.iterate(np.sin, [1.0], steps=3)", r"Map\(f, names\)"),
    ("flow(PENDULUM, [1, 0], time=1, events=sf.Event('q', to='-p'))", r"to=\('q', '-p/2'\)"),
    ("Field(lambda x, t: -x, 'x', t=0.0)", r"f\(y, t\) takes the time.*no value"),
    ("Field(lambda q, p: (p, -q), 'q p')", r"lambda x: f\(\*x\)"),
    ("Field(lambda x: -x.q, 'q')", r"x\[0\]"),
    ("MOTION.t | RUN.t", "time"),
    ("RUN.dt", "eps"),
    ("RUN.x0", r"states\[0\]"),
    ("RUN.w", r"run\[.w.\]"),
    ("RUN.omega | RUN.x", r"run\.states"),
    ("RUN.finl", "final"),
    ("RUN.extend(3)", r"iterate\(system, run"),
    ("RUN.lyapunov_exponents", r"suslov_fast\.lyapunov_exponents"),
    ("OF_FAMILY.rho", r"run\.body\.parameters\['rho'\]"),
    ("OF_BODY.omega1", r"run\['Omega1'\]"),
    ("QUADRATIC.rho", "parameters"),
    ("QUADRATIC.integrals", r"report\(field\)"),
    # functions of users
    ("Field.from_equations(\"x' = interp(t, [0, 1], [1, 0]); t' = 1\")", r"\(0, 1, 2\)"),
    ("Field(lambda x: x + np.ones((2, 1)) * x[0], 2)",
     r"shape \(2, 2\).*write B\[:, 0\]"),
    ("Field(lambda x, A: A @ x, 2, A=np.eye(2))",
     "leave a matrix out of the parameters"),
    ("Field(lambda x, *p: p[0] * x, 2, p=(1, 2))", "parameters have names"),
    *((f"Field(lambda x: {f}, 'x')", r"np\.interp\(t, np\.repeat\(knots, 2\)\[1:\]") for f in (
        "np.searchsorted([0, 1], x)", "np.digitize(x, [0, 1])", "np.eye(3)[0][int(x[0] // 2)]",
        "np.eye(3)[0][np.floor(x[0])]", "np.floor(x[0]).astype(int)", "[1, 2][math.floor(x[0])]",
    )),
    # the laboratory
    ("sf.kahan.modified_energy(BODY, sympy.symbols('u v'), 0.1)", r"report\(system\)\.integrals"),
    ("integrability.invariant_measure | integrability.density", r"report\(field\)\.measures"),
    ("integrability.singularity_confinement", "planar_entropy"),
    ("integrability.reversing_symmetries", r"report\(field\)"),
    ("integrability.RationalMap(lambda x: x, 'x y')", r"Map\(f, names\)"),
]  # fmt: skip


def each_typed():
    for typed, said in ROWS:
        words = typed.split(" | ")
        if "=1 | " in typed:  # arguments of one call
            head, first = re.fullmatch(r"(.*[(, ])(\w+=1)", words[0]).groups()
            tail = words[-1].partition("=1")[2]
            words = [f"{head}{word.partition('=1')[0]}=1{tail}" for word in (first, *words[1:])]
        yield from (pytest.param(word, said, id=word) for word in words)


@pytest.mark.parametrize(("typed", "said"), [*each_typed()])
def test_what_is_typed_leads_on(typed, said):
    names = globals() | results() | {"math": math, "sympy": sympy}
    with pytest.raises((TypeError, ValueError, AttributeError, ImportError)) as told:
        exec(typed, names)
    assert re.search(said, str(told.value)), told.value
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("thing", [QUADRATIC, Suslov3D, sf, integrability])
def test_names_without_an_answer_are_missing_as_in_python(thing):
    with pytest.raises(AttributeError, match=r"'nothing'$") as told:
        _ = thing.nothing
    assert "use " not in str(told.value)
    assert not hasattr(thing, "solve_ivp")
    if inspect.ismodule(thing):
        with pytest.raises(ImportError, match="'nothing'"):
            exec(f"from {thing.__name__} import nothing")
