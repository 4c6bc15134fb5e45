"""Machine code of the motion of a field to a tolerance, from the lists of `tolerance`.

The code takes lines of lanes, a few at a time, so that their rows stay in the first cache, and
takes another line whenever one has reached all times. The lanes of a line wait for each other at
each time, by steps of length 0.
"""

from typing import NamedTuple

from .generated import loader, piece_function, save
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
    total: int  # sum of weights times ends of columns (n, the `given` components)
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
    text, D, given, size = Text(W), step.D, step.given, 8 * W
    integer, V, rows = text.integer, text.V, rows_of(step)
    (*before, usual), _ = step.pieces
    for k, piece in enumerate(before):
        piece_function(text, step, f"{name}_{k}", piece, True)
    text.add(f"define i64 @{name}(i64 %arguments) #0 {{")
    text.label("entry")
    of = FlowArguments(*(text.load("i64", text.plus("%arguments", 8 * k)) for k in SLOT))

    def line_at(number):
        """Return the address of the rows of a line."""
        return integer("add", of.rows, integer("mul", number, rows.size * size))

    def numbers(line, row, count=D):
        return [text.plus(line, size * (row + k)) for k in range(count)]

    def row(line, row):
        return text.load(V, text.plus(line, size * row))

    def active(k):
        return text.load("i64", integer("add", of.active, integer("mul", k, 8)))

    def at(array, number):
        return integer("add", array, integer("mul", number, 8))

    def scalar(address):
        value = text.load("double", address)
        return value if W == 1 else text.splat(value, W)

    def value_of(t, of_line):
        address = text.plus(of_line, (size if for_each else 8) * t)
        return text.load(V, address) if for_each else scalar(address)

    def values_of(line):
        """Return the address of the values v of the lanes of a line."""
        if for_each:
            return integer("add", of.values, integer("mul", line, size * step.parameters))
        return of.values

    text.branch(text.compare_integers("eq", of.beginning, 0), "under_way", "begins")
    text.label("begins")
    with text.loop("first", of.beginning) as k:
        of_line = values_of(k)
        begin_line(text, step, line_at(k), lambda t, v=of_line: value_of(t, v), of.rtol)
    text.store("i64", 0, text.plus("%arguments", 8 * SLOT.beginning))
    text.jump("under_way")
    text.label("under_way")
    text.branch(text.compare_integers("eq", of.taking, 0), "end", "step")

    text.label("step")
    text.add(f"  %taking = phi i64 [ {of.taking}, %under_way ], [ %kept1, %stepped ]")
    budget_at = text.plus("%arguments", 8 * SLOT.budget)
    left = text.load("i64", budget_at)
    text.branch(text.compare_integers("sgt", left, 0), "begin", "pause")
    text.label("pause")
    text.store("i64", "%taking", text.plus("%arguments", 8 * SLOT.taking))
    text.add("  ret i64 0")
    text.label("begin")
    text.store("i64", integer("sub", left, "%taking"), budget_at)
    zero, one = text.constant(0.0), text.constant(1.0)

    with text.loop("column", of.columns) as c:
        plan = integer("add", of.plan, integer("mul", c, 32))
        stages = text.load("i64", text.plus(plan, 8 * COLUMN.stages))
        scale, weight, second = (
            scalar(text.plus(plan, 8 * k)) for k in (COLUMN.scale, COLUMN.weight, COLUMN.second)
        )
        is_first = text.compare_integers("eq", c, 0)

        def from_0(value, first, is_first=is_first):
            return text.new(f"select i1 {is_first}, {V} {first}, {V} {value}")

        with text.loop("prepare", "%taking") as k:
            number = active(k)
            line, place = line_at(number), text.load("i64", at(of.place, number))
            end = scalar(at(of.times, place))
            rest = text.operate("fsub", end, row(line, rows.time))
            wanted = row(line, rows.wanted)
            reach = text.operate("fmul", text.constant(REACH), rest)
            taken = text.select(text.compare("olt", wanted, reach), wanted, rest)
            text.store(V, taken, text.plus(line, size * rows.taken))
            text.store(V, from_0(row(line, rows.least), one), text.plus(line, size * rows.least))
            half = text.operate("fmul", scale, taken)
            values, of_line = {}, values_of(number)

            def half_of(number, of_line=of_line, half=half):
                value = value_of(number - D, of_line)
                return value if number >= D + step.T else text.operate("fmul", half, value)

            text.carry_out(step.fixed, values, half_of)
            for number, offset in step.places.items():
                value = values[number] if number in values else half_of(number)
                text.store(V, value, text.plus(line, size * (rows.table + offset)))
            if step.lift is not None:
                begin_step(text, step, is_first, line, dict(values), half_of)
            for x, base in zip(numbers(line, rows.x), numbers(line, rows.base), strict=True):
                text.store(V, text.load(V, base), x)

        is_last = text.compare_integers("eq", integer("add", c, 1), of.columns)

        def stage(k):
            line = line_at(active(k))
            table = text.plus(line, size * rows.table)
            for n in range(len(before)):
                text.add(f"  call void @{name}_{n}(i64 {line}, i64 {table}, i64 {of.kept})")
            load, values = loader(text, step, True, line, table, of.kept), {}
            text.carry_out(usual, values, load)
            after = [values[n] if n in values else load(n) for n in step.after]
            if step.lift is None:
                least = values[step.least] if step.least in values else load(step.least)
                so_far = row(line, rows.least)
                is_less = text.compare("olt", least, so_far)
                least = text.select(is_less, least, so_far)
                text.store(V, least, text.plus(line, size * rows.least))
            for n, value, x in zip(step.after, after, numbers(line, rows.x), strict=True):
                if n >= D:
                    text.store(V, value, x)

        with text.loop("stage", stages) as number_of_stage:
            with text.loop("each", "%taking") as k:
                stage(k)
            text.branch(is_last, "of_last", "of_all")
            text.label("of_last")
            factor = scalar(at(of.difference, number_of_stage))
            begins = text.compare_integers("eq", number_of_stage, 0)
            with text.loop("differ", "%taking") as k:
                line = line_at(active(k))
                for n in range(given):
                    change = text.operate("fsub", row(line, rows.x + n), row(line, rows.base + n))
                    so_far = from_0(row(line, rows.difference + n), zero, begins)
                    term = text.operate("fadd", so_far, text.operate("fmul", factor, change))
                    text.store(V, term, text.plus(line, size * (rows.difference + n)))
            text.jump("of_all")
            text.label("of_all")

        with text.loop("sum", "%taking") as k:
            line = line_at(active(k))
            for n in range(given):
                change = text.operate("fsub", row(line, rows.x + n), row(line, rows.base + n))
                for first, factor in ((rows.total, weight), (rows.second, second)):
                    so_far = from_0(row(line, first + n), zero)
                    term = text.operate("fmul", factor, change)
                    term = text.operate("fadd", so_far, term)
                    text.store(V, term, text.plus(line, size * (first + n)))

    before_choice = text.block
    text.jump("choose")
    text.label("choose")
    text.add(f"  %k = phi i64 [ 0, %{before_choice} ], [ %k1, %chosen ]")
    text.add(f"  %kept = phi i64 [ 0, %{before_choice} ], [ %kept1, %chosen ]")
    number = active("%k")
    line, place = line_at(number), text.load("i64", at(of.place, number))
    first_value = D + 4 * given
    inputs = [*range(rows.base, rows.base + first_value), *[None] * step.T]
    inputs += [*range(rows.time, rows.least + 1)]
    of_line = values_of(number)

    def load(n):
        if n == len(inputs):
            return scalar(at(of.times, place))
        if n == len(inputs) + 1:
            return scalar(of.rtol)
        if n > len(inputs):  # words of a lifted field, and coefficients of the lift
            word, words = n - len(inputs) - 2, D - given
            if word < words:
                return row(line, rows.x + given + word)
            return value_of(step.T + word - words, of_line)
        return value_of(n - first_value, of_line) if inputs[n] is None else row(line, inputs[n])

    values, choice = {}, step.choice
    text.carry_out(choice.operations, values, load)
    places = numbers(line, rows.base, given) + numbers(line, rows.largest, given)
    places += numbers(line, rows.time, 4)
    for n, address in zip(choice.results, places, strict=True):
        text.store(V, values[n], address)
    text.jump("check")

    text.label("check")
    text.add(f"  %line = phi i64 [ {number}, %choose ], [ %line, %another ], [ %fresh, %fill ]")
    text.add(f"  %place = phi i64 [ {place}, %choose ], [ %place1, %another ], [ 0, %fill ]")
    line = line_at("%line")
    arrived = text.compare("oeq", row(line, rows.time), scalar(at(of.times, "%place")))
    ended = text.compare("oeq", row(line, rows.wanted), zero)
    done = text.joined("or", [arrived, ended])
    text.branch(text.all_true(done), "reached", "goes_on")
    text.label("reached")
    row_at = integer("add", of.states, integer("mul", "%place", of.state_bytes))
    text.add(f"  %row = add i64 {row_at}, 0")
    states = [text.load(V, address) for address in numbers(line, rows.base, given)]
    text.jump("save")
    save(text, states, given, of.trajectories, 8)
    text.label("next")
    text.add("  %place1 = add i64 %place, 1")
    text.branch(text.compare_integers("ult", "%place1", of.count), "another", "finished")
    text.label("another")
    text.jump("check")
    text.label("finished")
    next_at = text.plus("%arguments", 8 * SLOT.next)
    fresh = text.load("i64", next_at)
    text.add(f"  %fresh = add i64 {fresh}, 0")
    text.branch(text.compare_integers("ult", "%fresh", of.lines), "fill", "drop")
    text.label("fill")
    text.store("i64", integer("add", "%fresh", 1), next_at)
    text.jump("check")
    text.label("drop")
    text.jump("chosen")
    text.label("goes_on")
    text.store("i64", "%line", at(of.active, "%kept"))
    text.store("i64", "%place", at(of.place, "%line"))
    more = integer("add", "%kept", 1)
    text.jump("chosen")
    text.label("chosen")
    text.add(f"  %kept1 = phi i64 [ %kept, %drop ], [ {more}, %goes_on ]")
    text.add("  %k1 = add i64 %k, 1")
    text.branch(text.compare_integers("ult", "%k1", "%taking"), "choose", "stepped")
    text.label("stepped")
    text.branch(text.compare_integers("eq", "%kept1", 0), "end", "step")
    text.label("end")
    text.add("  ret i64 1")
    return text.finished()


def begin_line(text, step, line, value_of, rtol):
    """Add the beginning of the trajectories of a line; `value_of` loads a value of a term."""
    rows, D, given = rows_of(step), step.D, step.given

    def address(row):
        return text.plus(line, 8 * text.W * row)

    def load(n):
        """Return a value by its number in the lists of `Step`."""
        return text.load(text.V, address(rows.base + n)) if n < given else value_of(n - D)

    values = {}
    if step.lift is not None:
        found = {}
        text.carry_out([*step.fixed, *step.prologue], found, load)
        words = enumerate(step.lifted, given)
        values = {k: found[n] if n in found else load(n) for k, n in words}

    def load_more(n):
        if n < D + step.T:
            return load(n)
        if n == D + step.T:
            return text.load(text.V, address(rows.wanted))
        number = text.load("double", rtol)
        return number if text.W == 1 else text.splat(number, text.W)

    beginning = step.beginning
    text.carry_out(beginning.operations, values, load_more)
    places = [rows.base + k for k in range(given)] + [rows.largest + k for k in range(given)]
    for n, row in zip(beginning.results, [*places, rows.wanted, rows.first], strict=True):
        text.store(text.V, values[n], address(row))


def begin_step(text, step, is_first, line, values, half_of):
    """Add the beginning of a step of a lifted field: words of the state, and the least pivot.

    `values` and `half_of` are those of parameters alone.
    """
    rows, given = rows_of(step), step.given

    def address(row):
        return text.plus(line, 8 * text.W * row)

    def load(number):
        is_state = number < given
        return text.load(text.V, address(rows.base + number)) if is_state else half_of(number)

    text.branch(is_first, "lift", "lifted")
    text.label("lift")
    text.carry_out(step.prologue, values, load)
    for k, number in enumerate(step.lifted, given):
        value = values[number] if number in values else load(number)
        text.store(text.V, value, address(rows.base + k))
    text.store(text.V, values[step.least], address(rows.least))
    text.jump("lifted")
    text.label("lifted")
