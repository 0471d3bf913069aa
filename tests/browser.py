"""A real browser, for pages: Chromium without a network."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

WITHIN = ("file:", "data:", "blob:")  # what a page that carries all it needs may ask for


class Visit:
    """A page that was opened; `bad` collects complaints of the console and whatever was missing."""

    def __init__(self, page: Any) -> None:
        self.page, self.bad = page, list[str]()
        page.on("console", self._note_message)
        page.on("pageerror", lambda error: self.bad.append(f"error: {error}"))
        page.on("request", self._note_request)
        page.on("requestfailed", self._note_failure)

    def _note_message(self, message: Any) -> None:
        if message.type in ("error", "warning") and "GL Driver Message" not in message.text:
            self.bad.append(f"{message.type}: {message.text}")

    def _note_request(self, request: Any) -> None:
        if not request.url.startswith(WITHIN):
            self.bad.append(f"asks for {request.url}")

    def _note_failure(self, request: Any) -> None:
        # A player that jumps breaks off what it was reading.
        if not (request.url.startswith("blob:") and "ERR_ABORTED" in (request.failure or "")):
            self.bad.append(f"not found: {request.url[:200]}")


@contextmanager
def chromium() -> Iterator[Any]:
    """Chromium; the test is skipped where there is none."""
    found = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if found is None:
        pytest.skip("no Chromium on this machine")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=found, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


def hold_time(page: Any) -> None:
    """From now on time passes on a page, whose clock was installed, as `page.clock.run_for` says."""
    page.clock.pause_at(page.evaluate("Date.now()") / 1000 + 60)  # not yet over when this is heard


def visit(browser: Any, path: Path, **how: Any) -> Visit:
    """Open a file."""
    seen = Visit(browser.new_context(**how).new_page())
    seen.page.goto(path.as_uri())
    return seen
