"""A researcher's ten questions, answered by clicks in a real browser: how many, and how long the pages make one wait.

Every path begins on the farm's page and ends where the answer is on the screen. A click takes what the keystroke level
model has for deciding, pointing and pressing (Card, Moran, Newell 1980), 1.35 + 1.1 + 0.2 s; what the browser waited is measured.
Nobody's reading is in either. ``BEFORE`` is what the pages of commit 4d66ffd offered for the same questions.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from playwright.sync_api import Page

CLICK_S = 1.35 + 1.1 + 0.2
READY = "#replay[data-ready=yes]"


@dataclass(frozen=True)
class Asked:
    """A question, the clicks that lead to its answer, and what is then on the screen."""

    question: str
    clicks: tuple[str, ...]
    answer: str


BEFORE: dict[str, int | None] = {
    "is it good": 1,
    "how sure is that": 2,
    "where does it fail": None,
    "why did this trial fail": 3,
    "is B better": 4,
    "on which goals": 6,
    "is the farm healthy": 0,
    "when will mine be done": None,
    "show my colleague this moment": None,
    "give me the data of all trials": None,
}
"""Clicks at commit 4d66ffd; None: no page answered it. Why a trial failed was left to whoever watched its replay, and the goals
on which two jobs differ led to one replay at a time.
"""


def asked(ended: str, again: str, running: str, failed: str) -> tuple[Asked, ...]:
    """The questions, about two jobs that ended, one that runs and a trial of the first that failed."""
    jobs, job = "nav a[href='/jobs']", f"#to-{ended}"
    compare = ("nav a[href='/compare']", f"#job-{ended}", f"#job-{again}", "form button.strong")
    tile = f"#tile-{int(failed.rpartition('-')[2])}"
    return (
        Asked("is it good", (jobs,), f"li:has({job}) .job-rate .rate"),
        Asked("how sure is that", (jobs, job), "#progress .big b"),
        Asked("where does it fail", (jobs, job), "#map .goal-map"),
        Asked("why did this trial fail", (jobs, job, tile), READY),
        Asked("is B better", compare, ".verdict"),
        Asked("on which goals", (*compare, ".strip a"), READY),
        Asked("is the farm healthy", (), "#health h1"),
        Asked("when will mine be done", (jobs, f"#to-{running}"), "#progress dt:has-text('left')"),
        Asked("show my colleague this moment", (jobs, job, tile, "#share summary", "#share button", "#copy"), "#link"),
        Asked("give me the data of all trials", (jobs, job, "#table"), "#trials"),
    )


def measured(page: Page, questions: tuple[Asked, ...]) -> list[dict]:
    """What was needed for each."""
    return [_one(page, each) for each in questions]


def _one(page: Page, asked: Asked) -> dict:
    page.goto("/")
    page.wait_for_selector("#health h1")
    waited_s = 0.0
    for at, click in enumerate(asked.clicks):
        following = asked.clicks[at + 1] if at + 1 < len(asked.clicks) else asked.answer
        waited_s += _timed(lambda click=click, following=following: _go(page, click, following))
    clicks, before = len(asked.clicks), BEFORE[asked.question]
    return {
        "question": asked.question,
        "clicks": clicks,
        "clicking_s": round(clicks * CLICK_S, 1),
        "waited_s": round(waited_s, 2),
        "clicks_before": before,
        "clicking_s_before": None if before is None else round(before * CLICK_S, 1),
    }


def _go(page: Page, click: str, following: str) -> None:
    if click == "#table":
        with page.expect_download():
            page.locator(click).click()
        return
    page.locator(click).first.click()
    page.locator(following).first.wait_for(state="attached", timeout=60_000)


def _timed(do: Callable[[], None]) -> float:
    began_s = time.perf_counter()
    do()
    return time.perf_counter() - began_s
