"""The verdict of a page in one sentence, and its warnings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.identification import POORLY_IDENTIFIED
from seaid.log import row_samples
from seaid.report.html_tables import CORRELATED, error_rows, share, short, side_name, term_name
from seaid.robot import THIN, is_physical

if TYPE_CHECKING:
    from seaid.errors import Finding
    from seaid.estimation import Estimate
    from seaid.identification import Identification
    from seaid.report.html_tables import ErrorRow
    from seaid.report.html_traces import Run

_LARGE_EXCLUDED_SHARE = 0.5
_BADLY_PREDICTED = 0.2

NOT_VALIDATED = (
    "Not validated on an unseen motion: how well the model fits its own motion says little about "
    "how well it predicts another."
)


@dataclass(frozen=True)
class Warnings:
    """Warnings on one subject, which is their heading."""

    subject: str
    sentences: tuple[str, ...]


def verdict(found: Identification, runs: Sequence[Run], warnings: Sequence[Warnings]) -> str:
    """Return one sentence on the estimates, their prediction errors and the number of warnings."""
    counted = (
        (_relative_errors(found.drives.values()), "drive parameter"),
        (_relative_errors([found.load]), "base parameter"),
    )
    estimated = [
        f"{_count(len(errors), name)} identified, {int(np.sum(errors < POORLY_IDENTIFIED))} with a "
        "standard error below 10\N{NO-BREAK SPACE}%"
        for errors, name in counted
        if len(errors)
    ]
    unseen = _prediction(error_rows(found, [run for run in runs if run.is_unseen]))
    count = sum(len(one.sentences) for one in warnings)
    raised = f"{_count(count, 'warning')} below" if count else "no warnings"
    return "; ".join([found.verdict.sentence, *estimated, unseen, raised]) + "."


def _relative_errors(estimates: Iterable[Estimate]) -> Array:
    """Return the relative standard errors of all parameters."""
    return np.concatenate([np.zeros(0), *(one.relative_standard_errors for one in estimates)])


def _prediction(rows: Sequence[ErrorRow]) -> str:
    """Return the prediction error of unseen motions: median and worst torque."""
    if not rows:
        return "not validated on an unseen motion"
    errors = [row.relative_error for row in rows]
    worst = max(rows, key=lambda row: row.relative_error)
    if len(rows) == 1:
        return f"the torque of an unseen motion is predicted with {share(errors[0])} error"
    return (
        f"the torques of unseen motions are predicted with a median error of "
        f"{share(float(np.median(errors)))}, {share(worst.relative_error)} at the worst joint "
        f"({worst.joint}, {worst.side} side)"
    )


def warnings_of(found: Identification, runs: Sequence[Run]) -> list[Warnings]:
    """Return the warnings by subject, without empty subjects."""
    every = (
        Warnings("Identification", tuple(_with_code(one) for one in found.warnings)),
        Warnings("Validation", tuple(_of_validation(found, runs))),
        Warnings("Bodies", tuple(_of_bodies(found))),
        Warnings("Poorly determined combinations", tuple(_poorly_determined(found))),
        Warnings("Terms that the data do not support", tuple(_unsupported_terms(found))),
        Warnings("Residuals", tuple(_autocorrelated(found))),
        Warnings("Standstill", tuple(_excluded(found))),
    )
    return [one for one in every if one.sentences]


def _with_code(one: Finding) -> str:
    """Return a warning with its code and its remedy as a sentence."""
    remedy = f" {' '.join(one.remedy.split())}" if one.remedy else ""
    return f"{one.code}: {_sentence(one.message)}{remedy}"


def _of_validation(found: Identification, runs: Sequence[Run]) -> Iterator[str]:
    if not any(run.is_unseen for run in runs):
        yield NOT_VALIDATED
    for run in runs:
        if not run.is_unseen and run.name.startswith("validation"):
            yield (
                f"The {run.name} is of a motion that was used for identification: it is not an "
                "unseen one."
            )
    for row in error_rows(found, [run for run in runs if run.is_unseen]):
        if row.relative_error > _BADLY_PREDICTED:
            yield (
                f"The torque of {row.joint} ({row.side} side) is poorly predicted in the "
                f"{row.run}: relative error {share(row.relative_error)}."
            )


def _of_bodies(found: Identification) -> Iterator[str]:
    """Yield the physically inconsistent bodies, which `write_urdf` would refuse."""
    bodies = found.robot.parameters.reshape(-1, 10)
    wrong = [
        name
        for name, body in zip(found.robot.body_names, bodies, strict=True)
        if not (np.all(np.isfinite(body)) and is_physical(body, THIN))
    ]
    if wrong and found.feasible is None:
        yield (
            f"{_listed(wrong)}: the inertial parameters are physically inconsistent. They have the "
            "identified base parameters and thus the right torques, but a simulator may refuse "
            "them. Identify with feasible=True for physically consistent ones."
        )
    elif wrong:
        yield f"{_listed(wrong)}: the inertial parameters are physically inconsistent."


def _poorly_determined(found: Identification) -> Iterator[str]:
    for side, checks in found.checks.items():
        where = f"{side_name(side)}{'' if side in ('load', 'both') else f' of {side}'}"
        for text in checks.poorly_determined:
            yield _sentence(f"{where}: {text}")


def _unsupported_terms(found: Identification) -> Iterator[str]:
    for side, checks in found.checks.items():
        for term in checks.terms:
            if term.bic <= 0:
                yield (
                    f"{_capital(term_name(side, term))}: not supported by the data (BIC "
                    f"{short(term.bic)}); remove the term."
                )


def _autocorrelated(found: Identification) -> Iterator[str]:
    for side, checks in found.checks.items():
        for joint, white in checks.whiteness.items():
            if white.first > CORRELATED:
                yield (
                    f"The residual of {joint} ({side_name(side)}) is autocorrelated "
                    f"({white.first:.3g} at lag 1): the model lacks a term there, or a sensor has "
                    "an offset."
                )


def _excluded(found: Identification) -> Iterator[str]:
    instants = sum(len(row_samples(motion)) for motion in found.motions)
    for side, count in found.excluded.items():
        rows = instants * (len(found.model.torque_joints) if side == "load" else 1)
        if rows and count > _LARGE_EXCLUDED_SHARE * rows:
            where = "The load side" if side == "load" else f"The actuator side of {side}"
            yield (
                f"{where} is identified from {share(1 - count / rows)} of its instants: the others "
                "are near standstill, where the direction of dry friction is unknown."
            )


def _listed(names: Sequence[str], most: int = 8) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _sentence(text: str) -> str:
    return _capital(text) + ("" if text.endswith(".") else ".")


def _capital(text: str) -> str:
    """Return a text with a capital first letter."""
    return text[:1].upper() + text[1:]


def _count(number: int, name: str) -> str:
    return f"{number} {name}{'' if number == 1 else 's'}"
