"""The page of `suslov-fast explore`: its numbers, its server, and what a browser makes of it."""

import contextlib
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path
from urllib.parse import parse_qsl, urlencode, urlsplit

import numpy as np
import pytest
from browser import Browser

import suslov_fast as sf
from suslov_fast._show.explore.parameters import PRESETS, Parameters, query_of_link, read
from suslov_fast._show.explore.scene import REGIMES, scene
from suslov_fast._show.explore.server import Server

PICTURE_1 = Parameters(4.0, 1.0, -0.5, -0.3, 0.2, -0.8, 1.3, 40)
POLE = Parameters(1.0, 1.0, 1.0, 0.0, 1.0, 1.0, -3.0, 5)
CASES = {
    "below": PICTURE_1,
    "backwards": PICTURE_1._replace(eps=-0.2),
    "at": Parameters(1.0, 1.0, 1.0, 0.0, 1.0, 0.5, -2.0, 5),
    "above": Parameters(1.0, 1.0, 1.0, 0.0, 1.0, 0.5, -4.0, 30),
    "pole": POLE,
    "matter": Parameters(3.0, 3.0, -0.2, -0.2, 1.0, -1.5, 1.4, 20),
    "steady": PICTURE_1._replace(I23=-0.25, Omega1=-0.5, Omega2=1.0),
    "at rest": PICTURE_1._replace(Omega1=0.0, Omega2=0.0),
    "no products": PICTURE_1._replace(I13=0.0, I23=0.0),
    "no step": PICTURE_1._replace(eps=0.0),
    "huge": PICTURE_1._replace(Omega1=1e300, Omega2=-1e300),
    "tiny": PICTURE_1._replace(I1=1e-300, I13=1e-200),
    "far apart": PICTURE_1._replace(I1=1e250, I2=1e-250),
    "beyond": PICTURE_1._replace(Omega1=1e308, Omega2=1e308, eps=1e308),
}


def rows(found, size=2):
    return np.array([[np.nan] * size if row is None else row for row in found])


@pytest.mark.parametrize("parameters", CASES.values(), ids=CASES)
def test_numbers_are_those_of_the_package(parameters):
    *_, steps = parameters
    found = json.loads(json.dumps(scene(parameters), allow_nan=False))
    body = sf.Suslov3D(*parameters[:4])
    omega0, eps = parameters[5:7], parameters.eps
    run = sf.iterate(body, omega0, eps, steps, attitude=True, on_singular="ignore")
    assert found["parameters"] == parameters._asdict()
    exists = np.isfinite(run.omega).all(axis=-1)
    assert [row is not None for row in found["omega"]] == exists.tolist()
    np.testing.assert_array_equal(rows(found["omega"]), run.omega)
    np.testing.assert_array_equal(rows(found["attitude"], 9).reshape(-1, 3, 3), run.attitude)
    with np.errstate(all="ignore"):
        spatial = sf.to_vector(body, run.omega, attitude=run.attitude)
        spatial[~np.isfinite(spatial).all(axis=-1)] = np.nan
    np.testing.assert_array_equal(rows(found["spatial"], 3), spatial)
    flow = sf.flow(body, omega0, run.time[np.isfinite(run.time)])
    np.testing.assert_array_equal(rows(found["flow"])[: len(flow)], flow)
    assert len(found["flow"]) == steps + 1
    numbers = found["numbers"]
    minus, plus = sf.limits(body, omega0, eps)
    for name, value in {
        "criticality": sf.criticality(body, omega0, eps),
        "F": sf.first_integral(body, omega0, eps),
        "energy": sf.energy(body, omega0),
        "scattering_angle": sf.scattering_angle(body),
    }.items():
        assert numbers[name] == (value if np.isfinite(value) else None), name
    for name, value in {"omega_minus": minus, "omega_plus": plus}.items():
        assert numbers[name] == (value.tolist() if np.isfinite(value).all() else None)
    status = sf.Status(int(run.status))
    assert found["status"]["name"] == status.name
    assert found["status"]["message"] == status.message
    assert found["status"]["failed_at"] == (int(run.failed_at) if status < 0 else None)


@pytest.mark.parametrize(
    ("case", "regime", "status"),
    [
        ("below", "below", "OK"),
        ("backwards", "below", "OK"),
        ("at", "at", "SUPERCRITICAL"),
        ("above", "above", "SUPERCRITICAL"),
        ("pole", "above", "SINGULAR"),
        ("steady", "steady", "OK"),
        ("at rest", "steady", "OK"),
        ("no products", "steady", "OK"),
    ],
)
def test_regimes(case, regime, status):
    found = scene(CASES[case])
    assert found["regime"] == {"name": regime, "text": REGIMES[regime]}
    assert found["status"]["name"] == status


@pytest.mark.parametrize("case", ["below", "backwards", "at", "above", "pole", "matter"])
def test_curves_are_levels(case):
    parameters = CASES[case]
    found, eps = scene(parameters), parameters.eps
    for branch in found["levels"]["F"]:
        t = sf.criticality(parameters.body, branch, eps)
        np.testing.assert_allclose(t, found["numbers"]["criticality"], rtol=1e-9)
    E = sf.energy(parameters.body, found["levels"]["energy"])
    np.testing.assert_allclose(E, found["numbers"]["energy"], rtol=1e-13)


@pytest.mark.parametrize("case", ["below", "backwards", "above", "matter"])
def test_halves_of_the_line(case):
    parameters = CASES[case]
    found = scene(parameters)
    body, eps = parameters.body, parameters.eps
    for half, sign in (("repelling", 1), ("attracting", -1)):
        direction = np.array(found["line"][half])
        np.testing.assert_allclose(sf.vector_field(body, direction), 0, atol=1e-17)
        derivative = sf.jacobian(body, direction, eps)
        assert np.sign(np.prod(abs(np.linalg.eigvals(derivative))) - 1) == sign
    plus = np.array(found["numbers"]["omega_plus"])
    np.testing.assert_allclose(plus / np.hypot(*plus), found["line"]["attracting"], atol=1e-15)


def test_the_ellipsoid_is_that_of_the_inertia_tensor():
    for case in ("below", "matter", "pole"):
        drawn = scene(CASES[case])["ellipsoid"]
        I1, I2, I13, I23 = CASES[case][:4]
        tensor = np.array([[I1, 0, I13], [0, I2, I23], [I13, I23, drawn["I3"]]])
        points = np.array(drawn["axes"]) * drawn["radii"]
        squares = np.einsum("ik,ij,jk->k", points, tensor, points)
        np.testing.assert_allclose(squares, squares[0], rtol=1e-13)
        low, high = CASES[case].body.admissible_I3()
        assert drawn["matter"] == (low < drawn["I3"] < high)


@pytest.mark.parametrize("case", ["below", "backwards", "above", "matter"])
def test_the_lines_of_python_give_the_same_states(case):
    found, names = scene(CASES[case]), {}
    exec(found["python"], names)
    np.testing.assert_array_equal(names["run"].omega, rows(found["omega"]))
    np.testing.assert_array_equal(names["run"].attitude.reshape(-1, 9), rows(found["attitude"], 9))


def test_beginnings_are_what_they_say():
    found = {name: scene(parameters) for name, (parameters, _) in PRESETS.items()}
    for name, each in found.items():
        regime, status = each["regime"]["name"], each["status"]["name"]
        if name.startswith(("Picture", "Long")):
            assert (regime, status) == ("below", "OK")
            ends = [each["numbers"][f"omega_{end}"] for end in ("minus", "plus")]
            size = np.hypot(*ends[0])
            assert np.hypot(*np.subtract(each["omega"][0], ends[0])) < 0.2 * size
            assert np.hypot(*np.subtract(each["omega"][-1], ends[1])) < 1e-3 * size
        else:
            assert regime == ("at" if name == "t = 1" else "above")
            assert status == ("SINGULAR" if "pole" in name else "SUPERCRITICAL")
    assert round(found["Long steps: t = 0.5"]["numbers"]["criticality"], 1) == 0.5
    assert len(found) == 8


# ------------------------------------------------------------------ the server


@pytest.fixture(scope="module")
def server():
    with Server(0) as running:
        thread = threading.Thread(target=running.serve_forever, args=(0.02,))
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def ask(server, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=300)
    with contextlib.closing(connection):
        names = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(method, path, headers=names)
        reply = connection.getresponse()
        return reply, reply.read()


def query(parameters, **other):
    return urlencode(parameters._asdict() | other)


def test_scenes_are_served(server):
    for parameters in (PICTURE_1, POLE):
        reply, body = ask(server, f"/scene?{query(parameters)}")
        assert reply.status == 200
        assert reply.headers["Content-Type"] == "application/json"
        assert json.loads(body) == json.loads(json.dumps(scene(parameters)))


def test_settings_are_served(server):
    told = json.loads(ask(server, "/settings")[1])
    assert told["version"] == sf.__version__
    assert [each["name"] for each in told["presets"]] == list(PRESETS)
    assert told["presets"][0]["parameters"] == PRESETS["Picture 1"][0]._asdict()


def test_the_page_is_served_and_asks_for_nothing_else(server):
    asked = set()
    for path in ("/", f"/?{query(PICTURE_1)}", "/style.css", "/explore.js"):
        reply, body = ask(server, path)
        assert reply.status == 200
        assert "default-src 'none'" in reply.headers["Content-Security-Policy"]
        assert reply.headers["X-Content-Type-Options"] == "nosniff"
        text = body.decode()
        asked |= set(re.findall(r'(?:src|href)="(/[^"]*)"|fetch\("(/\w+)', text))
        assert set(re.findall(r"https?://[\w.]+", text)) <= {"http://www.w3.org"}
        assert "url(" not in text
        assert "@import" not in text
    names = {"".join(pair) for pair in asked}
    assert names == {"/style.css", "/explore.js", "/scene", "/settings"}
    assert ask(server, "/", "HEAD")[1] == b""


BAD = [
    ({"I1": "0"}, "I1: expected a positive number, got 0", "I1"),
    ({"I2": "-1"}, "I2: expected a positive number, got -1", "I2"),
    ({"I1": ""}, "I1: expected a number, got ''", "I1"),
    ({"I13": "nan"}, "I13: expected a number, got 'nan'", "I13"),
    ({"eps": "1e999"}, "eps: expected a number, got '1e999'", "eps"),
    ({"Omega1": "one"}, "Omega1: expected a number, got 'one'", "Omega1"),
    ({"Omega2": "<b>"}, "Omega2: expected a number, got '<b>'", "Omega2"),
    ({"steps": "0"}, "steps: expected an integer from 1 to 5000, got 0", "steps"),
    ({"steps": "2.5"}, "steps: expected an integer from 1 to 5000, got 2.5", "steps"),
    ({"steps": "1e9"}, "steps: expected an integer from 1 to 5000, got 1e9", "steps"),
    ({"I1": "1e300", "I2": "1e-300"}, "I1, I2: expected moments within a factor of", None),
]


@pytest.mark.parametrize(("change", "message", "field"), BAD)
def test_bad_values_are_answered_with_a_message(server, change, message, field):
    reply, body = ask(server, f"/scene?{query(PICTURE_1, **change)}")
    told = json.loads(body)
    assert reply.status == 200
    assert told["error"].startswith(message)
    assert told["field"] == field


@pytest.mark.parametrize(
    "path",
    [
        "/scene",
        "/scene?I1=4",
        f"/scene?{query(PICTURE_1)}&I1=4",
        f"/scene?{query(PICTURE_1)}&other=4",
        "/scene?" + "&".join(f"I{k}=1" for k in range(30)),
    ],
)
def test_queries_of_another_page_are_refused(server, path):
    reply, body = ask(server, path)
    assert reply.status == 400
    assert json.loads(body)["error"]


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/index.html", 404),
        ("/../pyproject.toml", 404),
        ("//etc/passwd", 404),
        ("/%2e%2e/__init__.py", 404),
        ("/page/explore.js", 404),
        ("/" + "x" * 3000, 414),
    ],
)
def test_nothing_else_is_served(server, path, status):
    assert ask(server, path)[0].status == status


def test_other_methods_are_refused(server):
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert ask(server, "/", method)[0].status == 501


@pytest.mark.parametrize("path", ["/", "/scene", "/settings", "/explore.js"])
def test_foreign_pages_are_refused(server, path):
    port = server.server_port
    for host in ("example.org", f"example.org:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}", ""):
        assert ask(server, path, Host=host)[0].status == 403
    for origin in ("http://example.org", f"https://127.0.0.1:{port}", "null"):
        assert ask(server, path, Origin=origin)[0].status == 403
    for name in ("127.0.0.1", "localhost"):
        reply, _ = ask(server, "/settings", Host=f"{name}:{port}", Origin=f"http://{name}:{port}")
        assert reply.status == 200


def raw(server, text):
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=30) as connection:
        connection.sendall(text.encode())
        connection.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: connection.recv(65536), b"")).decode()


def test_odd_requests(server, capfd):
    host = f"Host: 127.0.0.1:{server.server_port}\r\n"
    assert raw(server, f"GET / HTTP/1.1\r\n{host}Host: example.org\r\n\r\n").startswith(
        "HTTP/1.1 403"
    )
    assert raw(server, "GET / HTTP/1.1\r\n\r\n").startswith("HTTP/1.1 403")
    assert "431" in raw(server, f"GET / HTTP/1.1\r\n{host}X: {'y' * 70000}\r\n\r\n")
    assert "400" in raw(server, "nonsense\r\n\r\n")
    for path in ("http://[", "//[", "/scene?%ff=%00", "/?\x00", "*"):
        assert raw(server, f"GET {path} HTTP/1.1\r\n{host}\r\n")[:12] in (
            "HTTP/1.1 200",
            "HTTP/1.1 400",
            "HTTP/1.1 404",
        )
    assert raw(server, "") == ""
    # One that leaves before it is answered.
    for _ in range(3 if os.name == "posix" else 0):
        with socket.create_connection(("127.0.0.1", server.server_port)) as connection:
            connection.sendall(f"GET /scene?{query(PICTURE_1)} HTTP/1.1\r\n{host}\r\n".encode())
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    assert ask(server, "/settings")[0].status == 200
    assert capfd.readouterr().err == ""


def test_it_listens_to_this_machine_alone(server):
    assert server.socket.getsockname()[0] == "127.0.0.1"


# ------------------------------------------------------------------ the command


def start(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "suslov_fast", "explore", "--no-browser", *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_ends_it(name):
    link = f"http://127.0.0.1:1/?{query(PICTURE_1)}&show=F"
    process = start(link)
    try:
        url = process.stdout.readline().strip()
        port = urlsplit(url).port
        shown = dict(parse_qsl(urlsplit(url).query))
        assert shown.pop("show") == "F"
        assert read(shown) == PICTURE_1
        with urllib.request.urlopen(url, timeout=60) as page:
            assert b"suslov_fast" in page.read()
        process.send_signal(getattr(signal, name))
        output, errors = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate()
    assert (process.returncode, output, errors) == (0, "", "")
    # The port is free again at once.
    Server(port).server_close()


def command(arguments, capsys, status=2):
    from suslov_fast._cli import main

    with pytest.raises(SystemExit) as stopped:
        main(["explore", "--no-browser", *arguments])
    assert stopped.value.code == status
    return capsys.readouterr().err


def test_bad_options(server, capsys):
    taken = command(["--port", str(server.server_port)], capsys, 1)
    assert f"--port: expected a port that is free, got {server.server_port}: " in taken
    for port in ("-1", "x", "1.5"):
        assert "--port: expected an integer of at least 0" in command(["--port", port], capsys)
    assert "at least 0 and below 65536, got '65536'" in command(["--port", "65536"], capsys)
    assert "LINK: expected each of I1, I2" in command(["http://127.0.0.1:1/?I1=4"], capsys)
    told = command([f"?{query(PICTURE_1, I1='x')}"], capsys)
    assert "LINK: I1: expected a number, got 'x'" in told
    assert "LINK: expected at most" in command([f"?{query(PICTURE_1)}&show={'x' * 5000}"], capsys)


def test_links_keep_what_they_say():
    parameters = PICTURE_1._replace(I1=0.1 + 0.2, eps=-1e-17, Omega1=2.0**60)
    told = dict(parse_qsl(query_of_link(f"http://127.0.0.1:9/?{query(parameters)}&extent=3.5")))
    assert told.pop("extent") == "3.5"
    assert read(told) == parameters


def test_a_browser_is_opened(monkeypatch, capsys):
    import webbrowser

    from suslov_fast._cli import main

    opened = threading.Event()
    urls = []

    def open_browser(url):
        urls.append(url)
        opened.set()

    def serve(self, poll_interval):
        assert opened.wait(60)
        raise KeyboardInterrupt

    monkeypatch.setattr(webbrowser, "open", open_browser)
    monkeypatch.setattr(Server, "serve_forever", serve)
    with pytest.raises(SystemExit) as stopped:
        main(["explore"])
    assert stopped.value.code == 0
    assert capsys.readouterr().out.split() == urls


def test_the_command_does_not_load_the_server_until_it_is_asked_to():
    code = "import sys, suslov_fast._cli; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "suslov_fast._show.explore.server" not in loaded


# ------------------------------------------------------------------ in a browser


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    running = Browser(tmp_path_factory.mktemp("browser"))
    yield running
    running.close()


@pytest.fixture
def page(browser, server):
    """The page, as it is opened; afterwards nothing was complained of, and nobody else asked."""
    browser.look(1280, 800)
    browser.events.clear()
    show(browser, server)
    yield browser
    assert browser.complaints() == []
    for address in browser.addresses():
        assert address.startswith((server.url, "data:")), address


def show(browser, server, parameters=None, **view):
    address = "" if parameters is None else f"?{query(parameters, **view)}"
    browser.open("about:blank")
    browser.open(server.url + address)
    settle(browser)


def settle(browser):
    """Until everything that was asked for is shown."""
    browser.wait("typeof scene !== 'undefined' && scene !== null && !asking")


def put(browser, name, value):
    """Write a number into a field, as a person does."""
    browser.value(
        f"inputs[{name!r}].number.value = {str(value)!r};"
        f"inputs[{name!r}].number.dispatchEvent(new Event('input', {{bubbles: true}}))"
    )
    settle(browser)


def pixels(browser, name):
    return browser.value(f"document.getElementById({name!r}).toDataURL()")


def coloured(browser, name, colour):
    """How many pixels of a canvas have nearly a colour of the page."""
    return browser.value(
        f"""(() => {{
            const canvas = document.getElementById({name!r}), code = colours[{colour!r}];
            const want = [1, 3, 5].map((k) => parseInt(code.slice(k, k + 2), 16));
            const copy = new OffscreenCanvas(canvas.width, canvas.height);
            const pen = copy.getContext("2d", {{ willReadFrequently: true }});
            pen.drawImage(canvas, 0, 0);
            const {{ data }} = pen.getImageData(0, 0, canvas.width, canvas.height);
            let count = 0;
            for (let k = 0; k < data.length; k += 4)
                count += data[k + 3] > 200 && want.every((v, i) => Math.abs(data[k + i] - v) < 12);
            return count;
        }})()"""
    )


def text(browser, name):
    return browser.value(f"document.getElementById({name!r}).textContent")


def omega0(browser):
    return browser.value("[Number(values.Omega1), Number(values.Omega2)]")


@pytest.mark.compiled
def test_what_is_seen_at_first(page):
    for colour in ("line", "F", "energy", "state", "accent"):
        assert coloured(page, "plane", colour) > 50, colour
    assert coloured(page, "space", "line") > 50
    assert text(page, "status") == "OK"
    assert text(page, "regime-name") == "t = 0.040253 < 1"
    assert "0.265625" in text(page, "numbers")
    assert page.value("byId('preset').value") == "Picture 1"


@pytest.mark.compiled
@pytest.mark.parametrize("name", Parameters._fields)
def test_each_parameter_changes_the_picture_at_once(page, name):
    before = pixels(page, "plane"), pixels(page, "space"), text(page, "numbers")
    put(page, name, {"I13": 0.4, "I23": 0.7, "Omega1": 1.5, "steps": 30}.get(name, 0.9))
    if name == "steps":
        page.value("setMoment(last()), draw()")
    after = pixels(page, "plane"), pixels(page, "space"), text(page, "numbers")
    assert before[0] != after[0]
    assert before[2] != after[2] or name == "steps"
    assert page.value("byId('preset').value") == ""
    # The slider does the same, and moves the number.
    page.value(
        f"inputs[{name!r}].slider.value = 2;"
        f"inputs[{name!r}].slider.dispatchEvent(new Event('input', {{bubbles: true}}))"
    )
    settle(page)
    assert page.value(f"inputs[{name!r}].number.value") == "2"
    assert page.value(f"scene.parameters[{name!r}]") == 2


@pytest.mark.compiled
def test_regimes_in_the_browser(page, server):
    for case, found in {
        "above": ("t = 1.9554 > 1", "SUPERCRITICAL", ""),
        "pole": ("t = 1.4142 > 1", "SINGULAR", f"No state 1: {sf.Status.SINGULAR.message}."),
        "at": ("t = 1 ", "SUPERCRITICAL", ""),
        "no products": ("Steady rotation", "OK", ""),
        "no step": ("t = 0 < 1", "OK", ""),
        "beyond": None,
        "huge": None,
    }.items():
        show(page, server, CASES[case])
        shown = tuple(text(page, name) for name in ("regime-name", "status", "failure"))
        assert shown == (found or shown)
    show(page, server, POLE)
    assert coloured(page, "plane", "bad") > 10, "a cross where the orbit ends"


@pytest.mark.compiled
def test_the_start_follows_mouse_and_keys(page):
    left, top, width, height = page.value(
        "(({x, y, width, height}) => [x, y, width, height])(byId('plane').getBoundingClientRect())"
    )
    scale = min(width, height) / 2 / page.value("extent")

    def place(x, y):
        return left + width / 2 + x * scale, top + height / 2 - y * scale

    page.mouse("mousePressed", *place(1.0, 0.5))
    settle(page)
    assert omega0(page) == pytest.approx([1.0, 0.5], abs=1 / scale)
    page.mouse("mouseMoved", *place(-1.5, 2.0))
    page.mouse("mouseReleased", *place(-1.5, 2.0))
    settle(page)
    assert omega0(page) == pytest.approx([-1.5, 2.0], abs=1 / scale)
    page.mouse("mouseMoved", *place(3.0, 3.0))
    settle(page)
    assert omega0(page) == pytest.approx([-1.5, 2.0], abs=1 / scale), "it was let go"
    assert page.value("scene.omega[0]") == omega0(page)
    assert page.value("document.activeElement.id") == "plane"
    x, y = omega0(page)
    page.key("ArrowRight")
    page.key("ArrowUp")
    settle(page)
    moved = omega0(page)
    assert moved[0] > x
    assert moved[1] > y
    extent = page.value("extent")
    page.key("+")
    assert page.value("extent") == pytest.approx(0.8 * extent)


@pytest.mark.compiled
def test_a_wrong_value_is_told_and_corrected(page):
    put(page, "I1", "0")
    assert text(page, "message") == "I1: expected a positive number, got 0"
    assert page.value("byId('message').hidden") is False
    assert page.value("inputs.I1.number.getAttribute('aria-invalid')") is not None
    put(page, "I1", "")
    assert text(page, "message") == "I1: expected a number, got ''"
    put(page, "I1", "3")
    assert page.value("byId('message').hidden") is True
    assert page.value("inputs.I1.number.getAttribute('aria-invalid')") is None
    assert page.value("scene.parameters.I1") == 3


@pytest.mark.compiled
def test_the_address_keeps_what_is_shown(page, server):
    put(page, "I1", "2.5")
    put(page, "Omega2", "-0.7")
    page.value("document.querySelector('#show input[value=flow]').click()")
    page.wait("location.search.includes('I1=2.5') && location.search.includes('flow')")
    address, before = page.value("location.href"), pixels(page, "plane")
    page.open("about:blank")
    page.open(address)
    settle(page)
    assert pixels(page, "plane") == before
    assert page.value("scene.parameters.I1") == 2.5
    assert page.value("[...shown].sort().join(' ')") == "F energy flow"


@pytest.mark.compiled
def test_the_body_turns(page):
    before = pixels(page, "space")
    page.value("byId('play').click()")
    page.wait("moment > 3")
    page.value("byId('play').click()")
    assert page.value("playing") is False
    assert pixels(page, "space") != before
    stopped = page.value("moment")
    page.value("byId('moment').value = 0, byId('moment').dispatchEvent(new Event('input'))")
    assert stopped > page.value("moment") == 0
    assert pixels(page, "space") == before
    # Between two states it turns about one axis, from the one to the other.
    ends = page.value("[orientation(20, 0), orientation(20, 1 - 1e-12), scene.attitude[21]]")
    np.testing.assert_allclose(ends[1], ends[2], atol=1e-10)
    half = np.reshape(page.value("orientation(20, 0.5)"), (3, 3))
    first, second = np.reshape(ends[0], (3, 3)), np.reshape(ends[2], (3, 3))
    np.testing.assert_allclose(half @ first.T @ half, second, atol=1e-12)


@pytest.mark.compiled
def test_light_dark_and_small(page):
    back = "getComputedStyle(document.body).backgroundColor"
    light = page.value(back), pixels(page, "plane")
    page.look(1280, 800, "dark")
    page.wait(f"{back} !== {light[0]!r}")
    assert page.wait(f"byId('plane').toDataURL() !== {light[1]!r}")
    for width, height in ((1440, 900), (1000, 700), (600, 800), (360, 640)):
        page.look(width, height)
        page.wait(f"innerWidth === {width}")
        assert page.value("document.documentElement.scrollWidth <= innerWidth")
        assert page.value("Math.min(byId('plane').clientWidth, byId('plane').clientHeight)") > 200
        page.wait("byId('plane').width === byId('plane').clientWidth")


@pytest.mark.compiled
def test_every_control_has_a_name(page):
    nameless = page.value(
        "[...document.querySelectorAll('input, select, button, canvas, meter')].filter(each =>"
        " !each.getAttribute('aria-label') && !(each.labels?.length) && !each.textContent.trim())"
        ".map(each => each.outerHTML)"
    )
    assert nameless == []
    assert page.value("document.querySelectorAll('input[type=number]').length") == 8


def test_it_is_in_the_documentation():
    docs = Path(__file__).parent.parent / "docs"
    assert "suslov-fast explore" in (docs / "howto" / "explore.md").read_text(encoding="utf-8")
