"""Wrong calls of the public functions: each is answered by an error that says what to do."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import pytest

import seaid
from seaid.drives.terms import (
    PARAMETERS_OF,
    FrictionTerm,
    JointFrictionTerm,
    MotorInput,
    ParallelSpringTerm,
    SpringTerm,
)
from seaid.errors import MADE_BY, LogError, SeaidError, UnknownNameError, checked, hints_of
from seaid.estimation.fitting import ESTIMATORS, LinearEstimator
from seaid.excitation.basis import _LEAST, BasisName
from seaid.excitation.criteria import CRITERIA, CriterionName
from seaid.identification import Identification, Validation
from seaid.log import Log
from seaid.robot import Robot
from tests.experiments import arm, arm_found, arm_log, arm_result


@dataclass(frozen=True)
class Given:
    """What a user has at hand."""

    robot: Robot
    log: Log
    found: Identification
    result: Validation
    plan: seaid.Trajectory
    path: Path


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Given:
    basis = seaid.excitation.make_basis("bspline", 2.0, 9)
    plan = seaid.Trajectory(arm().joint_names, basis, np.zeros((9, arm().n)))
    path = tmp_path_factory.mktemp("wrong") / "leg.urdf"
    return Given(arm(), arm_log(), arm_found(), arm_result(), plan, path)


FUNCTIONS = [name for name in seaid.__all__ if inspect.isfunction(getattr(seaid, name))]
Call = tuple[str, Any, str]

CALLS: dict[str, Call] = {
    "a path for the robot": (
        "identify",
        lambda x: ([str(x.path), x.log], {}),
        r"robot= must be a Robot, found the text '.*leg\.urdf'; make one with seaid\.load_robot\(",
    ),
    "robot and log swapped": (
        "identify",
        lambda x: ([x.log, x.robot], {}),
        r"found a Log: robot and logs are swapped; write identify\(robot, logs\)",
    ),
    "no log": (
        "identify",
        lambda x: ([x.robot, None], {}),
        r"logs= must be a Log, .*found None; make one with seaid\.read_log\(path, robot\)",
    ),
    "a list with another thing": (
        "compare_terms",
        lambda x: ([x.robot, [x.log, 3]], {}),
        r"logs= must be .* or a list of these, found a list with 3",
    ),
    "a number for torque_joints": (
        "identify",
        lambda x: ([x.robot, x.log], {"torque_joints": 3}),
        "torque_joints= must be a name or a list of names, found 3",
    ),
    "an unknown method": (
        "identify",
        lambda x: (["leg.urdf", None], {"method": "twostep"}),
        "robot= must be",
    ),
    "a misspelled method": (
        "identify",
        lambda x: ([x.robot, "nowhere.csv"], {"method": "twostep"}),
        r"method=: no method is named 'twostep'; did you mean 'two-step'\? allowed: auto, two-step",
    ),
    "an estimator that conditions do not have": (
        "identify_conditions",
        lambda x: ([{}], {"estimator": "iv"}),
        f"no estimator is named 'iv'; allowed: {', '.join(ESTIMATORS)}$",
    ),
    "no text for a choice": (
        "identify",
        lambda x: ([x.robot, x.log], {"method": 2}),
        "method= must be 'auto', 'two-step' or 'simultaneous', found 2",
    ),
    "a misspelled argument": (
        "identify",
        lambda x: ([x.robot, x.log], {"estimater": "ols"}),
        "identify: no argument is named 'estimater'; did you mean 'estimator'",
    ),
    "too many arguments": (
        "identify",
        lambda x: ([x.robot, x.log, ["shoulder"]], {}),
        r"identify\(robot, logs\) takes at most 2 arguments without a name, found 3: write .*=",
    ),
    "a misspelled option of identify": (
        "cross_validate",
        lambda x: ([x.robot, x.log], {"cutoff": 8.0}),
        "identify: no argument is named 'cutoff'; did you mean 'cutoff_hz'",
    ),
    "a text for a number": (
        "identify",
        lambda x: ([x.robot, x.log], {"cutoff_hz": "8"}),
        "cutoff_hz= must be a number, found the text '8'",
    ),
    "one payload": (
        "load_robot",
        lambda x: (["leg.urdf"], {"payloads": seaid.Payload("foot", 2.0)}),
        r"payloads= must be a list of Payloads, found a Payload; put it into a list: payloads=\[",
    ),
    "a robot for its drives": (
        "write_drives",
        lambda x: ([x.robot, "drives.toml"], {}),
        "drives= must be a mapping, found a Robot",
    ),
    "write_log swapped": (
        "write_log",
        lambda x: (["run.csv", x.log], {}),
        r"log and path are swapped; write write_log\(log, path\)",
    ),
    "a log without its robot": (
        "read_log",
        lambda x: (["run.csv"], {}),
        r"robot is missing: write read_log\(path, robot\); make it with seaid\.load_robot\(",
    ),
    "one sensor": (
        "identifiability",
        lambda x: ([x.robot, "deflection"], {}),
        r"sensors= must be a list of names or a mapping, .*put it into a list: sensors=\[",
    ),
    "conditions without robots": (
        "identify_conditions",
        lambda x: ([{"cold": x.log, "warm": x.log}], {}),
        r"condition 'cold' must be \(robot, logs\), found Log\(",
    ),
    "a report of a robot": (
        "write_report",
        lambda x: ([x.robot, "report.html", x.result], {}),
        r"identification= must be an Identification, found a Robot; make one with seaid",
    ),
}


@pytest.mark.parametrize("case", CALLS)
def test_a_wrong_call_says_what_to_do(case: str, given: Given) -> None:
    name, arguments, words = CALLS[case]
    positional, named = arguments(given)
    with pytest.raises(SeaidError, match=words):
        getattr(seaid, name)(*positional, **named)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_refuses_what_is_no_argument(name: str) -> None:
    """No function of the library reads a file or fails inside for an object of no use."""
    function = getattr(seaid, name)
    places = [
        one
        for one in inspect.signature(function).parameters.values()
        if one.kind is one.POSITIONAL_OR_KEYWORD
    ]
    needed = [one.name for one in places if one.default is one.empty]
    with pytest.raises(SeaidError, match=f"^{places[0].name}= must be .*, found an object"):
        function(*[object()] * max(len(needed), 1))
    if needed:
        with pytest.raises(SeaidError, match=f"^{needed[0]} is missing: write {name}"):
            function()


def test_one_joint_may_stand_without_a_list(given: Given) -> None:
    one, same = (
        seaid.base_parameters(given.robot, torque_joints=joints)
        for joints in ("shoulder", ["shoulder"])
    )
    assert one.columns == same.columns


def test_numbers_of_numpy_and_tuples_are_arguments(given: Given) -> None:
    cutoff_hz: Any = np.float32(8.0)
    seed: Any = np.int64(1)
    assert seaid.reconstruct_motion(given.robot, given.log, cutoff_hz).cutoff_hz == 8.0
    assert seaid.base_parameters(given.robot, torque_joints=("shoulder",), seed=seed).names


@pytest.mark.parametrize("value", ["kne", "knee_pich"])
def test_a_joint_that_is_not_there_is_a_key_error_with_the_nearest_name(
    value: str, tulip_leg: Robot
) -> None:
    with pytest.raises(KeyError, match=f"no joint is named '{value}'.*knee_pitch") as problem:
        tulip_leg.drives[value]
    assert isinstance(problem.value, SeaidError)
    assert str(pickle.loads(pickle.dumps(problem.value))) == str(problem.value)
    assert value not in tulip_leg.drives
    assert tulip_leg.drives.get(value) is None


def test_entries_of_results_say_the_nearest_name(given: Given) -> None:
    with pytest.raises(UnknownNameError, match=r"no joint .* did you mean 'shoulder'"):
        given.found.drives["sholder"]
    with pytest.raises(UnknownNameError, match="no parameter is named 'stifness'; did you mean"):
        given.found.drives["shoulder"].value("stifness")


def test_what_makes_an_argument_is_a_function_or_a_type_of_seaid() -> None:
    for call in MADE_BY.values():
        assert hasattr(seaid, call.removeprefix("seaid.").split("(")[0]), call


@pytest.mark.parametrize(
    ("names", "table"),
    [
        (LinearEstimator, ESTIMATORS),
        (BasisName, [*_LEAST, "multisine"]),  # whose size is that of its frequencies
        (CriterionName, CRITERIA),
        (MotorInput, PARAMETERS_OF["motor_input"]),
        (FrictionTerm, PARAMETERS_OF["friction"]),
        (SpringTerm, PARAMETERS_OF["spring"]),
        (ParallelSpringTerm, PARAMETERS_OF["parallel_spring"]),
        (JointFrictionTerm, PARAMETERS_OF["joint_friction"]),
    ],
)
def test_every_name_of_a_choice_has_its_entry(names: Any, table: Any) -> None:
    assert list(get_args(names)) == list(table)


def test_lists_within_lists_are_left_to_the_function() -> None:
    @checked(LogError)
    def takes(
        pairs: Sequence[tuple[str, str]] = (), *, kind: Literal["a", "b"] | None = None
    ) -> int:
        """Return the number of pairs."""
        return len(pairs)

    assert takes([("a", "b"), "cd"], kind=None) == 2  # type: ignore[list-item]
    with pytest.raises(LogError, match="pairs= must be a list of tuples, found 3"):
        takes(3)  # type: ignore[arg-type]
    with pytest.raises(LogError, match="kind=: no kind is named 'c'; allowed: a, b"):
        takes(kind="c")  # type: ignore[arg-type]
    assert takes.__name__ == "takes"
    assert list(inspect.signature(takes).parameters) == ["pairs", "kind"]


def test_all_annotations_are_types_that_are_compared() -> None:
    """Those of modules that import a type for types only are found in the faces of packages."""
    unknown = {
        (name, argument)
        for name in FUNCTIONS
        for argument, hint in hints_of(getattr(seaid, name)).items()
        if hint is Any
    }
    assert unknown == {
        (name, "options") for name in ("cross_validate", "cutoff_sensitivity", "run")
    }
