"""view_robot and View: a window in the browser that shows a robot and plays its motions."""

from __future__ import annotations

import contextlib
import io
import socket
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from seaid._arrays import Array
from seaid._progress import Display, counted
from seaid.errors import RobotError, SeaidError, checked, reason_of, unknown_name
from seaid.excitation import Excitation, Trajectory
from seaid.log import Log, Motion
from seaid.robot import Robot
from seaid.view.panel import (
    NOTHING,
    Panel,
    deflection_colors,
    draw_plots,
    notes_of,
    put_panel,
    slider_end,
    table,
)
from seaid.view.picture import Picture, picture_of, rest_posture
from seaid.view.playback import Playback, Shown, playback_of, scales

if TYPE_CHECKING:
    from seaid.identification import Identification
    from seaid.view.stage import Stage

_FRAMES_HZ = 30.0


@dataclass(frozen=True, eq=False, repr=False)
class View(Display):
    """An open window on a robot, from `view_robot`; its methods do the same as the panel.

    `stop` or the end of a `with` block closes it.

    Attributes
    ----------
    url : str
        The address to open in a browser.
    playbacks : tuple of Playback
        The motions that it can play.
    limits : array (n,)
        The ends of the colour scale of deflections [rad or m].
    server, stage, panel
        The server and the handles of viser.
    """

    server: Any
    picture: Picture
    playbacks: tuple[Playback, ...]
    stage: Stage
    panel: Panel
    limits: Array
    _drawing: Any = field(default_factory=threading.RLock, init=False, repr=False)
    _playing: threading.Event = field(default_factory=threading.Event, init=False, repr=False)
    _ended: threading.Event = field(default_factory=threading.Event, init=False, repr=False)
    _clock: threading.Thread = field(init=False, repr=False)

    def _in_short(self) -> str:
        return f"{self.url}: {counted(len(self.playbacks), 'motion')}"

    def __post_init__(self) -> None:
        self._listen()
        self._change_motion()
        clock = threading.Thread(target=self._keep_time, name="seaid view", daemon=True)
        object.__setattr__(self, "_clock", clock)
        clock.start()

    @property
    def url(self) -> str:
        """The address to open in a browser."""
        host = self.server.get_host()
        # These mean "all interfaces" to a server, and are no addresses to open.
        shown = "localhost" if host in ("0.0.0.0", "::", "") else host
        return f"http://{f'[{shown}]' if ':' in shown else shown}:{self.server.get_port()}"

    @property
    def time(self) -> float:
        """The time [s] since the start of the motion shown, 0 without a motion."""
        return float(self.panel.time.value) if self.playbacks else 0.0

    @property
    def playback(self) -> Playback | None:
        """The motion shown."""
        return self._named(self.panel.run.value) if self.playbacks else None

    def show(self, name: str) -> None:
        """Show another motion by its name. Raises SeaidError for an unknown name."""
        self._named(name)
        self.panel.run.value = name

    def compare(self, name: str | None) -> None:
        """Draw another motion in orange for comparison, None to remove it.

        Raises SeaidError for an unknown name, and if there is no other motion.
        """
        if self.panel.compared is None:
            raise SeaidError("there is no other motion to compare with: give view_robot two")
        self.panel.compared.value = NOTHING if name is None else self._named(name).name

    def seek(self, time_s: float) -> None:
        """Show the robot at a time [s] since the start of the motion, to the millisecond.

        Times beyond the motion give its nearest end. Raises SeaidError without a motion.
        """
        if self.playback is None:
            raise SeaidError("there is no motion to seek in: give view_robot one")
        self.panel.time.value = round(float(np.clip(time_s, 0.0, self.panel.time.max)), 3)

    def play(self) -> None:
        """Play from the time shown, in a loop. Raises SeaidError without a motion."""
        if self.playback is None:
            raise SeaidError("there is no motion to play: give view_robot one")
        self._playing.set()
        self.panel.play.label, self.panel.play.icon = "Pause", "player-pause"

    def pause(self) -> None:
        """Pause at the time shown."""
        self._playing.clear()
        if self.panel.play is not None:
            self.panel.play.label, self.panel.play.icon = "Play", "player-play"

    def wait(self, seconds: float | None = None) -> None:
        """Wait until `stop` closes the window, or for `seconds`; the page remains usable."""
        self._ended.wait(seconds)

    def stop(self) -> None:
        """Close the window and free its port."""
        if not self._ended.is_set():
            self._ended.set()
            # First, because the clock writes to the server.
            self._clock.join()
            stop_quietly(self.server)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.stop()

    def _named(self, name: str) -> Playback:
        by_name = {playback.name: playback for playback in self.playbacks}
        if name not in by_name:
            raise SeaidError(unknown_name("motion", name, by_name))
        return by_name[name]

    def _listen(self) -> None:
        panel = self.panel
        for slider in panel.joints:
            slider.on_update(lambda _: self._draw())
        if self.playbacks:
            panel.time.on_update(lambda _: self._draw())
            panel.run.on_update(lambda _: self._change_motion())
            panel.play.on_click(lambda _: self.pause() if self._playing.is_set() else self.play())
        if panel.plots is not None:
            panel.plots.joint.on_update(lambda _: self._draw())
        if panel.compared is not None:
            panel.compared.on_update(lambda _: self._draw())

    def _change_motion(self) -> None:
        playback = self.playback
        with self._drawing:
            if playback is not None:
                self.panel.time.max = slider_end(playback)
                self.panel.time.value = min(self.time, self.panel.time.max)
            self.panel.notes.content = notes_of(self.picture, playback)
        self._draw()

    def _draw(self) -> None:
        """Move and colour all parts for the time shown."""
        robot, panel = self.picture.robot, self.panel
        with self._drawing, self.server.atomic():
            position, deflection = self._state()
            colors = deflection_colors(deflection, self.limits)
            self.stage.robot.display(robot.to_model(position))
            self.stage.paint(colors)
            if self.playback is not None and panel.plots is not None:
                panel.table.content = table(robot, position, deflection, colors)
                draw_plots(panel.plots, robot, self.playback, self.time)
            if panel.compared is not None:
                is_compared = panel.compared.value != NOTHING
                self.stage.ghost.visualRootFrame.visible = is_compared
                if is_compared:
                    compared, _ = self._named(panel.compared.value).at(self.time)
                    self.stage.ghost.display(robot.to_model(compared))

    def _state(self) -> tuple[Array, Array]:
        """Return position and deflection (n,) shown now."""
        if self.playback is not None:
            return self.playback.at(self.time)
        values = np.array([slider.value for slider in self.panel.joints])
        return values, np.full(len(values), np.nan)

    def _keep_time(self) -> None:
        """Advance the time while the motion plays, in a loop."""
        before, due = time.monotonic(), 0.0
        while not self._ended.wait(1.0 / _FRAMES_HZ):
            now = time.monotonic()
            step, before = now - before, now
            if self._playing.is_set():
                due += step * float(self.panel.speed.value.rstrip("x"))
                shown = self.time + np.floor(due * 1e3) / 1e3  # the slider has milliseconds
                due %= 1e-3
                end = self.panel.time.max
                self.panel.time.value = round(float(shown % end if shown > end else shown), 3)


_QUIET = threading.RLock()


@contextlib.contextmanager
def quietly() -> Iterator[None]:
    """Suppress the messages that viser prints, for one thread at a time: stdout is of all."""
    with _QUIET, contextlib.redirect_stdout(io.StringIO()):
        yield


def stop_quietly(server: Any) -> None:
    """Stop a server; its thread prints that it has stopped, on a busy machine a while later."""
    thread = getattr(getattr(server, "_websock_server", None), "_server_thread", None)
    with quietly():
        server.stop()
        if thread is not None:
            thread.join(_LONGEST_STOP_S)


_LONGEST_STOP_S = 10.0

_POSTURES = 40
"""Number of postures per motion that the camera shows."""


@checked(SeaidError)
def view_robot(
    robot: Robot,
    motions: Mapping[str, Shown] | Sequence[Shown] | Shown = (),
    *,
    identified: Robot | Identification | None = None,
    package_dirs: str | Path | Sequence[str | Path] = (),
    host: str = "127.0.0.1",
    port: int = 8080,
) -> View:
    """Show a robot and its planned and logged motions in the browser, at `View.url`.

    Joints with a spring have the colour of its deflection. Without motions, joints have sliders.

    Parameters
    ----------
    robot : Robot
    motions : Log, Motion, Trajectory, Excitation, a sequence of them, or {name: motion}
    identified : Robot or Identification, optional
        The identified robot, whose bodies are compared with those of `robot`.
    package_dirs : path or sequence of paths
        Folders to search for meshes, besides the folder of the file and those above it.
    host : str
        The address to serve: this machine alone by default, "0.0.0.0" for the network.
    port : int
        The port to serve, 0 for any free one.

    Returns
    -------
    View
        It is open until `View.stop` or the end of a `with` block.

    Raises
    ------
    SeaidError
        If viser is not installed or the port is not available.
    RobotError
        For a robot without its URDF, and an identified robot with other joints.
    LogError, ExcitationError
        For motions of other joints.

    Examples
    --------
    >>> with seaid.view_robot(robot, {"run": seaid.read_log("run.csv", robot)}) as view:
    ...     view.play()
    ...     view.wait()
    """
    server_of = _viser_server()
    model = _identified_robot(robot, identified)
    picture = picture_of(robot, identified=model, package_dirs=package_dirs)
    playbacks = [playback_of(robot, m, name, model) for name, m in _named_motions(motions).items()]
    _check_port(host, port)
    with quietly():
        server = server_of(host=host, port=port, verbose=False)
    try:
        return _opened(server, picture, tuple(playbacks))
    except BaseException:
        stop_quietly(server)
        raise


def _opened(server: Any, picture: Picture, playbacks: tuple[Playback, ...]) -> View:
    from seaid.view.stage import Stage, set_the_view

    limits = scales(playbacks, picture.robot.is_prismatic)
    sampled = [p.position[:: max(1, len(p.time) // _POSTURES)] for p in playbacks]
    set_the_view(server, picture, np.concatenate(sampled or [rest_posture(picture.robot)[None]]))
    stage = Stage(server, picture)
    panel = put_panel(server, picture, stage, playbacks, limits)
    return View(server, picture, playbacks, stage, panel, limits)


def _viser_server() -> Any:
    try:
        from viser import ViserServer
    except ImportError:
        raise SeaidError(
            "to view a robot, the package viser is needed: get it with pip install 'seaid[view]'"
        ) from None
    return ViserServer


def _identified_robot(robot: Robot, identified: Robot | Identification | None) -> Robot | None:
    """Return the identified robot. Raises RobotError for one with other joints or bodies."""
    if identified is None:
        return None
    model = identified if isinstance(identified, Robot) else identified.robot
    names = robot.joint_names, robot.body_names
    if (model.joint_names, model.body_names) != names:
        raise RobotError(
            f"identified: it has the joints {', '.join(model.joint_names)}, but '{robot.name}' has "
            f"{', '.join(robot.joint_names)}; load both with the same joints=",
            "joints=",
        )
    return model


def _named_motions(motions: Mapping[str, Shown] | Sequence[Shown] | Shown) -> dict[str, Shown]:
    if isinstance(motions, Mapping):
        return dict(motions)
    several = [motions] if isinstance(motions, Log | Motion | Trajectory | Excitation) else motions
    kinds = {Log: "log", Motion: "motion"}
    return {
        f"{kinds.get(type(motion), 'plan')} {number}": motion
        for number, motion in enumerate(several, 1)
    }


def _check_port(host: str, port: int) -> None:
    """Raise SeaidError for an unavailable port, for which viser would wait or take another."""
    if isinstance(port, bool) or not isinstance(port, int) or not 0 <= port < 65536:
        raise SeaidError(f"port must be a whole number of 0 to 65535, found {port!r}")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as problem:
        raise SeaidError(
            f"cannot open port {port} of host '{host}': {reason_of(problem)}; if another view is "
            "open there, end it or take another port; port 0 is any free one"
        ) from None
