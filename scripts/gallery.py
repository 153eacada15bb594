"""Pictures of README and documents: `make pictures`, or `python scripts/gallery.py [NAME ...]`.

Friction and excitation are of the simulated TULip leg, the spring is that of a HEBI module
(models/logs), and the robots are those of models/ and of example-robot-data. The figures of the
paper and the report of the leg are those of `make tulip`, the report of the arm is that of the
commands of the README. Robots, view and reports need Chromium and playwright (`make dev`,
`make test-browser`). The figures of benchmarks of hours are `scripts/coverage.py` and
`scripts/benchmarks/excitation_peer.py`.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

import seaid
from seaid._arrays import IndexArray
from seaid.excitation.limits import joint_limits
from seaid.log import in_band, low_pass, row_samples
from seaid.robot.inertia import in_parent_frame
from seaid.view.picture import aim, rest_posture, sphere_around

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.example_robots import example_urdf
from scripts.identify_tulip_leg import (
    LIMITS,
    TEST_MASS,
    experiment,
    load_leg,
    sensors,
    shipped_plan,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from playwright.sync_api import Browser, Page

ROOT = Path(__file__).resolve().parents[1]
MODELS = ROOT / "models"
BLUE, ORANGE, GREEN, GREY, INK = "#1f5fbf", "#c8600a", "#0b7d5c", "#8a949e", "#22272e"
POINTS = 400
"""Most points of a figure, which has about eighty bytes for each."""
SMOOTH_HZ, AT_REST_NM = 8.0, 1e-3
"""Low pass of the measured spring, and changes of its torque per sample that are rest."""


@cache
def identified() -> tuple[seaid.Robot, seaid.Log, seaid.Identification]:
    """Return the true leg, its noisy log, and what is identified from a wrong URDF and the log."""
    true = load_leg((TEST_MASS,))
    log = experiment((TEST_MASS,), shipped_plan(), sensors(1), seed=1)
    return true, log, seaid.identify(wrong(true), log, feasible=True)


def wrong(robot: seaid.Robot) -> seaid.Robot:
    """Return a robot as its first CAD model is: too light thigh and foot, and soft springs."""
    bodies = robot.parameters.reshape(-1, 10).copy()
    for link, factor, shift in (("thigh", 0.75, 0.04), ("foot", 0.7, -0.02)):
        body = robot.body_names.index(link)
        placement = pin.SE3(np.eye(3), np.array([0.02, 0.0, shift]))
        bodies[body] = factor * in_parent_frame(bodies[body], placement)
    drives = {
        joint: robot.drives[joint].with_values(
            {"stiffness": 0.85 * robot.drives[joint].values["stiffness"]}
        )
        for joint in robot.elastic_joints
    }
    return robot.with_values(bodies.ravel(), {**robot.drives, **drives})


@contextmanager
def figure(path: Path, width: float, height: float, **options: Any) -> Iterator[Any]:
    """Give the axes of an SVG file, which has no date."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    style: dict[Any, Any] = {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
    with mpl.rc_context({**style, "axes.edgecolor": GREY, "svg.hashsalt": path.stem}):
        drawn = Figure(figsize=(width, height), layout="constrained")
        yield drawn.subplots(**options)
        drawn.savefig(path, metadata={"Date": None})


def friction(path: Path) -> None:
    """Draw friction torque over motor speed: samples, identified and true curve."""
    true, _, found = identified()
    with figure(path, 4.6, 3.0) as axes:
        joint, motion = "hip_pitch", found.motions[0]
        drive, index = found.robot.drives[joint], found.robot.index(joint)
        lever = drive.motor_radius / drive.ratio
        stretch = lever * motion.motor_position - drive.load_radius * motion.joint_position
        value = found.drives[joint].value
        spring = value("stiffness") * stretch + value("spring_offset")
        assert drive.motor_inertia_kg_m2 is not None
        torque = motion.motor_torque - drive.motor_inertia_kg_m2 * motion.motor_acceleration
        samples = thinned(row_samples(motion))
        sample = in_band(motion, (torque - lever * spring)[:, index : index + 1])[samples, 0]
        speed = motion.motor_velocity[samples, index]
        ends = np.max(np.abs(speed)) * np.array([-1.0, 0.0, 0.0, 1.0])
        for robot, label, style in (
            (true, "true", {"color": ORANGE, "linewidth": 5.0, "alpha": 0.45}),
            (found.robot, "identified", {"color": INK, "linewidth": 1.2}),
        ):
            v = robot.drives[joint].values
            curve = v["viscous_friction"] * ends + v["coulomb_friction"] * np.array([-1, -1, 1, 1])
            axes.plot(ends, 1e3 * curve, label=label, **style)
        axes.plot(speed, 1e3 * sample, ".", color=BLUE, markersize=3, label="samples of the log")
        finish(axes, "speed of the motor [rad/s]", "friction [mN m]", f"Friction of {joint}")


def spring(path: Path) -> None:
    """Draw the torque of a measured spring with its gear over their deflection."""
    robot = seaid.load_robot(MODELS / "hebi_arm_2.urdf", MODELS / "hebi_arm_2.toml")
    logs = MODELS / "logs"
    log = seaid.read_log(
        logs / "hebi_arms" / "grav_comp_bad.npz", robot, description=logs / "hebi_csv_2.toml"
    )
    k = seaid.identify(robot, log).drives["joint_0"].value("stiffness")
    with figure(path, 4.6, 3.0) as axes:
        ratio, rate_hz = robot.drives["joint_0"].ratio, 1 / np.median(np.diff(log.time))
        behind = log.motor_position[:, 0] / ratio - log.joint_position[:, 0]
        assert log.joint_torque is not None
        both = np.column_stack([behind, log.joint_torque[:, 0]])
        stretch, torque = low_pass(both, rate_hz, SMOOTH_HZ).T
        stretch = stretch - np.mean(stretch) + np.mean(torque) / k
        change = np.gradient(torque)
        for sign, color, label in ((1, BLUE, "rising"), (-1, ORANGE, "falling")):
            part = thinned(np.flatnonzero(sign * change > AT_REST_NM))
            style = {"color": color, "markersize": 3, "label": f"measured, torque {label}"}
            axes.plot(1e3 * stretch[part], torque[part], ".", **style)
        ends = np.array([np.min(stretch), np.max(stretch)])
        text = f"identified, {k:.1f} N m/rad"
        axes.plot(1e3 * ends, k * ends, color=INK, linewidth=1.2, label=text)
        finish(
            axes, "deflection of spring and gear [mrad]", "torque [N m]", "Spring of a HEBI X5-4"
        )


def excitation(path: Path) -> None:
    """Draw the planned motion of the leg within its limits."""
    plan = seaid.load_trajectory(MODELS / "tulip_plan.json")
    limits = joint_limits(load_leg(()), LIMITS)
    time = np.linspace(0.0, plan.duration, 200)
    q = plan.sample(time)[0]
    with figure(path, 4.6, 4.4, nrows=q.shape[1], sharex=True) as axes:
        for index, (one, joint) in enumerate(zip(axes, plan.joint_names, strict=True)):
            one.axhspan(limits.lower[index], limits.upper[index], color=BLUE, alpha=0.08, lw=0)
            one.plot(time, q[:, index], color=BLUE, linewidth=1.3)
            one.set_ylabel(joint.replace("_", "\n"), rotation=0, ha="right", va="center")
        axes[0].set_title("Exciting motion of the TULip leg [rad], within its limits", fontsize=9)
        axes[-1].set_xlabel("time [s]")
        axes[-1].set_xlim(0.0, plan.duration)


def thinned(samples: IndexArray) -> IndexArray:
    """Return some of the samples, not more than a figure shows."""
    return samples[:: -(-len(samples) // POINTS)]


def finish(axes: Axes, x: str, y: str, title: str) -> None:
    """Add the words of a figure."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, fontsize=9)
    axes.grid(color="0.93")
    axes.legend(frameon=False, fontsize=8)


ROBOTS: tuple[tuple[str, str | Path, Path | None, float], ...] = (
    ("TULip leg, three springs", MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml", 0.4),
    ("HEBI arm, five springs", MODELS / "hebi_arm_5.urdf", MODELS / "hebi_arm_5.toml", 0.6),
    ("Franka Panda", "panda.urdf", None, 0.5),
    ("UR10", "ur10_robot.urdf", None, -0.8),
)
TILE_PX, ROOM = 440, 1.15
PATIENCE_MS = 180_000.0
"""How long a page may take to open on a busy machine."""


@contextmanager
def chromium() -> Iterator[Browser]:
    """Give a browser without a screen."""
    from playwright.sync_api import sync_playwright

    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    program = next(filter(None, map(shutil.which, names)), None)
    software = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=program, args=["--no-sandbox", *software]
        )
        yield browser
        browser.close()


def opened(browser: Browser, url: str, width: int, height: int) -> Page:
    """Return the page of a view, without the word of viser on graphics."""
    page = browser.new_page(viewport={"width": width, "height": height})
    page.goto(url)
    page.wait_for_selector("canvas")
    page.wait_for_timeout(4000.0)
    if (close := page.locator(".mantine-Notification-closeButton")).count():
        close.first.click()
        page.wait_for_timeout(1000.0)
    return page


def robots(path: Path) -> None:
    """Draw robots in the view, side by side."""
    from PIL import Image, ImageDraw, ImageFont

    whole = Image.new("RGB", (2 * TILE_PX, 2 * TILE_PX), "white")
    draw, font = ImageDraw.Draw(whole), ImageFont.load_default(17)
    with chromium() as browser:
        for number, (title, urdf, drives, turn) in enumerate(ROBOTS):
            robot = seaid.load_robot(example_urdf(urdf) if isinstance(urdf, str) else urdf, drives)
            with seaid.view_robot(robot, port=0) as view:
                posture = np.clip(rest_posture(robot) + turn, None, robot.upper_limits)
                for slider, value in zip(view.panel.inputs, posture, strict=True):
                    slider.value = round(float(value), 3)
                view.stage.show("names", False)
                page = opened(browser, view.url, TILE_PX + 345, TILE_PX)
                middle, radius = sphere_around(view.picture.outline(posture[None]))
                for client in view.server.get_clients().values():
                    window_px = TILE_PX + 345, TILE_PX
                    aim(client.camera, middle, ROOM * radius, view.picture.up, window_px)
                page.wait_for_timeout(2000.0)
                clip = {"x": 0, "y": 0, "width": TILE_PX, "height": TILE_PX}
                tile = Image.open(BytesIO(page.screenshot(clip=clip)))  # type: ignore[arg-type]
                page.close()
            corner = number % 2 * TILE_PX, number // 2 * TILE_PX
            whole.paste(tile, corner)
            draw.text((corner[0] + 14, corner[1] + 10), title, fill=INK, font=font)
    whole.save(path, optimize=True)


def view(path: Path) -> None:
    """Draw the view of the leg with its log, the nominal and the identified values."""
    from PIL import Image

    _, log, found = identified()
    plan = seaid.load_trajectory(MODELS / "tulip_plan.json")
    motions: dict[str, seaid.view.Shown] = {"run.csv": log, "plan.json": plan}
    nominal = wrong(load_leg((TEST_MASS,)))
    with (
        seaid.view_robot(nominal, motions, identified=found, port=0) as shown,
        chromium() as browser,
    ):
        shown.seek(4.0)
        page = opened(browser, shown.url, 1280, 790)
        picture = Image.open(BytesIO(page.screenshot())).convert("RGB")
    picture.save(path, optimize=True)


@cache
def main_job() -> Path:
    """Return the folder with what `make tulip` writes."""
    folder = Path(tempfile.mkdtemp())
    script = str(ROOT / "scripts" / "identify_tulip_leg.py")
    subprocess.run([sys.executable, script, "--output", str(folder)], check=True)
    return folder


def actuator_side(path: Path) -> None:
    """Draw Figure 3 of the paper."""
    shutil.copyfile(main_job() / path.name, path)


def load_side(path: Path) -> None:
    """Draw Figure 4 of the paper."""
    shutil.copyfile(main_job() / path.name, path)


def report(path: Path) -> None:
    """Draw the first screen of the report of the leg."""
    first_screen(main_job() / "report.html", path)


def report_hebi(path: Path) -> None:
    """Draw the first screen of the report of the arm of the README."""
    log = MODELS / "logs" / "hebi_arms" / "grav_comp_bad.npz"
    with tempfile.TemporaryDirectory() as folder:
        for words in (
            ("init", MODELS / "hebi_arm_2.urdf", log, "--folder", folder),
            ("run", folder),
        ):
            subprocess.run([sys.executable, "-m", "seaid", *map(str, words)], check=True)
        first_screen(Path(folder) / "runs" / "latest" / "report.html", path)


def first_screen(page: Path, path: Path) -> None:
    """Draw the first screen of a page, in light, and in dark next to the style of the site.

    The description of the picture has its words for tests to read.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    dark = path.parent / "_static" / f"{path.stem}_dark.png"
    dark.parent.mkdir(exist_ok=True)
    with chromium() as browser:
        for scheme, name in (("light", path), ("dark", dark)):
            shown = browser.new_page(viewport={"width": 1280, "height": 800})
            shown.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
            shown.goto(page.as_uri(), timeout=PATIENCE_MS)
            shown.wait_for_timeout(500.0)
            picture = Image.open(BytesIO(shown.screenshot())).convert("RGB")
            words = PngInfo()
            words.add_itxt("Description", shown.inner_text(".verdict") + shown.inner_text(".first"))
            picture.save(name, optimize=True, pnginfo=words)
            shown.close()


PICTURES = {
    friction: "_static/gallery/friction.svg",
    spring: "_static/gallery/spring.svg",
    excitation: "_static/gallery/excitation.svg",
    robots: "_static/gallery/robots.png",
    view: "view.png",
    actuator_side: "actuator_side.png",
    load_side: "load_side.png",
    report: "report.png",
    report_hebi: "report_hebi.png",
}
"""{function that draws: file in docs/}."""


def main(names: list[str], output: Path) -> None:
    """Draw the pictures of these names, all without any."""
    for draw, file in PICTURES.items():
        if not names or draw.__name__ in names:
            (output / file).parent.mkdir(parents=True, exist_ok=True)
            draw(output / file)
            print(output / file)


if __name__ == "__main__":
    warnings.simplefilter("ignore", seaid.errors.SeaidWarning)
    parser = argparse.ArgumentParser(description=__doc__)
    choices = [draw.__name__ for draw in PICTURES]
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(choices))
    parser.add_argument("--output", type=Path, default=ROOT / "docs", help="default: docs/")
    given = parser.parse_args()
    if unknown := set(given.names) - set(choices):
        parser.error(f"no picture is named {', '.join(sorted(unknown))}")
    main(given.names, given.output)
