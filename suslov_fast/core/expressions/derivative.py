"""Derivatives of expression programs by the chain rule; they are expression programs, too."""

from .dense_product import ENTRY, along, is_matrix, products_in
from .function_records import FUNCTIONS, RECORDS
from .numpy_evaluation import OF_TRUTH_VALUES
from .tables import is_table


def gradients(values, operations, results, D, by=()):
    """Return {j: operand of the derivative with respect to j} for each operand in `results`.

    j is a component 0 to D - 1, a parameter in `by`, or an entry of a product with a dense matrix
    (see `along`). Derivatives that are 0 are missing. `operations` compute `results`; the
    operations of derivatives are added to `values`.
    """
    rows, powers = {i: {i: 1.0} for i in (*range(D), *by)}, {}
    for instruction, number, operands in operations:
        if power := _power_of(instruction, operands, powers):
            powers[number] = power
        if instruction == ENTRY or is_matrix(instruction):
            is_own = instruction == ENTRY and (by or number not in values.fixed)
            rows[number] = {number: 1.0} if is_own else {}
        elif (by or number not in values.fixed) and instruction not in OF_TRUTH_VALUES:
            rows[number] = _row(values, instruction, number, operands, rows, powers)
    return [{} if isinstance(a, float) else dict(rows.get(a, {})) for a in results]


def gradients_along(values, results, D, v):
    """Return `gradients` of `results`, and v extended by changes of entries of matrix products.

    v is {component: operand of its change}. Gradients times the new v are the changes of `results`.
    """
    products = products_in(values.operations)
    operands = [a for _, of, _ in products for a in of]
    rows = gradients(values, [*values.operations], [*operands, *results], D)
    count = len(operands)
    return rows[count:], along(values.emit, products, rows[:count], v)[1]


def _power_of(instruction, operands, powers):
    """Return (a, c) if an operation is a**c, by a product or a root; else None.

    `powers` are those of earlier operations. x**1.5 is a product, and has the derivative 0 at 0.
    """
    if instruction == "sqrt":
        return operands[0], 0.5
    if instruction == "fmul" and float not in map(type, operands):
        a, b = operands
        for base, c in (powers.get(a, (a, 1.0)), (a, 1.0)):
            for other, d in (powers.get(b, (b, 1.0)), (b, 1.0)):
                if base == other:
                    return base, c + d
    return None


def _row(values, instruction, number, operands, rows, powers):
    """Return {j: operand of the derivative} of value `number`, from the `rows` of `operands`."""
    emit = values.emit
    if instruction == "fmul" and number in powers:
        a, c = powers[number]  # a**c has the derivative c a**(c - 1) a'
        factor = emit("fmul", c, FUNCTIONS["power"].rule(values, a, c - 1.0))
        return _sum(emit, [(factor, rows.get(a, {}))])
    of = [{} if isinstance(a, float) else rows.get(a, {}) for a in operands]
    if not any(of):
        return {}
    if instruction in ("select", "max", "min"):  # the derivative of the chosen operand
        comparison = {"max": "ogt", "min": "olt"}.get(instruction)
        truth = emit(comparison, *operands) if comparison else operands[0]
        a, b = of[-2:]
        return {j: emit("select", truth, a.get(j, 0.0), b.get(j, 0.0)) for j in sorted({*a, *b})}
    if instruction in ("fadd", "fsub"):
        return _sum(emit, [(1.0, of[0]), (1.0 if instruction == "fadd" else -1.0, of[1])])
    if instruction == "fmul":
        a, b = operands
        return _sum(emit, [(b, of[0]), (a, of[1])])
    if instruction == "fdiv":  # (a' - (a / b) b') / b
        row = _sum(emit, [(1.0, of[0]), (emit("fmul", -1.0, number), of[1])])
        return {j: emit("fdiv", slope, operands[1]) for j, slope in row.items()}
    if instruction == "fabs":
        (a,) = operands
        sign = emit("select", emit("olt", a, 0.0), -1.0, 0.0)
        return _sum(emit, [(emit("select", emit("ogt", a, 0.0), 1.0, sign), of[0])])
    if is_table(instruction):
        partials = (emit(instruction.derivative, *operands),)
    else:
        partials = RECORDS[instruction].partials(emit, *operands, number)
    return _sum(emit, zip(partials, of, strict=True))


def _sum(emit, pairs):
    """Return the sum of factor * row over `pairs` (factor, row) of rows {component: operand}."""
    total = {}
    for factor, row in pairs:
        constant = factor if isinstance(factor, float) else None
        if constant == 1.0 and not total:
            total = dict(row)
            continue
        for j, slope in () if constant == 0.0 else row.items():
            if constant == -1.0 and j in total:
                total[j] = emit("fsub", total[j], slope)
            else:
                part = slope if constant == 1.0 else emit("fmul", factor, slope)
                total[j] = emit("fadd", total[j], part) if j in total else part
    return total
