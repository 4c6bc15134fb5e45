"""A whole step of a lifted field: added variables from the state, stages, and the state again.

The state x (`given` components) is a part of M words, which are products of the variables: x and
added ones u = g(p), with polynomials p of the variables before. At the first stage of a whole step
all words are computed from x. Then the stages are those of the field of the words, and what the
other words become does not matter.

The pivots of the lifted field tell nothing of the motion. Poles are told by the sign of
det(1 - h f'(x)) of the equations as given, at the state from which a whole step is taken, with h
half of the longest sub-step: h f' = N dwords/dx, with the rows of N that belong to x.
"""

import functools

import numpy as np

from .operations import Step, Values, evaluate
from .planned_elimination import Factors, Matrix, elimination_order

ONE = -1  # the place of a coefficient 1


class Lifting:
    """The part of a step that makes the field of all words that of the given equations.

    Values 0 to M - 1 are the words, the next T are h v of the terms, and after them come the
    coefficients of the lift.

    lift        a `bodies.structure.Lift`, and the longest stage over the first
    prologue    operations before the first stage of a whole step
    lifted      values of the prologue: the words after the state
    """

    def __init__(self, indices, D, lift, longest=1.0):
        self.lift, self.lifted = (lift, longest), []
        super().__init__(indices, D, lift.coefficients)
        if self.factors is None:
            self._separate_fixed()

    given = property(lambda self: self.lift[0].given)
    parameters = property(lambda self: self.T + self.lift[0].coefficients)

    def _separate_fixed(self):
        values, first = self.values, len(self.values.operations)
        self._add_prologue()
        own = {number for _, number, _ in values.operations[first:]}
        super()._separate_fixed()
        self.prologue = [operation for operation in self.usual if operation[1] in own]
        self.usual = [operation for operation in self.usual if operation[1] not in own]

    def _add_prologue(self):
        lift, longest = self.lift
        emit, first = self.values.emit, self.D + self.T
        variables = Variables(self.values, lift, first)
        words = [variables.product(word) for word in lift.words]
        self.lifted = [number for number, _ in words]
        slopes = [{i: 1.0} for i in range(lift.given)] + [slope for _, slope in words]
        numbers = [*range(lift.given), *self.lifted]
        matrix = Matrix(self.indices, self.D, self.values, numbers, range(self.D, first))
        rows = [{} for _ in range(lift.given)]  # of h f'
        for i, j in sorted(place for place in matrix.pattern if place[0] < lift.given):
            entry, _ = matrix.entry(i, j)
            variables.add_multiple(rows[i], entry, slopes[j])
        if longest != 1.0:
            rows = [{j: emit("fmul", longest, value) for j, value in row.items()} for row in rows]
        entries = _Entries(rows, self.values)
        factors = Factors(entries, elimination_order(entries.pattern, lift.given))
        self._test_pivots([*factors.pivot.values()])


class _Entries:
    """The entries of h f' of the equations as given, as `Factors` takes them."""

    def __init__(self, rows, values):
        self.rows, self.values = rows, values
        self.pattern = {(i, j) for i, row in enumerate(rows) for j in row}

    def entry(self, i, j):
        """Return the entry of row i and column j; None stands for 0."""
        return self.rows[i].get(j), None


class LiftedStep(Lifting, Step):
    """The operations of a stage of the lifted field, and those of its first stage before it.

    turned      true if det(1 - h f'(x)) of the equations as given is negative, and x has words
    """

    turned = None

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.of_one_sign = {*self.lift[0].signs}

    def _add_tests(self, halves):
        super()._add_tests(halves)
        self.negative = self.values.emit("olt", 1.0, 0.0)
        self.rare.append(self.values.operations[-1])

    def _test_pivots(self, pivots):
        emit, joined = self.values.emit, self.values.joined
        self.turned = joined("xor", [emit("olt", pivot, 0.0) for pivot in pivots or [1.0]])
        # 0 times a word that is not finite, such as log 0, is NaN.
        nothing = joined("fadd", [emit("fmul", 0.0, word) for word in self.lifted])
        self.turned = emit("and", self.turned, emit("oeq", nothing, 0.0))

    def _results(self):
        return [*super()._results(), *self.lifted, *self.increments.values()]


class Variables:
    """Values of variables, and their derivatives by the components of the state, as operations.

    arguments    of the added variables g(p): values of the polynomials p, and their derivatives
    """

    def __init__(self, values, lift, first, state=None):
        self.values, self.emit, self.first, self.lift = values, values.emit, first, lift
        self.numbers = [*(state or range(lift.given))]
        self.slopes, self.arguments = [{i: 1.0} for i in range(lift.given)], []
        for definition in lift.definitions:
            number, slope = self._variable(*definition)
            self.numbers.append(number)
            self.slopes.append(slope)

    def _coefficient(self, place):
        return 1.0 if place == ONE else self.first + place

    def times(self, a, b):
        """Return the value a b; a constant 1 needs no operation."""
        if a == 1.0 and isinstance(a, float):
            return b
        if b == 1.0 and isinstance(b, float):
            return a
        return self.emit("fmul", a, b)

    def add_multiple(self, slope, factor, other):
        """Add a multiple of a derivative to the derivative `slope`."""
        for j, value in other.items():
            product = self.times(factor, value)
            slope[j] = self.emit("fadd", slope[j], product) if j in slope else product

    def product(self, word):
        """Return a product of variables, and its derivative."""
        number, slope = self.numbers[word[0]], self.slopes[word[0]]
        for i in word[1:]:
            following = {}
            self.add_multiple(following, self.numbers[i], slope)
            self.add_multiple(following, number, self.slopes[i])
            number, slope = self.times(number, self.numbers[i]), following
        return number, slope

    def polynomial(self, terms):
        """Return the value of a polynomial, and its derivative."""
        total, slope = None, {}
        for place, variables in terms:
            number, c = self._coefficient(place), self._coefficient(place)
            if variables:
                product, of_product = self.product(variables)
                number = self.times(c, product)
                self.add_multiple(slope, c, of_product)
            total = number if total is None else self.emit("fadd", total, number)
        return total, slope

    def _variable(self, function, terms, exponent):
        """Return the value g(p), and its derivative g'(p) p'."""
        p, of_p = self.polynomial(terms)
        self.arguments.append((p, of_p))
        u, factor = self._function(function, p, exponent)
        slope = {}
        self.add_multiple(slope, factor, of_p)
        return u, slope

    def _function(self, function, p, exponent):
        """Return the values g(p) and g'(p)."""
        emit = self.emit
        if function == "inverse":
            u = emit("fdiv", 1.0, p)
            return u, emit("fmul", -1.0, emit("fmul", u, u))
        if function == "root":
            u = emit("fdiv", 1.0, emit("sqrt", p))
            return u, emit("fmul", -0.5, emit("fdiv", u, p))
        if function == "power":
            r = self._coefficient(exponent)
            u = emit("pow", p, r)
            return u, emit("fdiv", emit("fmul", r, u), p)
        if function == "cbrt":
            u = emit("cbrt", p)
            return u, emit("fdiv", u, emit("fmul", 3.0, p))
        u = emit(_OF_LIBRARY[function], p)
        if function == "exp":
            return u, u
        if function == "log":
            return u, emit("fdiv", 1.0, p)
        if function == "arctan":
            return u, emit("fdiv", 1.0, emit("fadd", 1.0, emit("fmul", p, p)))
        if function in ("tan", "tanh"):
            instruction = "fadd" if function == "tan" else "fsub"
            return u, emit(instruction, 1.0, emit("fmul", u, u))
        other = {"sin": "cos", "cos": "sin", "sinh": "cosh", "cosh": "sinh"}[function]
        slope = emit(_OF_LIBRARY[other], p)
        return u, emit("fmul", -1.0, slope) if function == "cos" else slope


_OF_LIBRARY = {
    **{name: name for name in ("exp", "log", "sin", "cos", "tan", "sinh", "cosh", "tanh")},
    "arctan": "atan",
}


def needed_for(results, operations):
    """Return the operations that values with these numbers need."""
    needed, kept = {*results}, []
    for operation in reversed(operations):
        if operation[1] in needed:
            needed.update(operation[2])
            kept.append(operation)
    return kept[::-1]


# ---------------------------------------------------------------------------------- values by NumPy
@functools.lru_cache(64)
def _plan(lift, terms):
    """Return operations on a state and coefficients, and words, or a polynomial, with slopes."""
    values = Values(lift.given + lift.coefficients, ())
    variables = Variables(values, lift, lift.given)
    found = [variables.product(word) for word in lift.words]
    return values.operations, found if terms is None else [variables.polynomial(terms)]


def _evaluated(lift, terms, coefficients, x, results):
    """Return the function that returns a value of the operations, of those that `results` need."""
    operations, _ = _plan(lift, terms)
    values = [x[..., i] for i in range(lift.given)]
    values += [coefficients[..., k] for k in range(lift.coefficients)]
    values = dict(enumerate(values))
    with np.errstate(all="ignore"):
        evaluate(needed_for(results, operations), values)
    return lambda number: number if isinstance(number, float) else values[number]


def words_at(lift, coefficients, x):
    """Return the words after states x (..., given), each (...).

    `coefficients` (..., n) has those of a single field, or of each member of a family.
    """
    words = [number for number, _ in _plan(lift, None)[1]]
    return [*map(_evaluated(lift, None, coefficients, x, words), words)]


def polynomial_at(lift, terms, coefficients, x):
    """Return the value (...) of a polynomial in the variables, such as a Hamiltonian."""
    [(number, _)] = _plan(lift, terms)[1]
    return _evaluated(lift, terms, coefficients, x, [number])(number)


def slopes_at(lift, coefficients, x):
    """Return the derivatives of all words, those of the state included, by it (..., M, given)."""
    slopes = [{i: 1.0} for i in range(lift.given)] + [slope for _, slope in _plan(lift, None)[1]]
    results = {number for slope in slopes for number in slope.values()}
    value_of = _evaluated(lift, None, coefficients, x, results)
    batch = np.broadcast_shapes(x.shape[:-1], coefficients.shape[:-1])
    out = np.zeros((*batch, len(slopes), lift.given))
    for k, slope in enumerate(slopes):
        for j, number in slope.items():
            out[..., k, j] = value_of(number)
    return out
