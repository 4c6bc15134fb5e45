"""Methods of order 4, 6 and 8 of fields: compositions of steps of Kahan's map."""

from itertools import cycle

import mpmath
import numba
import numpy as np
import pytest
from samples import SQUARE
from systems import FLOWS, HENON_HEILES, LORENZ, compiled_step

import suslov_fast as sf
from suslov_fast import IntegrationWarning, Status
from suslov_fast.maps.map_records import map_of

# As published, up to the middle one: Suzuki (1990); Sofroniou and Spaletta (2005), with 32 digits.
# The others follow by symmetry, the middle one from the sum, which is 1.
PUBLISHED = {
    "order4": 3 * ["1/(6 - cbrt(6))"],
    "order6": [
        "0.13861930854051695245808013042625", "0.13346562851074760407046858832209",
        "0.13070531011449225190542755785015", "0.12961893756907034772505366537091",
        "-0.35000324893920896516170830911323", "0.11805530653002387170273438954049",
    ],
    "order8": [
        "0.10647728984550031823931967854896", "0.10837408645835726397433410591546",
        "0.35337821052654342419534541324080", "-0.23341414023165082198780281128319",
        "-0.24445266791528841269462171413216", "0.11317848435755633314700952515599",
        "0.11892905625000350062692972283951", "0.12603912321825988140305670268365",
        "0.12581718736176041804392391641587", "0.11699135019217642180722881433533",
    ],
}  # fmt: skip


def exact_stages(method):
    """The fractions of a method in 30 digits or more."""
    with mpmath.workdps(40):
        cbrt = mpmath.cbrt(6)
        half = [
            1 / (6 - cbrt) if "cbrt" in each else mpmath.mpf(each) for each in PUBLISHED[method]
        ]
        return [*half, 1 - 2 * sum(half), *half[::-1]]


STAGES = {method: [float(each) for each in exact_stages(method)] for method in PUBLISHED}
METHODS = sorted(STAGES)
if numba.config.DISABLE_JIT:  # the others repeat the same sub-steps
    METHODS = METHODS[:1]


EACH = [*zip(FLOWS, cycle(METHODS), strict=False)]  # flow with a method


def composed(field, x, eps, method, steps=1):
    """States after each of the steps, each by several of Kahan's map."""
    states = [np.asarray(x, float)]
    for _ in range(steps):
        x = states[-1]
        for fraction in STAGES[method]:
            x = sf.step(field, x, fraction * np.asarray(eps))
        states.append(x)
    return np.array(states)


@pytest.mark.parametrize("method", METHODS)
def test_fractions_are_those_published(method):
    """Those published, whose odd powers have the sum 0 up to the order; no sub-step overshoots."""
    record, order = map_of(LORENZ, method), int(method[-1])
    fractions = np.array(STAGES[method])
    assert record.name == f"Kahan, order {order}"
    assert list(record.methods) == [method]
    assert abs(np.array(record.stages.fractions) - fractions).max() < 1e-15
    assert len(fractions) == {4: 7, 6: 13, 8: 21}[order]
    with mpmath.workdps(40):
        for power in range(3, order, 2):
            assert abs(sum(each**power for each in exact_stages(method))) < 1e-30
        assert abs(sum(each ** (order + 1) for each in exact_stages(method))) > 1e-6
    assert -1e-15 < min(np.cumsum(fractions)) <= max(np.cumsum(fractions)) < 1 + 1e-15


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("name", "method"), EACH)
def test_steps_are_composed(name, method, rng):
    _, field, start, time = FLOWS[name]
    x = np.array(start) + rng.normal(size=(19, field.dimension)) / 8
    eps = np.linspace(-1, 1, 19) * time / 80
    run = sf.iterate(field, x, eps, 12, method=method)
    wanted = composed(field, x, eps, method, 12)
    assert abs(run.states - wanted).max() < 1e-13 * abs(wanted).max()
    assert (run.states[:, 9] == x[9]).all()  # eps = 0
    assert (sf.step(field, x, eps, method=method) == run.states[1]).all()
    for every in (13, 2**61, 2**62):  # beyond the last step
        first = sf.iterate(field, x, eps, 12, method=method, save_every=every)
        assert np.array_equal(first.states, x[np.newaxis])
        assert np.array_equal(first.final, run.states[12])


@pytest.mark.parametrize("method", METHODS)
def test_multipliers_are_products_over_fractions(method):
    point = [np.sqrt(72), np.sqrt(72), 27]
    mu = np.linalg.eigvals(2 * (np.eye(3) - sf.kahan.matrix(LORENZ, point, 1.0)))
    for eps in (1 / 64, -1 / 16, 0.3):
        found = sf.kahan.multipliers(LORENZ, point, eps, method=method)
        parts = [fraction * eps * mu / 2 for fraction in STAGES[method]]
        wanted = np.prod([(1 + part) / (1 - part) for part in parts], axis=0)
        wanted = wanted[np.lexsort((-wanted.imag, -abs(wanted)))]
        assert found.dtype == complex
        assert abs(found - wanted).max() < 1e-12 * abs(wanted).max()
        jacobian = sf.kahan.jacobian(LORENZ, point, eps, method=method)
        assert abs(np.prod(found) - np.linalg.det(jacobian)) < 1e-11 * abs(np.prod(wanted))


# ------------------------------------------------------------------------------ poles in sub-steps
def statuses(field, x, eps, method):
    """The status of a step from that of its sub-steps."""
    x, passed = np.array(x, float), False
    for fraction in map_of(field, method).stages.fractions:
        run = sf.iterate(field, x, fraction * eps, 1, on_singular="ignore", save_every=None)
        if not run.ok.all():
            return run.status
        passed |= bool(run.status == Status.PASSED_POLE)
        x = run.final
    return Status.PASSED_POLE if passed else Status.OK


@pytest.mark.sampled(1)
@pytest.mark.parametrize("method", METHODS)
def test_status_of_sub_steps(method, rng):
    for field, size, eps in ((LORENZ, 30, 1 / 3), (HENON_HEILES, 30, 1 / 2), (SQUARE, 8, 1 / 2)):
        x = rng.uniform(-size, size, (40, field.dimension))
        run = sf.iterate(field, x, eps, 1, method=method, on_singular="ignore")
        wanted = [statuses(field, each, eps, method) for each in x]
        assert (run.status == wanted).all()
        assert 0 < np.count_nonzero(run.status == Status.PASSED_POLE) < 40
        assert (run.failed_at == np.where(run.status == Status.OK, -1, 1)).all()
        assert [compiled_step(field, each, eps, method=method)[0] for each in x] == wanted


def at_the_pole_of(stage, method):
    """Return a state from which a step of x' = x**2 ends at the pole of a sub-step, eps = 1."""
    fractions = map_of(SQUARE, method).stages.fractions
    x = 1.0 / sum(fractions[: stage + 1])
    for _ in range(1000):
        before = x
        for fraction in fractions[:stage]:
            before = sf.step(SQUARE, [before], fraction)[0]
        run = sf.iterate(SQUARE, [before], fractions[stage], 1, on_singular="ignore")
        if run.status == Status.SINGULAR:
            return x
        x = np.nextafter(x, 0.0)
    raise AssertionError("no such state")


@pytest.mark.parametrize("method", METHODS)
def test_a_pole_in_a_sub_step(method):
    for stage in (0, 2, 4):
        starts = [[0.1], [at_the_pole_of(stage, method)], [-0.3]]
        run = sf.iterate(SQUARE, starts, 1.0, 3, method=method, on_singular="ignore")
        assert run.status[1] == Status.SINGULAR
        assert run.failed_at[1] == 1
        assert np.isnan(run.states[1:, 1]).all()
        assert (run.status[[0, 2]] == Status.OK).all()
        assert np.isfinite(run.states[:, [0, 2]]).all()
        for function in (sf.step, sf.kahan.jacobian):
            with pytest.warns(IntegrationWarning):
                assert np.isnan(function(SQUARE, starts[1], 1.0, method=method)).all()
        status, out = compiled_step(SQUARE, starts[1], 1.0, method=method)
        assert (status, np.isnan(out[0])) == (Status.SINGULAR, True)


@pytest.mark.parametrize("D", [2, 18])
def test_exponents_tell_a_pole_in_a_sub_step_of_the_first_step(D):
    """With D = 18, too, where NumPy takes the derivatives of sub-steps one by one."""
    field = sf.Field(lambda x: (x[0] ** 2 + 1, *(-each for each in x[1:])), D)
    x = np.ones((2, D))
    x[:, 0] = 6.0, 2.0
    run = sf.iterate(field, x, 0.25, 20, method="order4", on_singular="ignore")
    assert run.first_pole.tolist() == [1, 2]
    with pytest.warns(IntegrationWarning, match=r"2 of 2 .*trajectory 0 at step 1\)"):
        sf.lyapunov_exponents(field, x, 0.25, 20, method="order4")
