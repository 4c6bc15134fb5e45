"""Sizes of the values of a program: the rounding error of a value is a small part of its size."""

from .dense_product import ENTRY, DenseMatrix, is_matrix
from .function_records import RECORDS
from .values import joined, larger, operand_of

_SLOPES = {"sin": "cos", "cos": "sin"}


def sizes_of(values, operations, state, with_branches=True, through=False):
    """Return {number of a value: its size before cancellation}; sizes are `Number`s in `values`.

    The size of a sum or difference is the sum of the sizes of its operands; other sizes are about
    the modulus. `state` is {number of an input or value of `operations`: its operand in `values`}.
    With `with_branches`, a branch has the size of the operand that it chooses. If rounding errors
    go `through` functions, their sizes contain changes by the sizes of their arguments: log(cosh x)
    has a size of 1 at x = 0.
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
        elif through and name in RECORDS and RECORDS[name].derivative:
            partials = RECORDS[name].partials(values.emit, *operands, number)
            for partial, argument in zip(partials, of, strict=False):
                size = size + abs(values.number(partial)) * argument
        sizes[number] = size
    return sizes


def with_phases(values, operations, state, sizes):
    """Return `sizes` plus the changes of values if arguments of sin and cos change by their sizes.

    So sin(a) at a = 1000 has a rounding error of up to 1000 units. Arguments are as in `sizes_of`,
    with all values of `operations` in `state`. Changes of other functions of sin(a) do not count.
    """
    changes = {}

    def modulus(a):
        return abs(a) if isinstance(a, float) else abs(values.number(state[a]))

    for name, number, operands in operations:
        of = [0.0 if type(a) is float else changes.get(a, 0.0) for a in operands]
        if name in _SLOPES and type(operands[0]) is int:
            slope = values.emit(_SLOPES[name], state[operands[0]])
            changes[number] = abs(values.number(slope)) * (sizes[operands[0]] + of[0])
        elif all(type(change) is float for change in of):
            continue
        elif name in ("fadd", "fsub"):
            changes[number] = of[0] + of[1]
        elif name == "fmul":
            changes[number] = of[0] * modulus(operands[1]) + of[1] * modulus(operands[0])
        elif name == "fdiv":
            changes[number] = (of[0] + of[1] * modulus(number)) / modulus(operands[1])
        elif name == "fabs":
            changes[number] = of[0]
        elif name in ("max", "min"):
            changes[number] = larger(*of)
        elif name == "select":
            changes[number] = values.number(state[operands[0]]).select(*of[1:])
    return {a: size + changes[a] if a in changes else size for a, size in sizes.items()}


def sizes_in(values):
    """Return a function: the size of an operand in `values`, with changes through functions."""
    operations, state = [*values.operations], {a: a for a in range(values.count)}
    sizes = sizes_of(values, operations, state, through=True)
    return lambda a: sizes[a] if type(a) is int else abs(values.number(a))


def moved_by_projection(values, rows):
    """Return {component: how far a projection moves it per unit of relative rounding}.

    `rows` are gradients {component: operand} of invariants. The projection to one of them moves the
    state along its gradient, by the rounding error of its terms.
    """
    moved, number = {}, values.number
    for row in filter(None, rows):
        terms = [abs(number(a) * number(j)) for j, a in row.items()]
        squares = [number(a) * number(a) for a in row.values()]
        size, square = (joined("fadd", each) for each in (terms, squares))
        part = (square > 0.0).select(size / square, 0.0)
        for j, a in row.items():
            new = abs(number(a)) * part
            moved[j] = moved[j] + new if j in moved else new
    return moved
