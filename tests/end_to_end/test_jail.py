"""A farm that asks for a jail: on a machine that has it policies run, on a kernel without Landlock nobody's are taken."""

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
    return jail


def test_a_farm_tells_which_jail_its_policies_run_in(tmp_path, whole_jail):
    with Farm(tmp_path, robots=2, more=(*NOMINAL, "--jail-level", "full")) as farm:
        status = farm.json("status")
        assert status["healthy"], status
        assert status["jail"] == {"level": "full", "layers": list(whole_jail.layers)}
        assert status["robots_by_jail"] == {"full": 2}
        said = farm.run("status")
        assert "jail:   full for uploads, robots: 2 full" in said
        assert "landlock-files" in said
        report = farm.report(farm.submit(REFERENCE, trials=1, seed=11))
        assert report["jail"] == status["jail"]
        assert all(row["outcome"]["jail"]["level"] == "full" for row in report["per_trial"])
        assert "jail           full" in farm.run("report", report["job_id"])


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
