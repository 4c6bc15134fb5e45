"""Code of LLVM, for what Numba cannot express or compiles slowly: calls by address, uncounted
arrays, blocks, wide stores, lines of lanes.

Calls of most functions here are typed and lowered here, too: overloads would have to be compiled.
"""

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

LINE = 8  # numbers of a cache line


def emit_call(context, builder, address, *values):
    kind = ir.FunctionType(context.get_value_type(types.none), [each.type for each in values])
    builder.call(builder.inttoptr(address, kind.as_pointer()), values)


@intrinsic
def call_address(typing, address, a, b, c, d):
    """Call the function at an address with four integers; it returns None."""

    def emit(context, builder, signature, arguments):
        emit_call(context, builder, *arguments)
        return context.get_dummy_value()

    return types.void(*[types.int64] * 5), emit


@intrinsic
def call_code(typing, address, numbers):
    """Call the code at an address with integers, as a tuple; it returns an integer."""
    word = ir.IntType(64)

    def emit(context, builder, signature, arguments):
        values = [builder.extract_value(arguments[1], k) for k in range(len(numbers))]
        kind = ir.FunctionType(word, [word] * len(numbers))
        return builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), values)

    return types.int64(types.int64, types.UniTuple(types.int64, len(numbers))), emit


@intrinsic
def address_as_pointer(typing, address):
    """Return an address as a pointer, for `numba.carray`."""

    def emit(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), emit


@intrinsic
def pack(typing, arguments):
    """Return the addresses of a function and of its data, for use while the caller runs.

    function(kernel, data, part, parts) calls the kernel at an address with all arguments.
    """
    result, word = types.UniTuple(types.int64, 2), ir.IntType(64)

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
        packed = inner.load(inner.inttoptr(data, packed.type.as_pointer()))
        numbers = [inner.extract_value(packed, k) for k in range(len(arguments))]
        emit_call(context, inner, kernel, part, parts, *numbers)
        inner.ret(context.get_dummy_value())
        addresses = [builder.ptrtoint(each, word) for each in (call_part, memory)]
        return context.make_tuple(builder, result, addresses)

    return result(arguments), emit


def uncounted_value(context, builder, kind, value):
    """Return an argument whose arrays have no reference counts, for which threads wait."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = ir.Constant(array.meminfo.type, None)
        return array._getvalue()
    for k, each in enumerate(kind if isinstance(kind, types.BaseTuple) else ()):
        element = uncounted_value(context, builder, each, builder.extract_value(value, k))
        value = builder.insert_value(value, element, k)
    return value


def array_of(context, builder, kind, data, shape, owner=None):
    """Return a C-contiguous array at an address; without an owner it has no reference count."""
    array, word = context.make_array(kind)(context, builder), context.get_value_type(types.intp)
    size = ir.Constant(word, context.get_abi_sizeof(data.type.pointee))
    array.data, array.itemsize, array.nitems, strides = data, size, ir.Constant(word, 1), []
    for length in reversed(shape):
        strides.insert(0, size)
        size, array.nitems = builder.mul(size, length), builder.mul(array.nitems, length)
    numbers = types.UniTuple(types.intp, kind.ndim)
    array.shape = context.make_tuple(builder, numbers, shape)
    array.strides = context.make_tuple(builder, numbers, strides)
    if owner is not None:
        array.meminfo = owner
    return array._getvalue()


# ------------------------------------------------------------------------------------------ arrays
def uncounted(arrays):
    """Return an array, or a tuple of arrays, without the reference counts that slow threads."""
    return arrays


def flat(array):
    """Return all numbers of a C-contiguous array in one row, uncounted."""
    return array.reshape(-1)


def for_size():
    """Let LLVM optimise the function that calls this for size.

    Loops of unknown lengths are not vectorised, with tests at run time: that compiles faster.
    """


def room(shape):
    """Return an uninitialised array that begins at a cache line.

    Vectors that straddle two lines take up to 1.5 times as long, and NumPy's arrays begin anywhere.
    """
    return np.empty(shape)


def block_of(rows, lanes):
    """Return the function that makes a block (rows, lanes) for a kernel, of some normal number.

    It lies on the stack of the kernel and begins at a cache line: a thread needs 64 KiB of stack.
    The compiler knows its shape, and so that its rows do not overlap.
    """

    def block():
        return np.ones((rows, lanes))

    type_callable(block)(lambda context: lambda: types.Array(types.float64, 2, "C"))

    @lower_builtin(block)
    def emit(context, builder, signature, arguments):
        with builder.goto_entry_block():
            memory = builder.alloca(ir.DoubleType(), rows * lanes)
        memory.align, byte, word = 8 * LINE, ir.IntType(8), context.get_value_type(types.intp)
        # Doubles of bytes that are 63 are about 5e-4: lanes of no trajectory are as fast as others.
        data, size = builder.bitcast(memory, byte.as_pointer()), ir.Constant(word, 8 * rows * lanes)
        fill = builder.module.declare_intrinsic("llvm.memset", [data.type, word])
        builder.call(fill, [data, ir.Constant(byte, 63), size, ir.Constant(ir.IntType(1), 0)])
        shape = [ir.Constant(word, rows), ir.Constant(word, lanes)]
        return array_of(context, builder, signature.return_type, memory, shape)

    return block


type_callable(for_size)(lambda context: lambda: types.none)
type_callable(uncounted)(lambda context: lambda arrays: arrays)
type_callable(flat)(lambda context: lambda array: types.Array(array.dtype, 1, "C"))
type_callable(room)(lambda context: lambda shape: types.Array(types.float64, len(shape), "C"))


@lower_builtin(for_size)
def _for_size(context, builder, signature, arguments):
    builder.function.attributes.add("optsize")
    return context.get_dummy_value()


@lower_builtin(uncounted, types.Any)
def _uncounted(context, builder, signature, arguments):
    return uncounted_value(context, builder, signature.args[0], arguments[0])


@lower_builtin(flat, types.Array)
def _flat(context, builder, signature, arguments):
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    return array_of(context, builder, signature.return_type, array.data, [array.nitems])


@lower_builtin(room, types.BaseTuple)
def _room(context, builder, signature, arguments):
    lengths, kind = builder.extract_value, signature.return_type
    shape = [
        context.cast(builder, lengths(arguments[0], k), each, types.intp)
        for k, each in enumerate(signature.args[0])
    ]
    size = ir.Constant(shape[0].type, 8)
    for length in shape:
        size = builder.mul(size, length)
    owner = context.nrt.meminfo_alloc_aligned(builder, size, 8 * LINE)
    data = context.nrt.meminfo_data(builder, owner)
    data = builder.bitcast(data, ir.DoubleType().as_pointer())
    return array_of(context, builder, kind, data, shape, owner)


# ------------------------------------------------------------------------------------------- lines
# Eight lanes in a register: a loop over lines is SIMD whatever the number of lanes, and whatever
# LLVM knows of the rows. NUMBA_BOUNDSCHECK does not check the indices of lines, pairs and rows.
class _Line(types.Type):
    """The type of eight numbers in a register."""


_LINE, _VECTOR = _Line("line"), ir.VectorType(ir.DoubleType(), LINE)


@register_model(_Line)
class _LineModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _VECTOR)


def load(b, row, l):
    """Return the line that begins at b[row, l], for a C-contiguous b; l may be beyond the row."""
    first = row * b.shape[1] + l
    return b.reshape(-1)[first : first + LINE].copy()


def store(b, row, l, line):
    """Write a line to b, from b[row, l] on."""
    first = row * b.shape[1] + l
    b.reshape(-1)[first : first + LINE] = line


def line_of(number):
    """Return a line of equal numbers."""
    return np.full(LINE, number)


def load_pairs(b, row, l, source, i):
    """Copy pairs from source[i] on, in turns, to the lines b[row, l:] and b[row + 1, l:]."""
    b[row, l : l + LINE] = source[i : i + 2 * LINE : 2]
    b[row + 1, l : l + LINE] = source[i + 1 : i + 2 * LINE : 2]


def store_pairs(target, i, b, row, l):
    """Copy the lines from b[row, l] and b[row + 1, l] on, in turns, to target[i] and so on."""
    target[i : i + 2 * LINE : 2] = load(b, row, l)
    target[i + 1 : i + 2 * LINE : 2] = load(b, row + 1, l)


def stream_pairs(target, i, b, row, l):
    """As `store_pairs`, to two whole cache lines, past the caches: twice as fast."""
    store_pairs(target, i, b, row, l)


def copy_row(b, row, target, j, i, count):
    """Copy b[row, :count] to target[j, i : i + count]."""
    target[j, i : i + count] = b[row, :count]


type_callable(load)(lambda context: lambda b, row, l: _LINE)
type_callable(store)(lambda context: lambda b, row, l, line: types.none)
type_callable(line_of)(lambda context: lambda number: _LINE)
type_callable(load_pairs)(lambda context: lambda b, row, l, source, i: types.none)
type_callable(store_pairs)(lambda context: lambda target, i, b, row, l: types.none)
type_callable(stream_pairs)(lambda context: lambda target, i, b, row, l: types.none)
type_callable(copy_row)(lambda context: lambda b, row, target, j, i, count: types.none)


def _address(context, builder, kinds, array, *place):
    """Return the address of the line from array[place] on, for `kinds` of array and place."""
    numbers, first = context.make_array(kinds[0])(context, builder, array), None
    for k, (each, kind) in enumerate(zip(place, kinds[1:], strict=True)):
        index = context.cast(builder, each, kind, types.intp)
        length = builder.extract_value(numbers.shape, k)
        first = index if first is None else builder.add(builder.mul(first, length), index)
    return builder.bitcast(builder.gep(numbers.data, [first]), _VECTOR.as_pointer())


@lower_builtin(load, types.Array, types.Integer, types.Integer)
def _load(context, builder, signature, arguments):
    return builder.load(_address(context, builder, signature.args, *arguments), align=8)


@lower_builtin(store, types.Array, types.Integer, types.Integer, _LINE)
def _store(context, builder, signature, arguments):
    *place, line = arguments
    builder.store(line, _address(context, builder, signature.args[:3], *place), align=8)
    return context.get_dummy_value()


@lower_builtin(line_of, types.Float)
def _line_of(context, builder, signature, arguments):
    nothing, word = ir.Constant(_VECTOR, ir.Undefined), ir.IntType(32)
    first = builder.insert_element(nothing, arguments[0], ir.Constant(word, 0))
    places = ir.Constant(ir.VectorType(word, LINE), [0] * LINE)
    return builder.shuffle_vector(first, nothing, places)


def _shuffle(builder, lines, order):
    """Return a line of the numbers of two lines, in this order."""
    return builder.shuffle_vector(*lines, ir.Constant(ir.VectorType(ir.IntType(32), LINE), order))


def _plus(builder, index, k):
    return builder.add(index, ir.Constant(index.type, k))


_PAIRS = types.Array, types.Integer, types.Array, types.Integer, types.Integer


@lower_builtin(load_pairs, types.Array, types.Integer, types.Integer, types.Array, types.Integer)
def _load_pairs(context, builder, signature, arguments):
    kinds, (b, row, l, source, i) = signature.args, arguments
    lines = [
        builder.load(_address(context, builder, kinds[3:], source, _plus(builder, i, k)), align=8)
        for k in (0, LINE)
    ]
    for k in range(2):
        place = _address(context, builder, kinds[:3], b, _plus(builder, row, k), l)
        line = _shuffle(builder, lines, [*range(k, 2 * LINE, 2)])
        builder.store(line, place, align=8)
    return context.get_dummy_value()


def _emit_pairs(context, builder, kinds, arguments, align):
    """Emit the two stores of a pair of lines, and return them."""
    target, i, b, row, l = arguments
    lines = [
        builder.load(_address(context, builder, kinds[2:], b, _plus(builder, row, k), l), align=8)
        for k in range(2)
    ]
    stores = []
    for k in (0, LINE // 2):
        order = [k + lane // 2 + LINE * (lane % 2) for lane in range(LINE)]
        place = _address(context, builder, kinds[:2], target, _plus(builder, i, 2 * k))
        stores.append(builder.store(_shuffle(builder, lines, order), place, align=align))
    return stores


@lower_builtin(store_pairs, *_PAIRS)
def _store_pairs(context, builder, signature, arguments):
    _emit_pairs(context, builder, signature.args, arguments, 8)
    return context.get_dummy_value()


@lower_builtin(stream_pairs, *_PAIRS)
def _stream_pairs(context, builder, signature, arguments):
    past_caches = builder.module.add_metadata([ir.Constant(ir.IntType(32), 1)])
    for each in _emit_pairs(context, builder, signature.args, arguments, 8 * LINE):
        each.set_metadata("nontemporal", past_caches)
    return context.get_dummy_value()


@lower_builtin(copy_row, types.Array, types.Integer, types.Array, *[types.Integer] * 3)
def _copy_row(context, builder, signature, arguments):
    kinds, (b, row, target, j, i, count) = signature.args, arguments
    byte, bit = ir.IntType(8).as_pointer(), ir.IntType(1)
    count = context.cast(builder, count, kinds[5], types.intp)
    first = ir.Constant(count.type, 0)
    source = _address(context, builder, (*kinds[:2], types.intp), b, row, first)
    place = _address(context, builder, kinds[2:5], target, j, i)
    both = [builder.bitcast(each, byte) for each in (place, source)]
    copy = builder.module.declare_intrinsic("llvm.memcpy", [byte, byte, count.type])
    size = builder.mul(count, ir.Constant(count.type, 8))
    builder.call(copy, [*both, size, ir.Constant(bit, 0)])
    return context.get_dummy_value()


def _compute(operation, instruction):
    """Let compiled code apply an operation to two lines."""

    @type_callable(operation)
    def choose(context):
        return lambda a, b: _LINE if a == b == _LINE else None

    @lower_builtin(operation, _LINE, _LINE)
    def emit(context, builder, signature, arguments):
        return getattr(builder, instruction)(*arguments)


_compute(operator.add, "fadd")
_compute(operator.sub, "fsub")
_compute(operator.mul, "fmul")
