"""The first screen of a report as a picture: `report_picture.py report.html docs/report.png`.

It needs Chromium and playwright (`make dev`, `make test-browser`).
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def main(report: Path, picture: Path, width: int, height: int) -> None:
    """Open the report in headless Chromium and write what fits into its window."""
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(shutil.which, NAMES)), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(report.resolve().as_uri())
        page.wait_for_timeout(500.0)
        page.screenshot(path=picture)
        browser.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("report", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=860)
    given = parser.parse_args()
    main(given.report, given.picture, given.width, given.height)
