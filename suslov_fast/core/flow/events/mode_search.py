"""Modes of surfaces that meet: all are tried, and the only consistent ones are chosen.

Several surfaces along which a solution may slide (`hybrid.sliding`) meet at the state. An action
has found a mode for each, one after the other, and has marked those of surfaces whose modes depend
on one another (`Mark`). With n marks there are 3**n sets of modes 1, -1 and 0. If f leads from the
state with one set alone, the solution goes on with it. If f leads away with none, and the solution
has arrived at the state, all modes become 0, and it stays where the surfaces meet: it winds into
this point. If several sets are consistent, the solution is not unique, and modes become infinite.
"""

from math import inf

from ...expressions.values import smaller
from ...hybrid.event_formulas import Mark
from ...llvm.text import Carried
from ..scalar_kernels import scalar_kernel

OF_SURFACE = "leads", "admits", "inside"  # results of the part `search` for each surface


def _parts(mode):
    """Return the mark of a mode, or 0, and the mode without it."""
    count = (mode * (1.0 / Mark.STEP) + 0.5).then("floor")
    mark = (mode < inf).select(Mark.STEP * count, 0.0)
    return mark, mode - mark


@scalar_kernel
def FIRST(mode):
    """Return a `mode` without its mark, and whether it is marked."""
    mark, found = _parts(mode)
    return {"found": found, "is_marked": mark > 0.0}


@scalar_kernel
def TRIED(mode, trial, leads, admits, inside, surely, hardly, stays):
    """Return `surely`, `hardly` and `stays` with the results for one more surface.

    They are 1 as long as all surfaces so far have consistent modes; as long as they have if
    rounding errors are admitted; and as long as all modes are 0, and the solution can slide.
    """
    is_free = ~(_parts(mode)[0] > 0.0)
    is_0 = is_free.select(1.0, trial.equals(0.0).select(inside, 0.0))
    return {
        "surely": is_free.select(surely, smaller(leads, surely)),
        "hardly": is_free.select(hardly, smaller(admits, hardly)),
        "stays": smaller(is_0, stays),
    }


@scalar_kernel
def NEXT(mode, trial, carry):
    """Return the next mode to try, and 1 if the next surface gets another mode, too, else 0."""
    mark, found = _parts(mode)
    turns = (mark > 0.0) & (carry > 0.0)
    after = trial.equals(0.0).select(1.0, (trial > 0.0).select(-1.0, 0.0))
    carried = after.equals(found).select(1.0, 0.0)
    return {"trial": turns.select(after, trial), "carry": turns.select(carried, carry)}


@scalar_kernel
def CHOSEN(mode, only, count, right, stay):
    """Return the new mode of a surface; `count` sets of modes are consistent, one has `only`.

    `right` is 1 if the modes found first are consistent up to rounding. `stay` is 1 if the solution
    may also slide along all surfaces, though f does not lead back to each from both sides.
    """
    mark, found = _parts(mode)
    may_stay = (mark > Mark.BEGINS) & (stay > 0.0)
    kept = (right > 0.0).select(found, may_stay.select(0.0, inf))
    sets = count + (mark > Mark.LEAVES).select(stay, 0.0)
    meeting = (count > 0.0).select((sets > 1.0).select(inf, only), kept)
    near = (may_stay & count.equals(0.0)).select(0.0, found)
    new = (mark > Mark.ARRIVES).select(near, meeting)
    return {"mode": (mark > 0.0).select(new, mode)}


def is_marked(code):
    """Return the truth values that some mode of a lane has a mark."""
    first, count = code.integrator.events.modes
    marks = Carried(sum=0.0)
    for g in code.text.each(count, marks):
        found = code.apply(FIRST, mode=code.work.new.after(first)[g])
        marks.sum = found["is_marked"].select(1.0, marks.sum)
    return marks.sum > 0.0


def find_modes(code):
    """Replace marked modes in the row `new`; return in which lanes there were any."""
    text, work, (first, count) = code.text, code.work, code.integrator.events.modes
    modes, trial, tried = work.new.after(first), work.trying.after(first), work.tried
    truth = is_marked(code)
    text.copy(work.new, work.trying, code.f.of_x.D)
    for g in text.each(count):
        trial[g] = work.only[g] = code.apply(FIRST, mode=modes[g])["found"]
    found = Carried(count=0.0, right=-1.0, stay=0.0, searches=truth.select(1.0, 0.0))
    for now in text.rounds(found):
        code.call("search", work.trying, code.table, tried)
        unclear, searches = tried[3 * count], now.searches > 0.0
        agree = Carried(surely=1.0, hardly=1.0 - unclear, stays=1.0 - unclear)
        for g in text.each(count, agree):
            results = {name: tried.after(k)[g * 3] for k, name in enumerate(OF_SURFACE)}
            inputs = vars(agree) | results | {"mode": modes[g], "trial": trial[g]}
            agree.update(code.apply(TRIED, **inputs))
        now.count = now.count + (searches & (agree.surely > 0.0)).select(1.0 + unclear, 0.0)
        now.right = (now.right < 0.0).select(agree.hardly, now.right)
        stays = (agree.stays > 0.0) & ~(agree.surely > 0.0)
        now.stay = (searches & stays).select(1.0, now.stay)
        turn = Carried(carry=1.0)
        for g in text.each(count, turn):
            work.only.choose(searches & (agree.surely > 0.0), g, trial[g])
            after = code.apply(NEXT, mode=modes[g], trial=trial[g], carry=turn.carry)
            trial[g], turn.carry = after["trial"], after["carry"]
        now.searches = (turn.carry > 0.0).select(0.0, now.searches)
        now.goes_on = (now.searches > 0.0).any()
    for g in text.each(count):
        inputs = {"mode": modes[g], "only": work.only[g]}
        inputs |= {"count": found.count, "right": found.right, "stay": found.stay}
        modes[g] = code.apply(CHOSEN, **inputs)["mode"]
    return truth
