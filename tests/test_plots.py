"""What is drawn is what the functions compute, and the paper's numbers are its own."""

import re
import sys

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._bodies.paper import PICTURES

matplotlib = pytest.importorskip("matplotlib")

# The end of Section 4 of the paper, arXiv:0807.2966, as its source has it.
PAPER = r"""
The last statement is illustrated by the following pictures. In all four cases, the line
$I_{13}\Omega_1+I_{23}\Omega_2=0$ is clearly indicated. Following parameters are chosen for
picture 1: $\epsilon=0.2, I_1=4, I_2=1, I_{13}=-0.5, I_{23}=-0.3$, for picture 2: $\epsilon=0.2,
I_1=4, I_2=3, I_{13}=-0.4, I_{23}=-0.2$, for picture 3: $\epsilon=0.02, I_1=4, I_2=2, I_{13}=0,
I_{23}=-0.2$ and for picture 4: $\epsilon=1, I_1=3, I_2=3, I_{13}=-0.2, I_{23}=-0.2$.
"""


def chosen_in_the_paper():
    for number, text in re.findall(r"picture (\d): \$(.*?)\$", PAPER, re.DOTALL):
        named = dict(re.findall(r"(\\epsilon|I_\{?\d+\}?)=(-?[\d.]+\d|\d)", text))
        values = {
            name.strip("\\").translate({ord(c): None for c in "_{}"}): float(value)
            for name, value in named.items()
        }
        yield int(number), values.pop("epsilon"), values


def test_the_parameters_of_the_paper():
    chosen = list(chosen_in_the_paper())
    assert [number for number, _, _ in chosen] == list(PICTURES) == [1, 2, 3, 4]
    for number, eps, values in chosen:
        assert PICTURES[number].eps == eps
        assert PICTURES[number].body == sf.Suslov3D(**values)


@pytest.mark.parametrize("number", PICTURES)
def test_phase(number):
    body, eps, extent = PICTURES[number]
    axes = sf.plot_phase(body, eps, extent, levels=4, letter="a")
    assert axes.get_title() == ""
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
    legend = axes.figure.legends[0]
    assert [text.get_text().split("$")[-1].strip(", ") for text in legend.get_texts()] == [
        "attracting",
        "repelling",
        "constant",
        "states of the map",
    ]
    assert [text.get_text() for text in axes.texts if text.get_text()] == ["(a)"]


def test_axes_are_taken_and_returned():
    figure = matplotlib.figure.Figure()
    axes = figure.subplots(1, 2)
    assert sf.plot_phase(*PICTURES[1], levels=2, legend=False, axes=axes[0]) is axes[0]
    assert not figure.legends
    assert sf.plot_convergence(axes=axes[1]) is axes[1]
    panels = figure.subplots(1, 3)
    assert sf.plot_regimes(axes=panels) is panels


def test_convergence_has_order_2():
    axes = sf.plot_convergence(letter="b")
    of_map, of_attitude, guide = (np.log(line.get_xydata()) for line in axes.get_lines())
    for line in (of_map, of_attitude):
        assert abs(np.polyfit(*line[3:].T, 1)[0] - 2) < 0.01
    assert abs(np.polyfit(*guide.T, 1)[0] - 2) < 1e-12


def test_regimes():
    panels = sf.plot_regimes(letters="abc")
    for panel in panels:
        named = {line.get_label(): line.get_xydata() for line in panel.get_lines()}
        np.testing.assert_allclose(named["iterated"], named["closed form"], atol=1e-12)
        X, Y = named["iterated"].T
        level = (X**2 + 2 * Y**2) / (2 + X**2)
        np.testing.assert_allclose(level, level[0], rtol=1e-12)


def test_four_dimensions():
    space, drift = sf.plot_four_dimensions(letters="ab")
    assert space.get_xlabel() == r"$\Omega_{14}$"
    slopes = [np.polyfit(*np.log(line.get_xydata()).T, 1)[0] for line in drift.get_lines()]
    np.testing.assert_allclose(slopes, [2, 2, 4, 4], atol=0.1)
    with pytest.raises(ValueError, match="body: expected a single one with n = 4"):
        sf.plot_four_dimensions(sf.SuslovND([1, 2], [1, 2]))


@pytest.mark.compiled
def test_scattering():
    panels = sf.plot_scattering((1.0, 4.0), letters="ab")
    assert len(panels) == 2
    assert panels[0].figure.axes[-1].get_ylabel() == "scattering angle (degrees)"


def test_animation():
    animation = sf.animate_body(steps=6, every=3)
    frames = list(animation.new_frame_seq())
    assert frames == [0, 3, 6]
    animation._draw_was_started = True  # nothing is saved here
    for number in frames:
        animation._func(number)
    path = animation._fig.axes[0].get_lines()[-1]
    assert len(np.asarray(path.get_data_3d()).T) == 7
    np.testing.assert_allclose(np.linalg.norm(path.get_data_3d(), axis=0), 1.15, rtol=1e-12)
    with pytest.raises(ValueError, match="I3: expected one with a positive definite"):
        sf.animate_body(I3=0.01)


def test_bad_input():
    with pytest.raises(ValueError, match="extent: expected one in which orbits follow"):
        sf.plot_phase(PICTURES[1].body, 10.0, 4.0)
    with pytest.raises(ValueError, match="I13 or I23 other than 0"):
        sf.plot_phase(sf.Suslov3D(1, 2, 0, 0), 0.1, 4.0)
    with pytest.raises(TypeError, match="body: expected Suslov3D"):
        sf.plot_phase(sf.SuslovND([1, 2], [1, 2]), 0.1, 4.0)


def test_without_matplotlib(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"pip install 'suslov_fast\[plots\]'"):
        sf.plot_convergence()


@pytest.mark.compiled
@pytest.mark.parametrize("format_of_files", ["pdf", "svg"])
def test_vector_formats(tmp_path, monkeypatch, capsys, format_of_files):
    from suslov_fast._cli import main, pictures

    written = []
    drawings = pictures.DRAWINGS
    # Pictures 2 to 4 are made as picture 1 is.
    kinds = ["picture1", "regimes", "convergence", "four_dimensions", "scattering"]
    assert drawings.keys() == {*kinds, "picture2", "picture3", "picture4"}
    for folder, names in ((tmp_path / "first", kinds), (tmp_path / "again", kinds[::4])):
        monkeypatch.setattr(pictures, "DRAWINGS", {name: drawings[name] for name in names})
        with pytest.raises(SystemExit) as stopped:
            main(["pictures", "-o", str(folder), "--format", format_of_files, "--letters"])
        assert stopped.value.code == 0, capsys.readouterr().err
        written.append({path.name: path.read_bytes() for path in folder.iterdir()})
    first, again = written
    assert (len(first), len(again)) == (5, 2)
    assert again.items() <= first.items(), "the same picture is the same file"
    start = b"%PDF" if format_of_files == "pdf" else b"<?xml"
    assert all(each.startswith(start) for each in first.values())
