"""Simulation: the complete model forward in time, with its controller and its sensors.

A `Robot` whose parameters are all known and a `Trajectory` come in; a `Log` goes out, as the
robot's own sensors would have written it: (7) and (8) integrated together, dry friction with
stick-slip, encoders with their resolution and offsets, torques with noise.

- `simulate` follows a planned trajectory by PD control;
- `replay` drives the model with the motor torques of a measured log.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> log = seaid.simulate(robot, seaid.load_trajectory("models/tulip_plan.json"), seed=1)
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
