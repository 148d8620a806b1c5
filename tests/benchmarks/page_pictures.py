"""Pictures of every page, wide and narrow, light and dark, and what axe-core says of each: ``python -m`` it.

A farm of two robots that differ runs policies, a ladder and a long job; at the end its robots are stopped, so that a job fails
and a farm is looked at that has lost its robots. ``--axe`` names axe-core's file; without it nothing is said of accessibility.
"""

import argparse
import json
import os
import signal
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from playwright.sync_api import Browser, Error, sync_playwright

from sim_backend.reality_gap.report.report import html_page
from tests.benchmarks import ten_questions
from tests.browser.conftest import CHROMIUM, FLAGS, REFERENCE, Looked, Visit
from tests.end_to_end.farm import Farm
from tests.unit.sim_backend.reality_gap.report import study_documents

ROBOTS, TRIALS, RANKED, RUNG, LONG = 2, 24, 4, 3, 600
POLICIES = ("push-scratch", "push-adr", "push")
SIZES = {"wide": (1440, 900), "narrow": (400, 860)}
SETTLED_MS, SHOT_MS = 1200, 120_000
WITHIN_S = 3000
DRAWN = "() => document.querySelector('#sheet').dataset.drawn !== undefined"
"""All small pictures are there."""
WITHOUT_SCRIPTS = ("study",)
"""In whose page nothing can be run, so that axe cannot read it either."""
GRAVE = ("serious", "critical")
WAIT_FOR = {"trial": "#replay[data-ready=yes]", "shared": "#replay[data-ready=yes]", "beside": "#replay[data-ready=yes]"}


@dataclass(frozen=True)
class Look:
    """How a page is looked at."""

    browser: Browser
    looked: Looked
    out: Path
    axe: str | None

    def at(self, pages: Mapping[str, str], token: str, *, whole: bool = True) -> list[dict]:
        """A picture of each page in each form; gives what was wrong with it."""
        found = []
        for dark in (False, True):
            for size, (width, height) in SIZES.items():
                with Visit(self.browser, self.looked, token, dark=dark, width=width, height=height) as visit:
                    for name, path in pages.items():
                        visit.page.goto(path)
                        if name in WAIT_FOR:
                            visit.page.wait_for_selector(WAIT_FOR[name], timeout=60_000)
                        visit.page.wait_for_timeout(SETTLED_MS)
                        if name == "job":
                            visit.page.wait_for_function(DRAWN, timeout=60_000)
                        named = f"{name}-{'dark' if dark else 'light'}-{size}"
                        visit.page.screenshot(path=self.out / f"{named}.png", full_page=whole, timeout=SHOT_MS)
                        print(named, flush=True)
                        found.append({"page": named, **({} if name in WITHOUT_SCRIPTS else self.wrong(visit))})
        return found

    def wrong(self, visit: Visit) -> dict:
        """What axe says of a page, and by how much it is wider than its window."""
        page = visit.page
        wide = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        if self.axe is None:
            return {"wider_by_px": max(0, wide)}
        page.evaluate(self.axe)
        said = page.evaluate("async () => (await axe.run()).violations")
        grave = [each["id"] for each in said if each["impact"] in GRAVE]
        return {"wider_by_px": max(0, wide), "grave": grave, "other": [each["id"] for each in said if each["id"] not in grave]}


def build(looked: Looked) -> dict[str, str]:
    """Runs what there is to look at; gives the path of each page. The study is one of the tests."""
    study = looked.farm.folder / "data" / "studies" / "joints"
    study.mkdir(parents=True)
    (study / "report.html").write_text(html_page(study_documents.full_document()))
    digests = {name: looked.upload(name, looked.user, REFERENCE.with_stem(name)) for name in POLICIES}
    ended, again = (looked.submit(digests[name], looked.user, trials=TRIALS, seed=3) for name in ("push", "push-adr"))
    labels = {"name": "smaller torques", "note": "reward on torque 0.02 instead of 0.01; ask Bea about the third finger"}
    with looked.client(looked.user) as ann:
        ann.patch(f"/v1/jobs/{ended}", json=labels).raise_for_status()
    ranked = [looked.submit(digest, looked.user, trials=RANKED, seed=None) for digest in digests.values()]
    asked = [{"policy": digest, "step": 1e5 * (place + 1)} for place, digest in enumerate(digests.values())]
    with looked.client(looked.user) as ann:
        body = {"name": "push, three trainings", "task": "push", "trials": RUNG, "rungs": asked}
        ladder = ann.post("/v1/ladders", json=body).raise_for_status().json()
    for job in (ended, again, *ranked, *(rung["job_id"] for rung in ladder["rungs"])):
        looked.wait(job, WITHIN_S)
    with looked.client(looked.user) as ann:
        trials = ann.get(f"/v1/jobs/{ended}/trials").json()["trials"]
        failed = next((each for each in trials if each["outcome"]["kind"] != "succeeded"), trials[0])
        at_s = (failed["outcome"]["failure"] or {}).get("at_s") or 5.0
        link = ann.post("/v1/shares", json={"trial": failed["trial_id"], "at_s": at_s}).raise_for_status().json()["url"]
    trial = f"/trials/{failed['trial_id']}"
    other = f"{again}-{failed['ordinal']:03d}"
    return {
        "farm": "/",
        "jobs": "/jobs",
        "job": f"/jobs/{ended}",
        "trial": f"{trial}?t={at_s}",
        "beside": f"{trial}?with={other}",
        "shared": link.removeprefix(looked.url),
        "links": "/shares",
        "report": f"/jobs/{ended}/report",
        "compare": f"/compare?jobs={ended},{again}",
        "refused": f"/compare?jobs={ended},{ranked[0]}",
        "ladder": f"/ladders/{ladder['ladder_id']}",
        "ladders": "/ladders",
        "leaderboard": "/leaderboard",
        "studies": "/studies",
        "study": "/studies/joints",
        "missing": "/nothing/here",
    }


def questions(look: Look, pages: Mapping[str, str]) -> list[dict]:
    """What a researcher's ten questions took."""
    ended, again = pages["compare"].partition("=")[2].split(",")
    running, failed = (pages[name].partition("?")[0].rpartition("/")[2] for name in ("running", "trial"))
    with Visit(look.browser, look.looked, look.looked.user) as visit:
        return ten_questions.measured(visit.page, ten_questions.asked(ended, again, running, failed))


def live(look: Look) -> list[dict]:
    """Pictures of a trial as it happens: each of whichever runs then."""
    found = []
    for dark in (False, True):
        for size, (width, height) in SIZES.items():
            with Visit(look.browser, look.looked, look.looked.operator, dark=dark, width=width, height=height) as visit:
                named = f"live-{'dark' if dark else 'light'}-{size}"
                while (seen := _watched(look, visit, named)) is None:
                    time.sleep(0.5)
                found.append(seen)
    return found


def _watched(look: Look, visit: Visit, named: str) -> dict | None:
    """What was wrong with the page of a trial that runs; None if none ran for long enough to be looked at."""
    robots = look.looked.api.get("/v1/robots").json()["robots"]
    running = [each["trial"] for each in robots if each["state"] == "running"]
    if not running:
        return None
    try:
        visit.page.goto(f"/trials/{running[0]}")
        visit.page.wait_for_function("() => Number(document.querySelector('#watch')?.dataset.seen) >= 3", timeout=5000)
        visit.page.screenshot(path=look.out / f"{named}.png", timeout=SHOT_MS)
        return {"page": named, **look.wrong(visit)}
    except Error:  # it ended, and its page went on to the replay
        return None


def troubles(look: Look) -> list[dict]:
    """Pictures of a farm whose robots are gone, and of the job that failed with them."""
    looked = look.looked
    running = [each for each in looked.api.get("/v1/robots").json()["robots"] if each["state"] == "running"]
    for each in running:
        os.kill(each["pid"], signal.SIGSTOP)
    earlier = {each["job_id"] for each in looked.api.get("/v1/jobs", params={"state": "failed"}).json()["jobs"]}
    until_s, failed = time.monotonic() + 120, None
    while failed is None and time.monotonic() < until_s:
        jobs = looked.api.get("/v1/jobs", params={"state": "failed"}).json()["jobs"]
        failed = next((each["job_id"] for each in jobs if each["job_id"] not in earlier), None)
        time.sleep(0.5)
    if failed is None:
        return [{"page": "failed", "problem": "no job failed"}]
    trial = next(each for each in looked.api.get(f"/v1/jobs/{failed}/trials").json()["trials"] if each["attempts"])
    found = look.at({"lost": "/", "failed": f"/jobs/{failed}", "faulted": f"/trials/{trial['trial_id']}"}, looked.operator)
    for each in running:  # until then they are only stopped: those that ended would be started again
        os.kill(each["pid"], signal.SIGKILL)
    return found


def troubles_alone(look: Look) -> list[dict]:
    """The pictures of troubles, of a farm that does nothing else."""
    looked = look.looked
    looked.submit(looked.upload("push", looked.user, REFERENCE.with_stem("push")), looked.user, trials=LONG, seed=4, task="lift")
    until_s = time.monotonic() + 120
    while time.monotonic() < until_s and not any(
        each["state"] == "running" for each in looked.api.get("/v1/robots").json()["robots"]
    ):
        time.sleep(0.2)
    return troubles(look)


def _keep(out: Path | None, found: list[dict]) -> None:
    """Prints what was found, and puts it in the place of what a file says of the same pages."""
    print(json.dumps(found, indent=1))
    if out:
        kept, names = json.loads(out.read_text()), {each["page"] for each in found}
        kept["pages"] = [each for each in kept["pages"] if each["page"] not in names] + found
        out.write_text(json.dumps(kept, indent=1) + "\n")


def main() -> None:
    """Runs the farm, takes the pictures, and says what was wrong."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--pictures", type=Path, required=True)
    parser.add_argument("--axe", type=Path)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--troubles", action="store_true", help="only of lost robots and of what failed; the rest of --out stays")
    parser.add_argument("--data", type=Path, help="keeps the farm's data there, so that a second run has its jobs")
    given = parser.parse_args()
    given.pictures.mkdir(parents=True, exist_ok=True)
    os.environ |= {"TRIFARM_SHARES": "true", "TRIFARM_WEBHOOKS": "true", "TRIFARM_MAX_ATTEMPTS": "1"}
    kept = ("TRIFARM_SHARES", "TRIFARM_WEBHOOKS", "TRIFARM_MAX_ATTEMPTS", "TRIFARM_REQUESTS_PER_S")
    axe = given.axe.read_text() if given.axe else None
    with tempfile.TemporaryDirectory(prefix="trifarm-pictures-") as folder:
        farm = Farm(given.data or Path(folder), robots=ROBOTS, more=("--physics", "real", "--farm-seed", "1"))
        farm.env |= {name: os.environ[name] for name in kept if name in os.environ}
        with farm, sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
            look = Look(browser, Looked(farm), given.pictures, axe)
            if given.troubles:
                _keep(given.out, troubles_alone(look))
                return
            empty = {
                "empty-jobs": "/jobs",
                "empty-compare": "/compare",
                "empty-leaderboard": "/leaderboard",
                "sign-in": "/sign-in",
            }
            found = look.at(empty, look.looked.stranger)
            known = (given.data or Path(folder)) / "pages.json"
            pages = json.loads(known.read_text()) if known.exists() else build(look.looked)
            known.write_text(json.dumps(pages))
            found += look.at(pages, look.looked.user)
            policy = look.looked.api.get(f"/v1{pages['job']}").json()["policy"]
            pages["running"] = f"/jobs/{look.looked.submit(policy, look.looked.user, trials=LONG, seed=4, task='lift')}"
            answers = questions(look, pages)
            print(json.dumps(answers), flush=True)
            found += live(look)
            found += look.at({"running": pages["running"]}, look.looked.user)
            found += troubles(look)
            look.looked.api.close()
            browser.close()
    text = json.dumps({"questions": answers, "pages": found}, indent=1)
    print(text)
    if given.out:
        given.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
