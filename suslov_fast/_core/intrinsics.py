"""What LLVM is told directly, since no Python code would make it emit it."""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from .vector import VECTOR, subtract_product


@intrinsic
def _subtract_product(typing_context, array, target, first, second):
    # Distances between rows are known at run time only: in a loop over so few lanes, LLVM's tests
    # for overlap would cost more than vectors gain.
    def generate(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        vector = ir.VectorType(ir.DoubleType(), VECTOR)
        places = [
            builder.bitcast(builder.gep(data, [index]), vector.as_pointer())
            for index in arguments[1:]
        ]
        values = [builder.load(place, align=8) for place in places]
        product = builder.fmul(values[1], values[2])
        builder.store(builder.fsub(values[0], product), places[0], align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, types.intp), generate


@overload(subtract_product, inline="always")
def _subtract_product_overload(array, target, first, second):
    def call(array, target, first, second):
        _subtract_product(array, target, first, second)

    return call
