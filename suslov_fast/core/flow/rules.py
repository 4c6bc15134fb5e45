"""The rules of columns, and which of them takes the steps of a right-hand side f."""

import functools

from .gragg import Gragg
from .linearly_implicit import LinearlyImplicit
from .stormer import Stormer

RULES = Stormer, Gragg, LinearlyImplicit  # of the rules of a mode, the first that fits f is used


@functools.lru_cache(64)
def rule_of(f, mode, rtol):
    """Return the `Rule` of f for lanes in this `LaneState`."""
    own = next(rule for rule in RULES if rule.mode == mode and rule.fits(f))
    return _rule(own, f, own.columns_for(rtol, f.hybrid.ends_steps))


_rule = functools.lru_cache(64)(lambda own, f, columns: own(f, columns))
