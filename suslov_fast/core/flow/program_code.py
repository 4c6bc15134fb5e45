"""Machine code of a right-hand side at states: of its table of numbers, of f, f', and tests.

The bits are the same as in NumPy, which would need a microsecond for each operation.
"""

import functools

import numpy as np

from ..expressions.programs import Program
from ..llvm.compiler import address_of, compiled
from ..llvm.text import Code, Index, Integers
from ..llvm.tolerances import WIDTH
from .vector_functions import ProgramFunction

TABLE = "table"


def _program(f, name):
    match name:
        case "f":
            return f.rates
        case "derivative":
            return f.derivative
    return f.start


@functools.lru_cache(256)
def code_of_program(f, name, W=1):
    """Return the code of a program of f, the place of the results in its memory, and its size.

    `name` is "f", "derivative", "start", or TABLE for f's table. The code reads the state (D,) and
    the table (n,), or for TABLE the parameters (P,). The results, and temporary numbers, follow in
    memory. With W > 1 the memory begins with an integer, how many blocks of this size follow; the
    numbers of a block have W lanes.
    """
    if name == TABLE:
        function, skipped, given = ProgramFunction(Program(f.fixed, f.table), f.D + f.P), f.D, f.P
        results = len(f.table)
    else:
        program = _program(f, name)
        places = {f.D + k: k for k in range(len(f.table))} if name == "start" else f.places
        function, skipped = ProgramFunction(program, f.D, places), 0
        given, results = f.D + len(f.table), len(program.results)
    size = given + results + function.scratch

    def text_of(own):
        text = Code(W)
        function.add(text, f"{own}_program", W > 1)
        text.begin(own, "memory")
        memory, rows = Index(text, "%memory"), (-skipped, f.D, given, given + results)
        if W == 1:
            text.invoke(f"{own}_program", *(memory + 8 * row for row in rows))
        else:
            for k in text.each(Integers(text, "%memory")[0]):
                block = memory + 8 + k * (8 * W * size)
                text.invoke(f"{own}_program", *(block + 8 * W * row for row in rows))
        text.add("  ret i64 1")
        return text.finished()

    code = compiled((name, W, f.key), text_of, 1)
    vars(code).setdefault("function", function)  # keeps the matrices that the code reads
    return code, slice(given, given + results), size


def by_code(f, name, *given):
    """Return the results (R,) of a program of f, see `code_of_program`: a new array.

    If the numbers given are arrays (-, B), at B states, results are (R, B).
    """
    if given[0].ndim > 1:
        return _by_code_in_lanes(f, name, np.concatenate(given))
    code, results, size = code_of_program(f, name)
    memory, begin = np.empty(size), 0
    for each in given:
        end = begin + len(each)
        memory[begin:end] = each
        begin = end
    code.call(address_of(memory))
    return memory[results]


def _by_code_in_lanes(f, name, given):
    code, results, size = code_of_program(f, name, WIDTH)
    count, B = given.shape
    blocks = -(-B // WIDTH)
    lanes, memory = np.zeros((count, blocks * WIDTH)), np.empty(1 + blocks * size * WIDTH)
    lanes[:, :B] = given
    memory[:1].view(np.int64)[0] = blocks
    rows = memory[1:].reshape(blocks, size, WIDTH)
    rows[:, :count] = lanes.reshape(count, blocks, WIDTH).transpose(1, 0, 2)
    code.call(address_of(memory))
    return rows[:, results].transpose(1, 0, 2).reshape(-1, blocks * WIDTH)[:, :B]
