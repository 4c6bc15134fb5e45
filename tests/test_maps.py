"""What every map of the registry must do."""

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._maps.registry import map_named, map_of


class Named(sf.Suslov3D):
    """A class of a user, derived from a body."""


def test_objects_of_a_subclass_are_bodies():
    body, own = sf.Suslov3D(4, 1, -0.5, -0.3), Named(4, 1, -0.5, -0.3)
    assert map_of(own) is map_of(body)
    for function in (sf.step, sf.first_integral, sf.jacobian):
        np.testing.assert_array_equal(function(own, [1, 0.5], 0.2), function(body, [1, 0.5], 0.2))
    assert sf.energy(own, [1, 0.5]) == sf.energy(body, [1, 0.5])
    run = sf.iterate(own, [1, 0.5], 0.2, 9)
    assert sf.attitude(own, run.omega, 0.2).shape == (10, 3, 3)
    with pytest.raises(TypeError, match=r"body: expected Suslov3D or SuslovND or .*, got Body"):
        sf.step(sf.Suslov3D.__base__(), [1, 0.5], 0.2)


def test_labels_of_axes():
    assert map_of(sf.SuslovND(np.ones(3), np.ones(3))).symbols(sf.SuslovND([1, 1], [1, 1])) == [
        r"$\Omega_{1n}$",
        r"$\Omega_{2n}$",
    ]
    with pytest.raises(ValueError, match=r"map: expected suslov3d or .* got 'Euler'"):
        map_named("Euler")
