"""The command line `seaid`: one command for each step of the library, `main` runs it.

In: files (URDF, TOML, logs, trajectories). Out: results on stdout or in files, notes and errors on
stderr. The commands have the names and options of the functions of the library that they call.

$ seaid identify leg.urdf run.csv --drives leg.toml -o parameters.json
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
