"""Fifty random mutations of each kind are refused with a type, or accepted and running. A thousand: ``mutations.py``."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.hostile.mutations import KINDS

ROOT = Path(__file__).parents[2]
COUNT = 50


def test_mutations_are_refused_with_a_type_or_run(tmp_path):
    out = tmp_path / "result.json"
    command = [sys.executable, "-m", "tests.hostile.mutations", "--count", str(COUNT), "--seed", "7", "--out", str(out)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=250, check=False)
    result = json.loads(out.read_text())
    assert set(result["kinds"]) == set(KINDS)
    for kind in result["kinds"].values():
        assert kind["faults"] == []
        assert kind["refused_before_parsing"] + kind["refused_by_converter"] + kind["accepted"] == COUNT
        assert kind["accepted"] > 0
        assert kind["largest_cpu_s_before_parsing"] <= 0.1
        assert kind["largest_cpu_s_of_converter"] <= 5
        assert kind["largest_memory_mb_of_converter"] <= 1024
        assert kind["largest_cpu_s_of_converter"] + kind["cpu_s_of_a_whole_converter"] <= 5
        assert kind["memory_mb_of_a_whole_converter"] <= 1024
    assert ended.returncode == 0


def test_mutations_are_the_same_for_the_same_seed():
    for _, make in KINDS.values():
        assert make(0, np.random.default_rng(3)) == make(0, np.random.default_rng(3))


def test_the_result_that_is_kept_is_of_a_thousand_without_a_fault():
    kept = json.loads((ROOT / "results/hostile-mutations.json").read_text())
    assert kept["count"] >= 1000
    assert set(kept["kinds"]) == set(KINDS)
    assert all(kind["faults"] == [] for kind in kept["kinds"].values())
