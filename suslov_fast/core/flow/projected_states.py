"""Projection of states onto constraints and first integrals, see `expressions.projection`.

The row `levels` has the values of invariants at the start of a trajectory, or after the last action
of an event. Those of constraints are 0. The rows `unkept` are 1 + the number of the first integral
that changes along f at the start of a step, the time of this start, and the time at the end of the
first step whose projection left out an integral. They are 0 if there is none.
"""

from .codegen import larger_of


def project(code, state):
    """Move the rows `state` to the levels of the invariants, if f has some."""
    f, text, line, given = code.f.of_x, code.text, code.line, code.work.projecting
    if not f.projection:
        return
    for i in text.each(f.D):
        given[i] = x = state[i]
        size = larger_of(abs(x), line.largest[i])
        given.after(f.D)[i] = code.component("extra", i) + code.number("rtol") * size
    text.copy(line.levels, given.after(2 * f.D), f.invariants_count)
    code.call("project", given, code.table, code.work.projected)
    text.copy(code.work.projected, state, f.D)


def test_integrals(code):
    """Test integrals at the start of a step, and at its end, after `project`."""
    f, line, work = code.f.of_x, code.line, code.work
    if f.changes:
        code.text.copy(line.x, work.changing, f.D)
        work.changing.after(f.D)[0] = work.signed[0]
        last, count = f.D + 1, len(f.tested)
        code.text.copy(work.projected.after(last), work.changing.after(last), count)
        code.call("changes", work.changing, code.table, work.changes)
    if f.left_out:
        work.left_out[0] = 0.0
        with code.text.when((work.projected[f.D] > 0.0).any(), likely=False):
            code.text.copy(work.projected, work.projecting, f.D)
            code.call("left_out", work.projecting, code.table, work.left_out)


def note(code):
    """Write results of `test_integrals` to the rows `unkept` in lanes that accept their step."""
    f, unkept, work = code.f.of_x, code.line.unkept, code.work
    if not f.left_out:
        return
    accepted = work.accepted[0] > 0.0
    if f.changes:
        is_first = accepted & (work.changes[0] > 0.0) & unkept[0].equals(0.0)
        unkept.choose(is_first, 0, work.changes[0])
        unkept.choose(is_first, 1, work.began[0])
    is_first = accepted & (work.left_out[0] > 0.0) & unkept[2].equals(0.0)
    unkept.choose(is_first, 2, code.line.t[0])


def kept_by_constraints(code, kept):
    """Return `kept`; 0 or -1 in lanes whose constraints lose their rank in the step to `new`.

    If it is -1, this happens within the allowed error of x, so the solution ends.
    """
    f, given, line = code.f.of_x, code.work.projecting, code.line
    if not f.regular:
        return kept
    code.text.copy(code.work.new, given, f.D)
    code.text.copy(line.x, given.after(2 * f.D + f.invariants_count), f.D)
    code.call("regular", given, code.table, code.work.projected)
    found = code.work.projected[0]
    return (found < 0.0).select(found, kept * found)


def keep_levels(code, truth, state):
    """Let the invariants have their values at `state` from now on, in lanes `truth`."""
    if code.f.of_x.projection:
        code.call("invariants", state, code.table, code.work.invariants)
        for k in code.text.each(code.f.of_x.invariants_count):
            code.line.levels.choose(truth, k, code.work.invariants[k])
