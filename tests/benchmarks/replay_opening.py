"""How long a person waits in a real browser: for the first page, and for the replay of a whole lift log. ``python -m`` it.

A farm runs one lift trial at 1 kHz. The first opening of its replay includes reducing the log on the server; the others find what
was kept. The first page is opened signed in, with nothing in the browser's cache.
"""

import argparse
import json
import os
import statistics
import tempfile
import time
from pathlib import Path

from sim_backend.training import reference_policies
from tests.browser.conftest import CHROMIUM, FLAGS
from tests.end_to_end.farm import Farm
from trial_logs.reader import read_log

OPENINGS, PAUSE_S = 5, 1.0
PAINT = "() => performance.getEntriesByType('paint').find(each => each.name === 'first-contentful-paint').startTime"
SENT = "() => performance.getEntries().reduce((sum, each) => sum + (each.transferSize || 0), 0)"


def signed_in(browser, url: str, token: str):
    """A page of a browser session with an empty cache."""
    page = browser.new_context(base_url=url, viewport={"width": 1280, "height": 860}).new_page()
    page.goto("/sign-in")
    page.fill("#token", token)
    page.click("button.strong")
    page.wait_for_url(f"{url}/")
    return page


def opened_s(page, trial: str) -> float:
    """Seconds from asking for a trial's page until the first picture of its replay is shown."""
    began_s = time.perf_counter()
    page.goto(f"/trials/{trial}")
    page.wait_for_selector("#replay[data-ready=yes]", timeout=60_000)
    return time.perf_counter() - began_s


def first_page(browser, url: str, token: str) -> dict[str, float]:
    """First paint in ms and kilobytes transferred, of the page of the farm with nothing cached but the session."""
    page = signed_in(browser, url, token)
    cookies, context = page.context.cookies(), browser.new_context(base_url=url)
    context.add_cookies(cookies)
    fresh = context.new_page()
    fresh.goto("/")
    fresh.wait_for_function("() => performance.getEntriesByType('paint').length > 1")
    return {"first_paint_ms": round(fresh.evaluate(PAINT), 1), "transferred_kb": round(fresh.evaluate(SENT) / 1000, 1)}


def main() -> None:
    """Runs the trial, opens the pages, and prints what was measured."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="trifarm-replay-") as folder, Farm(Path(folder), robots=1) as farm:
        job = farm.submit(reference_policies.folder() / "lift.safetensors", task="lift", trials=1)
        farm.report(job)
        trial, settings = f"{job}-000", json.loads((farm.folder / "home" / "settings.json").read_text())
        farm.run("fetch", job, "--to", str(farm.folder / "logs"))
        log = next((farm.folder / "logs").glob("**/*.mcap"))
        found = {
            "cores": os.cpu_count(),
            "load_before": os.getloadavg()[0],
            "log_megabytes": round(log.stat().st_size / 1e6, 1),
            "log_steps": len(read_log(log).joint_position_rad),
        }
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
            page = signed_in(browser, settings["url"], settings["token"])
            times = [opened_s(page, trial)]
            for _ in range(OPENINGS - 1):
                time.sleep(PAUSE_S)
                times.append(opened_s(page, trial))
            pages = [first_page(browser, settings["url"], settings["token"]) for _ in range(OPENINGS)]
            browser.close()
    found |= {
        "replay_first_s": round(times[0], 2),
        "replay_again_median_s": round(statistics.median(times[1:]), 2),
        "first_page": {name: statistics.median(each[name] for each in pages) for name in pages[0]},
    }
    text = json.dumps(found, indent=2)
    print(text)
    if given.out:
        given.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
