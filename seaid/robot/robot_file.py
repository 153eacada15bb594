"""The text of a robot's description: what a path or a name stands for, and what it must be instead.

`urdf_path` resolves names of robot_descriptions and of example-robot-data; `urdf_text` reads a
URDF, expands a xacro file where the package xacro is installed, converts a MuJoCo model, and says
for any other file what it is and what turns it into a URDF. The root element alone decides whether
a file is a URDF, MJCF or SDF.
"""

from __future__ import annotations

import difflib
import importlib
import math
import re
import warnings
from contextlib import suppress
from io import BytesIO
from pathlib import Path

from seaid._files import working_folder
from seaid.errors import RobotError, SeaidWarning, check_name, listed, reason_of, shortened
from seaid.robot.urdf import SNAP_RAD, UrdfTree, urdf_tree

LARGEST_BYTES = 16_000_000
"""Limit on the size of a URDF file, whose elements take ten times as much memory; robots of 5,000
joints are below it."""

ROBOT_SUFFIXES = (".urdf", ".xacro", ".sdf", ".xml", ".mjcf")
"""Suffixes of files that describe a robot, read or refused with the converter's name."""

_LOGS = (".csv", ".npz", ".json", ".parquet", ".h5", ".hdf5", ".mat", ".txt", ".bag", ".mcap")
_NAME = re.compile(r"[A-Za-z0-9_]{1,100}")
_MOST_NAMED = 5
"""Files of a folder that a message names."""

_PACKED = {b"\x1f\x8b": "gunzip -k", b"PK\x03\x04": "unzip", b"\xfd7zXZ": "unxz -k"}
"""{first bytes of a compressed file: the command that unpacks it}."""

_VERSION_0 = re.compile(rb"""\A((?:\xef\xbb\xbf)?<\?xml\s+version\s*=\s*["'])0\.0(?=["'])""")
_NAMESPACE = re.compile(rb"""\s+xmlns\s*=\s*(?:"[^"]*"|'[^']*')""")


def urdf_path(urdf: str | Path) -> Path:
    """Return the file of a path, or of a name.

    Names are those of robot_descriptions, such as 'go2_description', and of the URDFs of
    example-robot-data, such as 'panda'.
    """
    path, name = Path(urdf), str(urdf)
    if not _NAME.fullmatch(name) or path.is_file():
        return path
    if not name.endswith("_description"):
        return _example(name) or path
    try:
        known = importlib.import_module("robot_descriptions").DESCRIPTIONS
    except ImportError:
        raise RobotError(
            f"{_missing(path)}; if it is a name of the package robot_descriptions, install that "
            "package: pip install robot_descriptions"
        ) from None
    check_name("robot of robot_descriptions", name, known, RobotError)
    try:
        module = importlib.import_module(f"robot_descriptions.{name}")
    except Exception as problem:  # what cloning a repository raises
        raise RobotError(
            f"robot_descriptions cannot get '{name}': {reason_of(problem)}; it clones a repository "
            "into $ROBOT_DESCRIPTIONS_CACHE (default ~/.cache/robot_descriptions) at the first use"
        ) from None
    for kind in ("URDF_PATH", "XACRO_PATH", "MJCF_PATH"):
        if hasattr(module, kind):
            return Path(getattr(module, kind))
    raise RobotError(f"robot_descriptions has neither a URDF nor an MJCF of '{name}'")


def _example(name: str) -> Path | None:
    """Return a robot of example-robot-data by the name of its URDF; None if there is none.

    As of example_robot_data.load, which the package on PyPI lacks: 'ur5' is ur5_robot.urdf. Raises
    RobotError if several begin with the name.
    """
    from importlib import metadata

    try:
        files = metadata.files("example-robot-data") or []
    except metadata.PackageNotFoundError:
        return None
    urdfs = {path.stem: path for path in files if path.suffix == ".urdf"}
    for exact in (name, f"{name}_robot"):
        if exact in urdfs:
            return Path(str(urdfs[exact].locate())).resolve()
    near = sorted(stem for stem in urdfs if stem.startswith(name))
    if near:
        raise RobotError(
            f"example-robot-data has no robot '{name}' but {listed(near)}: name one of them"
        )
    return None


def urdf_text(path: Path) -> bytes:
    """Return a file as the text of a URDF. Raises RobotError, with the remedy, if it is none."""
    text = _content(path)
    _check_kind(path, text)
    if b"<xacro:" in text and b"<xacro:" in re.sub(rb"<!--.*?-->", b"", text, flags=re.DOTALL):
        text = _expanded(path)  # an expanded file keeps the namespace, and comments
    root, text = _root_and_text(text)
    if root == "mujoco":
        from seaid.robot.mjcf import urdf_of_mjcf

        return urdf_of_mjcf(path)
    if root == "sdf":
        raise RobotError(
            f"'{path}' is SDF, which seaid does not read: convert it to URDF (the ROS 2 package "
            "sdformat_urdf, or sdf2urdf of pysdf), or name the URDF from which it was made"
        )
    return text


def _check_kind(path: Path, text: bytes) -> None:
    """Raise RobotError for a file that is packed, a table of drives or a log."""
    for start, command in _PACKED.items():
        if text.startswith(start):
            raise RobotError(
                f"'{path}' is compressed: unpack it ({command} {path.name}) and name the URDF"
            )
    if path.suffix.lower() == ".toml":
        raise RobotError(
            f"'{path}' is TOML, not a URDF: the robot's URDF comes first, and its drives as "
            "drives=",
            "drives=",
        )
    if path.suffix.lower() in _LOGS and not text.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        raise RobotError(
            f"'{path}' is not a URDF, by its name a log: the robot's URDF comes first, then the "
            "logs"
        )


def is_mjcf(path: Path) -> bool:
    """Whether a file is a MuJoCo model by its root element; a URDF may contain a <mujoco> too."""
    return _root_and_text(_content(path))[0] == "mujoco"


def _root_and_text(text: bytes) -> tuple[str, bytes]:
    """Return the tag of an XML text's root, "" if it has none, and the text as readers take it.

    TinyXML, with which Pinocchio, MuJoCo and ROS read a URDF, knows neither namespaces nor versions
    of XML: the text has no default namespaces, and version 1.0 for 0.0.
    """
    from lxml import etree

    text = _NAMESPACE.sub(b"", _VERSION_0.sub(rb"\g<1>1.0", text))
    with suppress(etree.XMLSyntaxError):  # the parser of the URDF names it
        for _, root in etree.iterparse(BytesIO(text), events=("start",)):
            return str(root.tag), text
    return "", text


def _content(path: Path) -> bytes:
    """Return the bytes of a file. Raises RobotError if it is missing or too large."""
    try:
        if not path.is_file():
            raise RobotError(_missing(path))
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            raise RobotError(
                f"URDF '{path}' is too large: {size:,} bytes, allowed are {LARGEST_BYTES:,}"
            )
        return path.read_bytes()
    except OSError as problem:
        raise RobotError(f"{_missing(path)}: {reason_of(problem)}") from None


def _missing(path: Path) -> str:
    """Return that there is no such file, and which robots are in its folder."""
    text = f"no URDF file at '{shortened(str(path), 500)}' ({working_folder()})"
    try:
        is_folder = path.is_dir()
        folder = path if is_folder else path.parent
        files = sorted(x.name for x in folder.iterdir() if x.suffix.lower() in ROBOT_SUFFIXES)
    except (OSError, ValueError):
        return text
    near = files if is_folder else difflib.get_close_matches(path.name, files, 3, 0.6)
    if not near:
        return text
    names = listed(near, _MOST_NAMED)
    return f"{text}: it is a folder; in it: {names}" if is_folder else f"{text}; there is {names}"


def _expanded(path: Path) -> bytes:
    """Return the URDF of a xacro file by the package xacro, or raise with the command."""
    command = f"xacro {path.name} > {path.name.split('.')[0]}.urdf"
    try:
        xacro = importlib.import_module("xacro")
    except ImportError:
        raise RobotError(
            f"'{path}' is a xacro file, not a URDF: expand it ({command}) and name the URDF, or "
            "install the package that reads it here (pip install xacro)"
        ) from None
    try:
        return bytes(xacro.process_file(str(path)).toxml(encoding="utf-8"))
    except Exception as problem:  # xacro lets through what its expressions raise
        raise RobotError(
            f"xacro cannot expand '{path}': {reason_of(problem)}; expand it with its arguments in "
            f"the ROS workspace ({command} name:=value) and name the URDF"
        ) from None


def reread_urdf(
    path: str | Path, text: bytes | None = None, snap_tolerance_rad: float = SNAP_RAD
) -> UrdfTree:
    """Read a loaded robot's URDF, or its `text`, without repeating its warnings."""
    path = Path(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeaidWarning)
        return urdf_tree(path, urdf_text(path) if text is None else text, snap_tolerance_rad)


def read_urdf(path: str | Path, snap_tolerance_rad: float) -> UrdfTree:
    """Read a URDF file, with angles snapped to the multiples of pi/2 that they mean.

    An angle means a multiple of pi/2 if it agrees with it within the tolerance and either to the
    digits in the file (1.57, 1.5708, 3.14159) or to float noise (1e-6 rad). One warning lists
    them; tolerance 0 keeps all angles. Raises RobotError for a file that is missing, broken or not
    a tree.
    """
    path = Path(path)
    if not 0 <= snap_tolerance_rad < math.pi / 4:
        raise RobotError(
            f"snap_tolerance_rad must be between 0 and pi/4, found {snap_tolerance_rad}"
        )
    return urdf_tree(path, urdf_text(path), snap_tolerance_rad)
