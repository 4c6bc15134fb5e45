"""Components below their allowed errors: implicit steps must not damp growth; one warning.

Linearly implicit Euler steps multiply exp(a t) by (1 - a h / n)**-n, which is no growth if a h is
large. The error estimate rejects such a step if the component counts, but not if it is below its
allowed error. The states may then follow an unstable equilibrium of a fed component, which is as
small. Let L be the components that are below NEAR allowed errors and not 0, and either not fed by
others or growing by themselves. The equations grow there at a rate above 1 / h if 1 - h J,
restricted to L, has a negative determinant; or a negative pivot, if no component of L takes from
another. Such a step is rejected: h / (1 - pivot), at both ends of it, is the longest length.

If none takes from another, growth shows as h f_i / x_i > 1 while no component changes its sign. So
implicit steps keep the signs of components that decay, which costs less than the allowed error.

A warning (`LOW`) is for a component that may have no digits. It was large, falls below FEW allowed
errors in two steps in a row while it remembers, and then grows to GROWN allowed errors, or a tenth
of its size. It remembers its former value if nothing else feeds it: h |g_i| is below the allowed
error, and |g_i| <= |f_i| / 2, where g is f with 0 for all components below their allowed errors.
If x_i divides f_i, nothing feeds it, and one step below FEW_ALONE allowed errors counts.
"""

from math import inf

from ..expressions.values import larger, smaller
from ..llvm.text import Carried
from .scalar_kernels import scalar_kernel

GROWN, STAYS = 1000.0, 0.125
FEW = 8.0  # allowed errors, below which a component has few digits
# The same for a component with the factor x_i in f_i, and at most OF_RTOL / rtol. Measured on 720
# runs of foxes and rabbits, rtol 1e-3 to 1e-9: 9 errors above 1e-3 (or 100 rtol) without a warning.
FEW_ALONE, OF_RTOL = 200.0, 0.02
# Allowed errors below which components may belong to L. Measured on 31 lasers that start from
# noise, with rtol and atol 1e-9: 1 stays dark without a warning with 8, none with 64.
NEAR = 64.0
NEXT = 0.25  # of the growth in a step that is looked at: the next step is four times as long


def _is_below(x, inverse, times=NEAR):
    """Return whether |x| < `times` allowed errors, which are 1 / `inverse`; False for clocks."""
    return (abs(x) * inverse < times) & (inverse > 0.0)


def _changes_sign(x, new, inverse):
    changes = ((x < 0.0) & (new > 0.0)) | ((x > 0.0) & (new < 0.0))
    return changes & _is_below(x, inverse) & _is_below(new, inverse)


@scalar_kernel
def GROWS(x, f, new, f_new, inverse, signed, grows):
    """Return `grows` = 1 if a small component grows or changes its sign in a step from x to `new`.

    Small is below NEAR allowed errors (1 / `inverse`). It grows if h f / x > NEXT; h is `signed`.
    """
    at_start = _is_below(x, inverse) & (signed * f / x > NEXT)
    at_end = _is_below(new, inverse) & (signed * f_new / new > NEXT)
    return {"grows": (at_start | at_end | _changes_sign(x, new, inverse)).select(1.0, grows)}


@scalar_kernel
def KEEPS_SIGN(x, new, inverse, remembers, feeds):
    """Return `new`, the component x after a step, with the sign of x if it is small and decays.

    Small is below NEAR allowed errors (1 / `inverse`). It decays if h df_i/dx_i < -1 (`remembers`
    is 2), and if no small component takes from another (`feeds` is 1).
    """
    changes = _changes_sign(x, new, inverse) & (remembers > 1.0) & (feeds > 0.0)
    return {"new": changes.select(-new, new)}


@scalar_kernel
def LARGE_ALONE(x, inverse, times):
    """Return `alone`: x, or 0 if |x| is below `times` allowed errors, which are 1 / `inverse`."""
    return {"alone": _is_below(x, inverse, times).select(0.0, x)}


def _is_fed(fed, inverse, taken):
    return abs(taken * fed) * inverse >= 1.0


@scalar_kernel
def REMEMBERS(x, f, fed, inverse, taken, signed):
    """Return `remembers` = 1 if x is small, not 0, and either unfed by others or growing by itself.

    `fed` is f_i with small components (|x| < NEAR / inverse) at 0; `signed` is h, `taken` |h|.
    """
    grows = signed * (f - fed) / x > NEXT
    is_free = ~_is_fed(fed, inverse, taken) | grows
    is_in = _is_below(x, inverse) & (abs(x) > 0.0) & is_free
    return {"remembers": is_in.select(1.0, 0.0)}


@scalar_kernel
def ENTRY(entry, of_row, of_column, is_diagonal, signed, feeds):
    """Return `entry`, J_ij of f', or 0 unless both i and j are small components of `REMEMBERS`.

    They are if `of_row` and `of_column` are not 0. `is_diagonal` is 1 if i = j. With h = `signed`,
    `feeds` becomes 0 if h J_ij < 0 and i != j, and `of_row` becomes 2 if h J_ii < -1.
    """
    own, is_own = ((of_row > 0.0) & (of_column > 0.0)).select(entry, 0.0), is_diagonal > 0.5
    takes = (signed * own < 0.0) & ~is_own
    return {
        "entry": own,
        "feeds": takes.select(0.0, feeds),
        "of_row": ((signed * own < -1.0) & is_own).select(2.0, of_row),
    }


@scalar_kernel
def PIVOT(pivot, taken, length, sign):
    """Update `length`, and the `sign` of det(1 - h J), by one pivot p of 1 - h J; `pivot` is 1 / p.

    `length` is the least h / (1 - p) with 1 - p > NEXT: longer steps damp growth. h is `taken`.
    """
    growth = 1.0 - 1.0 / pivot
    return {
        "length": (growth > NEXT).select(smaller(taken / growth, length), length),
        "sign": (pivot < 0.0).select(-sign, sign),
    }


@scalar_kernel
def LONGEST(length, sign, feeds, least):
    """Return `least`, or `length` if less and something grows: `sign` < 0 or `feeds` = 1."""
    return {"least": ((sign < 0.0) | (feeds > 0.0)).select(smaller(length, least), least)}


def _grown(rtol):
    """Return the size, in allowed errors, from which a small component has grown again."""
    return smaller(GROWN, 0.1 / rtol)


def _bounds(rtol, keeps):
    """Return two sizes of x_i in allowed errors: low, grown. `keeps` is 1 if x_i divides f_i."""
    few = (keeps > 0.0).select(smaller(FEW_ALONE, OF_RTOL / rtol), FEW)
    return few, (keeps > 0.0).select(4.0 * few, _grown(rtol))


@scalar_kernel
def FALLEN(new, largest, inverse, rtol, keeps, fallen):
    """Return `fallen` = 1 if a component, `new`, is low but was large before; else keep `fallen`.

    `largest` is its largest modulus, `inverse` 1 / allowed error; `keeps` is 1 if x_i divides f_i.
    """
    few, grown = _bounds(rtol, keeps)
    has_fallen = (abs(new) * inverse < few) & (largest * inverse > grown)
    return {"fallen": has_fallen.select(1.0, fallen)}


@scalar_kernel
def LOW(new, largest, f_new, fed, inverse, taken, last, rtol, keeps, low, watches):
    """Return `low`: for how many steps in a row (1, 2) a component is low; 3 if it grew after 2.

    `fed` is f_i where small components are 0, `inverse` 1 / allowed error, `largest` the largest
    modulus; `keeps` is 1 if x_i divides f_i. `watches` is the largest `low` < 3 of all components.
    """
    few, grown = _bounds(rtol, keeps)
    since = (low >= 2.0).select((abs(new) * inverse > grown).select(3.0, low), 0.0)
    stays = abs(f_new) * inverse * (last * rtol) < STAYS  # it does not just cross 0
    is_few = _is_below(new, inverse, FEW)
    remembers = is_few & (abs(new) > 0.0) & ~_is_fed(fed, inverse, taken)
    by_itself = abs(fed) <= 0.5 * abs(f_new)
    is_alone = (keeps > 0.0) & _is_below(new, inverse, few)
    is_low = (largest * inverse > grown) & (is_alone | (stays & remembers & by_itself))
    since = (is_few & ~(remembers | is_alone)).select(0.0, since)  # it is fed
    later = is_alone.select(2.0, smaller(low + 1.0, 2.0))
    now = (low >= 3.0).select(low, is_low.select(later, since))
    return {"low": now, "watches": larger((now < 3.0).select(now, 0.0), watches)}


def longest_step(code):
    """Return the longest step that damps no growth of small components, else infinity."""
    text, line, work, D = code.text, code.line, code.work, code.f.of.D
    sums = code.reduce(GROWS, lambda i: {"inverse": work.error[i]}, D, grows=0.0)

    def longest():
        feeds, least = _growth(code, line.x, line.f, text.value(inf))
        for i in text.each(D):
            inputs = {"inverse": work.error[i], "remembers": work.start[i]}
            work.new.put_chosen(i, code.apply(KEEPS_SIGN, i, feeds=feeds, **inputs)["new"])
        code.call("f", work.new, code.table, work.f_new)
        _, least = _growth(code, work.new, work.f_new, least)
        return [(sums.grows > 0.0).select(least, inf)]  # as if each lane were alone

    if not code.f.entries:
        return text.value(inf)
    (least,) = text.otherwise(~(sums.grows > 0.0).any(), [inf], longest)
    return least


def _growth(code, x, f, least):
    """Return `feeds` of `_factor_alone`, and the longest step, <= `least`, that damps no growth."""
    work = code.work
    feeds, count = _factor_alone(code, x, f), code.integrator.pivots
    found = code.reduce(PIVOT, lambda i: {"pivot": work.factors[i]}, count, length=inf, sign=1.0)
    found = code.apply(LONGEST, feeds=feeds, least=least, **vars(found))
    return feeds, found["least"]


def _factor_alone(code, x, rates):
    """Factorise 1 - h f'(x) on small components; return 1 if none takes from another (`ENTRY`)."""
    text, work, f = code.text, code.work, code.f
    _find_fed(code, x, NEAR)
    text.fill(work.start, code.D, lambda: 0.0)
    for i in text.each(code.f.of.D):
        inputs = {"x": x[i], "f": rates[i], "fed": work.f[i], "inverse": work.error[i]}
        work.start[i] = code.apply(REMEMBERS, **inputs)["remembers"]
    code.call("j", x, code.table, work.alone)
    places = [(i, j, float(i == j)) for i, j in f.pattern]
    rows, columns, diagonal = map(text.constants, zip(*places, strict=True))
    sums = Carried(feeds=1.0)
    for k in text.each(f.entries, sums):
        inputs = {"entry": work.alone[k], "is_diagonal": diagonal[k]}
        inputs |= {"of_row": work.start[rows[k]], "of_column": work.start[columns[k]]}
        found = code.apply(ENTRY, **inputs, **vars(sums))
        work.alone.put_chosen(k, found.pop("entry"))
        work.start.put_chosen(rows[k], found.pop("of_row"))
        sums.update(found)
    work.alone[f.entries] = work.signed[0]
    code.call("factor", work.alone, code.table, work.factors)
    return sums.feeds


def _find_fed(code, x, times):
    """Write f to the row `f`, at x with 0 for components below `times` allowed errors."""
    text, work = code.text, code.work
    text.copy(x, work.start, code.D)
    for i in text.each(code.f.of.D):
        alone = code.apply(LARGE_ALONE, x=x[i], inverse=work.error[i], times=times)["alone"]
        work.start.put_chosen(i, alone)
    code.call("f", work.start, code.table, work.f)


def watch_small(code, fallen):
    """Update `low`, how many steps components are low; `fallen` is 1 where one has fallen."""
    text, line, work = code.text, code.line, code.work
    looks = (work.accepted[0] > 0.0) & ((fallen > 0.0) | (line.watches[0] > 0.0))
    with text.when(looks.any(), likely=False):
        _find_fed(code, work.new, FEW)
        largest = Carried(watches=0.0)
        for i in text.each(code.f.of.D, largest):
            inputs = {"inverse": work.error[i], "watches": largest.watches, "fed": work.f[i]}
            found = code.apply(LOW, i, taken=work.taken[0], **inputs)
            line.low.choose(looks, i, found["low"])
            largest.watches = found["watches"]
        line.watches.choose(looks, 0, largest.watches)
