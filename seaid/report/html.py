"""write_report and write_comparison: self-contained HTML pages of results and their checks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from seaid._files import write_whole
from seaid._progress import counted
from seaid.checks import CODES
from seaid.errors import SeaidError, checked
from seaid.frequency import FrequencyResponse
from seaid.identification import Identification, Validation
from seaid.identification.validation import compared
from seaid.report import figures, formats, provenance, tables
from seaid.report.comparison import Difference, comparison_of
from seaid.report.formats import probability, rendered, share, short
from seaid.report.html_charts import Axis, Figure, Run, traces_figure, traces_of
from seaid.report.html_robot import Label, Posture, posture_of, robot_picture
from seaid.report.html_verdict import (
    Nominal,
    Notice,
    before_and_after,
    nominal_values,
    notices_of,
    page_verdict,
)
from seaid.report.text import group_name
from seaid.robot import Robot
from seaid.simulation import ReplayComparison

Fact = str | int | float


@checked(SeaidError)
def write_report(
    identification: Identification,
    path: str | Path,
    validations: Validation | Iterable[Validation] = (),
    *,
    facts: Mapping[str, Fact] | None = None,
    nominal: Robot | None = None,
    frequency: FrequencyResponse | None = None,
    replays: ReplayComparison | Iterable[ReplayComparison] = (),
    notes: Iterable[str] = (),
) -> None:
    """Write the report of an identification as one HTML file that opens offline.

    The first screen has the verdict, the robot with its joints coloured by how well each is
    explained, the errors before and after the identification, and the warnings with their
    remedies. Then come figures of each actuator, tables with confidence intervals, interactive
    traces, and checks. The size is below 6 MB for any logs; traces are thinned if necessary, and
    the page says so.

    Parameters
    ----------
    identification : Identification
    path : path
        The file to write, ending in .html.
    validations : Validation or iterable of Validation
        Validations on motions that were not used for identification. Without any the page says
        so.
    facts : dict, optional
        Experiment metadata {name: text or number}, as seeds, files, people and places; "Command"
        is shown as code.
    nominal : Robot, optional
        The robot with the nominal values to compare with. Default: those of the identified one.
    frequency : FrequencyResponse, optional
        A frequency response, of `frequency_response(..., identification=found)`: measured and
        computed responses with resonance and antiresonance, and its warnings.
    replays : ReplayComparison or iterable of ReplayComparison, optional
        Replays of logs before and after the identification, of `compare_replays`.
    notes : iterable of str, optional
        Why logs that were to validate do not, among the warnings.

    Raises
    ------
    SeaidError
        For another suffix, results that are not validations of this robot, invalid facts, and if
        the file cannot be written.

    Examples
    --------
    >>> checked = seaid.validate(result, seaid.read_log("other.csv", robot))
    >>> seaid.write_report(result, "report.html", checked, facts={"place": "Eindhoven"})
    """
    path = _page_path(path)
    nominal_robot = nominal or identification.nominal or identification.known
    joints = identification.robot.joint_names
    if nominal_robot.joint_names != joints:
        raise _other_joints(
            "nominal=", nominal_robot.joint_names, joints, "the same robot with nominal values"
        )
    results = _checked(identification, validations)
    if frequency is not None and not set(frequency.joints) <= set(joints):
        raise _other_joints("frequency=", frequency.joints, joints, "a response of the same robot")
    moved = [replays] if isinstance(replays, ReplayComparison) else list(replays)
    runs = runs_of(identification, results)
    values, posture = nominal_values(identification, nominal_robot), posture_of(identification)
    content = {
        # The template has its sections, and makes their tables and figures of these.
        **{"result": identification, "nominal": nominal_robot, "frequency": frequency},
        **{"tables": tables, "figures": figures},
        **{"provenance": provenance, "codes": CODES},
        "base": tables.load_table(identification.load, values.bodies),
        "facts": dict(facts or {}).items(),
        **_motions(identification, runs, values, posture, moved, tuple(notes)),
        "replays": [_replay(identification, replay) for replay in moved],
    }
    write_whole(path, rendered("report.html.j2", robot=identification.robot.name, **content))


@checked(SeaidError)
def write_comparison(
    first: Identification,
    second: Identification,
    path: str | Path,
    *,
    names: tuple[str, str] = ("first", "second"),
) -> None:
    """Write the comparison of two identifications as one HTML file that opens offline.

    Parameters
    ----------
    first, second : Identification
        Two identifications of one robot: cold and warm, before and after a repair.
    path : path
        The file to write, ending in .html.
    names : (str, str)
        How the page names them.

    Raises
    ------
    SeaidError
        For another suffix, identifications without a common parameter, and if the file cannot be
        written.

    Examples
    --------
    >>> cold, warm = (seaid.identify(robot, log) for log in (cold_log, warm_log))
    >>> seaid.report.write_comparison(cold, warm, "comparison.html", names=("cold", "warm"))
    """
    path = _page_path(path)
    result = comparison_of(first, second, names=names)
    tests = [
        (group_name(group), short(test.chi_square), test.freedom, probability(test.p_value))
        for group, test in result.groups.items()
    ]
    page = rendered(
        "comparison.html.j2",
        robot=first.robot.name,
        result=result,
        picture=robot_picture(
            posture_of(first),
            _difference_labels(first.robot, result.differences),
            "The robot: which drives differ",
        ),
        tests=tests,
        table=tables.difference_table(result),
        numbers=list(zip(names, map(_identified_from, (first, second)), strict=True)),
    )
    write_whole(path, page)


def _difference_labels(robot: Robot, differences: Sequence[Difference]) -> dict[str, Label]:
    """Return the parameters of the drive of each joint that differ significantly."""
    labels = {}
    for joint in robot.joint_names:
        changes = [difference for difference in differences if difference.joint == joint]
        names = [change.name.replace("_", " ") for change in changes if change.is_significant]
        nothing = "no difference" if changes else "no drive"
        colour = "poor" if names else "good" if changes else "none"
        labels[joint] = Label(joint, ", ".join(names) or nothing, colour)
    return labels


def _identified_from(identification: Identification) -> str:
    motions = len(identification.motions)
    length = sum(float(motion.time[-1] - motion.time[0]) for motion in identification.motions)
    logs = f"{length:.4g} s in {counted(motions, 'motion')}" if motions else "logs read in pieces"
    return f"{logs}, below {identification.cutoff_hz:.3g} Hz: {identification.verdict.sentence}"


def _other_joints(
    option: str, joints: Sequence[str], expected: Sequence[str], remedy: str
) -> SeaidError:
    """Return the error of an argument of a robot with other joints."""
    return SeaidError(
        f"{option}: the joints {', '.join(joints)}, but the identified robot has "
        f"{', '.join(expected)}: give {remedy}"
    )


def _page_path(path: str | Path) -> Path:
    path = Path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise SeaidError(f"a report is an HTML page: '{path}' must end in .html")
    return path


def runs_of(identification: Identification, results: Sequence[Validation]) -> list[Run]:
    """Return all motions of a page: those used for identification, then the validations."""
    fits = [compared(identification, motion) for motion in identification.motions]
    runs = [Run(_name("own log", place, fits), fit, False) for place, fit in enumerate(fits)]
    for place, result in enumerate(results):
        # By the samples and not by names: a log that was identified from is no test.
        seen = any(_is_same_motion(result, fit) for fit in fits)
        name = _name("validation", place, results)
        runs.append(Run(name, result, not seen))
    return runs


def _name(kind: str, place: int, every: Sequence[Any]) -> str:
    return f"{kind} {place + 1}" if len(every) > 1 else kind


def _is_same_motion(first: Validation, second: Validation) -> bool:
    """Return whether two validations are of the same motion."""
    traces = [(x.time, x.actuator.measured, x.load.measured) for x in (first, second)]
    return first.load.measured.shape == second.load.measured.shape and all(
        np.allclose(a, b, rtol=1e-9, atol=0, equal_nan=True) for a, b in zip(*traces, strict=True)
    )


def _checked(
    identification: Identification, results: Validation | Iterable[Validation]
) -> list[Validation]:
    every = [results] if isinstance(results, Validation) else list(results)
    joints = identification.robot.joint_names
    for validation in every:
        if validation.joints != joints:
            remedy = "a validation of the identification of the report"
            raise _other_joints("validations=", validation.joints, joints, remedy)
    return every


def _motions(
    identification: Identification,
    runs: Sequence[Run],
    nominal: Nominal,
    posture: Posture,
    replays: Sequence[ReplayComparison],
    notes: Sequence[str],
) -> dict[str, Any]:
    """Return the template values of the first screen and of the motions."""
    errors = tables.error_rows(runs, identification.robot)
    errors += [row for run in runs for row in tables.base_rows(run)]
    traces = traces_of(identification, runs)
    pictured = ([run for run in runs if run.is_unseen] or list(runs))[:1]
    notices = notices_of(identification, runs, replays, notes)
    labels = _labels(identification, pictured, notices)
    return {
        "verdict": page_verdict(identification, runs, replays),
        "notices": notices,
        "picture": robot_picture(
            posture, labels, "The robot: how well the torque of each joint is explained"
        ),
        "bars": _bars(pictured, nominal),
        "pictured": [run.name for run in pictured],
        "is_unseen": any(run.is_unseen for run in pictured),
        "errors": tables.error_table(errors),
        "runs": runs,
        "all_errors": len(errors),
        "printed": [x for run in pictured for x in _printed_traces(run, identification.robot)],
        "has_own": bool(identification.motions),
        "traces": traces,
        "without_traces": len(runs) - len(traces["runs"]),
    }


_MOST_PRINTED = 12
"""Most traces of torques on paper, evenly from the best to the worst predicted."""


def _printed_traces(run: Run, robot: Robot) -> Iterator[Figure]:
    """Yield traces for paper, of torques from the best to the worst predicted."""
    ranked = sorted(tables.error_rows([run], robot), key=lambda row: row.relative_error)
    for row in ranked[:: max(1, -(-len(ranked) // _MOST_PRINTED))]:
        fit, place = getattr(run.result, row.side), run.result.joints.index(row.joint)
        torque = "motor torque" if row.side == "actuator" else "torque on the load"
        yield traces_figure(
            run.result.time,
            {"measured": fit.measured[:, place], "computed": fit.computed[:, place]},
            Axis(torque, row.unit),
            f"{row.joint}: {torque}, measured and computed",
            f"{row.joint}, {row.side} side, {run.name}: measured (wide) and computed (thin), "
            f"error {share(row.relative_error)}",
        )


def _replay(identification: Identification, result: ReplayComparison) -> dict[str, Any]:
    """Return the template values of a replay: errors, and traces from the largest error down."""
    joints = identification.robot.joint_names
    if not {*result.joints} <= {*joints}:
        raise _other_joints("replays=", result.joints, joints, "a replay of the same robot")
    return {
        "length": f"{float(result.time[-1] - result.time[0]):.3g}",
        "table": tables.replay_error_table(result),
        "figures": [_replayed(result, int(k)) for k in np.argsort(-result.rms_errors[1])],
    }


def _replayed(result: ReplayComparison, place: int) -> Figure:
    """Return the traces of a replayed joint."""
    kinds = {"measured": result.measured, "replayed": result.before, "computed": result.after}
    joint, unit = result.joints[place], "m" if result.is_prismatic[place] else "rad"
    before, after = (short(1e3 * float(error[place])) for error in result.rms_errors)
    return traces_figure(
        result.time,
        {name: positions[:, place] for name, positions in kinds.items()},
        Axis("joint position", unit),
        f"Replayed position of {joint}: measured, before and after",
        f"{joint}: {after} m{unit} rms, {before} before",
    )


def _labels(
    result: Identification, pictured: Sequence[Run], notices: Sequence[Notice]
) -> dict[str, Label]:
    """Return how well each joint is explained: on the load side, else on the actuator side."""
    flagged = {joint for n in notices if n.severity != "note" for joint in n.joints}
    # Rows of the load side come last, and replace those of the actuator side.
    errors = {row.joint: row.relative_error for row in tables.error_rows(pictured, result.robot)}
    return {
        joint: Label(
            joint,
            f"{share(errors[joint])} error" if joint in errors else "not compared",
            formats.explained_as(errors.get(joint, np.nan)),
            joint in flagged,
        )
        for joint in result.robot.joint_names
    }


def _bars(pictured: Sequence[Run], nominal: Nominal) -> dict[str, Any]:
    """Return the errors before and after, the largest first, and that of a whole bar."""
    rows = [row for run in pictured for row in before_and_after(nominal, run)]
    rows.sort(key=lambda row: -row.relative_error)
    errors = [x for row in rows for x in (row.before, row.relative_error) if np.isfinite(x)]
    return {"rows": rows, "full": min(max(errors, default=1.0), 1.0) or 1.0}
