"""The next state from the ends of columns: x_next, f(x_next), and the error estimate e (`step`).

A component whose rate contains it as a factor keeps its sign. So does a denominator in f that
depends on time alone, because a solution does not cross a pole of f.
"""

from ..expressions.tolerances import TINY
from ..llvm.text import Carried
from . import allowed_errors, projected_states
from .codegen import larger_of, weighted
from .scalar_kernels import scalar_kernel
from .tolerances import LEAST_SIZE, LEAST_SIZE_OF_COLUMNS, NOISE_OF_STEP


def _changes_sign(x, new):
    return ((x < 0.0) & (new > 0.0)) | ((x > 0.0) & (new < 0.0))


@scalar_kernel
def KEPT(x, new, keeps, kept, extra, rtol, size):
    """Return `new` with the sign of x if the component keeps its sign (`keeps`), and `kept`.

    `kept` becomes 0, which refuses the step, if `new` had the other sign and was not small.
    """
    changes = _changes_sign(x, new) & (keeps > 0.0)
    is_large = abs(new) > extra + rtol * size
    return {"kept": (changes & is_large).select(0.0, kept), "new": changes.select(-new, new)}


def find_next_state(code):
    """Write the next state, f at this state, and errors to the rows `new`, `f_new` and `error`.

    Return `kept`, which is 0 where a component or a denominator loses its sign, or constraints lose
    their rank (-1 ends the solution), and two dicts {input of kernels of `allowed_errors`: number},
    from maxima over x, and over columns of derivatives.
    """
    text, integrator, line, work = code.text, code.integrator, code.line, code.work
    own, of_error = integrator.rule.weights, integrator.rule.error_weights
    sums, sizes = Carried(top=0.0, moved=0.0, kept=1.0), []
    for first, count in integrator.parts:
        for i in text.each(count, sums):
            i = i + first
            x, ends = line.x[i], code.of_columns(work.ends, i)
            new = x + weighted(own, ends)
            if code.f.steady:
                exact = x + work.signed[0] * line.f_x[i]
                new = (code.component("steady", i) > 0.0).select(exact, new)
            if code.f.of_one_sign:
                size = abs(x) if integrator.has_atol else line.largest[i]
                found = code.apply(KEPT, i, x=x, new=new, kept=sums.kept, size=size)
                new, sums.kept = found["new"], found["kept"]
            work.new.put_chosen(i, new)
            work.error[i] = weighted(of_error, ends)
            if not integrator.has_atol:
                sums.update(code.apply(allowed_errors.LARGEST, i, **vars(sums) | {"new": new}))
        if integrator.has_atol:
            sizes.append({})
            continue
        smallest = LEAST_SIZE if first == 0 else LEAST_SIZE_OF_COLUMNS
        least = larger_of(code.number("rtol") * (smallest * sums.top), TINY)
        sizes.append({"moved": sums.moved, "least": least, "noisy": NOISE_OF_STEP * sums.top})
    projected_states.project(code, work.new)
    projected_states.test_integrals(code)
    kept = projected_states.kept_by_constraints(code, sums.kept)
    code.call("f", work.new, code.table, work.f_new)
    for k in range(code.D, code.extended):  # denominators that depend on time alone
        kept = _changes_sign(line.f_x[k], work.f_new[k]).select(0.0, kept)
    return kept, sizes


def move(code):
    """Add code that moves lanes to their next state if they accept their step."""
    text, line, work = code.text, code.line, code.work
    accepted = work.accepted[0] > 0.0
    for i in text.each(code.D):
        new = work.new[i]
        line.x.choose(accepted, i, new)
        code.keep_largest(accepted, i, new)
    for i in text.each(code.extended):
        line.f_x.choose(accepted, i, work.f_new[i])
