"""Reports: an identification as people read it.

`Identification` and `Validation` come in; tables for the terminal, figures and one page of HTML go
out. The page stands alone: its figures are drawn in the browser from the numbers inside.

- `write_report` writes the page;
- the tables are what `summary()` and `print` show of each result.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> found = seaid.identify(robot, seaid.read_log("run.csv", robot))
>>> checked = seaid.validate(found, seaid.read_log("other.csv", robot))
>>> seaid.write_report(found, checked, "report.html")
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
