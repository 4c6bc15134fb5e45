"""The functions of right-hand sides: one record for each.

A list names a function by its instruction, which `lists.step` carries out in NumPy, and
`code.compiler` in lanes; its derivative is a list, too. Other functions are made of these. From the
records follow what a function of a user may call, how its equations are written and read, and what
the pages say.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from .tables import of_line


class Function(NamedTuple):
    """A function of numbers that f may contain.

    name        NumPy's name for it, which is also its name in equations
    operands    their number
    rule        takes `values` and operands; returns the operand that is the value
    instruction its name in lists; "" if it is made of others
    derivative  takes `emit`, the operands, and the number of the value; returns the operands that
                are the partial derivatives, one for each operand
    is_0_at_0   whether it is 0 at 0, and smooth there
    sign        its sign in equations
    """

    name: str
    operands: int
    rule: Callable
    instruction: str = ""
    derivative: Callable | None = None
    is_0_at_0: bool = False
    sign: str = ""


def _instruction(name):
    def rule(values, *operands):
        return values.emit(name, *operands)

    return rule


def _of_1(name, instruction, derivative, is_0_at_0=False):
    """Return the record of a function of one number that a list names."""
    return Function(name, 1, _instruction(instruction), instruction, derivative, is_0_at_0)


def _of_2(name, instruction, derivative):
    return Function(name, 2, _instruction(instruction), instruction, derivative)


def _inverse(emit, a):
    return emit("fdiv", 1.0, a)


def _minus(emit, a):
    return emit("fmul", -1.0, a)


def _square(emit, a):
    return emit("fmul", a, a)


def _root_of_product(emit, a, b):
    """Return 1 / (sqrt(a) sqrt(b)), whose digits do not go where a is near 0."""
    return (_inverse(emit, emit("fmul", emit("sqrt", a), emit("sqrt", b))),)


def _of_angle(emit, y, x):
    """Return the derivatives of arctan2(y, x)."""
    square = emit("fadd", _square(emit, x), _square(emit, y))
    return emit("fdiv", x, square), _minus(emit, emit("fdiv", y, square))


def _of_power(emit, a, b, y):
    """Return the derivatives of a**b by a and b, which are 0 for b = 0 and for a = 0."""
    lower = emit("fmul", b, emit("pow", a, emit("fsub", b, 1.0)))
    by_base = emit("select", emit("oeq", b, 0.0), 0.0, lower)
    by_exponent = emit("select", emit("oeq", a, 0.0), 0.0, emit("fmul", y, emit("log", a)))
    return by_base, by_exponent


def _of_hypot(emit, a, b, y):
    """Return a / y and b / y, 0 at 0."""
    is_0 = emit("oeq", y, 0.0)
    return tuple(emit("select", is_0, 0.0, emit("fdiv", each, y)) for each in (a, b))


def _of_logaddexp(emit, a, b, y):
    """Return the shares of exp(a) and exp(b) in their sum, also where both are infinite."""
    way = emit("select", emit("oeq", a, b), 0.0, emit("fsub", a, b))
    return emit("expit", way), emit("expit", _minus(emit, way))


def _of_expit(emit, a, y):
    """Return y (1 - y), where 1 - y is the value at -a, with all digits."""
    return (emit("fmul", y, emit("expit", _minus(emit, a))),)


def _of_erf(emit, a, y):
    return (emit("fmul", 2.0 / math.sqrt(math.pi), emit("exp", _minus(emit, _square(emit, a)))),)


def _of_tanh(emit, a, y):
    """Return 1 / cosh(a)**2, which has more digits than 1 - y**2."""
    return (emit("fdiv", _inverse(emit, emit("cosh", a)), emit("cosh", a)),)


_OF_LISTS = [
    _of_1("exp", "exp", lambda emit, a, y: (y,)),
    _of_1("exp2", "exp2", lambda emit, a, y: (emit("fmul", math.log(2.0), y),)),
    _of_1("expm1", "expm1", lambda emit, a, y: (emit("exp", a),), True),
    _of_1("log", "log", lambda emit, a, y: (_inverse(emit, a),)),
    _of_1("log2", "log2", lambda emit, a, y: (emit("fdiv", 1 / math.log(2.0), a),)),
    _of_1("log10", "log10", lambda emit, a, y: (emit("fdiv", 1 / math.log(10.0), a),)),
    _of_1("log1p", "log1p", lambda emit, a, y: (_inverse(emit, emit("fadd", 1.0, a)),), True),
    _of_1("sqrt", "sqrt", lambda emit, a, y: (emit("fdiv", 0.5, y),)),
    _of_1(
        "cbrt",
        "cbrt",
        lambda emit, a, y: (emit("fdiv", _inverse(emit, 3.0), _square(emit, y)),),
    ),
    _of_1("sin", "sin", lambda emit, a, y: (emit("cos", a),), True),
    _of_1("cos", "cos", lambda emit, a, y: (_minus(emit, emit("sin", a)),)),
    _of_1("tan", "tan", lambda emit, a, y: (emit("fadd", 1.0, _square(emit, y)),), True),
    _of_1("sinh", "sinh", lambda emit, a, y: (emit("cosh", a),), True),
    _of_1("cosh", "cosh", lambda emit, a, y: (emit("sinh", a),)),
    _of_1("tanh", "tanh", _of_tanh, True),
    _of_1(
        "arcsin",
        "asin",
        lambda emit, a, y: _root_of_product(emit, emit("fsub", 1.0, a), emit("fadd", 1.0, a)),
        True,
    ),
    _of_1(
        "arccos",
        "acos",
        lambda emit, a, y: (
            _minus(
                emit,
                _root_of_product(emit, emit("fsub", 1.0, a), emit("fadd", 1.0, a))[0],
            ),
        ),
    ),
    _of_1(
        "arctan",
        "atan",
        lambda emit, a, y: (_inverse(emit, emit("fadd", 1.0, _square(emit, a))),),
        True,
    ),
    _of_1("arcsinh", "asinh", lambda emit, a, y: (_inverse(emit, emit("hypot", 1.0, a)),), True),
    _of_1(
        "arccosh",
        "acosh",
        lambda emit, a, y: _root_of_product(emit, emit("fsub", a, 1.0), emit("fadd", a, 1.0)),
    ),
    _of_1(
        "arctanh",
        "atanh",
        lambda emit, a, y: (
            _inverse(emit, emit("fmul", emit("fsub", 1.0, a), emit("fadd", 1.0, a))),
        ),
        True,
    ),
    _of_1("erf", "erf", _of_erf, True),
    _of_1("expit", "expit", _of_expit),
    _of_1("floor", "floor", lambda emit, a, y: (0.0,)),
    _of_2("arctan2", "atan2", lambda emit, a, b, y: _of_angle(emit, a, b)),
    _of_2("hypot", "hypot", _of_hypot),
    _of_2("logaddexp", "logaddexp", _of_logaddexp),
]
_POWER = _of_2("power", "pow", _of_power)
RECORDS = {record.instruction: record for record in [*_OF_LISTS, _POWER]}


# ------------------------------------------------------------------ functions made of others
def _swapped(name):
    def rule(values, a, b):
        return values.emit(name, b, a)

    return rule


def not_(values, a):
    """Return the opposite of a truth value."""
    return values.emit("xor", a, values.emit("oeq", 0.0, 0.0))


def power(values, a, exponent):
    """Return a**exponent: products and roots where 2 exponent is an integer of at most 64."""
    emit = values.emit
    if isinstance(exponent, float) and 2.0 * exponent in range(-128, 129):
        if exponent < 0.0:
            return _inverse(emit, power(values, a, -exponent))
        whole = int(exponent)
        result = emit("sqrt", a) if exponent != whole else 1.0
        square = a
        while whole:
            if whole & 1:
                result = emit("fmul", square, result)
            whole >>= 1
            square = _square(emit, square) if whole else square
        return result
    return emit("pow", a, exponent)


def _sign(values, a):
    emit = values.emit
    zero = emit("fabs", emit("fmul", 0.0, a))  # or NaN
    below = emit("select", emit("olt", a, 0.0), -1.0, zero)
    return emit("select", emit("ogt", a, 0.0), 1.0, below)


def _heaviside(values, a, middle):
    emit = values.emit
    missing = emit("fmul", 0.0, a)  # NaN where a is
    at_0 = emit("select", emit("oeq", a, 0.0), middle, missing)
    below = emit("select", emit("olt", a, 0.0), 0.0, at_0)
    return emit("select", emit("ogt", a, 0.0), 1.0, below)


def _extreme(name):
    """Return the rule of a minimum or maximum, which is NaN where one of both is."""

    def rule(values, a, b):
        if isinstance(b, float):
            a, b = b, a
        result = values.emit(name, a, b)  # b where one of both is NaN
        if isinstance(a, float):
            return result
        return values.emit("select", values.emit("oeq", a, a), result, a)

    return rule


def _floor_of_quotient(values, a, b):
    return values.emit("floor", values.emit("fdiv", a, b))


def _remainder(values, a, b):
    whole = _floor_of_quotient(values, a, b)
    return values.emit("fsub", a, values.emit("fmul", b, whole))


def _ceil(values, a):
    emit = values.emit
    return _minus(emit, emit("floor", _minus(emit, a)))


def _trunc(values, a):
    is_negative = values.emit("olt", a, 0.0)
    return values.emit("select", is_negative, _ceil(values, a), values.emit("floor", a))


def _times(factor):
    return lambda values, a: values.emit("fmul", factor, a)


def interp(values, x, knots, heights, left, right):
    """Return what np.interp does: of a table with increasing knots, by the same arithmetic."""
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
    """Return whether two operands are the same number of a value, or the same constant."""
    return type(a) is type(b) and (a == b if type(a) is int else repr(a) == repr(b))


def _sum(values, a, b):
    if _is_0(a) or _is_0(b):
        return b if _is_0(a) else a
    return values.emit("fadd", a, b)


def _difference(values, a, b):
    return a if _is_0(b) else values.emit("fsub", a, b)


def _product(values, a, b):
    """Return a b; 0 for a constant 0, such as most entries of a matrix."""
    return 0.0 if _is_0(a) or _is_0(b) else values.emit("fmul", a, b)


def _is_0(a):
    return isinstance(a, float) and a == 0.0


def _clip(values, a, least, most):
    return _extreme("min")(values, _extreme("max")(values, a, least), most)


_MADE = [
    Function("add", 2, _sum, sign="+"),
    Function("subtract", 2, _difference, sign="-"),
    Function("multiply", 2, _product, sign="*"),
    Function("divide", 2, _instruction("fdiv"), sign="/"),
    Function("power", 2, power, sign="**"),
    Function("floor_divide", 2, _floor_of_quotient, sign="//"),
    Function("remainder", 2, _remainder, sign="%"),
    Function("positive", 1, lambda values, a: a),
    Function("negative", 1, _times(-1.0)),
    Function("absolute", 1, _instruction("fabs")),
    Function("deg2rad", 1, _times(math.pi / 180.0)),
    Function("rad2deg", 1, _times(180.0 / math.pi)),
    Function("sign", 1, _sign),
    Function("heaviside", 2, _heaviside),
    Function("minimum", 2, _extreme("min")),
    Function("maximum", 2, _extreme("max")),
    Function("clip", 3, _clip),
    Function("ceil", 1, _ceil),
    Function("trunc", 1, _trunc),
    Function("where", 3, _instruction("select")),
    Function("less", 2, _instruction("olt"), sign="<"),
    Function("greater", 2, _instruction("ogt"), sign=">"),
    Function("less_equal", 2, _swapped("oge"), sign="<="),
    Function("greater_equal", 2, _instruction("oge"), sign=">="),
    Function("equal", 2, _instruction("oeq"), sign="=="),
    Function(
        "not_equal",
        2,
        lambda values, a, b: not_(values, values.emit("oeq", a, b)),
        sign="!=",
    ),
    Function("logical_and", 2, _instruction("and"), sign="&"),
    Function("logical_or", 2, _instruction("or"), sign="|"),
    Function("logical_xor", 2, _instruction("xor"), sign="^"),
    Function("logical_not", 1, not_, sign="~"),
]
FUNCTIONS = {record.name: record for record in [*_OF_LISTS, *_MADE]}
# Other names of NumPy for the same functions.
OTHER_NAMES = {
    "abs": "absolute",
    "fabs": "absolute",
    "true_divide": "divide",
    "float_power": "power",
    "pow": "power",
    "mod": "remainder",
    "radians": "deg2rad",
    "degrees": "rad2deg",
    "conjugate": "positive",
    "bitwise_and": "logical_and",
    "bitwise_or": "logical_or",
    "bitwise_xor": "logical_xor",
    "invert": "logical_not",
    "bitwise_not": "logical_not",
}
