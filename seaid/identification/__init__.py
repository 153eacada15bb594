"""Identification: a robot and its logs become parameters of drives and bodies.

A `Robot` and logs come in; an `Identification` goes out: an estimate per drive, one of the base
parameters of the load side, flags, and the robot with all values put in.

- `identify`: the motor equations first and then the load side, or both at once;
- `validate`, `cross_validate`: the torque that an identified model predicts for another log;
- `refine`: output error, by simulating the whole model;
- `compare_terms`: which friction and spring terms the data support;
- `identify_conditions`: logs under several conditions;
- `consistency`: inertial parameters that are physically consistent, nearest to a prior.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> print(seaid.identify(robot, seaid.read_log("run.csv", robot)).summary())
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
