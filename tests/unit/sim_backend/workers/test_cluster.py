"""The seam on a Ray of this machine."""

import functools
import importlib.util

import pytest

from sim_backend.workers.cluster import status
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
