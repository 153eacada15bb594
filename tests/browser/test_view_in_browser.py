"""The view in a real browser: it loads without error or a foreign request, and moves.

`make test-browser` runs these; screenshots go to out/browser/.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin
import pytest
from playwright.sync_api import Browser, ConsoleMessage, Locator, Page, Request

from seaid.robot.inertia import in_parent_frame
from seaid.view import Shown, View, view_robot
from tests import experiments
from tests.browser.conftest import PICTURES
from tests.experiments import TEST_MASS
from tests.view.motions import log_of, plan_of

pytestmark = pytest.mark.browser

PATIENCE_MS = 60_000.0


@pytest.fixture(scope="module")
def view() -> Iterator[View]:
    """Return a view of a log and a plan whose names a browser could take for markup."""
    leg = experiments.leg(TEST_MASS)
    bodies = leg.parameters.reshape(-1, 10)
    moved = pin.SE3(np.eye(3), np.array([0.02, 0.01, -0.03]))
    values = 1.1 * np.array([in_parent_frame(one, moved) for one in bodies])
    values[1, 4] = -1.0  # no body can be that
    identified = leg.with_values(values.ravel(), leg.drives)
    motions: dict[str, Shown] = {"<i>run</i>": log_of(leg), "plan {1}": plan_of(leg)}
    with view_robot(leg, motions, identified=identified, port=0) as shown:
        yield shown


@pytest.fixture(scope="module")
def wrong() -> list[str]:
    """Return what went wrong in the page, and what it asked for elsewhere."""
    return []


def opened_page(browser: Browser, view: View, wrong: list[str], width: int, height: int) -> Page:
    """Return the page of the view in a window of this size, without viser's word on graphics."""

    def said(message: ConsoleMessage) -> None:
        if message.type == "error":
            wrong.append(message.text)

    def asked(request: Request) -> None:
        if not request.url.startswith((view.url, "data:", "blob:")):
            wrong.append(f"request of {request.url}")

    opened = browser.new_page(viewport={"width": width, "height": height})
    opened.set_default_timeout(PATIENCE_MS)
    opened.on("console", said)
    opened.on("pageerror", lambda problem: wrong.append(str(problem)))
    opened.on("request", asked)
    opened.goto(view.url)
    opened.wait_for_selector("canvas")
    opened.get_by_text("tulip_leg").first.wait_for()
    notice = opened.locator(".mantine-Notification-closeButton")
    opened.wait_for_timeout(1000)
    if notice.count():
        notice.first.click()
    return opened


@pytest.fixture(scope="module")
def page(drawing_browser: Browser, view: View, wrong: list[str]) -> Page:
    return opened_page(drawing_browser, view, wrong, 1280, 800)


def wait_until(page: Page, condition: Callable[[], bool]) -> None:
    """Wait until the server has heard what the page did, and fail when it does not."""
    for _ in range(int(PATIENCE_MS / 100.0)):
        if condition():
            return
        page.wait_for_timeout(100)
    raise AssertionError("the page did not come to this")


def drawn(page: Page, name: str, other_than: bytes = b"") -> bytes:
    """Return a screenshot of the scene once it stands still and is another than this picture."""
    clip = {"x": 400.0, "y": 0.0, "width": 500.0, "height": 800.0}  # without panels
    before = b""
    for _ in range(40):
        page.wait_for_timeout(500)
        now = page.screenshot(clip=clip, timeout=PATIENCE_MS)  # type: ignore[arg-type]
        if now == before != other_than:
            break
        before = now
    page.screenshot(path=PICTURES / f"view_{name}.png", timeout=PATIENCE_MS)
    return before


def chosen(page: Page, value: str) -> Locator:
    """Return the box of a choice that shows a value."""
    boxes = page.locator("input.mantine-Select-input").all()
    return next(box for box in boxes if box.input_value() == value)


def test_page_shows_the_robot_and_what_time_it_is(page: Page, view: View, wrong: list[str]) -> None:
    assert page.locator("canvas").count() >= 1
    assert page.get_by_text("Spring deflection about its mean").is_visible()
    assert page.get_by_text("tulip_leg").is_visible()
    limit = 1e3 * float(np.max(view.panel.limits))
    assert page.get_by_text(f"±{limit:.3g} mrad").is_visible()
    view.seek(0.0)
    start = drawn(page, "start")
    view.seek(0.5)
    assert drawn(page, "seek", start) != start
    assert wrong == []


def test_buttons_and_choices_of_the_page_move_the_robot(
    page: Page, view: View, wrong: list[str]
) -> None:
    view.pause()
    view.seek(0.0)
    page.get_by_role("button", name="Play").click()
    page.get_by_role("button", name="Pause").wait_for()
    wait_until(page, lambda: view.time > 0.0)
    page.get_by_role("button", name="Pause").click()
    page.get_by_role("button", name="Play").wait_for()
    chosen(page, "<i>run</i>").click()
    page.get_by_role("option", name="plan {1}").click()
    wait_until(page, lambda: view.playback is view.playbacks[1])
    assert page.get_by_text("deflections are those of the nominal model").is_visible()
    assert chosen(page, "plan {1}").is_visible()
    assert wrong == []


def test_plots_and_bodies_are_there(page: Page, view: View, wrong: list[str]) -> None:
    view.show("<i>run</i>")
    view.seek(0.7)
    view.panel.joint.value = "knee_pitch"
    page.get_by_text("spring deflection of knee_pitch [mrad]").wait_for()
    assert page.locator(".uplot canvas").count() >= 1
    for name in ("motion", "identified", "compared"):
        assert page.get_by_text(name).locator("visible=true").count() >= 1
    before = drawn(page, "bodies")
    page.get_by_label("identified").first.uncheck()
    assert drawn(page, "nominal", before) != before
    page.get_by_label("identified").first.check()
    assert wrong == []


def test_small_page_has_its_controls_below_the_robot(
    drawing_browser: Browser, view: View, wrong: list[str]
) -> None:
    """At 390 px nothing is wider than the page, the panel collapses, and the plots open."""
    small = opened_page(drawing_browser, view, wrong, 390, 844)
    play = small.get_by_role("button", name="Play")
    box = play.bounding_box()
    assert box is not None
    assert 0 <= box["x"] < box["x"] + box["width"] <= 390
    assert box["y"] > 0.4 * 844  # the robot is above
    small.screenshot(path=PICTURES / "view_390.png")
    assert small.evaluate("document.documentElement.scrollWidth") <= 390
    plots = small.get_by_role("button", name="Expand panel Plots")
    plots.scroll_into_view_if_needed()
    plots.click()
    chart = small.locator(".uplot canvas").first
    chart.wait_for()
    small.wait_for_timeout(1000)  # the plot is drawn anew in the width of the open panel
    chart.scroll_into_view_if_needed()
    small.wait_for_timeout(500)
    wide = chart.bounding_box()
    assert wide is not None
    assert 200 < wide["width"] <= 320
    small.screenshot(path=PICTURES / "view_390_plots.png")
    small.mouse.move(200, 700)
    small.mouse.wheel(0, -5000)
    small.wait_for_timeout(300)
    small.get_by_text("tulip_leg").click()  # the head of the panel
    small.wait_for_timeout(600)
    assert not play.is_visible() or (play.bounding_box() or box)["y"] > 844 - 60
    small.screenshot(path=PICTURES / "view_390_collapsed.png")
    small.get_by_text("tulip_leg").click()
    small.wait_for_timeout(600)
    play.click(trial=True)
    small.close()
    assert wrong == []
