"""Whether a step of `flow` of a lifted field followed its variables: tests of its state at the end.

All columns of a step may agree on words that no state has, or on a state that has missed something.
Operations of `values` make the tests from `lift.Variables` of the states at both ends.
"""

LARGEST_ANGLE = 16.0  # of a sine in a step; beyond it columns may agree without its turns
# Rise of an exponent in a step to a maximum, and fall from it, or modulus of the argument of a cosh
# at both ends: exp, or 1 / cosh, is below 1/1000 of its maximum there.
LARGEST_RISE = 8.0
LEFT = 0.125  # how far words may be from those of the state, in units of themselves or of 1
OF_ONE_SIGN = {"inverse", "root", "power", "exp", "cosh"}


def compared(values, variables, lift, words):
    """Return the words of a state, and truth values of other `words`: whether they are near.

    `variables` are those of the state.
    """
    n, near = lift.given, []
    own = [variables.product(word)[0] for word in lift.words]
    for number, other, (variable, *others) in zip(own, words, lift.words, strict=True):
        function = None if others or variable < n else lift.definitions[variable - n][0]
        if function != "tanh" and function not in OF_ONE_SIGN:
            continue
        limit = LEFT
        if function in OF_ONE_SIGN:
            size = values.emit("max", values.emit("fabs", number), values.emit("fabs", other))
            limit = values.emit("fmul", LEFT, size)
        distance = values.emit("fabs", values.emit("fsub", number, other))
        near.append(values.emit("oge", limit, distance))
    return own, near


def follows(indices, values, even, before, after):
    """Return truth values: whether stages can follow the variables of the equations over a step.

    They cannot follow an angle that turns too far. They step over a pole, as that of 1 / (t - 1),
    beyond which x' = x / (t - 1) has no solution: there p of 1 / p changes its sign, and tan(p)
    falls while p rises. And they do not see a pulse exp(p), if p of time alone rises at first and
    falls at last, nor 1 / cosh(p), if p passes 0, where g(p) is 0 to rounding at both ends.
    """
    lift, emit, found = before.lift, values.emit, []
    n, of_equations = lift.given, indices[1:, indices[0] < lift.given]
    words = {k - n for k in of_equations.ravel().tolist() if n <= k < n + len(lift.words)}
    used = {variable for k in words for variable in lift.words[k]}
    of_state = [emit("fsub", after.numbers[j], before.numbers[j]) for j in range(n)]
    for variable, (function, *_) in enumerate(lift.definitions, n):
        (p, slope), (p_after, slope_after) = (
            each.arguments[variable - n] for each in (before, after)
        )
        change = emit("fsub", p_after, p)
        if function in ("sin", "cos"):
            found.append(emit("oge", LARGEST_ANGLE, emit("fabs", change)))
        elif function == "inverse" and variable in used:
            found.append(_are_alike(values, p, p_after))
        elif function == "tan" and variable in used:
            rise = emit("fsub", after.numbers[variable], before.numbers[variable])
            found.append(emit("oge", emit("fmul", change, rise), 0.0))
        elif function == "exp" and slope and {*slope} <= even:
            first, last = (
                values.joined("fadd", [emit("fmul", each[j], of_state[j]) for j in each])
                for each in (slope, slope_after)
            )
            small = emit("oge", LARGEST_RISE, first), emit("oge", last, -LARGEST_RISE)
            found.append(emit("or", *small))
        elif function == "cosh":
            least = emit("min", emit("fabs", p), emit("fabs", p_after))
            alike = _are_alike(values, p, p_after)
            found.append(emit("or", alike, emit("oge", LARGEST_RISE, least)))
    return found


def _are_alike(values, a, b):
    """Return whether both of two numbers are below 0, or none is."""
    signs = (values.emit("olt", each, 0.0) for each in (a, b))
    differ = values.emit("xor", *signs)
    return values.emit("oeq", values.emit("select", differ, 1.0, 0.0), 0.0)
