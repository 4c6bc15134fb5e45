"""The functions that a right-hand side may contain: one record for each.

A function with an `instruction` is an operation of expression programs, which `numpy_evaluation`
and `llvm.text` evaluate. Other functions are made of these. The records determine which functions
users may call, how equations are written and read, and a table of the documentation.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from .tables import of_line
from .tolerances import SMALLEST
from .values import Number, operand_of


class Function(NamedTuple):
    """A function of numbers that f may contain.

    name         NumPy's name for it, which is also its name in equations
    derivative   function of the operands and the value; returns one partial derivative or several
    is_0_at_0    True if it is 0 at 0, and smooth at 0
    instruction  its name in expression programs; "" if it is made of others
    formula      if it is made of others: takes a `Number` for each operand, returns the value
    narrows      True if it makes narrow pulses of waves, as in exp(100 cos(t))
    others       NumPy's other names for it
    """

    name: str
    operands: int
    derivative: Callable | None = None
    is_0_at_0: bool = False
    instruction: str = ""
    formula: Callable | None = None
    sign: str = ""
    narrows: bool = False
    others: str = ""

    def rule(self, values, *operands):
        """Add this function of `operands` to the program `values`; return the result's operand."""
        if self.instruction:
            return values.emit(self.instruction, *operands)
        return operand_of(self.formula(*map(values.number, operands)))

    def partials(self, emit, *operands_and_value):
        """Add partial derivatives by `emit`; return operands. The value is the last argument."""
        found = self.derivative(*[Number(emit, a) for a in operands_and_value])
        return [*map(operand_of, found if isinstance(found, tuple) else (found,))]


def _per_roots(a, b):
    """Return 1 / sqrt(a b); it keeps its digits if a or b is near 0."""
    return 1.0 / (a.sqrt() * b.sqrt())


def _of_angle(y, x, _):
    square = x * x + y * y
    return x / square, -(y / square)


def _of_power(a, b, y):
    """Return dy/da = b a**(b - 1) (0 if b = 0) and dy/db = y log(a) (0 if a = 0) of y = a**b."""
    lower = b * a.then("pow", b - 1.0)
    return b.equals(0.0).select(0.0, lower), a.equals(0.0).select(0.0, y * a.then("log"))


def _of_hypot(a, b, y):
    """Return the derivatives a / y and b / y of y = hypot(a, b), both 0 where y = 0.

    The sum changes y = 0 alone, and is no condition, at which steps would end.
    """
    y = y + SMALLEST
    return a / y, b / y


def _of_logaddexp(a, b, y):
    """Return the derivatives exp(a) / s and exp(b) / s of y = log(s), s = exp(a) + exp(b)."""
    way = a.equals(b).select(0.0, a - b)
    return way.then("expit"), (-way).then("expit")


def _of_erf(a):
    return 2.0 / math.sqrt(math.pi) * (-(a * a)).then("exp")


_OF_LISTS = [
    Function("exp", 1, lambda a, y: y, narrows=True),
    Function("expm1", 1, lambda a, y: a.then("exp"), True, narrows=True),
    Function("log", 1, lambda a, y: 1.0 / a),
    Function("log2", 1, lambda a, y: (1 / math.log(2.0)) / a),
    Function("log10", 1, lambda a, y: (1 / math.log(10.0)) / a),
    Function("log1p", 1, lambda a, y: 1.0 / (1.0 + a), True),
    Function("sqrt", 1, lambda a, y: 0.5 / y),
    Function("cbrt", 1, lambda a, y: (1.0 / 3.0) / (y * y)),
    Function("sin", 1, lambda a, y: a.then("cos"), True),
    Function("cos", 1, lambda a, y: -a.then("sin")),
    Function("tan", 1, lambda a, y: 1.0 + y * y, True),
    Function("sinh", 1, lambda a, y: a.then("cosh"), True),
    Function("cosh", 1, lambda a, y: a.then("sinh")),
    # This form has more digits than 1 - y**2.
    Function("tanh", 1, lambda a, y: (1.0 / a.then("cosh")) / a.then("cosh"), True, narrows=True),
    Function("arcsin", 1, lambda a, y: _per_roots(1.0 - a, 1.0 + a), True, "asin"),
    Function("arccos", 1, lambda a, y: -_per_roots(1.0 - a, 1.0 + a), False, "acos"),
    Function("arctan", 1, lambda a, y: 1.0 / (1.0 + a * a), True, "atan"),
    Function("arcsinh", 1, lambda a, y: 1.0 / a.then("hypot", 1.0), True, "asinh"),
    Function("arccosh", 1, lambda a, y: _per_roots(a - 1.0, 1.0 + a), False, "acosh"),
    Function("arctanh", 1, lambda a, y: 1.0 / ((1.0 - a) * (1.0 + a)), True, "atanh"),
    Function("erf", 1, lambda a, y: _of_erf(a), True, narrows=True),
    Function("erfc", 1, lambda a, y: -_of_erf(a), narrows=True),
    # 1 - y is the value at -a, which has all digits.
    Function("expit", 1, lambda a, y: y * (-a).then("expit"), narrows=True),
    Function("floor", 1, lambda a, y: 0.0),
    Function("arctan2", 2, _of_angle, False, "atan2"),
    Function("hypot", 2, _of_hypot),
    Function("logaddexp", 2, _of_logaddexp, narrows=True),
]
_OF_LISTS = [each._replace(instruction=each.instruction or each.name) for each in _OF_LISTS]
_POWER = Function("power", 2, _of_power, False, "pow")
_SCALE = Function("scale", 2, lambda a, b, y: (0.0, 0.0), False, "scale")
RECORDS = {record.instruction: record for record in [*_OF_LISTS, _POWER, _SCALE]}


# ------------------------------------------------------------------ functions made of others
def _power(a, exponent):
    """Return a**exponent, by products and a root if it is a constant n / 2 with abs(n) <= 128."""
    number = exponent.number
    if not (isinstance(number, float) and 2.0 * number in range(-128, 129)):
        return a.then("pow", exponent)
    if number < 0.0:
        return 1.0 / _power(a, Number(a.emit, -number))
    whole = int(number)
    result = a.sqrt() if number != whole else 1.0
    square = a
    while whole:
        if whole & 1:
            result = square * result
        whole >>= 1
        square = square * square if whole else square
    return result


def _extreme(name):
    """Return a function of two `Number`s: their "min" or "max" (`name`), or NaN if one is NaN."""

    def formula(a, b):
        if isinstance(b.number, float):
            a, b = b, a
        result = a.then(name, b)  # this is b if a or b is NaN
        return result if isinstance(a.number, float) else a.equals(a).select(result, a)

    return formula


_minimum, _maximum = _extreme("min"), _extreme("max")


def _sign(a):
    zero = abs(0.0 * a)  # NaN if a is NaN
    return (a > 0.0).select(1.0, (a < 0.0).select(-1.0, zero))


def _heaviside(a, middle):
    at_0 = a.equals(0.0).select(middle, 0.0 * a)  # NaN if a is NaN
    return (a > 0.0).select(1.0, (a < 0.0).select(0.0, at_0))


def _ceil(a):
    return -(-a).then("floor")


def interp(values, x, knots, heights, left, right):
    """Add np.interp(x, knots, heights, left, right) to `values`, same bits; return its operand."""
    emit = values.emit
    result = emit(of_line(knots, heights), x)
    for truth, knot, end, beyond in (
        ("ogt", knots[-1], heights[-1], right),
        ("olt", knots[0], heights[0], left),
    ):
        if not same(end, beyond):
            result = emit("select", emit(truth, x, knot), beyond, result)
    return result


def same(a, b):
    """Return True if two operands are the same value, or the same constant."""
    return type(a) is type(b) and (a == b if type(a) is int else repr(a) == repr(b))


def _is_0(a):
    return isinstance(a.number, float) and a.number == 0.0


def _sum(a, b):
    return b if _is_0(a) else a if _is_0(b) else a + b


def _product(a, b):
    """Return a b; 0 if either is the constant 0, as most entries of a matrix are."""
    return Number(a.emit, 0.0) if _is_0(a) or _is_0(b) else a * b


def _quotient(a, b, c, d):
    """Return the real part of (a + i b) / (c + i d).

    A power of 2, on which the value does not depend, keeps c**2 + d**2 in range.
    """
    scale = c.then("scale", d)
    c, d = c * scale, d * scale
    inverse = scale / (c * c + d * d)
    return _sum(_product(a, c * inverse), _product(b, d * inverse))


_MADE = [
    Function("add", 2, formula=_sum, sign="+"),
    Function("subtract", 2, formula=lambda a, b: a if _is_0(b) else a - b, sign="-"),
    Function("multiply", 2, formula=_product, sign="*"),
    Function("divide", 2, instruction="fdiv", sign="/", others="true_divide"),
    Function("power", 2, formula=_power, sign="**", others="float_power pow"),
    Function("quotient", 4, formula=_quotient),
    Function("exp2", 1, formula=lambda a: Number(a.emit, 2.0).then("pow", a)),
    Function("floor_divide", 2, formula=lambda a, b: (a / b).then("floor"), sign="//"),
    Function(
        "remainder", 2, formula=lambda a, b: a - b * (a / b).then("floor"), sign="%", others="mod"
    ),
    Function("positive", 1, formula=lambda a: a, others="conjugate"),
    Function("negative", 1, formula=lambda a: -a),
    Function("absolute", 1, instruction="fabs", others="abs fabs"),
    Function("deg2rad", 1, formula=lambda a: math.pi / 180.0 * a, others="radians"),
    Function("rad2deg", 1, formula=lambda a: 180.0 / math.pi * a, others="degrees"),
    Function("sign", 1, formula=_sign),
    Function("heaviside", 2, formula=_heaviside),
    Function("minimum", 2, formula=_minimum),
    Function("maximum", 2, formula=_maximum),
    Function("clip", 3, formula=lambda a, least, most: _minimum(_maximum(a, least), most)),
    Function("ceil", 1, formula=_ceil),
    Function("trunc", 1, formula=lambda a: (a < 0.0).select(_ceil(a), a.then("floor"))),
    Function("where", 3, instruction="select"),
    Function("less", 2, instruction="olt", sign="<"),
    Function("greater", 2, instruction="ogt", sign=">"),
    Function("less_equal", 2, formula=lambda a, b: b >= a, sign="<="),
    Function("greater_equal", 2, instruction="oge", sign=">="),
    Function("equal", 2, instruction="oeq", sign="=="),
    Function("not_equal", 2, formula=lambda a, b: ~a.equals(b), sign="!="),
    Function("logical_and", 2, instruction="and", sign="&", others="bitwise_and"),
    Function("logical_or", 2, instruction="or", sign="|", others="bitwise_or"),
    Function("logical_xor", 2, instruction="xor", sign="^", others="bitwise_xor"),
    Function("logical_not", 1, formula=lambda a: ~a, sign="~", others="invert bitwise_not"),
]
FUNCTIONS = {record.name: record for record in [*_OF_LISTS, *_MADE]}
OTHER_NAMES = {other: name for name, record in FUNCTIONS.items() for other in record.others.split()}
