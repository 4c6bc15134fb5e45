"""The page of `explore`: its numbers are those of `iterate` and `flow`, and failures are a text."""

import html
import os
import re
import signal
import sys

import children
import numpy as np
import pytest

import suslov_fast as sf

bokeh = pytest.importorskip("bokeh")

from bokeh.application import Application  # noqa: E402
from bokeh.application.handlers import FunctionHandler  # noqa: E402
from bokeh.client import pull_session  # noqa: E402
from bokeh.events import ButtonClick  # noqa: E402
from bokeh.models import Button, Select, Slider  # noqa: E402

BODY = sf.Suslov3D(4, 2, -0.5, -0.3)


def rates(x, friction):
    return x[1], -np.sin(x[0]) - friction * x[1]


def pendulum(friction):
    return sf.Field(rates, "angle velocity", friction=friction)


def page_of(monkeypatch, *arguments, **options):
    """Return the document that a visitor of the page gets, and its sliders by their titles."""
    served = []
    module = sys.modules[sf.explore.__module__]
    monkeypatch.setattr(module, "serve", lambda page, port: served.append((page, port)))
    sf.explore(*arguments, **options)
    [(page, _)] = served
    document = Application(FunctionHandler(page)).create_document()
    return document, {each.title: each for each in document.select({"type": Slider})}


def check(document, states, time):
    """Compare what the figures show with states (N, 2)."""
    shown = document.get_model_by_name("states").data
    found = [np.asarray(shown[name]) for name in "txy"]
    np.testing.assert_array_equal(found, [time, *np.transpose(states)])


def test_a_body(monkeypatch):
    document, sliders = page_of(monkeypatch, BODY, [-0.9, 1.3], eps=0.1, steps=40)
    run = sf.iterate(BODY, [-0.9, 1.3], 0.1, 40)
    check(document, run.states, run.time)
    assert {*sliders} == {*"I1 I2 I13 I23 eps steps Omega1(0) Omega2(0)".split()}
    assert sliders["I1"].start > 0
    for name, value in {"I2": 3.0, "eps": 0.15, "steps": 50, "Omega1(0)": 0.5}.items():
        sliders[name].value = value
    run = sf.iterate(sf.Suslov3D(4, 3, -0.5, -0.3), [0.5, 1.3], 0.15, 50)
    check(document, run.states, run.time)
    first, second = sorted(document.select({"type": Select}), key=lambda each: each.value)
    first.value, second.value = "Omega2", "Omega1"
    check(document, run.states[:, ::-1], run.time)
    document.callbacks.trigger_event(ButtonClick(document.select_one({"type": Button})))
    run = sf.iterate(BODY, [-0.9, 1.3], 0.1, 40)
    check(document, run.states[:, ::-1], run.time)
    times = np.linspace(0.0, 3.0, 2001)
    document, _ = page_of(monkeypatch, BODY, [-0.9, 1.3], time=3.0)
    check(document, sf.flow(BODY, [-0.9, 1.3], time=times).states, times)


def test_a_family_of_fields(monkeypatch):
    """A slider goes from the least to the largest value of the family, and begins at its first."""
    document, sliders = page_of(monkeypatch, pendulum([0.3, 0.1, 0.9]), [2.5, 0.0], time=9.0)
    friction = sliders["friction"]
    assert (friction.start, friction.value, friction.end) == (0.1, 0.3, 0.9)
    times = np.linspace(0.0, 9.0, 2001)
    check(document, sf.flow(pendulum(0.3), [2.5, 0.0], time=times).states, times)
    friction.value, sliders["velocity(0)"].value = 0.5, 1.0
    check(document, sf.flow(pendulum(0.5), [2.5, 1.0], time=times).states, times)


def test_vectors_of_parameters_and_many_variables(monkeypatch):
    body = sf.SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
    document, sliders = page_of(monkeypatch, body)
    sliders["J2"].value, sliders["I3"].value = 2.5, 0.4
    changed = sf.SuslovND(J=[1.3, 2.5, 3.7], I=[0.4, -0.7, 0.4])
    run = sf.iterate(changed, [1.0, 1 / 2, 1 / 3], 0.2, 500)
    check(document, run.states[:, :2], run.time)
    chain = sf.Field(lambda x: np.roll(x, 1) - x, 25)
    _, sliders = page_of(monkeypatch, chain, np.arange(25.0), time=1.0)
    assert len(sliders) == 1 + 20


def test_failures_are_a_line_of_text(monkeypatch):
    """A solution that ends shows states up to there, and a system that cannot be made none."""
    field = sf.Field(lambda x, a: (a * x[0] ** 3,), "x", a=1.0)
    document, sliders = page_of(monkeypatch, field, [0.5], time=1.0)
    sliders["a"].value, sliders["time"].value = 2.0, 2.0
    shown = document.get_model_by_name("states").data
    last = shown["t"][np.isfinite(shown["x"])][-1]
    assert 0.99 < last <= 1.0  # x = 1 / sqrt(4 - 4 t)
    assert "t = 1" in document.get_model_by_name("message").text
    document, sliders = page_of(monkeypatch, BODY)
    sliders["I1"].value = -1.0
    assert "I1" in html.unescape(document.get_model_by_name("message").text)
    assert len(document.get_model_by_name("states").data["x"]) == 0
    sliders["I1"].value = 4.0
    assert len(document.get_model_by_name("states").data["x"]) == 501


@pytest.mark.parametrize(
    ("arguments", "options"),
    [
        ((BODY, [1.0, 2.0, 3.0]), {}),
        ((BODY,), {"eps": 0.1, "time": 1.0}),
        ((pendulum(0.1),), {"eps": 0.1}),
        ((rates,), {}),
    ],
)
def test_wrong_arguments_are_told_before_anything_is_served(monkeypatch, arguments, options):
    with pytest.raises((TypeError, ValueError)):
        page_of(monkeypatch, *arguments, **options)


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_it_is_served_until_ctrl_c():
    code = (
        "import signal, suslov_fast as sf; signal.signal(2, signal.default_int_handler)\n"
        "sf.explore(sf.Suslov3D(4, 2, -0.5, -0.3), [-0.9, 1.3])"
    )
    with children.start(code, BROWSER="true") as process:
        address = re.match(r"http://localhost:\d+/", process.stdout.readline())[0]
        with pull_session(url=address) as session:
            slider = session.document.select_one({"title": "I2"})
            slider.value = 3.0
            session.force_roundtrip()
            session.pull()
            run = sf.iterate(sf.Suslov3D(4, 3, -0.5, -0.3), [-0.9, 1.3], 0.2, 500)
            check(session.document, run.states, run.time)
        process.send_signal(signal.SIGINT)
        process.wait(timeout=30)
    assert process.returncode == 0
