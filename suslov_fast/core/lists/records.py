"""The functions of right-hand sides: one record for each.

A list names the function by its instruction, which `operations` carries out in NumPy, and
`machine_code` in lanes. The derivative is a list, too.
"""

from collections.abc import Callable
from typing import NamedTuple


class Function(NamedTuple):
    """A function of numbers that f may contain.

    name        NumPy's name for it
    instruction its name in lists
    derivative  takes `emit`, the operands, and the number of the value; returns the operands that
                are the partial derivatives, one for each operand
    is_0_at_0   whether it is 0 at 0, and smooth there
    """

    name: str
    instruction: str
    derivative: Callable
    is_0_at_0: bool = False


_ALL = [
    Function("exp", "exp", lambda emit, a, y: (y,)),
    Function("log", "log", lambda emit, a, y: (emit("fdiv", 1.0, a),)),
    Function("sqrt", "sqrt", lambda emit, a, y: (emit("fdiv", 0.5, y),)),
    Function("sin", "sin", lambda emit, a, y: (emit("cos", a),), is_0_at_0=True),
    Function("cos", "cos", lambda emit, a, y: (emit("fmul", -1.0, emit("sin", a)),)),
]
RECORDS = {record.instruction: record for record in _ALL}
