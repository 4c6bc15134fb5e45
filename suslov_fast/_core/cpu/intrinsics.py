"""What LLVM is told directly: arithmetic on vectors in registers, and the functions of `vector`.

Loops over lanes would be left to LLVM to make vectors of, and it often does not: it must first see
that rows do not overlap, and it keeps sums over components in memory.
"""

import math

from llvmlite import ir

from ..lanewise import any_lane
from ..stand_ins import (
    DOUBLE,
    VECTOR,
    Emitted,
    EmittedArray,
    emits,
    emitted,
    spread,
)
from .vector import (
    all_lanes,
    copy_transposed,
    expect_store,
    fence,
    on_stack,
    splat,
    store_at,
    store_pairs,
    store_pairs_apart,
    stream,
    stream_pairs,
    vector_at,
)


@emits(splat)
def _splat(builder, number):
    return Emitted(builder, spread(builder, emitted(builder, number).value))


@emits(all_lanes)
def _all_lanes(builder, conditions):
    return ~any_lane(~conditions)


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


@emits(store_pairs_apart)
def _store_pairs_apart(builder, array, index, stride, first, second):
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
