"""Robots whose base moves: bases, contacts and what they add to the identification.

`load_robot` with a base that is not fixed makes a `FloatingRobot`. Importing its type registers
what such a robot adds to packages that know nothing of it: equations, estimates and checks.

- `whole_body`: mass and centre of mass of the whole robot;
- `ContactForces`: forces of the ground, predicted from torques and motion, by `validate`;
- `find_contacts`, `with_leg_order`: what a log does not say of feet and legs.

>>> import seaid
>>> feet = ["FL_foot", "FR_foot", "RL_foot", "RR_foot"]
>>> robot = seaid.load_robot("models/go2.urdf", base="floating", contacts=feet)
>>> robot.floating_base.contact_links
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
