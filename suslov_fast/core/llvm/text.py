"""LLVM's intermediate representation as text: values and arrays with operators, loops, conditions.

Addresses are integers, because versions of LLVM write the types of pointers differently.
Python's operators add instructions to the text, from left to right as Python carries them out:

    for i in text.each(D):
        b[i] = x[i] + s * f[i]

adds a loop with two loads, a product, a sum and a store. `Value` is W numbers, `Truth` their truth
values, `Index` an integer; `Array`, `Shared` and `Integers` are memory that brackets read and
write. Loops are `Code.each` and `Code.rounds`, which carry on values in a `Carried`.
"""

import itertools
import struct
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np

from ..expressions.elementary import LARGE_ANGLE, OF_ANGLES, list_of
from ..expressions.numpy_evaluation import OF_BITS, OF_LIBRARY, OF_LISTS, OF_TRUTH_VALUES
from ..expressions.tables import LARGEST, Table, is_table
from .compiler import pointer
from .tolerances import MANY_ROWS, ROWS_OF_FILL

_NUMBER, _BITS = struct.Struct("d"), struct.Struct("Q")


# -------------------------------------------------------------------------------------- the names
class _Name:
    """A named value in a text. `str()` is the name, so that it may stand in any instruction."""

    __array_ufunc__ = None  # numbers of NumPy leave their operators to this class
    __bool__ = None  # `if` is an error, because there are no values yet: write `when` or `select`

    def __init__(self, text, name):
        self.text, self.name = text, str(name)

    def __str__(self):
        return self.name

    def _number(self, operand):
        """Return an operand as it stands in instructions; `Value` writes floats as constants."""
        return operand

    def _operate(self, instruction, a, b):
        a, b = self._number(a), self._number(b)
        return type(self)(self.text, self.text.known(f"{instruction} {self.kind} {a}, {b}"))


def _add_operators(cls, **instructions):
    for name, how in instructions.items():
        setattr(cls, f"__{name}__", lambda self, other, how=how: self._operate(how, self, other))
        setattr(cls, f"__r{name}__", lambda self, other, how=how: self._operate(how, other, self))


class Truth(_Name):
    """Truth values of all lanes, or a single truth value, with `&`, `|`, `^` and `~`."""

    def __init__(self, text, name, kind=None):
        super().__init__(text, name)
        self.kind = kind or text.M

    def _operate(self, instruction, a, b):
        name = self.text.new(f"{instruction} {self.kind} {a}, {b}")
        return Truth(self.text, name, self.kind)

    def __invert__(self):
        """Return the negated truth values."""
        return self ^ ("true" if self.kind == "i1" else self.text.truth(True))

    def select(self, a, b):
        """Return a in lanes where this is true, b in others; a and b are numbers or integers."""
        value = b if isinstance(b, _Name) else self.text.value(a)
        a, b = value._number(a), value._number(b)
        name = f"select {self.kind} {self}, {value.kind} {a}, {value.kind} {b}"
        return type(value)(value.text, value.text.new(name))

    def _packed(self):
        """Return an integer with a bit for each lane (or one truth value), and its LLVM type."""
        if self.kind == "i1":
            return self, self.kind
        kind = f"i{self.text.W}"
        return self.text.new(f"bitcast {self.kind} {self} to {kind}"), kind

    def bits(self):
        """Return the truth values as an integer `Index`; bit k is 1 if lane k is true."""
        bits, kind = self._packed()
        return Index(self.text, self.text.new(f"zext {kind} {bits} to i64"))

    def any(self):
        """Return a single truth value: whether any lane is true."""
        return self._compared("ne", 0)

    def all(self):
        """Return a single truth value: whether all lanes are true."""
        return self._compared("eq", -1)

    def _compared(self, how, number):
        if self.kind == "i1":
            return self
        bits, kind = self._packed()
        return Truth(self.text, self.text.new(f"icmp {how} {kind} {bits}, {number}"), "i1")


class _Comparable(_Name):
    """A value with methods `equals` and `differs`; `==` compares objects, as keys of dicts."""

    def _compare(self, how, other):
        comparison = f"{self.comparison} {how} {self.kind} {self}, {self._number(other)}"
        return Truth(self.text, self.text.known(comparison), self.of_comparison)

    def equals(self, other):
        return self._compare(self.equal, other)

    def differs(self, other):
        return self._compare(self.different, other)


class Value(_Comparable):
    """W numbers, with `+`, `-`, `*`, `/`, `abs` and comparisons; a float means W equal numbers."""

    comparison, equal, different = "fcmp", "oeq", "une"
    kind = property(lambda self: self.text.V)
    of_comparison = property(lambda self: self.text.M)

    def _number(self, operand):
        return self.text.constant(operand) if isinstance(operand, float) else operand

    def __abs__(self):
        return Value(self.text, self.text._call("fabs", self))

    def sqrt(self):
        return Value(self.text, self.text._call("sqrt", self))

    def floor(self):
        return Value(self.text, self.text._call("floor", self))


class Index(_Comparable):
    """An integer, or an address, with operators; `<`, `<=`, ... and `//` are unsigned."""

    comparison, equal, different, kind, of_comparison = "icmp", "eq", "ne", "i64", "i1"

    def _operate(self, instruction, a, b):
        if instruction == "add" and isinstance(b, int) and b == 0:
            return a
        return super()._operate(instruction, a, b)


_add_operators(Truth, **{"and": "and", "or": "or", "xor": "xor"})
_add_operators(Value, add="fadd", sub="fsub", mul="fmul", truediv="fdiv")
_add_operators(Index, add="add", sub="sub", mul="mul", floordiv="udiv", lshift="shl", rshift="lshr",
               **{"and": "and", "or": "or", "xor": "xor"})  # fmt: skip
for _cls, _marks in ((Value, "o"), (Index, "u")):
    for _name in ("lt", "le", "gt", "ge"):
        setattr(
            _cls, f"__{_name}__", lambda self, other, how=_marks + _name: self._compare(how, other)
        )


# ------------------------------------------------------------------------------------- the memory
class Array:
    """Rows of W numbers at an address; `a[i]` reads row i, and `a[i] = value` writes it."""

    def __init__(self, text, base, first=0):
        self.text, self.base, self.first = text, base, first

    def at(self, i=0):
        """Return the address of row i."""
        return Index(self.text, self._place(i))

    def _place(self, i):
        return self.text.place(self.base, self.first, i)

    def after(self, k):
        """Return the array that begins at row k of this one."""
        return type(self)(self.text, self.base, self.first + k)

    def from_here(self, i=0):
        """Return the array that begins at row i of this one; its address is computed here, once."""
        return type(self)(self.text, self.at(i))

    def __getitem__(self, i):
        return Value(self.text, self.text.load(self.text.V, self._place(i)))

    def __setitem__(self, i, value):
        self.text.store(self.text.V, self.text.value(value), self._place(i))

    def put_chosen(self, i, value):
        """Write a `select` with row i to row i; volatile, because masked stores would be slow."""
        self.text.store(self.text.V, self.text.value(value), self._place(i), how="volatile ")

    def choose(self, truth, i, value):
        """Write `value` to row i in lanes where `truth` is true; other lanes keep their number."""
        self.put_chosen(i, truth.select(value, self[i]))


class Shared(Array):
    """Numbers of 8 bytes at an address, which all lanes share."""

    def _place(self, i):
        return Index(self.text, self.base) + 8 * self.first + i * 8

    def __getitem__(self, i):
        return self.text.splat(self.text.load("double", self._place(i)))


class Integers(Shared):
    """Integers of 8 bytes at an address."""

    def __getitem__(self, i):
        return Index(self.text, self.text.load("i64", self._place(i)))

    def __setitem__(self, i, value):
        self.text.store("i64", value, self._place(i))


class Intervals:
    """Intervals of a `Table` as constants: rows of low ends, high ends, heights and slopes.

    The four rows are `bytes` apart; inf fills each row up to 2**n numbers.
    """

    def __init__(self, text, table, name=None):
        count = table.rows.shape[1]
        self.half = max(2 ** (count - 1).bit_length() // 2, 1)
        self.text, self.bytes = text, 16 * self.half
        numbers = np.full((Table.ROWS, 2 * self.half), np.inf)
        numbers[:, :count] = table.rows
        self.base = text.constants(numbers, name).base

    def holding(self, x, less=0.0):
        """Return the address of the low end of the interval that holds x + less, in one lane."""
        for now in self.text.rounds(Carried(at=self.base, half=self.half)):
            above = now.at + now.half * 8
            is_above = x >= Shared(x.text, above)[0] - less
            now.half = now.half >> 1
            now.at = is_above.select(above, now.at)
            now.goes_on = now.half.differs(0)
        return now.at


class Carried:
    """Loop variables by name: the body of a loop replaces them by the values of the next round.

    Floats become W equal numbers, integers an `Index`. After the loop they are the last values.
    """

    def __init__(self, **values):
        vars(self).update(values)

    def update(self, values):
        """Replace loop variables by `values`, {name: value}."""
        vars(self).update(values)


class Code:
    """The text of functions for SIMD packs of W lanes.

    V, M and I are the types of W numbers, of W truth values and of the bits of W numbers. Rows are
    `size` bytes apart. Instructions go to the text `target`, if given.
    """

    def __init__(self, W, target=None, size=None):
        self.W, self.target, self.size = W, target or self, size or 8 * W
        self.lines, self.count, self.blocks = [], 0, 0
        self.declared, self.functions, self.arrays_of_text = set(), {}, []
        self.names = {}  # {instruction: name of its value} of the basic block, see `known`
        self.V = f"<{W} x double>" if W > 1 else "double"
        self.M = f"<{W} x i1>" if W > 1 else "i1"
        self.I = f"<{W} x i64>" if W > 1 else "i64"
        self.suffix = f"v{W}f64" if W > 1 else "f64"

    def finished(self):
        """Return the text with the end of its last function, with constants and declarations."""
        return "\n".join([
            *self.arrays_of_text, *self.lines, "}", *sorted(self.declared),
            *itertools.chain(*self.functions.values()),
            # Vectors of 8 lanes are whole registers, also where LLVM prefers narrower ones. If the
            # stack were not aligned, registers saved there might straddle cache lines by chance.
            'attributes #0 = { nounwind "stackrealign" "min-legal-vector-width"="512" }',
            '!0 = !{!"branch_weights", i32 1000000, i32 1}',
            '!2 = !{!"branch_weights", i32 1, i32 1000000}', "",
        ])  # fmt: skip

    def add(self, line):
        self.target.lines.append(line)

    def new(self, instruction):
        """Add an instruction; return the new name that the text gives to its value."""
        self.target.count += 1
        self.target.lines.append(f"  %v{self.target.count} = {instruction}")
        return f"%v{self.target.count}"

    def known(self, instruction):
        """Return the name of the value of an instruction that depends on its operands alone.

        An earlier one of the same basic block serves again: most repeat addresses.
        """
        names = self.target.names
        name = names.get(instruction)
        if name is None:
            name = names[instruction] = self.new(instruction)
        return name

    def jump(self, label):
        self.add(f"  br label %{label}")

    def branch(self, truth, label, other, likely=None):
        """Go to `label` if `truth` is true, else to `other`; `likely` is a guess of `truth`."""
        weights = {None: "", True: ", !prof !0", False: ", !prof !2"}[likely]
        self.add(f"  br i1 {truth}, label %{label}, label %{other}{weights}")

    def load(self, kind, address, align=8):
        pointed = self.known(f"inttoptr i64 {address} to {pointer(kind)}")
        return self.new(f"load {kind}, {pointer(kind)} {pointed}, align {align}")

    def store(self, kind, value, address, how="", align=8):
        pointed = self.known(f"inttoptr i64 {address} to {pointer(kind)}")
        self.add(f"  store {how}{kind} {value}, {pointer(kind)} {pointed}, align {align}")

    def _name(self, kind):
        self.target.blocks += 1
        return f"{kind}{self.target.blocks}"

    def label(self, name):
        self.target.lines.append(f"{name}:")
        self.block = self.target.block = name
        self.target.names = {}

    def begin(self, name, *arguments, result="i64"):
        """Begin the function name(arguments); `arguments` are the names of integers."""
        arguments = ", ".join(f"i64 %{argument}" for argument in arguments)
        self.add(f"define {result} @{name}({arguments}) #0 {{")
        self.label("entry")

    @contextmanager
    def function(self, name, arguments=("from", "table", "to", "scratch")):
        """Add void name(arguments) with integer arguments; its body is the block of `with`."""
        self.begin(name, *arguments, result="internal void")
        yield
        self.add("  ret void")
        self.add("}")

    def leave(self, result):
        """Add the return of `result`, such as "i64 0"; code up to the next label is not reached."""
        self.add(f"  ret {result}")
        self.label(self._name("left"))

    def next_block(self):
        """End the basic block, which is code without branches, and begin another."""
        name = self._name("next")
        self.jump(name)
        self.label(name)

    def constants(self, values, name=None):
        """Add an array of constants, integers or floats; return it as `Integers` or `Shared`."""
        name = name or f"array{len(self.target.arrays_of_text)}"
        values = np.asarray(values)
        if values.dtype == float:
            rows, kind, mark = Shared, "double", ", align 64"
            texts = [f"0x{bits:016X}" for bits in values.ravel().view(np.uint64).tolist()]
        else:
            rows, kind, mark = Integers, f"i{8 * values.itemsize}", ""
            texts = values.ravel().tolist()
        whole = f"[{len(texts)} x {kind}]"
        items = ", ".join(f"{kind} {text}" for text in texts)
        self.target.arrays_of_text.append(f"@{name} = private constant {whole} [{items}]{mark}")
        return rows(self, Index(self, self.new(f"ptrtoint {pointer(whole)} @{name} to i64")))

    def table(self, table):
        """Return the name of the function double name(double x) of a `Table`; add it if missing."""
        name = "_".join(table.split())
        if name not in self.target.functions:
            text = Code(1)
            text.add(f"define internal double @{name}(double %x) #0 {{")
            text.label("entry")
            intervals = Intervals(text, table, f"{name}_rows")
            x = Value(text, "%x")
            x = (x > LARGEST).select(LARGEST, (x < -LARGEST).select(-LARGEST, x))
            at = intervals.holding(x)
            rows = (Shared(text, at + k * intervals.bytes)[0] for k in range(Table.ROWS))
            low, _, height, slope = rows
            text.add(f"  ret double {slope * (x - low) + height}")
            self.target.functions |= {name: [*text.lines, "}"]}
            self.target.arrays_of_text += text.arrays_of_text
        return name

    def copy(self, source, target, count):
        """Add a loop that copies `count` rows; `source` and `target` are arrays or addresses."""
        source, target = (a if isinstance(a, Array) else Array(self, a) for a in (source, target))
        for k in self.each(count):
            target[k] = source[k]

    def fill(self, rows, count, of, *inputs):
        """Add loops that write rows[i] = of(a[i], b[i], ...) for i < count; `inputs` are a, b, ...

        An input that is a `Value` is the same for all rows. One lane takes ROWS_OF_FILL rows a
        round, because without optimisation rounds take most of the time. Few rows are taken singly,
        because processors stall on a vector of rows that were just written singly.
        """

        def put(text, inputs, i):
            values = (text.array(a.base, a.first)[i] if isinstance(a, Array) else a for a in inputs)
            text.array(rows.base, rows.first)[i] = of(*values)

        first = 0
        if self.W == 1 and count >= MANY_ROWS:
            first = count - count % ROWS_OF_FILL
            wide = self.lanes(ROWS_OF_FILL)
            wide_inputs = [a if isinstance(a, Array) else wide.splat(a) for a in inputs]
            for k in self.each(first // ROWS_OF_FILL):
                put(wide, wide_inputs, k * ROWS_OF_FILL)
        for k in self.each(count - first):
            put(self, inputs, k + first)

    def copy_numbers(self, source, step, target, other, count):
        """Copy 8 bytes for each k < count in a loop: from source + k step to target + k other."""
        for k in self.each(count):
            number = self.load("i64", source + k * step)
            self.store("i64", number, target + k * other)

    def invoke(self, name, *addresses):
        """Call the void function `name` of this text; its arguments are arrays or integers."""
        addresses = [a.at() if isinstance(a, Array) else a for a in addresses]
        self.add(f"  call void @{name}({', '.join(f'i64 {a}' for a in addresses)})")

    def call(self, result, address, *integers):
        """Call the function at an address with integers; return a value of LLVM type `result`."""
        kind = f"{result} ({', '.join(['i64'] * len(integers))})"
        function = self.new(f"inttoptr i64 {address} to {pointer(kind)}")
        call = f"call {result} {function}({', '.join(f'i64 {a}' for a in integers)})"
        return self.add(f"  {call}") if result == "void" else self.new(call)

    @contextmanager
    def when(self, truth, likely=None):
        """Add the body of `with`, which runs if `truth` is true; `likely` is a guess of `truth`."""
        name = self._name("when")
        self.branch(truth, name, f"{name}_after", likely)
        self.label(name)
        yield
        self.jump(f"{name}_after")
        self.label(f"{name}_after")

    def otherwise(self, truth, values, body):
        """Return `values` if `truth` is true, else the values of body(), which runs only then."""
        name, before = self._name("otherwise"), self.target.block
        values = map(self.value, values)
        self.branch(truth, f"{name}_after", name, True)
        self.label(name)
        others, end = body(), self.target.block
        self.jump(f"{name}_after")
        self.label(f"{name}_after")
        results = []
        for value, other in zip(values, others, strict=True):
            phi = self.new(f"phi {value.kind} [ {value}, %{before} ], [ {other}, %{end} ]")
            results.append(type(value)(self, phi))
        return results

    # --------------------------------------------------------------------------------------- loops
    def rounds(self, carried, *others):
        """Add a loop with the body of `for`; it continues while `carried.goes_on` is true.

        Python runs the body once, to write its instructions, and must not leave the `for`. The body
        replaces the variables in `carried` and `others`, all `Carried`, and sets `carried.goes_on`.
        """
        name, before = self._name("cycle"), self.target.block
        self.jump(name)
        self.label(name)
        place = len(self.target.lines)
        phis = []
        for each in (carried, *others):
            for key, value in vars(each).items():
                value = self.value(value)
                phis.append((each, key, value))
                setattr(each, key, type(value)(value.text, f"%{name}.{key}"))
        yield carried
        goes_on = vars(carried).pop("goes_on")
        # The phis belong at the head of the loop, but read names that exist only now.
        self.target.lines[place:place] = [
            f"  %{name}.{key} = phi {first.kind} "
            f"[ {first}, %{before} ], [ {first._number(getattr(each, key))}, %{name}_end ]"
            for each, key, first in phis
        ]
        self.jump(f"{name}_end")
        self.label(f"{name}_end")
        self.branch(goes_on, name, f"{name}_after")
        self.label(f"{name}_after")

    def each(self, count, carried=None, most=1):
        """Add a loop with the body of `for`; yield its index, from 0 to count - 1.

        `carried` has the loop variables, see `rounds`. If `count` is a Python integer of at most
        `most`, the loop is unrolled. Any other count must be 1 or more.
        """
        carried = carried or Carried()
        if isinstance(count, int) and count <= most:
            carried.update({key: self.value(value) for key, value in vars(carried).items()})
            yield from range(count)
            return
        for at in self.rounds(Carried(index=0), carried):
            yield at.index
            at.index = at.index + 1
            at.goes_on = at.index < count

    def listed(self, indices):
        """Return a function of `carried`, as in `each`, that adds a loop over `indices`."""
        first, count = min(indices, default=0), len(indices)
        if [*indices] == [*range(first, first + count)]:
            return lambda carried=None: (k + first for k in self.each(count, carried))
        array = indices if count < 2 else self.constants(indices)  # address found before the loop
        return lambda carried=None: (array[k] for k in self.each(count, carried))

    # ------------------------------------------------------------------------------ names, memory
    def value(self, value):
        """Return a float as a `Value`, an int as an `Index`, any other value as it is."""
        if isinstance(value, float):
            return Value(self, self.constant(value))
        if isinstance(value, int):
            return Index(self, value)
        return value

    def lanes(self, W):
        """Return a `Code` that adds to this text, for W lanes; rows stay as far apart as here."""
        return Code(W, self.target, self.size)

    def array(self, base, first=0):
        """Return the `Array` that begins at row `first`, where `base` is the address of row 0."""
        return Array(self, base, first)

    def arrays(self, base, rows):
        """Return an object of `Array`s by name; `rows` has first rows, and row 0 is at `base`."""
        firsts = rows._asdict().items()
        return SimpleNamespace(**{name: Array(self, base, first) for name, first in firsts})

    def place(self, base, first, i=0):
        """Return the address of row first + i, where `base` is the address of row 0."""
        base = Index(self, base)
        if isinstance(i, int):
            return base + self.size * (first + i)
        # `freeze` keeps one counter for all rows of a loop: LLVM would make one of each address.
        row = Index(self, self.known(f"freeze i64 {base + i * self.size}"))
        return row + self.size * first

    def short(self, address, k):
        """Return the k-th unsigned integer of 4 bytes at an address."""
        number = self.load("i32", Index(self, address) + k * 4, 4)
        return Index(self, self.new(f"zext i32 {number} to i64"))

    def apply(self, kernel, **inputs):
        """Add the operations of a scalar `kernel` on `inputs` by name; return {name: result}."""
        values = {k: self.value(inputs[name]) for k, name in enumerate(kernel.inputs)}
        self.carry_out(kernel.operations, values, None)
        truths = {number for how, number, _ in kernel.operations if how in OF_TRUTH_VALUES}
        results = {}
        for name, a in kernel.results.items():
            kind = Truth if a in truths else Value
            results[name] = self.value(a) if isinstance(a, float) else kind(self, values[a])
        return results

    def shuffled(self, a, b, order):
        """Return the vector of lanes `order`: n < W is lane n of a, n >= W is lane n - W of b."""
        order = ", ".join(f"i32 {n}" for n in order)
        return self.new(f"shufflevector {self.V} {a}, {self.V} {b}, <{self.W} x i32> <{order}>")

    def truth(self, is_true):
        """Return W equal truth values as text, without their type M."""
        text = "true" if is_true else "false"
        return text if self.W == 1 else f"<{', '.join([f'i1 {text}'] * self.W)}>"

    # --------------------------------------------------------------------------------------- lists
    def constant(self, number):
        """Return W equal constants as text, without their type V."""
        bits = f"0x{_BITS.unpack(_NUMBER.pack(number))[0]:016X}"
        return bits if self.W == 1 else f"<{', '.join([f'double {bits}'] * self.W)}>"

    def splat(self, number):
        """Return a `Value` with the same number in all lanes; `number` is the name of a double."""
        if self.W > 1:
            first = self.new(f"insertelement {self.V} undef, double {number}, i32 0")
            order = f"<{self.W} x i32> zeroinitializer"
            number = self.new(f"shufflevector {self.V} {first}, {self.V} undef, {order}")
        return Value(self, number)

    def _call(self, name, *operands):
        function = f"{self.V} @llvm.{name}.{self.suffix}"
        kinds = ", ".join([self.V] * len(operands))
        self.target.declared.add(f"declare {function}({kinds})")
        return self.new(f"call {function}({self._typed(operands)})")

    def _typed(self, operands):
        return ", ".join(f"{self.V} {operand}" for operand in operands)

    def compare(self, how, a, b):
        return self.new(f"fcmp {how} {self.V} {a}, {b}")

    def select(self, truth, a, b):
        return self.new(f"select {self.M} {truth}, {self.V} {a}, {self.V} {b}")

    def carry_out(self, operations, values, load):
        """Add `operations` to the text; `values`, {number of a value: name}, gets their results.

        load(number) returns the name of a value that `values` lacks.
        """
        M = self.M
        for instruction, number, operands in operations:
            names = []
            for operand in operands:
                if isinstance(operand, float):
                    names.append(self.constant(operand))
                    continue
                if operand not in values:
                    values[operand] = load(operand)
                names.append(values[operand])
            if instruction in ("fabs", "sqrt", "floor", "copysign"):
                name = self._call(instruction, *names)
            elif instruction == "sum":
                name = names.pop(0) if len(names) % 2 else None
                for a, b in zip(names[::2], names[1::2], strict=True):
                    product = Value(self, a) * Value(self, b)
                    name = product if name is None else Value(self, name) + product
            elif instruction in ("max", "min"):
                is_first = self.compare("ogt" if instruction == "max" else "olt", *names)
                name = self.select(is_first, *names)
            elif instruction == "select":
                name = self.select(*names)
            elif instruction in ("and", "or", "xor"):
                name = self.new(f"{instruction} {M} {names[0]}, {names[1]}")
            elif instruction in OF_TRUTH_VALUES:
                name = self.compare(instruction, *names)
            elif instruction in OF_BITS:
                a, b = (self.new(f"bitcast {self.V} {a} to {self.I}") for a in names)
                bits = self.new(f"{instruction.removeprefix('bits_')} {self.I} {a}, {b}")
                name = self.new(f"bitcast {self.I} {bits} to {self.V}")
            elif instruction in OF_LISTS:
                name = self._call_list(instruction, names)
            elif instruction in OF_LIBRARY:
                kinds = ", ".join(["double"] * len(names))
                self.target.declared.add(f"declare double @{instruction}({kinds})")
                name = self._by_lane(f"double @{instruction}", names)
            elif is_table(instruction):
                name = self._by_lane(f"double @{self.table(instruction)}", names)
            else:
                name = self.new(f"{instruction} {self.V} {names[0]}, {names[1]}")
            values[number] = name

    def _by_lane(self, function, operands):
        """Call a function, such as "double @tan", lane by lane; return the name of the results."""
        if self.W == 1:
            return self.new(f"call {function}({self._typed(operands)})")
        result = "undef"
        for l in range(self.W):
            of_lane = [self.new(f"extractelement {self.V} {a}, i32 {l}") for a in operands]
            numbers = ", ".join(f"double {number}" for number in of_lane)
            number = self.new(f"call {function}({numbers})")
            result = self.new(f"insertelement {self.V} {result}, double {number}, i32 {l}")
        return result

    def _call_list(self, name, operands):
        """Call elementary function `name`, defined once, for W lanes; return the result's name."""
        function = f"lanes_{name}_{self.W}"
        if function not in self.target.functions:
            operations, result = list_of(name)
            text = Code(self.W)
            values = {k: f"%x{k}" for k in range(len(operands))}
            given = text._typed(values.values())
            text.add(f"define internal {self.V} @{function}({given}) #0 {{")
            text.label("entry")
            text.carry_out(operations, values, None)
            value = Value(text, values[result])
            if name in OF_ANGLES:
                value = text._of_large_angles(name, value)
            text.add(f"  ret {self.V} {value}")
            self.target.functions |= text.functions | {function: [*text.lines, "}"]}
            self.target.declared |= text.declared
        return self.new(f"call {self.V} @{function}({self._typed(operands)})")

    def _of_large_angles(self, name, value):
        """Return sin, cos or tan of %x0: `value`, or the C library's where %x0 is large."""
        is_large = abs(Value(self, "%x0")) >= LARGE_ANGLE
        self.declared.add(f"declare double @{name}(double)")

        def of_library():
            return [is_large.select(Value(self, self._by_lane(f"double @{name}", ["%x0"])), value)]

        return self.otherwise(is_large.bits().equals(0), [value], of_library)[0]
