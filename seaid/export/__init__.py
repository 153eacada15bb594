"""Robot files of an identification.

An `Identification`, or a `Robot` with its values, comes in; files go out:

- `write_urdf`: the source URDF with the identified inertias, otherwise unchanged byte by byte;
- `write_mjcf`: a MuJoCo model with the springs, the armature and the friction of the drives;
- `write_model`: these, and actuators for Isaac Lab, USD, Newton and Drake;
- `write_randomization`: ranges and correlated samples, for domain randomization;
- `write_parameters`: all values with their errors, which `read_parameters` reads back.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> result = seaid.identify(robot, seaid.read_log("run.csv", robot), feasible=True)
>>> notes = seaid.write_mjcf(result, "leg.xml").notes
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
