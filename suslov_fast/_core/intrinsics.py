"""What LLVM is told directly: arithmetic on vectors in registers, and the functions of `vector`.

Loops over lanes would be left to LLVM to make vectors of, and it often does not: it must first see
that rows do not overlap, and it keeps sums over components in memory.
"""

import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

from .vector import VECTOR, choose, in_all, load, same, store


class Lanes(types.Type):
    """VECTOR values of one type."""

    def __init__(self, element):
        self.element = element
        super().__init__(f"lanes({element})")


DOUBLES, CONDITION = Lanes(types.float64), Lanes(types.boolean)
_LLVM = {
    DOUBLES: ir.VectorType(ir.DoubleType(), VECTOR),
    CONDITION: ir.VectorType(ir.IntType(1), VECTOR),
}


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, lanes):
        super().__init__(manager, lanes, _LLVM[lanes])


def _define(function, returns, *accepts):
    """Let compiled code call a function of these types; the decorated one emits its code."""

    @infer_global(function)
    class Signature(ConcreteTemplate):
        cases = (signature(returns, *accepts),)

    return lower_builtin(function, *accepts)


def _spread(builder, value):
    """A vector as it is, a number in all lanes."""
    if value.type == _LLVM[DOUBLES]:
        return value
    index = ir.IntType(32)
    vector = builder.insert_element(_LLVM[DOUBLES](ir.Undefined), value, index(0))
    return builder.shuffle_vector(vector, vector, ir.VectorType(index, VECTOR)(None))


def _define_lane_by_lane(function, returns, emit):
    """Of two vectors, or of a vector and a number."""

    def generate(context, builder, signature, arguments):
        return emit(builder, *(_spread(builder, value) for value in arguments))

    for accepts in ((DOUBLES, DOUBLES), (DOUBLES, types.float64), (types.float64, DOUBLES)):
        _define(function, returns, *accepts)(generate)


_define_lane_by_lane(operator.add, DOUBLES, ir.IRBuilder.fadd)
_define_lane_by_lane(operator.sub, DOUBLES, ir.IRBuilder.fsub)
_define_lane_by_lane(operator.mul, DOUBLES, ir.IRBuilder.fmul)
_define_lane_by_lane(operator.truediv, DOUBLES, ir.IRBuilder.fdiv)
_define_lane_by_lane(operator.lt, CONDITION, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_define_lane_by_lane(operator.gt, CONDITION, lambda builder, a, b: builder.fcmp_ordered(">", a, b))
_define_lane_by_lane(operator.ge, CONDITION, lambda builder, a, b: builder.fcmp_ordered(">=", a, b))


@_define(operator.and_, CONDITION, CONDITION, CONDITION)
def _and(context, builder, signature, arguments):
    return builder.and_(*arguments)


@_define(operator.neg, DOUBLES, DOUBLES)
def _neg(context, builder, signature, arguments):
    return builder.fneg(*arguments)


@_define(abs, DOUBLES, DOUBLES)
def _abs(context, builder, signature, arguments):
    kind = ir.FunctionType(_LLVM[DOUBLES], [_LLVM[DOUBLES]])
    fabs = builder.module.declare_intrinsic(f"llvm.fabs.v{VECTOR}f64", fnty=kind)
    return builder.call(fabs, arguments)


@_define(same, DOUBLES, types.float64)
def _same(context, builder, signature, arguments):
    return _spread(builder, *arguments)


@_define(choose, DOUBLES, CONDITION, DOUBLES, DOUBLES)
def _choose(context, builder, signature, arguments):
    return builder.select(*arguments)


@_define(in_all, types.boolean, CONDITION)
def _in_all(context, builder, signature, arguments):
    bits = ir.IntType(VECTOR)
    return builder.icmp_unsigned("==", builder.bitcast(*arguments, bits), bits(-1))


def _place(context, builder, signature, arguments, dimension):
    """Where in an array a vector lies."""
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    lengths = cgutils.unpack_tuple(builder, array.shape, dimension)
    row = arguments[1]
    for index, length in zip(arguments[2:], lengths[1:], strict=False):
        row = builder.add(builder.mul(row, length), index)
    first = builder.gep(array.data, [builder.mul(row, row.type(VECTOR))])
    return builder.bitcast(first, _LLVM[DOUBLES].as_pointer())


def _define_access(dimension):
    array = types.Array(types.float64, dimension, "C")
    indices = [types.intp] * (dimension - 1)

    @_define(load, DOUBLES, array, *indices)
    def _load(context, builder, signature, arguments):
        return builder.load(_place(context, builder, signature, arguments, dimension), align=8)

    @_define(store, types.void, array, *indices, DOUBLES)
    def _store(context, builder, signature, arguments):
        *where, vector = arguments
        builder.store(vector, _place(context, builder, signature, where, dimension), align=8)
        return context.get_dummy_value()


for dimension in (2, 3, 4):
    _define_access(dimension)
