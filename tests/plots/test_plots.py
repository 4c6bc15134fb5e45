"""Plots show the values of the functions."""

import re

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib import colors
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from systems import LORENZ, lorenz

import suslov_fast as sf
from suslov_fast.bodies.rigid import FIGURES

# The end of Section 4 of the paper, arXiv:0807.2966, from its LaTeX source.
PAPER = r"""
picture 1: $\epsilon=0.2, I_1=4, I_2=1, I_{13}=-0.5, I_{23}=-0.3$, for picture 2: $\epsilon=0.2,
I_1=4, I_2=3, I_{13}=-0.4, I_{23}=-0.2$, for picture 3: $\epsilon=0.02, I_1=4, I_2=2, I_{13}=0,
I_{23}=-0.2$ and for picture 4: $\epsilon=1, I_1=3, I_2=3, I_{13}=-0.2, I_{23}=-0.2$.
"""
BODY = sf.Suslov3D(4, 1, -0.5, -0.3)
GYROSTAT = sf.SuslovGyrostat(4, 2, -0.5, -0.3, 0.4)


def test_the_parameters_of_the_paper():
    values = np.array(re.findall(r"=(-?[\d.]+)", PAPER), float).reshape(4, 5)
    for figure, (eps, *parameters) in zip(FIGURES.values(), values, strict=True):
        assert (figure.body, figure.eps) == (sf.Suslov3D(*parameters), eps)


PHASES = [(*figure, 12) for figure in FIGURES.values()]
PHASES += [(GYROSTAT, 0.4, 2.6, 11), (sf.SuslovGyrostat(4, 2, 0, 0, 0.4), 0.4, 2.6, 6)]


@pytest.mark.parametrize(("body", "eps", "extent", "orbits"), PHASES)
def test_phase(body, eps, extent, orbits):
    """Levels that meet the line of steady states have two orbits from it to it, others one turn."""
    axes = sf.plot_phase(body, eps, extent, levels=6)
    assert axes.get_legend() is not None
    assert rf"$\epsilon={eps:g}$" in axes.get_title()
    assert axes.get_xlim() == axes.get_ylim() == (-extent, extent)
    I1, I2, I13, I23, k = body.constants
    level, lines = np.nan, axes.get_lines()
    assert sum("= 0" in line.get_label() for line in lines) == (2 if I13 or I23 else 0)
    for line in lines:
        states = line.get_xydata()
        along = abs(states @ [I13, I23] + k)
        if "= 0" in line.get_label():
            assert along.max() < 1e-12 * extent
        elif len(states):
            F = sf.first_integral(body, states, eps)
            level = F[0] if line.get_linestyle() == "-" else level
            np.testing.assert_allclose(F, level, rtol=1e-11)
        if line.get_marker() == "." and len(states):
            orbits -= 1
            steps = sf.step(body, states[:-1], eps)
            np.testing.assert_allclose(states[1:], steps, atol=1e-11 * extent)
            if k**2 < 4 * I1 * I2 * level * (I13**2 / I1 + I23**2 / I2):
                assert max(along[0], along[-1]) < 0.1 * along.max()
            else:
                assert np.hypot(*(states[-1] - states[0])) < 0.2
    assert orbits == 0


def test_axes_are_taken_and_returned():
    figure = Figure()
    first, space = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")
    run = sf.iterate(BODY, [[1.0, 0.5], [0.2, -0.7]], 0.2, 9)
    assert run.plot(color="red", ax=first) is first
    assert sf.plot_phase(*FIGURES[1], levels=2, ax=first) is first
    assert first.get_legend() is None
    assert not plt.get_fignums()
    assert run.plot().figure in map(plt.figure, plt.get_fignums())  # notebooks show it
    for name, wrong in (("ax", figure), ("ax", space), ("lines", "no")):
        with pytest.raises((TypeError, ValueError), match=f"^{name} must"):
            run.plot(**{name: wrong})


@pytest.mark.compiled  # interpreted, the long runs take minutes
@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("body", "states", "arguments", "lines", "joined"),
    [
        (BODY, 20, {"steps": 300}, None, True),
        (BODY, 20, {"steps": 300, "save_every": 10}, None, False),
        (BODY, 20, {"steps": 300, "save_every": 10}, True, True),
        (BODY, 1, {"steps": 2, "eps": 2.0}, None, False),  # few and long steps
        (BODY, 3, {"steps": 6, "save_every": None}, None, False),
        (BODY, 1, {"steps": 300}, False, False),
        (GYROSTAT, 5, {"steps": 100}, None, True),
        (LORENZ, 1, {"steps": 3000, "eps": 1 / 64}, None, True),
        (LORENZ, 2, {"steps": 20_000, "eps": 1 / 64}, None, True),
        (LORENZ, 2, {"steps": 80_000, "eps": 1 / 64}, None, False),  # too many
        (LORENZ, 2, {"steps": 80_000, "eps": 1 / 64}, True, True),
        (LORENZ, 2, {"steps": 20_000, "eps": 1 / 64}, False, False),
        (LORENZ, 2, {"steps": 25_000, "eps": 1 / 64}, False, False),  # too many
    ],
)
def test_what_is_drawn_of_a_run(body, states, arguments, lines, joined, monkeypatch):
    monkeypatch.setattr("suslov_fast.runs.drawing.MOST_DOTS", 45_000)  # not a million, for speed
    omega0 = np.random.default_rng(0).uniform(0.5, 2, (states, body.dimension))
    run = sf.iterate(body, omega0, **({"eps": 0.2} | arguments))
    components = (0, body.dimension - 1)
    axes = run.plot(*components, lines=lines, title=True)
    found, plane = axes.collections, run.states[..., components]
    assert isinstance(found[0], LineCollection) == joined
    if joined:
        segments, orbits = found[0].get_segments(), np.moveaxis(plane, 1, 0)
        np.testing.assert_array_equal(segments, orbits)
    else:
        every, dots = plane.reshape(-1, 2), found[0].get_offsets()
        assert len(dots) == min(len(every), 45_000)
        assert {*map(tuple, dots)} <= {*map(tuple, every)}
        all_of_them = len(dots) == states * (run.n[-1] + 1)
        assert (f"{len(dots):,} of their states" in axes.get_title()) != all_of_them
    assert f"{run.n[-1]:,}" in axes.get_title()
    assert len(axes.figure.axes) == 1


FAMILY = sf.QuadraticField.from_function(lorenz, 3, rho=np.linspace(20, 28, 9))


def test_families_have_the_colours_of_their_parameter():
    run = sf.iterate(FAMILY, [1, 1, 20], 1 / 64, 600)
    axes = run.plot("x1", "x3")
    (lines,), bar = axes.collections, axes.figure.axes[1]
    np.testing.assert_array_equal(lines.get_array(), FAMILY.parameters["rho"])
    np.testing.assert_array_equal(lines.get_segments(), np.moveaxis(run.x[..., ::2], 1, 0))
    assert bar.get_ylabel() == r"$\rho$"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$x_{1}$", "$x_{3}$")
    axes = sf.iterate(FAMILY[::4], [1, 1, 20], 1 / 64, 100).plot(lines=False)
    texts = [text.get_text() for text in axes.get_legend().get_texts()]
    assert texts == [rf"$\rho$ = {rho}" for rho in (20, 24, 28)]
    assert len(axes.figure.axes) == 1
    sizes = sf.iterate(BODY, [[1.0, 0.5], [0.2, -0.7]], [0.1, 0.2], 9).plot()
    texts = [text.get_text() for text in sizes.get_legend().get_texts()]
    assert texts == [rf"$\epsilon$ = {eps}" for eps in (0.1, 0.2)]
    run = sf.iterate(FAMILY[0], np.eye(3), 1 / 64, 600)
    axes = run.plot(color=[3.0, 1.0, 2.0])
    np.testing.assert_array_equal(axes.collections[0].get_array(), [3, 1, 2])
    for wrong in ("rho", "sigma", [1.0, 2.0]):
        with pytest.raises(ValueError, match=r"^color"):
            run.plot(color=wrong)
    for wrong in (("x1", "y"), "y", (0, 3), [1], ("x1", 0.5)):
        with pytest.raises((TypeError, ValueError), match=r"^components\b"):
            run.plot(*wrong)


def test_crossings_are_drawn():
    points = sf.crossings(FAMILY, [1, 1, 20], 1 / 64, 3000, lambda x: x[..., 2] - 24)
    axes = points.plot("x1", 2, title=True)
    (dots,), bar = axes.collections, axes.figure.axes[1]
    np.testing.assert_array_equal(dots.get_offsets(), points.states[:, ::2])
    np.testing.assert_array_equal(dots.get_array(), FAMILY.parameters["rho"][points.trajectory])
    assert bar.get_ylabel() == r"$\rho$"
    assert f"{len(points)} crossings by 9 orbits" in axes.get_title()
    for name in ("trajectory", "n", "time"):
        dots = points.plot(color=name).collections[0]
        np.testing.assert_array_equal(dots.get_array(), getattr(points, name))
    dots = points.plot(color=points.states[:, 0]).collections[0]
    np.testing.assert_array_equal(dots.get_array(), points.states[:, 0])
    one_each = np.arange(9.0)[::-1]
    dots = points.plot(color=one_each).collections[0]
    np.testing.assert_array_equal(dots.get_array(), one_each[points.trajectory])
    for wrong in ("eps", "count", [1.0], np.ones((9, 1))):
        with pytest.raises(ValueError, match=r"^color\b"):
            points.plot(color=wrong)


# ------------------------------------------------------------------ time, space, colours, titles
def saddle(count):
    field = sf.QuadraticField.from_hamiltonian(
        lambda x: sum(each**2 for each in x) / 2 + x[0] ** 2 * x[1], "x y px py"
    )
    starts = np.random.default_rng(0).uniform(-0.2, 0.2, (count, 4))
    return field, starts


def test_time_is_a_component():
    field, starts = saddle(3)
    run = sf.iterate(field, starts, 1 / 16, 50)
    axes = run.plot("time", "px")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$t$", "$p_{x}$")
    assert run.plot("px").get_xlabel() == "$t$"
    [lines, *_] = axes.collections
    drawn = np.array([path.vertices for path in lines.get_paths()])
    np.testing.assert_array_equal(drawn[:, :, 0], np.tile(run.time, (3, 1)))
    np.testing.assert_array_equal(drawn[:, :, 1], run.x[..., 2].T)
    single = sf.iterate(sf.QuadraticField([[[1.0]]]), [0.1], 0.1, 5).plot()  # its only component
    assert (single.get_xlabel(), single.get_ylabel()) == ("$t$", "$x_{1}$")
    varied = sf.iterate(field, starts, np.array([0.1, 0.2, 0.3]), 50).plot("time", 0)
    assert len(varied.legend().get_texts()) == 3  # of eps, also found by Matplotlib
    both = run.plot("px", color="red", label="x", ax=run.plot("py", color="blue", label="y"))
    assert [text.get_text() for text in both.legend().get_texts()] == ["y", "x"]
    points = sf.crossings(field, starts, 1 / 16, 400, lambda x: x[..., 0])
    of_time = points.plot("time", "py").collections[0].get_offsets()
    np.testing.assert_array_equal(np.asarray(of_time)[:, 0], points.time)


def test_several_components_over_time_have_a_colour_each():
    field, starts = saddle(3)
    run = sf.iterate(field, starts, 1 / 16, 50)
    for chosen, labels in (("time",), run.body.labels), (("time", ["y", "px"]), ["y", "px"]):
        axes = run.plot(*chosen)
        assert len(axes.get_legend().get_texts()) == len(labels)
        joined = [each for each in axes.collections if isinstance(each, LineCollection)]
        assert len({tuple(each.get_color()[0]) for each in joined}) == len(labels)
        for label, each in zip(labels, joined, strict=True):
            drawn = np.array([path.vertices for path in each.get_paths()])
            np.testing.assert_array_equal(drawn[:, :, 1], run.x[..., field.labels.index(label)].T)
    for name in "color", "label":
        with pytest.raises(ValueError, match=rf"^{name}\b"):
            run.plot("time", **{name: "red"})


def test_three_components_are_drawn_in_space():
    field, starts = saddle(2)
    axes = sf.iterate(field, starts, 1 / 16, 50).plot(0, 1, "px", title="in space")
    assert (axes.name, axes.get_zlabel(), axes.get_title()) == ("3d", "$p_{x}$", "in space")
    ours = plt.figure().add_subplot(projection="3d")
    run = sf.iterate(field, starts, 1 / 16, 50)
    assert run.plot(0, 1, 2, lines=False, ax=ours) is ours
    for components, ax in ((("x", "y"), ours), ((0, 1, 2), plt.figure().add_subplot())):
        with pytest.raises(TypeError, match="ax must be"):
            run.plot(*components, ax=ax)
    for wrong in (("x",),), ("time", ("x", "z")):
        with pytest.raises((TypeError, ValueError), match=r'x, y.*such as "time", "x", not'):
            run.plot(*wrong)


def test_colours_of_matplotlib_and_titles(monkeypatch):
    field, starts = saddle(4)
    run = sf.iterate(field, starts, 1 / 16, 50)
    axes = run.plot(color="crimson", lines=True)
    assert axes.get_title() == ""
    np.testing.assert_array_equal(axes.collections[0].get_color(), [[*colors.to_rgba("crimson")]])
    assert run.plot(color=(0.1, 0.2, 0.3), title=True).get_title() != ""
    monkeypatch.setattr("suslov_fast.runs.drawing.MOST_DOTS", 100)
    assert "of their states" in run.plot(lines=False).get_title()  # some are left out
    assert run.plot(lines=False, title=False).get_title() == ""
    with pytest.raises(ValueError, match=r"color\b"):
        run.plot(color="crimsn")


def test_starts_have_a_colour_each():
    """With a key of up to eight, which names the starts if the plot has the time 0."""
    field = sf.QuadraticField.from_function(lambda x: (x[1], -x[0]), "q v")
    x0 = np.array([[0.5, 0.0], [1.0, 0.0], [1.5, 0.25]])
    motion = sf.flow(field, x0, time=np.linspace(0, 6, 61))
    axes = motion.plot()
    assert [each.get_text() for each in axes.get_legend().get_texts()] == [
        "(0.5, 0)", "(1, 0)", "(1.5, 0.25)"
    ]  # fmt: skip
    np.testing.assert_array_equal(axes.collections[0].get_array(), [0, 1, 2])
    axes = sf.flow(field, x0, time=[1.0, 2.0]).plot()
    assert axes.get_legend().get_texts()[2].get_text() == "trajectory 2"
    nine = sf.flow(field, np.tile(x0, (3, 1)), time=[0.0, 1.0]).plot()
    assert nine.get_legend() is None
    assert len(nine.figure.axes) == 1
    assert len({*nine.collections[0].get_array()}) == 9
    points = sf.crossings(field, x0, surface="v", time=7.0)
    axes = points.plot("time", "q")
    np.testing.assert_array_equal(axes.collections[0].get_array(), points.trajectory)
    assert len(axes.get_legend().get_texts()) == 3
    assert sf.flow(field, x0[0], time=[0.0, 0.5, 1.0]).plot().get_legend() is None
    with pytest.warns(UserWarning, match="2 times"):
        sf.flow(field, x0[0], time=(0.0, 1.0)).plot("time")
