"""A robot: its rigid bodies in Pinocchio and a drive for every joint.

A URDF file and a table of drives come in; a frozen `Robot` goes out. On the way the file is
checked (masses, inertias, axes, joints that mimic others), angles that are multiples of 90 degrees
but for rounding are made exact, and payloads are added.

`Robot.parameters` are ten inertial parameters per body in the order of Pinocchio: the mass, the
first moments, and the six moments of inertia about the origin of the joint's frame.
`transmission` maps drives to joints where one drive moves several.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> robot.n, robot.elastic_joints
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
