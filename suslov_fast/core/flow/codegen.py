"""Shared parts of functions in an integrator's text: arrays, scalar kernels, calls.

`FunctionCode` is a function with rows of the workspace; `StepCode` takes steps of SIMD packs.
"""

from math import inf

from ..llvm.text import Integers, Shared, Truth
from .code_arguments import COMPONENT, NUMBER, SLOT, CodeArguments, ComponentNumbers, SharedNumbers


class FunctionCode:
    """The base of classes that add functions of an `Integrator` to a text.

    Names of functions begin with `name`. `work` is the address of the workspace; the attribute
    `work` has an array for each of its parts. If `for_each` is True, each lane has its own table of
    f.
    """

    def __init__(self, text, integrator, name, for_each, work="%work"):
        self.text, self.integrator, self.name, self.for_each = text, integrator, name, for_each
        self.f, self.D = integrator.f, integrator.f.D
        self.extended = self.D + len(self.f.denominators)
        self.work = text.arrays(work, integrator.work)

    def call(self, function, *addresses):
        """Call a function of the integrator with the `addresses` of input, table and output."""
        self.text.invoke(f"{self.name}_{function}", *addresses, self.work.scratch)


class StepCode(FunctionCode):
    """Arrays and operations of a function that takes steps of lines, SIMD packs of W lanes.

    loaded    the arguments of the code as it began, see `CodeArguments`
    line      an array for each part of `memory.rows_of_trajectory`
    work      an array for each part of `memory.rows_of_work`
    table     the address of the table

    `line` and `table` are those of trajectories in lanes, or those that are `waiting` (`lanes`).
    """

    def __init__(self, text, integrator, name, for_each, waiting=False):
        self.arguments = Integers(text, "%arguments")
        self.loaded = CodeArguments(*(self.arguments[k] for k in SLOT))
        super().__init__(text, integrator, name, for_each, self.loaded.work)
        line, tables = self.work.line, self.work.table
        if waiting:
            line, tables = self.work.waiting, self.work.table_waiting
        self.line = text.arrays(line.at(), integrator.rows)
        self.table = tables.at() if for_each else self.loaded.table

    def has_trajectories(self):
        """Return True if any lane has a trajectory: the row `own` is 0 in lanes without one."""
        text = self.text
        own, zero = text.load(text.I, self.work.own.at()), "0" if text.W == 1 else "zeroinitializer"
        return Truth(text, text.new(f"icmp ne {text.I} {own}, {zero}")).any()

    def columns(self, x, f, count):
        """Write the ends of the first `count` columns, minus x, to `work.ends`; f is f(x)."""
        self.text.invoke(f"{self.name}_columns", x, f, self.table, self.loaded.work, count)

    @property
    def mode(self):
        """The `LaneState` of lanes that take steps with this integrator: EXPLICIT or IMPLICIT."""
        return self.text.value(float(self.integrator.rule.mode))

    def number(self, name):
        """Return the number `name`, such as "rtol", of `SharedNumbers`, which all lanes share."""
        found, f = Shared(self.text, self.loaded.numbers)[getattr(NUMBER, name)], self.f.of_x
        if name != "longest" or f.longest == inf:
            return found
        table = self.text.array(self.table) if self.for_each else Shared(self.text, self.table)
        is_constant = isinstance(f.longest, float)
        own = self.text.value(f.longest) if is_constant else table[f.places[f.longest]]
        return (own < found).select(own, found)

    def component(self, name, i):
        """Return the number `name`, such as "keeps", of component i in `ComponentNumbers`."""
        return Shared(self.text, self.loaded.components, getattr(COMPONENT, name) * self.D)[i]

    def apply(self, kernel, i=0, **inputs):
        """Apply a scalar kernel to component i; return {name: result}.

        Inputs that are not in `inputs` are found by name: numbers of all lanes, numbers of the
        component, and rows of `line` or `work`.
        """
        for name in [name for name in kernel.inputs if name not in inputs]:
            if name in SharedNumbers._fields:
                inputs[name] = self.number(name)
            elif name in ComponentNumbers._fields:
                inputs[name] = self.component(name, i)
            else:
                rows = self.line if hasattr(self.line, name) else self.work
                inputs[name] = getattr(rows, name)[0 if name in self.integrator.scalars else i]
        return self.text.apply(kernel, **inputs)

    def of_columns(self, rows, i):
        """Return a list: component i of each column. `rows` has D rows a column, as `work.ends`."""
        return [rows.after(c * self.D)[i] for c in range(len(self.integrator.rule.columns))]

    def goal(self):
        """Return the time that no step passes: the last one, or the next given time of an event."""
        last = self.number("last")
        if not self.integrator.f.hybrid.acts:
            return last
        stop = self.line.stop[0]
        return (last < stop).select(last, stop)

    def keep_largest(self, truth, i, x):
        """Raise the row `largest` of component i to |x|, in lanes where `truth` is true.

        If allowed errors are relative to |x| (RELATIVE in `lost`), it may also become smaller.
        """
        modulus, largest = abs(x), self.line.largest[i]
        is_new = modulus > largest
        if self.integrator.is_relative:
            is_new = is_new | (self.line.lost[i] < 0.0)
        self.line.largest.choose(truth, i, is_new.select(modulus, largest))

    def lanes_with(self, bits):
        """Add a loop over lanes k where bit k of `bits` is 1; yield 8 k, the offset in bytes."""
        for lane in self.text.each(self.text.W):
            bit = (bits >> lane) & 1
            with self.text.when(bit.equals(1)):
                yield lane * 8

    def put_clocks(self, one, offset, time, to):
        """Write clocks, their rates times `time`, into the state of the lane `one` at `to`.

        A sum over steps would add up rounding.
        """
        rates = one.array(self.line.f_x.at() + offset)
        sign = Shared(one, self.loaded.numbers)[NUMBER.sign]
        for clock in self.f.hybrid.offsets:
            to[clock] = rates[clock] * (sign * time)

    def keep(self, rows, found, truth=None):
        """Write found[name] to the row `name` of `rows`, for each name, in lanes `truth` or all."""
        for name, value in found.items():
            own = getattr(rows, name)
            own.put_chosen(0, value if truth is None else truth.select(value, own[0]))


def larger_of(a, b):
    """Return the larger of two `Value`s; b if one of them is NaN."""
    return (a > b).select(a, b)


def weighted(factors, values):
    """Return the sum of factors[k] * values[k], added from the first product to the last."""
    products = (factor * value for factor, value in zip(factors, values, strict=True))
    return sum(products, next(products))
