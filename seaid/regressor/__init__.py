"""Regressors: a robot and a motion become linear equations y = W theta.

`Robot` and `Motion` come in; a `Regression` goes out, whose columns are parameters and whose rows
are the equations at the sampled instants:

- `actuator_regression`: the motor equation (7), (10) of an elastic joint;
- `load_regression`: the load side (8) with the base parameters of the bodies.

`base_parameters` finds which combinations of inertial parameters are identifiable, by a QR
reduction; `exact/` derives the same in exact arithmetic, and `cross_check` compares both.
`identifiability` answers which parameters a set of sensors can identify at all.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> seaid.base_parameters(robot).expressions
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
