"""A project: the set-up of an identification in one file, its runs, and their saved results.

A `seaid.toml` with robot, logs and options comes in; folders with results go out, from which
everything else starts without identifying again.

- `write_first_project` writes a first file, with what it infers from the logs and each doubt;
- `load_project` reads it: `Project`;
- `run_project` identifies, validates, reports and exports: `ProjectRun`;
- `save_run`, `load_run` keep an identification whole in one file.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> found = seaid.identify(robot, seaid.read_log("run.csv", robot))
>>> seaid.project.save_run(found, "leg.npz")
>>> seaid.project.load_run("leg.npz").identification.drives["knee_pitch"].value("stiffness")
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
