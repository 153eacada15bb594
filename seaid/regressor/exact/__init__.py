"""The exact equations of a robot: rigid-body regressor, base parameters and complete model.

A `Robot` comes in, its geometry as rational numbers; no tolerance decides a rank:

- `base_parameters`: the base parameters (14), by a recursion over the joints;
- `rigid_body`: the regressor (9) of the load side in sympy, as a function, and as source text by
  `export_numpy` and `export_c`;
- `complete_model`: the equations (7) and (8) for `seaid.symbolic.separate`.

>>> from seaid.regressor.exact import base_parameters
>>> base_parameters(robot).expressions
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
