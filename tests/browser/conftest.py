"""Chromium for the tests of pages; it draws WebGL without a graphics card."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, sync_playwright

PICTURES = Path(__file__).parents[2] / "out" / "browser"
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Return the browser of this machine; screenshots go to out/browser/."""
    found = [path for path in map(shutil.which, NAMES) if path]
    if not found:
        pytest.fail(f"none of {', '.join(NAMES)} is installed: `make test-browser` installs one")
    PICTURES.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found[0], args=[*FLAGS])
        yield browser
        browser.close()
