"""Formulas without branches, of numbers or of vectors of them, compiled by being called.

A formula made `lanewise` is no function of its own where it is compiled: it is called, once, on
stand-ins for its arguments, and what is done to them is written down where it is used. So Numba
need not read, type, compile and inline it and all that it calls, which takes most of the time of a
first use; and what it works on stays in registers. What it calls needs no mark. Its conditions are
those of `select`, its largest and smallest numbers those of `larger` and `smaller`; loops over
what is known beforehand are written out. Interpreted, vectors are NumPy arrays.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.typing.templates import AbstractTemplate, builtin_registry, signature
from numba.extending import lower_builtin, models, register_model

# Doubles in the widest registers; the compiler splits them where registers are narrower.
VECTOR = 8


def select(conditions, first, second):
    """The first where a condition holds, the second elsewhere."""
    if isinstance(conditions, Emitted):
        return conditions.choose(first, second)
    return np.where(conditions, first, second)[()]


def larger(a, b):
    """b where one is NaN."""
    return select(a > b, a, b)


def smaller(a, b):
    """b where one is NaN."""
    return select(a < b, a, b)


def any_lane(conditions):
    """Whether the condition of any lane holds."""
    if isinstance(conditions, Emitted):
        return conditions.any_lane()
    return bool(conditions.any())


def split(v):
    """v as a sum of two numbers of 26 bits, whose products are exact (Veltkamp)."""
    c = 134217729.0 * v
    high = c - (c - v)
    return high, v - high


def two_product(v, w):
    """v*w, rounded, and what the rounding lost (Dekker)."""
    product = v * w
    if isinstance(product, Emitted):
        return product, v.call("fma", w, -product)  # the same, unless it is subnormal
    v1, v2 = split(v)
    w1, w2 = split(w)
    return product, v2 * w2 - (((product - v1 * w1) - v2 * w1) - v1 * w2)


def bits_of(v):
    """The bits of numbers, as integers."""
    return v.cast(_INTEGER) if isinstance(v, Emitted) else np.float64(v).view(np.int64)


def number_of_bits(bits):
    """The reverse of `bits_of`."""
    return bits.cast(_DOUBLE) if isinstance(bits, Emitted) else np.int64(bits).view(np.float64)


class Lanes(types.Type):
    """VECTOR values of one type."""

    def __init__(self, element):
        super().__init__(f"lanes({element})")


DOUBLES, CONDITIONS = Lanes(types.float64), Lanes(types.boolean)
_DOUBLE, _INTEGER, _CONDITION = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
IN_LLVM = {
    DOUBLES: ir.VectorType(_DOUBLE, VECTOR),
    CONDITIONS: ir.VectorType(_CONDITION, VECTOR),
}
_OF_NUMBERS = {types.float64: _DOUBLE, types.intp: _INTEGER, types.boolean: _CONDITION}
_NUMBA = {kind: of for of, kind in (IN_LLVM | _OF_NUMBERS).items()}
_FLAT = types.Array(types.float64, 1, "C")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, lanes):
        super().__init__(manager, lanes, IN_LLVM[lanes])


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


def _binary(of_doubles, of_integers, reverse=False):
    def operate(self, other):
        a, b = self.beside(other)
        emit = of_doubles if _element(a.type) == _DOUBLE else of_integers
        return Emitted(self.builder, emit(self.builder, *((b, a) if reverse else (a, b))))

    return operate


def _comparison(how):
    def operate(self, other):
        a, b = self.beside(other)
        emit = self.builder.fcmp_unordered if how == "!=" else self.builder.fcmp_ordered
        return Emitted(self.builder, emit(how, a, b))

    return operate


class Emitted:
    """A number, an integer, a condition, or a vector of them, in a formula that is compiled."""

    __hash__ = None

    def __init__(self, builder, value):
        self.builder, self.value = builder, value

    def constant(self, number):
        kind = _element(self.value.type)
        return ir.Constant(kind, float(number) if kind == _DOUBLE else number)

    def beside(self, other):
        """The values of this and of another, as of one type."""
        if isinstance(other, Emitted):
            a, b = self.value, other.value
        else:
            a, b = self.value, self.constant(other)
        return _alike(self.builder, a, b)

    __add__ = __radd__ = _binary(ir.IRBuilder.fadd, ir.IRBuilder.add)
    __sub__ = _binary(ir.IRBuilder.fsub, ir.IRBuilder.sub)
    __rsub__ = _binary(ir.IRBuilder.fsub, ir.IRBuilder.sub, reverse=True)
    __mul__ = __rmul__ = _binary(ir.IRBuilder.fmul, ir.IRBuilder.mul)
    __truediv__ = _binary(ir.IRBuilder.fdiv, None)
    __rtruediv__ = _binary(ir.IRBuilder.fdiv, None, reverse=True)
    __lshift__ = _binary(None, ir.IRBuilder.shl)
    __rshift__ = _binary(None, ir.IRBuilder.ashr)
    __and__ = __rand__ = _binary(None, ir.IRBuilder.and_)
    __or__ = __ror__ = _binary(None, ir.IRBuilder.or_)
    __lt__, __le__, __gt__, __ge__ = map(_comparison, ("<", "<=", ">", ">="))
    __eq__, __ne__ = map(_comparison, ("==", "!="))

    def copy(self):
        return self

    def __neg__(self):
        return Emitted(self.builder, self.builder.fneg(self.value))

    def __abs__(self):
        return self.call("fabs")

    def __array_ufunc__(self, function, method, *arguments):
        return self.call(function.__name__)  # NumPy's root

    def call(self, name, *others):
        """What an intrinsic function of LLVM returns."""
        values = _alike(self.builder, self.value, *(each.value for each in others))
        kind = values[0].type
        suffix = f"v{kind.count}f64" if isinstance(kind, ir.VectorType) else "f64"
        declared = self.builder.module.declare_intrinsic(
            f"llvm.{name}.{suffix}", fnty=ir.FunctionType(kind, [kind] * len(values))
        )
        return Emitted(self.builder, self.builder.call(declared, values))

    def cast(self, element):
        """The same bits as numbers of another type."""
        kind = self.value.type
        kind = ir.VectorType(element, kind.count) if isinstance(kind, ir.VectorType) else element
        return Emitted(self.builder, self.builder.bitcast(self.value, kind))

    def choose(self, first, second):
        values = [
            each.value if isinstance(each, Emitted) else ir.Constant(_DOUBLE, float(each))
            for each in (first, second)
        ]
        return Emitted(
            self.builder, self.builder.select(*_alike(self.builder, self.value, *values))
        )

    def any_lane(self):
        bits = ir.IntType(self.value.type.count)
        value = self.builder.bitcast(self.value, bits)
        return Emitted(self.builder, self.builder.icmp_unsigned("!=", value, bits(0)))


class EmittedArray:
    """A flat array of doubles in a formula that is compiled: vectors of it are read and written."""

    def __init__(self, builder, data):
        self.builder, self.data = builder, data

    def __getitem__(self, part):
        """What lies from an index on; a vector at its beginning; or the number at an index."""
        if not isinstance(part, slice):
            return Emitted(self.builder, self.builder.load(self._from(part)))
        if part.start is not None:
            return EmittedArray(self.builder, self._from(part.start))
        return Emitted(self.builder, self.builder.load(self._place(part.stop), align=8))

    def __setitem__(self, part, vector):
        value = vector.value if isinstance(vector, Emitted) else _DOUBLE(vector)
        if isinstance(part, slice):
            value = spread(self.builder, value, part.stop)
            self.builder.store(value, self._place(part.stop), align=8)
        else:
            self.builder.store(value, self._from(part))

    def _from(self, index):
        start = index.value if isinstance(index, Emitted) else _INTEGER(index)
        return self.builder.gep(self.data, [start])

    def _place(self, size):
        return self.builder.bitcast(self.data, ir.VectorType(_DOUBLE, size).as_pointer())


def lanewise(function):
    """Compile a formula without branches by calling it, as the head of this file says.

    It takes and returns numbers, conditions, and vectors of them; and reads and writes vectors of
    flat arrays. Integers are those that place them.
    """

    def emit(builder, values):
        results = function(*values)
        return results if isinstance(results, tuple) else (results,)

    signatures = {}

    class _Called(AbstractTemplate):
        key = function

        def generic(self, arguments, options):
            accepts = tuple(map(_accepted, arguments))
            if accepts not in signatures:
                signatures[accepts] = signature(_returned(emit, accepts), *accepts)
            return signatures[accepts]

    builtin_registry.register_global(function, types.Function(_Called))

    @lower_builtin(function, types.VarArg(types.Any))
    def _generate(context, builder, signature, arguments):
        values = [
            context.make_array(_FLAT)(context, builder, value).data if kind == _FLAT else value
            for kind, value in zip(signature.args, arguments, strict=True)
        ]
        results = emit(builder, _stand_ins(builder, signature.args, values))
        values = [each.value for each in results if each is not None]
        if signature.return_type == types.void:
            return context.get_dummy_value()
        if len(values) == 1:
            return values[0]
        return context.make_tuple(builder, signature.return_type, values)

    return function


def _returned(emit, accepts):
    """The type of what a formula returns, by a trial."""
    pointers = {_FLAT: _DOUBLE.as_pointer()}
    kinds = [(pointers | IN_LLVM | _OF_NUMBERS)[each] for each in accepts]
    tried = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), kinds), "tried")
    builder = ir.IRBuilder(tried.append_basic_block())
    results = emit(builder, _stand_ins(builder, accepts, tried.args))
    returns = [_NUMBA[each.value.type] for each in results if each is not None]
    if len(results) == 1:
        return returns[0] if returns else types.void
    return types.Tuple(returns)


def _accepted(kind):
    if isinstance(kind, Lanes) or kind == _FLAT:
        return kind
    if isinstance(kind, types.Boolean):
        return types.boolean
    return types.intp if isinstance(kind, types.Integer) else types.float64


def _stand_ins(builder, kinds, values):
    return [
        (EmittedArray if kind == _FLAT else Emitted)(builder, value)
        for kind, value in zip(kinds, values, strict=True)
    ]


for _each in (select, larger, smaller, any_lane, two_product):
    lanewise(_each)
