"""The rule of an integrator: how its columns go from x to their ends, and all that depends on it.

`rules` lists the rules. Each has a file of its own, with a class that begins with `Rule`.
"""

from .weights import weights, weights_of_errors


class Rule:
    """The base of the rules of columns, for a right-hand side f.

    A rule has these attributes:

    mode         the `LaneState` of lanes that take steps by this rule
    p            ends of columns have errors in powers of (h / N)**p
    columns      numbers N of the sub-steps of columns, with `weights` and `error_weights`
    power        the next length has the factor ratio**(-1 / power), see `step_length`
    predicts     True if two steps predict the next length, see `step_length`
    loses        (a, n): steps lose about (g / a)**n of growth exp(g), n is even, see
                 `growing_components`
    interpolates  True if `dense_output` finds states inside a step; else each requested time has a
                 step aside (`step_length`), whose end may have fast modes that f shows
    damps        True if long steps damp all fast modes, also growing ones
    has_points   True if the rule finds states inside a step (`point`), which are less accurate than
                 the polynomial that other rules use to find surfaces
    columns_for  the function of `weights` that chooses `columns`
    floor        the name of the `ComponentNumbers` for allowed errors, see `floors_of`
    grows        factor of rounding errors of h f, see `second_trial`
    sums         names of numbers that `add_errors` sums over components
    lanes        how many columns one trajectory of a dense f computes side by side

    `code` in the methods is the `StepCode` of a step.
    """

    predicts, has_points, sums, lanes = False, False, (), 1

    def __init__(self, f, columns):
        self.f, self.columns = f, columns
        self.weights = weights(columns, self.p)
        self.error_weights = weights_of_errors(columns, self.p)

    @classmethod
    def fits(cls, f):
        """Return True if the rule can take steps of a `RightHandSide` f."""
        return True

    @property
    def key(self):
        """A tuple that identifies the code of this rule."""
        return type(self).__name__, self.columns

    def add_functions(self, functions):
        """Add `vector_functions` that columns call to the dict `functions`, after f."""

    def rows(self):
        """Return {part of the workspace: number of its rows}, with parts `apart` and `nodes`."""

    def add(self, text, integrator, name, for_each):
        """Add the function void columns(x, f, table, work, count) to the text.

        The function writes y_c - x, for the ends y_c of the first `count` columns, to the row
        `ends` of `work`. The row `signed` of `work` has the length of the step, with the sign of
        time. x, f, `table` and `work` are addresses; f is f(x).
        """

    def find_columns(self, code):
        """Write y_c - x to the row `ends`; return inputs of `turn` by name."""
        code.columns(code.line.x, code.line.f_x, len(self.columns))
        return {}

    def begin_errors(self, code):
        """Prepare what `add_errors` needs."""

    def add_errors(self, code, i, sums, inverse):
        """Return numbers in `sums` by name, increased by those of component i.

        They are `apart` and `sums` of the rule; `inverse` is 1 / the allowed error of component i.
        """
        return {}

    def end_errors(self, code, errors):
        """Return by name what replaces `errors`, results of `allowed_errors.find_errors`."""
        return {}

    def begin_trial(self, code):
        """Return a function of i, the component i of the sum that shows false ends (`step`)."""
        return lambda i: code.text.value(0.0)

    def row_of_change(self, code):
        """Return the row in which `second_trial` finds changes h f of a sub-step."""
        return code.work.f_start

    def propagate(self, code):
        """Replace the change in this row by the change of the sub-step's end."""

    def turn(self, code, errors):
        """Let lanes change to a rule of another mode, or end, by the `errors` of the step.

        `step_length` has kernels for this: TURN_EXPLICIT reads sums of DIFFERENCES.
        """
