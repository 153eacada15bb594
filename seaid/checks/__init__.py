"""Checks: what can be wrong with a set-up, its log or a result, and how it shows.

- `codes`: what each finding stands for, with its usual cause, what to do and its words (in
  `codes.toml`), and which findings follow from others;
- `engine`: how checks are declared and made, and which columns belong into an equation, by forward
  selection. `columns` (drives) and `gears` (with their sensors) propose them, `terms` computes
  those of drives, and `model` selects and names.

Findings are made here, and those of bases and feet in `seaid.legged`: a room for each thing that
is looked at, such as `channels` of a log.
Nothing here knows the steps of an identification.

>>> from seaid.checks import CODES
>>> CODES["delay"].advice
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
