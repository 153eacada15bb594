"""The exact regressor as sympy, as a function, and as files that stand alone."""

import ast
import ctypes
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from seaid._arrays import Array
from seaid.errors import SeaidError
from seaid.legged import load_robot
from seaid.regressor import joint_torques, rigid_body_regressor
from seaid.regressor.base import random_states
from seaid.robot import Robot
from seaid.symbolic import complete_model, export_c, export_numpy, reduce, rigid_body, separate

Y_AXIS = '<axis xyz="0 1 0"/>'


def assert_close(found: Array, expected: Array) -> None:
    assert found.shape == expected.shape
    assert np.max(np.abs(found - expected)) < 1e-9 * max(1.0, np.max(np.abs(expected)))


def test_sympy_regressor_of_a_pendulum(write_chain: Callable[..., Path]) -> None:
    form = rigid_body(load_robot(write_chain({"a": f"continuous {Y_AXIS}"})))
    (q,), (_,), (a,) = form.motion
    assert (q.is_real, a.is_real) == (True, True)
    g = sp.Rational(981, 100)
    R = form.expanded(form.R)
    torque = [0, -g * sp.cos(q), 0, -g * sp.sin(q), 0, 0, a, 0, 0, 0]
    assert (R - sp.Matrix([torque])).expand() == sp.zeros(1, 10)
    assert form.expanded(form.R_0) == R.extract([0], list(form.base.columns))


def test_shapes_are_checked(tulip_leg: Robot) -> None:
    form = rigid_body(tulip_leg)
    q = np.zeros((4, 5))
    with pytest.raises(SeaidError, match=r"v must have shape \(any, 5\)"):
        form.regressor(q, q[:, :4], q)
    with pytest.raises(SeaidError, match="as many rows, found 4, 3, 4"):
        form.base_regressor(q, q[:3], q)


def test_numpy_file_stands_alone(tulip_leg: Robot, tmp_path: Path) -> None:
    form = rigid_body(tulip_leg)
    export_numpy(form, tmp_path / "leg_regressor.py", tulip_leg.parameters)
    states = random_states(tulip_leg, seed=4)
    np.savez(tmp_path / "states.npz", *states)
    program = (
        "import sys, numpy as np, leg_regressor as leg\n"
        "states = np.load('states.npz')\n"
        "states = [states[f'arr_{i}'] for i in range(3)]\n"
        "np.savez('found.npz', leg.regressor(*states), leg.base_regressor(*states), leg.GROUPING,"
        "    leg.inverse_dynamics(*states))\n"
        "assert len(leg.BASE_PARAMETERS) == len(leg.BASE_COLUMNS) == 29\n"
        "assert leg.JOINTS[0] == 'hip_yaw' and len(leg.PARAMETERS) == 50\n"
        "assert not {'pinocchio', 'seaid', 'sympy'} & set(sys.modules)\n"
        "try:\n"
        "    leg.regressor(*[x[:, :4] for x in states])\n"
        "except ValueError as problem:\n"
        "    assert '(T, 5)' in str(problem)\n"
        "else:\n"
        "    raise AssertionError\n"
    )
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True)
    found = np.load(tmp_path / "found.npz")
    expected = rigid_body_regressor(tulip_leg, *states)
    assert_close(found["arr_0"], expected)
    assert_close(found["arr_1"], form.base.reduce(expected))
    assert np.array_equal(found["arr_2"], form.base.grouping)
    assert_close(found["arr_3"], joint_torques(tulip_leg, *states))


def test_c_file_stands_alone(tulip_leg: Robot, tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler named cc")
    form = rigid_body(tulip_leg)
    source, library = tmp_path / "leg.c", tmp_path / "leg.so"
    export_c(form, source, tulip_leg.parameters)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, str(source), "-o", str(library), "-lm"], check=True)
    functions = ctypes.CDLL(str(library))
    states = random_states(tulip_leg, seed=5)
    expected = rigid_body_regressor(tulip_leg, *states)
    for title, wanted in (
        ("tulip_leg_regressor", expected),
        ("tulip_leg_base_regressor", form.base.reduce(expected)),
        ("tulip_leg_inverse_dynamics", joint_torques(tulip_leg, *states)),
    ):
        found = np.empty_like(wanted, order="C")
        for t in range(len(found)):
            arrays = [np.ascontiguousarray(x[t]) for x in states] + [found[t]]
            pointers = [x.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for x in arrays]
            getattr(functions, title)(*pointers)
        assert_close(found, wanted)


def test_files_that_cannot_be_written_are_not_there(tulip_leg: Robot, tmp_path: Path) -> None:
    """For parameters of another size or not finite, or for a path that is none."""
    form = rigid_body(tulip_leg)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(SeaidError, match=r"parameters must have shape \(50\), found \(49,\)"):
        export_c(form, tmp_path / "leg.c", np.ones(49))
    with pytest.raises(SeaidError, match="parameters must be finite"):
        export_numpy(form, tmp_path / "leg.py", np.full(50, np.nan))
    with pytest.raises(SeaidError, match="cannot write"):
        export_numpy(form, tmp_path / "file" / "regressor.py")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_complete_model_is_one_system_for_algorithm_1(write_chain: Callable[..., Path]) -> None:
    """Its base parameters are those of the bodies, the spring and the friction of both motors."""
    knee = f'{Y_AXIS}<origin xyz="0 0 -0.275"/>'
    path = write_chain({"hip": f"continuous {Y_AXIS}", "knee": f"continuous {knee}"})
    drives = {
        "hip": {"type": "stiff", "gear_ratio": 50.0, "motor_inertia_kg_m2": 1e-5},
        "knee": {"type": "series_elastic", "gear_ratio": 100.0, "motor_inertia_kg_m2": 3e-6},
    }
    model = complete_model(load_robot(path, drives))
    assert len(model.equations) == 3
    assert [str(x) for x in model.coordinates] == ["q_hip(t)", "q_knee(t)", "theta_M_knee(t)"]
    assert [str(x) for x in model.inputs] == ["tau_M_hip(t)", "tau_M_knee(t)"]
    drive = [sp.Symbol(x) for x in ("F_v_hip", "F_C_hip", "F_v_knee", "F_C_knee", "k_knee")]
    unknowns = [*drive, sp.Symbol("f_0_knee"), *model.parameters]
    base = reduce(separate(model.equations, [*model.coordinates, *model.inputs], unknowns))
    # The planar 2R has 6; the spring tells k and f_0 in both equations, the motors friction each.
    assert len(base.pivots) == 6 + 6


def test_ideal_drive_has_the_joint_torque(write_chain: Callable[..., Path]) -> None:
    model = complete_model(load_robot(write_chain({"a": f"continuous {Y_AXIS}"})))
    assert str(model.inputs[0]) == "tau_a(t)"
    assert model.equations[0].diff(model.inputs[0]) == -1


ODD_NAMES = [
    "x*\\&#10;/ int evil(void) { return 1; } /*",
    "x*/ int evil(void) { return 1; } /*",
    "x*??/&#10;/ int evil(void); /*",
    "x**//**/&quot;&quot;&quot;&#10;evil = 1&#10;&quot;&quot;&quot;",
    "x\\",
    "x&#x202E;*/",
    "\u00e4\u00df \u4e2d",
    "7 &quot;x&quot; */",
]


@pytest.mark.parametrize("name", ODD_NAMES)
def test_no_name_of_a_user_leaves_its_comment(
    name: str, write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    urdf = write_urdf(
        f'<link name="base"/><link name="{name}"/><joint name="{name}" type="continuous">'
        f'<parent link="base"/><child link="{name}"/>{Y_AXIS}</joint>'
    )
    urdf.write_text(urdf.read_text().replace('robot name="test"', f'robot name="{name}"'))
    form = rigid_body(load_robot(urdf))
    export_c(form, tmp_path / "out.c")
    export_numpy(form, tmp_path / "out.py")
    text = (tmp_path / "out.c").read_text("utf-8")
    about, code = text[: text.index("*/")], text[text.index("*/") + 2 :]
    assert "/*" not in about[2:]
    assert "\\" not in text
    assert code.lstrip().startswith("#include <math.h>")
    assert re.fullmatch(r"[\x20-\x7e\n]*", code)
    assert re.search(r"void \w+_regressor\(", code)
    tree = ast.parse((tmp_path / "out.py").read_text("utf-8"))
    assert {type(one).__name__ for one in tree.body} <= {"Expr", "Import", "Assign", "FunctionDef"}
    assigned = [one.targets[0] for one in tree.body if isinstance(one, ast.Assign)]
    assert "evil" not in {one.id for one in assigned if isinstance(one, ast.Name)}
    if shutil.which("cc"):
        flags = ["-std=c99", "-Wall", "-Werror", "-fsyntax-only"]
        subprocess.run(["cc", *flags, str(tmp_path / "out.c")], check=True)
