"""Equations in LaTeX, as notebooks show them."""

import numpy as np
import pytest
from sympy import latex

import suslov_fast as sf
from suslov_fast import Field
from suslov_fast.integrability import report

SHOWN = {
    "pendulum": (
        Field(lambda x, k: (x[1], -k * np.sin(x[0] / 2)), "phi v", k=2.0),
        [
            r"\dot{\phi} &= v",
            r"\dot{v} &= -k \, \sin\left(\frac{\phi}{2}\right)",
            "k &= 2.0",
        ],
    ),
    "quotient": (
        Field(lambda x: ((x[0] + 1) ** 2.5 / (x[0] - np.sqrt(abs(x[0]))),), "x1"),
        [
            r"\dot{x_{1}} &= \frac{\left(x_{1} + 1\right)^{2.5}}"
            r"{x_{1} - \sqrt{\left|x_{1}\right|}}"
        ],
    ),
    "hamiltonian": (
        Field.from_hamiltonian(lambda x: (x[0] ** 2 + x[1] ** 2) / 2, "q p"),
        [r"\dot{q} &= p", r"\dot{p} &= -q", r"H &= \frac{q^{2} + p^{2}}{2}"],
    ),
    "body": (
        sf.Suslov3D(4, 1, -0.5, -0.25),
        [
            r"\dot{\Omega_{1}} &= \frac{1}{8} \, \Omega_{1} \, \Omega_{2} + "
            r"\frac{1}{16} \, \Omega_{2}^{2}",
            r"\dot{\Omega_{2}} &= -\frac{1}{2} \, \Omega_{1}^{2} - "
            r"\frac{1}{4} \, \Omega_{1} \, \Omega_{2}",
            "I_{1} &= 4.0", "I_{2} &= 1.0", "I_{13} &= -0.5", "I_{23} &= -0.25",
        ],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SHOWN)
def test_equations_in_notebooks(name):
    thing, lines = SHOWN[name]
    expected = r" \\ ".join(lines)
    text = rf"$\displaystyle \begin{{aligned}}{expected}\end{{aligned}}$"
    assert thing._repr_latex_() == text


def test_others_are_shown_as_texts():
    family = Field(lambda x, k: (-k * x[0],), "x1", k=[1.0, 2.0])
    large = Field(lambda x: x * np.sum(x), 40)
    for each in (family, large, sf.Suslov3D([4, 3], 1, -0.5, -0.25)):
        assert each._repr_latex_() is None


def test_formulas_of_reports():
    field = Field(lambda x: (x[1], -x[0]), 2)
    found = report(field, degree=2)
    text = found.integrals[0]._repr_latex_()
    assert text.startswith(r"$\displaystyle x_{1}")
    assert latex([found.integrals[0]]) == rf"\left[ {latex(found.integrals[0])}\right]"
    assert r"\mathtt" not in latex(found.integrals[0])
    assert text.count("$") == 2
