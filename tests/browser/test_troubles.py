"""Pages of a farm in trouble and of one where nothing is yet, by scripted robots: read by whoever cannot see."""

import signal

import pytest

from tests.browser.conftest import Visit, gravest
from tests.integration.farm_process import PATIENCE_S, services, until


class Troubled:
    """What a visit needs of a farm."""

    def __init__(self, farm):
        self.farm, self.url = farm, farm.api
        self.operator = farm.tokens["admin"]
        made = farm.admin.post("/v1/tokens", json={"owner": "new", "scopes": ["submit"]})
        self.newcomer = made.json()["secret"]


@pytest.fixture(scope="module")
def troubled(chromium, tmp_path_factory):
    """A farm whose only robot died in the midst of a trial, which was the job's last attempt."""
    with services(tmp_path_factory.mktemp("troubled") / "farm", max_attempts=1, renew_every_s=0.3) as farm:
        farm.start_robot("robot-0", trial_s=600)
        until(lambda: farm.robots_in("idle") == 1, PATIENCE_S, "a robot")
        job = farm.submit(farm.policy(), trials=3).json()["job_id"]
        until(lambda: farm.robots_in("running") == 1, PATIENCE_S, "its trial")
        farm.robots["robot-0"].send_signal(signal.SIGKILL)
        until(lambda: farm.job(job)["state"] == "failed", PATIENCE_S, "the job to fail")
        until(lambda: farm.robots_in("lost") == 1, PATIENCE_S, "the robot to be lost")
        yield Troubled(farm), job


def shown(visit, path, axe):
    visit.page.goto(path)
    visit.page.wait_for_timeout(200)
    grave = gravest(visit.page, axe)
    assert not grave, f"{path}: {grave}"
    assert visit.page.evaluate("document.documentElement.scrollWidth <= innerWidth"), f"{path} is wider than its window"
    return visit.page.inner_text("main")


def test_a_farm_in_trouble_says_what_failed_on_a_phone_too(browser, troubled, axe):
    farm, job = troubled
    with Visit(browser, farm, farm.operator, width=400, dark=True) as visit:
        assert "lost" in shown(visit, "/", axe)
        assert "Failed by the platform" in shown(visit, f"/jobs/{job}", axe)
        assert "failed by the platform" in shown(visit, f"/trials/{job}-000", axe)


def test_a_newcomer_finds_no_page_empty_of_words(browser, troubled, axe):
    farm, _ = troubled
    with Visit(browser, farm, farm.newcomer, width=400) as visit:
        assert "No jobs yet" in shown(visit, "/jobs", axe)
        assert "No job has ended with a report yet" in shown(visit, "/compare", axe)
        for path in ("/ladders", "/leaderboard", "/studies", "/shares"):
            assert len(shown(visit, path, axe)) > 40, path
