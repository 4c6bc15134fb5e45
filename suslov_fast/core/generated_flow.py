"""Machine code of the motion of a field to a tolerance, from the lists of `tolerance`.

The code takes lines of lanes, a few at a time, so that their rows stay in the first cache, and
takes another line whenever one has reached all times. The lanes of a line wait for each other at
each time, by steps of length 0.
"""

from typing import NamedTuple

from .generated_lines import loader, piece_function, save
from .machine_code import Text
from .tolerance import REACH


class FlowArguments(NamedTuple):
    """The integers of an array that the code of `text_of_flow` takes."""

    rows: int  # address of the rows of all lines, see `Rows`
    lines: int
    values: int  # address of the values v of the terms, (T,) or (lines, T, W)
    plan: int  # address of a `Column` for each column: four numbers of 8 bytes
    columns: int
    difference: int  # address of the factors of the states of the last column in `Rows.difference`
    times: int  # address of the times, ascending moduli
    count: int  # of times
    states: int  # address of the states at these times (count, trajectories, D)
    state_bytes: int  # of one time
    trajectories: int
    rtol: int  # address of it
    kept: int  # address of memory for values that later pieces of a long list need
    place: int  # address of the number of the next time of each line
    beginning: int  # lines whose trajectories begin, 0 in later calls
    # Where the code is. It returns 0 when the budget is spent, and goes on there in the next call;
    # else 1.
    active: int  # address of the numbers of lines that are being taken
    taking: int  # how many of them
    next: int  # the next line
    budget: int  # steps that are left, of all active lines


SLOT = FlowArguments(*range(len(FlowArguments._fields)))  # places in the array


class Column(NamedTuple):
    """A column of an extrapolated step."""

    stages: int
    scale: int  # +-eps / 2 of a stage, for a step of length 1
    weight: int
    second: int  # weight without the shortest column


COLUMN = Column(*range(4))


class Rows(NamedTuple):
    """The first rows of W numbers of a line."""

    x: int  # of a stage (D)
    base: int  # the state before the step (D)
    # Before a step the sums are 0, and the least pivot is 1.
    total: int  # of weights times ends of columns (n, the `given` components)
    second: int  # the same without the shortest column (n)
    difference: int  # of the states of the last column (n)
    largest: int  # moduli so far (n)
    time: int
    wanted: int  # length of the next step, 0 if the trajectory has ended; at first the last time
    longer: int  # the largest factor between this length and the next
    steps: int  # since the last time
    taken: int  # length of this step
    first: int  # time that limits lengths until the first step is taken
    least: int  # least pivot of this step
    table: int  # `Step.table`
    size: int  # number of all rows


def rows_of(step):
    """Return the rows for the lists of a `tolerance.Stage`."""
    first = [0, step.D, *(2 * step.D + k * step.given for k in range(5))]
    return Rows(*first, *range(first[-1] + 1, first[-1] + 8), first[-1] + 7 + len(step.table))


def text_of_flow(step, name, W, for_each, _):
    """Return the text of i64 name(arguments), see `FlowArguments`."""
    return _Flow(step, name, W, for_each).finished()


class _Flow:
    """The text of the motion, block by block.

    of      `FlowArguments`, as values
    rows    `Rows`
    """

    def __init__(self, step, name, W, for_each):
        self.text, self.step, self.name, self.for_each = Text(W), step, name, for_each
        self.rows, self.size = rows_of(step), 8 * W  # bytes of a row
        (*self.before, self.usual), _ = step.pieces

    def finished(self):
        """Return the whole text."""
        text = self.text
        for k, piece in enumerate(self.before):
            piece_function(text, self.step, f"{self.name}_{k}", piece, True)
        text.add(f"define i64 @{self.name}(i64 %arguments) #0 {{")
        text.label("entry")
        self.of = FlowArguments(*(text.load("i64", self.slot(k)) for k in SLOT))
        self.begin()
        self.begin_step()
        with text.loop("column", self.of.columns) as c:
            self.take_column(c)
        self.save_at_times(*self.choose())
        self.go_on()
        return text.finished()

    # ------------------------------------------------------------------------------------ addresses
    def slot(self, k):
        return self.text.plus("%arguments", 8 * k)

    def at(self, array, number):
        """Return the address of a number of 8 bytes."""
        return self.text.integer("add", array, self.text.integer("mul", number, 8))

    def active(self, k):
        """Return the number of the k-th line that is being taken."""
        return self.text.load("i64", self.at(self.of.active, k))

    def line_at(self, number):
        """Return the address of the rows of a line."""
        offset = self.text.integer("mul", number, self.rows.size * self.size)
        return self.text.integer("add", self.of.rows, offset)

    def values_of(self, number):
        """Return the address of the values v of the lanes of a line."""
        if not self.for_each:
            return self.of.values
        offset = self.text.integer("mul", number, self.size * self.step.parameters)
        return self.text.integer("add", self.of.values, offset)

    # --------------------------------------------------------------------------------------- values
    def row(self, line, row):
        return self.text.load(self.text.V, self.text.plus(line, self.size * row))

    def put(self, value, line, row):
        self.text.store(self.text.V, value, self.text.plus(line, self.size * row))

    def put_chosen(self, value, line, row):
        """See `Text.store_chosen`."""
        self.text.store_chosen(value, self.text.plus(line, self.size * row))

    def scalar(self, address):
        """Return a number that all lanes share."""
        value = self.text.load("double", address)
        return value if self.text.W == 1 else self.text.splat(value, self.text.W)

    def value(self, t, of_line):
        """Return the value of a term, or a coefficient of the lift, by its number."""
        if self.for_each:
            return self.row(of_line, t)
        return self.scalar(self.text.plus(of_line, 8 * t))

    # ----------------------------------------------------------------------------------- first call
    def begin(self):
        """Begin the trajectories of all lines, in the first call."""
        text, of = self.text, self.of
        text.branch(text.compare_integers("eq", of.beginning, 0), "under_way", "begins")
        text.label("begins")
        with text.loop("first", of.beginning) as number:
            self.begin_line(number)
        text.store("i64", 0, self.slot(SLOT.beginning))
        text.jump("under_way")
        text.label("under_way")
        text.branch(text.compare_integers("eq", of.taking, 0), "end", "step")

    def begin_line(self, number):
        """Carry out `Stage.beginning` for the trajectories of a line."""
        text, step, rows, given = self.text, self.step, self.rows, self.step.given
        line, of_line = self.line_at(number), self.values_of(number)
        last, rtol = step.D + step.T, step.D + step.T + 1

        def load_state_or_value(n):
            is_state = n < given
            return self.row(line, rows.base + n) if is_state else self.value(n - step.D, of_line)

        def load(n):
            if n == last:
                return self.row(line, rows.wanted)
            return self.scalar(self.of.rtol) if n == rtol else load_state_or_value(n)

        values = {}
        if step.lift is not None:
            found = {}
            text.carry_out([*step.fixed, *step.prologue], found, load_state_or_value)
            for k, n in enumerate(step.lifted, given):
                values[k] = found[n] if n in found else load_state_or_value(n)
        text.carry_out(step.beginning.operations, values, load)
        places = [rows.base + k for k in range(given)] + [rows.largest + k for k in range(given)]
        places += [rows.wanted, rows.first]
        for n, row in zip(step.beginning.results, places, strict=True):
            self.put_chosen(values[n], line, row)
        self.put(text.constant(1.0), line, rows.least)

    # ------------------------------------------------------------------------------------- one step
    def begin_step(self):
        """Pause where the budget is spent; `taking` lines are being taken."""
        text = self.text
        text.label("step")
        text.add(f"  %taking = phi i64 [ {self.of.taking}, %under_way ], [ %kept1, %stepped ]")
        budget = self.slot(SLOT.budget)
        left = text.load("i64", budget)
        text.branch(text.compare_integers("sgt", left, 0), "begin", "pause")
        text.label("pause")
        text.store("i64", "%taking", self.slot(SLOT.taking))
        text.add("  ret i64 0")
        text.label("begin")
        text.store("i64", text.integer("sub", left, "%taking"), budget)

    def take_column(self, c):
        """Take the stages of a column in all lines, and add its end to the sums."""
        text, of = self.text, self.of
        plan = text.integer("add", of.plan, text.integer("mul", c, 8 * len(COLUMN)))
        stages = text.load("i64", text.plus(plan, 8 * COLUMN.stages))
        scale, weight, second = (
            self.scalar(text.plus(plan, 8 * k))
            for k in (COLUMN.scale, COLUMN.weight, COLUMN.second)
        )
        is_first = text.compare_integers("eq", c, 0)
        with text.loop("prepare", "%taking") as k:
            self.begin_column(self.active(k), scale, is_first)
        is_last = text.compare_integers("eq", text.integer("add", c, 1), of.columns)
        with text.loop("stage", stages) as number:
            with text.loop("each", "%taking") as k:
                self.take_stage(self.line_at(self.active(k)))
            text.branch(is_last, "of_last", "of_all")
            text.label("of_last")
            factor = self.scalar(self.at(of.difference, number))
            with text.loop("differ", "%taking") as k:
                line = self.line_at(self.active(k))
                self.add_changes(line, {self.rows.difference: factor})
            text.jump("of_all")
            text.label("of_all")
        with text.loop("sum", "%taking") as k:
            line = self.line_at(self.active(k))
            self.add_changes(line, {self.rows.total: weight, self.rows.second: second})

    def begin_column(self, number, scale, is_first):
        """Write the table of a line for stages of this scale, and its state before the step."""
        text, step, rows, of = self.text, self.step, self.rows, self.of
        line, place = self.line_at(number), text.load("i64", self.at(of.place, number))
        end = self.scalar(self.at(of.times, place))
        rest = text.operate("fsub", end, self.row(line, rows.time))
        wanted = self.row(line, rows.wanted)
        reach = text.operate("fmul", text.constant(REACH), rest)
        taken = text.select(text.compare("olt", wanted, reach), wanted, rest)
        self.put(taken, line, rows.taken)
        half = text.operate("fmul", scale, taken)
        values, of_line = {}, self.values_of(number)

        def half_of(n):
            value = self.value(n - step.D, of_line)
            return value if n >= step.D + step.T else text.operate("fmul", half, value)

        text.carry_out(step.fixed, values, half_of)
        for n, offset in step.places.items():
            self.put(values[n] if n in values else half_of(n), line, rows.table + offset)
        if step.lift is not None:
            text.branch(is_first, "lift", "lifted")
            text.label("lift")
            self.write_words(line, dict(values), half_of)
            text.jump("lifted")
            text.label("lifted")
        for k in range(step.D):
            self.put(self.row(line, rows.base + k), line, rows.x + k)

    def write_words(self, line, values, half_of):
        """Write the words of the states of a line, and the least pivot, of a lifted field."""
        step, rows, given = self.step, self.rows, self.step.given

        def load(n):
            return self.row(line, rows.base + n) if n < given else half_of(n)

        self.text.carry_out(step.prologue, values, load)
        for k, n in enumerate(step.lifted, given):
            self.put(values[n] if n in values else load(n), line, rows.base + k)
        self.put(values[step.least], line, rows.least)

    def take_stage(self, line):
        """Take a stage of a line."""
        text, step, rows = self.text, self.step, self.rows
        table = text.plus(line, self.size * rows.table)
        for n in range(len(self.before)):
            text.add(f"  call void @{self.name}_{n}(i64 {line}, i64 {table}, i64 {self.of.kept})")
        load, values = loader(text, step, True, line, table, self.of.kept), {}
        text.carry_out(self.usual, values, load)
        after = [values[n] if n in values else load(n) for n in step.after]
        if step.lift is None:
            least = values[step.least] if step.least in values else load(step.least)
            so_far = self.row(line, rows.least)
            is_less = text.compare("olt", least, so_far)
            self.put_chosen(text.select(is_less, least, so_far), line, rows.least)
        for k, (n, value) in enumerate(zip(step.after, after, strict=True)):
            if n >= step.D:
                self.put(value, line, rows.x + k)

    def add_changes(self, line, factors):
        """Add the change of the state in this step, times a factor, to each of these rows."""
        text, rows = self.text, self.rows
        for n in range(self.step.given):
            x, base = self.row(line, rows.x + n), self.row(line, rows.base + n)
            change = text.operate("fsub", x, base)
            for row, factor in factors.items():
                term = text.operate("fmul", factor, change)
                self.put(text.operate("fadd", self.row(line, row + n), term), line, row + n)

    # --------------------------------------------------------------------------------- after a step
    def choose(self):
        """Carry out `Stage.choice` for each line; `kept` of them have times to reach."""
        text, step, rows, of, given = self.text, self.step, self.rows, self.of, self.step.given
        before = text.block
        text.jump("choose")
        text.label("choose")
        text.add(f"  %k = phi i64 [ 0, %{before} ], [ %k1, %chosen ]")
        text.add(f"  %kept = phi i64 [ 0, %{before} ], [ %kept1, %chosen ]")
        number = self.active("%k")
        line, place = self.line_at(number), text.load("i64", self.at(of.place, number))
        first_value = step.D + 4 * given
        inputs = [*range(rows.base, rows.base + first_value), *[None] * step.T]
        inputs += [*range(rows.time, rows.least + 1)]
        of_line = self.values_of(number)

        def load(n):
            if n == len(inputs):
                return self.scalar(self.at(of.times, place))
            if n == len(inputs) + 1:
                return self.scalar(of.rtol)
            if n > len(inputs):  # words of a lifted field, and coefficients of the lift
                word, words = n - len(inputs) - 2, step.D - given
                if word < words:
                    return self.row(line, rows.x + given + word)
                return self.value(step.T + word - words, of_line)
            is_value = inputs[n] is None
            return self.value(n - first_value, of_line) if is_value else self.row(line, inputs[n])

        values, choice = {}, step.choice
        text.carry_out(choice.operations, values, load)
        places = [rows.base + k for k in range(given)] + [rows.largest + k for k in range(given)]
        places += range(rows.time, rows.time + 4)
        for n, row in zip(choice.results, places, strict=True):
            self.put_chosen(values[n], line, row)
        for row in range(rows.total, rows.total + 3 * given):
            self.put(text.constant(0.0), line, row)
        self.put(text.constant(1.0), line, rows.least)
        text.jump("check")
        return number, place

    def save_at_times(self, number, place):
        """Save the states of a line whose trajectories have all reached a time, or ended before."""
        text, rows, of, given = self.text, self.rows, self.of, self.step.given
        text.label("check")
        text.add(f"  %line = phi i64 [ {number}, %choose ], [ %line, %another ], [ %fresh, %fill ]")
        text.add(f"  %place = phi i64 [ {place}, %choose ], [ %place1, %another ], [ 0, %fill ]")
        line, end = self.line_at("%line"), self.scalar(self.at(of.times, "%place"))
        arrived = text.compare("oeq", self.row(line, rows.time), end)
        ended = text.compare("oeq", self.row(line, rows.wanted), text.constant(0.0))
        done = text.joined("or", [arrived, ended])
        text.branch(text.all_true(done), "reached", "goes_on")
        text.label("reached")
        row = text.integer("add", of.states, text.integer("mul", "%place", of.state_bytes))
        text.add(f"  %row = add i64 {row}, 0")
        states = [self.row(line, rows.base + k) for k in range(given)]
        text.jump("save")
        save(text, states, given, of.trajectories, 8)

    def go_on(self):
        """Go on with the next time, with another line in place of one at its end, or with none."""
        text, of = self.text, self.of
        text.label("next")
        text.add("  %place1 = add i64 %place, 1")
        text.branch(text.compare_integers("ult", "%place1", of.count), "another", "finished")
        text.label("another")
        text.jump("check")
        text.label("finished")
        next_at = self.slot(SLOT.next)
        fresh = text.load("i64", next_at)
        text.add(f"  %fresh = add i64 {fresh}, 0")
        text.branch(text.compare_integers("ult", "%fresh", of.lines), "fill", "drop")
        text.label("fill")
        text.store("i64", text.integer("add", "%fresh", 1), next_at)
        text.jump("check")
        text.label("drop")
        text.jump("chosen")
        text.label("goes_on")
        text.store("i64", "%line", self.at(of.active, "%kept"))
        text.store("i64", "%place", self.at(of.place, "%line"))
        more = text.integer("add", "%kept", 1)
        text.jump("chosen")
        text.label("chosen")
        text.add(f"  %kept1 = phi i64 [ %kept, %drop ], [ {more}, %goes_on ]")
        text.add("  %k1 = add i64 %k, 1")
        text.branch(text.compare_integers("ult", "%k1", "%taking"), "choose", "stepped")
        text.label("stepped")
        text.branch(text.compare_integers("eq", "%kept1", 0), "end", "step")
        text.label("end")
        text.add("  ret i64 1")
