"""Proofs that the orbits of the points to which curves are contracted never end.

An orbit ends at a point without an image. It never ends if it is periodic modulo a small prime,
where all its points have images.
"""

from __future__ import annotations

import random

from .contracted_curves import Passage, Plane, PlaneModulo

_SMALL_PRIMES = (5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79)
_TRIES = 3  # points and numbers in place of eps for each of these


def why_never(plane: Plane, number: int, passage: Passage) -> str:
    """Return why the orbit of curve `number`, with orders `passage`, never ends; "" if unproved."""
    for p in _SMALL_PRIMES:
        rng = random.Random(p)
        for _ in range(_TRIES):
            eps = rng.randrange(1, p)
            residues = PlaneModulo(plane, p, (eps,), rng.randrange(99))
            if _is_periodic_modulo(residues, number, passage):
                at = f" and {plane.map.letter} = {eps}" if plane.symbolic else ""
                return f"never, since modulo {p}{at} the orbit is periodic"
    return ""


def _is_periodic_modulo(residues: PlaneModulo, number: int, passage: Passage) -> bool:
    """Return True if the orbit of curve `number` modulo a prime is periodic, and has all images.

    A smooth point of the curve modulo p is the residue of a point over the p-adic numbers. If
    images do not vanish modulo p, they are residues of the true orbit. `passage` has its orders.
    """
    if any(P == 0 for P in (*residues.forms, residues.curves[number])):
        return False
    germ, terms = residues.germ(residues.curves[number]), 1 + sum(passage.common_orders)
    for expected in (0, *passage.common_orders):
        if germ is None or (step := residues.step(germ, terms)) is None:
            return False
        germ = step.germ
        terms -= step.common_order
        if step.common_order != expected:
            return False
    x = [P[0] for P in germ or ()]
    visited = set()
    while any(x):
        pivot = next(a for a in x if a)
        point = tuple(int(a / pivot) for a in x)
        if point in visited:
            return True
        visited.add(point)
        x = [F(*point) for F in residues.forms]
    return False
