"""Plots show the values of the functions."""

import re

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

import suslov_fast as sf
from suslov_fast.bodies.rigid import FIGURES

# The end of Section 4 of the paper, arXiv:0807.2966, from its LaTeX source.
PAPER = r"""
picture 1: $\epsilon=0.2, I_1=4, I_2=1, I_{13}=-0.5, I_{23}=-0.3$, for picture 2: $\epsilon=0.2,
I_1=4, I_2=3, I_{13}=-0.4, I_{23}=-0.2$, for picture 3: $\epsilon=0.02, I_1=4, I_2=2, I_{13}=0,
I_{23}=-0.2$ and for picture 4: $\epsilon=1, I_1=3, I_2=3, I_{13}=-0.2, I_{23}=-0.2$.
"""
BODY = sf.Suslov3D(4, 1, -0.5, -0.3)
GYROSTAT = sf.Suslov3D(4, 2, -0.5, -0.3, 0.4)


def test_the_parameters_of_the_paper():
    values = np.array(re.findall(r"=(-?[\d.]+)", PAPER), float).reshape(4, 5)
    for (*figure, _), (eps, *parameters) in zip(FIGURES.values(), values, strict=True):
        assert figure == [sf.Suslov3D(*parameters), eps]


PHASES = [(*figure, 12) for figure in FIGURES.values()]
PHASES += [(GYROSTAT, 0.4, 2.6, 11), (sf.Suslov3D(4, 2, 0, 0, 0.4), 0.4, 2.6, 6)]


@pytest.mark.parametrize(("body", "eps", "extent", "orbits"), PHASES)
def test_phase(body, eps, extent, orbits):
    """Levels that meet the line of steady states have two orbits from it to it, others one turn."""
    axes = sf.plot_phase(body, eps, extent, levels=6)
    assert axes.get_legend() is not None
    assert rf"$\epsilon={eps:g}$" in axes.get_title()
    assert axes.get_xlim() == axes.get_ylim() == (-extent, extent)
    I1, I2, I13, I23, k = (body.parameters.get(name, 0) for name in "I1 I2 I13 I23 k".split())
    level, lines = np.nan, axes.get_lines()
    assert sum("= 0" in line.get_label() for line in lines) == (2 if I13 or I23 else 0)
    for line in lines:
        states = line.get_xydata()
        along = abs(states @ [I13, I23] + k)
        if "= 0" in line.get_label():
            assert along.max() < 1e-12 * extent
        elif len(states):
            F = body.first_integral(states, eps)
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
    first = figure.add_subplot(1, 2, 1)
    run = sf.iterate(BODY, [[1.0, 0.5], [0.2, -0.7]], 0.2, 9)
    assert run.plot(color="red", ax=first) is first
    assert sf.plot_phase(*FIGURES[1], levels=2, ax=first) is first
    assert not plt.get_fignums()
    assert run.plot().figure in map(plt.figure, plt.get_fignums())  # notebooks show it


DUFFING = sf.Field(lambda x: (x[1], x[0] - x[0] ** 3 - 0.2 * x[1]), "q p")
LASER = sf.Field(lambda z: (1.0 + 0.5j) * z - z * abs(z) ** 2, "z", complex=True)
UNREAD = sf.Field(lambda t, y: (y[1], y[0] - y[0] ** 3 - 0.2 * y[1]), "q p")


@pytest.mark.parametrize("field", [DUFFING, LASER, UNREAD])
def test_portraits(field):
    """Nullclines lie where a component of f is 0; filled dots attract, others do not."""
    axes = sf.plot_phase(field, extent=(-2, 1.5, -1, 1))
    assert (axes.get_xlim(), axes.get_ylim()) == ((-2, 1.5), (-1, 1))
    contours = [each for each in axes.collections if hasattr(each, "levels")]
    assert len(contours) == 2
    layout = field._layout
    for k, each in enumerate(contours):
        points = np.vstack([path.vertices for path in each.get_paths()])
        f = field(points[:, :1] + 1j * points[:, 1:] if field is LASER else points)
        assert len(points) > 100
        assert abs(layout.of_parts(f)[:, k]).max() < 2e-3
    dots = {
        line.get_markerfacecolor(): np.sort(line.get_xdata())
        for line in axes.get_lines()
        if line.get_marker() == "o"
    }
    wanted = {"w": [0.0]} if field is LASER else {"k": [-1.0, 1.0], "w": [0.0]}
    assert dots.keys() == wanted.keys()
    for colour, places in wanted.items():
        np.testing.assert_allclose(dots[colour], places, atol=1e-9)
    assert not [
        each
        for each in sf.plot_phase(field, nullclines=False).collections
        if hasattr(each, "levels")
    ]


def test_events_are_dots():
    """At their states, in the colour of the parameter; over time, too."""
    family = sf.Field(lambda x, k: (x[1], -k * x[0]), "x v", k=[1.0, 4.0])
    section = sf.crossings(family, [1.0, 0.0], "x", time=10.0)
    [dots] = section.plot("x", "v").collections
    np.testing.assert_array_equal(dots.get_offsets(), section.states)
    np.testing.assert_array_equal(dots.get_array(), [1.0, 4.0][:1] * 3 + [4.0] * 6)
    axes = section.plot("time", "v", color="red", s=3)
    [dots] = axes.collections
    np.testing.assert_array_equal(dots.get_offsets(), np.c_[section.time, section["v"]])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$t$", "$v$")
    assert sf.crossings(family[0], [1.0, 0.0], "x", time=10.0).plot(ax=axes) is axes


# ------------------------------------------------------------------ time, space, colours
def saddle_run():
    field = sf.Field.from_hamiltonian(
        lambda x: sum(each**2 for each in x) / 2 + x[0] ** 2 * x[1], "x y px py"
    )
    return sf.iterate(field, np.random.default_rng(0).uniform(-0.2, 0.2, (3, 4)), 1 / 16, 50)


def test_runs_are_drawn_with_their_names():
    run = saddle_run()
    axes = run.plot("time", "px")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$t$", "$p_{x}$")
    drawn = [line.get_xydata() for line in axes.lines]
    np.testing.assert_array_equal([each[:, 0] for each in drawn], np.tile(run.time, (3, 1)))
    np.testing.assert_array_equal([each[:, 1] for each in drawn], run.states[..., 2].T)
    space = run.plot(0, 1, "px")
    assert (space.name, space.get_zlabel()) == ("3d", "$p_{x}$")
    with pytest.raises(ValueError, match="z"):
        run.plot("z")


def test_axes_in_space():
    """A sphere is round, and labels are inside the figure; other extents have axes of their own."""
    turns = sf.Field(lambda m: (m[1] * m[2], -2 * m[0] * m[2], m[0] * m[1]), "a b c")
    motion = sf.flow(turns, [[0.1, 0.99, 0.1], [0.7, 0.1, 0.7]], time=np.linspace(0, 20, 500))
    axes = motion.plot("a", "b", "c")
    axes.figure.canvas.draw()
    limits = [np.ptp(each) for each in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())]
    np.testing.assert_allclose(axes._box_aspect / axes._box_aspect[0], limits / limits[0])
    for each in (axes, motion.plot("time", "b", "c")):
        each.figure.canvas.draw()
        for axis in (each.xaxis, each.yaxis, each.zaxis):
            box = axis.label.get_window_extent()
            assert 0 < box.x0 < box.x1 < each.figure.bbox.width
            assert 0 < box.y0 < box.y1 < each.figure.bbox.height
    given = plt.figure().add_subplot(projection="3d")
    before = given._box_aspect.copy()
    np.testing.assert_array_equal(motion.plot("a", "b", "c", ax=given)._box_aspect, before)


def test_orbits_of_large_batches_share_lines():
    starts = np.random.default_rng(0).uniform(-1.0, 1.0, (300, 2))
    run = sf.iterate(BODY, starts, 0.2, 4)
    for options in ({}, {"color": "red"}, {"color": np.arange(300.0)}):
        axes = run.plot(**options)
        assert len(axes.lines) <= 64
        drawn = np.concatenate([line.get_xydata() for line in axes.lines])
        drawn = drawn[np.isfinite(drawn[:, 0])]
        expected = run.states.reshape(-1, 2)
        np.testing.assert_array_equal(*(x[np.lexsort(x.T)] for x in (drawn, expected)))
        for line in axes.lines:  # no orbit is joined to the next one
            orbits = np.split(line.get_xydata(), np.flatnonzero(np.isnan(line.get_xdata())))
            assert {np.isfinite(each).all(axis=1).sum() for each in orbits} == {5}
    assert len({line.get_color() for line in axes.lines}) == 64


def test_states_far_apart_are_dots():
    henon = sf.Map(lambda x: (1 - 1.4 * x[0] ** 2 + x[1], 0.3 * x[0]), 2)
    for run, style in ((sf.iterate(henon, [0.1, 0.1], 99), "None"), (saddle_run(), "-")):
        assert {line.get_linestyle() for line in run.plot().lines} == {style}
        assert {line.get_linestyle() for line in run.plot(lines=True).lines} == {"-"}


SPRING = sf.Field(lambda x, k, c: (x[1], -k * x[0] - c * x[1]), "q p", k=1.0, c=0.1)


def test_lists_of_names_and_properties_of_lines():
    motion = sf.flow(SPRING, [1.0, 0.0], time=np.linspace(0, 9, 100))
    lines = motion.plot("t", ["p", "q"], lw=2, ls="--").get_lines()
    assert [line.get_label() for line in lines] == ["$p$", "$q$"]
    assert {(line.get_linewidth(), line.get_linestyle()) for line in lines} == {(2, "--")}
    np.testing.assert_array_equal(lines[0].get_xydata(), np.c_[motion.time, motion["p"]])
    with pytest.raises(TypeError, match="plot has no argument 'figsize': use ax"):
        motion.plot(figsize=(3, 3))
    few = sf.flow(SPRING, [1.0, 0.0], time=np.linspace(0, 9, 5)).plot().get_lines()
    assert few[0].get_markersize() > 4


def test_a_motion_at_its_last_time_is_drawn_as_a_whole():
    whole = sf.flow(SPRING, [1.0, 0.0], time=np.linspace(0, 9, 201))
    for times in (9.0, [0.0, 9.0]):
        [line] = sf.flow(SPRING, [1.0, 0.0], time=times).plot("time", "q").get_lines()
        np.testing.assert_array_equal(line.get_xydata(), np.c_[whole.time, whole["q"]])
    several = sf.flow(SPRING, [[1.0, 0.0], [2.0, 0.0]], time=9.0).plot("q", "p")
    assert [len(line.get_xydata()) for line in several.get_lines()] == [1, 1]


def test_a_second_parameter_is_told():
    several = SPRING.with_parameters(k=[[1.0], [2.0], [3.0]], c=[0.1, 0.5])
    times = np.linspace(0, 9, 100)
    lines = sf.flow(several, [1.0, 0.0], time=times).plot("t", "q").get_lines()
    assert lines[3].get_label() == "$k$ = 2, $c$ = 0.5"
    assert [line.get_linestyle() for line in lines] == ["-", "--"] * 3
    many = SPRING.with_parameters(k=np.linspace(1, 3, 9)[:, np.newaxis], c=[0.1, 0.5])
    figure = sf.flow(many, [1.0, 0.0], time=times).plot("t", "q").figure
    assert figure.axes[1].get_ylabel() == "$k$, each for 2 $c$"
