"""A Ray of two cores that loses its nodes one after the other: ``python -m tests.unit.sim_backend.workers.lost_nodes``.

A program of its own, since Ray reads its settings once in a process. Prints what came of it, as JSON.
"""

import json

from ray.cluster_utils import Cluster  # of the extra, which need not be installed

from sim_backend.workers import cluster
from sim_backend.workers.pool import WorkersError, open_workers
from tests.unit.sim_backend.workers.works import SlowSquare, Square

NODE = {"object_store_memory": 128 * 2**20, "node_ip_address": "127.0.0.1"}
ITEMS = 12


def refused(address: str) -> str:
    """What three workers on two cores are told."""
    try:
        with open_workers(Square, 3, address):
            return "not refused"
    except WorkersError as error:
        return str(error)


def main() -> None:
    """See the module's docstring."""
    ray = Cluster(initialize_head=True, head_node_args=NODE | {"num_cpus": 0, "include_dashboard": False})
    nodes = [ray.add_node(num_cpus=1, **NODE) for _ in range(2)]
    found = {"three": refused(str(ray.address))}
    with open_workers(SlowSquare, 2, str(ray.address)) as workers:
        results = workers.map(range(ITEMS))
        squares = [next(results)]
        ray.remove_node(nodes[0], allow_graceful=False)
        found |= {"squares": squares + list(results), "lost": len(workers.lost)}
        ray.remove_node(nodes[1], allow_graceful=False)
        cluster.PLACED_WITHIN_S = 2.0
        try:
            found["none"] = str(list(workers.map(range(ITEMS))))
        except WorkersError as error:
            found["none"] = str(error)
    print(json.dumps(found))
    ray.shutdown()


if __name__ == "__main__":
    main()
