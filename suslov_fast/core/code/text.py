"""Text of machine code with loops and conditions, for rows of lines."""

from contextlib import contextmanager

import numpy as np

from .compiler import Text, pointer

WRITTEN_OUT = 4  # indices of which loops are written out


def bits_of(number):
    """Return a number as LLVM's text has it."""
    return f"0x{np.float64(number).view(np.uint64):016X}"


class Code(Text):
    """Text with loops and conditions, for the rows of lines."""

    def __init__(self, W, target=None):
        super().__init__(W, target)
        self.blocks, self.size = 0, 8 * W
        self.has_runs, self.called, self.constants = False, frozenset(), []

    def _name(self, kind):
        self.target.blocks += 1
        return f"{kind}{self.target.blocks}"

    def label(self, name):
        self.target.lines.append(f"{name}:")
        self.block = self.target.block = name

    def begin(self, name, *arguments):
        """Begin the function i64 name(arguments), of integers."""
        arguments = ", ".join(f"i64 %{argument}" for argument in arguments)
        self.add(f"define i64 @{name}({arguments}) #0 {{")
        self.label("entry")

    @contextmanager
    def function(self, name):
        """Add void name(from, table, to, scratch), whose body is the block of `with`."""
        self.add(
            f"define internal void @{name}(i64 %from, i64 %table, i64 %to, i64 %scratch) #0 {{"
        )
        self.label("entry")
        yield
        self.add("  ret void")
        self.add("}")

    def leave(self, result):
        """Return from the function; the code that follows, up to the next block, is not reached."""
        self.add(f"  ret {result}")
        self.label(self._name("left"))

    def next_block(self):
        """End the block of straight-line code, and begin another."""
        name = self._name("next")
        self.jump(name)
        self.label(name)

    def integers(self, name, array):
        """Return the address of an array of integers, which is part of the text."""
        kind = f"[{array.size} x i{8 * array.itemsize}]"
        values = ", ".join(f"i{8 * array.itemsize} {value}" for value in array.ravel().tolist())
        self.target.constants.append(f"@{name} = private constant {kind} [{values}]")
        return self.new(f"ptrtoint {pointer(kind)} @{name} to i64")

    def numbers(self, name, array):
        """Return the address of an array of numbers, which is part of the text."""
        kind = f"[{array.size} x double]"
        bits = array.ravel().view(np.uint64).tolist()
        values = ", ".join(f"double 0x{number:016X}" for number in bits)
        self.target.constants.append(f"@{name} = private constant {kind} [{values}], align 64")
        return self.new(f"ptrtoint {pointer(kind)} @{name} to i64")

    def memory(self, count):
        """Return the address of memory for so many numbers, on the stack."""
        place = self.new(f"alloca double, i64 {count}")
        return self.new(f"ptrtoint {pointer('double')} {place} to i64")

    def prefetch(self, address):
        """Let the cache load what stands at an address, if it exists: it is written soon."""
        kind = pointer("i8")
        name = f"@llvm.prefetch.p0{'' if kind == 'ptr' else 'i8'}"
        self.target.declared.add(f"declare void {name}({kind}, i32, i32, i32)")
        place = self.new(f"inttoptr i64 {address} to {kind}")
        self.add(f"  call void {name}({kind} {place}, i32 1, i32 3, i32 1)")

    def copy(self, source, target, count):
        """Add a loop that copies rows."""
        self.fold(count, {}, lambda k: self.put(self.row(source, 0, k), target, 0, k))

    def call(self, result, address, *integers):
        """Call the function at an address with integers; return its result, of this type."""
        kind = f"{result} ({', '.join(['i64'] * len(integers))})"
        function = self.new(f"inttoptr i64 {address} to {pointer(kind)}")
        call = f"call {result} {function}({', '.join(f'i64 {a}' for a in integers)})"
        return self.add(f"  {call}") if result == "void" else self.new(call)

    @contextmanager
    def when(self, truth, likely=None):
        """Add a block that is carried out if a truth value is true."""
        name = self._name("when")
        self.branch(truth, name, f"{name}_after", likely)
        self.label(name)
        yield
        self.jump(f"{name}_after")
        self.label(f"{name}_after")

    def otherwise(self, truth, values, body, kinds=None, likely=True):
        """Return these values if a truth value is true, else what `body()` returns.

        They are W numbers each, or of these kinds.
        """
        name, before = self._name("otherwise"), self.target.block
        self.branch(truth, f"{name}_after", name, likely)
        self.label(name)
        others, end = body(), self.target.block
        self.jump(f"{name}_after")
        self.label(f"{name}_after")
        return [
            self.new(f"phi {kind} [ {value}, %{before} ], [ {other}, %{end} ]")
            for kind, value, other in zip(
                kinds or [self.V] * len(values), values, others, strict=True
            )
        ]

    def choice(self, kind, truth, a, b):
        """Return one of two values of a kind, which are both there."""
        return self.new(f"select i1 {truth}, {kind} {a}, {kind} {b}")

    def cycle(self, carried, body):
        """Add a loop that carries on values, given with their kinds by name; return the last ones.

        `body(**values)` returns the next values, and whether the loop goes on.
        """
        name, before = self._name("cycle"), self.target.block
        self.jump(name)
        self.label(name)
        place, phis = len(self.target.lines), {key: f"%{name}_{key}" for key in carried}
        found, goes_on = body(**phis)
        # The next values have names only now.
        self.target.lines[place:place] = [
            f"  {phi} = phi {kind} [ {value}, %{before} ], [ {found[key]}, %{name}_end ]"
            for (key, phi), (kind, value) in zip(phis.items(), carried.values(), strict=True)
        ]
        self.jump(f"{name}_end")
        self.label(f"{name}_end")
        self.branch(goes_on, name, f"{name}_after")
        self.label(f"{name}_after")
        return found

    def switch(self, value, cases):
        """Add a block for each of some integers, which `cases[integer]()` writes."""
        name = self._name("switch")
        ways = " ".join(f"i64 {number}, label %{name}_{number}" for number in cases)
        self.add(f"  switch i64 {value}, label %{name}_after [ {ways} ]")
        for number, body in cases.items():
            self.label(f"{name}_{number}")
            body()
            self.jump(f"{name}_after")
        self.label(f"{name}_after")

    @contextmanager
    def times(self, count):
        """Add a loop over 1 or more indices."""
        with self.loop(self._name("loop"), count) as index:
            yield index

    @contextmanager
    def repeat(self):
        """Add a loop that goes on while the truth value is true that the block appends."""
        name, goes_on = self._name("repeat"), []
        self.jump(name)
        self.label(name)
        yield goes_on
        self.branch(goes_on[0], name, f"{name}_after")
        self.label(f"{name}_after")

    def fold(self, count, carried, body):
        """Add a loop over 1 or more indices; return the values that it carries on, by name.

        `body(index, **carried)` adds the block and returns the next values, or None without any.
        """
        if isinstance(count, int) and count <= WRITTEN_OUT:
            found = carried
            for i in range(count):
                found = body(i, **found) or {}
            return found

        def step(index, **values):
            found, following = body(index, **values) or {}, self.integer("add", index, 1)
            goes_on = self.compare_integers("ult", following, count)
            return found | {"index": following}, goes_on

        kinds = {key: (self.V, value) for key, value in carried.items()}
        last = self.cycle({"index": ("i64", "0")} | kinds, step)
        return {key: last[key] for key in carried}

    def place(self, base, first, i=0):
        """Return the address of row first + i from an address on."""
        if isinstance(i, int):
            return self.plus(base, self.size * (first + i))
        offset = self.integer("mul", i, self.size)
        return self.integer("add", self.plus(base, self.size * first), offset)

    def row(self, base, first, i=0):
        return self.load(self.V, self.place(base, first, i))

    def put(self, value, base, first, i=0):
        self.store(self.V, value, self.place(base, first, i))

    def put_chosen(self, value, base, first, i=0):
        """See `Text.store_chosen`."""
        self.store_chosen(value, self.place(base, first, i))

    def shared(self, address):
        """Return a number at an address, in all lanes."""
        number = self.load("double", address)
        return number if self.W == 1 else self.splat(number, self.W)

    def at(self, address, i):
        """Return the address of the i-th number of 8 bytes."""
        if isinstance(i, int):
            return self.plus(address, 8 * i)
        return self.integer("add", address, self.integer("mul", i, 8))

    def apply(self, rule, **inputs):
        """Carry out a rule; return its results by name."""
        values = {k: inputs[name] for k, name in enumerate(rule.inputs)}
        self.carry_out(rule.operations, values, None)
        return {
            name: self.constant(a) if isinstance(a, float) else values[a]
            for name, a in rule.results.items()
        }

    def shuffled(self, a, b, order):
        """Return the lanes of two vectors, one after the other, in this order."""
        order = ", ".join(f"i32 {n}" for n in order)
        return self.new(f"shufflevector {self.V} {a}, {self.V} {b}, <{self.W} x i32> <{order}>")

    def truth(self, is_true):
        """Return W equal truth values, without the type M."""
        text = "true" if is_true else "false"
        return text if self.W == 1 else f"<{', '.join([f'i1 {text}'] * self.W)}>"

    def any(self, truth):
        """Return whether the truth value of some lane is true."""
        if self.W == 1:
            return truth
        return self.new(
            f"icmp ne i{self.W} {self.new(f'bitcast {self.M} {truth} to i{self.W}')}, 0"
        )
