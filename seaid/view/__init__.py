"""A robot and its motions in the browser.

A `Robot` and any number of motions come in; `view_robot` opens a page on which the robot moves,
with the deflection of its springs in colours, and returns a `View` to play, pause and seek.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> view = seaid.view_robot(robot, seaid.read_log("run.csv", robot))
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
