"""What the codes of steps and tangents share: values of a line, saved states."""


def add_table(text, step, halves, fraction, fixed):
    """Compute the numbers of `Step.table` into the dict `fixed`.

    `halves` is the address of h v for one line, `fraction` the one of a stage.
    """
    fraction = fraction if text.W == 1 else text.splat(fraction, text.W)

    def half_of(number):
        half = text.load(text.V, text.plus(halves, 8 * text.W * (number - step.D)))
        return text.operate("fmul", half, fraction)

    text.carry_out(step.fixed, fixed, half_of)
    for number in step.table:
        if number not in fixed:
            fixed[number] = half_of(number)


def loader(text, step, for_each, state, table, fixed=()):
    """Return the function that loads a value: of the state, or of the table.

    `state` and `table` are the addresses of their rows for one line. Values in the dict `fixed` are
    there already.
    """
    size = 8 * text.W

    def load(number):
        if number in fixed:
            return fixed[number]
        if number < step.D:
            return text.load(text.V, text.plus(state, size * number))
        address = text.plus(table, (size if for_each else 8) * step.places[number])
        if for_each or text.W == 1:
            return text.load(text.V, address)
        return text.splat(text.load("double", address), text.W)

    return load


def save(text, states, D, trajectories, align):
    """Add the block `save`, which writes the states of a line to the row, one after the other."""
    new, integer, W = text.new, text.integer, text.W
    text.label("save")
    place = integer("add", "%row", integer("mul", "%line", 8 * W * D))
    if W == 1:
        for k in range(D):
            text.store("double", states[k], text.plus(place, 8 * k))
        text.jump("next")
        return
    vectors = []
    for first in range(0, W * D, W):
        vector, sources = "undef", [divmod(n, D) for n in range(first, first + W)]
        for k in dict.fromkeys(component for _, component in sources):
            order = [
                W + lane if component == k else n for n, (lane, component) in enumerate(sources)
            ]
            order = ", ".join(f"i32 {n}" for n in order)
            vector = new(
                f"shufflevector {text.V} {vector}, {text.V} {states[k]}, <{W} x i32> <{order}>"
            )
        vectors.append(vector)
    last = integer("mul", integer("add", "%line", 1), W)
    text.branch(text.compare_integers("ule", last, trajectories), "whole", "part")
    text.label("whole")
    mark = ", !nontemporal !1" if align > 8 else ""
    for k, vector in enumerate(vectors):
        text.store(text.V, vector, text.plus(place, 8 * W * k), align, mark)
    text.jump("next")
    text.label("part")  # the last line has fewer trajectories, and is written number by number
    left = integer("mul", integer("sub", trajectories, integer("mul", "%line", W)), D)
    text.jump("number0")
    for n in range(W * D):
        text.label(f"number{n}")
        text.branch(text.compare_integers("ult", n, left), f"put{n}", "next")
        text.label(f"put{n}")
        number = new(f"extractelement {text.V} {vectors[n // W]}, i32 {n % W}")
        text.store("double", number, text.plus(place, 8 * n))
        text.jump(f"number{n + 1}")
    text.label(f"number{W * D}")
    text.jump("next")
