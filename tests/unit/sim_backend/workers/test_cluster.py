"""The seam on a Ray of this machine."""

import functools
import importlib.util
import json
import os
import pickle
import secrets
import subprocess
import sys

import numpy as np
import pytest

from sim_backend.workers.cluster import size_of, status
from sim_backend.workers.pool import WorkersError, open_workers
from tests.unit.sim_backend.workers.works import EndsOnce, Square

NO_RAY = importlib.util.find_spec("ray") is None
needs_ray = pytest.mark.skipif(NO_RAY, reason="Ray is not installed (the extra 'cluster')")


@pytest.mark.skipif(not NO_RAY, reason="Ray is installed")
def test_without_ray_a_cluster_says_what_to_install():
    with pytest.raises(WorkersError, match=r"'\.\[cluster\]'"):
        status("127.0.0.1:6379")


@needs_ray
@pytest.mark.filterwarnings("default")  # Ray's own
def test_ray_gives_the_same_results_and_replaces_lost_workers(tmp_path):
    with open_workers(Square, 2, "local") as workers:
        assert list(workers.map(range(7), 1)) == [1, 2, 5, 10, 17, 26, 37]
    with open_workers(functools.partial(EndsOnce, str(tmp_path)), 1, "local") as workers:
        assert list(workers.map(range(4))) == [0, 1, 2, 3]
        assert sorted(workers.lost) == [0, 3]


def test_arrays_are_counted_as_they_are_sent():
    values = {"row": np.zeros((1000, 50), np.float32), "part": np.zeros((100, 100))[::2, ::3], "word": "lift"}
    assert len(pickle.dumps(values, protocol=5)) == pytest.approx(size_of(values), rel=0.01)


@needs_ray
@pytest.mark.filterwarnings("default")  # Ray's own
def test_what_goes_to_actors_and_back_is_counted():
    items, shared = [1 << 80_000] * 4, 1 << 160_000
    with open_workers(Square, 2, "local") as workers:
        results = list(workers.map(items, shared))
        moved = sum(len(pickle.dumps(each)) for each in (*items, *results, shared))
        assert moved <= workers.moved_bytes <= moved + 200, "what all share is put once into the store of the only node"


@needs_ray
def test_a_node_that_is_lost_stops_nobody_and_no_node_at_all_is_said():
    """Also three workers on two cores; half a second for each item, and some ten for Ray to see that a node is gone."""
    environment = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32), "RAY_USAGE_STATS_ENABLED": "0"}
    environment["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"  # else Ray listens on all interfaces
    command = [sys.executable, "-m", "tests.unit.sim_backend.workers.lost_nodes"]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=os.environ | environment, timeout=280)
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["three"].startswith("3 workers were asked for, which need a core each, and the Ray at 127.0.0.1:")
    assert "has 2: ask for fewer, or add nodes" in found["three"]
    assert found["squares"] == [item * item for item in range(12)] and found["lost"] == 1
    assert found["none"].startswith("Ray could place none of the 2 workers for 2 s: of ")
