"""The search of a report: cheap parts first, until it has as many integrals as orbits show.

It finds the degrees of iterates on random lines (`growth`), the number of integrals that relations
along orbits show (`relations`), the polynomials with the cofactors 1 and det DPhi, and then with
all products of factors of the map (`darboux`), with the integrals and measures that follow from
them and are checked as identities (`invariants`).
"""

import math
import pickle
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

from . import arithmetic
from .functions import RationalFunction, independent
from .growth import degrees_on_a_line, growth
from .invariants import Invariants
from .maps import RationalMap
from .relations import counts, integrals_of

_FEW = 80  # coefficients, at most, of a polynomial of higher degree than that of the report
_ENOUGH, _DEGREES = 10, 24  # iterates: enough if a recurrence holds, and at most
_SMALL, _LARGE, _LARGEST = 100, 3_000, 8_000  # degrees: cheap; costly; too costly

_START = "import sys; sys.path[:] = {}; from suslov_fast.integrability.search import serve; serve()"


def search(found: Any, seed: int) -> Iterator[Any]:
    """Fill a `Report`, and yield it after each part."""
    invariants, done = Invariants(found.map), {}
    for kind, text in _parts(found, invariants, seed):
        done[kind] = text
        found.searched = [*done.values()]
        found.integrals = independent(invariants.integrals)
        found.measures = tuple(invariants.measures)
        found.polynomials = tuple(invariants.polynomials)
        if found.map.has_letter:
            formulas = [*found.integrals, *found.measures, *found.polynomials]
            special = {eps for f in formulas for eps in f.special}
            found.special_eps = tuple(sorted(special.union(found.map.degenerate_eps)))
        yield found
    found.finished = True
    yield found


def _is_complete(found: Any) -> bool:
    """Return True if the integrals are as many as the relations show, and there is a measure."""
    return bool(found.relations and found.measures) and len(found.integrals) >= found.relations


def _parts(found: Any, invariants: Invariants, seed: int) -> Iterator[tuple[str, str]]:
    """Search part by part, and yield the kind and the description of each part."""
    map, d, D = found.map, found.degree, found.map.dimension
    found.degrees = _degrees(map, seed)
    yield "degrees", f"degrees of {len(found.degrees)} iterates"
    if not map.is_invertible:
        yield "end", "nothing else: the map has no inverse, since det DPhi = 0"
        return
    if (H := getattr(map, "hamiltonian", None)) is not None:
        invariants.add_hamiltonian(H)
        yield "hamiltonian", "the modified energy and 1/det A of the Hamiltonian"
    for k in range(1, d + 1):
        exponents = arithmetic.exponents_up_to(k, D)
        found.relations = counts(map, exponents, seed)[1]
        if len(found.integrals) < found.relations:
            invariants.add(integrals_of(map, exponents, seed))
        yield "relations", f"relations between the {len(exponents)} monomials up to degree {k}"
    if not _is_complete(found):
        for cofactor in (RationalFunction(()), None):
            invariants.of_cofactor(cofactor, d)
        yield "simple", f"polynomials up to degree {d} with the cofactors 1 and det DPhi"
    if map.factors is None:
        yield "end", "no other Darboux polynomials, since det DPhi is too long"
        return
    cofactors = "products of powers of the factors of det DPhi as cofactors"
    for k in range(1, 2 * d + 1):
        unknowns, highest = math.comb(D + k, D), max((f.degree for f in found.integrals), default=0)
        if _is_complete(found) and (k >= highest or unknowns > _FEW):
            yield "end", "no more, since as many integrals as relations show are known"
            return
        # Integrals with irrational coefficients have rational norms, of a higher degree.
        if k > d and (unknowns > _FEW or len(found.integrals) >= found.relations):
            return
        invariants.of_degree(k)
        yield "all", f"Darboux polynomials up to degree {k} with {cofactors}"


def _degrees(map: RationalMap, seed: int) -> list[int]:
    """Return degrees of iterates, as many as a recurrence needs, and more if they cost little."""

    def compute(p: int, eps: int) -> list[int]:
        found: list[int] = []
        for each in degrees_on_a_line(map, p, eps):
            found.append(each)
            following = each**2 / max(1, found[-2:][0])
            settled = (len(found) >= _ENOUGH and each > _SMALL) or following > _LARGE
            if settled and growth(found).entropy_error == 0:
                break
            if following > _LARGEST or len(found) == _DEGREES:
                break
        return found

    return list(arithmetic.confirmed(random.Random(seed), compute))


def search_until(deadline: float, found: Any, seed: int) -> Iterator[Any]:
    """Yield what `search` yields, until `time.monotonic()` reaches the deadline.

    It runs in another process, since python-flint cannot be interrupted.
    """
    pipe, command = subprocess.PIPE, [sys.executable, "-c", _START.format(sys.path)]
    process: Any = subprocess.Popen(command, stdin=pipe, stdout=pipe)
    left = min(deadline - time.monotonic(), threading.TIMEOUT_MAX)
    timer = threading.Timer(left, process.kill)
    with process:
        try:
            timer.start()
            with process.stdin:
                pickle.dump((found, seed), process.stdin)
            while not found.finished:
                found = pickle.load(process.stdout)
                if isinstance(found, Exception):
                    raise found
                yield found
        except (EOFError, BrokenPipeError, pickle.UnpicklingError):
            if time.monotonic() < deadline:
                raise RuntimeError("the process of the search ended") from None
        finally:
            timer.cancel()
            process.kill()


def serve() -> None:
    """Run the search with arguments from stdin, and write what it yields to stdout."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that waits
    out = sys.stdout.buffer
    try:
        for found in search(*pickle.load(sys.stdin.buffer)):
            pickle.dump(found, out)
            out.flush()
    except Exception as error:
        pickle.dump(error, out)
