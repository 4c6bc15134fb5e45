"""Values of an expression program, written with Python's operators."""


class Number:
    """A value of a program, or a constant, with Python's operators; & | ^ ~ for truth values.

    `emit` adds an operation to the program and returns the number of its value.
    """

    __slots__ = ("emit", "number")

    def __init__(self, emit, number):
        self.emit, self.number = emit, number

    def then(self, instruction, *others):
        """Return the value of `instruction` on this value and `others`, as a `Number`."""
        return self._of(instruction, self, *others)

    def _of(self, instruction, *operands):
        numbers = [a.number if type(a) is Number else float(a) for a in operands]
        return Number(self.emit, self.emit(instruction, *numbers))

    def __neg__(self):
        return self._of("fmul", -1.0, self)

    def __abs__(self):
        return self.then("fabs")

    def __invert__(self):
        """Return the negated truth value."""
        return self ^ Number(self.emit, 0.0).equals(0.0)

    def __le__(self, other):
        return self._of("oge", other, self)

    def sqrt(self):
        return self.then("sqrt")

    def equals(self, other):
        """Return the truth value that this value equals another value."""
        return self.then("oeq", other)

    def select(self, a, b):
        """Return a where this truth value is true, b elsewhere."""
        return self.then("select", a, b)

    def within(self, least, greatest):
        """Return this value, clipped to the interval from least to greatest; NaN stays NaN."""
        return self._of("min", greatest, self._of("max", least, self))


def _operator(instruction, is_reflected=False):
    def method(self, other):
        other = other.number if type(other) is Number else float(other)
        operands = (other, self.number) if is_reflected else (self.number, other)
        return Number(self.emit, self.emit(instruction, *operands))

    return method


for _name, _instruction in (
    ("add", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv"), ("lt", "olt"),
    ("gt", "ogt"), ("ge", "oge"), ("and", "and"), ("or", "or"), ("xor", "xor"),
):  # fmt: skip
    setattr(Number, f"__{_name}__", _operator(_instruction))
for _name, _instruction in (
    ("add", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv")
):  # fmt: skip
    setattr(Number, f"__r{_name}__", _operator(_instruction, True))


def operand_of(a):
    """Return the operand of a `Number`: the number of its value; or the constant a itself."""
    return a.number if isinstance(a, Number) else a


def larger(a, b):
    """Return the larger of two numbers; `b` if one of them is NaN."""
    return (a if isinstance(a, Number) else b)._of("max", a, b)


def smaller(a, b):
    """Return the smaller of two numbers; `b` if one of them is NaN."""
    return (a if isinstance(a, Number) else b)._of("min", a, b)


def joined(instruction, numbers):
    """Return `numbers` joined by an instruction such as "fadd", in pairs: without long chains."""
    numbers = [*numbers]
    while len(numbers) > 1:
        left = numbers[len(numbers) & ~1 :]
        pairs = zip(numbers[::2], numbers[1::2], strict=False)
        numbers = [a.then(instruction, b) for a, b in pairs] + left
    return numbers[0]
