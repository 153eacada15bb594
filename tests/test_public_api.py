"""The names that scripts outside this project use: there, documented, and quick to import."""

import importlib
import inspect
import pkgutil
import pydoc
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import ModuleType

import pytest

import seaid
import seaid.regressor
import seaid.symbolic
from seaid._progress import Display, Result

IMPORT_SECONDS = 1.0
FUNCTIONS = {
    "load_robot": "urdf drives joints payloads gravity snap_tolerance_rad",
    "load_scene": "urdf robot package_dirs keep_out clearance_m disabled_pairs srdf",
    "base_parameters": "robot motion torque_joints",
    "design_excitation": "robot duration basis coefficients limits rest_to_rest starts seed "
    "executor progress",
    "add_run_in": "trajectory robot limits periods",
    "load_trajectory": "path",
    "cross_check": "numeric exact",
    "identifiability": "robot sensors conditions seed",
    "simulate": "robot trajectory rate_hz noise seed",
    "read_log": "path robot columns description repair",
    "describe_log": "path robot",
    "run": "urdf logs folder progress",
    "run_project": "project command progress",
    "write_log": "log path",
    "write_urdf": "found path source force",
    "write_mjcf": "found path force",
    "write_randomization": "found path level samples spread seed",
    "write_model": "found path format time_step_s force",
    "write_drives": "drives path",
    "read_parameters": "path robot",
    "write_report": "identification path validations facts nominal",
    "write_comparison": "first second path names",
    "report.comparison_of": "first second names",
    "estimate_delays": "robot log largest_s cutoff_hz",
    "find_contacts": "robot log",
    "correct_delays": "log delays",
    "gear_ratio": "motor_angle_rad output_angle_rad",
    "replay": "robot log command",
    "reconstruct_motion": "robot log cutoff_hz",
    "identify": "robot logs torque_joints method estimator feasible cutoff_hz encoder_offset_std "
    "executor progress",
    "compare_terms": "robot logs joints terms torque_joints cutoff_hz progress",
    "identify_conditions": "conditions condition_specific torque_joints estimator cutoff_hz "
    "encoder_offset_std progress",
    "cross_validate": "robot logs parts progress",
    "cutoff_sensitivity": "robot logs cutoffs_hz progress",
    "open_long_log": "path robot columns cutoff_hz chunk_samples",
    "refine": "identification logs encoder_offset_std iterations progress",
    "validate": "identification log",
    "view_robot": "robot motions package_dirs host port",
    "regressor.rigid_body_regressor": "robot q v a",
    "symbolic.equations_of_motion": "lagrangian coordinates forces",
    "symbolic.separate": "equations motion unknowns",
    "symbolic.reduce": "form",
    "symbolic.base_parameters": "robot through",
}
CLASSES = {
    "Robot": "name joint_names model drives parameter_names parameters",
    "Payload": "link mass com",
    "Box": "center size rotation_rpy name",
    "StiffDrive": "gear_ratio gear_ratio_rad_per_m motor_inertia_kg_m2 coulomb_friction_Nm "
    "viscous_friction_Nms_per_rad",
    "SeriesElasticDrive": "gear_ratio motor_inertia_kg_m2 motor_pulley_radius_m "
    "load_pulley_radius_m stiffness_N_per_m stiffness_Nm_per_rad viscous_friction_Nms_per_rad "
    "coulomb_friction_Nm",
    "regressor.BaseParameters": "columns names expressions grouping gap reduce project",
    "regressor.CrossCheck": "agree same_columns max_difference gap",
    "Excitation": "trajectory condition_number base margins",
    "Trajectory": "duration sample save save_set_points joint_trajectory save_joint_trajectory "
    "main_interval",
    "EndState": "position velocity acceleration",
    "Noise": "",
    "Limits": "",
    "Log": "time joint_names motor_position joint_position motor_torque joint_torque",
    "Motion": "processing",
    "identification.CutoffSensitivity": "cutoffs_hz names units values standard_errors proposed "
    "refused moves save_figure",
    "identification.GearRatio": "value standard_error misfit_rad",
    "identification.Delay": "joint channel against delay_s standard_error_s is_significant",
    "Repairs": "rate_hz longest_gap_s most_gap_error most_missing most_disordered "
    "most_saturated largest_drift",
    "log.Repair": "channel kind count time_s action",
    "LogDescription": "joints time where repair to_dict to_toml",
    "log.Description": "description unsure unused assumed to_toml",
    "log.LongLog": "path cutoff_hz",
    "identification.FeasibleParameters": "robot values estimate distance chi_square active_bounds "
    "notes",
    "Identifiability": "names identifiable combinations ratios unidentifiable base rank usable gap "
    "agree summary body_count",
    "identification.TermSelection": "comparisons recommended robot",
    "identification.Conditions": "identifications condition_specific differences summary",
    "Identification": "drives load base robot checks feasible summary to_dict save",
    "Estimate": "names values covariance standard_errors units residual_std condition_number "
    "degrees_of_freedom interval",
    "Validation": "joints actuator load",
    "view.View": "url playbacks playback time show compare seek play pause wait stop",
    "export.WrittenMjcf": "path notes",
    "export.Randomization": "path ranges samples unidentified",
    "export.WrittenModel": "path drives warnings notes",
    "identification.Fit": "rms_error relative_error r_squared",
    "symbolic.RegressorForm": "zeta regressor parameters",
    "symbolic.BaseForm": "regressor parameters B echelon pivots fundamental_functions",
}
RESULTS = {
    *("regressor.BaseParameters", "regressor.CrossCheck", "Identifiability", "Excitation"),
    *("Identification", "Estimate", "Validation", "identification.FeasibleParameters"),
    *("identification.CutoffSensitivity", "identification.TermSelection"),
    "identification.Conditions",
}
PACKAGES = [one.name for one in pkgutil.iter_modules(seaid.__path__) if one.ispkg]
ERRORS = (
    *("SeaidError", "RobotError", "LogError", "ExcitationError", "SymbolicError"),
    *("IdentificationError", "SeaidWarning"),
)


def find(name: str) -> object:
    """Return what a script reaches as seaid.<name>."""
    found: object = seaid
    for part in name.split("."):
        found = getattr(found, part)
    return found


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function_of_the_design_is_there_with_its_arguments(name: str) -> None:
    function = find(name)
    assert inspect.isfunction(function)
    assert set(FUNCTIONS[name].split()) <= set(inspect.signature(function).parameters)


@pytest.mark.parametrize("name", CLASSES)
def test_type_of_the_design_is_frozen_data_with_its_fields(name: str) -> None:
    kind = find(name)
    assert isinstance(kind, type)
    assert is_dataclass(kind)
    assert kind.__dataclass_params__.frozen  # type: ignore[attr-defined]
    assert set(CLASSES[name].split()) <= {field.name for field in fields(kind)} | set(dir(kind))


@pytest.mark.parametrize("name", ERRORS)
def test_error_is_there(name: str) -> None:
    assert issubclass(getattr(seaid, name), Exception)


def test_all_lists_what_is_there_sorted_and_dir_the_same() -> None:
    assert sorted(seaid.__all__) == dir(seaid)
    for name in seaid.__all__:
        assert getattr(seaid, name) is not None
    public = {name for name in (*FUNCTIONS, *CLASSES, *ERRORS) if "." not in name}
    assert public <= set(seaid.__all__)


MOST_NAMES = 79
"""Names of `seaid` besides its packages; HOUSE.md asks for 70."""


def test_the_face_has_what_users_call_and_make() -> None:
    """Types that are only returned are in their packages: `seaid.identification.GearRatio`."""
    assert len({*seaid.__all__} - {*PACKAGES}) <= MOST_NAMES


def test_no_public_name_is_also_a_module_which_would_hide_it_once_imported() -> None:
    names = {module.name for module in pkgutil.iter_modules(seaid.__path__)}
    assert names & set(seaid.__all__) <= {
        one.name for one in pkgutil.iter_modules(seaid.__path__) if one.ispkg
    }


def test_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="No seaid attribute load_robott"):
        seaid.load_robott  # type: ignore[attr-defined]  # noqa: B018


def test_import_is_quick_and_leaves_the_heavy_packages_alone() -> None:
    heavy = ["numpy", "scipy", "pinocchio", "sympy", "flint", "matplotlib", "yourdfpy", "trimesh"]
    heavy += ["lxml", "rich", "typer", "jinja2", "viser", "mujoco", "pyarrow", "h5py"]
    code = (
        "import time; start = time.perf_counter(); import seaid\n"
        "print(time.perf_counter() - start)\n"
        f"import sys; print([name for name in {heavy} if name in sys.modules])"
    )
    command = [sys.executable, "-c", code]
    runs = [
        subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
        for _ in range(3)
    ]
    assert min(float(seconds) for seconds, _ in runs) < IMPORT_SECONDS
    assert all(loaded == "[]" for _, loaded in runs)


def test_loading_a_robot_leaves_sympy_and_matplotlib_alone(tulip_urdf: Path) -> None:
    drives = tulip_urdf.with_suffix(".toml")
    code = (
        f"import sys, seaid; seaid.load_robot({str(tulip_urdf)!r}, {str(drives)!r})\n"
        "print([name for name in ('sympy', 'matplotlib') if name in sys.modules])"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


# Documentation


def modules() -> Iterator[ModuleType]:
    yield seaid
    for module in pkgutil.walk_packages(seaid.__path__, "seaid."):
        yield importlib.import_module(module.name)


def undocumented(module: ModuleType) -> Iterator[str]:
    """Return the public things of a module that have no docstring."""
    if not module.__doc__:
        yield module.__name__
    for name, thing in vars(module).items():
        own = getattr(thing, "__module__", None) == module.__name__
        if name.startswith("_") or not own or not (inspect.isfunction(thing) or is_class(thing)):
            continue
        if not thing.__doc__:
            yield f"{module.__name__}.{name}"
        for method, value in vars(thing).items() if is_class(thing) else ():
            function = getattr(value, "fget", None) or getattr(value, "func", value)
            public = inspect.isfunction(function) and not method.startswith("_")
            if public and not function.__doc__:
                yield f"{module.__name__}.{name}.{method}"


def is_class(thing: object) -> bool:
    return isinstance(thing, type)


def test_everything_public_has_a_docstring() -> None:
    assert [name for module in modules() for name in undocumented(module)] == []


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if "." not in name])
def test_every_public_function_that_can_fail_says_how(name: str) -> None:
    assert "Raises" in (inspect.getdoc(find(name)) or "")


@pytest.mark.parametrize("name", CLASSES)
def test_every_type_is_displayed_in_one_line_and_by_a_table_of_the_report(name: str) -> None:
    kind = find(name)
    assert isinstance(kind, type)
    assert issubclass(kind, Display)
    assert kind.__repr__ is Display.__repr__
    assert inspect.isfunction(getattr(seaid.report, kind.table_name))


def test_results_are_those_with_a_summary() -> None:
    assert {name for name in CLASSES if issubclass(find(name), Result)} == RESULTS  # type: ignore[arg-type]


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if "." not in name])
def test_help_shows_the_signature(name: str) -> None:
    shown = pydoc.render_doc(find(name), renderer=pydoc.TextDoc())
    assert set(FUNCTIONS[name].split()) <= set(re.findall(r"\w+", shown.split(" -> ")[0]))


@pytest.mark.parametrize("package", PACKAGES)
def test_dir_of_a_package_shows_its_functions(package: str) -> None:
    module = importlib.import_module(f"seaid.{package}")
    text = (module.__doc__ or "") if package != "cli" else "`main`"
    found = {name: getattr(module, name, None) for name in re.findall(r"`(\w+)`", text)}
    named = {name for name, one in found.items() if inspect.isfunction(one)}
    assert set(dir(module)) >= {*named, *getattr(module, "__all__", ())}
    assert dir(module)


def test_dir_of_symbolic_shows_what_is_imported_on_first_use() -> None:
    assert {"separate", "reduce", "base_parameters", "complete_model"} <= set(dir(seaid.symbolic))
