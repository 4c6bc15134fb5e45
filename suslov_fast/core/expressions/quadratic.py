"""Right-hand sides of quadratic fields, made from their terms."""

import numpy as np

from .programs import Expressions


def expressions_of(indices, D, is_one, is_minus_one):
    """Return `Expressions` of f_i = sum of v x_j x_k, the operands that are f, and P.

    Terms are (3, T), with x_D = 1. `is_one` and `is_minus_one` (T,) mark v that are 1 or -1 for all
    members. The other v are parameters, in the order of terms: see `parameters_of`.
    """
    given, first = ~(is_one | is_minus_one), D
    numbers = iter(range(first, first + int(given.sum())))
    values = Expressions(first + int(given.sum()), range(D, first + int(given.sum())))
    terms = [[] for _ in range(D)]
    for (i, j, k), minus, of_parameter in zip(
        indices.T.tolist(), is_minus_one.tolist(), given.tolist(), strict=True
    ):
        factors = sorted(a for a in (j, k) if a < D)
        factors += [next(numbers)] if of_parameter else []
        product = factors[0] if factors else 1.0
        for factor in factors[1:]:
            product = values.emit("fmul", product, factor)
        terms[i].append((minus, product))
    results = [_sum(values.emit, each) for each in terms]
    return values, results, given.sum().item()


def parameters_of(terms, is_one, is_minus_one):
    """Return the parameters (P, ...) from values (..., T) of terms."""
    return np.moveaxis(terms[..., ~(is_one | is_minus_one)], -1, 0)


def _sum(emit, terms):
    """Return the sum of terms, pairs (True if it is subtracted, value), in their order."""
    is_minus, total = False, None
    for minus, product in terms:
        if total is None:
            is_minus, total = minus, product
        elif minus == is_minus:
            total = emit("fadd", total, product)
        elif minus:
            total = emit("fsub", total, product)
        else:  # -a + b
            is_minus, total = False, emit("fsub", product, total)
    if total is None:
        return 0.0
    return emit("fmul", -1.0, total) if is_minus else total
