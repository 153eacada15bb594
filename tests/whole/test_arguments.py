"""Wrong calls of the public functions: each is answered by an error that says what to do."""

import inspect
import pickle
from collections.abc import Callable, Sequence
from typing import Any, Literal, get_args

import numpy as np
import pytest
import sympy

import seaid
from seaid.drives import PARAMETERS_OF, terms
from seaid.errors import LogError, SeaidError, SymbolicError, UnknownNameError, checked, hints_of
from seaid.estimation.fitting import ESTIMATORS, LinearEstimator
from seaid.excitation import BasisName
from seaid.excitation.basis import _LEAST
from seaid.excitation.criteria import CRITERIA, CriterionName
from seaid.symbolic import separate
from tests.experiments import arm, arm_found, arm_log, arm_result

FUNCTIONS = [name for name in seaid.__all__ if inspect.isfunction(getattr(seaid, name))]


@pytest.fixture(scope="module")
def given() -> dict[str, Any]:
    """Return what a user has at hand."""
    return {"robot": arm(), "log": arm_log(), "found": arm_found(), "result": arm_result()}


PAYLOAD = seaid.Payload("foot", 2.0)
CONDITIONS = {"cold": "log", "warm": "log"}
OPTIONS: list[tuple[dict[str, Any], str]] = [
    ({"torque_joints": 3}, "s= must be .* a list of names, found 3"),
    ({"method": 2}, "must be 'auto', 'two-step' or 'simultaneous'"),
    ({"estimater": "ols"}, "no argument is named 'estimater'"),
    ({"cutoff_hz": "8"}, "number of 0.001 or more, found the text '8'"),
    ({"cutoff_hz": -3}, "cutoff_hz= must be .* 0.001 or more, .* -3"),
    (
        {"known_std": {"gear_ratio": "a"}},
        "^known_std= must be a mapping, found a dict with the text 'a', which must be a number",
    ),
    (
        {"share": {"torque": 3}},
        "^share= must be a mapping, found a dict with 3, which must be a list of names",
    ),
    ({"share": {"torque": [3]}}, "a dict with a list, which must be a list of n"),
]
"""Options of `identify`, and words of the error."""

CALLS: list[tuple[str, list[Any], dict[str, Any], str]] = [
    ("identify", ["a/leg.urdf", "log"], {}, r"must be a Robot, found the text 'a/leg\.urdf'"),
    ("identify", ["log", "robot"], {}, "robot= must be a Robot, found a Log"),
    ("identify", ["robot", None], {}, "must be a Log, .* or a list of these, found None"),
    ("compare_terms", ["robot", ["log", 3]], {}, "or a list of these, found a list with 3"),
    (
        "identify",
        ["robot", "no.csv"],
        {"method": "twostep"},
        r"method=: no method is named 'twostep'; did you mean 'two-step'\? allowed: auto, two-step",
    ),
    ("identify", ["robot", "log", ["a"]], {}, "too many positional arguments; write identify"),
    ("cross_validate", ["robot", "log"], {"cutoff": 8.0}, "did you mean 'cutoff_hz'"),
    *(("identify", ["robot", "log"], *row) for row in OPTIONS),
    ("describe_log", ["run.csv"], {"rate_hz": 0}, "rate_hz= must be .* 0.001 or more, found 0"),
    ("load_robot", ["leg.urdf"], {"payloads": PAYLOAD}, r"put it into a list: payloads=\["),
    ("write_drives", ["robot", "drives.toml"], {}, "drives= must be a mapping, found a Robot"),
    ("read_log", ["run.csv"], {}, r"argument: 'robot'; write read_log\(path, robot, "),
    ("identify_conditions", [CONDITIONS], {}, r"'cold' must be \(robot, logs\), found 'log'"),
    ("write_report", ["robot", "a.html", "result"], {}, "must be an Identification"),
]
"""[(function, its arguments, in which names stand for what is at hand, words of the error)]."""


@pytest.mark.parametrize(("name", "positional", "named", "words"), CALLS)
def test_a_wrong_call_says_what_to_do(
    name: str, positional: list[Any], named: dict[str, Any], words: str, given: dict[str, Any]
) -> None:
    """It names the argument, what was found, and the function that makes what is wanted."""

    def at_hand(value: Any) -> Any:
        if isinstance(value, list):
            return [at_hand(one) for one in value]
        return given.get(value, value) if isinstance(value, str) else value

    with pytest.raises(SeaidError, match=words):
        getattr(seaid, name)(*map(at_hand, positional), **named)


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
        with pytest.raises(SeaidError, match=f"^{name}: missing .*'{needed[0]}'; write {name}"):
            function()


def test_one_joint_may_stand_without_a_list_and_numbers_may_be_of_numpy() -> None:
    """Tuples are lists."""
    seed: Any = np.int64(1)
    joints: Any = ("shoulder", ["shoulder"], ("shoulder",))
    bases = [seaid.base_parameters(arm(), torque_joints=one, seed=seed) for one in joints]
    assert bases[0].columns == bases[1].columns == bases[2].columns
    cutoff_hz: Any = np.float32(8.0)
    assert seaid.reconstruct_motion(arm(), arm_log(), cutoff_hz).cutoff_hz == 8.0


def test_a_name_that_is_not_there_is_a_key_error_with_the_nearest_one() -> None:
    """In a robot, in a result and in an estimate, and so it comes from another process."""
    calls: tuple[tuple[Callable[[], object], str], ...] = (
        (lambda: arm().drives["sholder"], "no joint is named 'sholder'.*shoulder"),
        (lambda: arm_found().drives["sholder"], "no joint .* did you mean 'shoulder'"),
        (lambda: arm_found().drives["shoulder"].value("stifness"), "no parameter .*'stiffness'"),
    )
    for look, words in calls:
        with pytest.raises(KeyError, match=words) as problem:
            look()
        assert isinstance(problem.value, UnknownNameError)
        assert str(pickle.loads(pickle.dumps(problem.value))) == str(problem.value)
    assert "sholder" not in arm().drives
    assert arm().drives.get("sholder") is None


@pytest.mark.parametrize(
    ("names", "table"),
    [
        (LinearEstimator, ESTIMATORS),
        (BasisName, [*_LEAST, "multisine"]),  # whose size is that of its frequencies
        (CriterionName, CRITERIA),
        (terms.MotorInput, PARAMETERS_OF["motor_input"]),
    ],
)
def test_every_name_of_a_choice_has_its_entry(names: Any, table: Any) -> None:
    assert list(get_args(names)) == list(table)


def test_a_limit_of_terms_that_is_no_number_is_refused() -> None:
    m, q = sympy.Symbol("m"), sympy.Function("q")(sympy.Symbol("t"))
    terms: Any = "a"
    with pytest.raises(SymbolicError, match="max_terms= must be a whole number, found the text"):
        separate(m * q, motion=[q], unknowns=[m], max_terms=terms)


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
    assert unknown == {("cross_validate", "options"), ("write_first_project", "robot_options")}
