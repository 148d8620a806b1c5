"""What robots cost their host: the program runs, on a small farm, and robots share what they can."""

import json
import os

import pytest

from tests.benchmarks.robots_of_a_host import COLUMNS, main


@pytest.mark.scale
@pytest.mark.skipif(os.getuid() != 0, reason="nobody but root may look into a robot")
def test_two_robots_share_their_memory(tmp_path, capsys):
    """`test_most_of_what_a_robot_needs_is_shared` asks it of forks without a farm."""
    out = tmp_path / "figures.json"
    main(["--robots", "2", "--idle-s", "1", "--out", str(out)])
    (farm,) = json.loads(out.read_text())["farms"]
    assert set(farm) == set(COLUMNS)
    assert farm["robots"] == 2
    assert farm["robot_uss_mb"] < 0.6 * farm["robot_pss_mb"], "most of what a robot needs is shared with the other one"
    assert farm["all_pss_mb"] > 2 * (farm["robot_pss_mb"] + farm["policy_pss_mb"])
    assert 0 < farm["first_lease_s"] < 60
    header, row = capsys.readouterr().out.splitlines()[-2:]
    assert all(title in header for title in COLUMNS.values())
    assert row.split()[0] == "2"
