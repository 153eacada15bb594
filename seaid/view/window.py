"""view_robot and View: a window in the browser that shows a robot and plays its motions."""

from __future__ import annotations

import contextlib
import io
import socket
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._progress import Display, counted
from seaid.errors import RobotError, SeaidError, checked, reason_of, unknown_name
from seaid.robot import Robot
from seaid.view.panel import NOTHING, Panel, deflection_colors
from seaid.view.picture import Picture, Stage, picture_of, rest_posture, set_the_view
from seaid.view.playback import Playback, Shown, playback_of

if TYPE_CHECKING:
    from seaid.identification import Identification


class View(Display, contextlib.AbstractContextManager["View"]):
    """An open window on a robot, from `view_robot`; its methods do the same as the panel.

    `stop` or the end of a `with` block closes it.

    Attributes
    ----------
    picture : Picture
        What it shows of the robot.
    playbacks : tuple of Playback
        The motions that it can play.
    is_playing : bool
        Whether the time goes on.
    server, stage, panel
        The server and the handles of viser.
    """

    def __init__(self, server: Any, picture: Picture, playbacks: Sequence[Playback]) -> None:
        self.server, self.picture, self.playbacks = server, picture, tuple(playbacks)
        # The camera shows about forty postures of each motion.
        sampled = [x.position[:: max(1, len(x.time) // 40)] for x in playbacks]
        set_the_view(
            server, picture, np.concatenate(sampled or [rest_posture(picture.robot)[None]])
        )
        self.stage = Stage(server, picture)
        self.panel = Panel(server, picture, self.stage, playbacks)
        self._drawing = threading.RLock()
        self.is_playing, self._ended = False, threading.Event()
        for handle in self.panel.inputs:
            handle.on_update(lambda _: self._draw())
        if playbacks:
            self.panel.play.on_click(lambda _: self.pause() if self.is_playing else self.play())
        self._draw()
        self._clock = threading.Thread(target=self._keep_time, name="seaid view", daemon=True)
        self._clock.start()

    def _in_short(self) -> str:
        return f"{self.url}: {counted(len(self.playbacks), 'motion')}"

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
        self.panel.run.value = self._named(name).name

    def compare(self, name: str | None) -> None:
        """Draw another motion in orange for comparison, None to remove it.

        Raises SeaidError for an unknown name, and without a motion.
        """
        self._check_motion()
        self.panel.compared.value = NOTHING if name is None else self._named(name).name

    def seek(self, time_s: float) -> None:
        """Show the robot at a time [s] since the start of the motion, to the millisecond.

        Times beyond the motion give its nearest end. Raises SeaidError without a motion.
        """
        self._check_motion()
        self.panel.time.value = round(float(np.clip(time_s, 0.0, self.panel.time.max)), 3)

    def play(self) -> None:
        """Play from the time shown, in a loop. Raises SeaidError without a motion."""
        self._check_motion()
        self.is_playing = True
        self.panel.play.label, self.panel.play.icon = "Pause", "player-pause"

    def pause(self) -> None:
        """Pause at the time shown."""
        self.is_playing = False
        if self.playbacks:
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

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _check_motion(self) -> None:
        if not self.playbacks:
            raise SeaidError("there is no motion to play: give view_robot one")

    def _named(self, name: str) -> Playback:
        by_name = {playback.name: playback for playback in self.playbacks}
        if name not in by_name:
            raise SeaidError(unknown_name("motion", name, by_name))
        return by_name[name]

    def _draw(self) -> None:
        """Move and colour all parts for the time shown."""
        playback, panel, stage = self.playback, self.panel, self.stage
        with self._drawing, self.server.atomic():
            if playback is None:
                stage.robot.move(np.array([slider.value for slider in panel.inputs]))
                return
            panel.time.max = max(round(playback.duration, 3), 0.001)
            panel.time.value = min(self.time, panel.time.max)
            position, deflection = playback.at(self.time)
            stage.robot.move(position)
            stage.paint(deflection_colors(deflection, panel.limits))
            name = panel.compared.value
            compared = None if name == NOTHING else self._named(name)
            stage.ghost.root.visible = compared is not None
            if compared is not None:
                stage.ghost.move(compared.at(self.time)[0])
            panel.draw(playback, compared)

    def _keep_time(self) -> None:
        """Advance the time while the motion plays, in a loop, thirty times per second."""
        before = time.monotonic()
        while not self._ended.wait(1.0 / 30.0):
            now = time.monotonic()
            step, before = now - before, now
            if self.is_playing:
                speed = float(self.panel.speed.value.rstrip("x"))
                self.panel.time.value = (self.time + speed * step) % self.panel.time.max


def stop_quietly(server: Any) -> None:
    """Stop a server; its thread prints that it has stopped, on a busy machine a while later."""
    thread = server._websock_server._server_thread
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()
        thread.join()


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
    try:
        from viser import ViserServer
    except ImportError:
        raise SeaidError(
            "to view a robot, the package viser is needed: get it with pip install 'seaid[view]'"
        ) from None
    model = _identified_robot(robot, identified)
    picture = picture_of(robot, identified=model, package_dirs=package_dirs)
    playbacks = [
        playback_of(robot, m, name, identified) for name, m in _named_motions(motions).items()
    ]
    _check_port(host, port)
    with contextlib.redirect_stdout(io.StringIO()):
        server = ViserServer(host=host, port=port, verbose=False)
    try:
        return View(server, picture, playbacks)
    except BaseException:
        stop_quietly(server)
        raise


def _identified_robot(robot: Robot, identified: Robot | Identification | None) -> Robot | None:
    """Return the identified robot. Raises RobotError for one with other joints or bodies."""
    model = identified if identified is None or isinstance(identified, Robot) else identified.robot
    names = robot.joint_names, robot.body_names
    if model is not None and (model.joint_names, model.body_names) != names:
        raise RobotError(
            f"identified: it has the joints {', '.join(model.joint_names)}, but '{robot.name}' has "
            f"{', '.join(robot.joint_names)}; load both with the same joints=",
            "joints=",
        )
    return model


def _named_motions(motions: Mapping[str, Shown] | Sequence[Shown] | Shown) -> dict[str, Shown]:
    if isinstance(motions, Mapping):
        return dict(motions)
    several = [motions] if isinstance(motions, Shown) else motions
    return {f"{type(x).__name__.lower()} {number}": x for number, x in enumerate(several, 1)}


def _check_port(host: str, port: int) -> None:
    """Raise SeaidError for an unavailable port, for which viser would wait or take another."""
    try:
        family, *_, address = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0]
        with socket.socket(family) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((address[0], port))
    except (OSError, OverflowError) as problem:
        raise SeaidError(
            f"cannot open port {port} of host '{host}': {reason_of(problem)}; if another view is "
            "open there, end it or take another port; port 0 is any free one"
        ) from None
