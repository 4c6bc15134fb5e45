"""What Numba cannot express, as code of LLVM: calls by address, uncounted arrays, wide stores,
lines of lanes.
"""

import operator
from contextlib import suppress

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
    """Return an argument whose arrays have no reference counts, for which threads wait: `meminfo`,
    `_getvalue`. Without these names arrays have their counts.
    """
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        with suppress(AttributeError):
            array.meminfo = ir.Constant(array.meminfo.type, None)
            return array._getvalue()
        return value
    for k, each in enumerate(kind if isinstance(kind, types.BaseTuple) else ()):
        element = uncounted_value(context, builder, each, builder.extract_value(value, k))
        value = builder.insert_value(value, element, k)
    return value


@intrinsic
def streamed_pairs(typing, target, i, source, j, k):
    """Make the compiled code of `numba.stream_pairs`."""

    def emit(context, builder, signature, arguments):
        word = ir.IntType(32)
        vector = ir.VectorType(ir.DoubleType(), LINE)

        def line(which, index):
            array = context.make_array(signature.args[which])(context, builder, arguments[which])
            return builder.bitcast(builder.gep(array.data, [index]), vector.as_pointer())

        first = builder.load(line(2, arguments[3]), align=8)
        second = builder.load(line(2, arguments[4]), align=8)
        nontemporal = builder.module.add_metadata([ir.Constant(word, 1)])
        for part in range(2):
            order = [LINE // 2 * part + lane // 2 + LINE * (lane % 2) for lane in range(LINE)]
            pairs = ir.Constant(ir.VectorType(word, LINE), order)
            place = builder.add(arguments[1], ir.Constant(arguments[1].type, LINE * part))
            store = builder.store(
                builder.shuffle_vector(first, second, pairs), line(0, place), align=64
            )
            store.set_metadata("nontemporal", nontemporal)
        return context.get_dummy_value()

    return types.void(target, types.intp, source, types.intp, types.intp), emit


@intrinsic
def without_counts(typing, arrays):
    """Make the compiled code of `numba.uncounted`."""

    def emit(context, builder, signature, arguments):
        return uncounted_value(context, builder, signature.args[0], arguments[0])

    return arrays(arrays), emit


@intrinsic
def address_of(typing, numbers):
    """Return the address of the numbers of an array, for `carray`."""

    def emit(context, builder, signature, arguments):
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return types.CPointer(types.float64)(numbers), emit


def at_line(b):
    """Return b from a cache line on, uncounted: its last LINE numbers are not to be used.

    Memory as it is allocated begins anywhere, and rows that straddle lines take up to half longer.
    """
    return b


type_callable(at_line)(lambda context: lambda b: b)


@lower_builtin(at_line, types.Array)
def _at_line(context, builder, signature, arguments):
    """Move the data of an array to a line: `_getvalue`. Without this name they stay."""
    [kind], word = signature.args, ir.IntType(64)
    b = uncounted_value(context, builder, kind, arguments[0])
    array = context.make_array(kind)(context, builder, b)
    last = builder.add(builder.ptrtoint(array.data, word), ir.Constant(word, 8 * LINE - 1))
    first = builder.and_(last, ir.Constant(word, -8 * LINE))
    array.data = builder.inttoptr(first, array.data.type)
    with suppress(AttributeError):
        return array._getvalue()
    return b


# ------------------------------------------------------------------------------------------- lines
# Eight lanes in a register: a loop over lines is SIMD whatever the number of lanes, and whatever
# LLVM knows of the rows. Calls are typed and lowered here, as overloads would have to be compiled.
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


type_callable(load)(lambda context: lambda b, row, l: _LINE)
type_callable(store)(lambda context: lambda b, row, l, line: types.none)
type_callable(line_of)(lambda context: lambda number: _LINE)


def _address(context, builder, kinds, b, row, l):
    array = context.make_array(kinds[0])(context, builder, b)
    row, l = (
        context.cast(builder, each, kind, types.intp)
        for each, kind in zip((row, l), kinds[1:3], strict=True)
    )
    lanes = builder.extract_value(array.shape, 1)
    first = builder.gep(array.data, [builder.add(builder.mul(row, lanes), l)])
    return builder.bitcast(first, _VECTOR.as_pointer())


@lower_builtin(load, types.Array, types.Integer, types.Integer)
def _load(context, builder, signature, arguments):
    return builder.load(_address(context, builder, signature.args, *arguments), align=8)


@lower_builtin(store, types.Array, types.Integer, types.Integer, _LINE)
def _store(context, builder, signature, arguments):
    *place, line = arguments
    builder.store(line, _address(context, builder, signature.args, *place), align=8)
    return context.get_dummy_value()


@lower_builtin(line_of, types.Float)
def _line_of(context, builder, signature, arguments):
    nothing, word = ir.Constant(_VECTOR, ir.Undefined), ir.IntType(32)
    first = builder.insert_element(nothing, arguments[0], ir.Constant(word, 0))
    places = ir.Constant(ir.VectorType(word, LINE), [0] * LINE)
    return builder.shuffle_vector(first, nothing, places)


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
