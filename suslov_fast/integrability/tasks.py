"""A queue of tasks, of which the cheapest runs first; it does not depend on what they find."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

LATE = 1.0  # seconds added to the costs of proofs and normal forms: searches run before them

Run = Callable[[], "Iterable[Task]"]


@dataclass(frozen=True)
class Task:
    """The search for one fact: a degree, the polynomials of a cofactor, a proof.

    `run` does the work, and returns the tasks that follow from its result. The cost is an estimate
    from the sizes of the problem, never a measured time, so that a search takes the same path on
    every machine. When all tasks of a `kind` for polynomials of a `degree` are done, the report
    lists this kind as searched up to this degree. A task that is not `needed` may be left out when
    tasks of its degree are not expected to find more.
    """

    cost: float  # in seconds on a usual machine, roughly
    run: Run
    kind: str = ""
    degree: int = 0
    needed: bool = True


class Queue:
    """Waiting tasks.

    Iteration runs them, the cheapest first, tasks of equal cost in the order in which they were
    added, and yields each task when it is done. A task that is not `needed` runs only while
    ``is_wanted(degree)`` is True; until then it is set aside.
    """

    def __init__(self, tasks: Iterable[Task], is_wanted: Callable[[int], bool]) -> None:
        self.done = 0
        self._is_wanted = is_wanted
        self._heap: list[tuple[float, int, Task]] = []
        self._aside: dict[int, list[Task]] = {}  # by degree
        self._open = Counter[tuple[str, int]]()  # tasks that are not done, by kind and degree
        self._degrees: dict[str, set[int]] = {}  # of all tasks so far, by kind
        self._pushed = 0  # number of tasks that were pushed, which orders those of equal cost
        self._add(tasks)

    def __len__(self) -> int:
        return len(self._heap) + sum(map(len, self._aside.values()))

    def __iter__(self) -> Iterator[Task]:
        while self._heap:
            _, _, task = heapq.heappop(self._heap)
            if task.needed or self._is_wanted(task.degree):
                self._add(task.run())
                self._open[task.kind, task.degree] -= 1
                self.done += 1
                yield task
            else:
                self._aside.setdefault(task.degree, []).append(task)
            self._push_wanted()

    def _push_wanted(self) -> None:
        """Push the tasks again that were set aside and are wanted now."""
        for degree in [degree for degree in self._aside if self._is_wanted(degree)]:
            for task in self._aside.pop(degree):
                self._push(task)

    def _add(self, tasks: Iterable[Task]) -> None:
        for task in tasks:
            self._open[task.kind, task.degree] += 1
            self._degrees.setdefault(task.kind, set()).add(task.degree)
            self._push(task)

    def _push(self, task: Task) -> None:
        self._pushed += 1
        heapq.heappush(self._heap, (task.cost, self._pushed, task))

    @property
    def has_set_aside(self) -> bool:
        """True if tasks are set aside."""
        return bool(self._aside)

    def finished(self) -> dict[str, int]:
        """Return, for each kind, the degree up to which all tasks are done."""
        highest: dict[str, int] = {}
        for kind, degrees in self._degrees.items():
            for degree in sorted(degrees):
                if self._open[kind, degree]:
                    break
                highest[kind] = degree
        return highest
