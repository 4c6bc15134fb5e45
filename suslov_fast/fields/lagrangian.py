"""Equations of motion from a Lagrangian L(q, u): constraints, forces, Hamel's equations.

q are generalized coordinates, and u velocities: q' = F(q, u) is u, or linear in u in a moving frame
whose vectors have the brackets [e_i, e_j] = sum_k c_ijk e_k. With momenta p = L_u and B = F_u,

M u' + r = A^T lambda,     M = p_u,     r = p_q q' + p_t - B^T L_q - sum_ik c_ijk u_i p_k - Q.

A = phi_u is the matrix of the constraints phi(q, u, t) = 0. A constraint g(q, t) = 0 without
velocities is holonomic: then phi = g_q q' + g_t. The derivative of phi in time gives A u' = c with
c = -phi_q q' - phi_t. The multipliers lambda are eliminated as formulas.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from ..checks import short, wrong
from ..core.expressions.derivative import gradients
from ..core.expressions.programs import program_of
from .linear_equations import is_zero, less, product_of, solved, sum_of
from .names import variables, with_time
from .samples import Samples
from .symbols import Symbol, Symbols
from .tolerances import ENTRIES_OF_ROW, LEAST_EIGENVALUE_OF_MASS
from .tracer import Tracer
from .trigonometry import shorter
from .user_function import UserFunction

_FUNCTION = "a function of (q, v), or (q, v, t), and of parameters by name"


class Mechanics(NamedTuple):
    """What `of_lagrangian` returns: operands in the list of the tracer.

    `quantities` are functions of the state, by name: the energy u p - L, the momenta p, and of
    systems with constraints `residuals` (phi, then g), `multipliers`, `reactions` A^T lambda,
    `matrix` (A, by rows), `sizes` (sums of moduli of terms of the residuals), and `corrections`,
    one Newton step to the constraints that is least in the metric of M.
    """

    tracer: Tracer
    rates: list[Any]
    quantities: dict[str, list[Any]]


def names_of(coordinates: Any, velocities: Any, has_frame: bool) -> tuple[tuple[str, ...], ...]:
    """Return the names of coordinates and of velocities, by default "vx vy" for "x y"."""
    q = variables(coordinates)
    if has_frame and not velocities:
        raise wrong("velocities", 'names of the velocities of the frame, "u w"', "left out")
    u = variables(velocities or [f"v{name}" for name in q])
    if not has_frame and len(u) != len(q):
        raise wrong("velocities", f"{len(q)} names, one for each coordinate", f"{len(u)}")
    return q, u


class _Functions:
    """Calls of L, constraints, forces and the frame with symbols of the state (q, u), and of t.

    flows    q' and, if a function takes time t, 1: the rates of the components `places`
    """

    def __init__(self, q: Sequence[str], u: Sequence[str], functions: Any, values: Any) -> None:
        self.n, self.m = sizes = len(q), len(u)
        self.given = {
            name: UserFunction(name, f, values, sizes)
            for name, f in functions.items()
            if f is not None
        }
        for name, f in self.given.items():
            lost = [a for a in f.needed[2:] if a not in f.takes]
            if lost or len(f.needed) < 2:
                how = f"pass a value of {lost[0]}" if lost else "write lambda q, v: ..."
                raise wrong(name, _FUNCTION, f"one of {f.needed}: {how}", TypeError)
        if idle := [p for p in values if not any(p in f.takes for f in self.given.values())]:
            raise TypeError(f"from_lagrangian: no function has the parameter {idle[0]!r}")
        takes_time = any(f.has_time for f in self.given.values())
        layout = with_time(variables((*q, *u)), takes_time)
        self.tracer = Tracer(layout, [*values])
        self.places = [*range(self.n), *range(layout.size, layout.D)]
        frame = self.symbols("frame", self.n) if "frame" in self.given else self.velocities
        self.flows = np.array(layout.completed(frame, 1.0), object)

    @property
    def velocities(self) -> Any:
        return self.tracer.state[self.n : self.n + self.m]

    def symbols(self, name: str, count: int | None = None) -> Any:
        """Return the results of a function, an array; zeros if it was not given."""
        if name not in self.given:
            return np.zeros(count or 0, object) + 0.0
        rows = self.given[name].formulas(self.tracer)
        if count not in (None, len(rows)):
            raise wrong(name, f"{count} components", f"{len(rows)}")
        return _array(self.tracer, rows)

    def shorter(self, array: Any, at_rest: bool = False) -> Any:
        """Return an array of shorter formulas, see `trigonometry`; also parts without velocities if
        `at_rest`.
        """
        tracer = self.tracer
        operands = [tracer.number(a) for a in array.ravel()]
        velocities = None if at_rest else range(self.n, self.n + self.m)
        found = shorter(tracer.values, operands, velocities)
        return _array(tracer, found).reshape(array.shape)


def _array(tracer: Tracer, operands: Sequence[Any]) -> Any:
    """Return an array of symbols, and of numbers for constant operands."""
    return _filled([a if isinstance(a, float) else Symbol(tracer, a) for a in operands])


def slopes(tracer: Tracer, values: Any, by: Sequence[int]) -> Any:
    """Return the matrix of derivatives of values with respect to variables of the state."""
    operands = [tracer.number(a) for a in values]
    operations = program_of(tracer.values.operations, operands).operations
    rows = gradients(tracer.values, operations, operands, tracer.D)
    rows = [row if type(a) is int else {} for a, row in zip(operands, rows, strict=True)]
    entries = _array(tracer, [row.get(j, 0.0) for row in rows for j in by])
    return entries.reshape(len(rows), len(by))


def of_lagrangian(
    functions: Mapping[str, Any],
    q: tuple[str, ...],
    u: tuple[str, ...],
    parameters: Mapping[str, Any],
    algebra: Any = None,
) -> Mechanics:
    """Return the equations for functions L, constraints, forces and frame; None: not given.

    With a frame, they are Hamel's equations for the structure constants of the `algebra`.
    """
    traced = _Functions(q, u, functions, parameters)
    tracer, n, m, flows = traced.tracer, traced.n, traced.m, traced.flows
    L, of_u = traced.shorter(traced.symbols("L")), range(n, n + m)
    p = slopes(tracer, L, of_u)[0]
    M, r = _inertia(traced, L, p, algebra)
    forces = traced.symbols("forces", m)
    pairs = zip(traced.shorter(-r), forces, strict=True)
    b = _filled([sum_of([(1.0, a), (1.0, Q)]) for a, Q in pairs])
    phi, g, holonomic = _constraints(traced)
    A, c = slopes(tracer, phi, of_u), -(slopes(tracer, phi, traced.places) @ flows)
    elimination = _elimination(traced, M, A, parameters)
    rates, multipliers = elimination.solution(b, traced.shorter(c))
    quantities = {"energy": [traced.velocities @ p - L[0]], "momenta": p}
    if len(A):
        shift = np.zeros(len(A), object) + 0.0
        shift[holonomic] = -g
        at_rest = np.zeros(m, object) + 0.0
        move, _ = elimination.solution(at_rest, shift)
        change, _ = elimination.solution(at_rest, -phi)
        B = slopes(tracer, flows[:n], of_u)
        state = _array(tracer, range(tracer.D))
        residuals = np.concatenate([phi, g])
        terms = slopes(tracer, residuals, range(tracer.D)) * state
        quantities |= {
            "residuals": residuals,
            "multipliers": -multipliers,
            "reactions": A.T @ -multipliers,
            "matrix": A.ravel(),
            "sizes": [sum(map(abs, row)) for row in terms],
            "corrections": np.concatenate([B @ move, change]),
        }
    operands = {name: [*map(tracer.result, of)] for name, of in quantities.items()}
    rates = [*map(tracer.result, [*flows[:n], *rates, *flows[n:]])]
    return Mechanics(tracer, rates, operands)


def _inertia(traced: _Functions, L: Any, p: Any, algebra: Any) -> tuple[Any, Any]:
    """Return M and r, without forces."""
    tracer, n, m = traced.tracer, traced.n, traced.m
    M = slopes(tracer, p, range(n, n + m))
    M = np.where(np.tri(m, dtype=bool), M, M.T)  # symmetric also in rounding
    L_q = slopes(tracer, L, range(n))[0]
    if "frame" in traced.given:
        L_q = slopes(tracer, traced.flows[:n], range(n, n + m)).T @ L_q
        c = _structure_constants(algebra, m)
        for i, j, k in np.argwhere(c).tolist():
            L_q[j] = L_q[j] + float(c[i, j, k]) * traced.velocities[i] * p[k]
    return M, -L_q + slopes(tracer, p, traced.places) @ traced.flows


def _constraints(traced: _Functions) -> tuple[Any, Any, list[int]]:
    """Return phi of all constraints, g of the holonomic ones, and the rows of these in phi."""
    tracer, n, m = traced.tracer, traced.n, traced.m
    phi = traced.shorter(traced.symbols("constraints"))
    given, holonomic = phi.copy(), []
    for row, of_u in enumerate(slopes(tracer, phi, range(n, n + m))):
        if all(map(is_zero, of_u)):
            along = slopes(tracer, given[row : row + 1], traced.places)[0]
            if all(map(is_zero, along[:n])):
                text = tracer.text(tracer.number(given[row]))
                raise wrong("constraints", "functions of q or v", f"{text} in row {row}")
            phi[row] = along @ traced.flows
            holonomic.append(row)
    return phi, given[holonomic], holonomic


def _elimination(traced: _Functions, M: Any, A: Any, parameters: Mapping[str, Any]) -> Any:
    """Return the elimination of multipliers from M u' - A^T lambda = b, A u' = c."""
    pivots = [
        (r, (j,), A[r, j]) for r, j in np.ndindex(A.shape) if isinstance(A[r, j], float) and A[r, j]
    ]
    pivots = pivots or _unit_vectors(traced, A)
    if not pivots:
        return _Simultaneous(traced.tracer, M, A, parameters)

    def order(pivot: Any) -> Any:
        r, places, size = pivot
        return sum(not is_zero(a) for j in places for a in M[j]), -abs(size), (r, places)

    return _Substituted(traced, M, A, min(pivots, key=order), parameters)


def _unit_vectors(traced: _Functions, A: Any) -> list[Any]:
    """Return all (r, (i, j), a) such that A_ri**2 + A_rj**2 is a number a, as for sin and cos."""
    found = []
    for r, row in enumerate(A):
        places = [j for j, a in enumerate(row) if not is_zero(a)]
        for i, j in combinations(places, 2) if len(places) <= ENTRIES_OF_ROW else ():
            square = _dot(row[[i, j]], row[[i, j]])
            [a] = traced.shorter(_filled([square]), at_rest=True)
            if isinstance(a, float) and a:
                found.append((r, (i, j), a))
    return found


class _Substituted:
    """An elimination that begins with a constraint A_r u' = c_r, as A_r d is a number s.

    d is the unit vector of one component, or it has two components of A_r as entries, see
    `_unit_vectors`. Vectors with A_r u' = 0 are the combinations N w of columns of N, so u' = N w +
    d c_r / s, and N^T M N w - (A N)^T lambda = N^T (b - M d c_r / s) without lambda_r. The part of
    M u' along d gives lambda_r later.
    """

    def __init__(
        self,
        traced: _Functions,
        M: Any,
        A: Any,
        pivot: tuple[int, tuple[int, ...], float],
        parameters: Mapping[str, Any],
    ) -> None:
        self.traced = traced
        r, places, size = pivot
        self.r, self.inverse, self.d = r, 1.0 / size, np.zeros(len(M), object) + 0.0
        self.d[list(places)] = A[r, list(places)] if len(places) > 1 else 1.0
        columns = []
        for k, a in enumerate(A[r]):
            if k not in places:
                column = _filled([product_of(product_of(-self.inverse, a), b) for b in self.d])
                column[k] = 1.0
                columns.append(column)
        if len(places) > 1:
            i, j = places
            across = np.zeros(len(M), object) + 0.0
            across[i], across[j] = A[r, j], product_of(-1.0, A[r, i])
            columns.insert(i, across)
        self.N = np.stack(columns, axis=1) if columns else np.zeros((len(M), 0), object)
        self.others = np.delete(A, r, axis=0)
        self.M_d = traced.shorter(_dot(M, self.d), at_rest=True)
        self.others_d = _dot(self.others, self.d)
        inner = traced.shorter(_dot(self.N.T, _dot(M, self.N)), at_rest=True)
        inner = np.where(np.tri(len(inner), dtype=bool), inner, inner.T)
        rows = traced.shorter(_dot(self.others, self.N), at_rest=True)
        self.inner = _elimination(traced, inner, rows, parameters)

    def solution(self, b: Any, c: Any) -> tuple[Any, Any]:
        """Return u' and -lambda."""
        r, first = self.r, product_of(self.inverse, c[self.r])
        right = _dot(self.N.T, [less(a, k, first) for a, k in zip(b, self.M_d, strict=True)])
        pairs = zip(np.delete(c, r), self.others_d, strict=True)
        w, minus = self.inner.solution(
            self.traced.shorter(right), _filled([less(a, k, first) for a, k in pairs])
        )
        pairs = zip(_dot(self.N, w), self.d, strict=True)
        u = _filled([sum_of([(1.0, a), (k, first)]) for a, k in pairs])
        rest = less(less(_dot(self.d, b), 1.0, _dot(self.M_d, u)), 1.0, _dot(self.others_d, minus))
        return u, np.insert(minus, r, product_of(self.inverse, rest))


def _dot(a: Any, b: Any) -> Any:
    """Return the product of a matrix or vector, and of a matrix or vector."""
    a, b = np.asarray(a, object), np.asarray(b, object)
    if a.ndim == 1 and b.ndim == 1:
        return sum_of(zip(a, b, strict=True))
    shape = (*a.shape[:-1], *b.shape[1:])
    rows, columns = np.atleast_2d(a), b.T if b.ndim == 2 else [b]
    return _filled([sum_of(zip(x, y, strict=True)) for x in rows for y in columns]).reshape(shape)


def _filled(entries: Any) -> Any:
    array = np.empty(len(entries), object)
    array[:] = entries
    return array


class _Simultaneous:
    """The elimination of all unknowns together.

    As A u' = c, the equations hold with M + w A^T A and b + w A^T c, too. This matrix is regular
    also where M is singular, as for bodies without a moment of inertia, which constraints alone
    keep from turning. w is 0 only if M is numbers.
    """

    def __init__(self, tracer: Tracer, M: Any, A: Any, parameters: Mapping[str, Any]) -> None:
        self.tracer, self.A = tracer, A
        self.is_definite, w = _weight(tracer, M, A, parameters)
        self.weighted = w * A.T if w else 0.0 * A.T
        whole = M + self.weighted @ A if w else M
        whole = np.where(np.tri(len(M), dtype=bool), whole, whole.T)
        corner = np.zeros((len(A), len(A)), object) + 0.0
        self.rows = np.block([[whole, A.T], [A, corner]]).tolist()

    def solution(self, b: Any, c: Any) -> tuple[Any, Any]:
        """Return u' and -lambda."""
        right = self._plain([*(b + self.weighted @ c), *c])
        rows, m = [self._plain(row) for row in self.rows], self.A.shape[1]
        try:
            x = solved(rows, right, Samples(self.tracer), m, self.is_definite)
        except ValueError:
            if not len(self.A):
                need = "a function with a regular matrix of masses, L_vv"
                how = "leave out velocities that constraints or L do not determine"
                raise wrong("L", need, f"one with a singular matrix: {how}") from None
            how = "leave out constraints that follow from others, or give each velocity a mass"
            raise wrong("constraints", "independent", f"dependent on one another: {how}") from None
        x = _array(self.tracer, [self.tracer.number(a) for a in x])
        return x[:m], x[m:]

    def _plain(self, values: Any) -> list[Any]:
        return [*_array(self.tracer, [self.tracer.number(a) for a in values])]


def _weight(tracer: Tracer, M: Any, A: Any, parameters: Mapping[str, Any]) -> tuple[bool, float]:
    """Return if M + w A^T A is positive definite at random states, and w."""
    if not len(M):  # constraints have determined all velocities
        return True, 0.0
    samples = Samples(tracer, parameters)
    found = [samples.matrices(matrix) for matrix in (M, A)]
    finite = np.all([np.isfinite(each).all((1, 2)) for each in found], axis=0)
    inertia, squares = found[0][finite], (found[1].transpose(0, 2, 1) @ found[1])[finite]
    has_numbers = all(isinstance(tracer.number(a), float) for a in M.ravel())
    if not len(A) or not len(inertia) or (has_numbers and _is_definite(inertia)):
        return len(inertia) > 0 and _is_definite(inertia), 0.0
    with np.errstate(all="ignore"):
        ratios = np.divide(*(np.einsum("sii->s", each) for each in (inertia, squares)))
        power = float(np.nan_to_num(np.log2(np.median(ratios))))
    w = 2.0 ** round(min(max(power, -60.0), 60.0))
    return _is_definite(inertia + w * squares), w


def _is_definite(matrices: Any) -> bool:
    """Return True if all symmetric matrices (n, m, m) are positive definite."""
    sizes = np.sqrt(abs(np.einsum("sii->si", matrices)))
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    scaled = matrices / sizes[:, :, None] / sizes[:, None, :]
    return bool((np.linalg.eigvalsh(scaled)[:, 0] > LEAST_EIGENVALUE_OF_MASS).all())


def _structure_constants(algebra: Any, m: int) -> Any:
    """Return the structure constants c (m, m, m) of "so3", "se3", or of an array."""
    if isinstance(algebra, str):
        i, j, k = np.ogrid[:3, :3, :3]
        turns = (i - j) * (j - k) * (k - i) / 2.0
        c = np.zeros((6, 6, 6))  # of rotations (0 to 2) and translations (3 to 5)
        for a, b, d in ((0, 0, 0), (0, 3, 3), (3, 0, 3)):
            c[a : a + 3, b : b + 3, d : d + 3] = turns
        algebra = {"so3": turns, "se3": c}.get(algebra, algebra)
    if algebra is None or isinstance(algebra, str):
        raise wrong("algebra", '"so3", "se3" or an array of structure constants', short(algebra))
    c = np.asarray(algebra, float)
    if c.shape != (m, m, m) or (c != -c.transpose(1, 0, 2)).any():
        raise wrong(
            "algebra", f"structure constants of {m} velocities, c[i, j] = -c[j, i]", c.shape
        )
    return c


def velocity(position: Any, q: Any, v: Any) -> Any:
    """Return the rate of position(q) along v, for use in L or in constraints.

    `position` takes symbols q and returns an array of formulas, such as a point or a rotation.
    """
    value = np.asarray(position(q), object)
    by = [each.operand for each in q]
    rates = slopes(q[0].tracer, value.ravel(), by) @ v
    array = np.array([*rates], object).reshape(value.shape)
    return array.view(Symbols) if value.ndim else array.item()
