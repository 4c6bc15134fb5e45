"""Machine code of derivatives along orbits: products of -DPhi with columns, and Gram-Schmidt.

`lists.step.Tangent` has the operations of a step; `tangent` takes the steps that they cannot take.
"""

from ..code.compiler import numbers_in_register
from ..code.text import Code
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
    integer, V = text.integer, text.V
    text.begin(name, "line", "table", "kept", "plan", "ignored", "steps")
    of_columns = {*tangent.column, *(number for _, number, _ in tangent.columns)}
    operands = (number for *_, operands in tangent.columns for number in operands)
    load = loader(text, tangent, for_each, "%line", "%table")
    last = {}

    def step(n):
        carried = [text.row("%line", D + k) for k in range(LENGTHS)]
        x, stage = [text.row("%line", i) for i in range(D)], Stage(text, tangent, load)
        usual = stage.take(x, enumerate(carried, D + tangent.T))
        for number in dict.fromkeys([*operands, *tangent.scaled]):
            needed = isinstance(number, int) and number not in of_columns
            if needed and number not in stage.values:
                stage.values[number] = load(number)
        others = integer("xor", "%ignored", all_lanes)

        def rare():
            after, _, good, told, values = stage.take_rare()
            alive = integer("mul", integer("and", good, others), 1 | 1 << OF_CHANGED)
            told = integer("and", told, alive)
            negative = integer("shl", integer("and", told, all_lanes), NEGATIVE)
            changed = integer("shl", integer("lshr", told, OF_CHANGED), CHANGED)
            told = integer("or", negative, changed)
            both = good, text.bits(values[tangent.derived])
            bad = [integer("and", integer("xor", bits, all_lanes), others) for bits in both]
            with text.when(text.compare_integers("ne", integer("or", *bad), 0)):
                flags = integer("or", n, told)
                for bits, shift in zip(bad, (STEP, DERIVATIVE), strict=True):
                    flags = integer("or", flags, integer("shl", bits, shift))
                text.leave(f"i64 {flags}")
            return [*after, told]

        kinds = [V] * D + ["i64"]
        *after, flags = text.otherwise(stage.is_good(), [*usual, 0], rare, kinds)
        length = _columns(text, tangent, stage.values)
        mean, power = text.operate("fmul", text.constant(1.0 / D), length), text.constant(1.0)
        for _ in range(D):
            power = text.operate("fmul", power, mean)
        scaled = [stage.values[number] for number in tangent.scaled]
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
        for bits, shift in ((due, DUE), (text.bits(text.joined("or", outside)), OUTSIDE)):
            bits = integer("and", bits, others)
            flags = integer("or", flags, integer("shl", bits, shift))
        for k, value in enumerate([*after, *scaled]):
            text.put(value, "%line", k)
        less = text.operate("fmul", most, scaled[VOLUME])  # the square root of LIMIT for LIMIT
        n = integer("add", n, 1)
        last.update(n=n, flags=flags, power=power, less=less)
        is_clear = text.compare_integers("eq", flags, 0)
        has_more = text.compare_integers("ult", n, "%steps")
        return {"n": n}, text.new(f"and i1 {is_clear}, {has_more}")

    text.cycle({"n": ("i64", "0")}, step)
    soon = text.bits(text.compare("olt", last["power"], last["less"]))
    soon = integer("shl", integer("xor", soon, all_lanes), SOON)
    flags = integer("or", last["flags"], soon)
    text.add(f"  ret i64 {integer('or', last['n'], flags)}")
    return text.finished()


def _columns(text, tangent, values):
    """Add a loop that multiplies the columns; return the sum of their squared lengths after it."""
    D, width, values = tangent.D, text.W, dict(values)
    at_once, room = columns_at_once(D, width, tangent.columns), room_of(D, width)
    if text.W == 1 and at_once > 1:  # columns are lanes
        width = at_once
        used = {operand for _, _, operands in tangent.columns for operand in operands}
        for number in sorted(used & values.keys() - {*tangent.column}):
            values[number] = text.splat(values[number], width)
    inner, first = Code(width, text), text.plus("%line", text.size * (2 * D + LENGTHS))

    def multiply(r, length):
        begin = text.integer("add", first, text.integer("mul", r, text.size))
        columns = []
        for c in range(at_once if text.W > 1 else 1):
            places = [text.plus(begin, text.size * (i * room + c)) for i in range(D)]
            columns.append((places, dict(values)))
        # Columns take turns, because an operation waits for the one before it of the same column.
        for operation in tangent.columns:
            for places, own in columns:
                inner.carry_out(
                    [operation],
                    own,
                    lambda n, p=places: inner.load(inner.V, p[n - tangent.column[0]]),
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
                element = text.new(f"extractelement {inner.V} {square}, i32 {k}")
                length = text.operate("fadd", length, element)
        r = text.integer("add", r, at_once)
        return {"r": r, "length": length}, text.compare_integers("ult", r, D)

    carried = {"r": ("i64", "0"), "length": (text.V, text.constant(0.0))}
    return text.cycle(carried, multiply)["length"]


def text_of_orthonormalise(D, name, W):
    """Return the text of i64 name(columns, carried, due, ...): modified Gram-Schmidt for a line.

    The code takes the addresses of the columns and of VOLUME, and bits of lanes that are due; it
    returns 0. The products of lengths are multiplied by the lengths. VOLUME becomes 1; or 0 if a
    column is 0, because then it does not show how the other columns grow.
    """
    # With a function of Numba instead, exponents take 1.05 to 1.65 times as long. Its loops over
    # lanes are no SIMD, because the compiler does not know that rows do not overlap.
    text, zero, one = Code(W), *map(Code(W).constant, (0.0, 1.0))
    integer, V, room = text.integer, text.V, room_of(D, W)
    text.begin(name, "columns", "carried", "due", "kept", "plan")  # two for `long_tangent`
    due = text.new(f"trunc i64 %due to i{W}")
    due = text.new(f"bitcast i{W} {due} to {text.M}") if W > 1 else due
    is_due = text.select(due, one, zero)

    def at(r):
        """Return the addresses of the components of column r."""
        first = integer("add", "%columns", integer("mul", r, text.size))
        return [text.plus(first, text.size * room * i) for i in range(D)]

    def total(pairs):
        """Return the sum of products of values in pairs, in this order."""
        result, *products = [text.operate("fmul", a, b) for a, b in pairs]
        for product in products:
            result = text.operate("fadd", result, product)
        return result

    def column(r, volume):
        places, first = at(r), at("0")
        product = total(
            [(text.load(V, a), text.load(V, b)) for a, b in zip(first, places, strict=True)]
        )

        def subtract(s, product):
            part, pairs = text.operate("fmul", product, is_due), []
            following = integer("add", s, 1)
            for place, earlier, later in zip(places, at(s), at(following), strict=True):
                x = text.operate("fmul", part, text.load(V, earlier))
                x = text.operate("fsub", text.load(V, place), x)
                text.store(V, x, place)
                pairs.append((text.load(V, later), x))
            found = {"s": following, "product": total(pairs)}
            return found, text.compare_integers("ult", following, r)

        def subtract_all():
            carried = {"s": ("i64", "0"), "product": (V, product)}
            return [text.cycle(carried, subtract)["product"]]

        is_first = text.compare_integers("eq", r, 0)
        [square] = text.otherwise(is_first, [product], subtract_all, likely=None)
        length = text.select(due, text.root(square), one)
        place = text.place("%carried", LENGTHS, r)
        text.store(V, text.operate("fmul", text.load(V, place), length), place)
        is_0 = text.compare("oeq", length, zero)
        volume = text.operate("fmul", volume, text.select(is_0, zero, one))
        inverse = text.select(is_0, zero, text.operate("fdiv", one, length))
        for place in places:
            text.store(V, text.operate("fmul", text.load(V, place), inverse), place)
        r = integer("add", r, 1)
        return {"r": r, "volume": volume}, text.compare_integers("ult", r, D)

    volume = text.select(due, one, text.load(V, "%carried"))
    volume = text.cycle({"r": ("i64", "0"), "volume": (V, volume)}, column)["volume"]
    text.store(V, volume, "%carried")
    text.add("  ret i64 0")
    return text.finished()
