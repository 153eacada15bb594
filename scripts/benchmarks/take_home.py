"""Waiting times: import, identification and report by command, and the report in a browser.

The script needs the files of `make tulip` and Chromium. Times are medians of three.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import seaid
from scripts.identify_tulip_leg import TEST_MASS, experiment, sensors
from scripts.short_form import add_quick, leg_plan, sized
from seaid.report import table

MODELS = Path(__file__).resolve().parents[2] / "models"
RUNS = sized(3, 1)
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
IMPORT = (
    "import time; begin = time.perf_counter(); import seaid; print(time.perf_counter() - begin)"
)


def main(logs: Path) -> None:
    """Print targets and measurements."""
    run, other = logs / "identification_log.csv", logs / "validation_log.csv"
    for path in (run, other):
        if not path.exists():
            print(f"skipped: '{path}' is not there: run make tulip first, or name its --logs")
            return
    leg = ["--drives", str(MODELS / "tulip_leg.toml"), "--payload", "foot:2.0:0.15,0,0"]
    urdf = str(MODELS / "tulip_leg.urdf")
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        identify = ["identify", urdf, str(run), *leg, "-o", str(Path(folder) / "found.json")]
        report = ["report", urdf, "--from", str(run), "--validate", str(other), *leg]
        report += ["-o", str(page)]
        identified, reported = (median(partial(command, words)) for words in (identify, report))
        rows = [
            ["import seaid", "1 s", seconds(median(imported))],
            ["seaid --help", "", seconds(median(lambda: command(["--help"])))],
            ["seaid identify (TULip log, 10 s)", "", seconds(identified)],
            ["seaid identify, then seaid report", "20 s", seconds(identified + reported)],
            ["size of the report", "6 MB", f"{page.stat().st_size / 1e6:.2f} MB"],
            ["report opened in Chromium", "2 s", opened(page)],
        ]
    print(table("Waiting times", ["", "wanted, below", "measured"], rows))


def write_logs(folder: Path) -> None:
    """Write two logs of the short form."""
    for seed, name in enumerate(("identification", "validation")):
        log = experiment((TEST_MASS,), leg_plan(), sensors(seed), seed)
        seaid.write_log(log, folder / f"{name}_log.csv")


def median(measure: Callable[[], float]) -> float:
    """Return the median of several measurements."""
    return statistics.median(measure() for _ in range(RUNS))


def seconds(value: float) -> str:
    """Return a time as text."""
    return f"{value:.2g} s"


def imported() -> float:
    """Return the time of `import seaid` in a new process [s], by its own clock."""
    done = subprocess.run([sys.executable, "-c", IMPORT], check=True, capture_output=True)
    return float(done.stdout)


def command(words: Sequence[str]) -> float:
    """Return the time of a command of `seaid` as a process [s]."""
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "seaid", *words, *(["--force"] if len(words) > 1 else [])],
        check=True,
        capture_output=True,
    )
    return time.perf_counter() - begin


def opened(page: Path) -> str:
    """Return the time that Chromium takes to load a page, or that there is no Chromium."""
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        return "no Chromium: make test-browser installs it"
    return seconds(median(lambda: loaded(page, program)))


def loaded(page: Path, program: str) -> float:
    """Return the time that a browser takes to load a page [s]."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        tab = browser.new_page()
        begin = time.perf_counter()
        tab.goto(page.as_uri(), wait_until="load")
        took = time.perf_counter() - begin
        browser.close()
    return took


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--logs", type=Path, default=Path("out/tulip_leg"), help="folder of make tulip"
    )
    add_quick(parser)
    given = parser.parse_args()
    if given.quick:
        with tempfile.TemporaryDirectory() as short:
            write_logs(Path(short))
            main(Path(short))
    else:
        main(given.logs)
