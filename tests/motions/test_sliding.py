"""Solutions that slide along surfaces at which f jumps."""

import numpy as np
import pytest

from suslov_fast import Field, flow


@pytest.mark.parametrize("power", [1, 2])
def test_what_is_decided_does_not_depend_on_the_times_asked(power):
    """A block that leaves its belt leaves it tangentially; a time asked there changed its mode."""
    belt = Field(
        lambda s: (
            s[1],
            -s[0] - 0.4 * np.sign(s[1] - 0.3) * (0.5 + 0.5 / (1 + abs(s[1] - 0.3) ** power)),
        ),
        "x v",
    )
    starts = np.array([[0.0, 1.0], [0.0, 0.0], [0.3, 0.3], [-1.0, 0.7]])
    one, few, many = (flow(belt, starts, time=np.linspace(0, 40, n)[1:]) for n in (2, 41, 401))
    assert one.ok.all()
    np.testing.assert_allclose(few.final, one.final, atol=1e-7)
    np.testing.assert_allclose(many.final, one.final, atol=1e-7)
    np.testing.assert_allclose(many.states[9::10], few.states, atol=1e-7)
