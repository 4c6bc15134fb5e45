"""Equilibria near given states, of any field: Newton's method, and SciPy's where it is not enough.

Steps of least norm solve f' d = -f, with rows of f' scaled to 1, so that neither the units of rates
nor a curve of equilibria matter, and in units of the given states where f' is not singular then.
They are accepted as long as each is much shorter than the one before, as near a regular
equilibrium; at a fold each is half as long.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.base import Body
from ..bodies.classes import BodyOrField
from ..bodies.fields.field_of_terms import FieldOfFunction
from ..checks import FloatArray, common_shape, first_index, instance, spell, states, warn
from ..engine.status import Status
from ..keywords import public

_MOST = 30  # steps of Newton's method
_SHORTER, _FARTHEST = 0.25, 2.0  # a step beside the one before, and beside the state, at most
_ROUNDING, _SMALL = 1e-14, 1e-8  # last steps beside the state: the end, and with nothing to gain
_LEAST = 1e-6  # sizes of components beside the largest one, at least
_RANK = 1e-12  # singular values of the scaled f' beside the largest one, below which they are 0
_WHOLE = 1e-8  # and above which f' is not singular, in units of the given states
_PROBE = 1e-6  # how far from an equilibrium, beside the state, Newton's method must lead back


class Equilibria(NamedTuple):
    """Equilibria near given states, from :func:`fixed_points`.

    Attributes
    ----------
    states : ndarray(float, shape=(..., D))
        The equilibria, NaN where none is found.
    eigenvalues : ndarray(complex, shape=(..., k))
        Eigenvalues of f', by decreasing real part; in conjugate pairs Im > 0 comes first. k is D
        without the variables of a constant rate. An equilibrium is stable if all real parts are
        negative, and unstable if one is positive.
    status : ndarray(int, shape=(...))
        The :class:`Status`: `OK`, `DEGENERATE`, `NOT_FOUND` or `NONFINITE`.
    """

    states: FloatArray
    eigenvalues: NDArray[np.complex128]
    status: NDArray[np.int8]


@public
def fixed_points(system: BodyOrField, /, near: ArrayLike) -> Equilibria:
    """Equilibria near given states.

    They are found by Newton's method for f(x) = 0 with the exact f', from all states at
    once; members of a family may go to different equilibria: to follow one, pass the last one found
    as `near` of the next. A body without a rotor has a line of them, of which it is the nearest
    one. The fixed points of Kahan's map are the same for every step size, because
    (1 - (eps / 2) f'(x)) (x_next - x) = eps f(x).

    Parameters
    ----------
    system : QuadraticField, Field or a body
        A single one, or a batch.
    near : array_like(float, shape=(..., D))
        States near equilibria, which broadcast with the batch. NaN gives NaN.

    Returns
    -------
    Equilibria
        A named tuple of `states` (..., D), `eigenvalues` of f' (..., k) by decreasing
        real part, and `status` (...), a :class:`Status`: the equilibrium of each state. Variables
        with a constant rate, such as time, keep the value that they have in `near`, and count
        neither in the condition nor in the eigenvalues. On a curve of equilibria a point near the
        given one is found. If Newton's method does not converge at once, shorter steps begin, and
        then ``scipy.optimize.root``, by its methods "hybr" and "lm"; what they find may be far.
        NaN, with a negative status, for a state from which none is found, and where one is
        degenerate, as at a fold.

    Warns
    -----
    UserWarning
        Once for all states without an equilibrium.

    Examples
    --------
    A pendulum with friction and a torque, for three torques:

    >>> import numpy as np
    >>> from suslov_fast import Field, fixed_points
    >>> pendulum = Field.from_function(
    ...     lambda x, m: (x[1], m - np.sin(x[0]) - 0.1 * x[1]), "q p", m=[0.0, 0.3, 0.6]
    ... )
    >>> found = fixed_points(pendulum, near=[0.1, 0.0])
    >>> found.states[:, 0].round(6)
    array([0.      , 0.304693, 0.643501])
    >>> found.eigenvalues.real.max(axis=-1).round(6)
    array([-0.05, -0.05, -0.05])
    """
    instance("system", system, Body)
    given = states("near", near, system.labels)
    field = system if isinstance(system, FieldOfFunction) else system.field()
    D, batch = field.dimension, common_shape({"system": field.shape, "near": given.shape[:-1]})
    steady = [np.isin(np.arange(D), f.steady) for _, f, _ in field.listed_right_hand_sides]
    own = ~np.logical_and.reduce(steady) if steady else np.ones(D, bool)
    members = np.broadcast_to(np.arange(int(np.prod(field.shape))).reshape(field.shape), batch)
    x = np.array(np.broadcast_to(given, (*batch, D)))

    def member(index: Any) -> Any:
        return field[np.unravel_index(members[index], field.shape)] if field.shape else field

    with np.errstate(all="ignore"):
        if has_line := system.steady_line is not None:
            x = _on_line(system.steady_line, x)
        has_value = np.isfinite(field(x)).all(axis=-1) & np.isfinite(x).all(axis=-1)
        sizes = _sizes_of(x)
        units = np.where(x == 0.0, sizes, abs(x))
        found, is_found = (x, has_value) if has_line else _newton(field, x, own, sizes, units)
        if not is_found.all():
            closer = _damped(
                field, np.where(is_found[..., np.newaxis], np.nan, x), own, sizes, units
            )
            others, too = _newton(field, closer, own, sizes, units)
            found = np.where(too[..., np.newaxis], others, found)
            is_found = np.array(is_found | too)
        for index in map(tuple, np.argwhere(has_value & ~is_found)):
            found[index], is_found[index] = _by_scipy(
                member(index), x[index], own, sizes[index], units[index]
            )
        is_regular = np.array(
            is_found if has_line else is_found & _leads_back(field, found, own, sizes, units)
        )
        is_degenerate = (is_found | _is_small(field, found, own, units)) & ~is_regular
        slopes = field.jacobian(np.where(is_regular[..., np.newaxis], found, np.nan))
    status = np.select(
        [is_regular, ~has_value, is_degenerate],
        [Status.OK, Status.NONFINITE, Status.DEGENERATE],
        Status.NOT_FOUND,
    ).astype(np.int8)
    if (failed := (status < 0) & ~np.isnan(x).any(axis=-1)).any():
        index = first_index(failed)
        where = f" (first: start {spell(index)}{_named(field, members[index])})" if batch else ""
        why = Status(status[index]).message
        warn(f"fixed_points: {failed.sum()} of {failed.size} starts have no result{where}: {why}")
    values = _eigenvalues(slopes[..., own, :][..., own])
    return Equilibria(np.where(is_regular[..., np.newaxis], found, np.nan), values, status)


def _on_line(direction: FloatArray, x: FloatArray) -> FloatArray:
    """Return the nearest states on lines through 0, of steady states.

    Newton's method halves states there, because f is homogeneous.
    """
    square = np.asarray((direction**2).sum(axis=-1, keepdims=True))
    along = (x * direction).sum(axis=-1, keepdims=True) / np.where(square > 0, square, 1.0)
    return np.where(square > 0, along * direction, x)  # without a direction all are steady


def _named(field: Any, member: Any) -> str:
    """Return the member of a family for messages."""
    index = tuple(map(int, np.unravel_index(member, field.shape))) if field.shape else ()
    return str(field.of_member(index if len(index) > 1 else index[0])) if index else ""


def _sizes_of(x: FloatArray) -> FloatArray:
    """Return the sizes of the components of states, no one far smaller than the largest."""
    largest = abs(x).max(axis=-1, keepdims=True)
    return np.maximum(abs(x), np.where(largest > 0, _LEAST * largest, 1.0))


def _step(field: Any, x: FloatArray, own: Any, units: FloatArray) -> tuple[Any, Any, Any, Any]:
    """Return the step (..., D) of Newton's method, f (..., k) by its scale, and the step's matrix.

    The matrix (..., k, k) times f is the step. `units` are sizes of the components. The last result
    is whether f' is not singular in these units.
    """
    f, slopes = field(x)[..., own], field.jacobian(x)[..., own, :][..., own]
    sizes = abs(slopes).max(axis=-1, initial=0.0)
    sizes = np.where(sizes > 0, sizes, 1.0)
    known = np.isfinite(f).all(axis=-1) & np.isfinite(slopes).all(axis=(-2, -1))
    scaled = np.where(known[..., np.newaxis, np.newaxis], slopes / sizes[..., np.newaxis], 0.0)
    units = units[..., np.newaxis, own]
    inner = scaled * units
    inner = np.where(np.isfinite(inner), inner, 0.0)
    rows = abs(inner).max(axis=-1, keepdims=True, initial=0.0)
    values = np.linalg.svd(inner / np.where(rows > 0, rows, 1.0), compute_uv=False)
    is_whole = values.min(axis=-1, initial=np.inf) > _WHOLE * values.max(axis=-1, initial=0.0)
    is_whole &= (rows > 0).all(axis=(-2, -1))
    kept = is_whole[..., np.newaxis, np.newaxis]
    units, rows = np.where(kept, units, 1.0), np.where(kept, rows, 1.0)
    inverse: Any = -np.linalg.pinv(scaled * units / rows, rcond=_RANK)
    inverse *= np.swapaxes(units, -2, -1) / np.swapaxes(rows * sizes[..., np.newaxis], -2, -1)
    step = _whole(inverse, np.where(known[..., np.newaxis], f, np.nan), own)
    return step, f / sizes, inverse, is_whole


def _whole(inverse: FloatArray, f: FloatArray, own: Any) -> FloatArray:
    """Return the product of a matrix and f, with 0 for variables that stay."""
    step = np.zeros((*f.shape[:-1], len(own)))
    step[..., own] = (inverse @ f[..., np.newaxis])[..., 0]
    return step


def _length(step: FloatArray, scale: FloatArray) -> FloatArray:
    length: FloatArray = abs(step / scale).max(axis=-1)
    return length


def _newton(
    field: Any, x: FloatArray, own: Any, sizes: FloatArray, units: FloatArray
) -> tuple[Any, Any]:
    """Return states to which Newton's method converges at once, and where it does.

    `sizes` are those of the components, beside which steps are measured.
    """
    x = x.copy()
    before, going = np.full(x.shape[:-1], np.inf), np.isfinite(x).all(axis=-1)
    is_found = np.zeros(x.shape[:-1], bool)
    for _ in range(_MOST):
        step, f, *_ = _step(field, x, own, units)
        scale = np.maximum(sizes, abs(x))
        length, size = _length(step, scale), scale.max(axis=-1, keepdims=True)
        solved = (abs(f) <= _SMALL * size).all(axis=-1)
        going &= length <= _FARTHEST
        is_last = (length <= _ROUNDING) | ((before <= _SMALL) & (length > _SHORTER * before))
        is_found |= going & is_last & solved
        going &= ~is_last & (length <= _SHORTER * before)
        moves = going | (is_found & (length <= before))
        x = np.where(moves[..., np.newaxis], x + step, x)
        before = length
        if not going.any():
            break
    return x, is_found


def _damped(
    field: Any, x: FloatArray, own: Any, sizes: FloatArray, units: FloatArray
) -> FloatArray:
    """Return states after parts of Newton's steps that make the next one shorter."""
    part = np.ones(x.shape[:-1])
    for _ in range(_MOST):
        step, _, inverse, _ = _step(field, x, own, units)
        scale = np.maximum(sizes, abs(x))
        length = _length(step, scale)
        part = np.minimum(part, _FARTHEST / length)
        moved = x + part[..., np.newaxis] * step
        after = _length(_whole(inverse, field(moved)[..., own], own), scale)
        is_shorter = after <= (1.0 - part / 4) * length
        x = np.where(is_shorter[..., np.newaxis], moved, x)
        part = np.where(is_shorter, np.minimum(1.0, 2.0 * part), part / 4)
    return x


def _by_scipy(
    field: Any, x: FloatArray, own: Any, sizes: FloatArray, units: FloatArray
) -> tuple[FloatArray, Any]:
    """Return the equilibrium that SciPy finds of a single field, and whether it is one."""
    from scipy.optimize import root  # here, because the import takes time

    def whole(y: Any) -> FloatArray:
        state = x.copy()
        state[own] = y
        return state

    last = x
    for method in ("hybr", "lm"):
        last = whole(
            root(
                lambda y: field(whole(y))[own],
                x[own],
                jac=lambda y: field.jacobian(whole(y))[own][:, own],
                method=method,
                options={"factor": 1},  # the first step is no longer than the state
            ).x
        )
        found, is_found = _newton(field, last, own, sizes, units)
        if is_found:
            return found, True
    return last, False


def _leads_back(field: Any, x: FloatArray, own: Any, sizes: FloatArray, units: FloatArray) -> Any:
    """Return whether Newton's method leads back from beside each state.

    A component far smaller than others may be one of digits, or rounding: then none of them lead.
    """
    beside = _PROBE * np.cos(np.arange(x.shape[-1])) * own
    leads = _newton(field, x + np.maximum(sizes, abs(x)) * beside, own, sizes, units)[1]
    if not leads.all():
        small = np.where(x == 0.0, sizes, abs(x))
        leads = leads | _newton(field, x + small * beside, own, small, small)[1]
    return leads


def _is_small(field: Any, x: FloatArray, own: Any, units: FloatArray) -> Any:
    """Return whether f is nearly 0 beside what it is where x is moved in its largest component."""
    _, f, *_ = _step(field, x, own, units)
    size = abs(x).max(axis=-1, keepdims=True)
    return (abs(f) <= 1e-6 * np.where(size > 0, size, 1.0)).all(axis=-1)


def _eigenvalues(slopes: FloatArray) -> Any:
    """Return the eigenvalues, by decreasing real part."""
    known = np.asarray(np.isfinite(slopes).all(axis=(-2, -1)))[..., np.newaxis]
    values = np.linalg.eigvals(np.where(known[..., np.newaxis], slopes, 0.0)).astype(complex)
    values = np.where(known, values, complex(np.nan, np.nan))
    return np.take_along_axis(values, np.lexsort((-values.imag, -values.real), axis=-1), axis=-1)
