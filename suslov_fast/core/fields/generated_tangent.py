"""Machine code of derivatives along orbits: products of -DPhi with columns, and Gram-Schmidt.

`lists.step.Tangent` has the operations of a step; `tangent` takes the steps that they cannot take.
"""

from ..code.compiler import numbers_in_register
from ..code.text import Carried, Code, Index, Truth, Value
from ..compiling.codes import CHANGED as OF_CHANGED
from ..lists.step import length_of
from .stage_code import Stage, loader

# Rows of a line: the state; the numbers below; the products of the lengths of D columns; columns.
# VOLUME is abs(det) of the columns, and (1 + NEAR_1) FAR_FROM_1 is the product of abs(det DPhi).
VOLUME, NEAR_1, FAR_FROM_1, LENGTHS = range(4)
# Products keep their digits within these ranges. The logarithm is taken of one that leaves them.
NEAR_1_LEAST, NEAR_1_LARGEST, LEAST_LENGTH, LARGEST_LENGTH = -0.999, 1e3, 1e-100, 1e100
# Columns are orthonormalised where they may lose digits. Let D columns have |det| = d and squared
# lengths with the mean m. Then d**2 <= m**D, with equality for orthogonal columns of equal lengths.
# A column of length p with a part t orthogonal to the others has
# d**2 <= t**2 ((D m - p**2) / (D - 1))**(D - 1) <= m**D (t / p)**2. Rounding errors are multiplied
# by p / t at most, which is below LIMIT while m**D is below LIMIT**2 d**2.
LIMIT, LEAST_SIZE, LARGEST_SIZE = 64.0, 1e-100, 1e100
# The code returns how many steps it took, and from these places on the bits of lanes: whose step or
# whose derivative is not accurate, so that no lane took the step; from det A < 0; with columns to
# be orthonormalised; with logarithms to be taken; in which a component changed its sign; whose
# columns lose digits soon. The last do not stop the steps.
STEP, DERIVATIVE, NEGATIVE, DUE, OUTSIDE, CHANGED, SOON = range(8, 64, 8)
# Instructions of the loop over columns, besides loads and stores. Several columns are multiplied at
# once while there are no more, because a longer loop exceeds the processor's instruction cache.
MOST_IN_LOOP = 1700


def room_of(D, W):
    """Return for how many columns there is room.

    Component i of column r of a line is in row 2 D + LENGTHS + i * room + r. If W is 1, the columns
    are lanes of a vector. Otherwise four at once may go beyond column D - 1, and `room` is odd,
    because components an even number of lines apart would share the same sets of the first cache.
    """
    if W == 1:
        at_once = columns_at_once(D, W, ())
        return -(-D // at_once) * at_once
    return (D + 3) | 1


def columns_at_once(D, W, operations):
    """Return how many columns are multiplied at once, by these operations for each."""
    if W == 1:
        return min(4, 1 << (D - 1).bit_length())
    length = length_of(operations) * W // min(numbers_in_register(), W)
    fitting = [n for n in (4, 3, 2) if n * length <= MOST_IN_LOOP and D > 1]
    return min(fitting, key=lambda n: -(-D // n) * n, default=1)


def text_of_tangent(tangent, name, W, for_each):
    """Return the text of i64 name(line, table, kept, plan, ignored, steps): steps of a line.

    Columns q become -DPhi q; `kept` and `plan` are for `long_tangent`. The code returns the number
    of steps with bits of lanes, see STEP. It stops after a step with such bits, and before a step
    that is not accurate. Bits in `ignored` mark lanes that do not stop it.
    """
    text, D, all_lanes = Code(W), tangent.D, (1 << W) - 1
    text.begin(name, "line", "table", "kept", "plan", "ignored", "steps")
    of_columns = {*tangent.column, *(number for _, number, _ in tangent.columns)}
    operands = (number for *_, operands in tangent.columns for number in operands)
    needed = [
        number
        for number in dict.fromkeys([*operands, *tangent.scaled])
        if isinstance(number, int) and number not in of_columns
    ]
    line, load = text.array("%line"), loader(text, tangent, for_each, "%line", "%table")
    for now in text.rounds(Carried(n=0)):
        carried = [line[D + k] for k in range(LENGTHS)]
        x, stage = [line[i] for i in range(D)], Stage(text, tangent, load)
        usual = stage.take(x, enumerate(carried, D + tangent.T))
        for number in needed:
            if number not in stage.values:
                stage.values[number] = load(number)
        others = Index(text, "%ignored") ^ all_lanes

        def rare(n=now.n, stage=stage, others=others):
            after, _, good, told, values = stage.take_rare()
            told = told & (good & others) * (1 | 1 << OF_CHANGED)
            told = (told & all_lanes) << NEGATIVE | told >> OF_CHANGED << CHANGED
            both = good, Truth(text, values[tangent.derived]).bits()
            step, derivative = ((bits ^ all_lanes) & others for bits in both)
            with text.when((step | derivative).differs(0)):
                text.leave(f"i64 {n | told | step << STEP | derivative << DERIVATIVE}")
            return [*after, told]

        *after, flags = text.otherwise(stage.is_good(), [*usual, 0], rare)
        length = _columns(text, tangent, stage.values)
        mean, power = (1.0 / D) * length, 1.0
        for _ in range(D):
            power = power * mean
        scaled = [Value(text, stage.values[number]) for number in tangent.scaled]
        volume, near_1, far = scaled
        most = LIMIT * volume
        fine = (length > LEAST_SIZE) & (length < LARGEST_SIZE) & (power < most * most)
        outside = (near_1 <= NEAR_1_LEAST) | (near_1 >= NEAR_1_LARGEST)
        outside = outside | (far <= LEAST_LENGTH) | (far >= LARGEST_LENGTH)
        flags = flags | ((fine.bits() ^ all_lanes) & others) << DUE
        flags = flags | (outside.bits() & others) << OUTSIDE
        for k, value in enumerate([*after, *scaled]):
            line[k] = value
        less = most * volume  # the square root of LIMIT for LIMIT
        now.n = now.n + 1
        now.goes_on = flags.equals(0) & (now.n < "%steps")
    soon = ((power < less).bits() ^ all_lanes) << SOON
    text.add(f"  ret i64 {now.n | (flags | soon)}")
    return text.finished()


def _columns(text, tangent, values):
    """Add a loop that multiplies the columns; return the sum of their squared lengths after it."""
    D, width, values = tangent.D, text.W, dict(values)
    at_once, room = columns_at_once(D, width, tangent.columns), room_of(D, width)
    if text.W == 1 and at_once > 1:  # columns are lanes
        width = at_once
        used = {operand for _, _, operands in tangent.columns for operand in operands}
        for number in sorted(used & values.keys() - {*tangent.column}):
            values[number] = text.lanes(width).splat(values[number])
    inner = Code(width, text, text.size * room)  # from component to component of a column
    first = text.array("%line").at(2 * D + LENGTHS)
    for now in text.rounds(Carried(r=0, length=0.0)):
        begin = first + now.r * text.size
        columns = []
        for c in range(at_once if text.W > 1 else 1):
            columns.append((inner.array(begin + text.size * c), dict(values)))
        # Columns take turns, because an operation waits for the one before it of the same column.
        for operation in tangent.columns:
            for q, own in columns:
                inner.carry_out([operation], own, lambda n, q=q: q[n - tangent.column[0]])
        for q, own in columns:
            square = None
            for i, number in enumerate(tangent.products):
                q[i] = value = Value(inner, own[number])
                square = value * value if square is None else square + value * value
            if width == text.W:
                now.length = now.length + square
            for k in range(width if width > text.W else 0):
                element = text.new(f"extractelement {inner.V} {square}, i32 {k}")
                now.length = now.length + Value(text, element)
        now.r = now.r + at_once
        now.goes_on = now.r < D
    return now.length


def text_of_orthonormalise(name, D, W):
    """Return the text of i64 name(columns, carried, due, ...): modified Gram-Schmidt for a line.

    The code takes the addresses of the columns and of VOLUME, and bits of lanes that are due; it
    returns 0. The products of lengths are multiplied by the lengths. VOLUME becomes 1; or 0 if a
    column is 0, because then it does not show how the other columns grow.
    """
    # With a function of Numba instead, exponents take 1.05 to 1.65 times as long. Its loops over
    # lanes are no SIMD, because the compiler does not know that rows do not overlap.
    text = Code(W)
    columns = Code(W, text, text.size * room_of(D, W))  # from component to component
    text.begin(name, "columns", "carried", "due", "kept", "plan")  # two for `long_tangent`
    bits = text.new(f"trunc i64 %due to i{W}")
    due = Truth(text, text.new(f"bitcast i{W} {bits} to {text.M}") if W > 1 else bits)
    is_due, carried = due.select(1.0, 0.0), text.array("%carried")

    def column(r):
        return columns.array(Index(text, "%columns") + r * text.size)

    for now in text.rounds(Carried(r=0, volume=due.select(1.0, carried[VOLUME]))):
        q, first = column(now.r), column(Index(text, 0))
        products = [first[i] * q[i] for i in range(D)]
        product = sum(products[1:], products[0])

        def subtract_all(r=now.r, q=q, product=product):
            for at in text.rounds(Carried(s=0, product=product)):
                part, earlier, products = at.product * is_due, column(at.s), []
                at.s = at.s + 1
                later = column(at.s)
                for i in range(D):
                    q[i] = x = q[i] - part * earlier[i]
                    products.append(later[i] * x)
                at.product = sum(products[1:], products[0])
                at.goes_on = at.s < r
            return [at.product]

        [square] = text.otherwise(now.r.equals(0), [product], subtract_all, likely=None)
        length = due.select(square.sqrt(), 1.0)
        lengths = carried.from_here(LENGTHS)
        lengths[now.r] = lengths[now.r] * length
        is_0 = length.equals(0.0)
        now.volume = now.volume * is_0.select(0.0, 1.0)
        inverse = is_0.select(0.0, 1.0 / length)
        for i in range(D):
            q[i] = q[i] * inverse
        now.r = now.r + 1
        now.goes_on = now.r < D
    carried[VOLUME] = now.volume
    text.add("  ret i64 0")
    return text.finished()
