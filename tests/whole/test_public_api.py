"""The names that scripts outside this project use: there, documented, and quick to import."""

import importlib
import inspect
import pkgutil
import pydoc
import re
import subprocess
import sys
from dataclasses import is_dataclass

import pytest

import seaid
import seaid.regressor
import seaid.symbolic
from seaid._progress import Display

IMPORT_SECONDS = 1.0
PACKAGES = [one.name for one in pkgutil.iter_modules(seaid.__path__) if one.ispkg]


FUNCTIONS = [name for name in seaid.__all__ if inspect.isfunction(getattr(seaid, name))]
TYPES = [name for name in seaid.__all__ if is_dataclass(getattr(seaid, name))]
PLAIN = ("Controller", "Finding", "Statics")
"""Types of plain data, which are shown as Python shows them."""


def test_all_lists_what_is_there_sorted_and_dir_the_same() -> None:
    """Types that are only returned are in their packages: `seaid.identification.gear.GearRatio`."""
    assert sorted(seaid.__all__) == dir(seaid)
    for name in seaid.__all__:
        assert getattr(seaid, name) is not None
    assert {"SeaidError", "SeaidWarning", "errors"} <= set(seaid.__all__)
    modules = {module.name for module in pkgutil.iter_modules(seaid.__path__)} - {"errors"}
    assert modules & set(seaid.__all__) <= {*PACKAGES}  # which would hide the name once imported
    with pytest.raises(AttributeError, match="No seaid attribute load_robott"):
        seaid.load_robott  # type: ignore[attr-defined]  # noqa: B018
    assert {"separate", "reduce", "base_parameters", "complete_model"} <= set(dir(seaid.symbolic))


HEAVY: tuple[str, ...] = (
    *("numpy", "scipy", "pinocchio", "sympy", "flint", "matplotlib", "yourdfpy", "trimesh"),
    *("lxml", "rich", "click", "jinja2", "viser", "mujoco", "pyarrow", "h5py"),
)


LEG = "seaid.load_robot('models/tulip_leg.urdf', 'models/tulip_leg.toml')"
WINDOW = "import seaid.cli.commands, seaid.view.picture, seaid.view.playback; seaid.view_robot"
WITHOUT = {
    "": HEAVY,
    LEG: ("sympy", "matplotlib", "yourdfpy", "trimesh", "pydantic"),
    WINDOW: ("viser", "trimesh", "yourdfpy"),
}
"""{what is done after the import: packages that are not loaded then}."""


@pytest.mark.parametrize("step", WITHOUT)
def test_import_is_quick_and_leaves_the_heavy_packages_alone(step: str) -> None:
    """Of which loading a robot needs some, and a window that is not opened others."""
    code = "import time; start = time.perf_counter(); import seaid\n"
    code += f"print(time.perf_counter() - start)\n{step}\n"
    code += f"import sys; print([name for name in {WITHOUT[step]} if name in sys.modules])"
    command = [sys.executable, "-c", code]
    runs = [
        subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
        for _ in range(1 if step else 3)
    ]
    assert min(float(seconds) for seconds, _ in runs) < IMPORT_SECONDS
    assert all(loaded == "[]" for _, loaded in runs)


def test_functions_of_the_face_say_how_they_fail_and_show_their_signature() -> None:
    """That they have a docstring is a rule of ruff."""
    for function in (getattr(seaid, name) for name in FUNCTIONS):
        assert "Raises" in (inspect.getdoc(function) or ""), function
        shown = pydoc.render_doc(function, renderer=pydoc.TextDoc()).split(" -> ")[0]
        assert {*inspect.signature(function).parameters} <= {*re.findall(r"\w+", shown)}


@pytest.mark.parametrize("name", TYPES)
def test_every_type_is_frozen_and_displayed_in_one_line_and_by_a_table_of_the_report(
    name: str,
) -> None:
    kind = getattr(seaid, name)
    assert kind.__dataclass_params__.frozen
    if name in PLAIN:
        return
    assert issubclass(kind, Display)
    assert kind.__repr__ is Display.__repr__
    assert inspect.isfunction(getattr(seaid.report.text, kind.table_name))


@pytest.mark.parametrize("package", PACKAGES)
def test_dir_of_a_package_shows_its_functions(package: str) -> None:
    module = importlib.import_module(f"seaid.{package}")
    text = (module.__doc__ or "") if package != "cli" else "`main`"
    found = {name: getattr(module, name, None) for name in re.findall(r"`(\w+)`", text)}
    named = {name for name, one in found.items() if inspect.isfunction(one)}
    assert set(dir(module)) >= {*named, *getattr(module, "__all__", ())}
    assert dir(module)
