"""Maps that are composed of simpler maps (stages), such as a QRT map of two involutions.

With symbolic parameters, polynomials of a stage have tens of terms, and of the composed map 10^4.
So points, lines and polynomials are mapped by one stage after another, and common factors divided
out of each.
"""

import math
import random
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from ..core.cached import cached_property
from .arithmetic import EPS
from .birational_maps import RationalMap
from .polynomials import Polynomials, coprime, random_line


class ComposedMap(RationalMap):
    """The map ``stages[-1](... stages[0](x))``."""

    def __init__(self, stages: Sequence[RationalMap], *more: Any) -> None:
        super().__init__(stages[0].forms, *more)
        self.stages = [*stages]
        del self.forms  # the forms of the first stage would hide the property

    @cached_property
    def forms(self) -> list[Any]:
        forms = self.variables
        for stage in self.stages:
            forms = coprime([stage.pullback(F, stage.degree, forms) for F in stage.forms])
        return forms

    def __reduce__(self) -> Any:
        return ComposedMap, (self.stages, self.inverse, self.letters, self.names, self.given)

    def _with(self, numbers: Mapping[str, Fraction]) -> RationalMap:
        inverse = self.inverse and self.inverse._with(numbers)
        return ComposedMap([each._with(numbers) for each in self.stages], inverse, (), self.names)

    @cached_property
    def coefficients(self) -> list[int]:
        return [c for stage in self.stages for c in stage.coefficients]

    @cached_property
    def degree(self) -> int:
        line = random_line(self.dimension, self.prime, random.Random(0))
        return max(x.degree() for x in self.at_eps(EPS).coprime_image(line))

    @cached_property
    def length(self) -> float:
        return max(stage.length for stage in self.stages)

    @property
    def cost_of_factors(self) -> float:
        return math.inf if len(self.letters) > 1 else super().cost_of_factors

    def homogeneous_image(self, x: Sequence[Any]) -> list[Any]:
        for stage in self.stages:
            x = stage.coprime_image(x)
        return [*x]

    def image(self, x: Sequence[Any]) -> list[Any]:
        for stage in self.stages:
            x = stage.image(x)
        return [*x]

    def derivative(self, x: Sequence[Any]) -> Any:
        product = self.stages[0].derivative(x)
        for before, stage in zip(self.stages, self.stages[1:], strict=False):
            x = before.image(x)
            product = stage.derivative(x) * product
        return product

    def pullbacks(self, space: Polynomials) -> list[Any]:
        for stage in reversed(self.stages):
            space = (*coprime(stage.pullbacks(space)),)
        return [*space]

    def cost_of_pullbacks(self, space: Polynomials) -> float:
        return sum(stage.cost_of_pullbacks(space) for stage in self.stages)


def composed(stages: Sequence[list[Any]], inverse: Any, letters: Any, *more: Any) -> RationalMap:
    """Return the composition of `stages`, lists F_1, ..., F_D, F_0; `more` are `names`, `given`."""
    if len(stages) == 1:
        return RationalMap(stages[0], inverse, letters, *more)
    maps = [RationalMap(forms, None, letters) for forms in stages]
    return ComposedMap(maps, inverse, letters, *more)
