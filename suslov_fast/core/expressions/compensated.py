"""Programs whose results are sums without rounding errors of partial sums.

In rate equations the same terms, with both signs, are in the rates of several components, so that
sums of components are conserved or slow. Terms have the same rounding errors wherever they occur;
partial sums have not, and their errors appear in slow directions. So each result that is a sum of
three or more terms is computed with the rounding errors of its partial sums (Neumaier 1974, with
the two-sum of Knuth):

s = a + b,     c = s - a,     error = (a - (s - c)) + (b - c).
"""

from collections import Counter

from .programs import Program, Values

_SIGN = {"fadd": 1.0, "fsub": -1.0}


def compensated(program):
    """Return a `Program` of the same results, with compensated sums."""
    operations = {number: (name, of) for name, number, of in program.operations}
    used = Counter(a for _, _, of in program.operations for a in of if not isinstance(a, float))
    used.update(a for a in program.results if not isinstance(a, float))
    values = Values(1 + max([0, *used, *operations]), ())

    def terms(a, sign, is_result=False):
        """Yield the terms (operand, sign) of a sum; a partial sum with several uses is a term."""
        name, of = ("", ()) if isinstance(a, float) else operations.get(a, ("", ()))
        if name not in _SIGN or (used[a] > 1 and not is_result):
            yield a, sign
            return
        yield from terms(of[0], sign)
        yield from terms(of[1], sign * _SIGN[name])

    def result(a):
        (first, sign), *others = terms(a, 1.0, True)
        if len(others) < 2:
            return a
        total, errors = values.number(first), 0.0
        total = total if sign > 0.0 else -total
        for b, sign in others:
            b = values.number(b) if sign > 0.0 else -values.number(b)
            s = total + b
            c = s - total
            error = (total - (s - c)) + (b - c)
            total, errors = s, error if errors == 0.0 else errors + error
        return (total + errors).number

    results = [result(a) for a in program.results]
    return Program([*program.operations, *values.operations], results)
