"""The page of `suslov-fast explore`: its numbers, its server, and its behaviour in a browser."""

import contextlib
import http.client
import json
import os
import re
import signal
import subprocess
import sys
import threading
import urllib.request
import warnings
from urllib.parse import urlencode, urlsplit

import numba
import numpy as np
import pytest
from browser import Browser

import suslov_fast as sf
from suslov_fast._show.explore.parameters import PRESETS, Parameters, parse_query
from suslov_fast._show.explore.scene import scene
from suslov_fast._show.explore.server import Server

PICTURE_1 = Parameters(4.0, 1.0, -0.5, -0.3, 0.2, -0.8, 1.3, 40)
POLE = PRESETS["A pole: no next state"]
# Parameters, the regime and the status.
CASES = {
    "below": (PICTURE_1, "below", "OK"),
    "backwards": (PICTURE_1._replace(eps=-0.2), "below", "OK"),
    "matter": (Parameters(3.0, 3.0, -0.2, -0.2, 1.0, -1.5, 1.4, 20), "below", "OK"),
    "ahead": (PRESETS["Long steps: t = 0.5"], "ahead", "OK"),
    "at": (PRESETS["t = 1"], "at", "SUPERCRITICAL"),
    "above": (PRESETS["t > 1: jumps"], "above", "SUPERCRITICAL"),
    "pole": (POLE, "pole", "SINGULAR"),
    "at rest": (PICTURE_1._replace(Omega1=0.0, Omega2=0.0), "steady", "OK"),
    "no products": (PICTURE_1._replace(I13=0.0, I23=0.0), "steady", "OK"),
    "no step": (PICTURE_1._replace(eps=0.0), "still", "OK"),
    "rotor": (PICTURE_1._replace(k=2.0), "rotor", "OK"),
    "weak rotor": (PICTURE_1._replace(k=-0.1), "below", "OK"),
    "tiny": (PICTURE_1._replace(I1=1e-300, I13=1e-200), None, None),
    "beyond": (PICTURE_1._replace(Omega1=1e308, Omega2=1e308, eps=1e308), None, None),
}
MOVING = ["below", "backwards", "matter", "above", "rotor", "weak rotor"]


def rows(found, size=2):
    return np.array([[np.nan] * size if row is None else row for row in found])


@pytest.mark.filterwarnings("ignore:.*range:RuntimeWarning")
@pytest.mark.parametrize("case", CASES)
def test_numbers_equal_those_of_the_package(case):
    parameters, regime, name = CASES[case]
    found = json.loads(json.dumps(scene(parameters._replace(portrait=1)), allow_nan=False))
    body, omega0, eps = parameters.body, parameters.omega0, parameters.eps
    run = sf.iterate(body, omega0, eps, parameters.steps, attitude=True, on_singular="ignore")
    np.testing.assert_array_equal(rows(found["omega"]), run.omega)
    np.testing.assert_array_equal(rows(found["attitude"], 9).reshape(-1, 3, 3), run.attitude)
    assert len(found["flow"]) == len(found["time"]) == len(run.omega)
    time = np.array([each for each in found["time"] if each is not None])
    np.testing.assert_array_equal(rows(found["flow"])[: len(time)], sf.flow(body, omega0, time))
    for quantity, value in {
        "F": sf.first_integral(body, omega0, eps),
        "criticality": sf.criticality(body, omega0, eps),
        "omega_plus": sf.limits(body, omega0, eps)[1],
    }.items():
        expected = value.tolist() if np.isfinite(value).all() else None
        assert found["numbers"][quantity] == expected, quantity
    status = sf.Status(int(run.status))
    failed_at = int(run.failed_at) if status < 0 else None
    expected = {"name": status.name, "message": status.message, "failed_at": failed_at}
    assert found["status"] == expected
    if regime is not None:
        assert (found["regime"]["name"], status.name) == (regime, name)


@pytest.mark.parametrize("case", MOVING)
def test_curves_and_portrait(case):
    parameters = CASES[case][0]._replace(portrait=1)
    found, body, eps = scene(parameters), parameters.body, parameters.eps
    for branch in found["levels"]["F"]:
        F = sf.first_integral(body, branch, eps)
        np.testing.assert_allclose(F, found["numbers"]["F"], rtol=1e-9)
    E = sf.energy(body, found["levels"]["energy"])
    np.testing.assert_allclose(E, found["numbers"]["energy"], rtol=1e-13)
    for half, sign in (("repelling", 1), ("attracting", -1)):
        state = np.add(found["line"]["middle"], 3.0 * np.array(found["line"][half]))
        np.testing.assert_allclose(sf.vector_field(body, state), 0, atol=1e-15)
        multipliers = np.linalg.eigvals(sf.jacobian(body, state, eps))
        assert np.sign(np.prod(abs(multipliers)) - 1) == sign
    orbits = found["portrait"]["orbits"]
    assert len(orbits) == 20
    for orbit in map(rows, orbits):
        after = sf.step(body, orbit[:-1], eps)
        np.testing.assert_allclose(orbit[1:], after, atol=1e-4 * abs(orbit).max())
    drawn, (I1, I2, I13, I23) = found["ellipsoid"], parameters[:4]
    tensor = np.array([[I1, 0, I13], [0, I2, I23], [I13, I23, drawn["I3"]]])
    points = np.array(drawn["axes"]) * drawn["radii"]
    squares = np.einsum("ik,ij,jk->k", points, tensor, points)
    np.testing.assert_allclose(squares, squares[0], rtol=1e-13)
    low, high = sf.Suslov3D(*parameters[:4]).admissible_I3()
    assert drawn["matter"] == (low < drawn["I3"] < high)


def test_presets_match_their_names():
    for name, parameters in PRESETS.items():
        found, names = scene(parameters), {}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sf.SingularStepWarning)
            exec(found["python"], names)
        np.testing.assert_array_equal(names["run"].omega, rows(found["omega"]))
        assert found["ellipsoid"]["matter"] == ("no rigid body" not in name)
        assert np.abs(parameters.omega0).max() < parameters.extent


@pytest.fixture(scope="module")
def server():
    with Server(0) as running:
        thread = threading.Thread(target=running.serve_forever, args=(0.02,))
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def ask(server, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=300)
    with contextlib.closing(connection):
        connection.request(method, path, headers=headers)
        reply = connection.getresponse()
        return reply, reply.read()


def query(parameters, **other):
    return urlencode(parameters._asdict() | other)


def test_the_page_is_served_and_refers_to_nothing_else(server):
    reply, body = ask(server, f"/scene?{query(POLE)}")
    assert (reply.status, reply.headers["Content-Type"]) == (200, "application/json")
    assert json.loads(body) == json.loads(json.dumps(scene(POLE)))
    settings = json.loads(ask(server, "/settings")[1])
    assert [each["name"] for each in settings["presets"]] == list(PRESETS)
    referred = set()
    for path in ("/", f"/?{query(PICTURE_1)}", "/style.css", "/explore.js"):
        reply, body = ask(server, path)
        assert reply.status == 200
        assert "default-src 'self'" in reply.headers["Content-Security-Policy"]
        text = body.decode()
        referred |= set(re.findall(r'(?:src|href)="(/[^"]*)"|fetch\("(/\w+)', text))
        assert set(re.findall(r"https?://[\w.]+", text)) <= {"http://www.w3.org"}
        assert "url(" not in text.replace("url(#frame)", "")
    names = {"".join(pair) for pair in referred}
    assert names == {"/style.css", "/explore.js", "/scene", "/settings"}


def test_bad_values_are_answered_with_a_message(server):
    for change, message, field in (
        ({"I1": "0"}, "I1: expected a positive moment of inertia, got 0", "I1"),
        ({"eps": "1e999"}, "eps: expected a number, got '1e999'", "eps"),
        ({"Omega2": "<b>"}, "Omega2: expected a number, got '<b>'", "Omega2"),
        ({"steps": "2.5"}, "steps: expected an integer from 1 to 5000, got 2.5", "steps"),
        ({"I1": "1e300", "I2": "1e-300"}, "I1, I2: expected moments within a factor of", "I1 I2"),
        ({"other": "4"}, "parameters: expected each of I1, I2, I13, I23, eps, Omega1, O", ""),
    ):
        reply, body = ask(server, f"/scene?{query(PICTURE_1, **change)}")
        answer = json.loads(body)
        assert (reply.status, answer["fields"]) == (200, field.split())
        assert answer["error"].startswith(message)
    far = query(PICTURE_1, I2="1e-320"), query(PICTURE_1, I13="1e300")
    for path in ("I1=4", f"{query(PICTURE_1)}&I1=4", *far, "&".join(f"I{k}=1" for k in range(30))):
        assert "error" in json.loads(ask(server, f"/scene?{path}")[1]), path


def test_nothing_else_is_served(server):
    for path in ("/../pyproject.toml", "/%2e%2e/__init__.py", "/page/explore.js"):
        assert ask(server, path)[0].status == 404, path
    for method, text in (("POST", b"suslov-fast: expected a GET request\n"), ("HEAD", b"")):
        reply, body = ask(server, "/", method)
        assert (reply.status, body) == (501, text)
    assert server.socket.getsockname()[0] == "127.0.0.1"


def test_foreign_pages_are_refused(server):
    def status(**headers):
        return ask(server, "/settings", **headers)[0].status

    port = server.port
    for host in ("example.org", f"example.org:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}", ""):
        assert status(Host=host) == 403
    for name in ("127.0.0.1", "localhost"):
        assert status(Host=f"{name}:{port}") == 200


def test_explore_in_a_notebook():
    body = sf.SuslovGyrostat(4, 2, -0.5, -0.3, 0.7)
    shown = sf.explore(body, [-0.9, 1.3], eps=0.2, steps=50)
    try:
        view = parse_query(urlsplit(shown.url).query)
        found = (view.body, view.omega0, view.eps, view.steps)
        assert found == (body, [-0.9, 1.3], 0.2, 50)
        assert f'src="{shown.url.replace("&", "&amp;")}"' in shown._repr_html_()
        with urllib.request.urlopen(shown.url, timeout=60) as page:
            assert b"suslov_fast" in page.read()
    finally:
        shown.close()
    for arguments, message in (
        ((sf.SuslovND([1, 2], [1, 1]),), "body: expected"),
        ((sf.Suslov3D([4, 3], 2, -0.5, -0.3),), "a single body"),
        ((body, [1, 2, 3]), "omega0: expected shape"),
        ((body, [1, 2], 0.1, 6000), "steps: expected an integer from 1 to 5000"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            sf.explore(*arguments)


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
def test_a_signal_ends_the_command():
    parameters = PICTURE_1._replace(I1=0.1 + 0.2, eps=-1e-17, Omega1=2.0**60, extent=3.5)
    link = f"http://127.0.0.1:1/?{query(parameters)}&show=F"
    command = [sys.executable, "-m", "suslov_fast", "explore", "--no-browser", link]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:
        url = process.stdout.readline().strip()
        view, _, show = urlsplit(url).query.rpartition("&")
        assert (parse_query(view), show) == (parameters, "show=F")
        with urllib.request.urlopen(url, timeout=60) as page:
            assert b"suslov_fast" in page.read()
        process.send_signal(signal.SIGTERM)
        output, errors = process.communicate(timeout=60)
    assert (process.returncode, output) == (0, "")
    assert errors == "suslov-fast: Ctrl-C ends the server\n"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if numba.config.DISABLE_JIT:
        pytest.skip("a page that waits for interpreted kernels")
    running = Browser(tmp_path_factory.mktemp("browser"))
    yield running
    running.close()


@pytest.fixture
def page(browser, server):
    """The initial page; afterwards, check that it logged no error and contacted no other server."""
    browser.look(1280, 800)
    browser.events.clear()
    show(browser, server)
    yield browser
    errors = {"Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"}
    for event in browser.events:
        assert event.get("method") not in errors, event
        if event.get("method") == "Network.requestWillBeSent":
            address = event["params"]["request"]["url"]
            assert address.startswith((server.url, "data:", "blob:")), address


def show(browser, server, parameters=None, **view):
    address = "" if parameters is None else f"?{query(parameters, **view)}"
    browser.open("about:blank")
    browser.open(server.url + address)
    settle(browser)


def settle(browser):
    browser.wait("typeof scene !== 'undefined' && scene !== null && !asking")


def put(browser, field, value, name="number"):
    """Write a number into a field, or move its slider."""
    place, event = f"inputs[{field!r}].{name}", "new Event('input', {bubbles: 1})"
    browser.value(f"{place}.value = {str(value)!r}; {place}.dispatchEvent({event})")
    settle(browser)


def pixels(browser):
    return browser.value("byId('plane').toDataURL()")


def text(browser, name):
    return browser.value(f"byId({name!r}).textContent")


@pytest.mark.slow
def test_each_parameter_changes_the_picture(page):
    assert text(page, "status") == "OK"
    assert page.value("byId('preset').value") == next(iter(PRESETS))
    for field in Parameters._fields[:8]:
        before = pixels(page)
        put(page, field, {"I13": 0.4, "Omega1": 1.5, "steps": 30}.get(field, 0.9))
        assert pixels(page) != before, field
        put(page, field, 2, "slider")
        assert page.value(f"inputs.{field}.number.value") == "2"
        assert page.value(f"scene.parameters.{field}") == 2
    assert page.value("byId('preset').value") == ""


@pytest.mark.slow
def test_every_case_is_drawn_without_an_error(page, server):
    for parameters, _, status in CASES.values():
        show(page, server, parameters, show="F energy flow joined portrait")
        assert text(page, "status") == (status or text(page, "status"))


def test_the_start_follows_the_mouse(page):
    moves = ("Pressed", [1.0, 0.5]), ("Moved", [-1.5, 2.0]), ("Released", [-1.5, 2.0])
    for kind, omega in moves:
        x, y = page.value(
            f"(({{x, y}}, [u, v]) => [x + u, y + v])"
            f"(byId('plane').getBoundingClientRect(), view().at({omega}))"
        )
        where = {"x": x, "y": y, "button": "left", "buttons": int(kind != "Released")}
        page.call("Input.dispatchMouseEvent", type=f"mouse{kind}", clickCount=1, **where)
        settle(page)
    assert page.value("scene.omega[0]") == pytest.approx(omega, abs=0.02)


def test_the_address_keeps_the_view(page):
    put(page, "I1", "0")
    assert text(page, "message") == "I1: expected a positive moment of inertia, got 0.0"
    put(page, "I1", "2.5")
    assert page.value("byId('message').hidden") is True
    page.value("document.querySelector('#show input[value=portrait]').click()")
    settle(page)
    assert page.value("scene.portrait.orbits.length") == 20
    page.wait("location.search.includes('I1=2.5') && location.search.includes('portrait')")
    address, before = page.value("location.href"), pixels(page)
    page.open("about:blank")
    page.open(address)
    settle(page)
    assert pixels(page) == before
    assert page.value("[...shown].sort().join(' ')") == "F energy portrait"


def test_exports(page, server, tmp_path):
    show(page, server, POLE._replace(Omega2=-8.5), show="portrait F energy")
    page.call("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    for kind in ("csv", "svg", "png"):
        page.value(f"byId('save-{kind}').click()")
        page.wait(f"byId('copied').textContent === 'Saved suslov-orbit.{kind}'")
    page.wait("new Promise((done) => setTimeout(() => done(true), 300))")
    table = np.loadtxt(tmp_path / "suslov-orbit.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 2:], rows(page.value("scene.omega"))[: len(table)])
    np.testing.assert_array_equal(table[:, 1], table[:, 0] * POLE.eps)
    assert "repelling steady states" in (tmp_path / "suslov-orbit.svg").read_text("utf-8")
    assert (tmp_path / "suslov-orbit.png").read_bytes().startswith(b"\x89PNG")


def test_the_body_turns_about_one_axis_between_two_states(page):
    ends = page.value("[orientation(20, 0), orientation(20, 1 - 1e-12), scene.attitude[21]]")
    np.testing.assert_allclose(ends[1], ends[2], atol=1e-10)
    half = np.reshape(page.value("orientation(20, 0.5)"), (3, 3))
    first, second = np.reshape(ends[0], (3, 3)), np.reshape(ends[2], (3, 3))
    np.testing.assert_allclose(half @ first.T @ half, second, atol=1e-12)
