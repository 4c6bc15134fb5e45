"""LLVM instructions for what Numba cannot express.

These are calls by address, arrays without reference counts, blocks of lanes on the stack, and
stores past the caches.

Each function brings its own typing and lowering, because an overload is itself compiled. `load` and
`gep` name their types, because pointers of later versions of llvmlite have none.
"""

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.imputils import impl_ret_borrowed, lower_constant
from numba.extending import (
    intrinsic,
    lower_builtin,
    models,
    register_model,
    type_callable,
    typeof_impl,
)

LINE = 8  # numbers of a cache line
_NUMBER, _VECTOR = ir.DoubleType(), ir.VectorType(ir.DoubleType(), LINE)


# ------------------------------------------------------------------------------------------- calls
def emit_call(builder, address, result, values):
    """Call the function at an address with these values; return its result."""
    kind = ir.FunctionType(result, [value.type for value in values])
    return builder.call(builder.inttoptr(address, kind.as_pointer()), values)


@intrinsic
def call_address(typing, address, a, b, c, d):
    """Call the function at an address with four integers; it returns nothing."""

    def emit(context, builder, signature, arguments):
        emit_call(builder, arguments[0], context.get_value_type(types.none), arguments[1:])
        return context.get_dummy_value()

    return types.void(*[types.int64] * 5), emit


@intrinsic
def call_code(typing, address, numbers):
    """Call the code at an address with a tuple of integers; return its integer."""

    def emit(context, builder, signature, arguments):
        values = [builder.extract_value(arguments[1], k) for k in range(len(numbers))]
        return emit_call(builder, arguments[0], ir.IntType(64), values)

    return types.int64(types.int64, types.UniTuple(types.int64, len(numbers))), emit


class _WithAddress(types.NamedTuple):
    """The type of named tuples that begin with an address of this process."""


register_model(_WithAddress)(models.TupleModel)


def with_address(cls):
    """Keep functions that have such a tuple as a constant out of the cache: Numba then warns."""

    @typeof_impl.register(cls)
    def type_of(value, context):
        return _WithAddress([typeof_impl(item, context) for item in value], cls)

    return cls


@lower_constant(_WithAddress)
def _constant_with_address(context, builder, kind, value):
    address = context.add_dynamic_addr(builder, value[0], info="address of machine code")
    address = builder.ptrtoint(address, context.get_value_type(kind[0]))
    others = zip(kind[1:], value[1:], strict=True)
    others = [context.get_constant_generic(builder, *pair) for pair in others]
    return context.make_tuple(builder, kind, [address, *others])


@intrinsic
def address_as_pointer(typing, address):
    """Return an address as a pointer, for `numba.carray`."""

    def emit(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), emit


@intrinsic
def pack(typing, arguments):
    """Return the addresses of a function and of data, which are valid while the caller runs.

    function(kernel, data, part, parts) calls the kernel at an address with part, parts and the
    arguments of `pack`, which are the data.
    """
    result, word = types.UniTuple(types.int64, 2), ir.IntType(64)

    def emit(context, builder, signature, values):
        packed, nothing = uncounted_value(context, builder, arguments, values[0]), types.none
        with builder.goto_entry_block():
            memory = builder.alloca(packed.type)
        builder.store(packed, memory)
        kind = ir.FunctionType(context.get_value_type(nothing), [word] * 4)
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


# ------------------------------------------------------------------------------------------ arrays
def uncounted_value(context, builder, kind, value):
    """Return an argument whose arrays have no reference counts.

    Threads that count references to the same array wait for each other.
    """
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = ir.Constant(array.meminfo.type, None)
        return array._getvalue()
    for k, item in enumerate(kind if isinstance(kind, types.BaseTuple) else ()):
        element = uncounted_value(context, builder, item, builder.extract_value(value, k))
        value = builder.insert_value(value, element, k)
    return value


def uncounted(arrays):
    """Return an array, or a tuple of arrays, without reference counts."""
    return arrays


def flat(array):
    """Return the numbers of an array of order C as an array (-,).

    Numba compiles `reshape` for each number of axes.
    """
    return array.reshape(-1)


def for_size():
    """Let LLVM optimise the function that calls this for size, which compiles faster.

    LLVM then vectorises no loops of unknown lengths, which would need tests at run time.
    """


def block_of(rows, lanes):
    """Return the function that makes a block (rows, lanes) for a kernel.

    The block is on the stack of the kernel, 64 KiB at most, and begins at a cache line. NumPy's
    arrays begin anywhere, and vectors that straddle two lines take up to 1.5 times as long. Because
    the shape is a constant, the compiler knows that rows do not overlap. All numbers are equal at
    first, and normal.
    """

    def block():
        return np.ones((rows, lanes))

    type_callable(block)(lambda context: lambda: types.Array(types.float64, 2, "C"))

    @lower_builtin(block)
    def emit(context, builder, signature, arguments):
        word, byte, bit = context.get_value_type(types.intp), ir.IntType(8), ir.IntType(1)
        with builder.goto_entry_block():
            memory = builder.alloca(_NUMBER, rows * lanes)
        memory.align, size = 8 * LINE, ir.Constant(word, 8 * rows * lanes)
        # Bytes of 63 make doubles of about 5e-4; subnormals in unused lanes would be slow.
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


type_callable(uncounted)(lambda context: lambda arrays: arrays)
type_callable(flat)(
    lambda context: lambda array: types.Array(array.dtype, 1, "C") if array.layout == "C" else None
)
type_callable(for_size)(lambda context: lambda: types.none)


@lower_builtin(uncounted, types.Any)
def _uncounted(context, builder, signature, arguments):
    return uncounted_value(context, builder, signature.args[0], arguments[0])


@lower_builtin(flat, types.Array)
def _flat(context, builder, signature, arguments):
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    numbers = context.make_array(signature.return_type)(context, builder)
    names = "meminfo", "parent", "nitems", "itemsize", "data"
    for name in names:
        setattr(numbers, name, getattr(array, name))
    word = context.get_value_type(types.intp)
    for name, value in (("shape", array.nitems), ("strides", array.itemsize)):
        one = builder.insert_value(ir.Constant(ir.ArrayType(word, 1), ir.Undefined), value, 0)
        setattr(numbers, name, one)
    return impl_ret_borrowed(context, builder, signature.return_type, numbers._getvalue())


@lower_builtin(for_size)
def _for_size(context, builder, signature, arguments):
    builder.function.attributes.add("optsize")
    return context.get_dummy_value()


# ------------------------------------------------------------------------------------------ stores
def stream_pairs(target, i, b, row, l):
    """Interleave LINE numbers from b[row, l] and b[row + 1, l] on into target, from index i on.

    These are two whole cache lines, which are written past the caches, in half the time.
    NUMBA_BOUNDSCHECK does not check the indices.
    """
    target[i : i + 2 * LINE : 2] = b[row, l : l + LINE]
    target[i + 1 : i + 2 * LINE : 2] = b[row + 1, l : l + LINE]


type_callable(stream_pairs)(lambda context: lambda target, i, b, row, l: types.none)


def _line(context, builder, kinds, array, *place):
    """Return a pointer to the line from array[place] on; `kinds` are the types of both."""
    numbers, offset = context.make_array(kinds[0])(context, builder, array), None
    for k, (index, kind) in enumerate(zip(place, kinds[1:], strict=True)):
        index = context.cast(builder, index, kind, types.intp)
        length = builder.extract_value(numbers.shape, k)
        offset = index if offset is None else builder.add(builder.mul(offset, length), index)
    pointer = builder.gep(numbers.data, [offset], source_etype=_NUMBER)
    return builder.bitcast(pointer, _VECTOR.as_pointer())


def _plus(builder, index, k):
    return builder.add(index, ir.Constant(index.type, k))


@lower_builtin(stream_pairs, types.Array, types.Integer, types.Array, types.Integer, types.Integer)
def _stream_pairs(context, builder, signature, arguments):
    kinds, (target, i, b, row, l) = signature.args, arguments
    lines = [
        builder.load(
            _line(context, builder, kinds[2:], b, _plus(builder, row, k), l), align=8, typ=_VECTOR
        )
        for k in range(2)
    ]
    past_caches = builder.module.add_metadata([ir.Constant(ir.IntType(32), 1)])
    for k in (0, LINE // 2):
        order = [k + lane // 2 + LINE * (lane % 2) for lane in range(LINE)]
        order = ir.Constant(ir.VectorType(ir.IntType(32), LINE), order)
        pointer = _line(context, builder, kinds[:2], target, _plus(builder, i, 2 * k))
        store = builder.store(builder.shuffle_vector(*lines, order), pointer, align=8 * LINE)
        store.set_metadata("nontemporal", past_caches)
    return context.get_dummy_value()


# ---------------------------------------------------------------------------------------- vectors
QUAD = 4  # numbers of a vector
_QUAD = ir.VectorType(_NUMBER, QUAD)


class _Quad(types.Type):
    """The type of vectors."""


_quad = _Quad("Quad")
register_model(_Quad)(lambda manager, kind: models.PrimitiveModel(manager, kind, _QUAD))


def get(array, i):
    """Return the vector i of an array (-,). NUMBA_BOUNDSCHECK does not check i, here and in `put`.

    LLVM does not see by itself that arrays do not overlap. Vectors have products and differences.
    """
    return array[i * QUAD : (i + 1) * QUAD].copy()


def put(array, i, quad):
    """Set the vector i of an array (-,)."""
    array[i * QUAD : (i + 1) * QUAD] = quad


type_callable(get)(lambda context: lambda array, i: _quad)
type_callable(put)(lambda context: lambda array, i, quad: types.none)


def _place(context, builder, signature, arguments):
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    i = context.cast(builder, arguments[1], signature.args[1], types.intp)
    data = builder.bitcast(array.data, _QUAD.as_pointer())
    return builder.gep(data, [i], source_etype=_QUAD)


@lower_builtin(get, types.Array, types.Integer)
def _get(context, builder, signature, arguments):
    return builder.load(_place(context, builder, signature, arguments), align=8, typ=_QUAD)


@lower_builtin(put, types.Array, types.Integer, _Quad)
def _put(context, builder, signature, arguments):
    builder.store(arguments[2], _place(context, builder, signature, arguments), align=8)
    return context.get_dummy_value()


for _operator, _instruction in ((operator.mul, "fmul"), (operator.sub, "fsub")):
    type_callable(_operator)(lambda context: lambda a, b: _quad if a == b == _quad else None)
    lower_builtin(_operator, _Quad, _Quad)(
        lambda context, builder, signature, arguments, emit=_instruction: getattr(builder, emit)(
            *arguments
        )
    )
