"""The tracer: the symbols with which a function is called, and the list of its operations."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from numbers import Rational
from typing import Any

import numpy as np

from ..checks import OF_SYMBOLS, short
from ..core.expressions.function_records import FUNCTIONS, OTHER_NAMES, interp
from ..core.expressions.numpy_evaluation import OF_TRUTH_VALUES
from ..core.expressions.programs import Expressions
from .complex_symbols import Complex, of_complex, parts_of_number
from .equation_text import brief
from .layout import Layout, layout_of
from .symbols import NotReal, Symbol, Symbols, Untraceable, applied, interpolated

_OF_EARLIER = "f keeps symbols of an earlier call: compute all from x"
_EXTREMES = "maximum minimum clip".split()
_ARITHMETIC = "add subtract multiply divide power remainder floor_divide".split()


class Tracer:
    """The symbols with which a function is called, and the list of its operations."""

    def __init__(
        self, layout: Layout, parameters: Sequence[str], has_products: bool = False
    ) -> None:
        self.layout, self.has_products = layout, has_products
        self.names = (*layout.components, *parameters)
        self.D, count = layout.D, len(self.names)
        self.values = Expressions(count, range(self.D, count))
        self.real_parameters = {name: Symbol(self, i) for i, name in enumerate(parameters, self.D)}
        self.parameters: dict[str, Any] = {}
        if parameters:
            of = layout_of(tuple(parameters))
            values = of.joined([*self.real_parameters.values()], Complex.of)
            self.parameters = dict(zip(of.names, values, strict=True))
        self.squares: dict[int, Any] = {}  # {operand of a modulus: operand of its square}
        self.ratios: dict[float, Fraction] = {}  # {nearest float: fraction that is no float}
        self.other = ""  # why symbols of this tracer cannot be used beside those of others
        self.decide: Callable[[Symbol], bool] | None = None  # see `branching`

    @property
    def state(self) -> Symbols:
        """The symbols of the variables; not stored, as garbage collection misses such arrays."""
        parts = [Symbol(self, i) for i in range(self.layout.size)]
        has_pairs = self.layout.has_pairs
        return Symbols.of(self.layout.joined(parts, Complex.of) if has_pairs else parts)

    @property
    def time(self) -> Symbol:
        """The symbol of the hidden time; if there is none, a symbol that cannot be used."""
        if self.layout.clock is not None:
            return Symbol(self, self.layout.clock)
        alone = Tracer(layout_of((), True), ())
        alone.other = "f of this system takes no time, which this function reads"
        return alone.time

    @property
    def known(self) -> dict[str, Symbol]:
        """The symbols by name, for texts: of complex variables z, also z.real and z.imag."""
        real = {name: Symbol(self, i) for i, name in enumerate(self.names)}
        return real | dict(zip(self.layout.names, self.state, strict=True)) | self.parameters

    def is_truth(self, operand: Any) -> bool:
        """Return True if an operand is a truth value of the list."""
        of: Mapping[Any, Any] = self.values.of
        return bool(type(operand) is int and of.get(operand, ("",))[0] in OF_TRUTH_VALUES)

    def operand(self, value: Any) -> Any:
        """Return the operand of a symbol or a number; True and False stay as they are."""
        if isinstance(value, Symbol):
            if value.tracer is not self:
                raise Untraceable(self.other or value.tracer.other or _OF_EARLIER)
            return value.operand
        if isinstance(value, (bool, np.bool_)):
            return bool(value)
        operand = constant(value)
        if isinstance(value, Rational) and value != operand:
            self.ratios[operand] = Fraction(value)
        return operand

    def number(self, value: Any) -> Any:
        """Return the operand of a number; a truth value is 0 or 1."""
        if type(value) is float:
            return value
        operand = self.operand(value)
        if isinstance(operand, bool):
            return float(operand)
        if self.is_truth(operand):
            return self.values.emit("select", operand, 1.0, 0.0)
        return operand

    def truth(self, value: Any) -> Any:
        """Return the operand of a truth value; a number is true unless it is 0."""
        operand = self.operand(value)
        if self.is_truth(operand):
            return operand
        if isinstance(operand, (bool, float)):
            return self.values.emit("oeq", 1.0 if operand else 0.0, 1.0)
        return (~self.values.number(operand).equals(0.0)).number

    def text(self, operand: Any) -> str:
        """Return the formula of an operand, for messages."""
        return brief(self.values, operand, self.names)

    def applied(self, name: str, operands: Sequence[Any], *tables: Any) -> Any:
        """Return the symbol of a function of operands; remember the function for texts."""
        if name in _ARITHMETIC and float in map(type, operands):
            _check_arithmetic(name, operands)
        if name in _EXTREMES and any(type(a) is float and math.isnan(a) for a in operands):
            raise Untraceable(f"a constant in {name} is NaN, and must be a number")
        if name == "power" and type(operands[0]) is int and operands[0] in self.squares:
            half = operands[1] / 2.0 if isinstance(operands[1], float) else 0.5
            if half.is_integer():
                return self.applied(name, [self.squares[operands[0]], half])
        rule: Any = interp if name == "interp" else FUNCTIONS[name].rule
        count = self.values.count
        result = rule(self.values, *operands, *tables)
        if not isinstance(result, float) and result >= count:
            self.values.written.setdefault(result, (name, tuple(operands), *tables))
        return Symbol(self, result)

    def result(self, value: Any) -> Any:
        """Return the operand of a component of f, or of H."""
        operand = self.number(value)
        if isinstance(operand, float) and not math.isfinite(operand):
            raise Untraceable(f"a component is {operand}, not a finite number or a formula")
        return operand

    def complex_of(self, real: Any, imag: Any) -> Complex:
        """Return the complex symbol with these parts."""
        return Complex(self, real, imag)

    def of_complex(self, name: str, values: Sequence[Any]) -> Any:
        """Return the value of a function of numbers, of which some are complex."""
        return of_complex(self, name, values)


def _check_arithmetic(name: str, operands: Sequence[Any]) -> None:
    """Raise an error for NaN, and for infinity unless it is a divisor: x would have no effect."""
    for k, a in enumerate(operands):
        is_limit = name == "divide" and k == 1 and a in (math.inf, -math.inf)
        if isinstance(a, float) and not math.isfinite(a) and not is_limit:
            sign = FUNCTIONS[name].sign
            raise Untraceable(f"a constant beside {sign} is {a}, and must be a finite number")


def constant(value: Any) -> float:
    """Return a real number as a float."""
    if type(value) is float:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, (complex, np.complexfloating)):
        raise NotReal(f"{value} is complex, where a real number is wanted")
    if hasattr(value, "free_symbols") and value.free_symbols:
        raise Untraceable(f"{short(value)} is an expression of SymPy: {OF_SYMBOLS}")
    is_number = isinstance(value, np.number) or hasattr(value, "as_integer_ratio")
    if not is_number and not hasattr(value, "free_symbols"):
        raise Untraceable(f"a number is wanted, not {short(value)}")
    try:
        return float(value)
    except OverflowError:
        raise Untraceable(f"{short(value)} is beyond the range of float64") from None


def called_by_name(name: str, arguments: Sequence[Any]) -> Any:
    """Return the value of a function in the text of an equation."""
    if name == "interp":
        return interpolated(*arguments)
    function = OTHER_NAMES.get(name, name)
    record = FUNCTIONS.get(function)
    if record is None or record.sign or len(arguments) != record.operands:
        raise ValueError(f"equations: there is no function {name} of {len(arguments)}")
    if any(isinstance(a, tuple) for a in arguments):
        raise ValueError(f"equations: {name} takes numbers")
    with np.errstate(all="ignore"):
        value = applied(function, *arguments)
    return value if isinstance(value, (Symbol, np.ndarray)) else float(value)


def components(tracer: Tracer, layout: Layout, values: Any, of_time: Any) -> list[Any]:
    """Return the operands of components, for values of variables and of the hidden time."""
    parts = layout.split(values, parts_of_number)
    return [*map(tracer.result, layout.completed(parts, of_time))]
