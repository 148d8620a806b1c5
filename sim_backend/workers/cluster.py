"""Workers on Ray, which is imported here and nowhere else: actors that Ray puts wherever a node has a core for them.

Ray's ports run the code of whoever reaches them. What is begun here listens on loopback only; addresses elsewhere are joined
only where Ray's token authentication is on (``RAY_AUTH_MODE=token``). Usage statistics are never sent.
"""

import ipaddress
import logging
import os
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


class RayWorkers(AbstractContextManager[Workers]):
    """Owner of the actors and, for ``"local"``, of the Ray that runs them.

    Args:
        make: makes the work in each of them.
        count: of the actors, each with one core.
        address: ``"local"``, or HOST:PORT of a Ray that runs.
    """

    def __init__(self, make: MakeWork, count: int, address: str) -> None:
        self.count, self.moved_bytes = count, 0
        self.lost: list[int] = []
        self._ray = connected(address, cpus=count)
        self._actor = self._ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(_Actor)
        self._make = make
        self._actors = [self._actor.remote(make) for _ in range(count)]
        self._began = [actor.pid.remote() for actor in self._actors]

    def map(self, items: Iterable[Any], shared: Any = None) -> Iterator[Any]:
        """As :meth:`Workers.map`; ``shared`` is put into the store once."""
        ray, items, self.lost = self._ray, list(items), []
        places, kept = Places(items, self.count, self.lost), ray.put(shared)
        under_way: dict[Any, tuple[int, int]] = {}
        found: dict[int, Any] = {}
        free = list(range(self.count))
        for place in range(len(items)):
            while place not in found:
                for number in list(free):
                    if (following := places.next_of(number)) is not None:
                        free.remove(number)
                        under_way[self._actors[number].do.remote(items[following], kept)] = number, following
                ready, _ = ray.wait(list(under_way), num_returns=1)
                number, done = under_way.pop(ready[0])
                free.append(number)
                try:
                    found[done] = ray.get(ready[0])
                    places.came()
                except (ray.exceptions.RayActorError, ray.exceptions.ObjectLostError):
                    places.again(number, done, begun=self._replace(number))
            yield found.pop(place)

    def _replace(self, number: int) -> bool:
        """Begin another actor in place of one that ended; whether that one had begun to work."""
        ray, answer = self._ray, self._began[number]
        begun = bool(ray.wait([answer], timeout=0.0)[0])
        try:
            ray.get(answer, timeout=0.0)
        except (ray.exceptions.RayActorError, ray.exceptions.ObjectLostError, ray.exceptions.GetTimeoutError):
            begun = False
        self._actors[number] = self._actor.remote(self._make)
        self._began[number] = self._actors[number].pid.remote()
        return begun

    def __exit__(self, *_: object) -> None:
        """End the actors, and the Ray that was begun for them."""
        for actor in self._actors:
            self._ray.kill(actor)
        self._ray.shutdown()


class _Actor:
    """The work in an actor."""

    def __init__(self, make: MakeWork) -> None:
        self._work = make()

    def do(self, item: Any, shared: Any) -> Any:
        """The result of one item."""
        return self._work(item, shared)

    def pid(self) -> int:
        """Of the actor's process."""
        return os.getpid()


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
    """What a cluster is made of: nodes, cores, memory of its store, and whether it asks for a token.

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
        "token": os.environ[_TOKEN] == "token",
        "nodes": nodes,
        "cpus": sum(node["cpus"] for node in alive),
        "free_cpus": free,
    }
