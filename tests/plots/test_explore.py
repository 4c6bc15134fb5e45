"""The page of `explore`: its numbers, its server, and its behaviour in a browser."""

import contextlib
import http.client
import json
import re
import socket
import urllib.request
from urllib.parse import urlencode, urlsplit

import numpy as np
import pytest
from browser import check_silence, exported, pixels, put, rows, serve, settle, show, text

import suslov_fast as sf
from suslov_fast.bodies.rigid import FIGURES
from suslov_fast.plots.explore import server as serving
from suslov_fast.plots.explore.scene import PAGE, Parameters, answer, parse_query
from suslov_fast.plots.explore.server import Server

SCRIPT = (PAGE / "presets.js").read_text("utf-8")
PRESETS = {
    name: Parameters(*json.loads(values))
    for name, values in re.findall(r'^  "(.*)": (\[.*\])', SCRIPT, re.MULTILINE)
}
PICTURE_1 = PRESETS["Paper, figure 1 (no rigid body)"]
POLE = PRESETS["A pole: no next state"]
CASES = PRESETS | {
    "backwards": PICTURE_1._replace(eps=-0.2),
    "at rest": PICTURE_1._replace(Omega1=0.0, Omega2=0.0),
    "no products": PICTURE_1._replace(I13=0.0, I23=0.0),
    "no step": PICTURE_1._replace(eps=0.0),
    "weak rotor": PICTURE_1._replace(k=-0.1),
    "beyond": PICTURE_1._replace(Omega1=1e300, Omega2=1e300, eps=1e30),
}
# Where they are not "below" and OK.
REGIMES = {
    "Long steps: criticality 0.5": ("ahead", "OK"),
    "Criticality 1": ("at", "SUPERCRITICAL"),
    "Criticality above 1: jumps": ("above", "SUPERCRITICAL"),
    "A pole: no next state": ("pole", "SINGULAR"),
    "A rotor: periodic": ("rotor", "OK"),
    "at rest": ("steady", "OK"),
    "no products": ("steady", "OK"),
    "no step": ("still", "OK"),
    "beyond": ("unknown", "NONFINITE"),
}


def query(parameters, **other):
    return urlencode(parameters._asdict() | other)


def numbers(parameters, **other):
    return json.loads(json.dumps(answer(query(parameters, **other)), allow_nan=False))


@pytest.mark.sampled(4)
@pytest.mark.filterwarnings("ignore::suslov_fast.SingularStepWarning")
@pytest.mark.parametrize("name", CASES)
def test_numbers_equal_those_of_the_package(name):
    parameters, names = CASES[name], {}
    found = numbers(parameters)
    exec(found["python"], names)
    body, run = names["body"], names["run"]
    assert body == parameters.body
    np.testing.assert_array_equal(rows(found["omega"]), run.omega)
    np.testing.assert_array_equal(rows(found["attitude"], 9).reshape(-1, 3, 3), run.attitude)
    np.testing.assert_array_equal(
        rows(found["flow"]), sf.flow(body, run.omega[0], time=run.time).omega
    )
    for quantity, value in {
        "F": run.first_integral()[0],
        "criticality": run.criticality()[0],
        "omega_plus": sf.limits(body, run.omega[0], parameters.eps)[1],
    }.items():
        expected = value.tolist() if np.isfinite(value).all() else None
        assert found["numbers"][quantity] == expected, quantity
    status = sf.Status(int(run.status))
    failed_at = int(run.failed_at) if status < 0 else None
    expected = {"name": status.name, "message": status.message, "failed_at": failed_at}
    assert found["status"] == expected
    assert (found["regime"], status.name) == REGIMES.get(name, ("below", "OK"))
    if name in PRESETS:
        assert found["ellipsoid"]["matter"] == ("no rigid body" not in name)
        assert np.abs(parameters[6:8]).max() < parameters.extent
    if number := re.search(r"figure (\d)", name):
        assert (body, parameters.eps, parameters.extent) == FIGURES[int(number[1])]


CURVES = (
    "A rigid body",
    "backwards",
    "Criticality above 1: jumps",
    "A rotor: periodic",
    "weak rotor",
)


@pytest.mark.parametrize("name", CURVES)
def test_curves_and_portrait(name):
    parameters = CASES[name]
    found, body, eps = numbers(parameters, show="portrait"), parameters.body, parameters.eps
    for branch in found["levels"]["F"]:
        F = sf.first_integral(body, branch, eps)
        np.testing.assert_allclose(F, found["numbers"]["F"], rtol=1e-9)
    E = sf.energy(body, found["levels"]["energy"])
    np.testing.assert_allclose(E, found["numbers"]["energy"], rtol=1e-13)
    middle, repelling = np.array(found["line"])
    for sign in (1, -1):
        state = middle + sign * 3.0 * repelling
        np.testing.assert_allclose(sf.vector_field(body, state), 0, atol=1e-15)
        assert np.sign(np.linalg.det(sf.jacobian(body, state, eps)) ** 2 - 1) == sign
    orbits = found["portrait"]["orbits"]
    assert len(orbits) == (17 if parameters.k == 1 else 20)  # levels without the line have one
    for orbit in map(np.array, orbits):
        after = sf.step(body, orbit[:-1], eps)
        np.testing.assert_allclose(orbit[1:], after, atol=1e-4 * abs(orbit).max())
    drawn = found["ellipsoid"]
    points = np.array(drawn["axes"]) * drawn["radii"]
    I1, I2, I13, I23 = body.constants[:4]
    tensor = [[I1, 0, I13], [0, I2, I23], [I13, I23, drawn["I3"]]]
    squares = np.einsum("ik,ij,jk->k", points, tensor, points)
    np.testing.assert_allclose(squares, squares[0], rtol=1e-13)


@pytest.fixture(scope="module")
def server():
    with serve(Server(0)) as running:
        yield running


def ask(server, path, headers=None):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=300)
    with contextlib.closing(connection):
        connection.request("GET", path, headers=headers or {})
        reply = connection.getresponse()
        return reply, reply.read()


def test_a_port_is_free_at_once():
    port = 0
    for _ in range(2):
        with serve(Server(port)) as server:
            port = server.port
            with socket.create_connection(("127.0.0.1", port), timeout=60) as connection:
                connection.sendall(b"GET /missing HTTP/1.0\r\n\r\n")
                while connection.recv(1024):  # the server ends it, and its end waits
                    pass


def test_the_page_is_served_and_refers_to_nothing_else(server):
    reply, body = ask(server, f"/scene?{query(POLE)}")
    assert (reply.status, reply.headers["Content-Type"]) == (200, "application/json")
    assert json.loads(body) == numbers(POLE)
    left, found = ["/", "/field.html", "/style.css"], set()
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
    files = {f"/{file.name}" for file in PAGE.iterdir()}
    assert files - {"/index.html"} == found - {"/"}


@pytest.mark.parametrize(
    ("text", "field"),
    [
        (query(PICTURE_1, I1=0), "I1"),
        (query(PICTURE_1, eps="1e999"), "eps"),
        (query(PICTURE_1, Omega2="<b>"), "Omega2"),
        (query(PICTURE_1, steps=2.5), "steps"),
        (query(PICTURE_1, other=4), "parameters"),
        ("I1=4", "parameters"),
        (f"{query(PICTURE_1)}&I1=4", "parameters"),
    ],
)
def test_bad_values_are_answered_with_a_message(text, field):
    found = answer(text)
    assert found["error"].startswith(f"{field} must ")
    assert found["fields"] == [field] * (field in Parameters._fields)


def test_what_is_refused(server):
    """A name elsewhere may lead to this address, and other pages may ask for numbers."""
    here, scene = f"127.0.0.1:{server.port}", f"/scene?{query(PICTURE_1)}"
    both = ["/", scene]
    hosts = "example.org", f"example.org:{server.port}", "127.0.0.1", f"{here}0", ""
    for status, paths, headers in (
        (200, both, {}),
        (200, both, {"Host": f"localhost:{server.port}"}),
        *((403, both, {"Host": host}) for host in hosts),
        (200, both, {"Sec-Fetch-Site": "same-origin"}),
        *((403, [scene], {"Sec-Fetch-Site": site}) for site in ("cross-site", "same-site")),
        (200, ["/"], {"Sec-Fetch-Site": "cross-site"}),  # a link, or a frame
        (404, ["/../server.py", "//etc/hostname", "/page/main.js", "/a%0Ab"], {}),
        (400, ["/%00"], {}),
    ):
        for path in paths:
            assert ask(server, path, headers)[0].status == status, (path, headers)
    assert server.socket.getsockname()[0] == "127.0.0.1"


@contextlib.contextmanager
def slow_clients(port, count, text):
    """Clients that are connected, have sent a text, and then wait."""
    with contextlib.ExitStack() as stack:
        clients = []
        for _ in range(count):
            client = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=60))
            client.sendall(text)
            clients.append(client)
        yield clients


@pytest.mark.parametrize("text", [b"", b"GET / HTT", b"GET /missing HTTP/1.1\r\nHost: "])
def test_slow_clients_neither_block_others_nor_the_end(text, monkeypatch):
    """Those that never end their request, each in a thread of its own."""
    monkeypatch.setattr(serving.Handler, "timeout", 1000.0)  # nor does it help that one gives up
    page = sf.explore(sf.Suslov3D(4, 2, -0.5, -0.3))
    with contextlib.closing(page), slow_clients(urlsplit(page.url).port, 40, text):
        with urllib.request.urlopen(page.url, timeout=60) as reply:
            assert reply.status == 200
        port = urlsplit(page.url).port
        page.close()
        with pytest.raises(OSError, match="refused"):
            socket.create_connection(("127.0.0.1", port), timeout=60)


def test_page_in_a_notebook():
    body = sf.SuslovGyrostat(4, 2, -0.5, -0.3, 0.7)
    with contextlib.closing(sf.explore(body, [-0.9, 1.3], eps=0.2, steps=50)) as page:
        view = parse_query(urlsplit(page.url).query)
        assert (view.body, view[5:9], view.show) == (body, (0.2, -0.9, 1.3, 50), "F energy")
        frame = page._repr_html_()
        assert f'src="{page.url.replace("&", "&amp;")}"' in frame
        with urllib.request.urlopen(page.url, timeout=60) as reply:
            assert b"suslov_fast" in reply.read()


MODULES = "state", "space", "plane"


@pytest.fixture
def page(browser, server):
    """A browser; afterwards, check that pages logged no error and contacted no other server."""
    browser.look(1280, 800)
    browser.events.clear()
    yield browser
    check_silence(browser, server.url)


@pytest.mark.slow
def test_every_case_is_drawn_without_an_error(page, server):
    for name, parameters in CASES.items():
        shown = "F energy flow joined portrait"
        show(page, f"{server.url}?{query(parameters, show=shown)}", *MODULES)
        assert text(page, "status") == REGIMES.get(name, ("below", "OK"))[1]


def test_the_start_follows_the_mouse(page, server):
    show(page, server.url, *MODULES)
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


def test_the_address_keeps_the_view(page, server):
    show(page, server.url, *MODULES)
    put(page, "I1", "0")
    assert text(page, "message").startswith("I1 must")
    put(page, "I1-slider", "2.5")
    assert page.value("byId('message').hidden") is True
    assert page.value("[byId('I1').value, state.scene.parameters.I1]") == ["2.5", 2.5]
    page.value("document.querySelector('#show input[value=portrait]').click()")
    settle(page)
    assert page.value("state.scene.portrait.orbits.length") == 20
    page.wait("location.search.includes('I1=2.5') && location.search.includes('portrait')")
    before = pixels(page)
    show(page, page.value("location.href"), *MODULES)
    assert pixels(page) == before


def test_exports(page, server, tmp_path):
    view = query(POLE, Omega2=-8.5, show="portrait F energy")
    show(page, f"{server.url}?{view}", *MODULES)
    table, picture = exported(page, tmp_path)
    np.testing.assert_array_equal(table[:, 2:], rows(page.value("state.scene.omega"))[: len(table)])
    np.testing.assert_array_equal(table[:, 1], table[:, 0] * POLE.eps)
    assert "repelling steady states" in picture


def test_the_body_turns_about_one_axis_between_two_states(page, server):
    show(page, server.url, *MODULES)
    ends = page.value("[orientation(20, 0), orientation(20, 1 - 1e-12), state.scene.attitude[21]]")
    np.testing.assert_allclose(ends[1], ends[2], atol=1e-10)
    half = np.reshape(page.value("orientation(20, 0.5)"), (3, 3))
    first, second = np.reshape(ends[0], (3, 3)), np.reshape(ends[2], (3, 3))
    np.testing.assert_allclose(half @ first.T @ half, second, atol=1e-12)
