"""Errors of the package: their base class, and what a report of a problem prints."""

import platform

import numpy as np
import pytest

import suslov_fast as sf


def test_errors_that_tell_of_the_mathematics_have_one_base_class():
    blow_up = sf.QuadraticField([[[1]]])
    body = sf.SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
    for call, kind in (
        (lambda: sf.iterate(blow_up, [1.0], 1.0, 3, on_singular="raise"), sf.SingularStepError),
        (lambda: sf.first_integral(body, [1.0, 1.0, 1.0], 0.1), sf.NotIntegrableError),
    ):
        with pytest.raises(sf.SuslovError) as told:
            call()
        assert type(told.value) is kind
    assert issubclass(sf.SingularStepError, ArithmeticError)
    assert issubclass(sf.NotIntegrableError, ValueError)
    for wrong in (lambda: sf.iterate(blow_up, [1.0, 2.0], 1.0, 3), lambda: sf.step(1, [1.0], 1.0)):
        with pytest.raises((ValueError, TypeError)) as told:
            wrong()
        assert not isinstance(told.value, sf.SuslovError)


def test_versions_for_reports(capsys):
    sf.show_versions()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"suslov_fast {sf.__version__}"
    assert lines[1] == f"python {platform.python_version()}"
    assert f"numpy {np.__version__}" in lines
    assert any(line.startswith("llvmlite ") for line in lines)
