"""What a page says at its top: the verdict in a sentence, and what must not be trusted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from seaid._arrays import Array
from seaid.estimation import Estimate
from seaid.identification import POORLY_IDENTIFIED, Identification
from seaid.log import row_samples
from seaid.report.html_tables import (
    CORRELATED,
    ErrorRow,
    error_rows,
    share,
    short,
    side_name,
    term_name,
)
from seaid.report.html_traces import Run
from seaid.robot import THIN, is_physical

_MUCH_LEFT_OUT = 0.5
_BADLY_PREDICTED = 0.2

NOT_VALIDATED = (
    "Not validated on a motion it has not seen: how well it fits its own motion says little about "
    "how well it predicts another."
)


@dataclass(frozen=True)
class Doubts:
    """Sentences on one subject; `subject` stands above them."""

    subject: str
    sentences: tuple[str, ...]


def verdict(found: Identification, runs: Sequence[Run], doubts: Sequence[Doubts]) -> str:
    """Return in a sentence what was found, how well it predicts, and how many doubts there are."""
    counted = (
        (_relative_errors(found.drives.values()), "drive parameter"),
        (_relative_errors([found.load]), "base parameter"),
    )
    told = [
        f"{_count(len(errors), name)} found, {int(np.sum(errors < POORLY_IDENTIFIED))} with a "
        "standard error below 10\N{NO-BREAK SPACE}%"
        for errors, name in counted
        if len(errors)
    ]
    unseen = _prediction(error_rows(found, [run for run in runs if run.is_unseen]))
    flags = sum(len(one.sentences) for one in doubts)
    raised = f"{_count(flags, 'flag')} below" if flags else "nothing is flagged"
    return "; ".join([*told, unseen, raised]) + "."


def _relative_errors(estimates: Iterable[Estimate]) -> Array:
    """Return the relative standard errors of all parameters."""
    return np.concatenate([np.zeros(0), *(one.relative_standard_errors for one in estimates)])


def _prediction(rows: Sequence[ErrorRow]) -> str:
    """Say how far the prediction of unseen motions is off, by median and worst torque."""
    if not rows:
        return "not validated on a motion it has not seen"
    errors = [row.relative_error for row in rows]
    worst = max(rows, key=lambda row: row.relative_error)
    if len(rows) == 1:
        return f"the torque of an unseen motion is predicted with {share(errors[0])} error"
    return (
        f"the torques of unseen motion are predicted with {share(float(np.median(errors)))} error "
        f"at the median, {share(worst.relative_error)} at the worst joint ({worst.joint}, "
        f"{worst.side} side)"
    )


def doubts_of(found: Identification, runs: Sequence[Run]) -> list[Doubts]:
    """Return what must not be trusted, by subject; empty subjects are left out."""
    every = (
        Doubts("Flags of the identification", tuple(map(_sentence, found.flags))),
        Doubts("Validation", tuple(_of_validation(found, runs))),
        Doubts("Bodies", tuple(_of_bodies(found))),
        Doubts("Combinations that the data hardly tell", tuple(_poorly_told(found))),
        Doubts("Terms that the data do not support", tuple(_not_worth(found))),
        Doubts("Residuals", tuple(_correlated(found))),
        Doubts("Standstill", tuple(_left_out(found))),
    )
    return [one for one in every if one.sentences]


def _of_validation(found: Identification, runs: Sequence[Run]) -> Iterator[str]:
    if not any(run.is_unseen for run in runs):
        yield NOT_VALIDATED
    for run in runs:
        if not run.is_unseen and run.name.startswith("validation"):
            yield (
                f"The {run.name} is of a motion that was identified from: it does not count as "
                "unseen."
            )
    for row in error_rows(found, [run for run in runs if run.is_unseen]):
        if row.relative_error > _BADLY_PREDICTED:
            yield (
                f"The torque of {row.joint} ({row.side} side) is predicted badly in the {row.run}: "
                f"{share(row.relative_error)} of its size is error."
            )


def _of_bodies(found: Identification) -> Iterator[str]:
    """Say which bodies cannot exist, as `write_urdf` would refuse them."""
    bodies = found.robot.parameters.reshape(-1, 10)
    wrong = [
        name
        for name, body in zip(found.robot.body_names, bodies, strict=True)
        if not (np.all(np.isfinite(body)) and is_physical(body, THIN))
    ]
    if wrong and found.feasible is None:
        yield (
            f"{_listed(wrong)}: no body can have the inertial parameters of the found robot. They "
            "give the identified base parameters, and right torques with them; a simulator may "
            "refuse them. Identify with feasible=True for possible bodies."
        )
    elif wrong:
        yield f"{_listed(wrong)}: no body can have these inertial parameters."


def _poorly_told(found: Identification) -> Iterator[str]:
    for side, checks in found.checks.items():
        where = f"{side_name(side)}{'' if side in ('load', 'both') else f' of {side}'}"
        for text in checks.poorly_determined:
            yield _sentence(f"{where}: {text}")


def _not_worth(found: Identification) -> Iterator[str]:
    for side, checks in found.checks.items():
        for term in checks.terms:
            if term.bic <= 0:
                yield (
                    f"{_capital(term_name(side, term))}: the data do not ask for it (BIC "
                    f"{short(term.bic)}); leave the term out."
                )


def _correlated(found: Identification) -> Iterator[str]:
    for side, checks in found.checks.items():
        for joint, white in checks.whiteness.items():
            if white.first > CORRELATED:
                yield (
                    f"The residual of {joint} ({side_name(side)}) goes on from row to row "
                    f"(autocorrelation {white.first:.3g}): the model lacks something there, or a "
                    "sensor's zero is off."
                )


def _left_out(found: Identification) -> Iterator[str]:
    instants = sum(len(row_samples(motion)) for motion in found.motions)
    for side, count in found.excluded.items():
        rows = instants * (len(found.model.rows) if side == "load" else 1)
        if rows and count > _MUCH_LEFT_OUT * rows:
            where = "The load side" if side == "load" else f"The actuator side of {side}"
            yield (
                f"{where} is identified from {share(1 - count / rows)} of its instants: in the "
                "others a motor stands still, where dry friction has no direction."
            )


def _listed(names: Sequence[str], most: int = 8) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _sentence(text: str) -> str:
    return _capital(text) + ("" if text.endswith(".") else ".")


def _capital(text: str) -> str:
    """Return a sentence's beginning; a joint's name in front stays as it is."""
    return text[:1].upper() + text[1:]


def _count(number: int, name: str) -> str:
    return f"{number} {name}{'' if number == 1 else 's'}"
