"""The LLVM code of `instructions`.

Only the documented extension API is used: numba.extending.intrinsic and numba.types. An intrinsic
takes the types of its arguments, and returns its signature and a function `emit`, which takes the
values in LLVM and writes the code.
"""

import math
import operator

from llvmlite import binding, ir
from numba import config, types
from numba.core.errors import RequireLiteralValue
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

LINE = 8  # numbers of a cache line, and of the longest vector
_DOUBLE, _BYTE, _WORD = ir.DoubleType(), ir.IntType(8), ir.IntType(64)
# Intel's processors evict a line that is prefetched for writing before a non-temporal store: rows
# then take 1.4 times as long. On AMD's they take as much longer without the prefetch.
_PREFETCHES = binding.get_host_cpu_name().startswith("znver")


@intrinsic
def fma(typing, a, b, c):
    def emit(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), emit


class Stack(types.Type):
    """Floats on the stack: a pointer, which Numba compiles faster than the seven numbers of an
    array, and whose references it does not count.

    The sizes are part of the type; that of the first axis only if indices are checked, so that
    fewer functions are compiled.
    """

    def __init__(self, sizes):
        self.sizes = sizes if config.BOUNDSCHECK else (0, *sizes[1:])
        super().__init__(f"stack{self.sizes}")


@register_model(Stack)
class _StackModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _DOUBLE.as_pointer())


def _allocate(builder, count):
    """Return memory for uninitialised floats in the calling function, on a cache line."""
    with builder.goto_entry_block():
        memory = builder.alloca(ir.ArrayType(_DOUBLE, count))
        memory.align = 64
    return builder.bitcast(memory, _DOUBLE.as_pointer())


@intrinsic(prefer_literal=True)
def stack(typing, *shape):
    if not all(isinstance(each, types.Literal) for each in shape):
        raise RequireLiteralValue("expected constant sizes")
    sizes = tuple(each.literal_value for each in shape)

    def emit(context, builder, signature, arguments):
        return _allocate(builder, math.prod(sizes))

    return Stack(sizes)(types.StarArgTuple.from_types(shape)), emit


@intrinsic(prefer_literal=True)
def rows_of(typing, kind, lanes):
    named = kind.instance_class
    row = Stack((lanes.literal_value,))
    result = types.NamedUniTuple(row, len(named._fields), named)

    def emit(context, builder, signature, arguments):
        rows = [_allocate(builder, lanes.literal_value) for _ in named._fields]
        return context.make_tuple(builder, result, rows)

    return result(kind, lanes), emit


def _place(context, builder, kinds, values):
    """Return a pointer to a number, from the types and the values of an array and an index."""
    (kind, index_kind), (value, index) = kinds, values
    indices = [index]
    if isinstance(index_kind, types.BaseTuple):
        indices = [builder.extract_value(index, axis) for axis in range(len(index_kind))]
    if isinstance(kind, Stack):
        place = _WORD(0)
        for each, size in zip(indices, kind.sizes, strict=True):
            if config.BOUNDSCHECK:
                with builder.if_then(builder.icmp_unsigned(">=", each, _WORD(size))):
                    context.call_conv.return_user_exc(builder, IndexError, ("on the stack",))
            place = builder.add(builder.mul(place, _WORD(size)), each)
        return builder.gep(value, [place], inbounds=True)
    array = context.make_array(kind)(context, builder, value)
    byte = builder.bitcast(array.data, _BYTE.as_pointer())
    for axis, each in enumerate(indices[:-1]):
        byte = builder.gep(byte, [builder.mul(each, builder.extract_value(array.strides, axis))])
    return builder.gep(builder.bitcast(byte, _DOUBLE.as_pointer()), indices[-1:])


@intrinsic
def borrowed(typing, array):
    def emit(context, builder, signature, arguments):
        view = context.make_array(array)(context, builder, arguments[0])
        view.meminfo = ir.Constant(view.meminfo.type, None)
        return view._getvalue()

    return array(array), emit


@type_callable(operator.getitem)
@type_callable(operator.setitem)
def _type_of_item(context):
    def type_of(kind, index, number=None):
        result = types.float64 if number is None else types.void
        return result if isinstance(kind, Stack) else None

    return type_of


@lower_builtin(operator.getitem, Stack, types.Any)
def _get(context, builder, signature, arguments):
    return builder.load(_place(context, builder, signature.args, arguments))


@lower_builtin(operator.setitem, Stack, types.Any, types.Any)
def _set(context, builder, signature, arguments):
    number = context.cast(builder, arguments[2], signature.args[2], types.float64)
    builder.store(number, _place(context, builder, signature.args[:2], arguments[:2]))


def _numbers_of(kind):
    """Return the type of the numbers of a lane, for that of a row or of a NamedTuple."""
    if isinstance(kind, Stack):
        return types.float64
    return types.BaseTuple.from_types([_numbers_of(each) for each in kind], kind.instance_class)


def _load(context, builder, kind, rows, index):
    """Return the number of a lane of a row, or the tuple of those of a NamedTuple."""
    if isinstance(kind, Stack):
        return builder.load(_place(context, builder, (kind, types.intp), (rows, index)))
    numbers = [
        _load(context, builder, each, builder.extract_value(rows, k), index)
        for k, each in enumerate(kind)
    ]
    return context.make_tuple(builder, _numbers_of(kind), numbers)


@intrinsic
def lane(typing, rows, l):
    def emit(context, builder, signature, arguments):
        return _load(context, builder, rows, *arguments)

    return _numbers_of(rows)(rows, types.intp), emit


@intrinsic
def put(typing, rows, l, numbers):
    kinds = list(numbers) if isinstance(numbers, types.BaseTuple) else [numbers]

    def emit(context, builder, signature, arguments):
        where, index, value = arguments
        for k, kind in enumerate(kinds):
            number = value if kind is numbers else builder.extract_value(value, k)
            if isinstance(rows, types.BaseTuple):
                row = builder.extract_value(where, k), index
                place = _place(context, builder, (rows.dtype, types.intp), row)
            else:
                first = _place(context, builder, (rows, types.intp), (where, index))
                place = builder.gep(first, [_WORD(k)], inbounds=True)
            builder.store(context.cast(builder, number, kind, types.float64), place)
        return context.get_dummy_value()

    return types.void(rows, types.intp, numbers), emit


def _line(context, builder, signature, arguments, k):
    """Return a pointer to a vector in argument k, whose indices follow it."""
    number = _place(context, builder, signature.args[k : k + 2], arguments[k : k + 2])
    return builder.bitcast(number, ir.VectorType(_DOUBLE, LINE).as_pointer())


@intrinsic
def subtract_product(typing, target, i, factor, j, source, k):
    def emit(context, builder, signature, arguments):
        lines = [_line(context, builder, signature, arguments, n) for n in (0, 2, 4)]
        before, v, w = (builder.load(each, align=8) for each in lines)
        builder.store(builder.fsub(before, builder.fmul(v, w)), lines[0], align=8)
        return context.get_dummy_value()

    return types.void(target, i, factor, j, source, k), emit


@intrinsic
def stream_line(typing, target, i, source, j):
    def emit(context, builder, signature, arguments):
        source, target = (_line(context, builder, signature, arguments, k) for k in (2, 0))
        store = builder.store(builder.load(source, align=8), target, align=64)
        one = ir.Constant(ir.IntType(32), 1)
        store.set_metadata("nontemporal", builder.module.add_metadata([one]))
        return context.get_dummy_value()

    return types.void(target, i, source, j), emit


@intrinsic
def expect_store(typing, target, i):
    def emit(context, builder, signature, arguments):
        if _PREFETCHES:
            byte, word = _BYTE.as_pointer(), ir.IntType(32)
            kind = ir.FunctionType(ir.VoidType(), (byte, word, word, word))
            prefetch = builder.module.declare_intrinsic("llvm.prefetch", (byte,), kind)
            place = builder.bitcast(_place(context, builder, signature.args, arguments), byte)
            builder.call(prefetch, (place, word(1), word(3), word(1)))  # to write, keep, data
        return context.get_dummy_value()

    return types.void(target, types.intp), emit


def _call_at(context, builder, address, values):
    """Call the function at an address, which returns None."""
    kind = ir.FunctionType(context.get_value_type(types.none), [each.type for each in values])
    builder.call(builder.inttoptr(address, kind.as_pointer()), values)


@intrinsic
def call(typing, address, numbers):
    """Call a compiled function by its address, with a tuple of integers."""

    def emit(context, builder, signature, arguments):
        values = [builder.extract_value(arguments[1], k) for k in range(len(numbers))]
        _call_at(context, builder, arguments[0], values)
        return context.get_dummy_value()

    return types.void(types.int64, numbers), emit


def _borrowed(context, builder, kind, value):
    """Return an argument whose arrays count no references, which threads would wait for."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = ir.Constant(array.meminfo.type, None)
        return array._getvalue()
    for k, each in enumerate(kind if isinstance(kind, types.BaseTuple) else ()):
        element = _borrowed(context, builder, each, builder.extract_value(value, k))
        value = builder.insert_value(value, element, k)
    return value


@intrinsic
def pack(typing, arguments):
    """Return the address of a function, and that of its data, for use while the caller runs.

    function(kernel, data, part, parts) calls the kernel at an address with all arguments.
    """
    result = types.UniTuple(types.int64, 2)

    def emit(context, builder, signature, values):
        packed = _borrowed(context, builder, arguments, values[0])
        with builder.goto_entry_block():
            memory = builder.alloca(packed.type)
        builder.store(packed, memory)
        kind = ir.FunctionType(context.get_value_type(types.none), [_WORD] * 4)
        function = ir.Function(builder.module, kind, f"{builder.function.name}.part")
        function.linkage = "internal"
        kernel, data, part, parts = function.args
        inner = ir.IRBuilder(function.append_basic_block())
        packed = inner.load(inner.inttoptr(data, packed.type.as_pointer()))
        numbers = [inner.extract_value(packed, k) for k in range(len(arguments))]
        _call_at(context, inner, kernel, [part, parts, *numbers])
        inner.ret(context.get_dummy_value())
        addresses = [builder.ptrtoint(each, _WORD) for each in (function, memory)]
        return context.make_tuple(builder, result, addresses)

    return result(arguments), emit
