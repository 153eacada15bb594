"""Frequency response: spectra of multisines become stiffnesses, dampings and inertias.

A `Robot` and logs of periodic motions come in; a `FrequencyResponse` goes out: the measured
response of each joint, and the linear model of motor, spring and load that fits it.

- `frequency_response`: the response of the motors, with springs, dampings and resonances.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> print(seaid.frequency_response(robot, seaid.read_log("run.csv", robot), period_s=5.0))
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
