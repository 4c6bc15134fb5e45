"""While a function is traced in one thread, other threads see NumPy, math and SciPy as they are."""

import copy
import functools
import inspect
import math
import pickle
import threading
from contextlib import contextmanager

import cloudpickle
import dask.base
import numba
import numpy as np
import pytest
from scipy.interpolate import BSpline, CubicSpline, PPoly, interp1d

from suslov_fast import Field

TABLE = CubicSpline([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.0, 2.0])
LINE = interp1d([0.0, 1.0, 2.0], [1.0, 3.0, 2.0])
MAKERS = "array asarray empty full ones zeros empty_like full_like ones_like zeros_like".split()
BEFORE = {
    **{f"np.{name}": getattr(np, name) for name in MAKERS},
    **{f"math.{name}": getattr(math, name) for name in ("sin", "log", "pow", "floor")},
    **{f"{of.__name__}.__call__": of.__call__ for of in (PPoly, BSpline, interp1d)},
}
SIGNATURES = {name: str(inspect.signature(BEFORE[name])) for name in ("math.sin", "PPoly.__call__")}


def by_name(name):
    first, last = name.split(".")
    return getattr(
        {"PPoly": PPoly, "BSpline": BSpline, "interp1d": interp1d}.get(first) or globals()[first],
        last,
    )


@contextmanager
def while_traced():
    """Run a block in this thread while another one is in the middle of a user's function."""
    inside, goes_on = threading.Event(), threading.Event()
    fields, names = [], {*globals()}

    def f(t, y):
        rates = np.zeros(2)
        rates[0] = math.sin(y[1]) + max(y[0], 0.0)
        inside.set()
        assert goes_on.wait(60)
        rates[1] = TABLE(t) + LINE(t) - y[0]
        return rates

    thread = threading.Thread(target=lambda: fields.append(Field(f, "x v")))
    thread.start()
    try:
        assert inside.wait(60)
        yield names
    finally:
        goes_on.set()
        thread.join()
    assert len(fields) == 1
    assert all(by_name(name) is before for name, before in BEFORE.items())
    assert {*globals()} == names


def plain(x):
    rates = np.zeros(2)
    rates[:] = math.sin(x[0]), max(x[1], 0.0)
    return rates


def test_functions_are_those_of_their_packages():
    with while_traced() as names:
        assert [name for name, before in BEFORE.items() if by_name(name) is not before] == []
        assert {*globals()} == names


@pytest.mark.parametrize("name", BEFORE)
def test_copies_and_pickles(name):
    before = BEFORE[name]
    with while_traced():
        now = by_name(name)
        found = [copy.copy(now), copy.deepcopy(now), copy.deepcopy({1: [now]})[1][0]]
        if "__call__" not in name:
            found += [pickle.loads(dump(now)) for dump in (pickle.dumps, cloudpickle.dumps)]
        token = dask.base.tokenize(now)
    assert all(each is before for each in found)
    assert token == dask.base.tokenize(before)
    later = copy.copy(found)  # they are what they were after the trace, too
    assert all(each is before for each in later)


@pytest.mark.parametrize("name", SIGNATURES)
def test_signatures_and_documentation(name):
    with while_traced():
        now = by_name(name)
        assert str(inspect.signature(now)) == SIGNATURES[name]
        assert inspect.getdoc(now) == inspect.getdoc(BEFORE[name])
        assert inspect.isroutine(now)
        members = dict(inspect.getmembers(np, inspect.isbuiltin))
    assert members["zeros"] is np.zeros


def test_functions_of_users_and_tables():
    with while_traced():
        copies = [cloudpickle.loads(cloudpickle.dumps(plain)), copy.deepcopy(plain)]
        tables = [pickle.loads(pickle.dumps(each)) for each in (TABLE, LINE)]
        tables += [copy.deepcopy(TABLE), functools.partial(TABLE)]
        values = [each([0.5, -1.0]).tolist() for each in (plain, *copies)]
        heights = [float(each(1.5)) for each in tables]
    assert values == [[math.sin(0.5), 0.0]] * 3
    assert heights == [float(each(1.5)) for each in (TABLE, LINE, TABLE, TABLE)]
    assert copies[0]([0.5, 2.0]).dtype == float


def test_numba_compiles():
    with while_traced():

        @numba.njit
        def kernel(n):
            values = np.zeros(n)
            values[0] = math.sin(0.5) + max(n, 2)
            return values

        assert kernel(3)[0] == math.sin(0.5) + 3


def test_names_that_modules_import():
    with while_traced():
        space = {}
        exec("from numpy import zeros\nfrom math import sin", space)
    assert space["zeros"] is np.zeros
    assert space["sin"] is math.sin


def test_two_traces_that_overlap():
    with while_traced():
        others = []

        def g(y):
            rates = np.empty(2)
            rates[:] = math.cos(y[0]), max(y[1], 1.0)
            return rates

        thread = threading.Thread(target=lambda: others.append(Field(g, "x v")))
        thread.start()
        thread.join(0.5)
    thread.join()
    expected = Field(lambda y: (np.cos(y[0]), np.maximum(y[1], 1.0)), "x v")
    assert others == [expected]
    assert all(by_name(name) is before for name, before in BEFORE.items())
