"""The seam of every fan-out: the same work in the calling process, in processes of this machine, or on a Ray cluster.

    with open_workers(Square, 2) as workers:
        assert list(workers.map(range(4))) == [0, 1, 4, 9]

``Square`` is called once in each worker and makes what does the work there, which is then called with each item::

    class Square:
        def __call__(self, item, shared=None):
            return item * item

What must hold of it: an item's result depends on nothing but the item and ``shared``, since any worker may get it, and gets it
again when the worker before was lost. Then the results are the same for any number of workers, wherever they are.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Any, Protocol

Work = Callable[[Any, Any], Any]
"""What a worker does: from an item and what all items of a call share to the item's result. All three are pickled."""
MakeWork = Callable[[], Work]
"""Makes the work in each worker: a class or function of a module, or a ``functools.partial`` of one."""
MOST_LOSSES = 5
"""An item that ended so many workers is not given to another, and no worker is begun after so many starts in vain in a row."""


class WorkersError(RuntimeError):
    """The workers cannot be had, or an item ended every worker that it was given to; the message says what to do."""


class Workers(Protocol):
    """Workers that are open."""

    count: int
    lost: list[int]
    """Places of the items whose workers were lost, an entry for each loss, since the last call of :meth:`map`."""
    moved_bytes: int
    """That went to the workers and back so far, memory that is shared left out."""

    def map(self, items: Iterable[Any], shared: Any = None) -> Iterator[Any]:
        """Results in the order of the items; each worker has one item at a time, and goes on with the next that nobody has.

        Items go to the worker of their place first (item k to worker k modulo ``count``), so that what a worker keeps of an
        earlier call is of use; a worker without one of its own takes another's.

        Raises:
            WorkersError: an item ended ``MOST_LOSSES`` workers, or so many in a row ended before they began.
            Exception: whatever the work raised.
        """
        ...


def open_workers(make: MakeWork, count: int = 0, cluster: str | None = None) -> AbstractContextManager[Workers]:
    """Workers for the time of a ``with``.

    Args:
        make: makes the work in each of them.
        count: of the workers; 0 works in the calling process, one item after the other.
        cluster: None for processes of this machine; ``"local"`` for a Ray that is begun on this machine and ends with the
            ``with``; or the address of a Ray that runs (``docs/cluster.md``).

    Raises:
        WorkersError: Ray is not installed, cannot be reached, or has fewer cores than workers were asked for.
    """
    if cluster is not None:
        from sim_backend.workers.cluster import RayWorkers

        return RayWorkers(make, max(count, 1), cluster)
    if count:
        from sim_backend.workers.processes import ProcessWorkers

        return ProcessWorkers(make, count)
    return HereWorkers(make)


def map(make: MakeWork, items: Iterable[Any], *, workers: int = 0, cluster: str | None = None, shared: Any = None) -> list[Any]:
    """Results in the order of the items, by workers that are opened for this call; arguments as for :func:`open_workers`."""
    with open_workers(make, workers, cluster) as opened:
        return list(opened.map(items, shared))


class HereWorkers(AbstractContextManager[Workers]):
    """The calling process."""

    def __init__(self, make: MakeWork) -> None:
        self.count, self.moved_bytes = 1, 0
        self.lost: list[int] = []
        self._work = make()

    def map(self, items: Iterable[Any], shared: Any = None) -> Iterator[Any]:
        """As :meth:`Workers.map`."""
        for item in items:
            yield self._work(item, shared)

    def __exit__(self, *_: object) -> None:
        """Nothing is open."""


class Places:
    """Which items wait, whose they are first, and how often each ended its worker."""

    def __init__(self, items: Sequence[Any], workers: int, lost: list[int]) -> None:
        self._waiting = [list(range(worker, len(items), workers)) for worker in range(workers)]
        self._lost, self._ended, self._failed_starts = lost, Counter[int](), 0

    def next_of(self, worker: int) -> int | None:
        """The next item of a worker, or of the one who has most left; None when all have been given out."""
        if self._waiting[worker]:
            return self._waiting[worker].pop(0)
        most = max(self._waiting, key=len)
        return most.pop() if most else None

    def came(self) -> None:
        """Of a result: workers can be begun."""
        self._failed_starts = 0

    def again(self, worker: int, place: int, *, begun: bool) -> None:
        """Give an item out again, first of all, whose worker ended; the item is not to blame if that had not begun with any.

        Raises:
            WorkersError: it ended too many workers, or too many ended before they began.
        """
        self._lost.append(place)
        self._waiting[worker].insert(0, place)
        if not begun:
            self.not_begun()
            return
        self._failed_starts = 0
        self._ended[place] += 1
        if self._ended[place] >= MOST_LOSSES:
            raise WorkersError(f"item {place} ended {MOST_LOSSES} workers, one after the other; look at what it does to them")

    def not_begun(self) -> None:
        """Of a worker that ended before it began.

        Raises:
            WorkersError: too many did, one after the other.
        """
        self._failed_starts += 1
        if self._failed_starts >= MOST_LOSSES:
            raise WorkersError(f"{MOST_LOSSES} workers in a row ended before they began; see that memory is enough for so many")
