"""Chromium for the tests of pages and of the view."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Playwright, sync_playwright

PICTURES = Path(__file__).parents[2] / "out" / "browser"
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@pytest.fixture(scope="session")
def playwright() -> Iterator[Playwright]:
    """Return what launches browsers; screenshots go to out/browser/."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as launcher:
        yield launcher


def launched(playwright: Playwright, *flags: str) -> Browser:
    """Return the browser of this machine."""
    found = [path for path in map(shutil.which, NAMES) if path]
    if not found:
        pytest.fail(f"none of {', '.join(NAMES)} is installed: `make test-browser` installs one")
    return playwright.chromium.launch(executable_path=found[0], args=["--no-sandbox", *flags])


@pytest.fixture(scope="module")
def browser(playwright: Playwright) -> Iterator[Browser]:
    """Return a browser for pages."""
    yield (opened := launched(playwright))
    opened.close()


@pytest.fixture(scope="module")
def drawing_browser(playwright: Playwright) -> Iterator[Browser]:
    """Return a browser that draws WebGL by software, which makes pages slow."""
    yield (opened := launched(playwright, *SOFTWARE))
    opened.close()
