"""The variational equations of a right-hand side: V' = f'(x) V, and the trace of f'."""

import functools

from .right_hand_side import Expressions, RightHandSide


@functools.lru_cache(64)
def variational(f):
    """Return the right-hand side of x, the columns of V, u and s, where u' = 0, s' = u trace f'.

    V has rows and columns for the components of x but for clocks, and stands column by column.
    u is a size that states of V have, because they and s should count as much as x in the error.
    Its parameters are the table of f. What implicit steps take for f' is block-diagonal: a block
    for x, and one for each column.
    """
    D, moving = f.D, [i for i in range(f.D) if i not in f.clocks]
    n = len(moving)
    size = D + n * n + 2
    first = {j: D + place for place, j in enumerate(moving)}  # of column 0 of V
    given = range(size, size + len(f.table))
    values = Expressions(given.stop, given)
    number = {i: i for i in range(D)} | dict(zip(f.table, given, strict=True))

    def renumbered(operand):
        return operand if isinstance(operand, float) else number[operand]

    for instruction, own, operands in [*f.f.operations, *f.derivative.operations]:
        if own not in number:
            number[own] = values.emit(instruction, *map(renumbered, operands))
    results = [renumbered(a) for a in f.f.results]
    slopes = [{} for _ in range(D)]
    for (i, j), entry in zip(f.pattern, f.derivative.results, strict=True):
        slopes[i][j] = renumbered(entry)
    rows = [*slopes]
    for column in range(n):
        for i in moving:
            own = {first[j] + column * n: a for j, a in slopes[i].items() if j in first}
            results.append(_sum(values.emit, [values.emit("fmul", a, j) for j, a in own.items()]))
            rows.append(own)
    trace = _sum(values.emit, [slopes[i][i] for i in moving if i in slopes[i]])
    results += [0.0, values.emit("fmul", size - 2, trace)]
    return RightHandSide(values, results, len(given), [*rows, {}, {}])


def _sum(emit, terms):
    return functools.reduce(lambda a, b: emit("fadd", a, b), terms) if terms else 0.0
