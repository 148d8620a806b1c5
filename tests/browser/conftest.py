"""One real farm and one real browser for the tests of this folder."""

import hashlib
import json
import shutil
import subprocess
import tarfile
import time
from pathlib import Path

import httpx
import pytest

from api_schemas.policy import PolicyManifest, canonical_json, policy_digest
from tests.end_to_end.farm import Farm

CHROMIUM = "/usr/bin/chromium"
REFERENCE = Path(__file__).parent.parent.parent / "sim_backend/training/reference_policies/push.safetensors"
HOSTILE = """<img src=x onerror=alert(1)>"'&{{7*7}}</script><script>alert(2)</script>"""
PATIENCE_MS = 120_000
"""A browser that draws in software on a busy machine; nothing of how soon a page is there."""
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-gpu-rasterization",
    "--disable-gpu-compositing",
]


class Visit:
    """A signed-in page that keeps what the browser complained about."""

    def __init__(self, browser, looked, token, *, dark=False, width=1280, height=860):
        self.context = browser.new_context(
            viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light", base_url=looked.url
        )
        self.context.set_default_timeout(PATIENCE_MS)
        self.page = self.context.new_page()
        self.complaints = []
        self.page.on("console", lambda said: self.complaints.append(said.text) if said.type == "error" else None)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("dialog", lambda dialog: (self.complaints.append(f"dialog {dialog.message}"), dialog.dismiss()))
        self.page.goto("/sign-in")
        self.page.fill("#token", token)
        self.page.click("button.strong")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.context.close()


class Looked:
    """A farm that people look at: its address, its tokens, and the jobs that it runs."""

    def __init__(self, farm: Farm) -> None:
        settings = json.loads((farm.folder / "home" / "settings.json").read_text())
        self.farm, self.url, self.operator = farm, settings["url"], settings["token"]
        self.api = self.client(self.operator)
        self.user = self.token("ann")
        self.stranger = self.token("bob")

    def client(self, token: str) -> httpx.Client:
        return httpx.Client(base_url=self.url, headers={"Authorization": f"Bearer {token}"}, timeout=120)

    def token(self, owner: str) -> str:
        return self.api.post("/v1/tokens", json={"owner": owner, "scopes": ["submit"]}).json()["secret"]

    def submit(self, policy: str, token: str, trials: int, seed: int | None = 1, task: str = "push") -> str:
        body = {"policy": policy, "task": task, "trials": trials, "seed": seed}
        with self.client(token) as client:
            return client.post("/v1/jobs", json=body).raise_for_status().json()["job_id"]

    def ladder(self, name: str, policy: str, token: str, rungs: int, trials: int) -> dict:
        """A ladder that has the same policy on each of its rungs."""
        asked = [{"policy": policy, "step": 1e5 * (rung + 1)} for rung in range(rungs)]
        body = {"name": name, "task": "push", "trials": trials, "rungs": asked}
        with self.client(token) as client:
            return client.post("/v1/ladders", json=body).raise_for_status().json()

    def upload(self, name: str, token: str, policy: Path = REFERENCE) -> str:
        """The digest of a shipped policy under another name, which is then the token's owner's."""
        weights = policy.read_bytes()
        manifest = PolicyManifest.model_validate(json.loads(policy.with_suffix(".json").read_text()) | {"name": name})
        digest = policy_digest(hashlib.sha256(weights).hexdigest(), manifest)
        files, data = {"weights": ("weights.safetensors", weights)}, {"manifest": canonical_json(manifest)}
        with self.client(token) as client:
            client.put(f"/v1/policies/{digest}", files=files, data=data).raise_for_status()
        return digest

    def wait(self, job_id: str, within_s: float = 240) -> None:
        give_up_s = time.monotonic() + within_s
        while self.api.get(f"/v1/jobs/{job_id}").json()["state"] != "succeeded":
            assert time.monotonic() < give_up_s, f"job {job_id} has not ended"
            time.sleep(0.1)


@pytest.fixture(scope="package")
def chromium():
    if not Path(CHROMIUM).exists():
        pytest.skip(f"there is no {CHROMIUM}: the pages are not looked at in a browser")
    return CHROMIUM


@pytest.fixture(scope="package")
def looked(chromium, tmp_path_factory):
    farm = Farm(tmp_path_factory.mktemp("browser"), robots=1)
    farm.env["TRIFARM_SHARES"] = "true"
    with farm:
        looked = Looked(farm)
        yield looked
        looked.api.close()


@pytest.fixture(scope="package")
def browser(chromium):
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        yield started
        started.close()


def gravest(page, axe):
    """What axe finds serious or critical on the page."""
    page.evaluate(axe)
    found = page.evaluate("async () => (await axe.run()).violations")
    worst = [each for each in found if each["impact"] in ("serious", "critical")]
    return [(each["id"], [node["html"][:120] for node in each["nodes"]]) for each in worst]


@pytest.fixture(scope="package")
def axe(tmp_path_factory) -> str:
    """The source of axe-core."""
    folder = tmp_path_factory.mktemp("axe")
    if shutil.which("npm") is None:
        pytest.skip("there is no npm to fetch axe-core with: accessibility is not checked")
    packing = ["npm", "pack", "axe-core@4.14.1", "--silent"]
    try:
        done = subprocess.run(packing, cwd=folder, capture_output=True, text=True, timeout=60, check=False)
    except subprocess.TimeoutExpired:
        pytest.skip("npm did not bring axe-core within 60 s: accessibility is not checked")
    archives = list(folder.glob("*.tgz"))
    if not archives:
        pytest.skip(f"npm could not bring axe-core, so accessibility is not checked: {done.stderr.strip()[-200:]}")
    with tarfile.open(archives[0]) as archive:
        member = archive.extractfile("package/axe.min.js")
        assert member is not None
        return member.read().decode()
