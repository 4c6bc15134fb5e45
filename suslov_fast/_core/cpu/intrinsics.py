"""What LLVM is told directly: arithmetic on vectors in registers, and the functions of `vector`.

Loops over lanes would be left to LLVM to make vectors of, and it often does not: it must first see
that rows do not overlap, and it keeps sums over components in memory.
"""

import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, overload

from ..lanewise import CONDITIONS, DOUBLES, IN_LLVM, VECTOR, spread
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


@_define(splat, DOUBLES, types.float64)
def _splat(context, builder, signature, arguments):
    return spread(builder, *arguments)


@_define(all_lanes, types.boolean, CONDITIONS)
def _all_lanes(context, builder, signature, arguments):
    bits = ir.IntType(VECTOR)
    return builder.icmp_unsigned("==", builder.bitcast(*arguments, bits), bits(-1))


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


_FLAT, _INDEX = types.Array(types.float64, 1, "C"), types.intp


def _element(context, builder, array, index, kind):
    """Where an element of a flat array lies."""
    data = context.make_array(_FLAT)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), kind.as_pointer())


@_define(vector_at, DOUBLES, _FLAT, _INDEX)
def _vector_at(context, builder, signature, arguments):
    return builder.load(_element(context, builder, *arguments, IN_LLVM[DOUBLES]), align=8)


@_define(pairs_at, types.UniTuple(DOUBLES, 2), _FLAT, _INDEX)
def _pairs_at(context, builder, signature, arguments):
    place = _element(context, builder, *arguments, IN_LLVM[DOUBLES])
    first, second = (
        builder.load(builder.gep(place, [ir.IntType(32)(half)]), align=8) for half in range(2)
    )
    kind = ir.VectorType(ir.IntType(32), VECTOR)
    lanes = (ir.Constant(kind, [2 * k + of_pair for k in range(VECTOR)]) for of_pair in range(2))
    vectors = [builder.shuffle_vector(first, second, mask) for mask in lanes]
    return context.make_tuple(builder, signature.return_type, vectors)


@_define(store_at, types.void, _FLAT, _INDEX, DOUBLES)
def _store_at(context, builder, signature, arguments):
    array, index, vector = arguments
    builder.store(vector, _element(context, builder, array, index, IN_LLVM[DOUBLES]), align=8)
    return context.get_dummy_value()


def _stream(builder, vector, place):
    store = builder.store(vector, place, align=64)
    one = ir.Constant(ir.IntType(32), 1)
    store.set_metadata("nontemporal", builder.module.add_metadata([one]))


@_define(stream, types.void, _FLAT, _INDEX, DOUBLES)
def _stream_vector(context, builder, signature, arguments):
    array, index, vector = arguments
    _stream(builder, vector, _element(context, builder, array, index, IN_LLVM[DOUBLES]))
    return context.get_dummy_value()


def _define_pairs(function, write):
    """Two shuffles of two vectors give two whole cache lines of pairs."""

    @_define(function, types.void, _FLAT, _INDEX, DOUBLES, DOUBLES)
    def _pairs(context, builder, signature, arguments):
        array, index, first, second = arguments
        place = _element(context, builder, array, index, IN_LLVM[DOUBLES])
        for half in range(2):
            lanes = [half * VECTOR // 2 + k // 2 + (VECTOR if k % 2 else 0) for k in range(VECTOR)]
            mask = ir.Constant(ir.VectorType(ir.IntType(32), VECTOR), lanes)
            line = builder.gep(place, [ir.IntType(32)(half)])
            write(builder, builder.shuffle_vector(first, second, mask), line)
        return context.get_dummy_value()


_define_pairs(store_pairs, lambda builder, vector, place: builder.store(vector, place, align=8))
_define_pairs(stream_pairs, _stream)


@_define(scatter_pairs, types.void, _FLAT, _INDEX, _INDEX, DOUBLES, DOUBLES)
def _scatter_pairs(context, builder, signature, arguments):
    array, index, stride, first, second = arguments
    pair = ir.VectorType(ir.DoubleType(), 2)
    for k in range(VECTOR):
        mask = ir.Constant(ir.VectorType(ir.IntType(32), 2), [k, VECTOR + k])
        place = _element(context, builder, array, index, pair)
        builder.store(builder.shuffle_vector(first, second, mask), place, align=8)
        index = builder.add(index, stride)
    return context.get_dummy_value()


@_define(copy_transposed, types.void, _FLAT, _INDEX, _INDEX, _FLAT, _INDEX, _INDEX, DOUBLES)
def _copy_transposed(context, builder, signature, arguments):
    array, index, stride, source, first, distance, factors = arguments
    rows = []
    for _ in range(VECTOR):
        place = _element(context, builder, source, first, IN_LLVM[DOUBLES])
        rows.append(builder.fmul(factors, builder.load(place, align=8)))
        first = builder.add(first, distance)
    # Squares of 1, 2 and 4 numbers change places with their mirror images.
    for size in (1, 2, 4):
        upper, lower = (
            ir.Constant(ir.VectorType(ir.IntType(32), VECTOR), places)
            for places in (
                [VECTOR + j - size if j & size else j for j in range(VECTOR)],
                [VECTOR + j if j & size else j + size for j in range(VECTOR)],
            )
        )
        rows = [
            builder.shuffle_vector(rows[i - size], rows[i], lower)
            if i & size
            else builder.shuffle_vector(rows[i], rows[i + size], upper)
            for i in range(VECTOR)
        ]
    for row in rows:
        builder.store(row, _element(context, builder, array, index, IN_LLVM[DOUBLES]), align=8)
        index = builder.add(index, stride)
    return context.get_dummy_value()


@_define(expect_store, types.void, _FLAT, _INDEX)
def _expect_store(context, builder, signature, arguments):
    integer = ir.IntType(32)
    place = _element(context, builder, *arguments, ir.IntType(8))
    kind = ir.FunctionType(ir.VoidType(), [place.type, integer, integer, integer])
    prefetch = builder.module.declare_intrinsic("llvm.prefetch", [place.type], kind)
    for_writing, near, data = integer(1), integer(3), integer(1)
    builder.call(prefetch, [place, for_writing, near, data])
    return context.get_dummy_value()


@_define(fence, types.void)
def _fence(context, builder, signature, arguments):
    builder.fence("seq_cst")
    return context.get_dummy_value()


@intrinsic(prefer_literal=True)
def _on_stack(typing_context, rows, lanes):
    if not (isinstance(rows, types.IntegerLiteral) and isinstance(lanes, types.IntegerLiteral)):
        return None
    shape = rows.literal_value, lanes.literal_value
    array_type = types.Array(types.float64, 2, "C")

    def generate(context, builder, signature, arguments):
        memory = ir.ArrayType(ir.DoubleType(), shape[0] * shape[1])
        with builder.goto_entry_block():
            place = builder.alloca(memory)
            place.align = 64

        def integers(*values):
            return cgutils.pack_array(builder, [ir.IntType(64)(value) for value in values])

        array = context.make_array(array_type)(context, builder)
        context.populate_array(
            array,
            data=builder.bitcast(place, ir.DoubleType().as_pointer()),
            shape=integers(*shape),
            strides=integers(8 * shape[1], 8),
            itemsize=ir.IntType(64)(8),
            meminfo=None,
        )
        return array._getvalue()

    return array_type(rows, lanes), generate


@overload(on_stack, inline="always", prefer_literal=True)
def _overload_on_stack(rows, lanes):
    return lambda rows, lanes: _on_stack(rows, lanes)


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
