"""The equations that all members of a family share: the list of operations of f."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ..core.cached import cached_property
from ..core.expressions.dense_product import expanded, roll
from ..core.expressions.derivative import gradients
from ..core.expressions.numpy_evaluation import evaluate
from ..core.expressions.programs import Expressions, Program, emitted, in_order, needed_for
from ..core.expressions.projection import Invariants
from ..core.expressions.right_hand_side import RightHandSide
from .equation_text import brief, written
from .tolerances import LONGEST_SHORTENED
from .tracer import Tracer


class Equations:
    """The equations that all members of a family share: the operations of f and of H.

    names, parameters  names of variables and of parameters, which are the first operands
    values, results    the operations of f and H, and the operands that are components of f; their
                       order depends on f and H, not on how f was written
    products           like `values`, but a product with a dense matrix is one operation
    positions          how many variables of mechanics, the first ones, are coordinates
    H, K               the operand of H, and the entries (i, j, value) of K; None without H
    ratios             the fractions that were typed, by the nearest floats
    """

    def __init__(
        self,
        names: Sequence[str],
        parameters: Sequence[str],
        values: Any,
        results: Sequence[Any],
        H: Any = None,
        K: Any = None,
        ratios: Mapping[float, Fraction] | None = None,
        quantities: Mapping[str, Sequence[Any]] | None = None,
        positions: int | None = None,
    ) -> None:
        self.names, self.parameters, self.K = tuple(names), tuple(parameters), K
        self.ratios = dict(ratios or {})
        roll(values)
        quantities = quantities or {}
        others = [*([] if H is None else [H]), *(a for of in quantities.values() for a in of)]
        values, operands = in_order(values, [*results, *others])
        self.products = values, operands[: len(results)]
        self.H = None if H is None else operands[len(results)]
        self._others = operands[len(operands) - sum(map(len, quantities.values())) :]
        self.sizes = sizes = {name: len(of) for name, of in quantities.items()}
        if positions is None and "corrections" in sizes:
            positions = sizes["corrections"] - sizes["momenta"]
        self.positions = positions or 0

    @cached_property
    def _written(self) -> tuple[Any, list[Any]]:
        values, results = self.products
        return expanded(values, [*results, *self._others])

    values = property(lambda self: self._written[0])
    results = property(lambda self: self._written[1][: len(self.names)])

    @cached_property
    def quantities(self) -> dict[str, list[Any]]:
        """The operands of functions of the state, by name."""
        rest = iter(self._written[1][len(self.names) :])
        return {name: [next(rest) for _ in range(size)] for name, size in self.sizes.items()}

    @cached_property
    def invariants(self) -> Invariants:
        """What steps of a motion keep: constraints, then first integrals."""
        constraints = self.quantities.get("residuals", [])
        integrals = self.quantities.get("conserved", [])
        return Invariants([*constraints, *integrals], len(constraints), self.positions)

    @cached_property
    def read_last(self) -> bool:
        """True if another component, or a quantity, depends on the last one."""
        D = len(self.names) - 1
        operations = self.products[0].operations
        return any(depends(operations, a, D) for a in [*self.products[1][:D], *self._others])

    @cached_property
    def with_timeless_integrals(self) -> Equations:
        """The same equations without first integrals that depend on the last component."""
        D, quantities = len(self.names) - 1, dict(self.quantities)
        integrals = quantities.pop("conserved", [])
        if kept := [a for a in integrals if not depends(self.values.operations, a, D)]:
            quantities["conserved"] = kept
        about: Any = self.H, self.K, self.ratios, quantities
        return Equations(self.names, self.parameters, self.values, self.results, *about)

    @property
    def without_last(self) -> Equations:
        """The same equations without the last component, on which nothing else depends."""
        return self._with_names(self.names[:-1])

    def with_time(self, name: str) -> Equations:
        """The same equations with a component more, the last one, which has the rate 1."""
        return self._with_names((*self.names, name), 1.0)

    def _with_names(self, names: tuple[str, ...], *rate: float) -> Equations:
        """The equations of these components, which are one more, or one less; H is a quantity."""
        D, before, P = len(names), len(self.names), len(self.parameters)
        sizes = self.sizes | ({} if self.H is None else {"energy": 1})
        others = [*self._others, *([] if self.H is None else [self.H])]
        kept = min(D, before)
        old, rows = in_order(self.products[0], [*self.products[1][:kept], *others])
        new = {k: k for k in range(kept)} | {before + p: D + p for p in range(P)}
        values = Expressions(D + P, range(D, D + P))
        rows = emitted(values, Program(old.operations, rows), new)
        values.take_written(old, new)
        rest = iter(rows[kept:])
        quantities = {name: [next(rest) for _ in range(size)] for name, size in sizes.items()}
        about: Any = {"ratios": self.ratios, "quantities": quantities, "positions": self.positions}
        return Equations(names, self.parameters, values, [*rows[:kept], *rate], **about)

    @property
    def all_names(self) -> tuple[str, ...]:
        return (*self.names, *self.parameters)

    @cached_property
    def key(self) -> Any:
        """The equations as a text that does not depend on names, for ==."""
        sizes = len(self.names), len(self.parameters)
        values, results = self.products
        others = (self.sizes, self._others) if self.sizes else ()
        return repr((sizes, values.operations, results, self.H, self.K, *others))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Equations) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    @property
    def _identity(self) -> tuple[Any, ...]:
        return self.parameters, self.key

    @cached_property
    def right_hand_side(self) -> RightHandSide:
        values, results = in_order(self.values, self.results)
        return RightHandSide(values, results, len(self.parameters))

    @cached_property
    def with_products(self) -> RightHandSide:
        values, results = in_order(*self.products)
        return RightHandSide(values, results, len(self.parameters))

    @cached_property
    def texts(self) -> tuple[dict[str, str], list[str]]:
        """The definitions, and the texts of f; of a Hamiltonian field, the text of H."""
        results = self.results if self.H is None else [self.H]
        results = [*results, *(a for of in self.quantities.values() for a in of)]
        return written(self.values, results, self.all_names, self.ratios)

    def shown(self, operand: Any) -> str:
        """Return the text of an operand for readers."""
        return brief(self.values, operand, self.all_names, LONGEST_SHORTENED, self.ratios)

    def energy(self, x: Any, parameters: Any) -> Any:
        """Return H (...) at states (D, ...)."""
        return self.at([self.H], x, parameters)[0]

    def at(self, operands: Sequence[Any], x: Any, parameters: Any) -> list[Any]:
        """Return the values (...) of operands at states (D, ...)."""
        values, operands = in_order(self.values, operands)
        numbers = dict(enumerate([*x, *parameters]))
        with np.errstate(all="ignore"):
            evaluate(values.operations, numbers)
        return [a if isinstance(a, float) else numbers[a] for a in operands]


def depends(operations: Sequence[Any], operand: Any, component: int) -> bool:
    """Return True if the formula of an operand reads a component."""
    read = [operand, *(a for _, _, of in needed_for(operations, [operand]) for a in of)]
    return any(type(a) is int and a == component for a in read)


def of_hamiltonian(
    tracer: Tracer,
    names: Sequence[str],
    parameters: Sequence[str],
    energy: Any,
    matrix: Any,
    quantities: Mapping[str, Sequence[Any]] | None = None,
) -> Equations:
    """Return the equations x' = K grad H, for the operand `energy` of H and the entries of K."""
    # H alone determines the order of operations: so an H read from a text has the same gradient.
    quantities = quantities or {}
    others = [a for of in quantities.values() for a in of]
    values, [H, *others] = in_order(tracer.values, [energy, *others])
    rest = iter(others)
    quantities = {name: [next(rest) for _ in of] for name, of in quantities.items()}
    of_H = needed_for(values.operations, [H]) if quantities else [*values.operations]
    [slopes] = gradients(values, of_H, [H], len(names))
    rows: list[Any] = [None] * len(names)  # None, because 0 is the number of the first variable
    for i, j, c in matrix.T:
        if j in slopes:
            part = values.emit("fmul", float(c), slopes[j])
            rows[i] = part if rows[i] is None else values.emit("fadd", rows[i], part)
    entries = tuple((int(i), int(j), Fraction(c)) for i, j, c in matrix.T)
    ratios = tracer.ratios | {float(c): c for _, _, c in entries if float(c) != c}
    rates = [0.0 if row is None else row for row in rows]
    return Equations(names, parameters, values, rates, H, entries, ratios, quantities)


def check_equalities(values: Any, names: Sequence[str], rows: Sequence[Any]) -> None:
    """Raise ValueError if f asks whether a clock equals a number: no step is at this time."""
    clocks = {i for i, rate in enumerate(rows) if isinstance(rate, float) and rate != 0.0}
    for name, _, operands in values.operations:
        for a, b in (operands, operands[::-1]) if name == "oeq" else ():
            if type(a) is int and a in clocks and isinstance(b, float) and b != 0.0:
                raise ValueError(
                    f"f: {names[a]} == {b:g} holds at no step of the motion, whatever f is then: "
                    f"what happens at that time is Event(times=[{b:g}], to=...)"
                )
