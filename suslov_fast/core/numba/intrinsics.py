"""LLVM instructions: calls by address, choices without branches, and stores past the caches.

Each function brings its own typing and lowering, because an overload is itself compiled. `load` and
`gep` name their types, because pointers of later versions of llvmlite have none. What is not in
Numba's guide to extensions has no substitute here: a weekly job tests it with the next Numba.
"""

from llvmlite import ir
from numba import types
from numba.core import errors  # where Numba documents its exceptions
from numba.core.imputils import lower_constant  # `numba.extending` has the other `lower_` functions
from numba.extending import (
    intrinsic,
    lower_builtin,
    models,
    register_model,
    type_callable,
    typeof_impl,
)

LINE = 8  # doubles in a cache line
_NUMBER, _VECTOR = ir.DoubleType(), ir.VectorType(ir.DoubleType(), LINE)


def emit_call(builder, address, result, values):
    """Emit a call of the function at an address with `values`; return its value, a `result`."""
    kind = ir.FunctionType(result, [value.type for value in values])
    return builder.call(builder.inttoptr(address, kind.as_pointer()), values)


@intrinsic
def call_address(typing, address, a, b, c, d):
    """Call the function at an address with integers a, b, c and d; it returns nothing."""

    def emit(context, builder, signature, arguments):
        emit_call(builder, arguments[0], context.get_value_type(types.none), arguments[1:])
        return context.get_dummy_value()

    return types.void(*[types.int64] * 5), emit


@intrinsic
def call_code(typing, address, numbers):
    """Call the code at an address with the tuple `numbers` of integers; return its integer."""

    def emit(context, builder, signature, arguments):
        values = [builder.extract_value(arguments[1], k) for k in range(len(numbers))]
        return emit_call(builder, arguments[0], ir.IntType(64), values)

    return types.int64(types.int64, types.UniTuple(types.int64, len(numbers))), emit


class _WithAddress(types.NamedTuple):
    """Type of named tuples that begin with an address: Numba caches no code with one in it."""


register_model(_WithAddress)(models.TupleModel)


def with_address(cls):
    """Give named tuples of `cls` the type `_WithAddress`, to cache no address; return `cls`."""

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


def with_item(named, place, value):
    """Return a named tuple with another value, of the same type, at the constant index `place`."""
    return named._replace(**{named._fields[place]: value})


@type_callable(with_item)
def _type_of_with_item(context):
    def typed(named, place, value):
        if not isinstance(place, types.IntegerLiteral):
            raise errors.RequireLiteralValue("place")
        kind = named.types[place.literal_value]
        if value != kind:
            raise errors.NumbaTypeError(
                f"{named.fields[place.literal_value]} must be of type {kind}"
            )
        return named

    return typed


@lower_builtin(with_item, types.BaseTuple, types.IntegerLiteral, types.Any)
def _with_item(context, builder, signature, arguments):
    place = signature.args[1].literal_value
    result = builder.insert_value(arguments[0], arguments[2], place)
    context.nrt.incref(builder, signature.return_type, result)
    return result


def stream_pairs(target, i, b, row, l):
    """Interleave b[row, l : l + LINE] and b[row + 1, l : l + LINE] into target from index i on.

    These two whole cache lines are written past the caches, which takes half the time.
    """
    target[i : i + 2 * LINE : 2] = b[row, l : l + LINE]
    target[i + 1 : i + 2 * LINE : 2] = b[row + 1, l : l + LINE]


type_callable(stream_pairs)(lambda context: lambda target, i, b, row, l: types.none)


def _line(context, builder, kinds, array, *place):
    """Return a pointer to the cache line at array[place]; `kinds` are Numba's types of both."""
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


def select(condition, first, second):
    """Return `first` if the condition is true, else `second`; compute both, without a branch."""
    return first if condition else second


@type_callable(select)
def _type_of_select(context):
    def unified(condition, first, second):
        kind = context.unify_types(first, second)
        return kind and types.unliteral(kind)

    return unified


@lower_builtin(select, types.Boolean, types.Any, types.Any)
def _select(context, builder, signature, arguments):
    pairs = zip(arguments[1:], signature.args[1:], strict=True)
    both = [context.cast(builder, *pair, signature.return_type) for pair in pairs]
    return builder.select(arguments[0], *both)
