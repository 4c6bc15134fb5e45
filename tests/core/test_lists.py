"""Machine code of random lists of operations carries out what NumPy does, to the bit."""

import weakref

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast.core.code import compiler as machine_code, runs as listed
from suslov_fast.core.fields import called_stages, steps as steps_field
from suslov_fast.core.fields.stages import Stages
from suslov_fast.core.lists import step as operations

pytestmark = pytest.mark.compiled

ARITHMETIC = ["fadd", "fsub", "fmul", "fdiv", "fabs", "max", "min"]
COMPARISONS = ["olt", "ogt", "oge", "oeq"]
CONSTANTS = [0.0, -0.0, 1.0, -1.5, 1e-300, np.inf, np.nan]
STAGES = [(1.0,), (0.5, -0.25, 0.75)]


class RandomStep(operations.Step):
    """A list that no field has: it takes states, constants and parameters in any order."""

    def __init__(self, rng, D, T, length):
        self.indices, self.D, self.T = rng.integers(0, D, (3, T)), D, T
        self.of_one_sign = ()
        values = self.values = operations.Values(D + T, range(D, D + T))
        numbers, truths = [*range(D + T)], []
        emit = values.emit

        def operand():
            is_constant = rng.random() < 0.1
            return float(rng.choice(CONSTANTS)) if is_constant else int(rng.choice(numbers))

        def extend(count, kinds):
            for kind in rng.choice(kinds, count):
                if kind in COMPARISONS:
                    truths.append(emit(str(kind), operand(), operand()))
                elif kind in ("and", "or", "xor"):
                    truths.append(emit(str(kind), *map(int, rng.choice(truths, 2))))
                elif kind == "select":
                    numbers.append(emit("select", int(rng.choice(truths)), operand(), operand()))
                elif kind == "fabs":
                    numbers.append(emit("fabs", int(rng.choice(numbers))))
                else:
                    numbers.append(emit(str(kind), operand(), operand()))

        extend(length, ARITHMETIC)
        extend(4, COMPARISONS)
        extend(length // 2, [*ARITHMETIC, *COMPARISONS, "and", "or", "xor", "select"])
        self.after = [int(n) for n in rng.choice(numbers, D)]
        # Now and then all lanes are good, often some.
        self.good = emit("or", int(rng.choice(truths)), int(rng.choice(truths)))
        first = len(values.operations)
        extend(length // 3, [*ARITHMETIC, *COMPARISONS, "and", "or", "xor", "select"])
        # As in a step, both are the same where `good` is true.
        self.after_rare = [emit("select", self.good, k, operand()) for k in self.after]
        self.accurate, self.negative = emit("olt", 0.0, 1.0), emit("olt", 1.0, 0.0)
        self.rare = values.operations[first:]
        self._separate_fixed()


def reference(step, x, halves, fractions, steps):
    """Carry out the list by NumPy, stage by stage; return all states (steps + 1, B, D)."""
    states = [x]
    for _ in range(steps):
        for fraction in fractions:
            values = dict(enumerate([*x.T, *(fraction * halves).T]))
            with np.errstate(all="ignore"):
                for part in (step.fixed, step.usual, step.rare):
                    operations.evaluate(part, values)
            x = np.transpose([np.broadcast_to(values[k], len(x)) for k in step.after_rare])
        states.append(x)
    return np.array(states)


def same_bits(found, expected):
    """Return whether numbers are equal, with their signs, or both are NaN."""
    same = (found == expected) & (np.signbit(found) == np.signbit(expected))
    return (same | (np.isnan(found) & np.isnan(expected))).all()


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(24))
def test_the_code_of_steps_does_what_numpy_does(monkeypatch, seed):
    """For lanes with parameters of their own, any alignment."""
    rng = np.random.default_rng(seed)
    monkeypatch.setattr(machine_code, "known_codes", {})
    D, T, steps, stages = 1 + seed // 2 % 4, 1 + seed % 3, 3, STAGES[seed // 4 % 2]
    step = RandomStep(rng, D, T, 60)
    W, B = (1, 2, 4, 8)[seed % 4], (13, 16, 24)[seed % 3] if seed % 4 else 1
    scheme = steps_field.Scheme(step, Stages(stages))
    for every in (0, 1, 2):
        for count in (1, B):  # rows of parameters
            x = rng.normal(size=(B, D)) * 10.0 ** rng.integers(-3, 4, (B, D))
            x[rng.random(x.shape) < 0.1] = rng.choice(CONSTANTS)
            values, eps = rng.normal(size=(count, T)), rng.uniform(0.1, 1.0, count)
            notes = np.zeros(B, np.int8), np.zeros(B, np.int64), np.zeros(B)
            lines = steps_field._Lines((scheme, values, eps), x, notes, W)
            memory = np.empty((steps + 2) * B * D + 16)
            shift = -(memory.ctypes.data // 8) % 8 + (0, 1, 2)[(seed + count) % 3]
            rows = steps // every if every else 0
            saved = memory[shift : shift + rows * B * D].reshape(rows, B, D)
            assert lines.take(0, steps, saved, every, True, ())
            halves = 0.5 * eps[:, None] * values
            states = reference(step, x, halves, stages, steps)
            assert same_bits(lines.states(), states[-1])
            assert same_bits(saved, states[every::every] if every else states[:0])
    kinds = {key[4:7] for key, _ in machine_code.known_codes}
    assert {W} == {each[0] for each in kinds}
    assert len(kinds) >= (2 if B == 1 else 4)
    assert None not in machine_code.known_codes.values()


def test_the_arrays_of_a_long_list_live_as_long_as_its_steps():
    """Of threads that begin at once, `programs_of` keeps the arrays of one alone."""
    field = sf.QuadraticField.from_function(
        lambda x: (x[1] * x[2], x[0] - x[1], x[0] ** 2 - x[2]), 3
    )
    indices, values = field.terms
    scheme, x = steps_field.scheme_of(indices, 3), np.full((8, 3), 0.5)
    notes = np.zeros(8, np.int8), np.zeros(8, np.int64), np.zeros(8)
    given = scheme, np.atleast_2d(values), np.array([0.1])
    lines = steps_field._Lines(given, x, notes, 8)
    stage = called_stages.StageByRuns(lines)
    heads = weakref.ref(listed.programs_of(scheme.step).usual.runs.heads)
    listed.programs_of.cache_clear()
    assert heads() is not None
    assert stage.programs[0].runs.heads is heads()
