"""Lists carried out in NumPy with one call for all operations that are alike and independent.

For one state of many variables, a call of NumPy for each operation would take most of the time.
"""

import numpy as np

from .kahan_step import FUNCTIONS

_JOINING = ("and", "or", "xor")


class Groups:
    """The operations of a list in groups of one instruction, after those of their operands.

    Each value has a row of a table: first constants, then what is given, then groups one after
    another. Truth values stand there as 0 and 1.
    """

    def __init__(self, program, given):
        operations, results = program
        read = [a for *_, operands in operations for a in operands] + results
        self.constants = {repr(a): a for a in read if isinstance(a, float)}
        rows = {text: row for row, text in enumerate(self.constants)}
        rows |= {number: len(rows) + k for k, number in enumerate(given)}

        def row_of(a):
            return rows[repr(a) if isinstance(a, float) else a]

        levels, groups = {}, {}
        for instruction, number, operands in operations:
            below = (levels.get(a, 0) for a in operands if not isinstance(a, float))
            levels[number] = 1 + max(below, default=0)
            groups.setdefault((levels[number], instruction), []).append((number, operands))
        self.groups, self.count = [], len(rows)
        for (_, instruction), group in sorted(groups.items()):
            end = self.count + len(group)
            rows |= {number: self.count + k for k, (number, _) in enumerate(group)}
            columns = zip(*(operands for _, operands in group), strict=True)
            places = [np.array([*map(row_of, column)]) for column in columns]
            self.groups.append((instruction, slice(self.count, end), places))
            self.count = end
        self.results = np.array([*map(row_of, results)], np.intp)

    def carried_out(self, given, shape):
        """Return the results (R, ...) for what is given, arrays that broadcast to `shape`."""
        table, first = np.empty((self.count, *shape)), len(self.constants)
        for row, constant in enumerate(self.constants.values()):
            table[row] = constant
        for row, values in enumerate(given, first):
            table[row] = values
        for instruction, place, operands in self.groups:
            numbers = [table[rows] for rows in operands]
            if instruction in _JOINING:
                numbers = [number != 0.0 for number in numbers]
            elif instruction == "select":
                numbers[0] = numbers[0] != 0.0
            table[place] = FUNCTIONS[instruction](*numbers)
        return table[self.results]
