"""The drive of one joint: motor, gear, spring and friction, as data, equations and columns.

A TOML table or keyword arguments come in; a frozen `SeriesElasticDrive` or `StiffDrive` goes out,
with the equations of the paper in sympy:

- (1)-(3) the torque of the motor and its friction, (4) the spring,
- (5)-(7) the motor equation, in which the spring torque is the load,
- the joint terms (parallel spring, joint friction), which act next to the drive in (8).

`joint_regressor` and `motor_regressor` of `seaid.regressor` turn them into columns over time by
Algorithm 1 of `seaid.symbolic`; a new friction or spring term touches this package only.

>>> from seaid.drives import SeriesElasticDrive, motor_equation
>>> drive = SeriesElasticDrive(gear_ratio=100.0, motor_inertia_kg_m2=1e-5)
>>> print(motor_equation(drive))
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
