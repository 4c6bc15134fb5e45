"""The page of `explore` for fields: its numbers, its messages, and its behaviour in a browser."""

import contextlib
import json
import urllib.request
from urllib.parse import urlencode

import numpy as np
import pytest
from browser import check_silence, exported, pixels, put, rows, settle, show, text, wait

import suslov_fast as sf


def lorenz(state, sigma, rho):
    x, y, z = state
    return sigma * (y - x), x * (rho - z) - y, x * y - 8 / 3 * z


RHO = np.linspace(10, 28, 10)
FAMILY = sf.QuadraticField.from_function(lorenz, "x y z", sigma=np.array([[8.0], [10.0]]), rho=RHO)
# u = tan t until t = pi / 2.
TANGENT = sf.QuadraticField.from_function(lambda v: (1 + v[0] ** 2, v[0] * v[1]), "u w")
SQUARE = sf.QuadraticField([[[1.0]]])  # no next state where eps x = 1


def scene(field, query="", x0=None, **arguments):
    """What the page is told, by default of its own view."""
    with contextlib.closing(sf.explore(field, x0, **arguments)) as page:
        address, _, shown = page.url.partition("?")
        with urllib.request.urlopen(f"{address}scene?{query or shown}", timeout=60) as reply:
            return json.load(reply)


@pytest.mark.parametrize("method", ["auto", "order4"])
def test_orbits_equal_those_of_iterate(method):
    query = urlencode(
        {"x": "z", "y": "x", "starts": "1,1,20;0.5,0,9", "eps": 0.02, "steps": 50}
        | {"method": method, "member": "1,9"}
    )
    found, names = scene(FAMILY, query), {}
    exec(found["python"], names)
    run = names["run"]
    assert names["field"] == FAMILY[1, 9]
    assert run.method == method
    assert run.states.shape == (51, 2, 3)
    for k, orbit in enumerate(found["orbits"]):
        np.testing.assert_array_equal(rows(orbit["states"]), run.x[:, k][:, [2, 0]])
        assert (orbit["status"], orbit["valid"], orbit["first_pole"]) == ("OK", 51, -1)
    assert found["values"] == {"sigma": 10.0, "rho": 28.0}
    axes = found["field"]["axes"]
    assert axes[0] == {"count": 2, "parameters": {"sigma": [8.0, 10.0]}}
    assert axes[1] == {"count": 10, "parameters": {"rho": RHO.tolist()}}
    assert {"auto", "order4", "order6", "order8"} <= {*found["field"]["methods"]}


DRIVEN = sf.Field.from_function(lambda v, k: (v[1], -k * np.sin(v[0])), "q p", k=2.0)


@pytest.mark.filterwarnings("ignore::suslov_fast.PoleWarning")
@pytest.mark.parametrize("field", [DRIVEN, TANGENT])
def test_motions(field):
    """Of a `Field`, and of any field with a last time: states by `flow`, and how they end."""
    found = scene(field, x0=[[1.0, 0.5], [0.3, 0.1]], time=4.0, rtol=1e-6)
    names = {}
    exec(found["python"], names)
    run = names["run"]
    assert names["field"] == field
    assert run.rtol == 1e-6
    assert found["field"]["methods"] == []
    assert found["time"] == run.time.tolist()
    for k, orbit in enumerate(found["orbits"]):
        np.testing.assert_array_equal(rows(orbit["states"]), run.x[:, k])
        assert orbit["status"] == sf.Status(run.status[k]).name
        assert orbit["end"] == (None if field is DRIVEN else run.end[k])
        assert orbit["valid"] == np.isfinite(run.x[:, k, 0]).sum()
    query = "time=2.0&rtol=1e-9" + "&numbers=3.0" * (field is DRIVEN)
    again = scene(field, query, time=4.0)
    assert again["time"][-1] == 2.0
    assert field is TANGENT or again["values"] == {"k": 3.0}
    for query, name in (("rtol=1", "rtol"), ("time=a", "time"), ("eps=0.1", "parameters")):
        assert scene(field, query, time=4.0)["error"].startswith(name)


def test_energy():
    spring = sf.QuadraticField.from_hamiltonian(lambda q: (q[0] ** 2 + q[1] ** 2) / 2, "q p")
    orbit = scene(spring, x0=[3.0, 4.0])["orbits"][0]
    assert orbit["energy"] == 12.5
    assert orbit["change"] < 1e-12


@pytest.mark.parametrize(
    ("name", "query"),
    [
        ("eps", "eps=a"), ("steps", "steps=5001"), ("steps", "steps=2.5"), ("starts", "starts=1,2"),
        ("y", "starts=1,b,2"), ("x", "x=v"), ("method", "method=rk4"), ("member", "member=1"),
        ("member", "member=0,10"), ("parameters", "other=1"), ("parameters", "rtol=1e-6"),
        ("parameters", "eps=1&eps=2"),
    ],
)  # fmt: skip
def test_bad_values_are_answered_with_a_message(name, query):
    found = scene(FAMILY, query)
    assert found["error"].startswith(f"{name} must be ")
    assert found["fields"] == [name] * (name != "parameters")
    assert found["field"]["names"] == ["x", "y", "z"]


@pytest.fixture
def page(browser):
    """The page of the family; afterwards, check that it logged no error."""
    with contextlib.closing(sf.explore(FAMILY, [1, 1, 20], steps=300)) as shown:
        browser.look(1280, 800)
        browser.events.clear()
        show(browser, shown.url, "state", "field_plane", "field_controls")
        yield browser
        check_silence(browser, shown.url.partition("?")[0])


def test_controls(page):
    before = pixels(page)
    put(page, "rho-slider", 9)
    assert page.value("[state.scene.values.rho, byId('rho-slider').nextSibling.value]") == [
        28,
        "28",
    ]
    put(page, "y", "z", "change")
    assert page.value("state.scene.parameters.y") == "z"
    assert pixels(page) != before
    put(page, "method", "order4", "change")
    put(page, "eps", "0.02")
    put(page, "start-y", "2.5")
    found = page.value("state.scene.parameters")
    assert (found["method"], found["eps"], found["starts"]) == ("order4", 0.02, [[1, 2.5, 20]])
    put(page, "eps", "")
    assert text(page, "message").startswith("eps must")
    assert text(page, "regime-name") == "No orbit"
    put(page, "eps", "0.01")
    assert page.value("byId('message').hidden") is True
    page.wait("location.search === `?${query()}`")  # written after a pause
    before = pixels(page)
    show(page, page.value("location.href"))
    wait(lambda: pixels(page) == before)


def test_clicks_are_starts(page):
    page.value("byId('keep').click()")
    for k, point in enumerate([[1.5, 4.0], [4.0, 6.0]]):
        x, y = page.value(
            f"(({{x, y}}, [u, v]) => [x + u, y + v])"
            f"(byId('plane').getBoundingClientRect(), at({point}))"
        )
        where = {"x": x, "y": y, "button": "left", "clickCount": 1}
        page.call("Input.dispatchMouseEvent", type="mousePressed", buttons=1, **where)
        page.call("Input.dispatchMouseEvent", type="mouseReleased", buttons=0, **where)
        settle(page)
        starts = page.value("state.scene.parameters.starts")
        assert len(starts) == k + 2
        assert starts[0] == [1, 1, 20]
        assert starts[-1] == pytest.approx([*point, 20], abs=0.05)
    page.value("byId('clear').click()")
    settle(page)
    assert len(page.value("state.scene.orbits")) == 1


def test_exports(page, tmp_path):
    table, picture = exported(page, tmp_path)
    np.testing.assert_array_equal(table[:, 3:5], page.value("state.scene.orbits[0].states"))
    assert "QuadraticField" in picture


def test_poles_are_said_and_nothing_is_cut_on_a_phone(browser):
    for field, name, failure in (
        (TANGENT, "Passed a pole", ""),
        (SQUARE, "Ends at a pole", "State 1 does not exist: state 0 lies on a pole of the map."),
    ):
        eps, steps = (0.05, 100) if field is TANGENT else (1.0, 3)
        with contextlib.closing(sf.explore(field, eps=eps, steps=steps)) as shown:
            browser.look(390, 844)
            show(browser, shown.url)
            assert text(browser, "regime-name") == name
            assert text(browser, "failure") == failure
            assert browser.value("document.documentElement.scrollWidth") <= 390


def test_named_parameters_of_a_single_field():
    """A single field has its parameters as numbers, while the function that made it is there."""
    field = sf.QuadraticField.from_function(lorenz, "x y z", sigma=10, rho=28)
    assert scene(field)["field"]["numbers"] == {"sigma": 10.0, "rho": 28.0}
    found = scene(field, "numbers=8.0,14.5&eps=0.02&steps=20", x0=[1, 1, 20])
    other = sf.QuadraticField.from_function(lorenz, "x y z", sigma=8, rho=14.5)
    run = sf.iterate(other, [[1.0, 1.0, 20.0]], 0.02, 20)
    np.testing.assert_array_equal(rows(found["orbits"][0]["states"]), run.x[:, 0, :2])
    assert found["values"] == {"sigma": 8.0, "rho": 14.5}
    assert found["parameters"]["numbers"] == [8.0, 14.5]
    names = {}
    exec(found["python"], names)
    assert names["field"] == other
    assert scene(field, "numbers=8.0,b")["fields"] == ["rho"]
    assert scene(field, "numbers=,14.5")["error"] == "sigma must be a number, not ''"
    assert scene(field, "numbers=8.0")["error"].startswith("numbers must be 2 numbers")
    loaded = sf.body_from_dict(field.to_dict())
    assert loaded == field
    assert scene(loaded)["field"]["numbers"] == {}


def test_errors_of_the_function_of_the_user_are_shown_on_the_page():
    """Whatever their class is: a function may look its parameter up."""

    def switched(x, mode):
        return ({1.0: x[0], 2.0: -x[0]}[mode],)

    field = sf.QuadraticField.from_function(switched, "u", mode=1.0)
    assert scene(field, "numbers=3.0", [1.0], eps=0.1, steps=3)["error"] == "KeyError: 3.0"
