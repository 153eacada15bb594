"""seaid: parameter identification of robots with series elastic actuators.

`load_robot` -> `design_excitation` -> `simulate` or `read_log` -> `identify` -> `validate`.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
