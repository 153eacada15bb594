"""Fixtures for all tests: robots as files, and hypothesis made repeatable."""

from __future__ import annotations

import gc
import warnings
from collections.abc import Callable, Generator, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

from scripts.example_robots import example_urdfs
from seaid.errors import SeaidWarning
from seaid.legged import load_robot
from seaid.robot import Robot
from tests.plants import body

if TYPE_CHECKING:
    from seaid.checks.columns import Side
    from seaid.checks.model import SideSelection

MODELS = Path(__file__).parents[1] / "models"

settings.register_profile("seaid", derandomize=True, deadline=None, max_examples=25, database=None)
settings.register_profile("quick", settings.get_profile("seaid"), max_examples=10)
settings.load_profile("seaid")


def pytest_configure(config: pytest.Config) -> None:
    """Try fewer examples of each property in the quick tests."""
    if "not slow" in config.getoption("markexpr"):
        settings.load_profile("quick")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep what is collected out of the garbage collector's way.

    Modules and thousands of tests live until the end: looking through them, again and again, took
    a tenth of the time of the quick tests.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


QUICK_ROBOTS = ("double_pendulum", "panda", "solo12", "ur10_robot", "xarm7")
"""Chains and trees, revolute and prismatic, with and without mimic joints; all others are slow."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that takes `example_urdf` for every loadable robot of example-robot-data."""
    if "example_urdf" in metafunc.fixturenames:
        robots = [
            pytest.param(
                path, id=path.stem, marks=() if path.stem in QUICK_ROBOTS else pytest.mark.slow
            )
            for path in example_urdfs()
        ]
        metafunc.parametrize("example_urdf", robots)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what reads .hebilog files without HEBI's reader; begin with statistics over many draws.

    A test of minutes that is the last one of a process keeps the other processes waiting.
    """
    items.sort(key=lambda item: "as_large_as_the_standard_errors" not in item.name)
    if find_spec("hebi") is None:
        skip = pytest.mark.skip(
            reason="reads a .hebilog, for which hebi-py is built: make test-hebi"
        )
        for item in items:
            if item.get_closest_marker("hebi"):
                item.add_marker(skip)


DESELECTED_SLOW = pytest.StashKey[int]()


def pytest_deselected(items: Sequence[pytest.Item]) -> None:
    """Count the slow tests that are not run."""
    for item in items:
        if item.get_closest_marker("slow"):
            item.config.stash[DESELECTED_SLOW] = item.config.stash.get(DESELECTED_SLOW, 0) + 1


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Hand the count from a worker of pytest-xdist to the process that reports."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["slow"] = session.config.stash.get(DESELECTED_SLOW, 0)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Take the count of a worker; all workers collect the same tests."""
    node.config.stash[DESELECTED_SLOW] = getattr(node, "workeroutput", {}).get("slow", 0)


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Say at the end how many slow tests were not run."""
    count = config.stash.get(DESELECTED_SLOW, 0)
    if count and "not slow" in config.getoption("markexpr"):
        terminalreporter.write_line(f"{count} slow tests were deselected: make test-all runs them")


@pytest.fixture(scope="session")
def example_path() -> Callable[[str], Path]:
    """Return a function from a file name, as 'ur10_robot.urdf', to its path."""
    return lambda name: next(path for path in example_urdfs() if path.name == name)


@pytest.fixture(scope="session")
def load_quietly() -> Callable[..., Robot]:
    """Return load_robot without warnings of rounded angles, and with independent mimic joints."""

    @cache
    def load(*arguments: object, **options: object) -> Robot:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeaidWarning)
            return load_robot(*arguments, **{"independent_mimics": True, **options})  # type: ignore[arg-type]

    return load


@pytest.fixture(scope="session")
def tulip_urdf() -> Path:
    return MODELS / "tulip_leg.urdf"


@pytest.fixture(scope="session")
def tulip_leg(tulip_urdf: Path) -> Robot:
    """Return the TULip leg with its nominal drives."""
    return load_robot(tulip_urdf, drives=MODELS / "tulip_leg.toml")


@pytest.fixture(scope="session")
def urdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the file of the arm that commands move, of tests/commanded_joint.py."""
    from tests.commanded_joint import URDF

    path = tmp_path_factory.mktemp("commands") / "one.urdf"
    path.write_text(URDF)
    return path


@pytest.fixture
def estimates_only(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Leave out findings that need fits or spectra of their own, for tests of estimates.

    They take up to half of the time of `identify`, and change no estimate: test_two_step.py.
    Terms are selected only where nobody named those of a drive, which may add one to it. A test
    marked `findings` keeps them, in a module whose other tests leave them out.
    """
    if request.node.get_closest_marker("findings"):
        return
    from seaid.checks.model import selections
    from seaid.drives.drives import DefaultTerms

    names = ("problem", "checking", "conclusion")
    problem, checking, conclusion = (f"seaid.identification.{name}" for name in names)

    def selected(sides: Sequence[Side]) -> list[SideSelection]:
        drives = [side.robot.drives[joint] for side in sides for joint in side.joints]
        is_open = any(isinstance(drive.friction, DefaultTerms) for drive in drives)
        return selections(sides) if is_open else []

    monkeypatch.setattr(f"{problem}.log_findings", lambda *_: [])
    monkeypatch.setattr(f"{checking}.findings_of_setup", lambda _, moving, known, logs: known)
    monkeypatch.setattr(f"{problem}.selections", selected)
    monkeypatch.setattr(f"{conclusion}.sensitivity_findings", lambda *_: [])
    monkeypatch.setattr(f"{conclusion}.backlash_findings", lambda *_: [])
    monkeypatch.setattr(f"{conclusion}.joint_checks", lambda *_: {})


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of the module with the small arm, its plans and its logs."""
    from tests.cli.small_arm import experiment

    folder = tmp_path_factory.mktemp("arm")
    for name, content in experiment().items():
        (folder / name).write_bytes(content)
    return folder


@pytest.fixture
def write_urdf(tmp_path: Path) -> Callable[[str], Path]:
    """Return a function that writes the inside of a <robot name="test"> and returns the path."""

    def write(inside: str) -> Path:
        path = tmp_path / "test.urdf"
        path.write_text(f'<robot name="test">\n{inside}\n</robot>\n', encoding="utf-8")
        return path

    return write


@pytest.fixture
def write_chain(write_urdf: Callable[[str], Path]) -> Callable[..., Path]:
    """Return a function that writes a chain: {joint: "type <elements>"} -> path.

    The links are 'base' and '<joint>_link', each with a body of its own (links in `empty` with
    none), each joint 0.1 0.2 0.3 m after the one before unless its elements have an <origin>.
    """

    def write(joints: dict[str, str], empty: tuple[str, ...] = ()) -> Path:
        parent, text = "base", '<link name="base"/>\n'
        for number, (name, description) in enumerate(joints.items(), 1):
            kind, _, elements = description.partition(" ")
            if "<origin" not in elements:
                elements += '<origin xyz="0.1 0.2 0.3"/>'
            link = f"{name}_link"
            text += f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
            text += f'<child link="{link}"/>{elements}</joint>\n'
            text += f'<link name="{link}">{"" if link in empty else body(number)}</link>\n'
            parent = link
        return write_urdf(text)

    return write
