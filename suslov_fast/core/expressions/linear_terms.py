"""Terms of a right-hand side: f = C m(x), with a constant matrix C and functions m of the state.

A left null vector c of C gives a linear integral c . x: c . f = 0 for all x. Products of sums are
expanded into terms, but quotients and other functions are not.
"""

import numpy as np

from .programs import depending
from .tolerances import MOST_FACTORS, MOST_TERMS, ROUNDING_OF_COEFFICIENTS


def coefficients(f, table):
    """Return C (members, D, terms) of a `RightHandSide` f = C m(x), with functions m of the state.

    `table` (members, n) has the table of f for each set of parameters. Each column of C is divided
    by its largest entry. A value that depends on branches is not expanded: it is a function in m.
    """
    parameters = f.hybrid.parameters(f.P)
    choices = depending(f.fixed, range(f.D + parameters, f.D + f.P))
    columns = dict(zip(f.table, table.T, strict=True))
    # {number of a value: {factors of a term: its coefficients, and the sums of their moduli}}
    terms = {a: {(): np.stack([c, abs(c)])} for a, c in columns.items() if a not in choices}

    def of(a):
        if isinstance(a, float):
            return {(): np.array([[a], [abs(a)]])}
        return terms.setdefault(a, {(a,): np.ones((2, 1))})

    for name, number, operands in f.rates.operations:
        parts = [of(a) for a in operands]
        if name == "fadd":
            terms[number] = _sum(parts)
        elif name == "fsub":
            terms[number] = _sum([parts[0], _product(parts[1], {(): np.array([[-1.0], [1.0]])})])
        elif name == "fmul" and _are_short(*parts):
            terms[number] = _product(*parts)
        elif name == "fdiv" and parts[1].keys() == {()}:
            terms[number] = {key: c / parts[1][()] for key, c in parts[0].items()}
        elif name == "fdiv":
            terms[number] = _product(parts[0], {((operands[1], "inverse"),): np.ones((2, 1))})
    rows = [of(a) for a in f.rates.results]
    keys = [*dict.fromkeys(key for row in rows for key in row)]
    both = np.zeros((2, len(table), f.D, len(keys)))
    for i, row in enumerate(rows):
        for key, c in row.items():
            both[:, :, i, keys.index(key)] = c
    C = np.where(abs(both[0]) <= ROUNDING_OF_COEFFICIENTS * both[1], 0.0, both[0])
    largest = abs(C).max(axis=1, keepdims=True, initial=0.0)
    return C / np.where(largest > 0.0, largest, 1.0)


def _sum(parts):
    terms = {}
    for part in parts:
        for key, c in part.items():
            terms[key] = terms.get(key, 0.0) + c
    return terms


def _are_short(a, b):
    degree = sum(max(map(len, part), default=0) for part in (a, b))
    return len(a) * len(b) <= MOST_TERMS and degree <= MOST_FACTORS


def _product(a, b):
    terms = {}
    for first, c in a.items():
        for second, d in b.items():
            key = (*sorted((*first, *second), key=str),)
            terms[key] = terms.get(key, 0.0) + c * d
    return terms
