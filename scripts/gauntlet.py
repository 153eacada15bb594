"""The gauntlet: which mistakes of a set-up `seaid.identify` names, and which its remedies repair.

Every mistake of `scripts/gauntlet_mistakes.py` and `scripts/gauntlet_joints.py`, in a severe and a
mild form, is made at every robot of `scripts/gauntlet_robots.py`, and the files are given to
`load_robot`, `read_log` and `identify` as a user gives them. Right set-ups show the false alarms.
One letter per case:

    R  flagged with the right code, and the remedy as printed repairs the result
    N  flagged (or refused) with the right code, but not repaired, or nothing can repair it
    n  named in a note, and the result is right: the mistake is harmless now
    D  flagged with other codes only
    t  not flagged, and the result is right
    -  not flagged, and the result is wrong
    !  an exception that is no error of seaid

A result is right if its predictions of an unseen motion are: at each joint the torque of the bodies
(without payloads, against the true one) and the motor torque of the drive, with an error of at most
1.5 times that of the right set-up plus 3 % of the torque. All printed lines are applied, those of
notes and of findings with other codes too, in one go. They repair if the result is right and no
finding of severity "wrong" with a right code is left. A rival that the finding of another code
names counts as its code. A false explanation is another code next to the right one, above a note.

A payload, a factor on torques in an arbitrary unit, or a tilt can only be estimated from the masses
of the robot file, which are off by up to 15 % here: no log separates a payload from the body that
carries it. After such a remedy the errors may be twice those of the right set-up plus 3 %, or
within what these masses leave open, 15 % of the torque. (Decided before the runs.)

A quadruped on the ground has mistakes of its own (`scripts/gauntlet_flags.py`) and right set-ups.
It is judged by the torques of its joints on an unseen motion.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
import time
import tomllib
import warnings
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from itertools import repeat
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import seaid
from seaid._arrays import Array
from seaid._files import result_folder, write_json
from seaid._progress import track
from seaid.checks import CODES
from seaid.errors import SeaidWarning
from seaid.regressor import rigid_body_regressor
from seaid.report import table

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.gauntlet_flags import flag_mistakes
from scripts.gauntlet_joints import joint_mistakes
from scripts.gauntlet_legs import QUADRUPED
from scripts.gauntlet_mistakes import HELD_OUT, Case, Mistake, Setup, mistakes
from scripts.gauntlet_robots import (
    MASSES_OFF,
    Sensors,
    columns,
    commanded,
    load,
    right_subjects,
    subjects,
    true_motion,
    true_robot,
)

WORSE, FLOOR = 1.5, 0.03
"""A result is right up to this multiple of the error of the right set-up plus this share."""

WORSE_BY_MASSES = 2.0
"""The same multiple after a remedy whose value rests on nominal masses, or up to `MASSES_OFF`."""

ROBOTS = [*subjects(), QUADRUPED]
"""Those at which mistakes are made."""

ROUNDS = 3
"""Remedies that a user applies one after the other."""


@dataclass(frozen=True)
class Said:
    """A finding, a warning of a reader, or a refusal, as far as the judgement needs it."""

    code: str
    severity: str
    joint: str
    message: str
    remedy: str = ""
    rivals: tuple[str, ...] = ()

    @property
    def codes(self) -> set[str]:
        """Its code, and those of the causes that explain as much."""
        return {self.code, *self.rivals} - {""}


@dataclass(frozen=True)
class Run:
    """What a user sees of one identification: findings, and the errors of its predictions."""

    said: tuple[Said, ...]
    errors: Array | None = None
    crash: str = ""


@dataclass(frozen=True)
class Outcome:
    """The judgement of one mistake at one robot."""

    mistake: str
    form: str
    robot: str
    seed: int
    letter: str
    worst_error: float
    repaired_error: float | None = None
    said: tuple[Said, ...] = ()
    after: tuple[Said, ...] = ()
    crash: str = ""
    codes: tuple[str, ...] = field(default=())
    repairable: bool = True
    harmless: bool = False

    @property
    def false_codes(self) -> list[str]:
        """Codes of findings above a note that explain nothing, in a case that is named."""
        found = {x.code for x in self.said if x.severity != "note" and x.code
                 and not x.codes & {*self.codes}}  # fmt: skip
        return sorted(found) if self.letter in "RN" else []


def run(case: Case, setup: Setup, truth: str = "plain") -> Run:
    """Load, read and identify as a user does, and predict an unseen motion of the true robot."""
    said: list[Said] = []
    found: seaid.Identification | None = None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = _identified(setup)
        except seaid.SeaidError as problem:
            said.append(Said("", "refused", "", str(problem), str(problem)))
        except Exception as problem:  # the gauntlet reports what no user should see
            return Run((), crash=f"{type(problem).__name__}: {problem}")
    said += [
        Said("", "doubtful", "", str(one.message), str(one.message))
        for one in caught
        if issubclass(one.category, SeaidWarning)
    ]
    if found is None:
        return Run(tuple(said))
    said += [
        Said(one.code, one.severity, one.joint, one.message, one.remedy, _rivals(one))
        for one in found.weighed_findings
    ]
    return Run(tuple(said), _errors(case, truth, found))


def _rivals(finding: seaid.Finding) -> tuple[str, ...]:
    """Return the codes of the other causes that the evidence of a finding names."""
    return tuple(key.removeprefix("or ") for key in finding.evidence if key.startswith("or "))


def _identified(setup: Setup) -> seaid.Identification:
    """Return the identification of what a user hands over. Raises SeaidError."""
    robot, logs = read(setup)
    return seaid.identify(robot, logs, **setup.options)


def read(setup: Setup) -> tuple[seaid.Robot, list[seaid.Log]]:
    """Return the robot and the logs of what a user hands over. Raises SeaidError."""
    given = setup.urdf, setup.drives, setup.payloads
    robot = load(*given, gravity=setup.gravity, **setup.base)
    logs = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (log, description) in enumerate(
            zip(setup.logs, setup.descriptions, strict=True), 1
        ):
            path = Path(folder) / f"log_{number}.npz"
            np.savez(path, **log)  # type: ignore[arg-type]
            limits = seaid.Repairs() if setup.repair else None
            logs.append(seaid.read_log(path, robot, description=description or None, repair=limits))
    return robot, logs


def _errors(case: Case, of: str, found: seaid.Identification) -> Array:
    """Return relative errors (2 n,) of the torques of bodies, and of drives, on an unseen motion.

    A spring's drive is judged by its motor torque (7), a stiff one by (8) with its friction. The
    size of a torque is at least 5 % of the largest one of the robot at joints of its kind.
    """
    name = case.subject.name
    of = _reference(of)
    measured = _held_out_log(name, of, case.seed)
    if case.subject.base:
        return _errors_on_the_ground(found, measured)
    truth, motion = true_robot(name, of), true_motion(name, of, HELD_OUT)
    bodies = _body_torques(truth, motion)
    difference = _body_torques(found.robot, motion) - bodies
    errors = _norms(difference) / _sizes(_norms(bodies), truth.is_prismatic)
    try:
        validation = seaid.validate(found, measured)
        elastic = np.isin(truth.joint_names, truth.elastic_joints)
        of_springs = _without_offsets(validation.actuator)
        drives = np.where(elastic, of_springs, validation.load.relative_error)
    except Exception:  # a model that predicts nothing
        drives = np.full(truth.n, np.inf)
    found_errors = np.concatenate([errors, drives])
    return np.where(np.isfinite(found_errors), found_errors, np.inf)


def _errors_on_the_ground(found: seaid.Identification, measured: seaid.Log) -> Array:
    """Return relative errors (n,) of the torques of joints whose base is not held."""
    try:
        return np.nan_to_num(seaid.validate(found, measured).load.relative_error, nan=np.inf)
    except Exception:  # a model that predicts nothing
        return np.full(found.robot.n, np.inf)


def _without_offsets(torques: Any) -> Array:
    """Return relative errors (n,) of torques but for a constant, that of the spring's zero.

    It changes with each zero of an encoder, and with the turn in which an incremental one begins.
    """
    error = np.where(torques.counted, torques.measured - torques.computed, np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # stiff joints have no such error
        sizes = np.nanmean(np.where(torques.counted, torques.measured, np.nan) ** 2, axis=0)
        return np.asarray(np.nanstd(error, axis=0) / np.sqrt(sizes))


@cache
def _held_out_log(name: str, truth: str, seed: int) -> seaid.Log:
    """Return the unseen log, with the encoder offsets of the experiment and without noise."""
    log = columns(name, truth, HELD_OUT, Sensors(noise=0.0, seed=seed))
    return _log(log, true_robot(name, truth))


def _log(log: Mapping[str, Array], robot: seaid.Robot) -> seaid.Log:
    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder) / "log.npz", **log)  # type: ignore[arg-type]
        return seaid.read_log(Path(folder) / "log.npz", robot)


def _body_torques(robot: seaid.Robot, motion: Any) -> Array:
    """Return the torques (T, n) of the bodies without payloads, every fifth instant."""
    states = (motion.joint_position, motion.joint_velocity, motion.joint_acceleration)
    regressor = rigid_body_regressor(robot, *(state[::5] for state in states))
    return np.asarray(regressor @ robot.parameters)


def _norms(torques: Array) -> Array:
    return np.asarray(np.linalg.norm(torques, axis=0))


def _sizes(norms: Array, kinds: Iterable[bool]) -> Array:
    """Return the norms, at least 5 % of the largest one of their kind."""
    kind = np.array(list(kinds))
    largest = [np.max(norms[kind == one]) for one in kind]
    return np.maximum(norms, 0.05 * np.array(largest))


@cache
def right_errors(name: str, seed: int, logs: int = 1, truth: str = "plain") -> Array:
    """Return the errors of the right set-up: the best that a user gets."""
    case = Case(right_subjects()[name], seed)
    found = run(case, case.setup(truth, logs, terms=True), truth).errors
    if found is None:
        raise SystemExit(f"the right set-up of {name} ({truth}) is refused")
    return found


_MOVING_LITTLE = ("still", "slow")
"""Truths that are compared with the plain one: the same robot, moving as it should."""


def _reference(truth: str) -> str:
    return "plain" if truth in _MOVING_LITTLE else truth


def is_right(
    case: Case,
    errors: Array | None,
    logs: int = 1,
    truth: str = "plain",
    *,
    by_masses: bool = False,
) -> bool:
    """Return whether predictions are about as good as those of the right set-up.

    Errors are larger if a repaired value could only come `by_masses` of the robot file.
    """
    if errors is None:
        return False
    best = right_errors(case.subject.name, case.seed, logs, _reference(truth))
    if by_masses:
        return bool(np.all(errors <= np.maximum(WORSE_BY_MASSES * best + FLOOR, MASSES_OFF)))
    return bool(np.all(errors <= WORSE * best + FLOOR))


def names_it(mistake: Mistake, one: Said) -> bool:
    """Return whether a finding, or a rival in it, has a right code, or a text the right words."""
    if one.code:
        return bool(one.codes & mistake.codes)
    words = mistake.words or tuple(code.split("-")[0] for code in mistake.codes)
    return any(re.search(rf"\b{re.escape(word)}", one.message, re.IGNORECASE) for word in words)


def judge(case: Case, mistake: Mistake) -> Outcome | None:
    """Make a mistake, identify, apply the remedies; None if the robot cannot have the mistake."""
    right = case.setup(mistake.truth, mistake.logs)
    setup = mistake.change(case, right)
    if setup is None:
        return None
    first = run(case, setup, mistake.truth)
    outcome = Outcome(
        mistake=mistake.name,
        form=mistake.form,
        robot=case.subject.name,
        seed=case.seed,
        letter="!",
        worst_error=_worst(first.errors),
        said=first.said,
        crash=first.crash,
        codes=tuple(sorted(mistake.codes)),
        repairable=mistake.repairable,
        harmless=mistake.harmless,
    )
    if first.crash:
        return outcome
    flagged = [one for one in first.said if one.severity != "note"]
    named = any(names_it(mistake, one) for one in flagged)
    fine = _is_fine(case, mistake, first)
    if not flagged:
        noted = any(names_it(mistake, one) for one in first.said)
        return replace(outcome, letter="n" if noted and fine else "t" if fine else "-")
    if not named:
        return replace(outcome, letter="D")
    last = _repaired(case, mistake, right, setup, first)
    left = [one for one in last.said if one.severity == "wrong" and names_it(mistake, one)]
    repaired = last is not first and _is_fine(case, mistake, last, mistake.by_masses) and not left
    return replace(
        outcome,
        letter="R" if repaired else "N",
        repaired_error=None if last is first else _worst(last.errors),
        after=() if last is first else last.said,
        crash=last.crash,
    )


def _is_fine(case: Case, mistake: Mistake, one: Run, by_masses: bool = False) -> bool:
    return is_right(case, one.errors, mistake.logs, mistake.truth, by_masses=by_masses)


def _worst(errors: Array | None) -> float:
    return float("inf") if errors is None else float(np.max(errors))


def _repaired(case: Case, mistake: Mistake, right: Setup, setup: Setup, first: Run) -> Run:
    """Return the run after all printed remedies, applied together until none is new.

    They are applied in the order in which they are printed: a later line for a channel contains
    an earlier one.
    """
    last = first
    for _ in range(ROUNDS):
        try:
            changed = setup
            for remedy in dict.fromkeys(one.remedy for one in last.said):
                changed = with_remedy(changed, right, remedy)
        except (tomllib.TOMLDecodeError, ValueError) as problem:
            return Run(last.said, last.errors, f"the remedy cannot be applied: {problem}")
        if same(changed, setup):
            break
        setup, last = changed, run(case, changed, mistake.truth)
        if last.crash or _is_fine(case, mistake, last):
            break
    return last


def same(one: Setup, other: Setup) -> bool:
    """Return whether two set-ups have the same settings."""
    return all(
        getattr(one, name) == getattr(other, name)
        for name in ("drives", "payloads", "descriptions", "gravity", "repair", "options")
    )


_SECTION = re.compile(r"(.*)in the (description of .*|drives file):$", re.IGNORECASE)
_OPTION = re.compile(
    r"(without |remove |exclude )?--([a-z-]+)(?:[ =]([^\s`'\",;()][^\s`'\";()]*))?"
)


def with_remedy(setup: Setup, right: Setup, remedy: str) -> Setup:
    """Return the set-up with the change that a remedy prints.

    TOML behind "in the description of the log:" ("of log 2:", "of the second log:" for one of
    several) is merged into the description, behind "in the drives file:" into the drives. Other
    lines are searched for options of the command line: --payload, --gravity, --drives, --repair.
    What stands behind ", or " is another way, and not applied.
    """
    section, text, plain = "", list[str](), list[str]()
    parts: list[tuple[str, list[str]]] = []
    for line in remedy.splitlines():
        header = _SECTION.match(line.strip())
        if header:
            section, text = header[2].lower(), []
            plain.append(header[1])
            parts.append((section, text))
        elif section:
            text.append(line)
        else:
            plain.append(line)
    for section, lines in parts:
        change = tomllib.loads("\n".join(lines))
        if section == "drives file":
            setup = replace(setup, drives=merged(setup.drives or {}, change))
        else:
            which = _which_log(section, len(setup.logs))
            tables = [
                merged(one, change) if number in which else one
                for number, one in enumerate(setup.descriptions)
            ]
            setup = replace(setup, descriptions=tuple(tables))
    first_ways = (line.split(", or ")[0] for line in plain)
    for option in _OPTION.finditer("\n".join(first_ways)):
        setup = _with_option(setup, right, bool(option[1]), option[2], option[3])
    return replace(setup, repair=setup.repair or "repair=seaid.Repairs()" in remedy)


def _which_log(section: str, count: int) -> set[int]:
    """Return the logs that a header names, counted from 0: all if it names none."""
    words = {"first": 0, "second": 1, "third": 2}
    found = {place for word, place in words.items() if word in section}
    found |= {int(number) - 1 for number in re.findall(r"log[ _](\d+)", section)}
    return found or set(range(count))


def _with_option(setup: Setup, right: Setup, without: bool, name: str, value: str | None) -> Setup:
    """Return the set-up with an option of the command line."""
    if name == "payload" and value:
        link = value.split(":")[0]
        others = tuple(one for one in setup.payloads if one.split(":")[0] != link)
        if without:
            return replace(setup, payloads=others)
        keep = () if ":" not in value else (value,)
        return replace(setup, payloads=keep or setup.payloads)
    if name == "gravity" and value:
        return replace(setup, gravity=tuple(float(one) for one in value.split(",")))
    if name == "drives":
        return replace(setup, drives=right.drives)
    if name == "repair":
        return replace(setup, repair=True)
    key = name.replace("-", "_")
    if key in ("method", "estimator") and value:
        return replace(setup, options={**setup.options, key: value})
    if key in ("cutoff_hz", "encoder_offset_std") and value:
        return replace(setup, options={**setup.options, key: float(value)})
    if key == "torque_joints" and value:
        return replace(setup, options={**setup.options, key: value.split(",")})
    return setup


def merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping with another one merged into it at every depth."""
    found = dict(old)
    for key, value in new.items():
        both = isinstance(value, Mapping) and isinstance(found.get(key), Mapping)
        found[key] = merged(found[key], value) if both else value
    return found


@dataclass(frozen=True)
class Right:
    """A right set-up and what was said of it."""

    number: int
    robot: str
    text: str
    said: tuple[Said, ...]
    worst_error: float
    crash: str = ""


MOTIONS, FEW_MOTIONS = 8, 3
"""True motions per robot for right set-ups, the second one with parallel springs and of the
quadruped; their sensors, noise and nominal values differ."""


def right_setup(number: int) -> Right:
    """Identify from a right set-up with sensors, noise, motions and nominal values of its own.

    A third of the robots have a declared spring parallel to a joint; of the others, a third of the
    stiff arms follow position commands.
    """
    rng = np.random.default_rng((number, 17))
    names = list(right_subjects())
    name = names[number * len(names) // RIGHT_BLOCK % len(names)]
    sensors = Sensors(
        motor_counts=float(rng.choice([1000, 2000, 4096, 10000])),
        joint_counts=float(2 ** rng.integers(13, 19)),
        noise=float(rng.choice([0.002, 0.005, 0.01, 0.02, 0.04])),
        seed=number + 1,
    )
    case, logs = Case(right_subjects()[name], number + 1), int(rng.integers(1, 3))
    is_held, has_commands = name != QUADRUPED, number % 3 == 1
    truth = "preload100" if number % 3 == 0 and is_held else "plain"
    setup = case.setup(truth, 0, terms=True)
    count = MOTIONS if truth == "plain" and is_held else FEW_MOTIONS
    motions = rng.choice(count, logs, replace=False)
    every = int(rng.choice([1, 2, 4])) if is_held else 1
    drives, samples = setup.drives, []
    for one in motions:
        log = columns(name, truth, int(one), sensors)
        if has_commands and name == "stiff":
            log, drives = commanded(name, int(one), log, setup.drives or {})
        samples.append({key: x[::every] for key, x in log.items()})
    setup = replace(
        setup,
        drives=drives,
        logs=tuple(samples),
        descriptions=({},) * logs,
    )
    found = run(case, setup, truth)
    rate_hz = 1 / float(np.median(np.diff(samples[0]["time_s"])))
    text = f"{truth}, {sensors}, motions {motions.tolist()}, {rate_hz:.4g} Hz"
    return Right(number, name, text, found.said, _worst(found.errors), found.crash)


RIGHT_BLOCK = 50
"""Right set-ups of one block have the robots one after the other: a process simulates few."""


@cache
def every_mistake() -> tuple[Mistake, ...]:
    """Return all mistakes; their codes exist."""
    found = (*mistakes(), *joint_mistakes(), *flag_mistakes())
    unknown = {code for one in found for code in one.codes} - set(CODES)
    assert not unknown, unknown
    return found


def _judged(task: tuple[str, int, int]) -> Outcome | None:
    name, seed, number = task
    return judge(Case(right_subjects()[name], seed), every_mistake()[number])


def _can_have(name: str, number: int) -> bool:
    """Return whether a mistake is made at a robot."""
    return every_mistake()[number].of_quadruped == (name == QUADRUPED)


def matrix(outcomes: Sequence[Outcome], robots: Sequence[str]) -> list[list[str]]:
    """Return the rows mistake x robot, one letter per seed."""
    rows: dict[tuple[str, str], dict[str, str]] = {}
    for one in outcomes:
        row = rows.setdefault((one.mistake, one.form), {})
        row[one.robot] = row.get(one.robot, "") + one.letter
    return [
        [name, form, *(row.get(robot, ".") for robot in robots)]
        for (name, form), row in rows.items()
    ]


NAMED, DETECTED = "RNn", "RNnD"


def summary(outcomes: Sequence[Outcome]) -> list[list[str]]:
    """Return the figures: of all cases, and of those in which the result would be wrong."""
    judged = [one for one in outcomes if not one.harmless]
    severe = [one for one in judged if one.form == "severe"]
    mild = [one for one in judged if one.form == "mild"]
    fixable = [one for one in severe if one.repairable]
    calm = [one for one in outcomes if one.harmless]
    named = [one for one in severe if one.letter in "RN"]
    false = sum(bool(one.false_codes) for one in named)
    return [
        ["severe: flagged with the right code", *_share(severe, NAMED), "97 %"],
        ["severe: the remedy repairs", *_share(fixable, "Rn"), "90 %"],
        ["severe, named: another code next to it", _part(false, len(named)), "-", "at most 5 %"],
        ["severe: flagged with any code", *_share(severe, DETECTED), "-"],
        ["mild: flagged with any code", *_share(mild, DETECTED), "70 %"],
        ["mild: flagged with the right code", *_share(mild, NAMED), "-"],
        ["nonsense that harms nothing: nothing else is flagged", *_share(calm, "tnNR"), "-"],
    ]


def _share(outcomes: Sequence[Outcome], letters: str) -> tuple[str, str]:
    """Return the share of all cases, and of those that are not right without a word."""
    harmful = [one for one in outcomes if one.letter != "t" or one.harmless]

    def share(cases: Sequence[Outcome]) -> str:
        return _part(sum(one.letter in letters for one in cases), len(cases))

    return share(outcomes), share(harmful)


def _part(count: int, cases: int) -> str:
    return f"{count} of {cases}, {count / max(cases, 1):.0%}"


def false_explanations(outcomes: Sequence[Outcome]) -> list[list[str]]:
    """Return the codes next to the right ones, of each mistake, with the robots that have them."""
    rows: dict[tuple[str, str, str], list[str]] = {}
    for one in outcomes:
        for code in one.false_codes:
            rows.setdefault((one.mistake, one.form, code), []).append(one.robot)
    return [[*key, ", ".join(robots)] for key, robots in rows.items()]


def problems(outcomes: Sequence[Outcome]) -> list[str]:
    """Return a line for every case that is not as it should be, with what was said instead."""
    lines = []
    for one in outcomes:
        good = "tnNR" if one.harmless else "Rtn" if one.repairable else "RNtn"
        if one.letter in good:
            continue
        said = Counter(f"{x.code or 'text'}/{x.severity}" for x in one.said if x.severity != "note")
        left = Counter(
            f"{x.code or 'text'}/{x.severity}" for x in one.after if x.severity != "note"
        )
        refusals = [x.message for x in (*one.said, *one.after) if x.severity == "refused"]
        repaired = "" if one.repaired_error is None else f" -> {one.repaired_error:.2g}"
        after = f"; after the remedy: {_counts(left)}" if one.repaired_error else ""
        crash = f"; {one.crash}" if one.crash else ""
        crash += f"; refused: {refusals[-1][:160]}" if refusals else ""
        lines.append(
            f"{one.letter} {one.mistake} ({one.form}), {one.robot} {one.seed}: error "
            f"{one.worst_error:.2g}{repaired}; said: {_counts(said)}{after}{crash}"
        )
    return lines


def _counts(found: Counter[str]) -> str:
    return ", ".join(f"{n} {name}" if n > 1 else name for name, n in found.items()) or "nothing"


def alarms(found: Sequence[Right]) -> tuple[list[list[str]], str]:
    """Return false alarms by code, and the share of right set-ups that have any."""
    counts: Counter[tuple[str, str, str]] = Counter()
    flagged = 0
    for one in found:
        bad = {(x.code or x.severity, x.severity, one.robot) for x in one.said
               if x.severity != "note"}  # fmt: skip
        bad |= {("crash", "!", one.robot)} if one.crash else set()
        flagged += bool(bad)
        counts.update(bad)
    rows = [[code, severity, robot, str(n)]
            for (code, severity, robot), n in counts.most_common()]  # fmt: skip
    wrong = sum(any(x.severity in ("wrong", "refused") for x in one.said) for one in found)
    share = flagged / max(len(found), 1)
    return rows, (
        f"{flagged} of {len(found)} right set-ups have a finding of severity wrong or doubtful "
        f"({share:.1%}; wanted at most 1 %), {wrong} one of severity wrong"
    )


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def main(arguments: argparse.Namespace) -> None:
    """Run the matrix and the right set-ups, and write text, Markdown and JSON."""
    output, begin = result_folder(arguments.output), time.perf_counter()
    names = arguments.robot or (["leg"] if arguments.quick else ROBOTS)
    numbers = [
        number
        for number, one in enumerate(every_mistake())
        if not arguments.only or any(text in one.title for text in arguments.only)
    ]
    first = arguments.first_seed
    seeds = [] if arguments.only_right else range(first, first + arguments.seeds)
    tasks = [
        (name, seed, number)
        for name in names
        for seed in seeds
        for number in numbers
        if _can_have(name, number)
    ]
    text, tables = [], []
    content: dict[str, Any] = {}
    with ProcessPoolExecutor(arguments.workers) as pool:
        size = max(1, min(25, len(tasks) // (2 * arguments.workers)))
        answers = pool.map(_judged, tasks, chunksize=size)
        outcomes = _progress(answers, len(tasks), "mistakes")
        size = max(1, min(RIGHT_BLOCK // 4, arguments.right // arguments.workers))
        places = range(RIGHT_BLOCK * first, RIGHT_BLOCK * first + arguments.right)
        rights = pool.map(right_setup, places, chunksize=size)
        right = _progress(rights, arguments.right, "right set-ups")
    if outcomes:
        for title, header, rows in (
            ("Mistakes", ["mistake", "form", *names], matrix(outcomes, names)),
            (
                "False explanations",
                ["mistake", "form", "code", "robots"],
                false_explanations(outcomes),
            ),
            ("Summary", ["figure", "of all", "of those that do harm", "wanted"], summary(outcomes)),
        ):
            text.append(str(table(title, header, rows)))
            tables.append(markdown(header, rows))
        text += ["What is not as it should be:", *problems(outcomes), ""]
        content["outcomes"] = [asdict(one) for one in outcomes]
    if right:
        rows, sentence = alarms(right)
        header = ["code", "severity", "robot", "set-ups"]
        text += [str(table("False alarms", header, rows)), sentence]
        tables.append(sentence + "\n\n" + (markdown(header, rows) if rows else ""))
        content["right"] = [asdict(one) for one in right]
    text.append(f"{time.perf_counter() - begin:.0f} s. Results: {output}/")
    print("\n".join(text))
    if arguments.messages:
        print("\n".join(_messages(outcomes)))
    (output / "gauntlet.md").write_text("\n".join(tables), "utf-8")
    write_json(output / "gauntlet.json", content)


def _progress(answers: Iterable[Any], count: int, what: str) -> list[Any]:
    """Return the answers, with a progress bar."""
    shown = track(list(zip(range(count), repeat(iter(answers)), strict=False)), what, _is_seen())
    return [answer for _, answers in shown if (answer := next(answers)) is not None]


def _is_seen() -> bool:
    return sys.stderr.isatty()


def _messages(outcomes: Sequence[Outcome]) -> list[str]:
    """Return all that was said, with the remedies."""
    lines = []
    for one in outcomes:
        lines.append(f"\n{one.letter} {one.mistake} ({one.form}), {one.robot} {one.seed}")
        for kind, said in (("", one.said), ("after the remedy: ", one.after)):
            for x in said:
                lines.append(f"  {kind}{x.severity} {x.code} {x.joint}: {x.message}")
                lines += [f"      {line}" for line in x.remedy.splitlines() if x.code]
    return lines


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", help="mistakes with this text in their title")
    parser.add_argument("--robot", action="append", choices=ROBOTS, help="may be repeated")
    parser.add_argument("--quick", action="store_true", help="only the leg")
    parser.add_argument("--seeds", type=int, default=1, help="experiments per mistake and robot")
    parser.add_argument(
        "--first-seed", type=int, default=0, metavar="N", help="of mistakes, and of right set-ups"
    )
    parser.add_argument("--right", type=int, default=0, metavar="N", help="right set-ups")
    parser.add_argument("--only-right", action="store_true", help="no mistakes")
    parser.add_argument("--messages", action="store_true", help="print all findings and remedies")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--output", type=Path, default=Path("out/gauntlet"), help="result folder")
    main(parser.parse_args())
