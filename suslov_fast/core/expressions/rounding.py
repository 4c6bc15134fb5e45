"""Rounding errors of the values of a program: each is a small part of the size of its value."""

from .dense_product import ENTRY, DenseMatrix, is_matrix
from .values import larger, operand_of


def sizes_of(values, operations, state, with_branches=True):
    """Return {number of a value: size}, with sizes to which rounding errors are in proportion.

    The program `values` contains a copy of `operations`: `state` is {number of an input or value:
    its operand in the copy}. Sizes are `Number`s, added to `values`. The size of a sum or
    difference is the sum of the sizes of both operands; other sizes are about the modulus. The size
    of a branch is the size of the chosen operand only if `with_branches`.
    """
    sizes = {a: abs(values.number(number)) for a, number in state.items()}
    for name, number, operands in operations:
        a, b, *_ = of = [abs(a) if isinstance(a, float) else sizes[a] for a in (*operands, 0.0)]
        size = sizes[number]
        if is_matrix(name):
            moduli = DenseMatrix(abs(name.matrix))
            size = values.number(values.emit(moduli, *map(operand_of, of[:-1])))
        elif name == ENTRY:
            size = values.number(values.emit(ENTRY, a.number, b))
        elif name in ("fadd", "fsub"):
            size = a + b
        elif name == "fmul":
            size = a * b
        elif name == "fdiv":
            divisor = operands[1]
            size = a / (b if isinstance(divisor, float) else abs(values.number(state[divisor])))
        elif name == "fabs":
            size = a
        elif with_branches and name in ("max", "min"):
            size = larger(a, b)
        elif with_branches and name == "select":
            a, b = (values.number(abs(a)) if type(a) is float else sizes[a] for a in operands[1:])
            size = values.number(state[operands[0]]).select(a, b)
        sizes[number] = size
    return sizes
