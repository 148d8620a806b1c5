"""How pushes of robots that differ everywhere scatter: what is counted, and what is refused."""

import json

import numpy as np
import pytest

from sim_backend.reality_gap.bench.cube_of_many import document, main
from sim_backend.reality_gap.knowledge.healthy import CUBES_OF_MANY_FILE
from sim_backend.reality_gap.subjects.cube.healthy import cubes_of_many, load_calibration
from sim_backend.reality_gap.subjects.cube.summary import NAMES, PLACED_NAMES

HEALTHY = load_calibration().null
FORCE, DELAY = NAMES.index("force_up"), NAMES.index("delay_s")


def rows(count: int = 400) -> np.ndarray:
    """Robots whose force upwards is off by two standard deviations and scatters three times as widely, and who are late."""
    found = np.random.default_rng(1).normal(size=(count, len(NAMES)))
    found[:, FORCE] = 2.0 + 3.0 * found[:, FORCE]
    found[:, DELAY] += 50.0
    return found


def test_numbers_of_pushes_scatter_as_they_were_found_and_those_of_reports_as_healthy_ones(tmp_path):
    made = document(rows(), range(400), HEALTHY)
    assert set(made["middle"]) == set(made["spread"]) == set(PLACED_NAMES)
    assert made["middle"]["force_up"] == pytest.approx(2.0, abs=0.5)
    assert made["spread"]["force_up"] == pytest.approx(3.0, rel=0.15)
    assert made["spread"]["cube_mass"] == pytest.approx(1.0, abs=0.15)
    path = tmp_path / "table.json"
    path.write_text(json.dumps(made))
    here = cubes_of_many(HEALTHY, path)
    assert here.null.covariance[DELAY, DELAY] == HEALTHY.covariance[DELAY, DELAY]
    assert here.null.covariance[FORCE, FORCE] == pytest.approx(made["spread"]["force_up"] ** 2 * HEALTHY.covariance[FORCE, FORCE])
    assert here.misfits.shape == (400,) and (np.diff(here.misfits) >= 0.0).all()
    assert here.misfit_p(here.misfits[-1] + 1.0) == pytest.approx(1 / 401) and here.misfit_p(0.0) == 1.0


def test_the_kept_table_is_of_robots_that_no_test_counts():
    kept = json.loads(CUBES_OF_MANY_FILE.read_text())
    assert len(kept["misfits"]) == len(kept["robots"]) >= 40
    assert not set(kept["robots"]) & set(range(8471, 8491))


def test_a_folder_without_such_robots_is_refused(tmp_path, capsys):
    (tmp_path / "robots.jsonl").write_text("")
    with pytest.raises(SystemExit):
        main([str(tmp_path)])
    assert "no robot with all effects" in capsys.readouterr().err
