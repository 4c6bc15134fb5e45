"""Results as tables of pandas."""

import numpy as np
import pytest

import suslov_fast as sf

FAMILY = sf.Field(lambda x, k: (x[1], -k * x[0]), "q v", k=[1.0, 4.0])
X0 = [[1.0, 0.0], [0.0, 2.0]]
RESULTS = {
    "map": lambda: sf.iterate(FAMILY, X0, [0.1, 0.2], 30, save_every=10),
    "motion": lambda: sf.flow(FAMILY, X0, time=[0.5, 1.0, 2.0]),
    "crossings": lambda: sf.crossings(FAMILY, X0, surface="q", time=9.0),
    "one": lambda: sf.flow(FAMILY[0], [1.0, 0.0], time=[0.0, 1.0]),
    "body": lambda: sf.iterate(sf.Suslov3D(4, [1, 2], -0.5, -0.3), [1.0, 0.5], 0.1, 3),
}


@pytest.mark.parametrize("kind", RESULTS)
def test_tables_have_a_row_for_each_state(kind):
    result = RESULTS[kind]()
    table = result.to_dataframe()
    labels = [*result.names]
    assert table.shape[0] == result.states[..., 0].size
    assert [*table.columns[-2:]] == labels
    if kind == "crossings":
        np.testing.assert_array_equal(table[labels], result.states)
        np.testing.assert_array_equal(table.k, np.array([1.0, 4.0])[result.trajectory])
        return
    for number, rows in table.groupby("trajectory") if kind != "one" else [(0, table)]:
        of_one = ... if kind == "one" else (slice(None), number)
        np.testing.assert_array_equal(rows[labels], result.states[of_one])
        times = np.reshape(result.time, (len(result.states), -1))
        np.testing.assert_array_equal(rows.time, times[:, number % times.shape[1]])
    columns = {
        "map": ["n", "time", "k", "eps"],
        "motion": ["time", "k"],
        "body": ["n", "time", "I2"],
    }
    assert [*table.columns[:-2]] == ["trajectory", *columns[kind]] if kind in columns else ["time"]
