"""Machine code of a right-hand side at one state: of its table of numbers, of f, and of f'.

The bits are the same as in NumPy, which would need a microsecond for each operation.
"""

import functools

import numpy as np

from ..expressions.programs import Program
from ..llvm.compiler import address_of, compiled
from ..llvm.text import Code, Index
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
def code_of_program(f, name):
    """Return the code of a program of f, the place of the results in its memory, and its size.

    `name` is "f", "derivative", "start", or TABLE for f's table. The code reads the state (D,) and
    the table (n,), or for TABLE the parameters (P,). The results, and temporary numbers, follow in
    memory.
    """
    if name == TABLE:
        function, skipped, given = ProgramFunction(Program(f.fixed, f.table), f.D + f.P), f.D, f.P
        results = len(f.table)
    else:
        program = _program(f, name)
        places = {f.D + k: k for k in range(len(f.table))} if name == "start" else f.places
        function, skipped = ProgramFunction(program, f.D, places), 0
        given, results = f.D + len(f.table), len(program.results)

    def text_of(own):
        text = Code(1)
        function.add(text, f"{own}_program", False)
        text.begin(own, "memory")
        memory = Index(text, "%memory")
        addresses = -8 * skipped, 8 * f.D, 8 * given, 8 * (given + results)
        text.invoke(f"{own}_program", *(memory + each for each in addresses))
        text.add("  ret i64 1")
        return text.finished()

    code = compiled((name, f.key), text_of, 1)
    vars(code).setdefault("function", function)  # keeps the matrices that the code reads
    return code, slice(given, given + results), given + results + function.scratch


def by_code(f, name, *given):
    """Return the results (R,) of a program of f, see `code_of_program`: a new array."""
    code, results, size = code_of_program(f, name)
    memory, begin = np.empty(size), 0
    for each in given:
        end = begin + len(each)
        memory[begin:end] = each
        begin = end
    code.call(address_of(memory))
    return memory[results]
