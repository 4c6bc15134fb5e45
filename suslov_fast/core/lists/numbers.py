"""Numbers of a list of operations, written with Python's operators."""


class Number:
    """A value of a list, or a constant: +, -, *, /, comparisons; & | ^ of truth values."""

    __slots__ = ("operand", "values")

    def __init__(self, values, operand):
        self.values, self.operand = values, operand

    def _emit(self, instruction, *others):
        operands = (a.operand if isinstance(a, Number) else float(a) for a in others)
        return Number(self.values, self.values.emit(instruction, *operands))

    def __neg__(self):
        return self._emit("fmul", -1.0, self)

    def __abs__(self):
        return self._emit("fabs", self)

    def sqrt(self):
        """The square root."""
        return self._emit("sqrt", self)

    def equals(self, other):
        """Whether two numbers are equal."""
        return self._emit("oeq", self, other)

    def __le__(self, other):
        return self._emit("oge", other, self)

    def chosen(self, a, b):
        """`a` where this truth value is true, else `b`."""
        return self._emit("select", self, a, b)


def _operator(instruction, is_reflected=False):
    def method(self, other):
        return self._emit(instruction, *((other, self) if is_reflected else (self, other)))

    return method


for _name, _instruction in (("add", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv")):
    setattr(Number, f"__{_name}__", _operator(_instruction))
    setattr(Number, f"__r{_name}__", _operator(_instruction, True))
for _name, _instruction in (
    ("lt", "olt"), ("gt", "ogt"), ("ge", "oge"), ("and", "and"), ("or", "or"), ("xor", "xor"),
):  # fmt: skip
    setattr(Number, f"__{_name}__", _operator(_instruction))


def larger(a, b):
    """Return the larger of two numbers; `b` where one of them is NaN."""
    return (a if isinstance(a, Number) else b)._emit("max", a, b)


def smaller(a, b):
    """Return the smaller of two numbers; `b` where one of them is NaN."""
    return (a if isinstance(a, Number) else b)._emit("min", a, b)
