"""Pictures of the pages for docs/dashboard.md: a farm of robots that differ, with names that a user would give.

``TRIFARM_PICTURES=docs/pictures python -m pytest tests/browser/test_pictures.py`` takes them; without it no farm is
started. Those of a ladder, which wants the checkpoints of a training, and of a trial as it happens are taken by hand.
"""

import itertools
import os
from pathlib import Path

import pytest

from tests.browser.conftest import REFERENCE, Looked, Visit
from tests.end_to_end.farm import Farm

FOLDER = os.environ.get("TRIFARM_PICTURES")
ROBOTS, TRIALS = 4, 40
SETTLED_MS = 2500
WITHIN_S = 1200
SHIPPED = ("push-scratch", "push-adr", "push-recurrent", "push")


@pytest.fixture(scope="module")
def shown(chromium, tmp_path_factory):
    if FOLDER is None:
        pytest.skip("TRIFARM_PICTURES names no folder to keep pictures in")
    more = ("--physics", "real", "--farm-seed", "1")
    with Farm(tmp_path_factory.mktemp("pictures"), robots=ROBOTS, more=more) as farm:
        looked = Looked(farm)
        yield looked
        looked.api.close()


@pytest.fixture(scope="module")
def pages(shown):
    """The path of each page. The leaderboard has the shipped policies, two of them share their goals, and one job still runs."""
    digests = {name: shown.upload(name, shown.user, REFERENCE.with_stem(name)) for name in SHIPPED}
    ranked = [shown.submit(digest, shown.user, trials=TRIALS, seed=None) for digest in digests.values()]
    ended, again = (shown.submit(digests[name], shown.user, trials=TRIALS, seed=3) for name in ("push", "push-adr"))
    for job in (*ranked, ended, again):
        shown.wait(job, WITHIN_S)
    shown.submit(digests["push"], shown.user, trials=200, seed=4)
    job, trial = f"/jobs/{ended}", f"/trials/{ended}-000"
    return {
        "farm": "/",
        "jobs": "/jobs",
        "job": job,
        "trial": trial,
        "compare": f"/compare?jobs={ended},{again}",
        "leaderboard": "/leaderboard",
    }


@pytest.mark.parametrize("dark, width", list(itertools.product((False, True), (1280, 390))))
def test_a_picture_of_each_page(browser, shown, pages, dark, width):
    look = f"{'dark' if dark else 'light'}-{'wide' if width > 1000 else 'narrow'}"
    with Visit(browser, shown, shown.operator, dark=dark, width=width) as visit:
        for name, path in pages.items():
            visit.page.goto(path)
            visit.page.wait_for_timeout(SETTLED_MS)
            visit.page.screenshot(path=Path(FOLDER or "") / f"{name}-{look}.png")
        assert visit.complaints == []
