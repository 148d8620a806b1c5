"""Workers on Ray, which is imported here and nowhere else: actors that Ray puts wherever a node has a core for them.

Ray's ports run the code of whoever reaches them. What is begun here listens on loopback only; addresses elsewhere are joined
only where Ray's token authentication is on at this side (``RAY_AUTH_MODE=token``). Whether it is on there, too, is not seen from
here: a Ray without it takes whoever sends a token as well. Usage statistics are never sent.
"""

import ipaddress
import logging
import os
import pickle
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager
from typing import Any

from sim_backend.extras import how_to_install
from sim_backend.workers.pool import MakeWork, Places, Workers, WorkersError

LOCAL = "local"
_ENVIRONMENT = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}
_LOOPBACK = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}
"""Ray's own switch for nodes that have only 127.0.0.1; without it 127.0.0.1 is replaced by the machine's address."""
_TOKEN = "RAY_AUTH_MODE"  # noqa: S105 - the name of a setting
OBJECT_STORE_BYTES = 512 * 2**20
PLACED_WITHIN_S = 180.0
"""Where no worker has begun for so long none will: on a busy machine one took more than 30 s (decision 43)."""


class RayWorkers(AbstractContextManager[Workers]):
    """Owner of the actors and, for ``"local"``, of the Ray that runs them.

    Actors that Ray cannot place yet have no items: those that have begun do the work meanwhile, however few they are.

    Args:
        make: makes the work in each of them.
        count: of the actors, each with one core.
        address: ``"local"``, or HOST:PORT of a Ray that runs.

    Raises:
        WorkersError: as for :func:`connected`, or the Ray has fewer cores than that.
    """

    def __init__(self, make: MakeWork, count: int, address: str) -> None:
        self.count, self.moved_bytes = count, 0
        self.lost: list[int] = []
        self._ray = connected(address, cpus=count)
        if (cores := self._cores()) < count:
            self._ray.shutdown()
            raise WorkersError(
                f"{count} workers were asked for, which need a core each, and the Ray at {address} has {cores}: ask for "
                f"fewer, or add nodes (docs/cluster.md)"
            )
        self._actor = self._ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(_Actor)
        self._make = make
        self._actors: dict[int, Any] = {}
        self._begins: dict[Any, int] = {}  # those of which nothing was heard yet, by what will be heard first
        self._node_of: dict[int, str] = {}  # those that have begun
        for number in range(count):
            self._begin(number)

    def _cores(self) -> int:
        """How many workers there is room for, whoever has the cores now."""
        return sum(int(node["Resources"].get("CPU", 0.0)) for node in self._ray.nodes() if node["Alive"])

    def _begin(self, number: int) -> None:
        """Ask Ray for an actor, in place of the one that had the number before."""
        self._node_of.pop(number, None)
        self._actors[number] = self._actor.remote(self._make)
        self._begins[self._actors[number].node.remote()] = number

    def map(self, items: Iterable[Any], shared: Any = None) -> Iterator[Any]:
        """As :meth:`Workers.map`; ``shared`` is put into the store once, and goes to each node once.

        Raises:
            WorkersError: as there, or no actor could be placed for ``PLACED_WITHIN_S`` while none had work.
        """
        ray, items, self.lost = self._ray, list(items), []
        places, kept = Places(items, self.count, self.lost), _Shared(ray, shared)
        under_way: dict[Any, tuple[int, int]] = {}
        found: dict[int, Any] = {}
        for place in range(len(items)):
            while place not in found:
                busy = {number for number, _ in under_way.values()}
                for number in sorted(self._node_of.keys() - busy):
                    if (following := places.next_of(number)) is not None:
                        under_way[self._give(number, items[following], kept)] = number, following
                answer = self._next_answer(list(under_way))
                if answer in self._begins:
                    self._has_begun(answer, places)
                    continue
                number, done = under_way.pop(answer)
                try:
                    result = ray.get(answer)
                except (ray.exceptions.RayActorError, ray.exceptions.ObjectLostError):
                    self._begin(number)
                    places.again(number, done, begun=True)
                else:
                    places.came()
                    self.moved_bytes += size_of(result)
                    found[done] = result
            yield found.pop(place)

    def _give(self, number: int, item: Any, shared: "_Shared") -> Any:
        """Hand an item to an actor; what its result will be known by."""
        self.moved_bytes += size_of(item) + shared.bytes_to(self._node_of[number])
        return self._actors[number].do.remote(item, shared.kept)

    def _next_answer(self, under_way: list[Any]) -> Any:
        """What comes first: a result, or the first word of an actor."""
        limit_s = None if under_way else PLACED_WITHIN_S
        ready, _ = self._ray.wait([*under_way, *self._begins], num_returns=1, timeout=limit_s)
        if not ready:
            free = self._ray.available_resources().get("CPU", 0.0)
            raise WorkersError(
                f"Ray could place none of the {self.count} workers for {PLACED_WITHIN_S:g} s: of {self._cores()} cores {free:g} "
                "are free; add nodes, or end what has the cores (trifarm cluster status)"
            )
        return ready[0]

    def _has_begun(self, answer: Any, places: Places) -> None:
        """An actor said its first word, or ended before."""
        number = self._begins.pop(answer)
        try:
            self._node_of[number] = self._ray.get(answer)
        except (self._ray.exceptions.RayActorError, self._ray.exceptions.ObjectLostError):
            self._begin(number)
            places.not_begun()

    def __exit__(self, *_: object) -> None:
        """End the actors, and the Ray that was begun for them."""
        for actor in self._actors.values():
            self._ray.kill(actor)
        self._ray.shutdown()


class _Shared:
    """What all items of a call share, in Ray's store. Owner of which nodes have it already."""

    def __init__(self, ray: Any, value: Any) -> None:
        self.kept = ray.put(value)
        self._bytes, self._nodes = size_of(value), set[str]()

    def bytes_to(self, node: str) -> int:
        """That go to a node now, where it stays for all who are there."""
        fresh = node not in self._nodes
        self._nodes.add(node)
        return self._bytes if fresh else 0


def size_of(value: Any) -> int:
    """Bytes that a value is when it is sent, its arrays counted where they lie and not copied."""
    arrays: list[pickle.PickleBuffer] = []
    rest = pickle.dumps(value, protocol=5, buffer_callback=arrays.append)
    return len(rest) + sum(array.raw().nbytes for array in arrays)


class _Actor:
    """The work in an actor."""

    def __init__(self, make: MakeWork) -> None:
        self._work = make()

    def do(self, item: Any, shared: Any) -> Any:
        """The result of one item."""
        return self._work(item, shared)

    def node(self) -> str:
        """Where it is."""
        import ray

        return ray.get_runtime_context().get_node_id()


def connected(address: str, cpus: int = 0) -> Any:
    """The module ``ray``, connected.

    Raises:
        WorkersError: it is not installed, nothing answers there, or what is there lets anyone in.
    """
    beyond = not is_loopback(address)
    if beyond and os.environ.get(_TOKEN) != "token":
        raise WorkersError(
            f"{address} is no address of this machine, and Ray runs the code of whoever reaches its ports: set {_TOKEN}=token "
            "on all nodes and here, with the same token in ~/.ray/auth_token (docs/cluster.md)"
        )
    os.environ.update(_ENVIRONMENT if beyond else {**_ENVIRONMENT, **_LOOPBACK})
    os.environ.setdefault(_TOKEN, "token")
    try:
        import ray  # of the extra, which need not be installed
    except ImportError:
        raise WorkersError(f"a cluster needs Ray, which is not installed: {how_to_install('cluster')}") from None
    asked: dict[str, Any] = {"address": address}
    if address == LOCAL:
        asked |= {"num_cpus": cpus, "include_dashboard": False, "object_store_memory": OBJECT_STORE_BYTES}
    try:
        ray.init(**asked, log_to_driver=False, logging_level=logging.ERROR, configure_logging=False)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise WorkersError(f"no Ray can be used at {address}: {error}; begin one with 'ray start' (docs/cluster.md)") from error
    return ray


def is_loopback(address: str) -> bool:
    """Whether an address, HOST:PORT or ``"local"``, is one of this machine alone."""
    host = address.rpartition(":")[0].strip("[]") or address
    try:
        return host in (LOCAL, "localhost") or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def status(address: str) -> dict[str, Any]:
    """What a cluster is made of: nodes, cores, memory of its store; and whether a token goes to it, which it need not ask for.

    Raises:
        WorkersError: as for :func:`connected`.
    """
    ray = connected(address)
    try:
        nodes = [
            {
                "address": node["NodeManagerAddress"],
                "alive": node["Alive"],
                "cpus": node["Resources"].get("CPU", 0.0),
                "object_store_bytes": node["Resources"].get("object_store_memory", 0.0),
            }
            for node in ray.nodes()
        ]
        free = ray.available_resources().get("CPU", 0.0)
    finally:
        ray.shutdown()
    alive = [node for node in nodes if node["alive"]]
    return {
        "address": address,
        "ray": ray.__version__,
        "sends_token": os.environ[_TOKEN] == "token",
        "nodes": nodes,
        "cpus": sum(node["cpus"] for node in alive),
        "free_cpus": free,
    }
