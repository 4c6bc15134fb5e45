"""Machine code for derivatives along orbits: steps with columns, and orthonormal columns.

See `generated` for the steps themselves, and `tangent` for what the code leaves.
"""

from .machine_code import Text

# Rows of a line of `text_of_tangent`, after the state: abs(det) of the columns, and the two
# products of the factors of abs(det DPhi); then products of D lengths, and columns.
VOLUME, NEAR_1, FAR_FROM_1, LENGTHS = range(4)
# Logarithms are taken of products that leave these ranges: what lies within keeps its digits.
NEAR_1_LEAST, NEAR_1_LARGEST, LEAST_LENGTH, LARGEST_LENGTH = -0.999, 1e3, 1e-100, 1e100
# Columns are orthonormalised where they may lose digits. Of D columns with |det| = d, whose squared
# lengths have the mean m, d**2 <= m**D, and equality means that they are orthogonal and equally
# long. A column of length p with a part t across the others has
# d**2 <= t**2 ((D m - p**2) / (D - 1))**(D - 1) <= m**D (t / p)**2. So while m**D is below
# LIMIT**2 d**2, p / t is below LIMIT, by which errors of rounding are multiplied at most.
LIMIT, LEAST_SIZE, LARGEST_SIZE = 64.0, 1e-100, 1e100
# Bits of lanes in what the code returns, above the number of steps: of those whose step or whose
# derivative is not accurate, so that none is taken; of those from det A < 0, with columns to be
# orthonormalised, with logarithms to be taken.
STEP, DERIVATIVE, NEGATIVE, DUE, OUTSIDE = range(16, 56, 8)


def columns_of(D, W):
    """Return how many columns are multiplied at once, and how many there is room for.

    Component i of column r of a line is in row 2 D + LENGTHS + i * room + r. Columns of one lane
    are lanes of a vector; those of several lie an odd number of lines apart.
    """
    if W > 1:
        at_once = min((4, 3, 2), key=lambda n: -(-D // n) * n) if D > 1 else 1
        return at_once, -(-D // at_once) * at_once | 1
    at_once = min(4, 1 << (D - 1).bit_length())
    return at_once, -(-D // at_once) * at_once


def text_of_tangent(tangent, name, W, for_each, _):
    """Return the text of i64 name(line, table, ignored, steps): steps of one line, with columns.

    Columns q become -DPhi q. It returns how many steps were taken, with bits of lanes; it stops at
    a step with such bits, and before one that lanes whose bit is not in `ignored` cannot take.
    """
    t, D, size, every = Text(W), tangent.D, 8 * W, (1 << W) - 1
    new, integer, V = t.new, t.integer, t.V
    at_once, room = columns_of(D, W)
    t.add(f"define i64 @{name}(i64 %line, i64 %table, i64 %ignored, i64 %steps) #0 {{")
    t.label("entry")
    places = [t.plus("%line", size * i) for i in range(2 * D + LENGTHS)]
    t.add("  br label %step")

    t.label("step")
    t.add("  %n = phi i64 [ 0, %entry ], [ %n1, %next ]")
    carried = [t.load(V, places[D + k]) for k in range(LENGTHS)]
    values = {i: t.load(V, places[i]) for i in range(D)}
    values |= dict(enumerate(carried, D + tangent.T))

    def of_table(number):
        address = t.plus("%table", (size if for_each else 8) * tangent.places[number])
        return t.load(V, address) if for_each or W == 1 else t.splat(t.load("double", address), W)

    t.carry_out(tangent.usual, values, of_table)
    for _, _, operands in tangent.columns:
        for each in operands:
            if isinstance(each, int) and each in tangent.values.fixed and each not in values:
                values[each] = of_table(each)
    t.add(f"  br i1 {t.all_true(values[tangent.good])}, label %columns, label %rare, !prof !0")

    t.label("rare")
    rare = dict(values)
    t.carry_out(tangent.rare, rare, of_table)
    others = integer("xor", "%ignored", every)
    good, derived = t.bits(rare[tangent.accurate]), t.bits(rare[tangent.derived])
    negative = integer("and", integer("and", good, t.bits(rare[tangent.negative])), others)
    bad = [integer("and", integer("xor", each, every), others) for each in (good, derived)]
    t.add(f"  br i1 {t.compare('ne', integer('or', *bad), 0)}, label %stop, label %columns")
    t.label("stop")
    flags = "%n"
    for truths, shift in zip((*bad, negative), (STEP, DERIVATIVE, NEGATIVE), strict=True):
        flags = integer("or", flags, integer("shl", truths, shift))
    t.add(f"  ret i64 {flags}")

    t.label("columns")
    t.add(f"  %negative = phi i64 [ 0, %step ], [ {negative}, %rare ]")
    length = _columns(t, tangent, values, places[-1], at_once, room)

    t.label("due")
    mean, power = t.operate("fmul", t.each(1.0 / D), length), t.each(1.0)
    for _ in range(D):
        power = t.operate("fmul", power, mean)
    scaled = [values[each] for each in tangent.scaled]
    most = t.operate("fmul", t.each(LIMIT), scaled[VOLUME])
    fine = [
        t.test("ogt", length, t.each(LEAST_SIZE)),
        t.test("olt", length, t.each(LARGEST_SIZE)),
        t.test("olt", power, t.operate("fmul", most, most)),
    ]
    outside = [
        t.test(how, scaled[k], t.each(limit))
        for k, how, limit in (
            (NEAR_1, "ole", NEAR_1_LEAST),
            (NEAR_1, "oge", NEAR_1_LARGEST),
            (FAR_FROM_1, "ole", LEAST_LENGTH),
            (FAR_FROM_1, "oge", LARGEST_LENGTH),
        )
    ]
    due = integer("xor", t.bits(t.joined("and", fine)), every)
    flags = integer("shl", "%negative", NEGATIVE)
    for truths, shift in ((due, DUE), (t.bits(t.joined("or", outside)), OUTSIDE)):
        truths = integer("and", truths, integer("xor", "%ignored", every))
        flags = integer("or", flags, integer("shl", truths, shift))
    for k, number in enumerate([*tangent.after, *tangent.scaled]):
        t.store(V, values[number], places[k])
    t.add("  %n1 = add i64 %n, 1")
    goes_on = new(f"and i1 {t.compare('eq', flags, 0)}, {t.compare('ult', '%n1', '%steps')}")
    t.add(f"  br i1 {goes_on}, label %next, label %end")
    t.label("next")
    t.add("  br label %step")
    t.label("end")
    t.add(f"  ret i64 {integer('or', '%n1', flags)}")
    return t.whole()


def _columns(t, tangent, values, last, at_once, room):
    """Add a loop over columns; return the sum of their squared lengths, after them."""
    D, new, integer, size, V = tangent.D, t.new, t.integer, 8 * t.W, t.V
    width, values = t.W, dict(values)
    if t.W == 1 and at_once > 1:  # columns are lanes
        width = at_once
        used = {each for _, _, operands in tangent.columns for each in operands}
        for each in sorted(used & values.keys() - {*tangent.column}):
            values[each] = t.splat(values[each], width)
    inner = Text(width, t)
    first = integer("add", last, size)
    t.add("  br label %column")
    t.label("column")
    t.add("  %r = phi i64 [ 0, %columns ], [ %r1, %column ]")
    t.add(f"  %length = phi {V} [ {t.each(0.0)}, %columns ], [ %length1, %column ]")
    here, length = integer("add", first, integer("mul", "%r", size)), "%length"
    columns = []
    for c in range(at_once if t.W > 1 else 1):
        places = [t.plus(here, size * (i * room + c)) for i in range(D)]
        columns.append((places, dict(values)))
    for operation in tangent.columns:  # one column after the other would wait for each
        for places, own in columns:
            inner.carry_out(
                [operation], own, lambda n, p=places: inner.load(inner.V, p[n - tangent.column[0]])
            )
    for places, own in columns:
        square = None
        for i, number in enumerate(tangent.products):
            inner.store(inner.V, own[number], places[i])
            more = inner.operate("fmul", own[number], own[number])
            square = more if square is None else inner.operate("fadd", square, more)
        if width == t.W:
            length = t.operate("fadd", length, square)
        for k in range(width if width > t.W else 0):
            one = new(f"extractelement {inner.V} {square}, i32 {k}")
            length = t.operate("fadd", length, one)
    t.add(f"  %length1 = fadd {V} {length}, {t.each(-0.0)}")
    t.add(f"  %r1 = add i64 %r, {at_once}")
    t.add(f"  br i1 {t.compare('ult', '%r1', D)}, label %column, label %due")
    return "%length1"


def text_of_orthonormalise(step, name, W, *_):
    """Return the text of i64 name(columns, carried, due): `tangent.orthonormalise` for a line.

    It takes the addresses of the columns and of VOLUME, and bits of lanes, and returns 0. Of a step
    only D counts.
    """
    t, D, size = Text(W), step.D, 8 * W
    new, integer, V, room = t.new, t.integer, t.V, columns_of(D, W)[1]
    t.add(f"define i64 @{name}(i64 %columns, i64 %carried, i64 %due) #0 {{")
    t.label("entry")
    due = new(f"trunc i64 %due to i{W}")
    due = new(f"bitcast i{W} {due} to {t.M}") if W > 1 else due
    is_due = t.choose_line(due, t.each(1.0), t.each(0.0))
    volume = t.choose_line(due, t.each(1.0), t.load(V, "%carried"))
    t.add("  br label %column")

    def at(r):
        """Return the addresses of the components of column r."""
        first = integer("add", "%columns", integer("mul", r, size))
        return [t.plus(first, size * room * i) for i in range(D)]

    def total(pairs):
        """Return the sum of products of values in pairs, in this order."""
        sums = [t.operate("fmul", a, b) for a, b in pairs]
        found = sums[0]
        for each in sums[1:]:
            found = t.operate("fadd", found, each)
        return found

    t.label("column")
    t.add("  %r = phi i64 [ 0, %entry ], [ %r1, %scale ]")
    t.add(f"  %volume = phi {V} [ {volume}, %entry ], [ %volume1, %scale ]")
    places, first = at("%r"), at("0")
    product = total([(t.load(V, a), t.load(V, b)) for a, b in zip(first, places, strict=True)])
    t.add(f"  br i1 {t.compare('eq', '%r', 0)}, label %scale, label %subtract")

    t.label("subtract")
    t.add("  %s = phi i64 [ 0, %column ], [ %s1, %subtract ]")
    t.add(f"  %product = phi {V} [ {product}, %column ], [ %product1, %subtract ]")
    part, pairs = t.operate("fmul", "%product", is_due), []
    t.add("  %s1 = add i64 %s, 1")
    for place, earlier, later in zip(places, at("%s"), at("%s1"), strict=True):
        x = t.operate("fmul", part, t.load(V, earlier))
        x = t.operate("fsub", t.load(V, place), x)
        t.store(V, x, place)
        pairs.append((t.load(V, later), x))
    t.add(f"  %product1 = fadd {V} {total(pairs)}, {t.each(-0.0)}")
    t.add(f"  br i1 {t.compare('ult', '%s1', '%r')}, label %subtract, label %scale")

    t.label("scale")
    t.add(f"  %square = phi {V} [ {product}, %column ], [ %product1, %subtract ]")
    root = new(f"call {V} @llvm.sqrt.{t.suffix}({V} %square)")
    length = t.choose_line(due, root, t.each(1.0))
    place = t.plus(integer("add", "%carried", integer("mul", "%r", size)), size * LENGTHS)
    t.store(V, t.operate("fmul", t.load(V, place), length), place)
    is_0 = t.test("oeq", length, t.each(0.0))
    kept = t.operate("fmul", "%volume", t.choose_line(is_0, t.each(0.0), t.each(1.0)))
    t.add(f"  %volume1 = fadd {V} {kept}, {t.each(-0.0)}")
    inverse = t.choose_line(is_0, t.each(0.0), t.operate("fdiv", t.each(1.0), length))
    for place in places:
        t.store(V, t.operate("fmul", t.load(V, place), inverse), place)
    t.add("  %r1 = add i64 %r, 1")
    t.add(f"  br i1 {t.compare('ult', '%r1', D)}, label %column, label %end")
    t.label("end")
    t.store(V, "%volume1", "%carried")
    t.add("  ret i64 0")
    return t.whole()
