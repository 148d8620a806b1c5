"""What Foxglove Studio, the last one that npm has, makes of a log and of the layout beside it; ``python -m`` it with a log.

Chromium opens both as a reader would, plays on to a moment, and keeps a picture; what the viewer complains of is printed.
"""

import argparse
import json
import shutil
import subprocess
import tarfile
import tempfile
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from tests import ROOT
from tests.browser.conftest import CHROMIUM, FLAGS

LAYOUT = ROOT / "services/dashboard/static/viewer_layout.json"
PACKAGES = {
    "@foxglove/studio-base@1.48.0": {"package/assets": "assets"},
    "react@17.0.2": {"package/umd/react.production.min.js": "react.js"},
    "react-dom@17.0.2": {"package/umd/react-dom.production.min.js": "react-dom.js"},
}
"""What is taken of each package, and as what it is served."""
PANELS = "[data-testid^='panel-mouseenter-container']"
WIDTH, HEIGHT = 1600, 1000
LEFT, FROM_BELOW = 40, 55
"""Where the viewer has its time line."""
READY_MS = 120_000
SETTLED_MS = 15_000


class Ranged(SimpleHTTPRequestHandler):
    """Files of a folder, also in parts: the viewer reads a log's summary first."""

    def do_GET(self) -> None:
        path = Path(self.translate_path(self.path))
        if path.suffix != ".mcap":
            return super().do_GET()
        size = path.stat().st_size
        first, _, last = self.headers.get("Range", "bytes=0-").removeprefix("bytes=").partition("-")
        start, end = int(first), min(size - 1, int(last) if last else size - 1)
        self.send_response(206 if "Range" in self.headers else 200)
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("Content-Length", str(end + 1 - start))
        self.send_header("Content-Range", f"bytes {start}-{end}/{size}")
        self.end_headers()
        with path.open("rb") as file:
            file.seek(start)
            self.wfile.write(file.read(end + 1 - start))
        return None

    def log_message(self, format: str, *args: object) -> None:
        """Nothing: the browser tells what went wrong."""


def bring(folder: Path) -> None:
    """Puts the viewer's files into ``folder``."""
    for package, parts in PACKAGES.items():
        with tempfile.TemporaryDirectory() as name:
            subprocess.run(["npm", "pack", package, "--silent"], cwd=name, check=True, stdout=subprocess.DEVNULL, timeout=300)
            with tarfile.open(next(Path(name).glob("*.tgz"))) as archive:
                archive.extractall(name, filter="data")
            for source, target in parts.items():
                shutil.move(Path(name) / source, folder / target)


def look(folder: Path, at: float, picture: Path | None) -> dict:
    """What is on the screen once log and layout are open: panels, their words, and complaints."""
    from playwright.sync_api import sync_playwright

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Ranged, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{server.server_port}"
    complaints: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.on("pageerror", lambda error: complaints.append(str(error)[:500]))
        page.on("console", lambda said: complaints.append(said.text[:500]) if said.type == "error" else None)
        page.goto(f"{url}/viewer.html?ds=remote-file&ds.url={url}/log.mcap")
        page.wait_for_selector(PANELS, timeout=READY_MS)
        page.wait_for_timeout(SETTLED_MS)
        page.mouse.click(LEFT + at * (WIDTH - 2 * LEFT), HEIGHT - FROM_BELOW)
        page.wait_for_timeout(SETTLED_MS)
        if picture is not None:
            page.screenshot(path=picture, timeout=READY_MS)
        found = {"panels": page.locator(PANELS).count(), "words": page.inner_text("body").split("\n")}
        found["layout"] = page.evaluate("keptLayout()")
        browser.close()
    server.shutdown()
    return found | {"complaints": complaints}


def main() -> None:
    """Brings the viewer, opens the log, and prints what was seen."""
    parser = argparse.ArgumentParser()
    parser.add_argument("log", type=Path)
    parser.add_argument("--layout", type=Path, default=LAYOUT)
    parser.add_argument("--at", type=float, default=0.5, help="the moment to go to, as a share of the log")
    parser.add_argument("--viewer", type=Path, help="a folder to keep the viewer in, or that has it")
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="trifarm-viewer-") as name:
        folder = given.viewer or Path(name)
        if not (folder / "assets").exists():
            folder.mkdir(parents=True, exist_ok=True)
            bring(folder)
        shutil.copy(given.log, folder / "log.mcap")
        shutil.copy(given.layout, folder / "layout.json")
        shutil.copy(Path(__file__).with_suffix(".html"), folder / "viewer.html")
        print(json.dumps(look(folder, given.at, given.picture), indent=2))


if __name__ == "__main__":
    main()
