"""Logs: samples of sensors become positions, velocities and accelerations.

A file comes in (CSV, NPZ, JSON, Parquet, HDF5, ROS bag, hebilog; `readers/`), with the column names
of seaid or with a description of its own ones; a `Log` goes out, and from it a `Motion`.

- `read_log` reads a file, and repairs it if asked (`repair/`: clocks, gaps, wraps, dropouts);
- `describe_log` infers what the columns of a foreign log mean;
- `reconstruct_motion` selects the cutoff frequency, filters without delay and differentiates;
- `open_long_log` reads a file piece by piece, so that memory does not grow with its length.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> motion = seaid.reconstruct_motion(robot, seaid.read_log("run.csv", robot))
>>> motion.cutoff_hz
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
