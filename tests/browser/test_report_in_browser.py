"""The report in a real browser: no error, no request, charts that answer, phone, dark, paper.

`make test-browser` runs these; screenshots go to out/browser/.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, sync_playwright

from seaid.report.html import write_report
from tests.report_pages import HOSTILE, arm_found, arm_result, made_up

pytestmark = pytest.mark.browser

PICTURES = Path(__file__).parents[2] / "out" / "browser"
LOAD_MS, PAGE_BYTES, PHONE_PX = 2000.0, 6_000_000, 390
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


class Opened:
    """A page of a report, with what went wrong in it."""

    def __init__(self, context: BrowserContext, path: Path) -> None:
        self.page: Page = context.new_page()
        self.wrong: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", self._note)
        self.page.on("pageerror", lambda problem: self.wrong.append(str(problem)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.as_uri(), wait_until="load")

    def _note(self, said: ConsoleMessage) -> None:
        if "getImageData" not in said.text:  # that is `ink` below
            self.wrong.append(f"{said.type}: {said.text}")

    def find(self, script: str, argument: Any = None) -> Any:
        """Return what a script finds in the page."""
        return self.page.evaluate(script, argument)

    def settle(self) -> None:
        """Wait for the next frames."""
        self.find("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 30)))")

    def ink(self, chart: str, variable: str) -> int:
        """Return how many pixels of a chart have a colour of the page."""
        count: int = self.find(
            """([id, name]) => {
              const css = getComputedStyle(document.documentElement).getPropertyValue("--" + name);
              const [r, g, b] = css.trim().match(/\\w\\w/g).map((one) => parseInt(one, 16));
              const canvas = document.querySelector(`#${id} canvas`);
              const { width, height } = canvas;
              const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
              let found = 0;
              for (let k = 0; k < data.length; k += 4) {
                const red = Math.abs(data[k] - r), green = Math.abs(data[k + 1] - g);
                const off = red + green + Math.abs(data[k + 2] - b);
                found += off < 30 && data[k + 3] > 200;
              }
              return found;
            }""",
            [chart, variable],
        )
        return count

    def ends(self, chart: str) -> list[float]:
        """Return where a chart's time begins and ends, as its legend says of both edges."""
        box = self.page.locator(f"#{chart} .u-over").bounding_box()
        assert box is not None
        said = []
        for share in (0.001, 0.999):
            self.page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
            self.settle()
            said.append(self.page.locator(f"#{chart} .u-series .u-value").first.inner_text())
        return [float(one) for one in said]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    found = [path for path in map(shutil.which, NAMES) if path]
    if not found:
        pytest.fail(f"none of {', '.join(NAMES)} is installed: `make test-browser` installs one")
    PICTURES.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found[0], args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def arm_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "report.html"
    write_report(arm_found(), [arm_result()], path, facts={"seed": 1})
    return path


@pytest.fixture
def opened(browser: Browser, arm_page: Path) -> Iterator[Opened]:
    """Return the arm's report on a desk; what went wrong in it fails the test."""
    context = browser.new_context(viewport={"width": 1200, "height": 900}, color_scheme="light")
    one = Opened(context, arm_page)
    one.page.locator("#viewer").scroll_into_view_if_needed()
    yield one
    assert one.wrong == []
    assert one.requests == [arm_page.as_uri()]
    context.close()


def load_ms(opened: Opened) -> float:
    found: float = opened.find("performance.getEntriesByType('navigation')[0].loadEventEnd")
    return found


def test_page_opens_fast_without_error_or_request(opened: Opened, arm_page: Path) -> None:
    assert load_ms(opened) < LOAD_MS
    assert arm_page.stat().st_size < PAGE_BYTES
    for chart in ("torque", "residual", "spectrum"):
        assert opened.page.locator(f"#{chart} canvas").count() == 1
    assert opened.ink("torque", "computed") > 100
    assert opened.ink("residual", "residual") > 100
    assert opened.ink("spectrum", "residual") > 50
    opened.page.screenshot(path=PICTURES / "light.png", full_page=True)


def test_click_on_a_name_in_the_legend_hides_its_trace_and_shows_it_again(opened: Opened) -> None:
    computed = opened.page.locator("#torque .u-series", has_text="computed")
    before = opened.ink("torque", "computed")
    computed.locator("th").click()
    opened.settle()
    assert opened.ink("torque", "computed") == 0
    assert opened.ink("torque", "measured") > 100
    opened.page.select_option("#joint", label="wrist")
    opened.settle()
    assert opened.ink("torque", "computed") == 0  # stays hidden with another joint
    computed.locator("th").click()
    opened.page.select_option("#joint", label="rail")
    opened.settle()
    assert opened.ink("torque", "computed") == pytest.approx(before, rel=0.2)


def test_drag_zooms_both_time_charts_and_a_double_click_goes_back(opened: Opened) -> None:
    whole = opened.ends("torque")
    box = opened.page.locator("#torque .u-over").bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    opened.page.mouse.move(box["x"] + 0.25 * box["width"], middle)
    opened.page.mouse.down()
    opened.page.mouse.move(box["x"] + 0.5 * box["width"], middle, steps=5)
    opened.page.mouse.up()
    opened.settle()
    length = whole[1] - whole[0]
    expected = [whole[0] + 0.25 * length, whole[0] + 0.5 * length]
    for chart in ("torque", "residual"):
        np.testing.assert_allclose(opened.ends(chart), expected, atol=0.02 * length)
    opened.page.screenshot(path=PICTURES / "zoomed.png")
    opened.page.select_option("#joint", label="wrist")  # the same stretch of another joint
    opened.settle()
    np.testing.assert_allclose(opened.ends("residual"), expected, atol=0.02 * length)
    opened.page.mouse.dblclick(box["x"] + 0.5 * box["width"], middle)
    opened.settle()
    for chart in ("torque", "residual"):
        np.testing.assert_allclose(opened.ends(chart), whole, atol=0.01 * length)


def test_selectors_change_motion_joint_and_side(opened: Opened) -> None:
    shown = opened.page.locator("#shown")
    assert "rail, load side, validation (unseen)" in shown.inner_text()
    options = opened.page.locator("#side option")
    assert options.nth(0).is_disabled()  # the rail is stiff: it has no actuator side
    opened.page.select_option("#joint", label="shoulder")
    opened.page.select_option("#side", value="actuator")
    assert "shoulder, actuator side, validation" in shown.inner_text()
    assert "the logged motor torque" in opened.page.locator("#source").inner_text()
    opened.page.select_option("#run", index=0)
    assert "own log (used for identification" in shown.inner_text()
    opened.page.select_option("#joint", label="wrist")  # stiff: falls back to the load side
    assert "wrist, load side, own log" in shown.inner_text()
    assert opened.page.locator("#side").input_value() == "load"


def test_map_reads_names_and_value_of_a_cell(opened: Opened) -> None:
    box = opened.page.locator("#map").bounding_box()
    assert box is not None
    opened.page.locator("#map").scroll_into_view_if_needed()
    opened.page.locator("#map").hover(position={"x": 255, "y": 25})
    said = opened.page.locator("#correlation").inner_text()
    assert said.startswith("coulomb friction of shoulder and viscous friction of shoulder: ")
    expected = arm_found().drives["shoulder"].correlation[0, 1]
    assert float(said.split(": ")[1].replace("−", "-")) == pytest.approx(expected, abs=0.006)


def test_dark_is_dark_and_the_button_turns_it(browser: Browser, arm_page: Path) -> None:
    context = browser.new_context(viewport={"width": 1200, "height": 900}, color_scheme="dark")
    opened = Opened(context, arm_page)
    paper = "getComputedStyle(document.body).backgroundColor"
    dark = opened.find(paper)
    assert max(int(one) for one in dark[4:-1].split(",")) < 50
    assert opened.ink("torque", "computed") > 100  # in the dark page's own colour
    opened.page.screenshot(path=PICTURES / "dark.png", full_page=True)
    opened.page.click("#theme")
    assert opened.find(paper) == "rgb(255, 255, 255)"
    opened.settle()
    assert opened.ink("torque", "computed") > 100
    opened.page.click("#theme")
    assert opened.find(paper) == dark
    assert opened.wrong == []
    context.close()


def test_phone_needs_no_sideways_scrolling(browser: Browser, arm_page: Path) -> None:
    context = browser.new_context(
        viewport={"width": PHONE_PX, "height": 844}, is_mobile=True, has_touch=True
    )
    opened = Opened(context, arm_page)
    assert opened.find("document.documentElement.scrollWidth") <= PHONE_PX
    assert opened.find("document.querySelector('#torque canvas').clientWidth") <= PHONE_PX
    opened.page.locator("#map").tap(position={"x": 255, "y": 25})
    assert "shoulder" in opened.page.locator("#correlation").inner_text()
    opened.page.screenshot(path=PICTURES / "phone.png", full_page=True)
    assert opened.wrong == []
    context.close()


def test_paper_has_everything_open_black_on_white(browser: Browser, arm_page: Path) -> None:
    context = browser.new_context(color_scheme="dark")
    opened = Opened(context, arm_page)
    opened.page.pdf(path=PICTURES / "report.pdf", format="A4")
    assert (PICTURES / "report.pdf").read_bytes().startswith(b"%PDF")
    opened.page.emulate_media(media="print")
    assert opened.find("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert opened.find("getComputedStyle(document.body).color") == "rgb(0, 0, 0)"
    assert not opened.page.locator("#viewer").is_visible()
    assert opened.page.locator(".picture svg").first.is_visible()
    opened.find("dispatchEvent(new Event('beforeprint'))")
    assert opened.page.locator("details:not([open])").count() == 0
    opened.find("dispatchEvent(new Event('afterprint'))")
    assert opened.page.locator("details[open]").count() == 0
    assert opened.wrong == []
    context.close()


def test_without_javascript_all_but_the_traces_is_there(browser: Browser, arm_page: Path) -> None:
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(arm_page.as_uri())
    assert page.get_by_text("Interactive traces need JavaScript").is_visible()
    assert not page.locator("#viewer").is_visible()
    assert page.locator(".picture svg").count() == 2
    assert page.locator("table").count() > 5
    context.close()


def test_hostile_names_are_text(browser: Browser, tmp_path: Path) -> None:
    found, result = made_up(tmp_path, HOSTILE)
    write_report(found, [result], tmp_path / "report.html", facts={"<b>who</b>": "</script>"})
    context = browser.new_context()
    opened = Opened(context, tmp_path / "report.html")
    alerts: list[str] = []
    opened.page.on("dialog", lambda dialog: alerts.append(dialog.message))
    options = opened.page.locator("#joint option")
    assert options.all_inner_texts() == list(HOSTILE)
    for place, name in enumerate(HOSTILE):
        opened.page.select_option("#joint", index=place)
        assert opened.page.locator("#shown").inner_text().startswith(f"{name}, load side")
        assert opened.page.get_by_text(name, exact=True).count() > 1
    assert opened.page.locator("b").count() == 0
    assert opened.page.locator("h1").inner_text() == "chain <i>"
    assert alerts == opened.wrong == []
    context.close()


def test_three_hundred_joints_open_fast(browser: Browser, tmp_path: Path) -> None:
    found, result = made_up(tmp_path, tuple(f"joint_{k:03d}" for k in range(300)), 20_000)
    path = tmp_path / "report.html"
    write_report(found, [result, result], path)
    assert path.stat().st_size < PAGE_BYTES
    context = browser.new_context(viewport={"width": 1200, "height": 900})
    opened = Opened(context, path)
    assert load_ms(opened) < LOAD_MS
    opened.page.select_option("#joint", label="joint_299")
    assert "joint_299, load side" in opened.page.locator("#shown").inner_text()
    assert opened.ink("torque", "computed") > 100
    assert opened.wrong == []
    context.close()
