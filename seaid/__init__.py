"""seaid: parameter identification of robots with series elastic actuators.

`load_robot` -> `design_excitation` -> `simulate` or `read_log` -> `identify` -> `validate`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from seaid import regression, symbolic
    from seaid.agreement import CrossCheck, cross_check
    from seaid.assembly import Payload
    from seaid.base import BaseParameters, base_parameters
    from seaid.bodies.possible_bodies import PossibleBodies
    from seaid.conditions import Conditions, identify_conditions
    from seaid.cross_validation import cross_validate
    from seaid.delays import Delay, correct_delays, estimate_delays
    from seaid.drivetrain.model import SeriesElasticDrive, StiffDrive
    from seaid.errors import (
        ExcitationError,
        IdentificationError,
        LogError,
        RobotError,
        SeaidError,
        SeaidWarning,
        SymbolicError,
    )
    from seaid.estimation.estimate import Estimate
    from seaid.excitation import (
        EndState,
        Excitation,
        Limits,
        Trajectory,
        add_run_in,
        design_excitation,
        load_trajectory,
    )
    from seaid.excitation.scene_file import Box, load_scene
    from seaid.export.drive_tables import write_drivetrains
    from seaid.export.mjcf import WrittenMjcf, write_mjcf
    from seaid.export.urdf_file import write_urdf
    from seaid.gears import GearRatio, gear_ratio
    from seaid.identification import Identification, identify
    from seaid.log import Log, read_log, write_log
    from seaid.logs.describe import Description, describe_log
    from seaid.logs.log_description import LogDescription
    from seaid.logs.repair import Repair, Repairs
    from seaid.long_log import LongLog, open_long_log
    from seaid.motion import Motion, reconstruct_motion
    from seaid.output_error import refine
    from seaid.parameters_file import read_parameters
    from seaid.replaying import replay
    from seaid.report.html import write_report
    from seaid.robot import Robot, load_robot
    from seaid.sensitivity import CutoffSensitivity, cutoff_sensitivity
    from seaid.sensors import Identifiability, identifiability
    from seaid.simulation import Noise, simulate
    from seaid.term_selection import TermSelection, compare_terms
    from seaid.validation import Validation, validate
    from seaid.view.opening import view_robot
    from seaid.view.window import View

__version__ = "0.1.0"

_WHERE = {
    "agreement": ("CrossCheck", "cross_check"),
    "assembly": ("Payload",),
    "base": ("BaseParameters", "base_parameters"),
    "conditions": ("Conditions", "identify_conditions"),
    "cross_validation": ("cross_validate",),
    "delays": ("Delay", "correct_delays", "estimate_delays"),
    "logs.describe": ("Description", "describe_log"),
    "drivetrain.model": ("SeriesElasticDrive", "StiffDrive"),
    "errors": (
        "ExcitationError",
        "IdentificationError",
        "LogError",
        "RobotError",
        "SeaidError",
        "SeaidWarning",
        "SymbolicError",
    ),
    "estimation.estimate": ("Estimate",),
    "excitation": (
        "EndState",
        "Excitation",
        "Limits",
        "Trajectory",
        "add_run_in",
        "design_excitation",
        "load_trajectory",
    ),
    "excitation.scene_file": ("Box", "load_scene"),
    "export.drive_tables": ("write_drivetrains",),
    "export.mjcf": ("WrittenMjcf", "write_mjcf"),
    "export.urdf_file": ("write_urdf",),
    "gears": ("GearRatio", "gear_ratio"),
    "identification": ("Identification", "identify"),
    "log": ("Log", "read_log", "write_log"),
    "logs.log_description": ("LogDescription",),
    "long_log": ("LongLog", "open_long_log"),
    "motion": ("Motion", "reconstruct_motion"),
    "output_error": ("refine",),
    "parameters_file": ("read_parameters",),
    "bodies.possible_bodies": ("PossibleBodies",),
    "logs.repair": ("Repair", "Repairs"),
    "replaying": ("replay",),
    "report.html": ("write_report",),
    "robot": ("Robot", "load_robot"),
    "sensors": ("Identifiability", "identifiability"),
    "sensitivity": ("CutoffSensitivity", "cutoff_sensitivity"),
    "simulation": ("Noise", "simulate"),
    "term_selection": ("TermSelection", "compare_terms"),
    "validation": ("Validation", "validate"),
    "view.opening": ("view_robot",),
    "view.window": ("View",),
}
_MODULE_OF = {name: module for module, names in _WHERE.items() for name in names}
_SUBMODULES = ("regression", "symbolic")

__all__ = [
    "BaseParameters",
    "Box",
    "Conditions",
    "CrossCheck",
    "CutoffSensitivity",
    "Delay",
    "Description",
    "EndState",
    "Estimate",
    "Excitation",
    "ExcitationError",
    "GearRatio",
    "Identifiability",
    "Identification",
    "IdentificationError",
    "Limits",
    "Log",
    "LogDescription",
    "LogError",
    "LongLog",
    "Motion",
    "Noise",
    "Payload",
    "PossibleBodies",
    "Repair",
    "Repairs",
    "Robot",
    "RobotError",
    "SeaidError",
    "SeaidWarning",
    "SeriesElasticDrive",
    "StiffDrive",
    "SymbolicError",
    "TermSelection",
    "Trajectory",
    "Validation",
    "View",
    "WrittenMjcf",
    "add_run_in",
    "base_parameters",
    "compare_terms",
    "correct_delays",
    "cross_check",
    "cross_validate",
    "cutoff_sensitivity",
    "describe_log",
    "design_excitation",
    "estimate_delays",
    "gear_ratio",
    "identifiability",
    "identify",
    "identify_conditions",
    "load_robot",
    "load_scene",
    "load_trajectory",
    "open_long_log",
    "read_log",
    "read_parameters",
    "reconstruct_motion",
    "refine",
    "regression",
    "replay",
    "simulate",
    "symbolic",
    "validate",
    "view_robot",
    "write_drivetrains",
    "write_log",
    "write_mjcf",
    "write_report",
    "write_urdf",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that `import seaid` stays quick."""
    if name in _SUBMODULES:
        return importlib.import_module(f"seaid.{name}")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'seaid' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"seaid.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
