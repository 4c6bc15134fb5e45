"""`on_level`: a map on a level of given integrals, or of the integrals of its report."""

from __future__ import annotations

from typing import Any

from ..fields.base import Body
from ..keywords import public
from .birational_maps import RationalMap
from .letters import checked_map
from .level_maps import Level, level_of
from .report import report


@public
def on_level(
    map: RationalMap | Body, integrals: Any = None, *, point: Any = None, letter: str = "h"
) -> Level:
    """Restrict a map of D variables to a level of D - 2 first integrals.

    The result is a birational map of the plane, for `planar_entropy` and `report`. Integrals that
    have degree 1 in a variable are solved for it; if one equation of degree 2 in three variables is
    left, it is projected from a point of the level.

    Parameters
    ----------
    map : KahanMap or RationalMap
        A birational map of three variables or more, with an inverse. If eps or another letter is
        symbolic, it stays so, and `point` is needed.
    integrals : sequence of RationalFunction or callable, optional
        D - 2 independent first integrals, such as those of a report; a callable takes the tuple of
        variables. By default the first ones that ``report(map)`` finds.
    point : sequence of D rational numbers, optional
        The level is that through this point. By default a letter stands for the value of the
        integral, or for a coordinate of a point of the level, so that the level is the generic one
        if D = 3. If D > 3, the other coordinates are small numbers.
    letter : str, optional
        The name of this letter, by default h.

    Returns
    -------
    Level
        Its `map` is planar and has an inverse.

    Raises
    ------
    TypeError, ValueError
        If these are not D - 2 independent integrals of the map, or the point is a singular one of
        their level, or no rule applies: then the message has the degrees of the equations left.
    ArithmeticError
        If there is no map, or none of the level to itself.

    Examples
    --------
    >>> from suslov_fast.integrability import kahan, on_level, planar_entropy, zoo
    >>> map = kahan(*zoo()["Volterra chain, N = 3"])
    >>> level = on_level(map, [lambda x: x[0] + x[1] + x[2]])
    >>> level
    Level(x1 + x2 + x3 = h; solved for x1)
    >>> level.map.degree, planar_entropy(level.map).entropy
    (2, 0.0)
    """
    map = checked_map(map)
    if integrals is None:
        integrals = report(map).integrals[: map.dimension - 2]
    return level_of(map, integrals, point, letter)
