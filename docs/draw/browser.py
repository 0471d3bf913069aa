"""Screenshots of the report and the live tank in a browser."""

import io
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from docs.draw.film import Picture
from docs.draw.pipeline import ENV

NAMES = ("chromium", "chromium-browser", "google-chrome")
WIDTH_PX, HEIGHT_PX = 1280, 800  # size of the window
HEAD_PX = "Math.round(document.querySelector('#measures').getBoundingClientRect().top)"
MOMENT_S = 15  # moment in the report's film
WAIT_S = 60  # longest wait for a page


def chromium() -> str:
    """Return the browser's path."""
    for name in NAMES:
        if path := shutil.which(name):
            return path
    raise SystemExit("docs: no Chromium on this machine; install it (apt-get install chromium)")


@contextmanager
def page(address: str) -> Iterator[Any]:
    """Open a page in a headless browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        try:
            tab = browser.new_page(viewport={"width": WIDTH_PX, "height": HEIGHT_PX})
            tab.goto(address)
            yield tab
        finally:
            browser.close()


def wait(tab: Any, condition: str) -> None:
    """Wait until a condition of the page holds; the page's policy forbids playwright's own wait."""
    for _ in range(WAIT_S * 10):
        if tab.evaluate(condition):
            return
        tab.wait_for_timeout(100)
    raise SystemExit(f"docs: the page does not fulfil, after {WAIT_S} s: {condition}")


def shot(tab: Any, **part: Any) -> Picture:
    """Return a screenshot of the window, or of a part of the page."""
    return np.asarray(Image.open(io.BytesIO(tab.screenshot(**part))).convert("RGB"))


def report(folder: Path) -> Picture:
    """Return the head of the report, with its film at a moment in the middle."""
    with page((folder / "reports/index.html").resolve().as_uri()) as tab:
        tab.evaluate("document.querySelector('video').pause()")
        tab.evaluate(f"document.querySelector('video').currentTime = {MOMENT_S}")
        tab.wait_for_timeout(1500)  # until the video shows that moment
        head = {"x": 0, "y": 0, "width": WIDTH_PX, "height": tab.evaluate(HEAD_PX)}
        return shot(tab, full_page=True, clip=head)


def live_tank(folder: Path, shares: list[tuple[float, float]]) -> Picture:
    """Return the live tank some time after each fish got a goal, in shares of the picture."""
    command = [sys.executable, "-m", "stages.play", "--no-open", "--port", "0"]
    command += ["--fish", str(len(shares))]
    tank = subprocess.Popen(command, cwd=folder, env=ENV, stderr=subprocess.PIPE, text=True)
    try:
        assert tank.stderr is not None
        output = tank.stderr.readline() + tank.stderr.readline()  # a start message, and the address
        address = next((word for word in output.split() if "http:" in word), "")
        if not address:
            raise SystemExit(f"docs: the live tank does not open:\n{output}{tank.stderr.read()}")
        with page(address) as tab:
            wait(tab, "!!state")
            box = tab.locator("#tank").bounding_box()
            for number, (x, y) in enumerate(shares):
                tab.select_option("#who", str(number))
                tab.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
            wait(tab, "state.decision && state.decision.candidates.length > 3")
            tab.wait_for_timeout(2000)  # for a trail
            return shot(tab)
    finally:
        tank.terminate()
        tank.wait()
