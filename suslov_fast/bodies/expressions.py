"""Smooth expressions, with which functions of users are called to make a `LiftedField`.

An expression is a polynomial in the variables of the state and in added variables. Where f calls a
function g of a polynomial p, or divides by p, a variable u = g(p) is added (`definitions`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from .columns import Column
from .definitions import HALF, ONE, Definitions, brief, number, product, variable
from .polynomials import HOW, Polynomial, exact
from .texts import COMPARISONS


class NotSmooth(TypeError):
    """An operation on an expression for which there is no added variable."""

    def __init__(self, operation: str, of: Expression) -> None:
        super().__init__(f"{operation} of {of!r}")
        self.operation, self.of = operation, of

    def in_words(self, names: Sequence[str]) -> str:
        operation, of = self.operation, self.of
        f = {"absolute": "abs", "fabs": "abs"}.get(operation, operation)
        if f in HOW:
            return f"calls {f}, which has no rule: write {HOW[f]}"
        if f in COMPARISONS:
            where = f"compares {of}" if f != "if" else f"asks whether {of} is true"
            how = f"write a step as {_SMOOTH['if']} {_INSTEAD}"
            return f"{where}, as in if: a branch is not smooth: {how}"
        if f in _NEVER:
            how = f"write {_SMOOTH[f]} {_INSTEAD}" if f in _SMOOTH else "use SciPy's solve_ivp"
            return f"calls {f} of {of}: it is not smooth: {how}"
        return f"calls {f} of {of}, which has no rule; those with one are {', '.join(FUNCTIONS)}"


# Smooth functions near those that are not.
_SMOOTH = {
    "abs": "np.sqrt(x**2 + d**2)",
    "sign": "np.tanh(x / d)",
    **dict.fromkeys(("if", "heaviside", "where"), "(1 + np.tanh(x / d)) / 2"),
    **dict.fromkeys(("maximum", "fmax"), "(x + np.sqrt(x**2 + d**2)) / 2 for max(x, 0)"),
}
_INSTEAD = "with a small d, or use SciPy's solve_ivp"
_NEVER = set(
    "abs sign floor ceil rint trunc maximum minimum fmax fmin heaviside remainder fmod mod "
    "floor_divide divmod copysign round clip where logical_and logical_or logical_not".split()
)


class Expression(NDArrayOperatorsMixin):
    """A polynomial in the state and in added variables; f is called with it as a number.

    `factors` are polynomials with their powers, whose product it is: of 1/(1 + x)**2 the inverse of
    1 + x becomes a variable.
    """

    def __init__(
        self,
        polynomial: Polynomial,
        definitions: Definitions,
        factors: Sequence[tuple[Polynomial, Fraction | int]] = (),
    ) -> None:
        self.polynomial, self.definitions = polynomial, definitions
        self.factors = tuple(factors) or ((polynomial, 1),)

    def __array_ufunc__(self, operation: Any, method: str, *operands: Any, **options: Any) -> Any:
        if any(isinstance(each, np.ndarray) for each in operands):  # entry by entry
            return operation(*(np.array(each, object) for each in operands))
        if method != "__call__" or options:
            raise NotSmooth(f"{operation.__name__}.{method}", self)
        rule = RULES.get(operation.__name__)
        if rule is None:
            raise NotSmooth(operation.__name__, self)
        return rule(*(self._as_expression(each) for each in operands))

    def _as_expression(self, value: Any) -> Expression:
        if isinstance(value, Expression):
            return value
        return Expression(as_polynomial(value), self.definitions)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Return a method; NumPy calls that of an object for each entry of an array."""
            if name in RULES:
                return partial(self._call, name)
            if name in HOW or name in _NEVER:

                def refuse(*_: Any) -> None:
                    raise NotSmooth(name, self)

                return refuse
            raise AttributeError(f"'Expression' object has no attribute {name!r}")

    def _call(self, name: str, *others: Any) -> Expression:
        result: Expression = RULES[name](self, *(self._as_expression(each) for each in others))
        return result

    def conjugate(self) -> Expression:
        """Return the expression itself, because variables are real; products in NumPy call this."""
        return self

    def __bool__(self) -> bool:
        raise NotSmooth("if", self)

    def __round__(self, digits: Any = None) -> Any:
        raise NotSmooth("round", self)

    def __repr__(self) -> str:
        return self.text()

    def text(self, _: Any = None) -> str:
        """Return the expression in the variables of the state, for readers."""
        return brief(self.definitions.text(self.polynomial))


def state_of(definitions: Definitions) -> list[Expression]:
    """Return the variables of the state."""
    return [Expression(variable(i), definitions) for i in range(definitions.D)]


def as_polynomial(value: Any) -> Polynomial:
    """Return an expression, a number or a column of parameters as a polynomial."""
    if isinstance(value, Expression):
        return value.polynomial
    if isinstance(value, Column):
        return variable(value.symbol())
    return number(exact("coefficients", value))


def constant(p: Polynomial) -> Fraction | None:
    """Return the value of a polynomial without variables and symbols; None for others."""
    return p.terms.get((), Fraction(0)) if p.terms.keys() <= {()} else None


def _sum(sign: int) -> Callable[..., Expression]:
    def add(a: Expression, b: Expression) -> Expression:
        p, q = a.polynomial, b.polynomial
        return Expression(p + q if sign > 0 else p - q, a.definitions)

    return add


def _product(a: Expression, b: Expression) -> Expression:
    # Factors are kept where one of the two is a power or a product of sums.
    factors = [(p, n) for each in (a, b) for p, n in each.factors if constant(p) != 1]
    result = a.polynomial * b.polynomial
    is_sum = any(len(p.terms) > 1 for p, _ in factors)
    return Expression(result, a.definitions, factors if is_sum else ())


def _inverse(a: Expression) -> Expression:
    parts = [a.definitions.power(p, number(-n)) for p, n in a.factors if n]
    return Expression(product(parts), a.definitions, [(p, -n) for p, n in a.factors])


def _quotient(a: Expression, b: Expression) -> Expression:
    return _product(a, _inverse(b))


def _power(base: Expression, power: Expression) -> Expression:
    p, exponent = base.polynomial, power.polynomial
    r, definitions = constant(exponent), base.definitions
    if r is None and any(i >= 0 for indices in exponent.terms for i in indices):
        return _exp(_product(power, _log(base)))  # the exponent depends on the state
    if r is not None and r.denominator == 1 and abs(r) < 100:
        n = int(r)
        if n < 0:
            return _power(_inverse(base), Expression(number(-n), definitions))
        factors = [(q, k * n) for q, k in base.factors]
        return Expression(math.prod([p] * n, start=ONE), definitions, factors if n else ())
    if r is not None and (value := constant(p)) is not None:
        return Expression(number(_of_numbers("power", value, r)), definitions)
    [(q, count), *others] = base.factors
    factors = [(p, r)] if r is not None and q is p and count == 1 and not others else []
    return Expression(definitions.power(p, exponent), definitions, factors)


def _of_numbers(name: str, *values: Fraction) -> Fraction:
    floats = [*map(float, values)]
    with np.errstate(all="ignore"):
        result = float(getattr(np, name)(*floats))
    if not math.isfinite(result):
        raise ValueError(f"{name}({', '.join(map(str, floats))}) has no finite value")
    return Fraction(result)


def _function(name: str, *partners: str) -> Callable[[Expression], Expression]:
    """Return the rule of a function, which adds a variable, and others after it."""

    def rule(a: Expression) -> Expression:
        p, definitions = a.polynomial, a.definitions
        if (value := constant(p)) is not None:
            return Expression(number(_of_numbers(name, value)), definitions)
        variables = {each: definitions.added(each, p) for each in sorted({name, *partners})[::-1]}
        return Expression(variables[name], definitions)

    return rule


_exp, _log, _sin = _function("exp"), _function("log"), _function("sin", "cos")


def _times(c: float, rule: Callable[[Expression], Expression]) -> Callable[..., Expression]:
    """Return a rule times a number."""
    return lambda a: _product(Expression(number(c), a.definitions), rule(a))


def _plus(a: Expression, c: int) -> Expression:
    return Expression(a.polynomial + number(c), a.definitions)


def _root(a: Expression) -> Expression:
    return _power(a, Expression(number(HALF), a.definitions))


_LOG2 = math.log(2.0)
RULES: dict[str, Callable[..., Expression]] = {
    "positive": lambda a: a,
    "negative": lambda a: _product(Expression(number(-1), a.definitions), a),
    "add": _sum(1),
    "subtract": _sum(-1),
    "multiply": _product,
    "divide": _quotient,
    "true_divide": _quotient,
    "power": _power,
    "float_power": _power,
    "square": lambda a: _product(a, a),
    "reciprocal": _inverse,
    "sqrt": _root,
    "cbrt": _function("cbrt"),
    "hypot": lambda a, b: _root(_sum(1)(_product(a, a), _product(b, b))),
    "exp": _exp,
    "exp2": lambda a: _exp(_product(Expression(number(_LOG2), a.definitions), a)),
    "expm1": lambda a: _plus(_exp(a), -1),
    "log": _log,
    "log2": _times(1 / _LOG2, _log),
    "log10": _times(math.log10(math.e), _log),
    "log1p": lambda a: _log(_plus(a, 1)),
    "sin": _sin,
    "cos": _function("cos", "sin"),
    "tan": _function("tan"),
    "sinh": _function("sinh", "cosh"),
    "cosh": _function("cosh", "sinh"),
    "tanh": _function("tanh"),
    "arctan": _function("arctan"),
}
# The functions of NumPy that have a rule.
FUNCTIONS = [
    name
    for name in RULES
    if name
    not in ("positive negative add subtract multiply divide true_divide float_power".split())
]
