"""One joint that swings or slides, and its states under a motor torque of time."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from seaid._arrays import Array
from seaid.drives import Drive
from seaid.legged import load_robot
from seaid.robot import Robot
from seaid.simulation.forward_dynamics import advance
from seaid.simulation.plant import Plant

Chain = Callable[..., Path]
LIMIT = '<limit lower="-3" upper="3" effort="9" velocity="9"/>'
PENDULUM, SLIDER = (
    f'{kind} <axis xyz="{axis}"/>{LIMIT}'
    for kind, axis in (("revolute", "0 1 0"), ("prismatic", "1 0 0"))
)


def pendulum(write_chain: Chain, drive: Drive, g: float = 9.81) -> Robot:
    return load_robot(write_chain({"swing": PENDULUM}), {"swing": drive}, gravity=(0, 0, -g))


def run(
    plant: Plant, state: Array, torque: Callable[[float], Array], duration: float, step: float
) -> Array:
    """Return the states (T, 4, n) under motor torques of time."""
    data, states = plant.model.createData(), [state]
    for tick in range(round(duration / step)):
        now, then = torque(tick * step), torque((tick + 1) * step)
        state = advance(plant, data, state, now, (then - now) / step, step)
        states.append(state)
    return np.array(states)
