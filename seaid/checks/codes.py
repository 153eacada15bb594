"""The codes of findings, by which checks make them: `DELAY.finding(...)`, and which are echoes.

What each `Code` stands for, what usually causes it, and what to do, is in `codes.toml`. A `Symptom`
says that something is off, and not why; a `Cause` spoils the fit of its joint. `CODES` has them in
the order of the page `docs/warnings.md`, whose sections are made from both files
(`python -m scripts.warnings_page`). Each code is given in one place.

An `Observation` is a check that looks at what is there, such as the samples of a `Channel` of a
log; `observed` makes all those of a room. A check that fails is no reason to lose the result: its
error becomes a note.

Findings follow from others: those of a wrong set-up, of noise, and symptoms of a cause. A result is
no better for it: a cause is as severe as the symptoms that it explains.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial, partialmethod
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from seaid._arrays import Array, FrozenMapping, is_constant
from seaid._files import read_toml, toml_table, toml_text
from seaid.checks import tolerances as tol
from seaid.drives import total_ratio
from seaid.errors import (
    SEVERITIES,
    Certainty,
    Finding,
    SeaidError,
    Severity,
    by_severity,
    listed,
    reason_of,
)
from seaid.log import Log, changed_source
from seaid.robot import Robot

Given = TypeVar("Given")


@dataclass(frozen=True)
class Code:
    """What a finding stands for.

    Attributes
    ----------
    name : str
        The word by which users and scripts refer to it, such as "delay".
    is_symptom, spoils : bool
        Whether it is a `Symptom`, or a `Cause`.
    """

    name: str
    is_symptom: ClassVar[bool] = False
    spoils: ClassVar[bool] = False

    @property
    def meaning(self) -> str:
        """What it stands for, in a phrase."""
        return _texts()[self.name]["meaning"]

    @property
    def cause(self) -> str:
        """The usual cause, in sentences."""
        return _texts()[self.name]["cause"]

    @property
    def advice(self) -> str:
        """What to do, in sentences."""
        return _texts()[self.name]["advice"]

    @property
    def measurement(self) -> str:
        """What decides between it and other causes that explain a log as well, "" if nothing."""
        return _texts()[self.name].get("measurement", "")

    @property
    def implies(self) -> str:
        """What follows if it is the cause, as a clause, "" if nothing does."""
        return _texts()[self.name].get("implies", "")

    def finding(
        self,
        message: str,
        joint: str = "",
        severity: Severity = "doubtful",
        evidence: Mapping[str, float] = FrozenMapping({}),
        remedy: str = "",
        certainty: Certainty = "likely",
        joints: tuple[str, ...] = (),
    ) -> Finding:
        """Return a finding of this code; the arguments are the attributes of `Finding`.

        The joint is the only one of `joints` unless it is named.
        """
        joint = joint or only_joint(joints)
        return Finding(self.name, message, joint, severity, evidence, remedy, certainty, joints)

    wrong = partialmethod(finding, severity="wrong")
    """Return a `finding` by which the result is not to be used."""

    note = partialmethod(finding, severity="note", certainty="certain")
    """Return a `finding` for information: by default what is certain and no mistake."""


@cache
def _texts() -> Mapping[str, Mapping[str, str]]:
    """Return {name of a code: its texts} of codes.toml, read once, where a text is needed."""
    path = Path(__file__).with_name("codes.toml")
    tables = read_toml(path, "the texts of codes", SeaidError)
    return {
        name: {key: " ".join(text.split()) for key, text in texts.items()}
        for name, texts in tables.items()
    }


class Symptom(Code):
    """A code of something that is off, and not of why: what spoils a fit brings it with it."""

    is_symptom = True


class Cause(Code):
    """A code of what spoils the fit of its joint, or of all joints if a finding names none."""

    spoils = True


@dataclass(frozen=True)
class Observation(Generic[Given]):
    """A check that looks at what is there: `look` yields the findings of its `code`."""

    code: Code
    look: Callable[[Given], Iterable[Finding]]


def observed(checks: Iterable[Observation[Given]], subject: Given) -> list[Finding]:
    """Return the findings of checks, in their order; a check that raises becomes a note."""
    findings: list[Finding] = []
    for check in checks:
        with guarded(check.code, findings):
            findings += check.look(subject)
    return findings


@contextmanager
def guarded(code: Code, findings: list[Finding]) -> Iterator[None]:
    """Add to findings, if a check of a code raises, the note that it could not be made."""
    try:
        yield
    except Exception as problem:  # the fit stands, whatever a check meets
        text = f"the check '{code.name}' could not be made: {reason_of(problem)}"
        findings.append(code.note(text))


def in_drives(tables: Mapping[tuple[str, ...], str], only: str = "") -> str:
    """Return the remedy that adds lines to tables of the drives file: {keys of a table: lines}."""
    parts = [f"{toml_table(*keys)}\n{lines}" for keys, lines in tables.items()]
    return "\n".join([f"in the drives file{only and f', {only}'}:", *parts])


def in_description(
    sources: Mapping[str, Mapping[str, str]], log: str = "the log", table: str = "joints"
) -> str:
    """Return the remedy that changes channels of a log: {joint: {quantity: its source as TOML}}."""
    lines = [f"in the description of {log}:"]
    for name, entries in sources.items():
        lines.append(toml_table(table, name))
        lines += [f"{quantity} = {source}" for quantity, source in entries.items()]
    return "\n".join(lines)


def zeros_in_description(
    robot: Robot, angles: Mapping[str, float], sources: Mapping[str, Mapping[str, Any]]
) -> str:
    """Return the remedy that adds angles to the zeros of joints, and of the motors that turn them.

    `sources` {joint: {quantity: column or entry of a description}} has what was logged.
    """
    moved = {(joint, "joint_position"): angle for joint, angle in angles.items()}
    added = np.array([angles.get(joint, 0.0) for joint in robot.joint_names])
    for turned, (joint, drive) in zip(
        robot.transmission @ added, robot.drives.items(), strict=True
    ):
        # theta_M = N r_L / r_M phi, phi = C q: the zero of a joint moves all motors that turn it.
        moved[joint, "motor_position"] = float(turned) * total_ratio(drive)
    entries: dict[str, dict[str, str]] = {}
    for (joint, quantity), offset in moved.items():
        source = sources.get(joint, {}).get(quantity)
        if offset and source:
            changed = changed_source(source, offset=round(offset, 5))
            entries.setdefault(joint, {})[quantity] = changed
    return in_description(entries)


def joints_of(findings: Iterable[Finding]) -> set[str]:
    """Return the joints that findings name, alone or among several."""
    return {joint for x in findings for joint in (x.joint, *x.joints) if joint}


def as_note(finding: Finding) -> Finding:
    """Return a finding as a note without a remedy, whose numbers are those of a wrong model."""
    return replace(finding, severity="note", remedy="")


def only_joint(joints: Sequence[str]) -> str:
    """Return the joint of a finding: the only one, or "" for several."""
    return joints[0] if len(joints) == 1 else ""


def excluding_torque(kept: Sequence[str]) -> str:
    """Return how to use the torques of some joints only, after words to which ", or" fits."""
    if not kept:
        return ""
    return (
        f", or exclude its torque (--torque-joints {','.join(kept)}), in [identify] of "
        f"seaid.toml:\ntorque_joints = [{', '.join(map(toml_text, kept))}]"
    )


@dataclass(frozen=True, eq=False)
class Channel:
    """The samples (T,) of a quantity of a joint, and the `source` in which the log has them."""

    joint: str
    quantity: str
    values: Array
    source: str | Mapping[str, Any] | None

    @property
    def entry(self) -> Mapping[str, Any]:
        """The entry of the description, empty for a column alone."""
        return self.source if isinstance(self.source, Mapping) else {}

    def changed(self, **changes: float) -> str:
        """Return the TOML of the source with the changes of `changed_source`."""
        return changed_source(self.source or "", **changes)

    @property
    def scale(self) -> float:
        """The factor on the column."""
        return float(self.entry.get("scale", 1.0))

    @property
    def largest(self) -> float:
        """The largest size of a sample."""
        return float(np.max(np.abs(self.values)))


def channels_of(log: Log, joints: Collection[str], *quantities: str) -> Iterator[Channel]:
    """Yield the channels of joints whose samples are all known, and change."""
    sources = log.sources()
    for quantity in (name for name in quantities if getattr(log, name) is not None):
        for joint, values in zip(log.joint_names, getattr(log, quantity).T, strict=True):
            if joint in joints and np.all(np.isfinite(values)) and not is_constant(values):
                yield Channel(joint, quantity, values, sources[joint].get(quantity))


UNIT = Cause("unit")
TIME_UNIT = Cause("time-unit")
WRAPS = Cause("wraps")
SIGN = Cause("sign")
ENCODER_OFFSET = Cause("encoder-offset")
SWAPPED_JOINTS = Cause("swapped-joints")
GEAR_RATIO = Cause("gear-ratio")
VARYING_RATIO = Cause("varying-ratio")
COUPLED_JOINTS = Cause("coupled-joints")
MISSING_DRIVES = Cause("missing-drives")
PAYLOAD = Code("payload")
GRAVITY = Cause("gravity")
NOMINAL_VALUES = Code("nominal-values")
GEOMETRY = Cause("geometry")
DELAY = Cause("delay")
COMMAND_DELAY = Code("command-delay")
CONTACT_FLAGS = Code("contact-flags")
BASE_FRAMES = Code("base-frames")
BASE_SENSOR = Code("base-sensor")
SOFT_FEET = Code("soft-feet")
BASE_BIAS = Code("base-bias")
SENSOR_ZERO = Code("sensor-zero")
NO_TORQUE = Code("no-torque")
TOTAL_MASS = Code("total-mass")
BASE_JUMPS = Code("base-jumps")
ROTOR_INERTIA = Cause("rotor-inertia")
TORQUE_SCALE = Cause("torque-scale")
GAIN_SCALE = Code("gain-scale")
UNUSED_COMMAND = Code("unused-command")
NO_MEASUREMENT = Cause("no-measurement")
TORQUE_OFFSET = Symptom("torque-offset")
ENCODER_OFFSETS_DIFFER = Cause("encoder-offsets-differ")
WEAK_SPRING = Symptom("weak-spring")
BACKLASH = Cause("backlash")
NONLINEAR_SPRING = Cause("nonlinear-spring")
GEAR_COMPLIANCE = Code("gear-compliance")
TRANSMISSION_ERROR = Cause("transmission-error")
REFERENCE_POSITION = Code("reference-position")
LOOSE_ENCODER = Cause("loose-encoder")
MISSING_TERM = Cause("missing-term")
NEEDLESS_TERM = Code("needless-term")
DRIVES_DIFFER = Code("drives-differ")
DRIFT = Symptom("drift")
RESIDUAL = Code("residual")
NO_FIT = Symptom("no-fit")
UNSEEN_MOTION = Code("unseen-motion")
CONTACT_FORCES = Code("contact-forces")
NOT_REPLAYED = Code("not-replayed")
REPLAY_WORSE = Code("replay-worse")
POORLY_IDENTIFIED = Code("poorly-identified")
UNIDENTIFIABLE = Code("unidentifiable")
POORLY_DETERMINED = Code("poorly-determined")
NEGATIVE_PARAMETER = Symptom("negative-parameter")
INCONSISTENT_INERTIA = Symptom("inconsistent-inertia")
WEAK_INSTRUMENTS = Symptom("weak-instruments")
FEW_ROWS = Symptom("few-rows")
HOMOGENEOUS = Code("homogeneous")
ESTIMATOR_DISAGREES = Symptom("estimator-disagrees")
BLOCKS_DISAGREE = Symptom("blocks-disagree")
CUTOFF_SENSITIVE = Symptom("cutoff-sensitive")
WORSE_THAN_START = Code("worse-than-start")
MOTOR_SIDE = Code("motor-side")
HIDDEN_RESONANCE = Code("hidden-resonance")
WRONG_MINIMUM = Code("wrong-minimum")
NOTHING_TO_SIMULATE = Code("nothing-to-simulate")
CONTACT = Cause("contact")
LOCKED_OUTPUT = Code("locked-output")
STANDSTILL = Cause("standstill")
SATURATION = Cause("saturation")
HOLES = Cause("holes")
NOT_IN_FORMAT = Code("not-in-format")
UNUSED_CHANNEL = Code("unused-channel")

CODES: Mapping[str, Code] = FrozenMapping(
    {code.name: code for code in list(globals().values()) if isinstance(code, Code)},
    "code of a finding",
)
"""{name of a code: the code}."""

EXPLAINED, OF_MOTOR = "explained", "explained of the motor equation"
"""The evidence of a column: the part of the squared residual of its equation that it explains."""

AS_GIVEN = "misfit as given"
"""The evidence of a mistake of the set-up: the part of a torque that is unexplained with it."""


def is_wrong(setup: Iterable[Finding]) -> bool:
    """Whether findings say that the set-up, and not only the model, is wrong."""
    return any(finding.severity == "wrong" and not _is_symptom(finding) for finding in setup)


def _is_symptom(finding: Finding) -> bool:
    return CODES[finding.code].is_symptom


def consequences(setup: Sequence[Finding], findings: Iterable[Finding]) -> list[Finding]:
    """Return findings about a fit: mere notes where the set-up is already known to be wrong.

    That is the whole robot if the cause is certain, or is of no joint, and its joints else: a cause
    that rests on the bodies of the robot file may be false. These notes have no remedy, because its
    numbers are those of the wrong set-up: applied next to the remedy of the set-up, a term or an
    offset of them would spoil the repaired result.
    """
    wrong = [finding for finding in setup if is_wrong([finding])]
    joints = joints_of(wrong)
    is_whole = any(not one.joint or one.certainty == "certain" for one in wrong)

    def is_echo(finding: Finding) -> bool:
        return is_whole or not finding.joint or finding.joint in joints

    return [as_note(x) if wrong and is_echo(x) else x for x in findings]


def merged(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings in the order of `by_severity`, those of one code at many joints as one.

    That is above a note. It has the words of the first one, the remedies of all together, and their
    evidence by joint.
    """
    ordered = by_severity(findings)
    alike: dict[tuple[str, str], list[Finding]] = {}
    for finding in ordered:
        if finding.joint and finding.severity != "note":
            alike.setdefault((finding.code, finding.severity), []).append(finding)
    replaced = {
        finding: _as_one(group) if finding is group[0] else None
        for group in alike.values()
        if len({finding.joint for finding in group}) > tol.MOST_ALIKE
        for finding in group
    }
    return tuple(x for x in (replaced.get(each, each) for each in ordered) if x is not None)


def _as_one(findings: Sequence[Finding]) -> Finding:
    """Return findings of one code and severity, each at a joint, as one."""
    first, joints = findings[0], tuple(dict.fromkeys(finding.joint for finding in findings))
    remedies: dict[str, dict[str, dict[str, None]]] = {}  # {first line: {table: its lines}}
    for finding in findings:
        header, *lines = finding.remedy.splitlines() or [""]
        tables, table = remedies.setdefault(header, {}), ""
        for line in lines:
            table = line if line.startswith("[") else table
            tables.setdefault(table, {})[line] = None
    lines = [
        line
        for header, tables in remedies.items()
        for line in filter(None, [header, *chain.from_iterable(tables.values())])
    ]
    return replace(
        first,
        message=f"{first.message}; likewise at {listed(joints[1:])}",
        joint="",
        joints=joints,
        evidence={
            f"{x.joint}: {key}": value for x in findings for key, value in x.evidence.items()
        },
        remedy="\n".join(lines),
    )


_ECHOES = (
    *("nonlinear-spring", "missing-term", "transmission-error", "estimator-disagrees"),
    "drift",
)
"""Findings that noise alone raises where the deflection of a spring is mostly noise."""


def that_matter(findings: Sequence[Finding], exact: Collection[str] = ()) -> list[Finding]:
    """Return findings without those that noise alone raises, or whose torques do not matter.

    A weak spring, whose deflection is mostly noise, has such findings; with backlash it is none. A
    wrong set-up is never dropped: what it explains is a note already.
    What a model lacks is a note at `exact` joints, whose torque errors do not matter, and so is a
    symptom of a cause that explains it: the cause is as severe as its symptoms, whose remedies have
    the numbers of a model without it. Too few rows are a note where another finding is why blocks
    of the logs contradict each other.
    """
    loose, weak = _joints("backlash", findings), _joints("weak-spring", findings)
    echoes = {**dict.fromkeys((*_ECHOES, "delay"), weak), "weak-spring": loose}
    echoes["nonlinear-spring"] = weak | loose
    minor: dict[str, Collection[str]] = dict.fromkeys(_ECHOES, exact)
    if {finding.code for finding in findings if finding.severity != "note"} - {FEW_ROWS.name}:
        minor[FEW_ROWS.name] = {""}
    kept = (x for x in findings if x.severity == "wrong" or x.joint not in echoes.get(x.code, ()))
    matter = [
        replace(finding, severity="note")
        if finding.joint in minor.get(finding.code, ())
        else finding
        for finding in kept
    ]
    return [*map(partial(_among, findings=matter), matter)]


def _among(finding: Finding, findings: Sequence[Finding]) -> Finding:
    """Return a finding as it counts among all: a symptom of a cause as a note without a remedy.

    A cause is as severe as the worst of its symptoms.
    """
    if finding.severity == "note":
        return finding
    if _is_symptom(finding):
        is_brought = any(_brings(cause, finding) for cause in findings)
        return as_note(finding) if is_brought else finding
    symptoms = (other for other in findings if _is_symptom(other) and _brings(finding, other))
    return replace(finding, severity=by_severity([finding, *symptoms])[0].severity)


def _brings(cause: Finding, symptom: Finding) -> bool:
    """Whether a cause spoils the fit of the joint of a symptom, and explains it.

    A mistake of the set-up whose misfit falls without it explains at least half of what is left
    unexplained; it spoils the bodies, and so other joints, but not worse than its own. A column
    explains the part of the residual of its equation that is in its evidence: most of it, of a
    symptom that is worse nearly all, and so much of an error that less than half of the torque is
    left. What a motor lacks explains no load.
    """
    if cause.severity == "note" or not CODES[cause.code].spoils:
        return False
    joints, evidence = joints_of([cause]), cause.evidence
    is_there = not joints or not symptom.joint or symptom.joint in joints
    is_worse = SEVERITIES.index(symptom.severity) < SEVERITIES.index(cause.severity)
    if not {EXPLAINED, OF_MOTOR} & {*evidence}:
        return is_there or (AS_GIVEN in evidence and not is_worse)
    explained = evidence.get(EXPLAINED, 0.0 if is_worse else evidence.get(OF_MOTOR, 0.0))
    # The rms error after a part of its square is explained.
    left = symptom.evidence.get("error", 0.0) * math.sqrt(max(1 - explained, 0.0))
    is_explained = explained > (1 - tol.POOR if is_worse else tol.MOST) and left < tol.MOST
    return is_there and is_explained


def _joints(code: str, findings: Iterable[Finding]) -> set[str]:
    return {finding.joint for finding in findings if finding.code == code}
