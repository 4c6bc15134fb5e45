"""Machine code of the steps of a field: LLVM's text, made from a list of operations.

A list (`operations.Step`) becomes straight-line code for a line of W lanes, in loops over lines and
steps. Its values stay in registers, and are those of `operations.evaluate`, to the bit.
"""

from ..code.compiler import Text
from ..compiling.codes import CHANGED
from .generated_lines import add_table, loader, save
from .generated_stages import (
    SLOT,
    CodeArguments,
    call_careful,
    end_composition,
    marks_of,
    others,
)

WIDTH = 8  # lanes of a line
OF_HALVES = 2  # a value of `for_each`: the code computes the tables of stages


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
    """The text of `text_of_steps`, block by block.

    A block of lines takes all steps before the next block begins; a step takes one line after the
    other. A line takes the block `rare` where the usual operations do not suffice, and `careful`
    where those of `rare` do not either.

    of        `CodeArguments`, as values
    single    names of the state of a single orbit, which stays in registers: a load would wait for
              the store before it
    """

    def __init__(self, step, name, W, for_each, align, tells_signs):
        self.text, self.step, self.name, self.for_each = Text(W), step, name, for_each
        self.align, self.tells_signs, self.size = align, tells_signs, 8 * W  # bytes of a row
        self.single = [f"%x{i}" for i in range(step.D if W == 1 else 0)]

    def finished(self):
        """Return the whole text."""
        text = self.text
        text.add(f"define i64 @{self.name}(i64 %arguments) #0 {{")
        text.label("entry")
        self.of = CodeArguments(*(text.load("i64", self.slot(k)) for k in SLOT))
        self.begin_step(self.begin_block())
        places, x, load = self.begin_line()
        values, usual = self.take_usual_step(x, load)
        rare, carefully = self.take_rare_step(places, x, values, load)
        self.end_line(self.joined(places, usual, rare, carefully))
        self.end_step()
        self.end_block()
        return text.finished()

    def slot(self, k):
        return self.text.plus("%arguments", 8 * k)

    def state_at(self, places):
        return [self.text.load(self.text.V, place) for place in places]

    def begin_block(self):
        """Begin or go on with a block of lines; return the loads of a single state."""
        text, of = self.text, self.of
        text.jump("blocks")
        text.label("blocks")
        text.add(f"  %lo = phi i64 [ {of.line}, %entry ], [ %hi, %after ]")
        for register, resumed, at_first in (
            ("n", of.n, "0"),
            ("stage", of.stage, "0"),
            ("until", of.until, of.first_until),
            ("row", of.row, of.first_row),
        ):
            text.add(f"  %{register}0 = phi i64 [ {resumed}, %entry ], [ {at_first}, %after ]")
        end = text.integer("add", "%lo", of.block)
        less = text.compare_integers("ult", end, of.lines)
        text.add(f"  %hi = select i1 {less}, i64 {end}, i64 {of.lines}")
        single = self.state_at(text.plus(of.x, self.size * i) for i in range(len(self.single)))
        text.jump("steps")
        return single

    def begin_step(self, single):
        """Begin a step of all lines of a block."""
        text, of = self.text, self.of
        text.label("steps")
        for register in ("n", "stage", "until", "row"):
            text.add(f"  %{register} = phi i64 [ %{register}0, %blocks ], [ %{register}1, %more ]")
        for i, component in enumerate(single):
            text.add(f"  %x{i} = phi {text.V} [ {component}, %blocks ], [ %state{i}, %more ]")
        self.saves = text.compare_integers("eq", "%until", 0)
        self.plan = text.integer("add", of.plan, text.integer("mul", "%stage", 16))
        self.table = text.load("i64", self.plan)
        self.next_stage = text.integer("add", "%stage", 1)
        self.is_last = text.compare_integers("eq", self.next_stage, of.stages)
        text.jump("lines")

    def begin_line(self):
        """Begin a step of a line.

        Return where its state is, the state, and a function that loads other values.
        """
        text, step, of = self.text, self.step, self.of
        text.label("lines")
        text.add("  %line = phi i64 [ %lo, %steps ], [ %line1, %next ]")
        state = text.integer("add", of.x, text.integer("mul", "%line", step.D * self.size))
        places = [text.plus(state, self.size * i) for i in range(step.D)]
        table, fixed = self.table, {}
        if self.for_each:
            numbers = step.T if self.for_each == OF_HALVES else len(step.table)
            table = text.integer("add", table, text.integer("mul", "%line", numbers * self.size))
        x = self.single or self.state_at(places)
        if self.for_each == OF_HALVES:
            fraction = text.load("double", text.plus(self.plan, 8))
            add_table(text, step, table, fraction, fixed)
        return places, x, loader(text, step, self.for_each, state, table, fixed)

    def take_usual_step(self, x, load):
        """Return all values, and the next state."""
        text, step = self.text, self.step
        values = dict(enumerate(x))
        text.carry_out(step.usual, values, load)
        after = [values[k] if k in values else load(k) for k in step.after]
        text.branch(text.all_true(values[step.good]), "finish", "rare", likely=True)
        return values, after

    def take_rare_step(self, places, x, values, load):
        """Return the next state by other operations, and after a call of `careful`.

        It takes lanes where these do not suffice either, and notes poles.
        """
        text, step, of = self.text, self.step, self.of
        text.label("rare")
        if not self.single:
            # Loaded and computed anew, so that the registers of usual lines need not be stored.
            x = self.state_at(places)
            values = dict(enumerate(x))
            text.carry_out(step.usual, values, load)
        text.carry_out(step.rare, values, load)
        accurate = values[step.accurate]
        after = [values[k] if k in values else load(k) for k in step.after_rare]
        after = [text.select(accurate, *both) for both in zip(after, x, strict=True)]
        for value, place in zip(after, places, strict=True):
            text.store(text.V, value, place)
        passed = marks_of(text, text.integer("add", of.marks, of.lines))
        good, negative = text.bits(accurate), text.bits(values[step.negative])
        bad = others(text, good, of.marks)
        told = text.integer("and", good, text.integer("xor", passed, (1 << text.W) - 1))
        negative = text.integer("and", negative, told)
        if step.changed is not None:
            changed = text.integer("and", text.bits(values[step.changed]), told)
            negative = text.integer("or", negative, text.integer("shl", changed, CHANGED))
        is_any = text.compare_integers("ne", text.integer("or", bad, negative), 0)
        text.branch(is_any, "careful", "finish")

        text.label("careful")
        text.branch(text.compare_integers("eq", of.careful, 0), "unable", "call")
        text.label("unable")
        text.add("  ret i64 0")
        text.label("call")
        solved = call_careful(text, of, bad, negative, places)
        text.jump("finish")
        return after, solved

    def joined(self, places, usual, rare, carefully):
        """Join the three ways; store and return the state of a line after a step."""
        text, step = self.text, self.step
        text.label("finish")
        names = [f"%state{k}" for k in range(step.D)]
        for name, *values in zip(names, usual, rare, carefully, strict=True):
            ways = ", ".join(
                f"[ {value}, %{block} ]"
                for value, block in zip(values, ("lines", "rare", "call"), strict=True)
            )
            text.add(f"  {name} = phi {text.V} {ways}")
        for k, n in enumerate(step.after):
            if n != k:
                text.store(text.V, names[k], places[k])
        if self.tells_signs:
            end_composition(text, step, self.of, places, names, self.is_last)
        return names

    # -------------------------------------------------------------------------------- ends of loops
    def end_line(self, state):
        """Save the state of a line where states are saved, and go on with the next line."""
        text = self.text
        if self.align:
            text.branch(self.saves, "save", "next")
            save(text, state, self.step.D, self.of.trajectories, self.align)
        else:
            text.jump("next")
        text.label("next")
        text.add("  %line1 = add i64 %line, 1")
        text.branch(text.compare_integers("ult", "%line1", "%hi"), "lines", "done")

    def end_step(self):
        """Go on with the next step of the block, or pause where the budget is spent."""
        text, of = self.text, self.of
        text.label("done")
        text.add("  %n1 = add i64 %n, 1")
        text.add(f"  %stage1 = select i1 {self.is_last}, i64 0, i64 {self.next_stage}")
        less = text.integer("sub", "%until", 1)
        text.add(f"  %until1 = select i1 {self.saves}, i64 {of.between}, i64 {less}")
        next_row = text.integer("add", "%row", of.row_bytes)
        text.add(f"  %row1 = select i1 {self.saves}, i64 {next_row}, i64 %row")
        text.branch(text.compare_integers("ult", "%n1", of.steps), "more", "after")
        text.label("more")
        left = text.load("i64", self.slot(SLOT.budget))
        text.branch(text.compare_integers("sgt", left, 0), "steps", "pause")
        text.label("pause")
        for slot, register in (
            (SLOT.line, "%lo"),
            (SLOT.n, "%n1"),
            (SLOT.stage, "%stage1"),
            (SLOT.until, "%until1"),
            (SLOT.row, "%row1"),
        ):
            text.store("i64", register, self.slot(slot))
        text.add("  ret i64 1")

    def end_block(self):
        """Go on with the next block, or end."""
        text = self.text
        text.label("after")
        text.branch(text.compare_integers("ult", "%hi", self.of.lines), "blocks", "end")
        text.label("end")
        text.store("i64", "%hi", self.slot(SLOT.line))
        text.add("  ret i64 1")


def text_of_step(step, name, *_):
    """Return the text of i64 name(x, table): one step of a state (D,), in place.

    It returns 1, and leaves the state, if the step is not accurate; else 2 if det A < 0, or 0.
    """
    text = Text(1)
    text.add(f"define i64 @{name}(i64 %x, i64 %table) #0 {{")
    text.label("entry")
    places = [text.plus("%x", 8 * i) for i in range(step.D)]
    values = {i: text.load("double", place) for i, place in enumerate(places)}

    def of_table(number):
        return text.load("double", text.plus("%table", 8 * step.places[number]))

    text.carry_out(step.usual, values, of_table)
    text.branch(values[step.good], "finish", "rare", likely=True)
    text.label("rare")
    rare = dict(values)
    text.carry_out(step.rare, rare, of_table)
    text.branch(rare[step.accurate], "accurate", "bad")
    text.label("bad")
    text.add("  ret i64 1")
    text.label("accurate")
    sign = text.integer("mul", 2, text.bits(rare[step.negative]))
    text.jump("finish")
    text.label("finish")
    text.add(f"  %code = phi i64 [ 0, %entry ], [ {sign}, %accurate ]")
    both = [*zip(step.after, step.after_rare, strict=True)]
    final = {
        k: text.new(f"phi double [ {values[usual]}, %entry ], [ {rare[other]}, %accurate ]")
        for k, (usual, other) in enumerate(both)
        if usual != k
    }
    for k, value in final.items():
        text.store("double", value, places[k])
    text.add("  ret i64 %code")
    return text.finished()
