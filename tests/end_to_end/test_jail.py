"""A farm that asks for a jail which a kernel without Landlock does not have: nobody's policies are taken."""

from pathlib import Path

import pytest

from jail.detection import detect
from jail.level import JailLevel
from tests.end_to_end.farm import Farm

ROOT = Path(__file__).parent.parent.parent
REFERENCE = ROOT / "sim_backend/training/reference_policies/push.safetensors"
NOMINAL = ("--physics", "nominal")


@pytest.fixture(scope="module", autouse=True)
def whole_jail():
    jail = detect()
    if jail.level is not JailLevel.FULL:
        print(f"this machine's jail is {jail}")
        pytest.skip(f"this machine's jail is {jail}")


def test_a_farm_that_cannot_have_the_jail_it_asks_for_takes_nothing_and_says_why(tmp_path):
    through = (str(ROOT / "tests" / "without_landlock.py"),)
    with Farm(tmp_path, robots=1, more=(*NOMINAL, "--jail-level", "filesystem"), through=through) as farm:
        status = farm.json("status")
        assert not status["healthy"]
        assert status["jail"]["level"] == "limits"
        assert status["robots_by_jail"] == {"limits": 1}
        problems = " ".join(status["problems"])
        assert "no policy and no log is taken: the jail here reaches level limits" in problems
        assert "robot-0 is out of service" in problems
        assert "asks for filesystem; missing: landlock-files" in problems
        refusal = farm.json("submit", str(REFERENCE), "--task", "push", "--trials", "1", code=None)["error"]
        assert refusal["type"].endswith("jail-too-open"), refusal
        assert refusal["status"] == 503
