"""What Numba cannot express, as code of LLVM: calls by address, uncounted arrays, wide stores."""

from contextlib import suppress

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

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
