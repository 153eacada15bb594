"""view_robot: what there is to see of a robot and its motions, opened in a window."""

from __future__ import annotations

import socket
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from seaid.errors import SeaidError, reason_of
from seaid.excitation import Excitation, Trajectory
from seaid.log import Log
from seaid.motion import Motion
from seaid.robot import Robot
from seaid.view.panel import put_panel
from seaid.view.picture import Picture, picture_of
from seaid.view.playback import Playback, Shown, playback_of, scales
from seaid.view.stage import put_on_stage, set_the_view
from seaid.view.window import View, quietly

_POSTURES = 40
"""Of each motion, to point the camera at."""


def view_robot(
    robot: Robot,
    motions: Mapping[str, Shown] | Sequence[Shown] | Shown = (),
    *,
    package_dirs: str | Path | Sequence[str | Path] = (),
    host: str = "127.0.0.1",
    port: int = 8080,
) -> View:
    """Show a robot in the browser, at `View.url`, and play planned and recorded motions.

    `motions`: logs, motions and trajectories, in a mapping under the names they get. Joints with a
    spring have the colour of its deflection; without motions, joints have sliders. `package_dirs`:
    folders in which packages of meshes are searched. `host`: who may look, by itself this machine
    alone, "0.0.0.0" for the network. `port` 0: any that is free. The window is open until
    `View.stop`, or the end of a `with` block.

    Raises SeaidError where viser is not installed or the port cannot be had, RobotError for a robot
    without its URDF, LogError and ExcitationError for motions of other joints.
    """
    server_of = _viser_server()
    picture = picture_of(robot, package_dirs=package_dirs)
    playbacks = [playback_of(robot, one, name) for name, one in _by_name(motions).items()]
    _check_port(host, port)
    with quietly():
        server = server_of(host=host, port=port, verbose=False)
    try:
        return _opened(server, picture, tuple(playbacks))
    except BaseException:
        with quietly():
            server.stop()
        raise


def _opened(server: Any, picture: Picture, playbacks: tuple[Playback, ...]) -> View:
    limits = scales(playbacks, picture.robot.is_prismatic)
    sampled = [one.position[:: max(1, len(one.time) // _POSTURES)] for one in playbacks]
    set_the_view(server, picture, np.concatenate(sampled or [picture.home[None]]))
    stage = put_on_stage(server, picture)
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


def _by_name(motions: Mapping[str, Shown] | Sequence[Shown] | Shown) -> dict[str, Shown]:
    if isinstance(motions, Mapping):
        return dict(motions)
    several = [motions] if isinstance(motions, Log | Motion | Trajectory | Excitation) else motions
    kinds = {Log: "log", Motion: "motion"}
    return {
        f"{kinds.get(type(one), 'plan')} {number}": one for number, one in enumerate(several, 1)
    }


def _check_port(host: str, port: int) -> None:
    """Raise SeaidError where a port cannot be had, which viser would go round or wait for."""
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
            "open there, end it or take another port; port 0 is any that is free"
        ) from None
