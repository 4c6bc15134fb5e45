"""Machine code of the steps of a field: LLVM's text, made from a list of operations.

A list (`lists.step.Step`) becomes straight-line code for a line of W lanes, in loops over lines and
steps. Its values stay in registers, and are those of `lists.step.evaluate`, to the bit. `Stage` is
what one stage does to a line, for steps, for users' loops and for derivatives.
"""

from typing import NamedTuple

from ..code.compiler import pointer
from ..code.text import Code
from ..compiling.codes import CHANGED
from ..lists.step import SIGNIFICANT

WIDTH = 8  # lanes of a line
OF_HALVES = 2  # a value of `for_each`: the code computes the tables of stages


class CodeArguments(NamedTuple):
    """The integers of an array that the code of `text_of_steps` takes."""

    x: int  # address of the states (lines, D, W)
    lines: int
    block: int  # lines of a block, which takes all steps before the next block begins
    steps: int  # of all stages
    # Address of two numbers of 8 bytes for each stage: the address of its `Step.table`, (n,) or
    # (lines, n, W), or of h v (lines, T, W) of a whole step; and its fraction.
    plan: int
    stages: int
    bases: int  # address of the states before a whole step (lines, D, W), 0 if they are not kept
    first_row: int  # address of the first saved states
    row_bytes: int  # from one saved row to the next
    first_until: int  # steps before the one that makes the first saved state
    between: int  # steps between those that make two saved states
    trajectories: int
    marks: int  # address of bits of lanes (2, lines): that have ended; passed a pole or ended
    careful: int  # address of `careful.careful`, 0 if it is not ready
    careful_arguments: int  # address of its array
    # Where the code is. It returns when the budget is spent, and goes on there in the next call.
    budget: int  # calls of `careful` that are left
    line: int  # the first of a block
    n: int  # the next step
    stage: int  # of this step
    until: int  # steps before the next one that makes a saved state
    row: int  # address of the next saved states


SLOT = CodeArguments(*range(len(CodeArguments._fields)))  # places in the array


# ---------------------------------------------------------------------------------------- a stage
class Stage:
    """A stage of a line: its operations, and what it tells.

    `load` returns a value that is not computed: of the state, or of the table.
    """

    def __init__(self, text, step, load):
        self.text, self.step, self.load, self.values = text, step, load, {}

    def take(self, x):
        """Carry out the usual operations on the state x; return the next state."""
        self.values = dict(enumerate(x))
        self.text.carry_out(self.step.usual, self.values, self.load)
        return self.results(self.step.after)

    def results(self, numbers):
        """Return values by their numbers."""
        return [self.values[k] if k in self.values else self.load(k) for k in numbers]

    def is_good(self):
        """Return whether the usual operations suffice in all lanes."""
        return self.text.all_true(self.values[self.step.good])

    def take_rare(self):
        """Carry out the rare operations, too.

        Return the next state, where it is accurate, the bits of these lanes, and those of lanes
        with det A < 0, and from CHANGED on of lanes in which a component changed its sign.
        """
        text, step = self.text, self.step
        text.carry_out(step.rare, self.values, self.load)
        accurate = self.values[step.accurate]
        told = text.bits(self.values[step.negative])
        if step.changed is not None:
            changed = text.integer("shl", text.bits(self.values[step.changed]), CHANGED)
            told = text.integer("or", told, changed)
        return self.results(step.after_rare), accurate, text.bits(accurate), told


def loader(text, step, for_each, state, table, fixed=()):
    """Return the function that loads a value: of the state, or of the table.

    `state` and `table` are the addresses of their rows for one line. Values in the dict `fixed` are
    there already.
    """

    def load(number):
        if number in fixed:
            return fixed[number]
        if number < step.D:
            return text.row(state, number)
        place = step.places[number]
        return text.row(table, place) if for_each else text.shared(text.plus(table, 8 * place))

    return load


def add_table(text, step, halves, fraction):
    """Return the numbers of `Step.table`, by their numbers as values.

    `halves` is the address of h v for one line, `fraction` the one of a stage.
    """
    fraction, fixed = fraction if text.W == 1 else text.splat(fraction, text.W), {}

    def half_of(number):
        return text.operate("fmul", text.row(halves, number - step.D), fraction)

    text.carry_out(step.fixed, fixed, half_of)
    for number in step.table:
        if number not in fixed:
            fixed[number] = half_of(number)
    return fixed


# ------------------------------------------------------------------------------------------- steps
def text_of_compositions(*arguments):
    """Return the text of `text_of_steps` for whole steps of several stages that tell signs."""
    return text_of_steps(*arguments, tells_signs=True)


def text_of_steps(step, name, W, for_each, align, tells_signs=False):
    """Return the text of i64 name(arguments): steps of lines of W lanes, see `CodeArguments`.

    It returns 1; or 0 at a step that needs `careful` while that is not ready. The table is common
    to all lanes, or `for_each` of them, or made of their h v at each stage. Saved states begin at
    multiples of `align` bytes, and go past the caches if that is more than 8; 0 means that none are
    saved.
    """
    return _Steps(step, name, W, for_each, align, tells_signs).finished()


class _Steps:
    """The text of `text_of_steps`.

    A block of lines takes all steps before the next block begins; a step takes one line after the
    other. The state of a single orbit stays in registers: a load would wait for the store before
    it.
    """

    def __init__(self, step, name, W, for_each, align, tells_signs):
        self.text, self.step, self.name, self.for_each = Code(W), step, name, for_each
        self.align, self.tells_signs, self.all_lanes = align, tells_signs, (1 << W) - 1
        self.single = [f"x{i}" for i in range(step.D if W == 1 else 0)]

    def finished(self):
        """Return the whole text."""
        text = self.text
        text.add(f"define i64 @{self.name}(i64 %arguments) #0 {{")
        text.label("entry")
        self.of = of = CodeArguments(*(text.load("i64", self.slot(k)) for k in SLOT))
        at = {"lo": of.line, "n": of.n, "stage": of.stage, "until": of.until, "row": of.row}
        last = text.cycle({key: ("i64", value) for key, value in at.items()}, self.block)
        text.store("i64", last["lo"], self.slot(SLOT.line))
        text.add("  ret i64 1")
        return text.finished()

    def slot(self, k):
        return self.text.plus("%arguments", 8 * k)

    def block(self, lo, **at):
        """Add all steps of a block of lines; return where the next one begins, if there is one."""
        text, of = self.text, self.of
        end = text.integer("add", lo, of.block)
        hi = text.choice("i64", text.compare_integers("ult", end, of.lines), end, of.lines)
        carried = {key: ("i64", value) for key, value in at.items()}
        for i, key in enumerate(self.single):
            carried[key] = text.V, text.row(of.x, i)
        text.cycle(carried, lambda **at: self.steps_of(lo, hi, **at))
        begin = {"n": "0", "stage": "0", "until": of.first_until, "row": of.first_row}
        return {"lo": hi, **begin}, text.compare_integers("ult", hi, of.lines)

    def steps_of(self, lo, hi, n, stage, until, row, **single):
        """Add a step of all lines of a block; return what the next one begins with, if any."""
        text, of = self.text, self.of
        saves = text.compare_integers("eq", until, 0)
        plan = text.integer("add", of.plan, text.integer("mul", stage, 16))
        table, fraction = text.load("i64", plan), None
        following = text.integer("add", stage, 1)
        is_last = text.compare_integers("eq", following, of.stages)
        if self.for_each == OF_HALVES:
            fraction = text.load("double", text.plus(plan, 8))
        x = [single[key] for key in self.single]
        final = []

        def take_line(line):
            final[:] = self.line(line, n, table, fraction, is_last, x)
            if self.align:
                with text.when(saves):
                    self.save(line, row, final)
            line = text.integer("add", line, 1)
            return {"line": line}, text.compare_integers("ult", line, hi)

        text.cycle({"line": ("i64", lo)}, take_line)
        n = text.integer("add", n, 1)
        stage = text.choice("i64", is_last, 0, following)
        until = text.choice("i64", saves, of.between, text.integer("sub", until, 1))
        row = text.choice("i64", saves, text.integer("add", row, of.row_bytes), row)
        has_more = text.compare_integers("ult", n, of.steps)
        with text.when(has_more, likely=True):
            left = text.load("i64", self.slot(SLOT.budget))
            with text.when(text.compare_integers("sle", left, 0), likely=False):
                at = (SLOT.line, lo), (SLOT.n, n), (SLOT.stage, stage), (SLOT.until, until)
                for slot, value in (*at, (SLOT.row, row)):
                    text.store("i64", value, self.slot(slot))
                text.leave("i64 1")
        following = {"n": n, "stage": stage, "until": until, "row": row}
        return following | dict(zip(self.single, final, strict=False)), has_more

    def line(self, line, n, table, fraction, is_last, x):
        """Add a step of a line; return its next state."""
        text, step, of = self.text, self.step, self.of
        state = text.integer("add", of.x, text.integer("mul", line, step.D * text.size))
        fixed = {}
        if self.for_each:
            numbers = step.T if self.for_each == OF_HALVES else len(step.table)
            table = text.integer("add", table, text.integer("mul", line, numbers * text.size))
        x = x or [text.row(state, i) for i in range(step.D)]
        if self.for_each == OF_HALVES:
            fixed = add_table(text, step, table, fraction)
        stage = Stage(text, step, loader(text, step, self.for_each, state, table, fixed))
        usual = stage.take(x)
        final = text.otherwise(
            stage.is_good(), usual, lambda: self.take_rare_step(stage, state, line, n, x)
        )
        for k, number in enumerate(step.after):
            if number != k:
                text.put(final[k], state, k)
        if self.tells_signs:
            with text.when(is_last):
                self.tell_changes(line, n, final)
        return final

    def take_rare_step(self, stage, state, line, n, x):
        """Add the rare operations, and `careful` where they do not suffice; return the state."""
        text, of = self.text, self.of
        if not self.single:
            # Loaded and computed anew, so that the registers of usual lines need not be stored.
            x = [text.row(state, i) for i in range(self.step.D)]
            stage.take(x)
        after, accurate, good, told = stage.take_rare()
        after = [text.select(accurate, *both) for both in zip(after, x, strict=True)]
        for k, value in enumerate(after):
            text.put(value, state, k)
        bad = self.others(good, line, of.marks)
        alive = text.integer("and", good, self.others(0, line, self.passed()))
        told = text.integer("and", told, text.integer("mul", alive, 1 | 1 << CHANGED))
        is_clear = text.compare_integers("eq", text.integer("or", bad, told), 0)

        def carefully():
            self.call_careful(line, bad, told, n)
            return [text.row(state, k) for k in range(self.step.D)]

        return text.otherwise(is_clear, after, carefully)

    def passed(self):
        """Return the address of the marks of lanes that passed a pole."""
        return self.text.integer("add", self.of.marks, self.of.lines)

    def others(self, bits, line, marks):
        """Return the bits of lanes that are neither in `bits` nor marked."""
        text = self.text
        marked = text.load("i8", text.integer("add", marks, line), 1)
        both = text.integer("or", bits, text.new(f"zext i8 {marked} to i64"))
        return text.integer("xor", both, self.all_lanes)

    def call_careful(self, line, bad, told, n):
        """Call `careful` for bits of lanes; leave if it is not ready."""
        text, of = self.text, self.of
        with text.when(text.compare_integers("eq", of.careful, 0)):
            text.leave("i64 0")
        kind = "void (i64, i64, i64, i64, i64)"
        function = text.new(f"inttoptr i64 {of.careful} to {pointer(kind)}")
        numbers = f"i64 {of.careful_arguments}, i64 {line}, i64 {bad}, i64 {told}, i64 {n}"
        text.add(f"  call void {function}({numbers})")
        left = text.load("i64", self.slot(SLOT.budget))
        text.store("i64", text.integer("sub", left, 1), self.slot(SLOT.budget))

    def tell_changes(self, line, n, after):
        """Tell `careful` of lanes in which a component changed its sign over a whole step.

        These are components that keep their signs along the motion.
        """
        text, of = self.text, self.of
        bases = text.integer("mul", line, len(after) * text.size)
        bases = text.integer("add", of.bases, bases)
        signs = sorted(self.step.of_one_sign)
        base = {k: text.row(bases, k) for k in signs}
        zero, significant, minus = map(text.constant, (0.0, SIGNIFICANT, -SIGNIFICANT))
        kept = [
            text.joined(
                "xor", [text.compare("olt", base[k], zero), text.compare("oge", after[k], zero)]
            )
            for k in signs
        ]
        is_kept = text.all_true(text.joined("and", kept))
        with text.when(text.new(f"xor i1 {is_kept}, true"), likely=False):
            changes = [
                text.joined(
                    "and",
                    [text.compare(first, base[k], zero), text.compare(second, after[k], least)],
                )
                for k in signs
                for first, second, least in (("olt", "ogt", significant), ("ogt", "olt", minus))
            ]
            # Lanes that have passed a pole have nothing more to tell.
            changed = text.bits(text.joined("or", changes))
            changed = text.integer("and", changed, self.others(0, line, self.passed()))
            with text.when(text.compare_integers("ne", changed, 0)):
                self.call_careful(line, 0, text.integer("shl", changed, CHANGED), n)
        for k in signs:
            text.put(after[k], bases, k)

    def save(self, line, row, states):
        """Write the states of a line to the row, one trajectory after the other."""
        text, W, D = self.text, self.text.W, self.step.D
        place = text.integer("add", row, text.integer("mul", line, 8 * W * D))
        if W == 1:
            for k in range(D):
                text.store("double", states[k], text.plus(place, 8 * k))
            return
        vectors = []
        for first in range(0, W * D, W):
            vector, sources = "undef", [divmod(n, D) for n in range(first, first + W)]
            for k in dict.fromkeys(component for _, component in sources):
                order = [
                    W + lane if component == k else n for n, (lane, component) in enumerate(sources)
                ]
                order = ", ".join(f"i32 {n}" for n in order)
                vector = text.new(
                    f"shufflevector {text.V} {vector}, {text.V} {states[k]}, <{W} x i32> <{order}>"
                )
            vectors.append(vector)
        last = text.integer("mul", text.integer("add", line, 1), W)
        is_whole = text.compare_integers("ule", last, self.of.trajectories)
        mark = ", !nontemporal !1" if self.align > 8 else ""
        with text.when(is_whole, likely=True):
            for k, vector in enumerate(vectors):
                text.store(text.V, vector, text.plus(place, 8 * W * k), self.align, mark)
        # The last line has fewer trajectories, and is written number by number.
        with text.when(text.new(f"xor i1 {is_whole}, true")):
            before = text.integer("mul", line, W)
            left = text.integer("mul", text.integer("sub", self.of.trajectories, before), D)
            for n in range(W * D):
                with text.when(text.compare_integers("ult", n, left)):
                    vector = vectors[n // W]
                    number = text.new(f"extractelement {text.V} {vector}, i32 {n % W}")
                    text.store("double", number, text.plus(place, 8 * n))


# ------------------------------------------------------------------------------------ users' loops
def text_of_step(step, name, *_):
    """Return the text of i64 name(x, table): one step of a state (D,), in place.

    It returns 1, and leaves the state, if the step is not accurate; else 2 if det A < 0, or 0.
    """
    text = Code(1)
    text.add(f"define i64 @{name}(i64 %x, i64 %table) #0 {{")
    text.label("entry")
    stage = Stage(text, step, loader(text, step, False, "%x", "%table"))
    usual = stage.take([text.row("%x", i) for i in range(step.D)])

    def rare():
        after, accurate, _, told = stage.take_rare()
        with text.when(text.new(f"xor i1 {accurate}, true")):
            text.leave("i64 1")
        negative = text.integer("and", told, 1)
        return [*after, text.integer("mul", negative, 2)]

    kinds = [text.V] * step.D + ["i64"]
    *final, code = text.otherwise(stage.is_good(), [*usual, 0], rare, kinds)
    for k, number in enumerate(step.after):
        if number != k:
            text.put(final[k], "%x", k)
    text.add(f"  ret i64 {code}")
    return text.finished()
