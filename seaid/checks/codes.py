"""The codes of findings, and which findings are echoes of others.

`CODES` has all that are in `codes.toml`, with what each stands for, what usually causes it, and
what to do; checks make their findings by them: `CODES["delay"].finding(...)`. The sections of the
page `docs/warnings.md` are made from that file, in its order (`python -m scripts.warnings_page`).

Findings follow from others: those of a wrong set-up, of noise, and symptoms of a cause. A result is
no better for it: a cause is as severe as the symptoms that it explains.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, partialmethod
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, Literal

from seaid import errors
from seaid._arrays import FrozenMapping
from seaid._files import read_toml, toml_table, toml_text
from seaid.checks import tolerances as tol
from seaid.errors import Certainty, Finding, SeaidError, Severity, by_severity, listed
from seaid.log.description import Entries, as_toml

_FORMS: dict[str, Callable[[Any], float]] = {"abs": abs, "degrees": math.degrees}
_FORMS |= {"milli": lambda x: 1e3 * x, "half": lambda x: 0.5 * x, "inverse": lambda x: 1 / x}
"""{form: function}: a number of the evidence in the unit of a sentence."""


_FIELD = re.compile(r"\{(\w[^{}:]*)(?::([^{}|]*)\|?([a-z ]*))?\}")
"""A field of a template, such as {delay [s]:.3g|abs milli}: the name of a value and its format."""


def _filled(text: str, values: Mapping[str, Any]) -> str:
    """Return a template with values {name: value} in place of its fields."""

    def shown(match: re.Match[str]) -> str:
        name, spec, forms = match.groups("")
        value = values[name]
        for form in forms.split():
            value = _FORMS[form](value)
        return format(value, spec)

    return _FIELD.sub(shown, text)


@dataclass(frozen=True)
class Case:
    """The texts of one case of a code: templates of its values.

    An empty `remedy` is none, and without any it is the advice of the code. `worse` is the severity
    of those that matter more, if the check separates them.
    """

    message: str
    remedy: str | None = None
    severity: Severity = "doubtful"
    worse: Severity | None = None
    certainty: Certainty | None = None

    def severity_of(self, is_worse: bool) -> Severity:
        """Return the severity of a finding, of one that matters more if `is_worse`."""
        return self.worse if is_worse and self.worse else self.severity

    def filled(self, values: Mapping[str, Any]) -> Case:
        """Return the texts with values in place of their fields."""
        remedy = self.remedy and _filled(self.remedy, values)
        return replace(self, message=_filled(self.message, values), remedy=remedy)


@dataclass(frozen=True)
class Code:
    """What a finding stands for.

    Attributes
    ----------
    name : str
        The word by which users and scripts refer to it, such as "delay".
    meaning : str
        What it stands for, in a phrase.
    cause, advice : str
        The usual cause, and what to do, in sentences.
    measurement : str
        What decides between it and other causes that explain a log as well, "" if nothing.
    implies : str
        What follows if it is the cause, as a clause, "" if nothing does.
    kind : {"cause", "symptom", ""}
        "symptom": something is off, and not why; what spoils a fit brings it with it. "cause": what
        spoils the fit of its joint, or of all joints if a finding names none.
    certainty : {"certain", "likely", "possible"}
        That of its findings, unless a case has another one.
    cases : mapping {name: Case}
        The texts of its findings.
    """

    name: str
    meaning: str
    cause: str
    advice: str
    measurement: str = ""
    implies: str = ""
    kind: Literal["cause", "symptom", ""] = ""
    certainty: Certainty = "likely"
    cases: Mapping[str, Case] = FrozenMapping({}, "case")

    def finding(
        self,
        case: str,
        joint: str = "",
        evidence: Mapping[str, Any] = FrozenMapping({}),
        remedy: str | None = None,
        is_worse: bool = False,
        severity: Severity | None = None,
        certainty: Certainty | None = None,
        joints: tuple[str, ...] = (),
    ) -> Finding:
        """Return a finding of one of the `cases` of this code.

        The words among the `evidence` are in its texts only. The joint is the only one of `joints`
        unless it is named, the remedy that of the case, else the advice of the code, and so are
        severity and certainty.
        """
        joint = joint or only_joint(joints)
        texts = self.cases[case].filled({"joint": joint, **evidence})
        numbers = {name: x for name, x in evidence.items() if not isinstance(x, str)}
        if remedy is None:
            remedy = self.advice if texts.remedy is None else texts.remedy
        sure = certainty or texts.certainty or self.certainty
        severity = severity or texts.severity_of(is_worse)
        return Finding(self.name, texts.message, joint, severity, numbers, remedy, sure, joints)

    note: ClassVar[partialmethod[Finding]] = partialmethod(
        finding, severity="note", certainty="certain", remedy=""
    )
    """Return a `finding` for information: by default what is certain and needs no remedy."""


def _in_lines(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the texts of a table, each in one line."""
    return {key: " ".join(x.split()) for key, x in table.items() if isinstance(x, str)}


def _codes() -> Mapping[str, Code]:
    """Return {name of a code: the code} of codes.toml."""
    tables = read_toml(Path(__file__).with_name("codes.toml"), "the texts of codes", SeaidError)
    codes = dict[str, Code]()
    for name, table in tables.items():
        texts, of_cases = _in_lines(table), (x for x in table if isinstance(table[x], dict))
        common = {"message": texts.pop("message", "")}
        cases = {case: Case(**common | _in_lines(table[case])) for case in of_cases}
        codes[name] = Code(name, **texts, cases=FrozenMapping(cases, f"case of '{name}'"))
    return FrozenMapping(codes, "code of a finding")


CODES = _codes()
"""{name of a code: the code}, in the order of codes.toml."""


class Remedy(str):
    """A remedy as data: `words`, and the lines that follow, {header of a table: its lines}."""

    words: str
    tables: Mapping[str, Sequence[str]]

    def __new__(cls, words: str, tables: Mapping[str, Sequence[str]] | None = None) -> Remedy:
        """Return the text of a remedy with its parts."""
        lines = (line for header, each in (tables or {}).items() for line in (header, *each))
        remedy = super().__new__(cls, "\n".join([words, *lines]))
        remedy.words, remedy.tables = words, tables or {}
        return remedy

    def __getnewargs__(self) -> tuple[str, Mapping[str, Sequence[str]]]:  # type: ignore[override]
        return self.words, self.tables


def in_drives(tables: Mapping[tuple[str, ...], str], before: str = "", only: str = "") -> Remedy:
    """Return the remedy that adds lines to tables of the drives file: {keys of a table: lines}.

    Its words are `before` those of the file, which it concerns `only` in a case.
    """
    lines = {toml_table(*keys): text.splitlines() for keys, text in tables.items()}
    return Remedy(f"{before}in the drives file{only and f', {only}'}:", lines)


def in_description(sources: Entries, log: str = "the log", table: str = "joints") -> Remedy:
    """Return the remedy that changes channels of a log: {joint: {quantity: its source}}."""
    lines = {
        toml_table(table, name): [f"{key} = {as_toml(source)}" for key, source in entries.items()]
        for name, entries in sources.items()
    }
    return Remedy(f"in the description of {log}:", lines)


def with_payload(link: str, mass_kg: float, com_m: str) -> str:
    """Return the remedy that gives a payload: by an option, or by the table of a project."""
    table = f"[[payload]]\nlink = {toml_text(link)}\nmass_kg = {mass_kg:.3g}\ncom_m = [{com_m}]"
    return f"option: --payload {link}:{mass_kg:.3g}:{com_m}, or in seaid.toml\n{table}"


def with_gravity(direction: str) -> str:
    """Return the remedy that gives gravity: by an option, or by a key of a project."""
    return f"option: --gravity {direction}, or at the top of seaid.toml\ngravity = [{direction}]"


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
    lines = f"seaid.toml:\ntorque_joints = [{', '.join(map(toml_text, kept))}]"
    return f", or exclude its torque (--torque-joints {','.join(kept)}), in [identify] of {lines}"


EXPLAINED, OF_MOTOR = "explained", "explained of the motor equation"
"""The evidence of a column: the part of the squared residual of its equation that it explains."""

AS_GIVEN = "misfit as given"
"""The evidence of a mistake of the set-up: the part of a torque that is unexplained with it."""


def is_wrong(setup: Iterable[Finding]) -> bool:
    """Whether findings say that the set-up, and not only the model, is wrong."""
    return any(finding.severity == "wrong" and not _is_symptom(finding) for finding in setup)


def _is_symptom(finding: Finding) -> bool:
    return CODES[finding.code].kind == "symptom"


def consequences(setup: Sequence[Finding], findings: Iterable[Finding]) -> list[Finding]:
    """Return findings about a fit: mere notes where the set-up is already known to be wrong.

    That is the whole robot if the cause is certain, or is of no joint, and its joints else: a cause
    that rests on the bodies of the robot file may be false. These notes have no remedy, because its
    numbers are those of the wrong set-up: applied next to the remedy of the set-up, a term or an
    offset of them would spoil the repaired result.
    """
    wrong = [finding for finding in setup if is_wrong([finding])]
    is_whole = any(not cause.joint or cause.certainty == "certain" for cause in wrong)
    return notes_beside(wrong, findings, is_whole)


def notes_beside(
    causes: Sequence[Finding], findings: Iterable[Finding], is_whole: bool
) -> list[Finding]:
    """Return findings: notes at the joints of causes and of no joint, all where `is_whole`."""
    joints = {"" for _ in causes} | joints_of(causes)
    return [as_note(x) if is_whole or x.joint in joints else x for x in findings]


Cause = tuple[Code, str]
"""A possible cause: its code, and what it is in words."""


def undecided(finding: Finding, rivals: Mapping[Cause, float]) -> Finding:
    """Return a finding with `rivals` that explain as much {rival: how much less it explains}.

    No lines are printed that only one of them supports: a measurement decides first.
    """
    causes = [(CODES[finding.code], finding.message), *rivals]
    texts = (f"{text} ({code.implies})" if code.implies else text for code, text in causes)
    measures = dict.fromkeys(filter(None, (code.measurement for code, _ in causes)))
    evidence = {f"or {code.name}": less for (code, _), less in rivals.items()}
    return replace(
        finding,
        message="; or ".join(texts),
        evidence={**finding.evidence, **evidence},
        remedy=f"the log does not decide between these: {' or '.join([*measures][:2])} first",
        certainty="possible",
    )


def merged(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings in the order of `by_severity`, those of one code at many joints as one.

    That is above a note. It has the words of the first one, the remedies of all together, and their
    evidence by joint. Where there are more findings than one reads, two joints are many, and the
    last findings are notes, with their remedies.
    """
    ordered, groups = by_severity(findings), dict[Any, list[Finding]]()
    above = [finding for finding in ordered if finding.severity != "note"]
    most = tol.MOST_ALIKE if len(above) < tol.MOST_READ else 1
    for finding in ordered:
        is_alone = finding.severity == "note" or not finding.joint
        key = finding if is_alone else (finding.code, finding.severity)
        groups.setdefault(key, []).append(finding)
    parts = ([_as_one(x)] if len({y.joint for y in x}) > most else x for x in groups.values())
    joined = [*chain.from_iterable(parts)]
    behind = f" (a note behind {tol.MOST_READ} findings that come first)"
    for place, finding in enumerate(joined[: len(above)]):
        if place >= tol.MOST_READ and finding.severity != "note":
            joined[place] = replace(finding, severity="note", message=finding.message + behind)
    return tuple(joined)


def _as_one(findings: Sequence[Finding]) -> Finding:
    """Return findings of one code and severity, each at a joint, as one."""
    first, joints = findings[0], tuple(dict.fromkeys(finding.joint for finding in findings))
    remedies: dict[str, dict[str, dict[str, None]]] = {}  # {words: {header of a table: its lines}}
    for finding in findings:
        remedy = finding.remedy if isinstance(finding.remedy, Remedy) else Remedy(finding.remedy)
        tables = remedies.setdefault(remedy.words, {})
        for header, lines in remedy.tables.items():
            tables.setdefault(header, {}).update(dict.fromkeys(lines))
    parts = [Remedy(words, {x: [*y] for x, y in each.items()}) for words, each in remedies.items()]
    message = f"{first.message}; likewise at {listed(joints[1:])}"
    evidence = {f"{x.joint}: {key}": x.evidence[key] for x in findings for key in x.evidence}
    whole = replace(first, message=message, joint="", joints=joints, evidence=evidence)
    return replace(whole, remedy="\n".join(filter(None, parts)))


_ECHOES = ("nonlinear-spring", "missing-term", "transmission-error", "drift")
"""Findings that noise alone raises where the deflection of a spring is mostly noise."""

_OF_FEW_ROWS = ("cutoff-sensitive",)
"""Findings of two fits of the same rows, which differ by chance if these are few."""


def that_matter(findings: Sequence[Finding], exact: Collection[str] = ()) -> list[Finding]:
    """Return findings without those that noise alone raises, or whose torques do not matter.

    A weak spring, whose deflection is mostly noise, has such findings; with backlash it is none. A
    wrong set-up is never dropped: what it explains is a note already.
    What a model lacks is a note at `exact` joints, whose torque errors do not matter, and so is a
    symptom of a cause that explains it: the cause is as severe as its symptoms, whose remedies have
    the numbers of a model without it. Too few rows are a note where another finding is why blocks
    of the logs contradict each other, and so is that two ways to fit them differ.
    """
    loose, weak = ({x.joint for x in findings if x.code == y} for y in ("backlash", "weak-spring"))
    echoes = dict.fromkeys((*_ECHOES, "delay", "rotor-inertia"), weak) | {"weak-spring": loose}
    echoes["nonlinear-spring"] = weak | loose
    minor = {**dict.fromkeys(_ECHOES, exact), **_beside_few_rows(findings)}
    kept = (x for x in findings if x.severity == "wrong" or x.joint not in echoes.get(x.code, ()))
    matter = [replace(x, severity="note") if x.joint in minor.get(x.code, ()) else x for x in kept]
    return [*map(partial(_among, findings=matter), matter)]


def _beside_few_rows(findings: Sequence[Finding]) -> dict[str, Collection[str]]:
    """Return {code: joints} of what is a note where there are too few rows, or these are one."""
    doubted = {finding.code for finding in findings if finding.severity != "note"}
    is_alone = doubted <= {"few-rows", *_OF_FEW_ROWS}
    codes = (_OF_FEW_ROWS if is_alone else ("few-rows",)) if "few-rows" in doubted else ()
    return dict.fromkeys(codes, tuple(finding.joint for finding in findings))


def _among(finding: Finding, findings: Sequence[Finding]) -> Finding:
    """Return a finding as it counts among all: a symptom of a cause as a note without a remedy.

    A cause is as severe as the worst of its symptoms.
    """
    if finding.severity == "note":
        return finding
    if _is_symptom(finding):
        return as_note(finding) if any(_brings(cause, finding) for cause in findings) else finding
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
    if cause.severity == "note" or CODES[cause.code].kind != "cause":
        return False
    joints, evidence = joints_of([cause]), cause.evidence
    is_there = not joints or not symptom.joint or symptom.joint in joints
    is_worse = errors.SEVERITIES.index(symptom.severity) < errors.SEVERITIES.index(cause.severity)
    if not {EXPLAINED, OF_MOTOR} & {*evidence}:
        return is_there or (AS_GIVEN in evidence and not is_worse)
    explained = evidence.get(EXPLAINED, 0.0 if is_worse else evidence.get(OF_MOTOR, 0.0))
    # The rms error after a part of its square is explained.
    left = symptom.evidence.get("error", 0.0) * math.sqrt(max(1 - explained, 0.0))
    return is_there and explained > (1 - tol.POOR if is_worse else tol.MOST) and left < tol.MOST
