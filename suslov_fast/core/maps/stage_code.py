"""Machine code of one stage of a field: straight-line code made from an expression program.

The code takes a line of W lanes. Its values stay in registers, and are bitwise identical to the
values of `evaluate` in NumPy. `driver` and `text_of_stage`, for loops of users, use `Stage`.
"""

from ..expressions.tolerances import OPERATIONS_OF_BLOCK
from ..llvm.text import Code, Shared, Truth, Value
from ..numba.status_codes import CHANGED


class Stage:
    """Writer of code for one stage of a `Step`, on a vector of lanes; `values` has its values.

    load(number) returns a value that no operation computes: a component of x, or a table value.
    """

    def __init__(self, text, step, load):
        self.text, self.step, self.load, self.values = text, step, load, {}

    def take(self, x):
        """Add the code of the usual operations on the state x; return the next state."""
        self.values = dict(enumerate(x))
        self.carry_out(self.step.usual, self.values)
        return self.results()

    def results(self):
        """Return the next state after the usual operations."""
        return self._results(self.values, self.step.after)

    def carry_out(self, operations, values):
        """Add the code of operations, in blocks if many; results go to `values` by number."""
        size = OPERATIONS_OF_BLOCK if self.step.is_long else len(operations)
        for begin in range(0, len(operations), max(size, 1)):
            if begin:
                self.text.next_block()
            self.text.carry_out(operations[begin : begin + size], values, self.load)

    def _results(self, values, numbers):
        load, text = self.load, self.text
        return [Value(text, values[k] if k in values else load(k)) for k in numbers]

    def is_good(self):
        """Return a truth value of the code: true if the usual operations suffice in all lanes."""
        return Truth(self.text, self.values[self.step.good]).all()

    def take_rare(self):
        """Add operations that few steps need; return (next state, `accurate`, its bits, `signs`).

        `accurate` is true in lanes in which the next state is. Bits of `signs` mark lanes with
        det A < 0; bits from CHANGED on mark lanes in which a component changed its sign.
        """
        text, step, values = self.text, self.step, dict(self.values)
        self.carry_out(step.rare, values)
        accurate = Truth(text, values[step.accurate])
        signs = Truth(text, values[step.negative]).bits()
        if step.changed is not None:
            signs = signs | Truth(text, values[step.changed]).bits() << CHANGED
        after = self._results(values, step.after_rare)
        return after, accurate, accurate.bits(), signs


def loader(text, step, for_each, state, table):
    """Return the `load` of a `Stage` for the addresses of the state and of the table of a line."""
    x, values = text.array(state), text.array(table) if for_each else Shared(text, table)

    def load(number):
        return x[number] if number < step.D else values[step.places[number]]

    return load


def text_of_stage(step, name, *_):
    """Return LLVM's text of i64 name(x, table), which takes a stage of one state in place.

    Arguments are addresses. The code returns 1, and leaves the state, if the stage is not accurate.
    Otherwise it returns 0, plus 256 if det A < 0, plus 65536 if a component changed its sign.
    """
    text = Code(1)
    text.begin(name, "x", "table")
    stage = Stage(text, step, loader(text, step, False, "%x", "%table"))
    x = text.array("%x")
    usual = stage.take([x[i] for i in range(step.D)])

    def rare():
        after, accurate, _, signs = stage.take_rare()
        with text.when(~accurate):
            text.leave("i64 1")
        return [*after, signs << 8]

    if step.of is None:
        *final, bits = text.otherwise(stage.is_good(), [*usual, 0], rare)
    else:
        final, bits = usual, 0
        with text.when(~Truth(text, stage.values[step.accurate])):
            text.leave("i64 1")
    for k, number in enumerate(step.after):
        if number != k:
            x[k] = final[k]
    text.add(f"  ret i64 {bits}")
    return text.finished()
