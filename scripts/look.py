"""Screenshots of what people see, into out/look/: reports of several robots, documents, the view.

`make look` runs it, after `make docs`. Every page is taken at 1280 and 390 px, light and dark, and
as on paper: the first screen and the whole page. Look at them before a change of a page is done.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import seaid
from scripts.identify_tulip_leg import (
    CAD,
    ENCODER_OFFSET_STD_RAD,
    TEST_MASS,
    experiment,
    load_leg,
    sensors,
)
from scripts.short_form import add_quick, few, is_quick, leg_plan

if TYPE_CHECKING:
    from playwright.sync_api import Browser

ROOT = Path(__file__).parents[1]
MODELS, LOGS = ROOT / "models", ROOT / "models" / "logs"
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
WEBGL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
DOCUMENTS = (
    *("index", "first_result", "paper", "warnings", "comparison", "drives"),
    *("experiment_design", "results", "how_to/ros2", "how_to/control"),
)
PLANS = ("plan", "validation_plan")
TALLEST_PX = 8_000
"""Height of a picture: below taller ones Chromium repeats the page from its top."""


@dataclass(frozen=True)
class Kind:
    """How a page is looked at."""

    name: str
    width: int
    height: int
    scheme: str = "light"
    is_paper: bool = False


KINDS = (
    Kind("1280_light", 1280, 800),
    Kind("1280_dark", 1280, 800, "dark"),
    Kind("390_light", 390, 844),
    Kind("390_dark", 390, 844, "dark"),
    Kind("paper", 700, 1000, is_paper=True),
)


def leg() -> tuple[seaid.Identification, seaid.Validation, seaid.Robot]:
    """Return the simulated TULip leg, and the leg of its drawing."""
    shipped = [seaid.load_trajectory(MODELS / f"tulip_{name}.json") for name in PLANS]
    plans = [leg_plan(), leg_plan()] if is_quick() else shipped
    log, other = (experiment((TEST_MASS,), plan, sensors(0), k) for k, plan in enumerate(plans))
    nominal = load_leg((TEST_MASS,), CAD)
    found = seaid.identify(nominal, log, feasible=True, encoder_offset_std=ENCODER_OFFSET_STD_RAD)
    return found, seaid.validate(found, other), nominal


def measured(
    robot: str, description: str, pattern: str
) -> tuple[seaid.Identification, seaid.Validation]:
    """Return a measured robot, identified from the first half of a log, validated on the rest."""
    model = seaid.load_robot(MODELS / f"{robot}.urdf", MODELS / f"{robot}.toml")
    path = min(LOGS.glob(pattern))
    log = seaid.read_log(path, model, description=LOGS / f"{description}.toml")
    middle = float(np.mean(log.time[[0, -1]]))
    found = seaid.identify(model, log.between(-np.inf, middle))
    return found, seaid.validate(found, log.between(middle, np.inf))


def write_pages(folder: Path) -> Iterator[Path]:
    """Write reports of several robots and a comparison; yield the pages."""
    found, result, nominal = leg()
    facts = {"Command": "seaid report tulip_leg.urdf --from run.csv --validate other.csv"}
    seaid.write_report(found, folder / "tulip_leg.html", result, facts=facts, nominal=nominal)
    yield folder / "tulip_leg.html"
    sets = (
        ("hebi_arm_3", "hebi_csv_3", "hebi_arms/ps4_*.npz"),
        ("hebi_arm_5", "hebi_csv_5", "hebi_arms/capstone_*.npz"),
        ("double_pendulum_a0", "double_pendulum_strong", "double_pendulum_a0/strong_torque/*.npz"),
    )
    for robot, description, pattern in few(sets):
        own, other = measured(robot, description, pattern)
        seaid.write_report(own, folder / f"{robot}.html", other)
        yield folder / f"{robot}.html"
    plan = leg_plan()
    again = experiment((TEST_MASS,), plan, sensors(9), 9)
    second = seaid.identify(load_leg((TEST_MASS,)).without_nominal(), again, feasible=True)
    seaid.report.write_comparison(
        found, second, folder / "leg_comparison.html", names=("Monday", "Friday")
    )
    yield folder / "leg_comparison.html"


def take(browser: Browser, page: Path, folder: Path, kinds: Sequence[Kind] = KINDS) -> None:
    """Take the first screen and the whole of a page in every kind."""
    for kind in kinds:
        size = {"width": kind.width, "height": kind.height}
        scheme = "dark" if kind.scheme == "dark" else "light"
        context = browser.new_context(viewport=size, color_scheme=scheme)  # type: ignore[arg-type]
        opened = context.new_page()
        if kind.is_paper:
            opened.emulate_media(media="print")
        opened.goto(page.as_uri())
        opened.wait_for_timeout(300.0)
        name = f"{page.stem}_{kind.name}"
        if not kind.is_paper:
            opened.screenshot(path=folder / f"{name}_first.png")
        opened.add_style_tag(content="main > section { content-visibility: visible !important; }")
        opened.wait_for_timeout(200.0)
        height = int(opened.evaluate("document.documentElement.scrollHeight"))
        for part, start in enumerate(range(0, height, TALLEST_PX)):
            clip = {"x": 0.0, "y": float(start), "width": float(kind.width)}
            clip["height"] = float(min(TALLEST_PX, height - start))
            path = folder / f"{name}{f'_{part}' if height > TALLEST_PX else ''}.png"
            opened.screenshot(path=path, full_page=True, clip=clip)  # type: ignore[arg-type]
        context.close()


def take_view(browser: Browser, folder: Path) -> None:
    """Take the view of the leg."""
    robot = load_leg((TEST_MASS,))
    plan = seaid.load_trajectory(MODELS / "tulip_plan.json")
    with seaid.view_robot(robot, {"plan": plan}, port=0) as shown:
        for kind in (KINDS[0], KINDS[2]):
            page = browser.new_page(viewport={"width": kind.width, "height": kind.height})
            page.goto(shown.url)
            page.locator("canvas").first.wait_for(timeout=60_000.0)
            page.wait_for_timeout(6000.0)
            for notice in page.locator(".mantine-Notification-closeButton").all():
                notice.click()  # that there is no graphics card
            page.screenshot(path=folder / f"view_{kind.name}.png")
            page.close()


def main(folder: Path, docs: Path) -> None:
    """Write all pages and their pictures."""
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        print("skipped: there is no Chromium: make look installs it")
        return
    from playwright.sync_api import sync_playwright

    folder.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox", *WEBGL])
        for page in few(write_pages(folder)):
            take(browser, page, folder, few(KINDS))
        for name in few(DOCUMENTS, 0):
            page = docs.resolve() / f"{name}.html"
            if page.exists():
                take(browser, page, folder, KINDS[:3])
            else:
                print(f"{page} is not there: make docs")
        if not is_quick():
            take_view(browser, folder)
        browser.close()
    print(f"{len(list(folder.glob('*.png')))} pictures: {folder}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "look")
    parser.add_argument("--docs", type=Path, default=ROOT / "out" / "docs")
    add_quick(parser)
    given = parser.parse_args()
    main(given.output.resolve(), given.docs)
