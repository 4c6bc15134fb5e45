"""The driver of steps of fields: what happens to lines of lanes, as LLVM's text.

A block of lines takes all steps before the next block begins; a step takes one line after the
other: a stage; `careful` for lanes that it tells of; at the end of a whole step the test of signs;
and saving. The stage of a short list is inlined (`text_of_steps`). That of a long list, or of a
dense field, is a function that the driver calls; then one text serves all fields
(`text_of_called_steps`).
"""

from typing import NamedTuple

from ..code.text import Code
from ..compiling.codes import CHANGED
from ..lists.step import SIGNIFICANT
from .stage_code import Stage, add_table, loader

WIDTH = 8  # lanes of a line
OF_HALVES = 2  # a value of `for_each`: the code computes the tables of stages
NOT_READY, DONE, STOPPED = range(3)  # what the code returns


class DriverArguments(NamedTuple):
    """The integers of an array that the driver takes."""

    x: int  # address of the states (lines, D, W)
    lines: int
    block: int  # lines of a block, which takes all steps before the next block begins
    steps: int  # of all stages
    # Address of two numbers of 8 bytes for each stage: the address of its `Step.table`, (n,) or
    # (lines, n, W), or of h v (lines, T, W) of a whole step, or of what a called stage takes; and
    # its fraction.
    plan: int
    stages: int
    bases: int  # address of the states before a whole step (lines, D, W), 0 if they are not kept
    first_row: int  # address of the first saved states
    row_bytes: int  # from one saved row to the next
    first_until: int  # steps before the one that makes the first saved state
    between: int  # steps between those that make two saved states
    trajectories: int
    ended: int  # address of bits of lanes (lines,) that have ended
    passed: int  # and of those that have passed a pole or ended
    careful: int  # address of `careful.careful`, 0 if it is not ready
    careful_arguments: int  # address of its array
    # Of a stage that is called:
    D: int
    signs: int  # address of the numbers of components that keep their signs
    sign_count: int
    stage_code: int  # address of i64 stage(x, table, plan), see `runs_code.text_of_stage_by_runs`
    stage_plan: int
    # Where the code is. It returns when the budget is spent, and goes on there in the next call.
    budget: int  # calls of `careful` that are left
    line: int  # the first of a block
    n: int  # the next step
    stage: int  # of this step
    until: int  # steps before the next one that makes a saved state
    row: int  # address of the next saved states


SLOT = DriverArguments(*range(len(DriverArguments._fields)))  # places in the array


def text_of_steps(step, name, W, for_each, align, tells_signs):
    """Return the text of i64 name(arguments): steps of lines of W lanes, see `DriverArguments`.

    It returns DONE; or NOT_READY at a step that needs `careful` while that is not. The table is
    common to all lanes, or `for_each` of them, or made of their h v at each stage. Saved states
    begin at multiples of `align` bytes, and go past the caches if that is more than 8; 0 means that
    none are saved. Signs are told if they are compared over whole steps of several stages.
    """
    return _Inlined(step, name, W, for_each, align, tells_signs).finished()


def text_of_called_steps(_, name, W, align, tells_signs):
    """Return the same text for any field, whose stage is a function.

    Where that function has to be prepared, the code returns STOPPED before the stage.
    """
    return _Called(name, W, align, tells_signs).finished()


class _Driver:
    """The text of a driver; classes below add the stage, and what depends on D."""

    def __init__(self, D, name, W, align, tells_signs):
        self.text, self.D, self.name = Code(W), D, name
        self.align, self.tells_signs, self.all_lanes = align, tells_signs, (1 << W) - 1
        self.single = []  # names of components that stay in registers

    def finished(self):
        """Return the whole text."""
        text = self.text
        text.begin(self.name, "arguments")
        self.of = of = DriverArguments(*(text.load("i64", self.slot(k)) for k in SLOT))
        self.begin()
        at = {"lo": of.line, "n": of.n, "stage": of.stage, "until": of.until, "row": of.row}
        last = text.cycle({key: ("i64", value) for key, value in at.items()}, self.block)
        text.store("i64", last["lo"], self.slot(SLOT.line))
        text.add(f"  ret i64 {DONE}")
        return text.finished()

    def begin(self):
        """Add what comes before all lines."""

    def slot(self, k):
        return self.text.plus("%arguments", 8 * k)

    def leave_at(self, result, **at):
        """Return; the next call goes on at this place."""
        for key, value in at.items():
            self.text.store("i64", value, self.slot(getattr(SLOT, key)))
        self.text.leave(f"i64 {result}")

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
        self.at = {"line": lo, "n": n, "stage": stage, "until": until, "row": row}
        saves = text.compare_integers("eq", until, 0)
        plan = text.integer("add", of.plan, text.integer("mul", stage, 16))
        following = text.integer("add", stage, 1)
        is_last = text.compare_integers("eq", following, of.stages)
        self.begin_stage(plan)
        x = [single[key] for key in self.single]
        final = []

        def take_line(line):
            bytes_of_line = text.integer("mul", self.D, text.size)
            state = text.integer("add", of.x, text.integer("mul", line, bytes_of_line))
            final[:] = self.take_stage(state, line, n, x)
            if self.tells_signs:
                with text.when(is_last):
                    bases = text.integer("mul", line, bytes_of_line)
                    self.tell_changes(text.integer("add", of.bases, bases), state, line, n, final)
            if self.align:
                with text.when(saves):
                    self.save(line, row, state, final)
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
            with text.when(text.new(f"icmp sle i64 {left}, 0"), likely=False):
                self.leave_at(DONE, line=lo, n=n, stage=stage, until=until, row=row)
        following = {"n": n, "stage": stage, "until": until, "row": row}
        return following | dict(zip(self.single, final, strict=False)), has_more

    # ----------------------------------------------------------------------------- careful lanes
    def others(self, bits, line, marks):
        """Return the bits of lanes that are neither in `bits` nor marked."""
        text = self.text
        marked = text.load("i8", text.integer("add", marks, line), 1)
        both = text.integer("or", bits, text.new(f"zext i8 {marked} to i64"))
        return text.integer("xor", both, self.all_lanes)

    def lanes_to_tell(self, good, told, line):
        """Return the bits of lanes that `careful` steps, and those that it notes, after a stage.

        Lanes in `good` took the stage, those in `told` from det A < 0 or with a changed sign.
        """
        text, of = self.text, self.of
        bad = self.others(good, line, of.ended)
        alive = text.integer("and", good, self.others(0, line, of.passed))
        return bad, text.integer("and", told, text.integer("mul", alive, 1 | 1 << CHANGED))

    def call_careful(self, line, bad, told, n):
        """Call `careful` for bits of lanes; leave if it is not ready."""
        text, of = self.text, self.of
        with text.when(text.compare_integers("eq", of.careful, 0)):
            text.leave(f"i64 {NOT_READY}")
        text.call("void", of.careful, of.careful_arguments, line, bad, told, n)
        left = text.load("i64", self.slot(SLOT.budget))
        text.store("i64", text.integer("sub", left, 1), self.slot(SLOT.budget))

    # --------------------------------------------------------------------------------- whole steps
    def tell_changes(self, bases, state, line, n, final):
        """Tell `careful` of lanes in which a component changed its sign over a whole step.

        These are components that keep their signs along the motion.
        """
        text = self.text
        zero, significant, minus = map(text.constant, (0.0, SIGNIFICANT, -SIGNIFICANT))

        def keeps(base, after):
            """Return where a component has its sign."""
            signs = text.compare("olt", base, zero), text.compare("oge", after, zero)
            return text.joined("xor", signs)

        def changes(base, after):
            """Return where it has the other one, by more than rounding may make."""
            rises = text.compare("olt", base, zero), text.compare("ogt", after, significant)
            falls = text.compare("ogt", base, zero), text.compare("olt", after, minus)
            return text.joined("or", [text.joined("and", rises), text.joined("and", falls)])

        is_kept = text.all_true(self.over_signs("and", keeps, bases, state, final))
        with text.when(text.new(f"xor i1 {is_kept}, true"), likely=False):
            # Lanes that have passed a pole have nothing more to tell.
            changed = text.bits(self.over_signs("or", changes, bases, state, final))
            changed = text.integer("and", changed, self.others(0, line, self.of.passed))
            with text.when(text.compare_integers("ne", changed, 0)):
                self.call_careful(line, 0, text.integer("shl", changed, CHANGED), n)
        self.keep_bases(bases, state, final)

    # -------------------------------------------------------------------------------------- saving
    def save_by_lane(self, line, row, state):
        """Write the states of the trajectories of a line to the row, number by number."""
        text, W, D, of = self.text, self.text.W, self.D, self.of
        first = text.integer("mul", line, W)
        for l in range(W):
            number = text.plus(first, l)
            with text.when(text.compare_integers("ult", number, of.trajectories)):
                place = text.at(row, text.integer("mul", number, D))
                from_lane = text.plus(state, 8 * l)

                def copy(k, place=place, from_lane=from_lane):
                    value = text.load("double", text.place(from_lane, 0, k))
                    text.store("double", value, text.at(place, k))

                text.fold(D, {}, copy)


class _Inlined(_Driver):
    """A driver with straight-line code of a stage.

    The state of a single orbit stays in registers: a load would wait for the store before it.
    """

    def __init__(self, step, name, W, for_each, align, tells_signs):
        super().__init__(step.D, name, W, align, tells_signs)
        self.step, self.for_each = step, for_each
        self.single = [f"x{i}" for i in range(step.D if W == 1 else 0)]

    def begin_stage(self, plan):
        text = self.text
        self.table, self.fraction = text.load("i64", plan), None
        if self.for_each == OF_HALVES:
            self.fraction = text.load("double", text.plus(plan, 8))

    def take_stage(self, state, line, n, x):
        """Add a stage of a line; return its next state."""
        text, step, table, fixed = self.text, self.step, self.table, {}
        if self.for_each:
            numbers = step.T if self.for_each == OF_HALVES else len(step.table)
            table = text.integer("add", table, text.integer("mul", line, numbers * text.size))
        x = x or [text.row(state, i) for i in range(step.D)]
        if self.for_each == OF_HALVES:
            fixed = add_table(text, step, table, self.fraction)
        stage = Stage(text, step, loader(text, step, self.for_each, state, table, fixed))
        usual = stage.take(x)
        final = text.otherwise(
            stage.is_good(), usual, lambda: self.take_rare_stage(stage, state, line, n, x)
        )
        for k, number in enumerate(step.after):
            if number != k:
                text.put(final[k], state, k)
        return final

    def take_rare_stage(self, stage, state, line, n, x):
        """Add the rare operations, and `careful` where they do not suffice; return the state."""
        text = self.text
        if not self.single:
            # Loaded and computed anew, so that the registers of usual lines need not be stored.
            x = [text.row(state, i) for i in range(self.D)]
            stage.take(x)
        after, accurate, good, told, _ = stage.take_rare()
        after = [text.select(accurate, *both) for both in zip(after, x, strict=True)]
        for k, value in enumerate(after):
            text.put(value, state, k)
        bad, told = self.lanes_to_tell(good, told, line)
        is_clear = text.compare_integers("eq", text.integer("or", bad, told), 0)

        def carefully():
            self.call_careful(line, bad, told, n)
            return [text.row(state, k) for k in range(self.D)]

        return text.otherwise(is_clear, after, carefully)

    def over_signs(self, instruction, truth_of, bases, state, final):
        """Return truth_of(base, after) of all components that keep their signs, joined."""
        signs = sorted(self.step.of_one_sign)
        truths = [truth_of(self.text.row(bases, k), final[k]) for k in signs]
        return self.text.joined(instruction, truths)

    def keep_bases(self, bases, state, final):
        for k in sorted(self.step.of_one_sign):
            self.text.put(final[k], bases, k)

    def save(self, line, row, state, final):
        """Write the states of a line to the row, one trajectory after the other.

        From registers: plain loops take 1.57 times as long. The last line has fewer trajectories.
        """
        text, W, D = self.text, self.text.W, self.D
        place = text.integer("add", row, text.integer("mul", line, 8 * W * D))
        if W == 1:
            for k in range(D):
                text.store("double", final[k], text.plus(place, 8 * k))
            return
        last = text.integer("mul", text.integer("add", line, 1), W)
        is_whole = text.compare_integers("ule", last, self.of.trajectories)
        mark = ", !nontemporal !1" if self.align > 8 else ""
        with text.when(is_whole, likely=True):
            for first in range(0, W * D, W):
                vector, sources = "undef", [divmod(n, D) for n in range(first, first + W)]
                for k in dict.fromkeys(component for _, component in sources):
                    order = [
                        W + lane if component == k else n
                        for n, (lane, component) in enumerate(sources)
                    ]
                    vector = text.shuffled(vector, final[k], order)
                text.store(text.V, vector, text.plus(place, 8 * first), self.align, mark)
        with text.when(text.new(f"xor i1 {is_whole}, true")):
            self.save_by_lane(line, row, state)


class _Called(_Driver):
    """A driver that calls a function for each stage, for any D."""

    def __init__(self, name, W, align, tells_signs):
        super().__init__(None, name, W, align, tells_signs)

    def begin(self):
        self.D = self.of.D

    def begin_stage(self, plan):
        self.table = self.text.load("i64", plan)

    def take_stage(self, state, line, n, x):
        """Add a stage of a line, and `careful` for its bits; the state is in memory alone."""
        text, of = self.text, self.of
        bits = text.call("i64", of.stage_code, state, self.table, of.stage_plan)
        with text.when(text.compare_integers("ne", bits, 0), likely=False):
            with text.when(text.compare_integers("slt", bits, 0)):
                self.leave_at(STOPPED, **self.at)
            good = text.integer("xor", text.integer("and", bits, self.all_lanes), self.all_lanes)
            bad, told = self.lanes_to_tell(good, text.integer("lshr", bits, 8), line)
            is_clear = text.compare_integers("eq", text.integer("or", bad, told), 0)
            with text.when(text.new(f"xor i1 {is_clear}, true")):
                self.call_careful(line, bad, told, n)
        return []

    def over_signs(self, instruction, truth_of, bases, state, final):
        text = self.text

        def join(i, value):
            k = text.load("i64", text.at(self.of.signs, i))
            truth = truth_of(text.row(bases, 0, k), text.row(state, 0, k))
            value, i = text.joined(instruction, [value, truth]), text.integer("add", i, 1)
            return {"i": i, "value": value}, text.compare_integers("ult", i, self.of.sign_count)

        start = text.truth(instruction == "and")
        return text.cycle({"i": ("i64", "0"), "value": (text.M, start)}, join)["value"]

    def keep_bases(self, bases, state, final):
        self.text.copy(state, bases, self.D)

    def save(self, line, row, state, final):
        self.save_by_lane(line, row, state)
