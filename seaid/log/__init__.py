"""Logs: from files with samples of sensors to positions, velocities and accelerations.

In: a file (CSV, NPZ, JSON, Parquet, HDF5, ROS bag, hebilog; `readers/`), with the column names of
seaid or with custom columns and a `LogDescription`. Out: a `Log` in SI units, and from it a
`Motion` with the motor side theta_M and the joint side theta_L of every joint on a uniform grid,
as the actuator equation (7) and the load equation (8) of the paper need them.

- `read_log` reads a file and repairs it on request (`repair/`: clocks, gaps, wraps, dropouts);
- `describe_log` infers the meaning of custom columns;
- `reconstruct_motion` selects the cutoff frequency, filters without delay and differentiates;
- `open_long_log` reads a file piece by piece, so that memory does not grow with its length.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> motion = seaid.reconstruct_motion(robot, seaid.read_log("run.csv", robot))
>>> motion.cutoff_hz
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
