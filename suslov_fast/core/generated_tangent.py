"""Machine code of derivatives along orbits: steps that multiply columns by -DPhi, and the modified
Gram-Schmidt method.

`operations.Tangent` has the operations of a step; `tangent` takes the steps that they cannot take.
"""

from .machine_code import Text

# Rows of a line: the state; the numbers below; the products of the lengths of D columns; columns.
# VOLUME is abs(det) of the columns, and (1 + NEAR_1) FAR_FROM_1 is the product of abs(det DPhi).
VOLUME, NEAR_1, FAR_FROM_1, LENGTHS = range(4)
# Logarithms are taken of products that leave these ranges, where they keep their digits.
NEAR_1_LEAST, NEAR_1_LARGEST, LEAST_LENGTH, LARGEST_LENGTH = -0.999, 1e3, 1e-100, 1e100
# Columns are orthonormalised where they may lose digits. Let D columns have |det| = d and squared
# lengths with the mean m. Then d**2 <= m**D, with equality for orthogonal columns of equal lengths.
# A column of length p with a part t orthogonal to the others has
# d**2 <= t**2 ((D m - p**2) / (D - 1))**(D - 1) <= m**D (t / p)**2. Rounding errors are multiplied
# by p / t at most, which is below LIMIT while m**D is below LIMIT**2 d**2.
LIMIT, LEAST_SIZE, LARGEST_SIZE = 64.0, 1e-100, 1e100
# The code returns how many steps it took, and from these places on the bits of lanes: whose step or
# whose derivative is not accurate, so that no lane took the step; from det A < 0; with columns to
# be orthonormalised; with logarithms to be taken.
STEP, DERIVATIVE, NEGATIVE, DUE, OUTSIDE = range(16, 56, 8)


def columns_of(D, W):
    """Return how many columns are multiplied at once, and for how many there is room.

    Component i of column r of a line is in row 2 D + LENGTHS + i * room + r. If W is 1, the columns
    are lanes of a vector. Otherwise `room` is odd, because components an even number of lines apart
    would share the same sets of the first cache.
    """
    if W > 1:
        at_once = min((4, 3, 2), key=lambda n: -(-D // n) * n) if D > 1 else 1
        return at_once, -(-D // at_once) * at_once | 1
    at_once = min(4, 1 << (D - 1).bit_length())
    return at_once, -(-D // at_once) * at_once


def text_of_tangent(tangent, name, W, for_each, _):
    """Return the text of i64 name(line, table, ignored, steps): steps of one line with its columns.

    Columns q become -DPhi q. The code returns the number of steps with bits of lanes, see STEP. It
    stops after a step with such bits, and before a step that is not accurate. Bits in `ignored`
    mark lanes that do not stop it.
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
        for number in operands:
            if isinstance(number, int) and number in tangent.values.fixed and number not in values:
                values[number] = of_table(number)
    t.add(f"  br i1 {t.all_true(values[tangent.good])}, label %columns, label %rare, !prof !0")

    t.label("rare")
    rare = dict(values)
    t.carry_out(tangent.rare, rare, of_table)
    others = integer("xor", "%ignored", every)
    accurate, derived = t.bits(rare[tangent.accurate]), t.bits(rare[tangent.derived])
    negative = integer("and", integer("and", accurate, t.bits(rare[tangent.negative])), others)
    bad = [integer("and", integer("xor", bits, every), others) for bits in (accurate, derived)]
    is_bad = t.compare_integers("ne", integer("or", *bad), 0)
    t.add(f"  br i1 {is_bad}, label %stop, label %columns")
    t.label("stop")
    flags = "%n"
    for bits, shift in zip((*bad, negative), (STEP, DERIVATIVE, NEGATIVE), strict=True):
        flags = integer("or", flags, integer("shl", bits, shift))
    t.add(f"  ret i64 {flags}")

    t.label("columns")
    t.add(f"  %negative = phi i64 [ 0, %step ], [ {negative}, %rare ]")
    length = _columns(t, tangent, values, places[-1], at_once, room)

    t.label("due")
    mean, power = t.operate("fmul", t.constant(1.0 / D), length), t.constant(1.0)
    for _ in range(D):
        power = t.operate("fmul", power, mean)
    scaled = [values[number] for number in tangent.scaled]
    most = t.operate("fmul", t.constant(LIMIT), scaled[VOLUME])
    fine = [
        t.compare("ogt", length, t.constant(LEAST_SIZE)),
        t.compare("olt", length, t.constant(LARGEST_SIZE)),
        t.compare("olt", power, t.operate("fmul", most, most)),
    ]
    outside = [
        t.compare(how, scaled[k], t.constant(limit))
        for k, how, limit in (
            (NEAR_1, "ole", NEAR_1_LEAST),
            (NEAR_1, "oge", NEAR_1_LARGEST),
            (FAR_FROM_1, "ole", LEAST_LENGTH),
            (FAR_FROM_1, "oge", LARGEST_LENGTH),
        )
    ]
    due = integer("xor", t.bits(t.joined("and", fine)), every)
    flags = integer("shl", "%negative", NEGATIVE)
    for bits, shift in ((due, DUE), (t.bits(t.joined("or", outside)), OUTSIDE)):
        bits = integer("and", bits, integer("xor", "%ignored", every))
        flags = integer("or", flags, integer("shl", bits, shift))
    for k, number in enumerate([*tangent.after, *tangent.scaled]):
        t.store(V, values[number], places[k])
    t.add("  %n1 = add i64 %n, 1")
    is_clear = t.compare_integers("eq", flags, 0)
    goes_on = new(f"and i1 {is_clear}, {t.compare_integers('ult', '%n1', '%steps')}")
    t.add(f"  br i1 {goes_on}, label %next, label %end")
    t.label("next")
    t.add("  br label %step")
    t.label("end")
    t.add(f"  ret i64 {integer('or', '%n1', flags)}")
    return t.finished()


def _columns(t, tangent, values, last, at_once, room):
    """Add a loop that multiplies the columns; return the sum of their squared lengths after it."""
    D, new, integer, size, V = tangent.D, t.new, t.integer, 8 * t.W, t.V
    width, values = t.W, dict(values)
    if t.W == 1 and at_once > 1:  # columns are lanes
        width = at_once
        used = {operand for _, _, operands in tangent.columns for operand in operands}
        for number in sorted(used & values.keys() - {*tangent.column}):
            values[number] = t.splat(values[number], width)
    inner = Text(width, t)
    first = integer("add", last, size)
    t.add("  br label %column")
    t.label("column")
    t.add("  %r = phi i64 [ 0, %columns ], [ %r1, %column ]")
    t.add(f"  %length = phi {V} [ {t.constant(0.0)}, %columns ], [ %length1, %column ]")
    column, length = integer("add", first, integer("mul", "%r", size)), "%length"
    columns = []
    for c in range(at_once if t.W > 1 else 1):
        places = [t.plus(column, size * (i * room + c)) for i in range(D)]
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
        if width == t.W:
            length = t.operate("fadd", length, square)
        for k in range(width if width > t.W else 0):
            element = new(f"extractelement {inner.V} {square}, i32 {k}")
            length = t.operate("fadd", length, element)
    t.add(f"  %length1 = fadd {V} {length}, {t.constant(-0.0)}")
    t.add(f"  %r1 = add i64 %r, {at_once}")
    t.add(f"  br i1 {t.compare_integers('ult', '%r1', D)}, label %column, label %due")
    return "%length1"


def text_of_orthonormalise(step, name, W, *_):
    """Return the text of i64 name(columns, carried, due): `tangent.orthonormalise` for a line.

    The code takes the addresses of the columns and of VOLUME, and bits of lanes; it returns 0. It
    depends on D alone.
    """
    # With `tangent.orthonormalise` instead, exponents take 1.05 to 1.65 times as long. Its loops
    # over lanes are no SIMD, because Numba does not know that rows of a line do not overlap.
    t, D, size = Text(W), step.D, 8 * W
    new, integer, V, room = t.new, t.integer, t.V, columns_of(D, W)[1]
    t.add(f"define i64 @{name}(i64 %columns, i64 %carried, i64 %due) #0 {{")
    t.label("entry")
    due = new(f"trunc i64 %due to i{W}")
    due = new(f"bitcast i{W} {due} to {t.M}") if W > 1 else due
    is_due = t.select(due, t.constant(1.0), t.constant(0.0))
    volume = t.select(due, t.constant(1.0), t.load(V, "%carried"))
    t.add("  br label %column")

    def at(r):
        """Return the addresses of the components of column r."""
        first = integer("add", "%columns", integer("mul", r, size))
        return [t.plus(first, size * room * i) for i in range(D)]

    def total(pairs):
        """Return the sum of products of values in pairs, in this order."""
        result, *products = [t.operate("fmul", a, b) for a, b in pairs]
        for product in products:
            result = t.operate("fadd", result, product)
        return result

    t.label("column")
    t.add("  %r = phi i64 [ 0, %entry ], [ %r1, %scale ]")
    t.add(f"  %volume = phi {V} [ {volume}, %entry ], [ %volume1, %scale ]")
    places, first = at("%r"), at("0")
    product = total([(t.load(V, a), t.load(V, b)) for a, b in zip(first, places, strict=True)])
    t.add(f"  br i1 {t.compare_integers('eq', '%r', 0)}, label %scale, label %subtract")

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
    t.add(f"  %product1 = fadd {V} {total(pairs)}, {t.constant(-0.0)}")
    t.add(f"  br i1 {t.compare_integers('ult', '%s1', '%r')}, label %subtract, label %scale")

    t.label("scale")
    t.add(f"  %square = phi {V} [ {product}, %column ], [ %product1, %subtract ]")
    root = new(f"call {V} @llvm.sqrt.{t.suffix}({V} %square)")
    length = t.select(due, root, t.constant(1.0))
    place = t.plus(integer("add", "%carried", integer("mul", "%r", size)), size * LENGTHS)
    t.store(V, t.operate("fmul", t.load(V, place), length), place)
    is_0 = t.compare("oeq", length, t.constant(0.0))
    nonzero = t.operate("fmul", "%volume", t.select(is_0, t.constant(0.0), t.constant(1.0)))
    t.add(f"  %volume1 = fadd {V} {nonzero}, {t.constant(-0.0)}")
    inverse = t.select(is_0, t.constant(0.0), t.operate("fdiv", t.constant(1.0), length))
    for place in places:
        t.store(V, t.operate("fmul", t.load(V, place), inverse), place)
    t.add("  %r1 = add i64 %r, 1")
    t.add(f"  br i1 {t.compare_integers('ult', '%r1', D)}, label %column, label %end")
    t.label("end")
    t.store(V, "%volume1", "%carried")
    t.add("  ret i64 0")
    return t.finished()
