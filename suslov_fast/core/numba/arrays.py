"""Arrays of kernels: without reference counts, flat, or as blocks of lanes on the stack.

Threads that count references to the same array wait for each other. Counting also makes much of the
code that Numba writes for an array, and so of the time of a first call.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils  # imported as in Numba's own guide to extensions
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

from .intrinsics import LINE, emit_call


class Uncounted(types.Array):
    """Type of arrays without reference counts, made of arrays of type `kind` that outlive them."""

    def __init__(self, kind):
        name = f"Uncounted {kind}"
        super().__init__(kind.dtype, kind.ndim, kind.layout, not kind.mutable, name, kind.aligned)

    def copy(self, dtype=None, ndim=None, layout=None, readonly=None):
        """Return this type with other dtype, ndim, layout or `readonly`, for a part of an array."""
        return uncounted_type(super().copy(dtype, ndim, layout, readonly))


@register_model(Uncounted)
class _Model(models.ArrayModel):
    def traverse(self, builder):
        return []  # these arrays hold no references


def uncounted_type(kind):
    """Return the type of an argument of Numba type `kind`, but without reference counts."""
    if type(kind) is types.Array:
        return Uncounted(kind)
    if isinstance(kind, types.BaseTuple):
        items = [*map(uncounted_type, kind.types)]
        if items != [*kind.types]:
            return types.BaseTuple.from_types(items, getattr(kind, "instance_class", None))
    return kind


def uncounted_value(context, builder, kind, value):
    """Return the LLVM value `value`, of an argument of type `kind`, without reference counts."""
    if isinstance(kind, types.Array):
        return builder.insert_value(value, ir.Constant(value.type.elements[0], None), 0)
    for k, item in enumerate(kind if isinstance(kind, types.BaseTuple) else ()):
        if uncounted_type(item) != item:
            element = uncounted_value(context, builder, item, builder.extract_value(value, k))
            value = builder.insert_value(value, element, k)
    return value


def uncounted(arrays):
    """Return an array, or a tuple of arrays, without reference counts."""
    return arrays


def keep(arrays):
    """Keep arrays of a kernel alive until this line, because it uses uncounted copies of them."""


def block_of(rows, lanes):
    """Return a function that makes an array (rows, lanes) on the stack of a kernel, 64 KiB at most.

    LLVM knows that rows do not overlap, because the shape is a constant. The array begins at a
    cache line: vectors that straddle two lines take up to 1.5 times as long.
    """

    def block():
        return np.ones((rows, lanes))

    kind = Uncounted(types.Array(types.float64, 2, "C"))
    type_callable(block)(lambda context: lambda: kind)

    @lower_builtin(block)
    def emit(context, builder, signature, arguments):
        word, byte, bit = context.get_value_type(types.intp), ir.IntType(8), ir.IntType(1)
        size = ir.Constant(word, 8 * rows * lanes)
        with builder.goto_entry_block():
            memory = builder.alloca(ir.DoubleType(), rows * lanes)
        memory.align = 8 * LINE
        # Bytes of 63 make doubles of about 5e-4. Subnormals, in lanes without data, would be slow.
        data = builder.bitcast(memory, context.get_value_type(types.voidptr))
        fill = builder.module.declare_intrinsic("llvm.memset", [data.type, word])
        builder.call(fill, [data, ir.Constant(byte, 63), size, ir.Constant(bit, 0)])
        array = context.make_array(signature.return_type)(context, builder)
        array.data, array.itemsize = memory, ir.Constant(word, 8)
        array.nitems = ir.Constant(word, rows * lanes)
        array.shape = ir.Constant(ir.ArrayType(word, 2), [rows, lanes])
        array.strides = ir.Constant(ir.ArrayType(word, 2), [8 * lanes, 8])
        return array._getvalue()

    return block


type_callable(uncounted)(lambda context: uncounted_type)
type_callable(keep)(lambda context: lambda arrays: types.none)


@lower_builtin(uncounted, types.Any)
def _uncounted(context, builder, signature, arguments):
    return uncounted_value(context, builder, signature.args[0], arguments[0])


@lower_builtin(keep, types.Any)
def _keep(context, builder, signature, arguments):
    return context.get_dummy_value()


@intrinsic
def array_at(typing, address, shape, dtype):
    """Return the C-ordered array at an address, without reference counts."""
    # It replaces Numba's `carray`, which would be compiled for each shape.
    result = Uncounted(types.Array(dtype.dtype, len(shape), "C"))

    def emit(context, builder, signature, values):
        word, item = context.get_value_type(types.intp), context.get_data_type(result.dtype)
        lengths = zip(cgutils.unpack_tuple(builder, values[1]), shape, strict=True)
        lengths = [context.cast(builder, *pair, types.intp) for pair in lengths]
        size, count = ir.Constant(word, context.get_abi_sizeof(item)), ir.Constant(word, 1)
        strides = []
        for length in reversed(lengths):
            strides.insert(0, builder.mul(size, count))
            count = builder.mul(count, length)
        array = context.make_array(result)(context, builder)
        array.data = builder.inttoptr(values[0], item.as_pointer())
        array.itemsize, array.nitems = size, count
        array.shape = cgutils.pack_array(builder, lengths)
        array.strides = cgutils.pack_array(builder, strides)
        return array._getvalue()

    return result(address, shape, dtype), emit


@intrinsic
def pack(typing, arguments):
    """Return two addresses, valid while the caller runs: of a function, and of the `arguments`.

    The function (kernel, data, part, parts) calls the kernel at the address `kernel` with part,
    parts and the arguments at the address `data`. So one loop in parallel can call all kernels.
    """
    result = types.UniTuple(types.int64, 2)
    word = ir.IntType(64)

    def emit(context, builder, signature, values):
        packed = uncounted_value(context, builder, arguments, values[0])
        with builder.goto_entry_block():
            memory = builder.alloca(packed.type)
        builder.store(packed, memory)
        kind = ir.FunctionType(context.get_value_type(types.none), [word] * 4)
        call_part = ir.Function(builder.module, kind, f"{builder.function.name}.part")
        call_part.linkage = "internal"
        kernel, data, part, parts = call_part.args
        inner = ir.IRBuilder(call_part.append_basic_block())
        packed = inner.load(inner.inttoptr(data, memory.type), typ=packed.type)
        items = [inner.extract_value(packed, k) for k in range(len(arguments))]
        emit_call(inner, kernel, kind.return_type, [part, parts, *items])
        inner.ret(context.get_dummy_value())
        addresses = [builder.ptrtoint(pointer, word) for pointer in (call_part, memory)]
        return context.make_tuple(builder, result, addresses)

    return result(arguments), emit
