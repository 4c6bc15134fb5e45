"""f of quadratic fields as it was typed: which list motions take, and that all copies take it."""

import copy
import json
import pickle

import numpy as np
import pytest

from suslov_fast import Change, QuadraticField, body_from_dict, flow


def lorenz(x, rho, beta=8 / 3):
    return 10 * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - beta * x[2]


def divided(x, rho):
    return 10 * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - x[2] * 8 / 3


def cancelling(x):
    return (x[0] + 1e6) * (x[1] + 1e6) - 1e12 - 1e6 * (x[0] + x[1]) + x[0], x[0] - x[1]


def counting(x, k):
    return x[1] * (x[0] - x[1]), -sum(x[:k]) * (x[0] + x[1])


def choosing(x, a):
    return np.where(a > 1, x[0], x[1]) * (x[0] - x[1]), -x[1]


def lattice(x):
    return np.roll(x, 1) * (np.roll(x, -1) - np.roll(x, 2)) - x + 8


def henon_heiles(x):
    return (x @ x) / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3


# f or H, D, parameters, and whether motions take what was typed
CASES = {
    "Lorenz": (lorenz, 3, {"rho": 28}, True),
    "products of sums": (lambda x: ((x[1] - x[0]) * (x[0] - x[1] + x[2]), -x[1], 1.0), 3, {}, True),
    "Lorenz-96": (lattice, 8, {}, True),
    "coupling by sums": (lambda x, a: x * (a - x.sum()), 16, {"a": 2.0}, True),
    "coupling of pairs": (lambda x: [sum(a * (1 - b) for b in x) for a in x], 6, {}, False),
    "quotients take long": (divided, 3, {"rho": 28}, False),
    "sums of large terms": (cancelling, 2, {}, False),
    "a parameter that counts": (counting, 2, {"k": 2}, False),
    "a parameter that chooses": (choosing, 2, {"a": 2}, False),
    "Henon-Heiles": (henon_heiles, 4, {}, False),
    "H of a sum": (lambda x: x[:6].sum() ** 3 + x[6:] @ x[6:] / 2, 12, {}, True),
}
OF_H = "Henon-Heiles", "H of a sum"


def make(name, kind=QuadraticField):
    f, D, parameters, _ = CASES[name]
    maker = kind.from_hamiltonian if name in OF_H else kind.from_function
    return maker(f, D, **parameters)


def starts(D):
    return np.random.default_rng(D).uniform(0.1, 0.4, (3, D))


def states(field, time=0.5, **more):
    return flow(field, starts(field.dimension), time=[time / 2, time], **more).states


@pytest.mark.parametrize("name", ["products of sums", "Lorenz-96"])
def test_what_was_typed_is_no_part_of_equality(name):
    field = make(name)
    by_terms = QuadraticField.from_terms(*field.terms, field.dimension)
    assert field == by_terms
    assert hash(field) == hash(by_terms)


WAYS = {
    "pickle": lambda field: pickle.loads(pickle.dumps(field)),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "text": lambda field: body_from_dict(json.loads(json.dumps(field.to_dict()))),
    "text twice": lambda field: WAYS["text"](WAYS["pickle"](WAYS["text"](field))),
    "parameters": lambda field: field.with_parameters(),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ["Lorenz", "products of sums", "H of a sum", "Henon-Heiles"])
def test_copies_move_with_the_same_bits(name, way):
    assert np.array_equal(states(WAYS[way](make(name))), states(make(name)))


@pytest.mark.parametrize("way", WAYS)
def test_bits_of_a_member_depend_on_no_other(way):
    """Members without some terms have other lists: of zeros, of a clock, of the terms."""

    def f(x, a, b):
        return a * (x[0] - x[1]) * (x[0] - x[1] + x[2]) + 1, b * x[0] - x[1], a * (x[1] - x[2])

    a, b = np.array([0.0, 1.0, 1.0, -0.5, 0.0]), np.array([1.0, 1.0, 0.0, 2.0, 0.0])
    field = WAYS[way](QuadraticField.from_function(f, 3, a=a, b=b))
    x = starts(3)[0]
    changes = Change(
        surface=lambda x, b: x[0] - 0.45 - 0 * b, to=lambda x: (x[0], x[1] + 0.1, x[2])
    )
    for more in {}, {"changes": changes}, {"stiff": True}, {"derivatives": "x0"}:
        found = flow(field, x, time=0.5, **more).states[-1]
        for i in range(len(a)):
            alone = QuadraticField.from_function(f, 3, a=a[i], b=b[i])
            assert np.array_equal(found[i], flow(alone, x, time=0.5, **more).states[-1])
            assert np.array_equal(found[i], flow(field[i], x, time=0.5, **more).states[-1])


def test_f_is_not_called_again_where_its_list_is_no_shorter():
    calls = []

    def f(x):
        calls.append(x)
        return [sum(a * (1 - b) for b in x) for a in x]

    field = QuadraticField.from_function(f, 6)
    made = len(calls)
    states(pickle.loads(pickle.dumps(field)))
    states(field)
    assert len(calls) == made
