"""Exciting trajectories: motions within limits from which the parameters can be identified well.

A `Robot` and `Limits` come in, a `Trajectory` goes out, (16)-(19): a B-spline, a polynomial or a
Fourier series whose coefficients minimise the condition number (or another criterion) of the
regressor, within limits of position, velocity, acceleration, torque, motor speed and deflection,
and without collisions.

- `design_excitation` plans a motion, `add_run_in` adds a start from rest and an end at rest;
- `load_scene` loads the bodies and boxes that must not collide;
- `Trajectory.save`, `save_set_points` and `save_joint_trajectory` write the plan for a controller.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> plan = seaid.design_excitation(robot, 4.0, limits=seaid.Limits(velocity=4.0))
>>> plan.trajectory.save("plan.json")
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
