"""What LLVM is told directly, since no Python code would make it emit it.

Compiled forms of the functions of `vector`, on arrays of doubles of any shape, in C order.
"""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from .vector import VECTOR, expect_store, store_past_caches, store_transposed, subtract_product

_VECTOR = ir.VectorType(ir.DoubleType(), VECTOR)
_LINE = 64
_DOUBLE = 8


def _data(context, builder, signature, arguments, k):
    """The data of the array that is argument k."""
    return context.make_array(signature.args[k])(context, builder, arguments[k]).data


def _place(builder, data, index):
    return builder.bitcast(builder.gep(data, [index]), _VECTOR.as_pointer())


def _load(builder, data, index):
    return builder.load(_place(builder, data, index), align=_DOUBLE)


@intrinsic
def _subtract_product(typing_context, array, target, first, second):
    # Distances between rows are known at run time only: in a loop over so few lanes, LLVM's tests
    # for overlap would cost more than vectors gain.
    def generate(context, builder, signature, arguments):
        data = _data(context, builder, signature, arguments, 0)
        values = [_load(builder, data, index) for index in arguments[1:]]
        product = builder.fmul(values[1], values[2])
        place = _place(builder, data, arguments[1])
        builder.store(builder.fsub(values[0], product), place, align=_DOUBLE)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, types.intp), generate


@intrinsic
def _store_past_caches(typing_context, array, target, source, first):
    def generate(context, builder, signature, arguments):
        value = _load(builder, _data(context, builder, signature, arguments, 2), arguments[3])
        place = _place(builder, _data(context, builder, signature, arguments, 0), arguments[1])
        one = ir.Constant(ir.IntType(32), 1)
        store = builder.store(value, place, align=_LINE)
        store.set_metadata("nontemporal", builder.module.add_metadata([one]))
        return context.get_dummy_value()

    return types.void(array, types.intp, source, types.intp), generate


@intrinsic
def _expect_store(typing_context, array, target):
    def generate(context, builder, signature, arguments):
        place = builder.gep(_data(context, builder, signature, arguments, 0), [arguments[1]])
        integer, pointer = ir.IntType(32), ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, integer, integer, integer])
        prefetch = builder.module.declare_intrinsic("llvm.prefetch", [pointer], kind)
        for_writing, near, data = (ir.Constant(integer, value) for value in (1, 3, 1))
        builder.call(prefetch, [builder.bitcast(place, pointer), for_writing, near, data])
        return context.get_dummy_value()

    return types.void(array, types.intp), generate


@intrinsic
def _store_transposed(typing_context, array, target, stride, source, first, distance):
    def shuffled(builder, one, other, places):
        mask = ir.Constant(ir.VectorType(ir.IntType(32), VECTOR), places)
        return builder.shuffle_vector(one, other, mask)

    def generate(context, builder, signature, arguments):
        _, target, stride, _, first, distance = arguments
        data = _data(context, builder, signature, arguments, 3)
        rows = []
        for _ in range(VECTOR):
            rows.append(_load(builder, data, first))
            first = builder.add(first, distance)
        # Squares of 1, 2 and 4 numbers change places with their mirror images.
        for size in (1, 2, 4):
            upper = [j if not j & size else VECTOR + j - size for j in range(VECTOR)]
            lower = [j + size if not j & size else VECTOR + j for j in range(VECTOR)]
            for i in range(VECTOR):
                if not i & size:
                    pair = rows[i], rows[i + size]
                    rows[i] = shuffled(builder, *pair, upper)
                    rows[i + size] = shuffled(builder, *pair, lower)
        data = _data(context, builder, signature, arguments, 0)
        for row in rows:
            builder.store(row, _place(builder, data, target), align=_DOUBLE)
            target = builder.add(target, stride)
        return context.get_dummy_value()

    intp = types.intp
    return types.void(array, intp, intp, source, intp, intp), generate


@overload(subtract_product, inline="always")
def _subtract_product_overload(array, target, first, second):
    def call(array, target, first, second):
        _subtract_product(array, target, first, second)

    return call


@overload(store_past_caches)
def _store_past_caches_overload(array, target, source, first):
    def call(array, target, source, first):
        _store_past_caches(array, target, source, first)

    return call


@overload(expect_store)
def _expect_store_overload(array, target):
    def call(array, target):
        _expect_store(array, target)

    return call


@overload(store_transposed)
def _store_transposed_overload(array, target, stride, source, first, distance):
    def call(array, target, stride, source, first, distance):
        _store_transposed(array, target, stride, source, first, distance)

    return call
