"""The report in a real browser: no error, no request, charts that answer, phone, dark, paper.

`make test-browser` runs these; screenshots go to out/browser/.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Locator, Page

from seaid.errors import Finding
from seaid.report import write_comparison, write_report
from tests.browser.conftest import PICTURES
from tests.experiments import arm, arm_found, arm_result
from tests.report_pages import HOSTILE, made_up

pytestmark = pytest.mark.browser

PAGE_BYTES, PHONE_PX = 6_000_000, 390
# How fast the browser of this machine is: a page of as many cells as a report of 300 joints has.
ROW = "<tr>" + "<td><span>1.000 ± 0.001</span>" * 8
YARDSTICK = f'<!doctype html><meta charset="utf-8"><table>{ROW * 4_000}</table>'
MOST_OF_YARDSTICK = 1.25  # 300 joints take 0.7 of it, 0.9 beside three other processes
WIDTHS = (320, 390, 600, 768, 900, 1040, 1100, 1280, 1600)
REMEDY = 'in the drives file:\n[shoulder]\ngear_ratio = 100.0\nspring = ["linear"]'


class Opened:
    """A page of a report, with what went wrong in it."""

    def __init__(self, context: BrowserContext, path: Path) -> None:
        self.page: Page = context.new_page()
        self.wrong: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", self._note)
        self.page.on("pageerror", lambda problem: self.wrong.append(str(problem)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        # Processor time of the page's main thread; a clock shows the other work of the machine too.
        session = context.new_cdp_session(self.page)
        session.send("Performance.enable", {"timeDomain": "threadTicks"})
        self.page.goto(path.as_uri(), wait_until="load")
        metrics = session.send("Performance.getMetrics")["metrics"]
        self.load_s = next(float(row["value"]) for row in metrics if row["name"] == "ThreadTime")
        session.detach()

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
def arm_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "report.html"
    facts = {"seed": "1", "Command": "seaid report arm.urdf --from run.csv"}
    write_report(arm_found(), path, [arm_result()], facts=facts, nominal=arm())
    return path


@pytest.fixture(scope="module")
def doubtful_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a report with a wrong gear ratio and a doubtful fit."""
    findings = (
        Finding("gear-ratio", "the ratio is off", "shoulder", "wrong", remedy=REMEDY),
        Finding("no-fit", "nothing fits", "wrist", "doubtful", remedy="record a longer motion"),
        Finding("holes", "samples are excluded", severity="note"),
    )
    path = tmp_path_factory.mktemp("doubtful") / "report.html"
    write_report(replace(arm_found(), findings=findings), path, [arm_result()], nominal=arm())
    return path


@contextmanager
def visit(browser: Browser, path: Path, width: int = 1200, **options: Any) -> Iterator[Opened]:
    """Open a page; what went wrong in it, or what it requested, fails the test."""
    context = browser.new_context(viewport={"width": width, "height": 900}, **options)
    page = Opened(context, path)
    yield page
    assert page.wrong == []
    assert page.requests == [path.as_uri()]
    context.close()


@pytest.fixture
def most_load_s(browser: Browser, tmp_path: Path) -> float:
    """Return how long a report may take to open: a multiple of the yardstick, the best of two."""
    path = tmp_path / "yardstick.html"
    path.write_text(YARDSTICK)
    times = []
    for _ in range(2):
        with visit(browser, path) as yardstick:
            times.append(yardstick.load_s)
    return MOST_OF_YARDSTICK * min(times)


@pytest.fixture
def opened(browser: Browser, arm_page: Path) -> Iterator[Opened]:
    """Return the arm's report on a desk, at its traces."""
    with visit(browser, arm_page, color_scheme="light") as page:
        for _ in range(2):  # the sections above get their true height
            page.find("document.querySelector('#viewer').scrollIntoView({ behavior: 'instant' })")
            page.settle()
        yield page


def test_page_opens_fast_without_error_or_request(
    opened: Opened, arm_page: Path, most_load_s: float
) -> None:
    assert opened.load_s < most_load_s
    assert arm_page.stat().st_size < PAGE_BYTES
    charts = "torque", "residual", "spectrum", "over-velocity", "over-position"
    for chart in charts:
        assert opened.page.locator(f"#{chart} canvas").count() == 1
    for chart in charts[3:]:
        assert opened.ink(chart, "residual") > 50
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


def downloaded(opened: Opened, place: Locator, folder: Path) -> Path:
    """Return the file that a click downloads."""
    with opened.page.expect_download() as waiting:
        place.click()
    path = folder / waiting.value.suggested_filename
    waiting.value.save_as(path)
    return path


def test_tables_are_copied_as_csv_and_latex(opened: Opened, tmp_path: Path) -> None:
    """The CSV has the exact values; the page shows rounded ones."""
    table = opened.page.locator(".table[data-name=drives]")
    path = downloaded(opened, table.get_by_text("CSV"), tmp_path)
    assert path.name == "mixed_arm_drives.csv"
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
    expected = [
        (joint, name.replace("_", " "), value, error)
        for joint, one in arm_found().drives.items()
        for name, value, error in zip(one.names, one.values, one.standard_errors, strict=True)
    ]
    read = [
        (row["Joint"], row["Parameter"], float(row["Identified"]), float(row["Std. error"]))
        for row in rows
    ]
    assert read == expected
    text = downloaded(opened, table.get_by_text("LaTeX"), tmp_path).read_text(encoding="utf-8")
    assert "\\begin{tabular}{llrrrrlrrl}" in text
    assert text.count(r"\\") == len(rows) + 1
    assert r"$\cdot 10^{-5}$" in text
    assert text.isascii()


def top(opened: Opened, selector: str) -> float:
    """Return where an element begins, in pixels from the top of the page."""
    found: float = opened.find(
        "(one) => document.querySelector(one).getBoundingClientRect().top + scrollY", selector
    )
    return found


COLOUR = """([name, kind, variable]) => {
  const one = getComputedStyle(document.querySelector(name))[kind];
  const [r, g, b] = getComputedStyle(document.documentElement).getPropertyValue("--" + variable)
    .match(/\\w\\w/g);
  return [one, `rgb(${[r, g, b].map((part) => parseInt(part, 16)).join(", ")})`];
}"""
"""What finds the colour of an element, and the one that the page names."""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_first_screen_has_verdict_robot_before_and_after_and_warnings(
    browser: Browser, doubtful_page: Path, scheme: Any
) -> None:
    """In the colours of the scheme, which the button turns; a remedy is copied as it stands."""
    permissions = ["clipboard-read", "clipboard-write"]
    with visit(
        browser, doubtful_page, 1280, color_scheme=scheme, permissions=permissions
    ) as opened:
        for selector in (".verdict .words", "svg.robot .joint", ".bars li", "#warnings h2"):
            assert top(opened, selector) < 800
        assert opened.page.locator(".verdict .words").inner_text() == "Do not use"
        for name, kind, variable in (
            (".verdict .words", "color", "bad"),
            (".notice.doubtful", "backgroundColor", "care-paper"),
        ):
            found = opened.find(COLOUR, [name, kind, variable])
            assert found[0] == found[1]
        assert opened.page.locator("svg.robot .joint").count() == 4
        assert opened.page.locator("svg.robot tspan.flag").count() == 2  # shoulder and wrist
        assert opened.page.locator(".bars .before").count() == 6
        opened.page.screenshot(path=PICTURES / f"first_{scheme}.png")
        opened.page.locator(".notice.wrong .copy").click()
        opened.page.locator(".notice.wrong .copy", has_text="Copied").wait_for(timeout=5000)
        assert opened.find("navigator.clipboard.readText()") == REMEDY.partition("\n")[2]
        for is_dark in (scheme == "dark", scheme == "light"):
            paper = opened.find("getComputedStyle(document.body).backgroundColor")
            assert (max(int(one) for one in paper[4:-1].split(",")) < 50) == is_dark
            opened.page.locator("#torque").scroll_into_view_if_needed()
            opened.settle()
            assert opened.ink("torque", "computed") > 100  # in the page's own colour
            opened.page.click("#theme")


def cut(opened: Opened) -> list[str]:
    """Return what is wider than the page, or than its place."""
    found: list[str] = opened.find(
        """() => {
          const room = document.documentElement.clientWidth + 0.5;
          const kinds = "table, .table th, .table td, .bars li, .notice, .code, .plot, dl, h1, h2";
          const wrong = [...document.querySelectorAll(`${kinds}, svg.robot`)].filter((one) => {
            const head = getComputedStyle(one.closest("thead") ?? one);
            const box = one.getBoundingClientRect();
            if (head.position === "absolute" || !box.width || one.closest(".uplot")) return false;
            return box.right > room || box.left < -0.5 || one.scrollWidth > box.width + 1.5;
          });
          return wrong.map((one) => `${one.tagName} ${one.textContent.slice(0, 40)}`);
        }"""
    )
    return found


LONG_NUMBERS = "(one) => { one.textContent = '2.9·10⁻³ % → 1.3·10⁻⁴ %'; }"
"""Errors before and after of a log without noise."""


@pytest.mark.parametrize("kind", ["arm", "hostile", "comparison"])
def test_nothing_is_cut_at_any_width(
    browser: Browser, arm_page: Path, tmp_path: Path, kind: str
) -> None:
    """Neither on a phone, nor with names of any length, nor in a comparison."""
    path = arm_page if kind == "arm" else tmp_path / "report.html"
    if kind == "hostile":
        found, result = made_up(tmp_path, (*HOSTILE, "long_" * 60), 1000)
        write_report(found, path, [result], facts={"x" * 200: "y" * 400})
    elif kind == "comparison":
        other = replace(arm_found().load, values=1.2 * arm_found().load.values)
        names = ("cold", "warm")
        write_comparison(arm_found(), replace(arm_found(), load=other), path, names=names)
    with visit(browser, path, 1280) as opened:
        style = "main > section { content-visibility: visible !important; }"
        opened.page.add_style_tag(content=style)
        opened.find(f"document.querySelectorAll('.bars .numbers').forEach({LONG_NUMBERS})")
        for width in WIDTHS:
            opened.page.set_viewport_size({"width": width, "height": 800})
            opened.settle()
            assert opened.find("document.documentElement.scrollWidth") <= width
            assert cut(opened) == [], width
        if kind == "comparison":
            assert "parameters differ" in opened.page.locator(".verdict .words").inner_text()
            place = opened.page.locator("[data-copy=csv]")
            assert downloaded(opened, place, tmp_path).name == "mixed_arm_comparison.csv"


def test_a_phone_shows_the_verdict_and_the_traces(browser: Browser, arm_page: Path) -> None:
    with visit(browser, arm_page, PHONE_PX, is_mobile=True, has_touch=True) as opened:
        assert top(opened, ".verdict .words") < 300
        assert top(opened, "svg.robot") < 600
        opened.page.locator("#torque").scroll_into_view_if_needed()
        assert opened.find("document.querySelector('#torque canvas').clientWidth") <= PHONE_PX
        opened.page.screenshot(path=PICTURES / "phone.png", full_page=True)


def test_paper_has_everything_open_black_on_white(browser: Browser, arm_page: Path) -> None:
    """Copies of the traces are for paper only, and details are closed again after it."""
    with visit(browser, arm_page, color_scheme="dark") as opened:
        page = opened.page
        assert not page.locator(".static").is_visible()
        page.pdf(path=PICTURES / "report.pdf", format="A4")
        page.emulate_media(media="print")
        page.set_viewport_size({"width": 700, "height": 1000})  # that of A4 between margins
        for kind, colour in (("backgroundColor", "255, 255, 255"), ("color", "0, 0, 0")):
            assert opened.find(f"getComputedStyle(document.body).{kind}") == f"rgb({colour})"
        assert not page.locator("#viewer").is_visible()
        assert page.locator(".static figure").count() == 6
        assert page.locator(".static svg").first.is_visible()
        assert page.locator("button:visible").count() == 0
        opened.find("dispatchEvent(new Event('beforeprint'))")
        assert page.locator("details:not([open])").count() == 0
        assert cut(opened) == []
        opened.find("dispatchEvent(new Event('afterprint'))")
        assert page.locator("details[open]").count() == 0


def test_without_javascript_all_but_the_traces_is_there(browser: Browser, arm_page: Path) -> None:
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(arm_page.as_uri())
    assert page.get_by_text("Interactive traces need JavaScript").is_visible()
    assert not page.locator("#viewer").is_visible()
    assert page.locator(".static svg").first.is_visible()
    assert page.locator("table").count() > 5
    assert page.locator(".actuator svg.plot").count() == 6
    assert page.locator("button:visible").count() == 0
    context.close()


def test_hostile_names_are_text(browser: Browser, tmp_path: Path) -> None:
    """Nothing of them is run, and each can be chosen."""
    found, result = made_up(tmp_path, HOSTILE)
    path, alerts = tmp_path / "report.html", []
    write_report(found, path, [result], facts={"<b>who</b>": "</script>"})
    with visit(browser, path) as opened:
        opened.page.on("dialog", lambda dialog: alerts.append(dialog.message))
        assert opened.page.locator("#joint option").all_inner_texts() == list(HOSTILE)
        for place, name in enumerate(HOSTILE):
            opened.page.select_option("#joint", index=place)
            assert opened.page.locator("#shown").inner_text().startswith(f"{name}, load side")
            assert opened.page.get_by_text(name, exact=True).count() > 1
        assert opened.page.locator("b").count() == 0
        assert opened.page.locator("h1").inner_text() == "chain <i>"
    assert alerts == []


def test_three_hundred_joints_open_fast(
    browser: Browser, tmp_path: Path, most_load_s: float
) -> None:
    """In the time and the size of a page of four."""
    found, result = made_up(tmp_path, tuple(f"joint_{k:03d}" for k in range(300)), 20_000)
    path = tmp_path / "report.html"
    write_report(found, path, [result, result])
    assert path.stat().st_size < PAGE_BYTES
    with visit(browser, path) as opened:
        assert opened.load_s < most_load_s
        opened.page.select_option("#joint", label="joint_299")
        assert "joint_299, load side" in opened.page.locator("#shown").inner_text()
        assert opened.ink("torque", "computed") > 100
