"""What LLVM is told directly: arithmetic on vectors in registers, and the functions of `vector`.

Loops over lanes would be left to LLVM to make vectors of, and it often does not: it must first see
that rows do not overlap, and it keeps sums over components in memory.
"""

import math
import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, ConcreteTemplate, infer_global, signature
from numba.extending import lower_builtin

from ..lanewise import any_lane, lanewise
from ..stand_ins import (
    CONDITIONS,
    DOUBLE,
    DOUBLES,
    IN_LLVM,
    VECTOR,
    Emitted,
    EmittedArray,
    emits,
    emitted,
    spread,
)
from .vector import (
    all_lanes,
    borrowed,
    copy_transposed,
    expect_store,
    fence,
    load,
    on_stack,
    pairs_at,
    scatter_pairs,
    splat,
    store,
    store_at,
    store_pairs,
    stream,
    stream_pairs,
    vector_at,
)


def _define(function, returns, *accepts):
    """Let compiled code call a function of these types; the decorated one emits its code."""

    @infer_global(function)
    class Signature(ConcreteTemplate):
        cases = (signature(returns, *accepts),)

    return lower_builtin(function, *accepts)


def _define_operator(function, returns, emit):
    """Of two vectors, or of a vector and a number."""

    def generate(context, builder, signature, arguments):
        return emit(builder, *(spread(builder, value) for value in arguments))

    _define(function, returns, DOUBLES, DOUBLES)(generate)
    _define(function, returns, DOUBLES, types.float64)(generate)
    _define(function, returns, types.float64, DOUBLES)(generate)


_define_operator(operator.add, DOUBLES, ir.IRBuilder.fadd)
_define_operator(operator.sub, DOUBLES, ir.IRBuilder.fsub)
_define_operator(operator.mul, DOUBLES, ir.IRBuilder.fmul)
_define_operator(operator.truediv, DOUBLES, ir.IRBuilder.fdiv)
_define_operator(operator.lt, CONDITIONS, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_define_operator(operator.gt, CONDITIONS, lambda builder, a, b: builder.fcmp_ordered(">", a, b))
_define_operator(operator.ge, CONDITIONS, lambda builder, a, b: builder.fcmp_ordered(">=", a, b))


@_define(operator.and_, CONDITIONS, CONDITIONS, CONDITIONS)
def _and(context, builder, signature, arguments):
    return builder.and_(*arguments)


@_define(operator.neg, DOUBLES, DOUBLES)
def _neg(context, builder, signature, arguments):
    return builder.fneg(*arguments)


@_define(abs, DOUBLES, DOUBLES)
def _abs(context, builder, signature, arguments):
    kind = ir.FunctionType(IN_LLVM[DOUBLES], [IN_LLVM[DOUBLES]])
    fabs = builder.module.declare_intrinsic(f"llvm.fabs.v{VECTOR}f64", fnty=kind)
    return builder.call(fabs, arguments)


@emits(splat)
def _splat(builder, number):
    return Emitted(builder, spread(builder, emitted(builder, number).value))


@emits(all_lanes)
def _all_lanes(builder, conditions):
    return ~any_lane(~conditions)


def _row(builder, indices, lengths):
    """The number of a row among all of an array, the last index running first."""
    *outer, index = indices
    if not outer:
        return index
    return builder.add(builder.mul(_row(builder, outer, lengths[:-1]), lengths[-1]), index)


def _place(context, builder, array_type, array, indices):
    """Where the vector at some indices lies."""
    array = context.make_array(array_type)(context, builder, array)
    lengths = cgutils.unpack_tuple(builder, array.shape)[:-1]
    first = builder.mul(_row(builder, indices, lengths), indices[0].type(VECTOR))
    return builder.bitcast(builder.gep(array.data, [first]), IN_LLVM[DOUBLES].as_pointer())


def _define_access(dimension):
    array = types.Array(types.float64, dimension, "C")
    indices = [types.intp] * (dimension - 1)

    @_define(load, DOUBLES, array, *indices)
    def _load(context, builder, signature, arguments):
        array, *indices = arguments
        return builder.load(_place(context, builder, signature.args[0], array, indices), align=8)

    @_define(store, types.void, array, *indices, DOUBLES)
    def _store(context, builder, signature, arguments):
        array, *indices, vector = arguments
        place = _place(context, builder, signature.args[0], array, indices)
        builder.store(vector, place, align=8)
        return context.get_dummy_value()


_define_access(3)


for _each in (vector_at, pairs_at, store_at):
    lanewise(_each)


@emits(stream)
def _stream(builder, array, index, vector):
    _past_caches(builder, vector.value, array[index:].as_vector(VECTOR))


def _past_caches(builder, vector, place):
    store = builder.store(vector, place, align=64)
    one = ir.Constant(ir.IntType(32), 1)
    store.set_metadata("nontemporal", builder.module.add_metadata([one]))


def _define_pairs(function, write):
    """Two shuffles of two vectors give two whole cache lines of pairs."""

    @emits(function)
    def _pairs(builder, array, index, first, second):
        for half in range(2):
            lanes = [half * VECTOR // 2 + k // 2 + (VECTOR if k % 2 else 0) for k in range(VECTOR)]
            line = array[index + half * VECTOR :].as_vector(VECTOR)
            write(builder, first.shuffled(second, lanes).value, line)


_define_pairs(store_pairs, lambda builder, vector, place: builder.store(vector, place, align=8))
_define_pairs(stream_pairs, _past_caches)


@emits(scatter_pairs)
def _scatter_pairs(builder, array, index, stride, first, second):
    for k in range(VECTOR):
        pair = first.shuffled(second, [k, VECTOR + k])
        builder.store(pair.value, array[index:].as_vector(2), align=8)
        index = index + stride


@emits(copy_transposed)
def _copy_transposed(builder, array, index, stride, source, first, distance, factors):
    rows = []
    for _ in range(VECTOR):
        rows.append(factors * vector_at(source, first))
        first = first + distance
    # Squares of 1, 2 and 4 numbers change places with their mirror images.
    for size in (1, 2, 4):
        upper = [VECTOR + j - size if j & size else j for j in range(VECTOR)]
        lower = [VECTOR + j if j & size else j + size for j in range(VECTOR)]
        rows = [
            rows[i - size].shuffled(rows[i], lower)
            if i & size
            else rows[i].shuffled(rows[i + size], upper)
            for i in range(VECTOR)
        ]
    for row in rows:
        store_at(array, index, row)
        index = index + stride


@emits(expect_store)
def _expect_store(builder, array, index):
    integer = ir.IntType(32)
    place = builder.bitcast(array[index:].pointer, ir.IntType(8).as_pointer())
    kind = ir.FunctionType(ir.VoidType(), [place.type, integer, integer, integer])
    prefetch = builder.module.declare_intrinsic("llvm.prefetch", [place.type], kind)
    for_writing, near, data = integer(1), integer(3), integer(1)
    builder.call(prefetch, [place, for_writing, near, data])


@emits(fence)
def _fence(builder):
    builder.fence("seq_cst")


@emits(on_stack)
def _on_stack(builder, *shape):
    with builder.goto_entry_block():
        memory = builder.alloca(ir.ArrayType(DOUBLE, math.prod(shape)))
        memory.align = 64
    return EmittedArray(builder, builder.bitcast(memory, DOUBLE.as_pointer()), shape)


@infer_global(borrowed)
class _Borrowed(AbstractTemplate):
    def generic(self, arguments, options):
        (array,) = arguments
        return signature(types.Array(array.dtype, 1, "C"), array)


@lower_builtin(borrowed, types.Array)
def _borrow(context, builder, signature, arguments):
    given = context.make_array(signature.args[0])(context, builder, *arguments)
    result = context.make_array(signature.return_type)(context, builder)
    context.populate_array(
        result,
        data=given.data,
        shape=[given.nitems],
        strides=[given.itemsize],
        itemsize=given.itemsize,
        meminfo=None,
    )
    return result._getvalue()
