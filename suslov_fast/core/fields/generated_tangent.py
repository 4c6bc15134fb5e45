"""Machine code of derivatives along orbits: products of -DPhi with columns, and Gram-Schmidt.

`operations.Tangent` has the operations of a step; `tangent` takes the steps that they cannot take.
"""

from ..code.compiler import numbers_in_register
from ..code.text import Code as Text
from ..lists.step import length_of
from .generated import loader

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


def text_of_tangent(tangent, name, W, for_each, _):
    """Return the text of i64 name(line, table, kept, plan, ignored, steps): steps of a line.

    Columns q become -DPhi q; `kept` and `plan` are for `long_tangent`. The code returns the number
    of steps with bits of lanes, see STEP. It stops after a step with such bits, and before a step
    that is not accurate. Bits in `ignored` mark lanes that do not stop it.
    """
    text, D, size, all_lanes = Text(W), tangent.D, 8 * W, (1 << W) - 1
    new, integer, V = text.new, text.integer, text.V
    at_once, room = columns_at_once(D, W, tangent.columns), room_of(D, W)
    arguments = "i64 %line, i64 %table, i64 %kept, i64 %plan, i64 %ignored, i64 %steps"
    text.add(f"define i64 @{name}({arguments}) #0 {{")
    text.label("entry")
    places = [text.plus("%line", size * i) for i in range(2 * D + LENGTHS)]
    text.jump("step")

    text.label("step")
    text.add("  %n = phi i64 [ 0, %entry ], [ %n1, %next ]")
    carried = [text.load(V, places[D + k]) for k in range(LENGTHS)]
    values = {i: text.load(V, places[i]) for i in range(D)}
    values |= dict(enumerate(carried, D + tangent.T))

    load = loader(text, tangent, for_each, "%line", "%table")
    text.carry_out(tangent.usual, values, load)
    of_columns = {*tangent.column, *(number for _, number, _ in tangent.columns)}
    operands = (number for *_, operands in tangent.columns for number in operands)
    results = [*tangent.after, *tangent.scaled]
    for number in dict.fromkeys([*operands, *results]):
        if isinstance(number, int) and number not in of_columns and number not in values:
            values[number] = load(number)
    text.branch(text.all_true(values[tangent.good]), "columns", "rare", likely=True)

    text.label("rare")
    rare = dict(values)
    text.carry_out(tangent.rare, rare, load)
    others = integer("xor", "%ignored", all_lanes)
    accurate, derived = text.bits(rare[tangent.accurate]), text.bits(rare[tangent.derived])
    negative = integer("and", integer("and", accurate, text.bits(rare[tangent.negative])), others)
    changed = "0"
    if tangent.changed is not None:
        changed = integer("and", accurate, text.bits(rare[tangent.changed]))
        changed = integer("shl", integer("and", changed, others), CHANGED)
    bad = [integer("and", integer("xor", bits, all_lanes), others) for bits in (accurate, derived)]
    is_bad = text.compare_integers("ne", integer("or", *bad), 0)
    text.branch(is_bad, "stop", "columns")
    text.label("stop")
    flags = "%n"
    for bits, shift in zip((*bad, negative), (STEP, DERIVATIVE, NEGATIVE), strict=True):
        flags = integer("or", flags, integer("shl", bits, shift))
    text.add(f"  ret i64 {integer('or', flags, changed)}")

    text.label("columns")
    text.add(f"  %negative = phi i64 [ 0, %step ], [ {negative}, %rare ]")
    text.add(f"  %changed = phi i64 [ 0, %step ], [ {changed}, %rare ]")
    after = [
        new(f"phi {V} [ {values[usual]}, %step ], [ {rare[other]}, %rare ]")
        for usual, other in zip(tangent.after, tangent.after_rare, strict=True)
    ]
    length = _columns(text, tangent, values, places[-1], at_once, room)

    text.label("due")
    mean, power = text.operate("fmul", text.constant(1.0 / D), length), text.constant(1.0)
    for _ in range(D):
        power = text.operate("fmul", power, mean)
    scaled = [values[number] for number in tangent.scaled]
    most = text.operate("fmul", text.constant(LIMIT), scaled[VOLUME])
    fine = [
        text.compare("ogt", length, text.constant(LEAST_SIZE)),
        text.compare("olt", length, text.constant(LARGEST_SIZE)),
        text.compare("olt", power, text.operate("fmul", most, most)),
    ]
    outside = [
        text.compare(how, scaled[k], text.constant(limit))
        for k, how, limit in (
            (NEAR_1, "ole", NEAR_1_LEAST),
            (NEAR_1, "oge", NEAR_1_LARGEST),
            (FAR_FROM_1, "ole", LEAST_LENGTH),
            (FAR_FROM_1, "oge", LARGEST_LENGTH),
        )
    ]
    due = integer("xor", text.bits(text.joined("and", fine)), all_lanes)
    flags = integer("or", "%changed", integer("shl", "%negative", NEGATIVE))
    for bits, shift in ((due, DUE), (text.bits(text.joined("or", outside)), OUTSIDE)):
        bits = integer("and", bits, integer("xor", "%ignored", all_lanes))
        flags = integer("or", flags, integer("shl", bits, shift))
    for value, place in zip([*after, *scaled], places, strict=False):
        text.store(V, value, place)
    text.add("  %n1 = add i64 %n, 1")
    is_clear = text.compare_integers("eq", flags, 0)
    goes_on = new(f"and i1 {is_clear}, {text.compare_integers('ult', '%n1', '%steps')}")
    text.branch(goes_on, "next", "end")
    text.label("next")
    text.jump("step")
    text.label("end")
    less = text.operate("fmul", most, scaled[VOLUME])  # the square root of LIMIT for LIMIT
    soon = integer("xor", text.bits(text.compare("olt", power, less)), all_lanes)
    flags = integer("or", flags, integer("shl", soon, SOON))
    text.add(f"  ret i64 {integer('or', '%n1', flags)}")
    return text.finished()


def _columns(text, tangent, values, last, at_once, room):
    """Add a loop that multiplies the columns; return the sum of their squared lengths after it."""
    D, new, integer, size, V = tangent.D, text.new, text.integer, 8 * text.W, text.V
    width, values = text.W, dict(values)
    if text.W == 1 and at_once > 1:  # columns are lanes
        width = at_once
        used = {operand for _, _, operands in tangent.columns for operand in operands}
        for number in sorted(used & values.keys() - {*tangent.column}):
            values[number] = text.splat(values[number], width)
    inner = Text(width, text)
    first = integer("add", last, size)
    text.jump("column")
    text.label("column")
    text.add("  %r = phi i64 [ 0, %columns ], [ %r1, %column ]")
    text.add(f"  %length = phi {V} [ {text.constant(0.0)}, %columns ], [ %length1, %column ]")
    column, length = integer("add", first, integer("mul", "%r", size)), "%length"
    columns = []
    for c in range(at_once if text.W > 1 else 1):
        places = [text.plus(column, size * (i * room + c)) for i in range(D)]
        columns.append((places, dict(values)))
    # Columns take turns, because an operation waits for the one before it of the same column.
    for operation in tangent.columns:
        for places, own in columns:
            inner.carry_out(
                [operation], own, lambda n, p=places: inner.load(inner.V, p[n - tangent.column[0]])
            )
    for places, own in columns:
        square = None
        for i, number in enumerate(tangent.products):
            inner.store(inner.V, own[number], places[i])
            product = inner.operate("fmul", own[number], own[number])
            square = product if square is None else inner.operate("fadd", square, product)
        if width == text.W:
            length = text.operate("fadd", length, square)
        for k in range(width if width > text.W else 0):
            element = new(f"extractelement {inner.V} {square}, i32 {k}")
            length = text.operate("fadd", length, element)
    text.add(f"  %length1 = fadd {V} {length}, {text.constant(-0.0)}")
    text.add(f"  %r1 = add i64 %r, {at_once}")
    text.branch(text.compare_integers("ult", "%r1", D), "column", "due")
    return "%length1"


def text_of_orthonormalise(step, name, W, *_):
    """Return the text of i64 name(columns, carried, due, ...): `lengths.orthonormalise` for a line.

    The code takes the addresses of the columns and of VOLUME, and bits of lanes; it returns 0. It
    depends on D alone.
    """
    # With `lengths.orthonormalise` instead, exponents take 1.05 to 1.65 times as long. Its loops
    # over lanes are no SIMD, because the compiler does not know that rows do not overlap.
    text, D, size = Text(W), step.D, 8 * W
    new, integer, V, room = text.new, text.integer, text.V, room_of(D, W)
    arguments = (
        "i64 %columns, i64 %carried, i64 %due, i64 %kept, i64 %plan"  # two of `long_tangent`
    )
    text.add(f"define i64 @{name}({arguments}) #0 {{")
    text.label("entry")
    due = new(f"trunc i64 %due to i{W}")
    due = new(f"bitcast i{W} {due} to {text.M}") if W > 1 else due
    is_due = text.select(due, text.constant(1.0), text.constant(0.0))
    volume = text.select(due, text.constant(1.0), text.load(V, "%carried"))
    text.jump("column")

    def at(r):
        """Return the addresses of the components of column r."""
        first = integer("add", "%columns", integer("mul", r, size))
        return [text.plus(first, size * room * i) for i in range(D)]

    def total(pairs):
        """Return the sum of products of values in pairs, in this order."""
        result, *products = [text.operate("fmul", a, b) for a, b in pairs]
        for product in products:
            result = text.operate("fadd", result, product)
        return result

    text.label("column")
    text.add("  %r = phi i64 [ 0, %entry ], [ %r1, %scale ]")
    text.add(f"  %volume = phi {V} [ {volume}, %entry ], [ %volume1, %scale ]")
    places, first = at("%r"), at("0")
    product = total(
        [(text.load(V, a), text.load(V, b)) for a, b in zip(first, places, strict=True)]
    )
    text.branch(text.compare_integers("eq", "%r", 0), "scale", "subtract")

    text.label("subtract")
    text.add("  %s = phi i64 [ 0, %column ], [ %s1, %subtract ]")
    text.add(f"  %product = phi {V} [ {product}, %column ], [ %product1, %subtract ]")
    part, pairs = text.operate("fmul", "%product", is_due), []
    text.add("  %s1 = add i64 %s, 1")
    for place, earlier, later in zip(places, at("%s"), at("%s1"), strict=True):
        x = text.operate("fmul", part, text.load(V, earlier))
        x = text.operate("fsub", text.load(V, place), x)
        text.store(V, x, place)
        pairs.append((text.load(V, later), x))
    text.add(f"  %product1 = fadd {V} {total(pairs)}, {text.constant(-0.0)}")
    text.branch(text.compare_integers("ult", "%s1", "%r"), "subtract", "scale")

    text.label("scale")
    text.add(f"  %square = phi {V} [ {product}, %column ], [ %product1, %subtract ]")
    root = text.root("%square")
    length = text.select(due, root, text.constant(1.0))
    place = text.plus(integer("add", "%carried", integer("mul", "%r", size)), size * LENGTHS)
    text.store(V, text.operate("fmul", text.load(V, place), length), place)
    is_0 = text.compare("oeq", length, text.constant(0.0))
    nonzero = text.operate(
        "fmul", "%volume", text.select(is_0, text.constant(0.0), text.constant(1.0))
    )
    text.add(f"  %volume1 = fadd {V} {nonzero}, {text.constant(-0.0)}")
    inverse = text.select(
        is_0, text.constant(0.0), text.operate("fdiv", text.constant(1.0), length)
    )
    for place in places:
        text.store(V, text.operate("fmul", text.load(V, place), inverse), place)
    text.add("  %r1 = add i64 %r, 1")
    text.branch(text.compare_integers("ult", "%r1", D), "column", "end")
    text.label("end")
    text.store(V, "%volume1", "%carried")
    text.add("  ret i64 0")
    return text.finished()
