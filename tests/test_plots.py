"""Plots show the values of the functions, in a style that journals accept."""

import io
import re

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

import suslov_fast as sf
from suslov_fast._bodies.paper import PICTURES

# The end of Section 4 of the paper, arXiv:0807.2966, from its LaTeX source.
PAPER = r"""
picture 1: $\epsilon=0.2, I_1=4, I_2=1, I_{13}=-0.5, I_{23}=-0.3$, for picture 2: $\epsilon=0.2,
I_1=4, I_2=3, I_{13}=-0.4, I_{23}=-0.2$, for picture 3: $\epsilon=0.02, I_1=4, I_2=2, I_{13}=0,
I_{23}=-0.2$ and for picture 4: $\epsilon=1, I_1=3, I_2=3, I_{13}=-0.2, I_{23}=-0.2$.
"""


def test_the_parameters_of_the_paper():
    found = re.findall(r"picture (\d): \$(.*?)\$", PAPER, re.DOTALL)
    assert [int(number) for number, _ in found] == list(PICTURES) == [1, 2, 3, 4]
    for number, text in found:
        eps, *parameters = (float(each) for each in re.findall(r"=(-?[\d.]+)", text))
        assert PICTURES[int(number)].eps == eps
        assert PICTURES[int(number)].body == sf.Suslov3D(*parameters)


@pytest.mark.parametrize("number", PICTURES)
def test_phase(number):
    body, eps, extent = PICTURES[number]
    axes = sf.plot_phase(body, eps, extent, levels=4, letter="a")
    assert axes.get_title(loc="left") == "(a)"
    assert axes.get_xlim() == axes.get_ylim() == (-extent, extent)
    lines = axes.get_lines()
    labelled = [line for line in lines if line.get_label().startswith("$I_{13}")]
    assert len(labelled) == 2
    for line in labelled:
        x, _ = sf.to_xy(body, line.get_xydata()).T
        assert abs(x).max() < 1e-12 * extent
    dots = [line for line in lines if line.get_marker() == "." and len(line.get_xdata()) > 1]
    curves = [line for line in lines if line.get_linestyle() == "-" and len(line.get_xdata()) > 99]
    assert (len(dots), len(curves)) == (8, 4)
    for k, orbit in enumerate(dots):
        t = sf.criticality(body, orbit.get_xydata(), eps)
        np.testing.assert_allclose(t, t[0], rtol=1e-11)
        on_curve = sf.criticality(body, curves[k // 2].get_xydata(), eps)
        np.testing.assert_allclose(on_curve, t[0], rtol=1e-11)
        steps = sf.step(body, orbit.get_xydata()[:-1], eps)
        np.testing.assert_allclose(orbit.get_xydata()[1:], steps, atol=1e-11 * extent)


@pytest.mark.parametrize("I13", [-0.5, 0.0])
def test_phase_of_a_gyrostat(I13):
    """Levels that meet the line of steady states have two orbits from it to it, others one turn."""
    body, eps = sf.SuslovGyrostat(4, 2, I13, -0.3 if I13 else 0.0, 0.4), 0.4
    axes = sf.plot_phase(body, eps, 2.6, levels=6)
    lines = axes.get_lines()
    steady = [line.get_xydata() for line in lines if "k = 0" in line.get_label()]
    assert len(steady) == (2 if I13 else 0)
    for ends in steady:
        np.testing.assert_allclose(ends @ [body.I13, body.I23], -body.k, rtol=1e-12)
    orbits = [line.get_xydata() for line in lines if line.get_marker() == "."][:-1]
    curves = [line.get_xydata() for line in lines if line.get_linestyle() == "-"]
    levels = [sf.first_integral(body, curve, eps) for curve in curves[:6]]
    for orbit in orbits:
        F = sf.first_integral(body, orbit, eps)
        np.testing.assert_allclose(F, F[0], rtol=1e-12)
        np.testing.assert_allclose(sf.step(body, orbit[:-1], eps), orbit[1:], atol=1e-12)
        assert min(abs(level / F[0] - 1).max() for level in levels) < 1e-12
        momentum = abs(orbit @ [body.I13, body.I23] + body.k)
        A2 = 4 * body.I1 * body.I2 * F[0] * (body.I13**2 / body.I1 + body.I23**2 / body.I2)
        if body.k**2 < A2:
            assert max(momentum[0], momentum[-1]) < 0.1 * momentum.max()
        else:
            assert np.hypot(*(orbit[-1] - orbit[0])) < 0.2
    assert len(orbits) == (11 if I13 else 6)


def test_axes_are_taken_and_returned(body):
    figure = Figure()
    first, space = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")
    run = sf.iterate(body, [[1.0, 0.5], [0.2, -0.7]], 0.2, 9)
    assert run.plot(ax=first) is first
    assert sf.plot_phase(*PICTURES[1], levels=2, legend=False, ax=first) is first
    assert first.get_legend() is None
    for wrong in (figure, space):
        with pytest.raises(TypeError, match="ax: expected plane axes of Matplotlib"):
            run.plot(ax=wrong)


@pytest.mark.parametrize(
    ("orbits", "arguments", "lines", "drawn"),
    [
        (200, {"steps": 300}, None, "-"),
        (200, {"steps": 300, "save_every": 10}, None, "None"),
        (200, {"steps": 300, "save_every": 10}, True, "-"),
        (1, {"steps": 6, "eps": 2.0}, None, "None"),  # few and long steps
        (1, {"steps": 6, "eps": 2.0, "save_every": None}, None, "None"),
        (1, {"steps": 300}, False, "None"),
    ],
)
def test_lines_and_colours_of_a_run(body, orbits, arguments, lines, drawn):
    omega0 = np.random.default_rng(0).uniform(-2, 2, (orbits, 2))
    run = sf.iterate(body, omega0, **({"eps": 0.2} | arguments))
    axes = run.plot(lines=lines)
    assert {line.get_linestyle() for line in axes.lines} == {drawn}
    assert {line.get_marker() for line in axes.lines} == {"."}
    np.testing.assert_array_equal(axes.lines[-1].get_xydata(), run.omega[:, -1])
    bars = [each for each in axes.figure.axes if each is not axes]
    assert [each.get_ylabel() for each in bars] == ["size of the first state"] * (orbits > 1)
    size = np.linalg.norm(run.omega[0], axis=-1)
    for bar in bars:
        np.testing.assert_allclose(bar.get_ylim(), [size.min(), size.max()])


def test_animation(body):
    animation = sf.animate_body(steps=6, every=3)
    frames = list(animation.new_frame_seq())
    assert frames == [0, 3, 6]
    animation._draw_was_started = True  # prevents a warning about an unsaved animation
    for number in frames:
        animation._func(number)
    front = np.array(animation._fig.axes[0].get_lines()[-1].get_data_3d())
    assert front.shape == (3, 7)
    length = np.linalg.norm(front, axis=0)
    np.testing.assert_allclose(length[np.isfinite(length)], 1.15, rtol=1e-12)
    with pytest.warns(UserWarning, match="I3: "):
        impossible = sf.Suslov3D(4, 1, -0.5, -0.3, I3=0.01)
    with pytest.raises(ValueError, match="I3: expected one with a positive definite"):
        sf.animate_body(impossible)
    with pytest.raises(sf.SingularStepError, match="singular step, first: 0 at step 1"):
        sf.animate_body(sf.Suslov3D(2, 2, 0.5, 0), [2, -9], 1.0)
    # No rigid body has the parameters of the first picture, but there is an ellipsoid.
    sf.animate_body(body, steps=1)._draw_was_started = True


B = sf.Suslov3D(4, 2, -0.5, -0.3)
LOGISTIC = sf.QuadraticField.from_function(lambda x: (x[0] - x[0] ** 2,), 1)
BAD = [
    (lambda: sf.iterate(LOGISTIC, [0.1], 0.1, 9).plot(), "plot: expected .* at least 2 components"),
    (lambda: sf.plot_phase(B, 10.0, 4.0), "extent: expected a criticality below 1"),
    (lambda: sf.plot_phase(B, 0, 4.0), "eps: expected a positive number, got 0"),
    (lambda: sf.plot_phase(B, 0.2, -4.0), "extent: expected a positive number, got -4.0"),
    (lambda: sf.plot_phase(B, 0.2, 4.0, levels=0), "levels: expected an integer of at least 1"),
    (lambda: sf.plot_phase(sf.Suslov3D(1, 2, 0, 0), 0.1, 4.0), "I13 or I23 other than 0"),
    (lambda: sf.plot_phase(sf.SuslovND([1, 2], [1, 2]), 0.1, 4.0), "body: expected Suslov3D"),
    (lambda: sf.animate_body(B, fps=0), "fps: expected a positive number, got 0"),
    (lambda: sf.animate_body(B, every=0), "every: expected an integer of at least 1, got 0"),
    (lambda: sf.animate_body(B, eps=[0.1, 0.2]), "eps: expected a single number, got"),
    (lambda: sf.animate_body(B, R0=[np.eye(3)]), r"a batch of shape \(1,\)"),
    (lambda: sf.animate_body(B, [[1, 2]]), r"a batch of shape \(1,\)"),
]


@pytest.mark.parametrize(("call", "message"), BAD)
def test_bad_input(call, message):
    with pytest.raises((ValueError, TypeError), match=message):
        call()


def test_style():
    """Plots use TrueType fonts, set mathematics in the text font, and keep the user's settings."""
    with matplotlib.rc_context({"font.family": "serif", "pdf.compression": 0}):
        before = dict(matplotlib.rcParams)
        axes = sf.plot_phase(*PICTURES[1], levels=2)
        file = io.BytesIO()
        axes.figure.savefig(file, format="pdf")
        assert dict(matplotlib.rcParams) == before
    assert axes.xaxis.label.get_math_fontfamily() == "dejavuserif"
    assert b"/Subtype /Type3" not in file.getvalue()
    fonts = re.findall(rb"/BaseFont /(?:\w+\+)?DejaVu(Serif|Sans)", file.getvalue())
    assert set(fonts) == {b"Serif"}
