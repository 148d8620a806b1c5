"""Workers in processes of this machine; one that ends is replaced, and what it had is done again."""

import multiprocessing
import os
import pickle
import threading
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, suppress
from multiprocessing.connection import Connection, wait
from typing import Any

from sim_backend.workers.pool import MakeWork, Places, Workers, WorkersError

_END_WITHIN_S = 5.0
BEGUN = b""
"""What a worker says once it has made what does the work; no answer is so short."""


class ProcessWorkers(AbstractContextManager[Workers]):
    """Owner of the processes. They are forked from one that has imported what the work needs, so that the next comes quickly.

    Args:
        make: makes the work in each of them.
        count: of the processes.
    """

    def __init__(self, make: MakeWork, count: int) -> None:
        self.count, self.moved_bytes = count, 0
        self.lost: list[int] = []
        self._make = make
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload([getattr(getattr(make, "func", make), "__module__", __name__)])
        self._workers = [_Worker(self._context, make) for _ in range(count)]

    @property
    def pids(self) -> list[int | None]:
        """Of the processes now."""
        return [worker.process.pid for worker in self._workers]

    def map(self, items: Iterable[Any], shared: Any = None) -> Iterator[Any]:
        """As :meth:`Workers.map`."""
        items, self.lost = list(items), []
        places, shared_bytes = Places(items, self.count, self.lost), pickle.dumps(shared, protocol=5)
        has: list[int | None] = [None] * self.count
        found: dict[int, Any] = {}
        for place in range(len(items)):
            while place not in found:
                for number in range(self.count):
                    if has[number] is None and (following := places.next_of(number)) is not None:
                        has[number] = following
                        self._give(number, items[following], shared_bytes)
                for number in self._ready(has):
                    answer = self._take(number)
                    if answer == BEGUN:
                        continue
                    done, has[number] = has[number], None
                    assert done is not None
                    if answer is None:
                        places.again(number, done, begun=self._replace(number))
                    else:
                        places.came()
                        found[done] = self._result(answer)
            yield found.pop(place)

    def _give(self, number: int, item: Any, shared: bytes) -> None:
        with suppress(OSError):  # it ended: seen when its result is waited for
            self.moved_bytes += self._workers[number].give(item, shared)

    def _ready(self, has: list[int | None]) -> list[int]:
        busy = {worker.pipe: number for number, worker in enumerate(self._workers) if has[number] is not None}
        return sorted(busy[pipe] for pipe in wait(list(busy)) if isinstance(pipe, Connection))

    def _take(self, number: int) -> bytes | None:
        """What a worker says, None if it ended instead."""
        worker = self._workers[number]
        try:
            answer = worker.pipe.recv_bytes()
        except (EOFError, OSError):
            return None
        worker.begun = worker.begun or answer == BEGUN
        self.moved_bytes += len(answer)
        return answer

    def _replace(self, number: int) -> bool:
        """Begin another worker in place of one that ended; whether that one had begun to work."""
        begun = self._workers[number].begun
        self._workers[number].end()
        self._workers[number] = _Worker(self._context, self._make)
        return begun

    def _result(self, answer: bytes) -> Any:
        failed, result = pickle.loads(answer)  # noqa: S301 - of our own child
        if failed:
            raise result
        return result

    def __exit__(self, *_: object) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.pipe.close()
        for worker in self._workers:
            worker.end()


class _Worker:
    """A process and our end of its pipe; ``shared`` goes to it when it is another than the last."""

    def __init__(self, context: Any, make: MakeWork) -> None:
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, make), daemon=True)
        try:
            self.process.start()
        except OSError as error:
            raise WorkersError(f"no process for a worker can be begun: {error}; ask for fewer") from error
        theirs.close()
        self._shared: bytes | None = None
        self.begun = False

    def give(self, item: Any, shared: bytes) -> int:
        fresh = b"" if shared == self._shared else shared
        message = pickle.dumps((item, bool(fresh)), protocol=5)
        self.pipe.send_bytes(message)
        if fresh:
            self.pipe.send_bytes(fresh)
            self._shared = shared
        return len(message) + len(fresh)

    def end(self) -> None:
        self.pipe.close()
        self.process.join(0.0 if self.process.exitcode is not None else _END_WITHIN_S)
        if self.process.exitcode is None:
            self.process.kill()
            self.process.join()


def _serve(pipe: Connection, make: MakeWork) -> None:
    """A worker's life: it ends when the other end of the pipe is closed, and at once when whoever held it dies."""
    import signal

    threading.Thread(target=_end_with_parent, daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for those who gave the work
    work, shared = make(), None
    with suppress(EOFError, OSError):
        pipe.send_bytes(BEGUN)
        while True:
            item, fresh = pickle.loads(pipe.recv_bytes())  # noqa: S301 - of our own parent
            if fresh:
                shared = pickle.loads(pipe.recv_bytes())  # noqa: S301
            try:
                answer: tuple[bool, Any] = False, work(item, shared)
            except Exception as error:
                answer = True, error
            pipe.send_bytes(pickle.dumps(answer, protocol=5))


def _end_with_parent() -> None:
    """Ends this process, whatever it does, when its parent has ended: nobody would look at what it has in hand."""
    parent = multiprocessing.parent_process()
    assert parent is not None, "a worker is somebody's child"
    parent.join()
    os._exit(1)
