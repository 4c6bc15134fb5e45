"""The page of `explore`: its numbers, its server, and its behaviour in a browser."""

import contextlib
import http.client
import itertools
import json
import re
import threading
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import urlencode, urlsplit

import numpy as np
import pytest
from browser import check_silence, pixels, put, serve, settle, text

import suslov_fast as sf
from suslov_fast.bodies.rigid import PICTURES
from suslov_fast.plots.explore import server as serving
from suslov_fast.plots.explore.scene import PAGE, Parameters, parse_query, scene
from suslov_fast.plots.explore.server import Server

NAMES, VALUES = (
    json.loads(text.replace(";", ""))
    for text in re.findall(
        r"= ([\[{].*?[\]}];)$", (PAGE / "presets.js").read_text("utf-8"), re.S | re.M
    )
)
PRESETS = {
    name: Parameters(**dict(zip(NAMES, values, strict=True))) for name, values in VALUES.items()
}
PICTURE_1 = Parameters(4.0, 1.0, -0.5, -0.3, 0.0, 0.2, -0.8, 1.3, 40)
POLE = PRESETS["A pole: no next state"]
# Parameters, the regime and the status.
CASES = {
    "below": (PICTURE_1, "below", "OK"),
    "backwards": (PICTURE_1._replace(eps=-0.2), "below", "OK"),
    "ahead": (PRESETS["Long steps: t = 0.5"], "ahead", "OK"),
    "at": (PRESETS["t = 1"], "at", "SUPERCRITICAL"),
    "above": (PRESETS["t > 1: jumps"], "above", "SUPERCRITICAL"),
    "pole": (POLE, "pole", "SINGULAR"),
    "at rest": (PICTURE_1._replace(Omega1=0.0, Omega2=0.0), "steady", "OK"),
    "no products": (PICTURE_1._replace(I13=0.0, I23=0.0), "steady", "OK"),
    "no step": (PICTURE_1._replace(eps=0.0), "still", "OK"),
    "rotor": (PICTURE_1._replace(k=2.0), "rotor", "OK"),
    "weak rotor": (PICTURE_1._replace(k=-0.1), "below", "OK"),
    "beyond": (PICTURE_1._replace(Omega1=1e300, Omega2=1e300, eps=1e30), None, None),
}


def rows(found, size=2):
    return np.array([[np.nan] * size if row is None else row for row in found])


@pytest.mark.parametrize("case", CASES)
def test_numbers_equal_those_of_the_package(case):
    parameters, regime, name = CASES[case]
    found = json.loads(json.dumps(scene(parameters._replace(show="portrait")), allow_nan=False))
    if regime is None:
        return
    body, omega0, eps = parameters.body, parameters[6:8], parameters.eps
    run = sf.iterate(body, omega0, eps, parameters.steps, attitude=True, on_singular="ignore")
    np.testing.assert_array_equal(rows(found["omega"]), run.omega)
    np.testing.assert_array_equal(rows(found["attitude"], 9).reshape(-1, 3, 3), run.attitude)
    np.testing.assert_array_equal(rows(found["flow"]), sf.flow(body, omega0, run.time))
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
    assert (found["regime"], status.name) == (regime, name)


@pytest.mark.parametrize("case", ["below", "backwards", "above", "rotor", "weak rotor"])
def test_curves_and_portrait(case):
    parameters = CASES[case][0]._replace(show="portrait")
    found, body, eps = scene(parameters), parameters.body, parameters.eps
    for branch in found["levels"]["F"]:
        F = sf.first_integral(body, branch, eps)
        np.testing.assert_allclose(F, found["numbers"]["F"], rtol=1e-9)
    E = sf.energy(body, found["levels"]["energy"])
    np.testing.assert_allclose(E, found["numbers"]["energy"], rtol=1e-13)
    middle, repelling = np.array(found["line"])
    for sign in (1, -1):
        state = middle + sign * 3.0 * repelling
        np.testing.assert_allclose(sf.vector_field(body, state), 0, atol=1e-15)
        multipliers = np.linalg.eigvals(sf.jacobian(body, state, eps))
        assert np.sign(np.prod(abs(multipliers)) - 1) == sign
    assert len(found["portrait"]["orbits"]) == {"rotor": 15}.get(case, 20)
    for orbit in map(rows, found["portrait"]["orbits"]):
        after = sf.step(body, orbit[:-1], eps)
        np.testing.assert_allclose(orbit[1:], after, atol=1e-4 * abs(orbit).max())
    drawn, (I1, I2, I13, I23) = found["ellipsoid"], parameters[:4]
    tensor = np.array([[I1, 0, I13], [0, I2, I23], [I13, I23, drawn["I3"]]])
    points = np.array(drawn["axes"]) * drawn["radii"]
    squares = np.einsum("ik,ij,jk->k", points, tensor, points)
    np.testing.assert_allclose(squares, squares[0], rtol=1e-13)
    low, high = sf.Suslov3D(*parameters[:4]).admissible_I3()
    assert drawn["matter"] == (low < drawn["I3"] < high)


@pytest.mark.filterwarnings("ignore::suslov_fast.SingularStepWarning")
@pytest.mark.parametrize("name", PRESETS)
def test_presets_match_their_names(name):
    parameters, names = PRESETS[name], {}
    found = scene(parameters)
    exec(found["python"], names)
    np.testing.assert_array_equal(names["run"].omega, rows(found["omega"]))
    assert found["ellipsoid"]["matter"] == ("no rigid body" not in name)
    assert np.abs(parameters[6:8]).max() < parameters.extent
    if number := re.search(r"picture (\d)", name):
        picture = parameters.body, parameters.eps, parameters.extent
        assert picture == PICTURES[int(number[1])]


@pytest.fixture(scope="module")
def server():
    with serve(Server(0)) as running:
        yield running


def ask(server, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=300)
    headers = {name.replace("_", "-"): value for name, value in headers.items()}
    with contextlib.closing(connection):
        connection.request(method, path, headers=headers)
        reply = connection.getresponse()
        return reply, reply.read()


def query(parameters, **other):
    return urlencode(parameters._asdict() | other)


def test_the_page_is_served_and_refers_to_nothing_else(server):
    reply, body = ask(server, f"/scene?{query(POLE)}")
    assert (reply.status, reply.headers["Content-Type"]) == (200, "application/json")
    assert json.loads(body) == json.loads(json.dumps(scene(parse_query(query(POLE)))))
    left, found = ["/", "/style.css"], set()
    while left:
        found.add(path := left.pop())
        reply, body = ask(server, path)
        assert reply.status == 200, path
        assert "default-src 'self'" in reply.headers["Content-Security-Policy"]
        text = body.decode()
        referred = re.findall(r'(?:src="|href="|from "\.)(/[^"]*)"', text)
        left += [each for each in referred if each not in found]
        addresses = set(re.findall(r"https?://[\w.]+", text))
        assert addresses <= {"http://www.w3.org", "http://127.0.0.1"}
        assert "url(" not in text.replace("url(#frame)", "")
        assert len(text.splitlines()) <= 250, path
    files = {f"/{file.name}" for file in PAGE.iterdir()}
    assert files - {"/index.html", "/widget.js"} == found - {"/"}


def test_bad_values_are_answered_with_a_message(server):
    for change, field in (
        ({"I1": "0"}, "I1"),
        ({"eps": "1e999"}, "eps"),
        ({"Omega2": "<b>"}, "Omega2"),
        ({"steps": "2.5"}, "steps"),
        ({"other": "4"}, "parameters"),
    ):
        reply, body = ask(server, f"/scene?{query(PICTURE_1, **change)}")
        answer = json.loads(body)
        assert (reply.status, answer["fields"]) == (200, [field] * (field in Parameters._fields))
        assert answer["error"].startswith(f"{field}: expected ")
    for path in ("I1=4", f"{query(PICTURE_1)}&I1=4"):
        assert "error" in json.loads(ask(server, f"/scene?{path}")[1]), path


def test_nothing_else_is_served(server):
    for path in ("/../server.py", "/%2e%2e/server.py", "//etc/hostname", "/page/main.js"):
        assert ask(server, path)[0].status == 404, path
    assert ask(server, "/%00")[0].status == ask(server, "/a%0Ab")[0].status == 400
    assert ask(server, "/", "POST")[0].status == 501
    assert server.socket.getsockname()[0] == "127.0.0.1"


def test_threads_are_bounded(server, monkeypatch):
    """Of forty requests at once thirty-two are under way; the others wait."""
    under_way, most, enough, go = [], [], threading.Event(), threading.Event()

    def slow(query):
        under_way.append(query)
        most.append(len(under_way))
        if len(under_way) == 32:
            enough.set()
        go.wait()
        under_way.pop()
        return {}

    monkeypatch.setattr(serving, "answer", slow)
    with ThreadPoolExecutor(40) as pool:
        replies = [pool.submit(ask, server, "/scene?") for _ in range(40)]
        enough.wait()
        go.set()
        assert [reply.result()[0].status for reply in replies] == [200] * 40
    assert max(most) == 32


def test_foreign_pages_are_refused(server):
    """A name elsewhere may lead to this address, and other pages may ask for numbers."""
    numbers, port = f"/scene?{query(PICTURE_1)}", server.port
    hosts = "example.org", f"example.org:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}", ""
    for host, path, method in itertools.product(hosts, (numbers, "/"), ("GET", "HEAD")):
        assert ask(server, path, method, Host=host)[0].status == 403
    assert ask(server, "/", "HEAD")[0].status == ask(server, numbers, "HEAD")[0].status == 200
    assert ask(server, numbers, Host=f"localhost:{port}")[0].status == 200
    for site, status in (("cross-site", 403), ("same-site", 403), ("same-origin", 200)):
        assert ask(server, numbers, Sec_Fetch_Site=site)[0].status == status
    assert ask(server, "/", Sec_Fetch_Site="cross-site")[0].status == 200  # a link, or a frame


def test_page_without_a_notebook_extra(monkeypatch):
    monkeypatch.setattr(serving, "find_spec", lambda name: None)
    body = sf.SuslovGyrostat(4, 2, -0.5, -0.3, 0.7)
    page = sf.explore(body, [-0.9, 1.3], eps=0.2, steps=50)
    with contextlib.closing(page):
        view = parse_query(urlsplit(page.url).query)
        assert (view.body, view[5:9]) == (body, (0.2, -0.9, 1.3, 50))
        assert f'src="{page.url.replace("&", "&amp;")}"' in page._repr_mimebundle_()["text/html"]
        with urllib.request.urlopen(page.url, timeout=60) as answer:
            assert b"suslov_fast" in answer.read()


@pytest.fixture
def page(browser, server):
    """The initial page; afterwards, check that it logged no error and contacted no other server."""
    browser.look(1280, 800)
    browser.events.clear()
    show(browser, server)
    yield browser
    check_silence(browser, server.url)


def show(browser, server, parameters=None, **view):
    address = "" if parameters is None else f"?{query(parameters, **view)}"
    browser.open("about:blank")
    browser.open(server.url + address)
    settle(browser)
    for module in ("state", "space", "plane"):
        browser.value(f"import('/{module}.js').then((found) => void Object.assign(window, found))")


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
    assert page.value("state.scene.omega[0]") == pytest.approx(omega, abs=0.02)


def test_the_address_keeps_the_view(page):
    put(page, "I1", "0")
    assert text(page, "message").startswith("I1: expected")
    put(page, "I1-slider", "2.5")
    assert page.value("byId('message').hidden") is True
    assert page.value("[byId('I1').value, state.scene.parameters.I1]") == ["2.5", 2.5]
    page.value("document.querySelector('#show input[value=portrait]').click()")
    settle(page)
    assert page.value("state.scene.portrait.orbits.length") == 20
    page.wait("location.search.includes('I1=2.5') && location.search.includes('portrait')")
    address, before = page.value("location.href"), pixels(page)
    page.open("about:blank")
    page.open(address)
    settle(page)
    assert pixels(page) == before


def test_exports(page, server, tmp_path):
    show(page, server, POLE._replace(Omega2=-8.5), show="portrait F energy")
    page.call("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    for kind in ("csv", "svg", "png"):
        page.value(f"byId('save-{kind}').click()")
        page.wait(f"byId('copied').textContent === 'Saved suslov-orbit.{kind}'")
    page.wait("new Promise((done) => setTimeout(() => done(true), 300))")
    table = np.loadtxt(tmp_path / "suslov-orbit.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 2:], rows(page.value("state.scene.omega"))[: len(table)])
    np.testing.assert_array_equal(table[:, 1], table[:, 0] * POLE.eps)
    assert "repelling steady states" in (tmp_path / "suslov-orbit.svg").read_text("utf-8")
    assert (tmp_path / "suslov-orbit.png").read_bytes().startswith(b"\x89PNG")


def test_the_body_turns_about_one_axis_between_two_states(page):
    ends = page.value("[orientation(20, 0), orientation(20, 1 - 1e-12), state.scene.attitude[21]]")
    np.testing.assert_allclose(ends[1], ends[2], atol=1e-10)
    half = np.reshape(page.value("orientation(20, 0.5)"), (3, 3))
    first, second = np.reshape(ends[0], (3, 3)), np.reshape(ends[2], (3, 3))
    np.testing.assert_allclose(half @ first.T @ half, second, atol=1e-12)
