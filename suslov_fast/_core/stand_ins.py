"""Stand-ins for numbers, vectors and arrays: what is done to them is written down for LLVM.

Code that is gone through with them, once, is compiled. So Numba need not read, type and compile it,
which takes most of the time of a first use.

Numbers are doubles, integers of 64 bits, and conditions, or vectors of them. Beside a double the
others are made doubles; an integer and a condition do not go together. What LLVM would take in
another sense than Python, or than NumPy, is an error as soon as it is done to a stand-in.
"""

import math
from functools import partial

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, builtin_registry, signature
from numba.extending import lower_builtin

# Doubles in the widest registers; the compiler splits them where registers are narrower.
VECTOR = 8
DOUBLE, INTEGER, CONDITION = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
_KINDS = {np.int64: INTEGER, np.float64: DOUBLE}
# What Numba gives and takes: numbers, and what arrays hold.
_NUMBERS = {types.float64: DOUBLE, types.intp: INTEGER, types.boolean: CONDITION}
_OF_LLVM = {kind: of for of, kind in _NUMBERS.items()}
_ELEMENTS = {types.float64: DOUBLE, types.int64: INTEGER, types.int8: ir.IntType(8)}


def spread(builder, value, size=VECTOR):
    """A vector as it is, a number in all lanes."""
    if isinstance(value.type, ir.VectorType):
        return value
    kind, index = ir.VectorType(value.type, size), ir.IntType(32)
    if isinstance(value, ir.Constant):
        return ir.Constant(kind, [value.constant] * size)
    vector = builder.insert_element(kind(ir.Undefined), value, index(0))
    return builder.shuffle_vector(vector, vector, ir.VectorType(index, size)(None))


def _alike(builder, *values):
    """Numbers as vectors, if others are."""
    sizes = {value.type.count for value in values if isinstance(value.type, ir.VectorType)}
    return [spread(builder, value, *sizes) for value in values] if sizes else values


def _element(kind):
    return kind.element if isinstance(kind, ir.VectorType) else kind


def _with_elements(element, kind):
    """A number, or a vector of as many, of another type."""
    return ir.VectorType(element, kind.count) if isinstance(kind, ir.VectorType) else element


def emitted(builder, value):
    """A number of Python as one that is compiled."""
    if isinstance(value, Emitted):
        return value
    if isinstance(value, (bool, np.bool_)):
        return Emitted(builder, ir.Constant(CONDITION, bool(value)))
    if isinstance(value, float):
        return Emitted(builder, ir.Constant(DOUBLE, value))
    if not isinstance(value, (int, np.int64)):
        raise TypeError(f"{value!r} is not a number")
    if not -(2**63) <= value < 2**63:
        raise OverflowError(f"{value} has more than 64 bits")
    return Emitted(builder, ir.Constant(INTEGER, int(value)))


def as_double(builder, value):
    """An integer, or a condition, as a number, and numbers as they are."""
    element = _element(value.type)
    if element == DOUBLE:
        return value
    convert = builder.uitofp if element == CONDITION else builder.sitofp
    return convert(value, _with_elements(DOUBLE, value.type))


def _require(element, *values):
    """What LLVM would refuse later, without a line of the source, or take in another sense."""
    for value in values:
        if _element(value.type) != element:
            raise TypeError(f"of type {value.type}, where {element} is needed")


def _binary(of_doubles=None, of_integers=None, of_conditions=None, reverse=False):
    emits = {DOUBLE: of_doubles, INTEGER: of_integers, CONDITION: of_conditions}

    def operate(self, other):
        a, b = self.beside(other)
        emit = emits[_element(a.type)]
        if emit is None:
            raise TypeError(f"no such operation is compiled for {a.type}")
        return Emitted(self.builder, emit(self.builder, *((b, a) if reverse else (a, b))))

    return operate


def _shift(emit):
    def operate(self, bits):
        # Of other distances LLVM may make anything.
        if not (isinstance(bits, int) and 0 <= bits < INTEGER.width):
            raise TypeError(f"a shift by {bits}")
        _require(INTEGER, self.value)
        return Emitted(self.builder, emit(self.builder, *self.beside(bits)))

    return operate


def _comparison(how):
    def operate(self, other):
        a, b = self.beside(other)
        if _element(a.type) != DOUBLE:
            if how not in ("==", "!="):
                _require(INTEGER, a)  # the sign of a condition is its only bit
            emit = self.builder.icmp_signed
        else:
            emit = self.builder.fcmp_unordered if how == "!=" else self.builder.fcmp_ordered
        return Emitted(self.builder, emit(how, a, b))

    return operate


def _is_power_of_two(value):
    return isinstance(value, int) and value > 0 and value & (value - 1) == 0


# What NumPy and LLVM round alike.
_EXACT = {"sqrt", "floor", "ceil", "copysign"}


class Emitted:
    """A number, an integer, a condition, or a vector of them, in code that is compiled."""

    __hash__ = None

    def __bool__(self):
        raise TypeError("a condition that is not known: only staged parts branch on one")

    def __init__(self, builder, value):
        self.builder, self.value = builder, value

    def __repr__(self):
        return f"<{self.value.type}>"

    def beside(self, other):
        """The values of this and of another, as of one type."""
        if _element(self.value.type) == DOUBLE and isinstance(other, int):
            other = float(other)
        values = self.value, emitted(self.builder, other).value
        kinds = {_element(each.type) for each in values}
        if DOUBLE in kinds:
            values = [as_double(self.builder, each) for each in values]
        elif len(kinds) > 1:
            raise TypeError("a condition beside an integer")
        return _alike(self.builder, *values)

    __add__ = __radd__ = _binary(ir.IRBuilder.fadd, ir.IRBuilder.add)
    __sub__ = _binary(ir.IRBuilder.fsub, ir.IRBuilder.sub)
    __rsub__ = _binary(ir.IRBuilder.fsub, ir.IRBuilder.sub, reverse=True)
    __mul__ = __rmul__ = _binary(ir.IRBuilder.fmul, ir.IRBuilder.mul)
    __truediv__ = _binary(ir.IRBuilder.fdiv)
    __rtruediv__ = _binary(ir.IRBuilder.fdiv, reverse=True)
    __lshift__, __rshift__ = map(_shift, (ir.IRBuilder.shl, ir.IRBuilder.ashr))
    __and__ = __rand__ = _binary(None, ir.IRBuilder.and_, ir.IRBuilder.and_)
    __or__ = __ror__ = _binary(None, ir.IRBuilder.or_, ir.IRBuilder.or_)
    __xor__ = _binary(None, ir.IRBuilder.xor)
    __lt__, __le__, __gt__, __ge__ = map(_comparison, ("<", "<=", ">", ">="))
    __eq__, __ne__ = map(_comparison, ("==", "!="))

    def __floordiv__(self, divisor):
        if _is_power_of_two(divisor):
            return self >> (divisor.bit_length() - 1)
        a, b = self._and_divisor(divisor)
        quotient = Emitted(self.builder, self.builder.sdiv(a, b))
        return self._rounded_up(a, b).choose(quotient - 1, quotient)

    def __mod__(self, divisor):
        if _is_power_of_two(divisor):
            return self & (divisor - 1)
        a, b = self._and_divisor(divisor)
        rest = Emitted(self.builder, self.builder.srem(a, b))
        return self._rounded_up(a, b).choose(rest + divisor, rest)

    def _and_divisor(self, divisor):
        """Two integers. What is not asked for is divided too, and a divisor of 0 is an abort."""
        a, b = self.beside(divisor)
        _require(INTEGER, a, b)
        if isinstance(divisor, Emitted):
            is_zero = self.builder.icmp_signed("==", b, b.type(0))
            return a, self.builder.or_(b, self.builder.zext(is_zero, b.type))
        if divisor == 0:
            raise ZeroDivisionError("division by zero")
        return a, b

    def __rfloordiv__(self, number):
        return emitted(self.builder, number) // self

    def __rmod__(self, number):
        return emitted(self.builder, number) % self

    def _rounded_up(self, a, b):
        """Whether a division of integers rounds up, which it does towards zero."""
        rest = Emitted(self.builder, self.builder.srem(a, b))
        return (rest != 0) & ((rest ^ Emitted(self.builder, b)) < 0)

    def copy(self):
        return self

    def __getitem__(self, part):
        """Some lanes."""
        lanes = range(self.value.type.count)[part]
        mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes))
        return Emitted(self.builder, self.builder.shuffle_vector(self.value, self.value, mask))

    def __neg__(self):
        if _element(self.value.type) == DOUBLE:
            return Emitted(self.builder, self.builder.fneg(self.value))
        _require(INTEGER, self.value)
        return Emitted(self.builder, self.builder.neg(self.value))

    def __invert__(self):
        """`not` of conditions."""
        _require(CONDITION, self.value)
        return Emitted(self.builder, self.builder.not_(self.value))

    def __abs__(self):
        return self.call("fabs")

    def __array_ufunc__(self, function, method, *arguments):
        """A function of NumPy, rounded as there."""
        first, *others = (emitted(self.builder, each) for each in arguments)
        if function.__name__ == "isnan":
            return first != first
        if function.__name__ == "isfinite":
            return abs(first) < math.inf
        if method != "__call__" or function.__name__ not in _EXACT:
            raise TypeError(f"numpy.{function.__name__} is not compiled")
        return first.call(function.__name__, *others)

    def call(self, name, *others):
        """What an intrinsic function of LLVM returns."""
        values = _alike(self.builder, self.value, *(each.value for each in others))
        _require(DOUBLE, *values)
        kind = values[0].type
        suffix = f"v{kind.count}f64" if isinstance(kind, ir.VectorType) else "f64"
        declared = self.builder.module.declare_intrinsic(
            f"llvm.{name}.{suffix}", fnty=ir.FunctionType(kind, [kind] * len(values))
        )
        return Emitted(self.builder, self.builder.call(declared, values))

    def view(self, of):
        return self.cast(_KINDS[of])

    def cast(self, element):
        """The same bits as numbers of another type."""
        kind = _with_elements(element, self.value.type)
        return Emitted(self.builder, self.builder.bitcast(self.value, kind))

    def to_integer(self):
        """A number as an integer."""
        if self.value.type == INTEGER:
            return self
        _require(DOUBLE, self.value)
        return Emitted(self.builder, self.builder.fptosi(self.value, INTEGER))

    def to_double(self):
        return Emitted(self.builder, as_double(self.builder, self.value))

    def choose(self, first, second):
        """The first where this condition holds, the second elsewhere; of tuples, one by one."""
        if isinstance(first, tuple):
            return tuple(self.choose(*each) for each in zip(first, second, strict=True))
        _require(CONDITION, self.value)
        first, second = (emitted(self.builder, each).value for each in (first, second))
        _require(_element(first.type), second)  # an integer has no -0
        return Emitted(
            self.builder, self.builder.select(*_alike(self.builder, self.value, first, second))
        )

    def shuffled(self, other, places):
        """The numbers at some places of two vectors."""
        mask = ir.Constant(ir.VectorType(ir.IntType(32), len(places)), places)
        return Emitted(self.builder, self.builder.shuffle_vector(self.value, other.value, mask))

    def any_lane(self):
        bits = ir.IntType(self.value.type.count)
        value = self.builder.bitcast(self.value, bits)
        return Emitted(self.builder, self.builder.icmp_unsigned("!=", value, bits(0)))


class EmittedArray:
    """A C-contiguous array in code that is compiled.

    Slices are of the first axis and lie within it. Lengths may be known, and are compared then.
    """

    # What Python would make of them by itself is not what NumPy does.
    __bool__ = __eq__ = __hash__ = __iter__ = None

    def __init__(self, builder, pointer, shape):
        self.builder, self.pointer, self.shape = builder, pointer, shape

    def __repr__(self):
        return f"{self.pointer.type}{self.shape}"

    @property
    def size(self):
        return math.prod(self.shape)

    @property
    def itemsize(self):
        kind = self.pointer.type.pointee
        return 8 if kind == DOUBLE else kind.width // 8

    @property
    def ctypes(self):
        return self

    @property
    def data(self):
        """The address, as NumPy calls it."""
        return Emitted(self.builder, self.builder.ptrtoint(self.pointer, INTEGER))

    def reshape(self, shape):
        shape = shape if isinstance(shape, tuple) else (shape,)
        known = (each for each in (self.shape, shape) if set(map(type, each)) <= {int})
        negative = any(isinstance(each, int) and each < 0 for each in shape)
        if negative or len(set(map(math.prod, known))) > 1:
            raise ValueError(f"an array of {self.shape} as one of {shape}")
        return EmittedArray(self.builder, self.pointer, shape)

    def view(self, of):
        """The same bits as numbers of another type, which are as long."""
        pointer = self.builder.bitcast(self.pointer, _KINDS[of].as_pointer())
        return EmittedArray(self.builder, pointer, self.shape)

    def copy(self):
        """A vector of all numbers."""
        return Emitted(self.builder, self.builder.load(self.as_vector(self.size), align=8))

    def as_vector(self, size):
        """Where a vector of the first numbers lies."""
        return self.builder.bitcast(self.pointer, ir.VectorType(DOUBLE, size).as_pointer())

    def fill(self, value):
        value = emitted(self.builder, value).value
        if isinstance(value.type, ir.VectorType) or isinstance(self.size, int):
            value = spread(self.builder, as_double(self.builder, value), self.size)
            if isinstance(self.size, int) and self.size != value.type.count:
                raise ValueError(f"{value.type.count} numbers in the place of {self.size}")
            self.builder.store(value, self.as_vector(value.type.count), align=8)
        else:
            flat = self.reshape(self.size)
            for index in loop(self.builder, 0, self.size, 1):
                flat[index] = Emitted(self.builder, value)

    def __getitem__(self, part):
        if isinstance(part, slice):
            if part.step is not None:
                raise IndexError("a slice with a step")
            start = 0 if part.start is None else part.start
            size = None if part.stop is None else part.stop - start
            for each in (start, part.stop, size):
                _within(each, self.shape[0], last=0)
            return EmittedArray(self.builder, self._place((start,)), (size, *self.shape[1:]))
        indices = part if isinstance(part, tuple) else (part,)
        place, shape = self._place(indices), self.shape[len(indices) :]
        if shape:
            return EmittedArray(self.builder, place, shape)
        value = self.builder.load(place)
        if value.type != DOUBLE and value.type != INTEGER:
            value = self.builder.sext(value, INTEGER)
        return Emitted(self.builder, value)

    def __setitem__(self, part, value):
        indices = part if isinstance(part, tuple) else (part,)
        if isinstance(part, slice) or len(indices) < len(self.shape):
            self[part].fill(value)
            return
        place = self._place(indices)
        value, kind = emitted(self.builder, value).value, place.type.pointee
        if kind == DOUBLE:
            value = as_double(self.builder, value)
        elif value.type == CONDITION:
            value = self.builder.zext(value, kind)
        elif value.type != kind:
            _require(INTEGER, value)
            value = self.builder.trunc(value, kind)
        self.builder.store(value, place)

    def _place(self, indices):
        """Where the part with these first indices begins."""
        if len(indices) > len(self.shape):
            raise IndexError(f"{len(indices)} indices of an array of {len(self.shape)} dimensions")
        for each, length in zip(indices, self.shape):  # noqa: B905  (the rest is a row)
            _within(each, length)
        index = indices[0]
        for axis, length in enumerate(self.shape[1:], 1):
            index = index * length + (indices[axis] if axis < len(indices) else 0)
        index = emitted(self.builder, index).value
        _require(INTEGER, index)
        return self.builder.gep(self.pointer, [index])


def _within(index, length, last=-1):
    """Refuse an index that is known to be negative or beyond the last one, length + last."""
    if isinstance(index, int):
        end = length + last if isinstance(length, int) else index
        if not 0 <= index <= end:
            raise IndexError(f"{index} in an array of length {length}")


def values_of(stand_in):
    """The values of LLVM that a number, an array, or a tuple of them stands for."""
    if isinstance(stand_in, Emitted):
        yield stand_in.value
    elif isinstance(stand_in, EmittedArray):
        yield stand_in.pointer
        yield from values_of(stand_in.shape)
    elif isinstance(stand_in, tuple):
        for each in stand_in:
            yield from values_of(each)


def with_values(builder, stand_in, values):
    """The same of other values, in another function."""
    if isinstance(stand_in, Emitted):
        return Emitted(builder, next(values))
    if isinstance(stand_in, EmittedArray):
        pointer = next(values)
        return EmittedArray(builder, pointer, with_values(builder, stand_in.shape, values))
    if isinstance(stand_in, tuple):
        parts = [with_values(builder, each, values) for each in stand_in]
        return type(stand_in)(*parts) if hasattr(stand_in, "_fields") else tuple(parts)
    return stand_in


def loop(builder, start, stop, step):
    """`range` in code that is compiled: goes once through what is done with the index it yields.

    A step that is not known beforehand is positive.
    """
    before = "<" if isinstance(step, Emitted) or step > 0 else ">"
    if not isinstance(step, Emitted) and step == 0:
        raise ValueError("a range with a step of 0")
    start, stop, step = (emitted(builder, each).value for each in (start, stop, step))
    _require(INTEGER, start, stop, step)
    entry = builder.block
    test, body, after = (builder.append_basic_block() for _ in range(3))
    builder.branch(test)
    builder.position_at_end(test)
    index = builder.phi(INTEGER)
    index.add_incoming(start, entry)
    builder.cbranch(builder.icmp_signed(before, index, stop), body, after)
    builder.position_at_end(body)
    yield Emitted(builder, index)
    index.add_incoming(builder.add(index, step, flags=("nsw",)), builder.block)
    builder.branch(test)
    builder.position_at_end(after)


# How calls are compiled of functions that do more than can be seen from their arguments.
EMITTERS = {}


def emits(function):
    """Compile calls of a function in staged parts by the decorated one, given a builder too."""

    def decorate(emit):
        EMITTERS[function] = emit
        return emit

    return decorate


def compiled_by(function, emit, returns):
    """Let Numba compile a call of a function by `emit(builder, *stand_ins)`, which returns others.

    Arguments are numbers, arrays, and tuples of them; results are numbers, and tuples of them.

    returns   tells whether there are any.
    """
    signatures = {}

    class _Called(AbstractTemplate):
        key = function

        def generic(self, arguments, named):
            accepts = tuple(map(_accepted, arguments))
            if None in accepts or named:
                return None
            if accepts not in signatures:
                result = _returned(emit, accepts) if returns() else types.void
                signatures[accepts] = signature(result, *accepts)
            return signatures[accepts]

    builtin_registry.register_global(function, types.Function(_Called))

    @lower_builtin(function, types.VarArg(types.Any))
    def _generate(context, builder, signature, arguments):
        given = [
            _stand_in(context, builder, kind, value)
            for kind, value in zip(signature.args, arguments, strict=True)
        ]
        result = emit(builder, *given)
        if signature.return_type == types.void:
            return context.get_dummy_value()
        if not isinstance(result, tuple):
            return emitted(builder, result).value
        values = [emitted(builder, each).value for each in result]
        return context.make_tuple(builder, signature.return_type, values)


def _returned(emit, accepts):
    """The type of what is returned, by a trial."""
    tried = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), ()), "tried")
    builder = ir.IRBuilder(tried.append_basic_block())
    result = emit(builder, *(_on_trial(builder, kind) for kind in accepts))
    if not isinstance(result, tuple):
        return _OF_LLVM[emitted(builder, result).value.type]
    return types.Tuple([_OF_LLVM[emitted(builder, each).value.type] for each in result])


def _accepted(kind):
    """The type that an argument is taken as, or None where it is not."""
    if isinstance(kind, types.Array):
        return kind if kind.layout == "C" and kind.dtype in _ELEMENTS else None
    if isinstance(kind, types.BaseTuple):
        # Numba would not convert what is in it.
        return kind if all(_accepted(each) == types.unliteral(each) for each in kind) else None
    if kind == types.none:
        return kind
    if isinstance(kind, types.Boolean):
        return types.boolean
    if isinstance(kind, types.Integer):
        return types.intp
    return types.float64 if isinstance(kind, types.Float) else None


def _stand_in(context, builder, kind, value):
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        lengths = (Emitted(builder, each) for each in cgutils.unpack_tuple(builder, array.shape))
        return EmittedArray(builder, array.data, tuple(lengths))
    if isinstance(kind, types.BaseTuple):
        values = cgutils.unpack_tuple(builder, value, len(kind))
        return tuple(map(partial(_stand_in, context, builder), kind, values))
    return None if kind == types.none else Emitted(builder, value)


def _on_trial(builder, kind):
    if isinstance(kind, types.Array):
        length = Emitted(builder, builder.load(builder.alloca(INTEGER)))
        return EmittedArray(builder, builder.alloca(_ELEMENTS[kind.dtype]), (length,) * kind.ndim)
    if isinstance(kind, types.BaseTuple):
        return tuple(_on_trial(builder, each) for each in kind)
    if kind == types.none:
        return None
    return Emitted(builder, builder.load(builder.alloca(_NUMBERS[kind])))
