"""LLVM instructions that Numba lacks, each with a Python equivalent for interpreted runs.

Only the documented extension API is used: numba.extending.intrinsic, numba.types, numba.carray.
"""

import numpy as np
from llvmlite import binding, ir
from numba import carray, config, types
from numba.core.errors import RequireLiteralValue
from numba.extending import intrinsic

from .options import formula

_DOUBLE, _BIT = ir.DoubleType(), ir.IntType(1)
LINE = 8  # numbers of a cache line, and of the longest vector
# Intel's processors evict a line that is prefetched for writing before a non-temporal store: rows
# then take 1.4 times as long. On AMD's it saves up to a third where rows share lines, or nothing.
_PREFETCHES = binding.get_host_cpu_name().startswith("znver")


@intrinsic
def _select(typing, condition, first, second):
    kinds = {type(types.unliteral(each)) for each in (first, second)}
    result = {types.Boolean: types.boolean, types.Integer: types.int64}.get(kinds.pop())
    result = types.float64 if kinds or result is None else result

    def emit(context, builder, signature, arguments):
        bit = arguments[0]
        if bit.type.width != 1:
            bit = builder.trunc(bit, _BIT)
        first, second = (
            context.cast(builder, value, kind, result)
            for value, kind in zip(arguments[1:], signature.args[1:], strict=True)
        )
        return builder.select(bit, first, second)

    return result(types.boolean, types.unliteral(first), types.unliteral(second)), emit


@intrinsic
def _fma(typing, a, b, c):
    def emit(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), emit


def _bit_cast(result, argument):
    @intrinsic
    def cast(typing, value):
        def emit(context, builder, signature, arguments):
            return builder.bitcast(arguments[0], context.get_value_type(result))

        return result(argument), emit

    return cast


_bits_of = _bit_cast(types.int64, types.float64)
_number_of_bits = _bit_cast(types.float64, types.int64)


def _reserved(builder, size):
    """Return a pointer to doubles on the stack of the calling function, on a cache line."""
    with builder.goto_entry_block():
        memory = builder.alloca(ir.ArrayType(_DOUBLE, size))
        memory.align = 64
    return builder.bitcast(memory, _DOUBLE.as_pointer())


@intrinsic(prefer_literal=True)
def _stack(typing, size):
    if not isinstance(size, types.Literal):
        raise RequireLiteralValue("stack: expected a constant size")

    def emit(context, builder, signature, arguments):
        return _reserved(builder, size.literal_value)

    return types.CPointer(types.float64)(size), emit


@intrinsic(prefer_literal=True)
def _rows_of(typing, kind, size):
    if not isinstance(size, types.Literal):
        raise RequireLiteralValue("rows_of: expected a constant size")
    row, count = types.Array(types.float64, 1, "C"), len(kind.instance_class._fields)
    result, number = types.NamedUniTuple(row, count, kind.instance_class), ir.IntType(64)
    one_axis = ir.ArrayType(number, 1)

    def emit(context, builder, signature, arguments):
        rows = []
        for _ in range(count):
            zero = ir.Constant(context.get_value_type(row), None)
            array = context.make_array(row)(context, builder, zero)
            array.data = _reserved(builder, size.literal_value)
            array.nitems, array.itemsize = number(size.literal_value), number(8)
            array.shape, array.strides = one_axis([size.literal_value]), one_axis([8])
            rows.append(array._getvalue())
        return context.make_tuple(builder, result, rows)

    return result(kind, size), emit


def _place(context, builder, signature, arguments, k):
    """Return a pointer to a vector in array k of the arguments, whose indices follow it."""
    array = context.make_array(signature.args[k])(context, builder, arguments[k])
    number, index = array.data, arguments[k + 1]
    if isinstance(signature.args[k + 1], types.UniTuple):
        *rows, index = (builder.extract_value(index, i) for i in range(len(signature.args[k + 1])))
        byte = builder.bitcast(number, ir.IntType(8).as_pointer())
        for axis, row in enumerate(rows):
            byte = builder.gep(byte, [builder.mul(row, builder.extract_value(array.strides, axis))])
        number = builder.bitcast(byte, _DOUBLE.as_pointer())
    number = builder.gep(number, [index])
    return builder.bitcast(number, ir.VectorType(_DOUBLE, LINE).as_pointer())


@intrinsic
def _subtract_product(typing, target, i, factor, j, source, k):
    def emit(context, builder, signature, arguments):
        places = [_place(context, builder, signature, arguments, n) for n in (0, 2, 4)]
        before, v, w = (builder.load(place, align=8) for place in places)
        builder.store(builder.fsub(before, builder.fmul(v, w)), places[0], align=8)
        return context.get_dummy_value()

    return types.void(target, i, factor, j, source, k), emit


def _copy_line(past_caches):
    @intrinsic
    def copy(typing, target, i, source, j):
        def emit(context, builder, signature, arguments):
            source, target = (_place(context, builder, signature, arguments, k) for k in (2, 0))
            store = builder.store(builder.load(source, align=8), target, align=8)
            if past_caches:
                store.align = 64
                one = ir.Constant(ir.IntType(32), 1)
                store.set_metadata("nontemporal", builder.module.add_metadata([one]))
            return context.get_dummy_value()

        return types.void(target, i, source, j), emit

    return copy


@intrinsic
def _expect_store(typing, target, i):
    def emit(context, builder, signature, arguments):
        if not _PREFETCHES:
            return context.get_dummy_value()
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), (byte, word, word, word))
        prefetch = builder.module.declare_intrinsic("llvm.prefetch", (byte,), kind)
        place = builder.bitcast(builder.gep(array.data, [arguments[1]]), byte)
        builder.call(prefetch, (place, word(1), word(3), word(1)))  # to write, keep, data
        return context.get_dummy_value()

    return types.void(target, types.intp), emit


def _of_lane(context, builder, rows, index):
    """Return pointers to one number of each array of a NamedTuple."""
    kind, value = rows
    arrays = (builder.extract_value(value, k) for k in range(len(kind)))
    arrays = (context.make_array(kind.dtype)(context, builder, each) for each in arrays)
    return [builder.gep(each.data, [index], inbounds=True) for each in arrays]


@intrinsic
def _lane(typing, rows, l):
    result = types.NamedUniTuple(types.float64, len(rows), rows.instance_class)

    def emit(context, builder, signature, arguments):
        places = _of_lane(context, builder, (signature.args[0], arguments[0]), arguments[1])
        return context.make_tuple(builder, result, [builder.load(each) for each in places])

    return result(rows, types.intp), emit


@intrinsic
def _put(typing, rows, l, numbers):
    def emit(context, builder, signature, arguments):
        places = _of_lane(context, builder, (signature.args[0], arguments[0]), arguments[1])
        for k, place in enumerate(places):
            builder.store(builder.extract_value(arguments[2], k), place)
        return context.get_dummy_value()

    return types.void(rows, types.intp, numbers), emit


@intrinsic
def _call(typing, address, arguments):
    """Call a compiled kernel, whose C function takes the values of the arguments."""
    kinds = list(arguments)

    def emit(context, builder, signature, values):
        address, packed = values
        kind = ir.FunctionType(
            context.get_value_type(types.none), [context.get_value_type(each) for each in kinds]
        )
        kernel = builder.inttoptr(address, kind.as_pointer())
        builder.call(kernel, [builder.extract_value(packed, k) for k in range(len(kinds))])
        return context.get_dummy_value()

    return types.void(types.int64, arguments), emit


# The reasons, measured on AVX2 with the closed form (entering an orbit takes 26 ns):
#
# select        a ternary is a branch, which prevents SIMD: 110 ns
# two_product   the error of a product takes one FMA, or 16 other operations
# bits_of       exponents and powers of two without calls to the C library, which prevent SIMD
# stack         LLVM knows that rows on the stack do not overlap; other arrays it compares in pairs
#               at run time, and does not vectorize with eight: 110 ns
# stream_line   non-temporal stores: 15 GB/s instead of 9 if every state is saved
# expect_store  a store to a line that is not in the caches delays those after it
# call          a parallel loop calls a kernel by its address, so that Numba compiles it once
# rows_of, lane, put
#               fields of a block, and of a lane, without a line of code for each
# copy_line, subtract_product
#               elimination of 64 equations in half the time: a loop that LLVM makes for a few
#               numbers spends half its time on the first and last iterations
if config.DISABLE_JIT:

    def select(condition, first, second):
        """Return `first` where the condition holds, else `second`; both are computed."""
        chosen = first if condition else second
        # Dividing by 0, a float of Python raises, and one of NumPy does not.
        return np.float64(chosen) if isinstance(chosen, float) else chosen

    def two_product(v, w):
        """Return v*w, rounded, and its rounding error (Dekker)."""
        product = v * w
        v1, v2 = _split(v)
        w1, w2 = _split(w)
        return product, v2 * w2 - (((product - v1 * w1) - v2 * w1) - v1 * w2)

    def _split(v):
        c = 134217729.0 * v
        high = c - (c - v)
        return high, v - high

    def bits_of(number):
        """Return the bits of a float as an integer."""
        return np.float64(number).view(np.int64)

    def number_of_bits(bits):
        """Return the float that has these bits."""
        return np.int64(bits).view(np.float64)

    def stack(size):
        """Return uninitialised memory for `size` floats; `carray` converts it to an array."""
        return np.empty(size)

    def rows_of(kind, size):
        """Return a NamedTuple of arrays of `size` floats each, on the stack."""
        return kind(*(np.empty(size) for _ in kind._fields))

    def carray(memory, shape):
        """Return memory of `stack` as an array."""
        return memory.reshape(shape)

    def stream_line(target, i, source, j):
        """Copy source[j:j+8] to the cache line target[i:i+8] with non-temporal stores."""
        target[i : i + LINE] = source[j : j + LINE]

    def copy_line(target, i, source, j):
        """Copy source[j:j+8] to target[i:i+8]."""
        target[_line(i)] = source[_line(j)]

    def subtract_product(target, i, factor, j, source, k):
        """Subtract from eight numbers, from target[i] on, the products of eight pairs of others."""
        target[_line(i)] -= factor[_line(j)] * source[_line(k)]

    def _line(index):
        return (*index[:-1], slice(index[-1], index[-1] + LINE))

    def lane(rows, l):
        """Return the numbers of lane l of a NamedTuple of rows, as such a NamedTuple."""
        return type(rows)(*(each[l] for each in rows))

    def put(rows, l, numbers):
        """Store the numbers of lane l of a NamedTuple of rows."""
        for each, number in zip(rows, numbers, strict=True):
            each[l] = number

    def expect_store(target, i):
        """Prefetch the cache line of target[i] for writing, on AMD's processors."""

    def call(kernel, arguments):
        """Call a kernel by its address, with a tuple of arguments."""
        kernel(*arguments)

else:
    select, bits_of, number_of_bits = _select, _bits_of, _number_of_bits
    stack, rows_of, expect_store, call = _stack, _rows_of, _expect_store, _call
    copy_line, stream_line = _copy_line(past_caches=False), _copy_line(past_caches=True)
    subtract_product, lane, put = _subtract_product, _lane, _put

    @formula
    def two_product(v, w):
        """Return v*w, rounded, and its rounding error."""
        product = v * w
        return product, _fma(v, w, -product)
