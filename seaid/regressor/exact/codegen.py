"""Regressors as NumPy and C99 source that needs nothing else: programs, written out."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from seaid._arrays import finite
from seaid._files import write_whole
from seaid._progress import counted
from seaid.errors import SymbolicError
from seaid.regressor.exact.geometry import number
from seaid.regressor.exact.program import Program, Value, needed

if TYPE_CHECKING:
    from seaid.regressor.exact.equations import RigidBodyForm


def text_of(value: Value) -> str:
    """Return a value as an expression that is valid in Python and in C."""
    text = ""
    for factors, x in value.items():
        sign = ("-" if x < 0 else "") if not text else (" - " if x < 0 else " + ")
        size = [] if abs(x) == 1 and factors else [repr(number(abs(x)))]
        text += sign + "*".join([*size, *factors])
    return text or "0.0"


_Entries = Mapping[tuple[int, int], Value]


def export_numpy(
    form: RigidBodyForm, path: str | Path, parameters: ArrayLike | None = None
) -> None:
    """Write the regressor as one Python file that needs NumPy only.

    It has `regressor(q, v, a)` and `base_regressor(q, v, a)` for (T, n) arrays, the names of joints
    and parameters, and the grouping matrix.

    Parameters
    ----------
    form : RigidBodyForm
        The exact regressor, of `rigid_body`.
    path : path-like
        The file to write.
    parameters : (10N,) array, optional
        Standard inertial parameters, such as `robot.parameters + robot.payload_parameters`: the
        file then also has `inverse_dynamics(q, v, a)`, the torques (T, n) of the bodies [N m or N].

    Raises
    ------
    SeaidError
        If the file cannot be written, or the parameters are not 10N finite numbers.

    Examples
    --------
    >>> form = seaid.symbolic.rigid_body(robot)
    >>> seaid.symbolic.export_numpy(form, "leg_dynamics.py", robot.parameters)
    """
    write_whole(path, numpy_source(form, _base_values(form, parameters)))


def export_c(form: RigidBodyForm, path: str | Path, parameters: ArrayLike | None = None) -> None:
    """Write the regressor as one C99 file that needs <math.h> only.

    It has `<robot>_regressor(q, v, a, Y)` and `<robot>_base_regressor(q, v, a, Y)` with row-major
    Y, and with `parameters` also `<robot>_inverse_dynamics(q, v, a, tau)`. For parameters and
    errors see `export_numpy`.
    """
    write_whole(path, c_source(form, _base_values(form, parameters)))


def _base_values(form: RigidBodyForm, parameters: ArrayLike | None) -> list[float] | None:
    if parameters is None:
        return None
    theta = finite("parameters", parameters, (len(form.parameter_names),), SymbolicError)
    return [float(x) for x in form.base.grouping @ theta]


def numpy_source(form: RigidBodyForm, values: Sequence[float] | None = None) -> str:
    """Return the text of `export_numpy` with the values of the base parameters, if any."""
    lists = {
        "JOINTS": form.joint_names,
        "PARAMETERS": form.parameter_names,
        "BASE_PARAMETERS": form.base.expressions,
    }
    groups = {
        (i, j): float(x) for i, row in enumerate(form.base.exact_rows) for j, x in row.items()
    }
    shape = form.base.grouping.shape
    return "\n".join(
        [
            '"""' + _about(form),
            "",
            "Y[t] @ theta is the inverse dynamics at sample t; base_regressor(q, v, a) @ (GROUPING "
            "@ theta)",
            "is the same. Written by seaid; needs NumPy only.",
            '"""',
            "",
            "import numpy as np",
            "",
            *(f"{key} = {_tuple(values)}" for key, values in lists.items()),
            f"BASE_COLUMNS = {form.base.columns!r}",
            f"GROUPING = np.zeros({shape!r})",
            *(f"GROUPING[{i}, {j}] = {value!r}" for (i, j), value in groups.items()),
            "",
            "",
            *_numpy_function("regressor", form, form.entries, shape[1]),
            "",
            "",
            *_numpy_function("base_regressor", form, form.base_entries, shape[0]),
            *(() if values is None else _numpy_inverse_dynamics(form, values)),
            "",
        ]
    )


def _tuple(values: Iterable[str]) -> str:
    return "(\n" + "".join(f"    {value!r},\n" for value in values) + ")"


def _about(form: RigidBodyForm) -> str:
    text = (
        f"Joint-torque regressor of '{form.robot_name}': {counted(len(form.joint_names), 'joint')} "
        f"with {len(form.parameter_names)} standard and {form.base.rank} base parameters. SI "
        "units; inertias about the joint frame; without friction and rotor inertia."
    )
    return fill(_as_comment(text), 96)


_MOST_OF_A_NAME = 60
"""Letters of the robot's name with which the names in a C file begin."""


def _as_comment(text: str) -> str:
    """Return a text with a user's names so that it cannot end a comment of C or Python.

    It could do so by `*/` or quotes, or by a backslash (or its trigraph) before the end of a line.
    Unprintable characters, which could hide text from a reader of the file, are replaced.
    """
    shown = "".join(char if char.isprintable() else "_" for char in text)
    plain = shown.translate({ord("\\"): "_", ord("?"): "_", ord('"'): "'"})
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)", " ", plain)


def _numpy_function(title: str, form: RigidBodyForm, entries: _Entries, width: int) -> list[str]:
    n = len(form.joint_names)
    lines = [f"    {line}" for line in _statements(form.program, entries, "np.", "")]
    return [
        f"def {title}(q, v, a):",
        f'    """Return Y (T, {n}, {width}) of positions, velocities, accelerations (T, {n})."""',
        "    q, v, a = (np.asarray(x, dtype=float) for x in (q, v, a))",
        f"    if not q.shape == v.shape == a.shape == (len(q), {n}):",
        f'        raise ValueError(f"q, v and a must be (T, {n}), found {{q.shape}}, {{v.shape}}, '
        '{a.shape}")',
        *_inputs(form.program, entries, n, "    {0}{1} = {0}[:, {1}]"),
        *lines,
        f"    Y = np.zeros((len(q), {n}, {width}))",
        *(f"    Y[:, {i}, {j}] = {text_of(value)}" for (i, j), value in sorted(entries.items())),
        "    return Y",
    ]


def _numpy_inverse_dynamics(form: RigidBodyForm, values: Sequence[float]) -> list[str]:
    n = len(form.joint_names)
    return [
        "",
        "",
        f"BASE_VALUES = np.array({list(values)!r})",
        "",
        "",
        "def inverse_dynamics(q, v, a):",
        f'    """Return the torques (T, {n}) of the bodies, with BASE_VALUES [N m or N]."""',
        "    return base_regressor(q, v, a) @ BASE_VALUES",
    ]


def c_source(form: RigidBodyForm, values: Sequence[float] | None = None) -> str:
    """Return the text of `export_c` with the values of the base parameters, if any."""
    prefix = re.sub(r"\W", "_", form.robot_name, flags=re.ASCII)[:_MOST_OF_A_NAME] or "robot"
    prefix = f"robot_{prefix}" if prefix[0].isdigit() else prefix
    names = "\n".join(
        f"   {i}: {_as_comment(text)}" for i, text in enumerate(form.base.expressions)
    )
    return "\n".join(
        [
            "/* " + _about(form).replace("\n", "\n   "),
            "   Y is row-major, one row per joint. Base parameters:",
            names,
            "   Written by seaid; C99, needs <math.h> only. */",
            "",
            "#include <math.h>",
            "#include <string.h>",
            "",
            *_c_function(f"{prefix}_regressor", form, form.entries, len(form.parameter_names)),
            "",
            *_c_function(f"{prefix}_base_regressor", form, form.base_entries, form.base.rank),
            "",
            *(() if values is None else _c_inverse_dynamics(prefix, form, values)),
        ]
    )


def _c_inverse_dynamics(prefix: str, form: RigidBodyForm, values: Sequence[float]) -> list[str]:
    """Return the lines of tau = R_0 theta_0 with the values theta_0 in SI units."""
    n = len(form.joint_names)
    rows: dict[int, list[str]] = {i: [] for i in range(n)}
    for (i, j), value in sorted(form.base_entries.items()):
        rows[i].append(f"\n        + ({values[j]!r})*({text_of(value)})")
    return [
        *_c_head(f"{prefix}_inverse_dynamics", f"tau[{n}]", form, form.base_entries),
        *(f"    tau[{i}] = 0.0{''.join(terms)};" for i, terms in rows.items()),
        "}",
        "",
    ]


def _c_function(title: str, form: RigidBodyForm, entries: _Entries, width: int) -> list[str]:
    size = len(form.joint_names) * width
    return [
        *_c_head(title, f"Y[{size}]", form, entries),
        f"    memset(Y, 0, {size} * sizeof *Y);",
        *(
            f"    Y[{i * width + j}] = {text_of(value)};"
            for (i, j), value in sorted(entries.items())
        ),
        "}",
    ]


def _c_head(title: str, output: str, form: RigidBodyForm, entries: _Entries) -> list[str]:
    """Return the lines of a function of q, v and a before its output is written."""
    n = len(form.joint_names)
    lines = _statements(form.program, entries, "", "const double ")
    inputs = ", ".join(f"const double {x}[{n}]" for x in "qva")
    return [
        f"void {title}({inputs}, double {output})",
        "{",
        # Without these a compiler warns of inputs that no entry needs.
        "    (void)q, (void)v, (void)a;",
        *_inputs(form.program, entries, n, "    const double {0}{1} = {0}[{1}];"),
        *(f"    {line};" for line in lines),
    ]


def _inputs(program: Program, entries: _Entries, n: int, pattern: str) -> list[str]:
    used = needed(program, entries.values())
    return [pattern.format(x, i) for x in "qva" for i in range(n) if f"{x}{i}" in used]


def _statements(program: Program, entries: _Entries, module: str, declare: str) -> list[str]:
    """Return the assignments that the entries need, in order."""
    used = needed(program, entries.values())
    lines = [
        f"{declare}{text} = {module}{function}({argument})"
        for text, (function, argument) in program.circular.items()
        if text in used
    ]
    return lines + [
        f"{declare}{text} = {text_of(value)}"
        for text, value in program.steps.items()
        if text in used
    ]
