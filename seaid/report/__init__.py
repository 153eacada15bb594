"""Tables, figures and the HTML report of an identification.

`Identification` and `Validation` come in; tables for the terminal, figures and an HTML page go out.
The page is one file that opens offline; its charts are drawn in the browser.

- `write_report` writes the page, `write_comparison` that of two identifications;
- `comparison_of` compares the parameters of two identifications;
- the `..._table` functions make the text that `summary()` and `print` show of each result.

>>> import seaid
>>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
>>> found = seaid.identify(robot, seaid.read_log("run.csv", robot))
>>> checked = seaid.validate(found, seaid.read_log("other.csv", robot))
>>> seaid.write_report(found, "report.html", checked)
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
