"""write_report: what the page says is what was found; hostile names, many joints, refusals."""

import base64
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array, FrozenMapping
from seaid.checks import CODES
from seaid.drives import ParameterName, read_drives
from seaid.errors import Finding, SeaidError
from seaid.estimation import TermTest, Whiteness
from seaid.estimation.estimate import ModelChecks
from seaid.identification import Identification, Validation, identify
from seaid.identification.validation import compared
from seaid.report import html_charts, tables, write_comparison, write_report
from seaid.report.figures import actuator_figures
from seaid.report.formats import share
from seaid.report.html import runs_of
from seaid.report.html_charts import Axis, Run, axis_time, traces_figure
from seaid.report.html_verdict import (
    NO_BODIES,
    before_and_after,
    nominal_values,
    notices_of,
    page_verdict,
)
from seaid.report.provenance import facts_of, known_drives
from seaid.report.tables import ErrorRow
from seaid.robot import Robot
from tests.experiments import arm, arm_found, arm_result
from tests.report.test_html_charts import points_of
from tests.report_pages import HOSTILE, made_up, prediction
from tests.terms import ELASTIC, STIFF, exact_motion, free_stretch, noisy_log, with_terms
from tests.terms import arm as two_joints

PAGE_BYTES = 6_000_000
VOID = {"meta", "br", "input", "link", "img", "hr"}


class Page(HTMLParser):
    """A page taken apart: its visible text, tags, attributes, scripts; unclosed tags fail."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.text, self.source = "", text
        self.tags: list[str] = []
        self.scripts: dict[str, str] = {}
        self.attributes: list[tuple[str, str]] = []
        self.open: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.text += " " if tag in ("dd", "td", "th", "li") else ""
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert tag in VOID or self.open.pop()[0] == tag

    def handle_data(self, data: str) -> None:
        inside, attributes = self.open[-1] if self.open else ("", {})
        if inside == "script":
            name = attributes.get("id") or "code"
            self.scripts[name] = self.scripts.get(name, "") + data
        elif inside != "style":
            self.text += data

    @property
    def words(self) -> str:
        """The visible text with single spaces."""
        return " ".join(self.text.split())


def page_of(
    folder: Path, found: Identification, results: Any, facts: Mapping[str, Any] | None = None
) -> Page:
    path = folder / "page.html"
    write_report(found, path, results, facts=facts)
    assert path.stat().st_size < PAGE_BYTES
    return Page(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Page:
    """The page of the mixed arm, validated."""
    facts = {"seed": 1, "who": "<me> & you"}
    return page_of(tmp_path_factory.mktemp("page"), arm_found(), [arm_result()], facts)


def unpacked(trace: dict[str, Any]) -> Array:
    steps = np.frombuffer(base64.b64decode(trace["data"]), dtype="<i2").astype(float)
    steps[steps == -32768] = np.nan
    return np.asarray(trace["offset"] + trace["scale"] * steps)


def expected_words() -> list[str]:
    """Return what a page has to say, in the words of the result."""
    found, result = arm_found(), arm_result()
    drives = [name.replace("_", " ") for one in found.drives.values() for name in one.names]
    counted = [f"{share(one)} of samples" for one in result.actuator.counted_share[1:3]]
    return [
        *(page_verdict(found, runs_of(found, [result])).sentence, *counted),
        *(*found.drives, *drives, *found.load.names, "gear_ratio_rad_per_m"),
        *("6,001 samples, 6.00 s at 1000 Hz", "Torques used on the load side all 4 joints"),
        *(str(found.processing[0].cutoff_selection), "who <me> & you"),
    ]


def test_page_has_everything_that_was_found(page: Page) -> None:
    """Values and intervals in full, words as the result has them, and the versions of libraries."""
    estimates = [*arm_found().drives.values(), arm_found().load]
    exact = {float(value) for name, value in page.attributes if name == "value" and "." in value}
    for estimate in estimates:
        assert {*estimate.values.tolist(), *estimate.standard_errors.tolist()} <= exact
    assert [x for x in expected_words() if " ".join(x.split()) not in page.words] == []
    for name in ("seaid", "numpy", "scipy", "Pinocchio", "Python"):
        assert re.search(rf"{name} \d+\.\d+", page.words)
    order = [page.words.index(words) for words in ("Good", "Before and after", "Warnings")]
    assert order == sorted(order)


def test_first_screen_says_how_well_the_unseen_motion_is_predicted() -> None:
    """The median and the largest of the relative errors of both sides, to two digits."""
    result = arm_result()
    errors = np.concatenate([result.actuator.relative_error, result.load.relative_error])
    errors = errors[np.isfinite(errors)]
    name, median, worst = page_verdict(arm_found(), runs_of(arm_found(), [result])).numbers[0]
    assert name == "Unseen motion"
    (largest,) = re.findall(r"worst ([\d.]+)\N{NO-BREAK SPACE}%", worst)
    numbers = [float(text) / 100 for text in (median.split("\N{NO-BREAK SPACE}")[0], largest)]
    assert numbers == pytest.approx([np.median(errors), np.max(errors)], rel=0.051)


def test_page_is_whole_html_that_fetches_nothing(page: Page) -> None:
    for name, value in page.attributes:
        assert name not in ("src", "srcset", "background", "poster"), value
        if name == "href":
            assert value.startswith("#")
    for wanted in ("h1", "h2", "table", "caption", "th", "nav", "main", "svg", "title"):
        assert wanted in page.tags
    ids = [value for name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    linked = {value[1:] for name, value in page.attributes if name == "href"}
    assert linked - {""} <= set(ids)


def test_traces_are_those_of_the_validation(page: Page) -> None:
    data = json.loads(page.scripts["traces-data"])
    own, unseen = data["runs"]
    assert (own["unseen"], unseen["unseen"]) == (False, True)
    result = arm_result()
    assert data["joints"] == list(result.joints)
    assert data["units"]["load"] == ["N", "N m", "N", "N m"]
    for side, fit in (("actuator", result.actuator), ("load", result.load)):
        for index, trace in enumerate(unseen[side]):
            if np.all(np.isnan(fit.measured[:, index])):
                assert trace is None
                continue
            times = unseen["start"] + unseen["step"] * np.arange(len(unpacked(trace["measured"])))
            values = {"measured": fit.measured, "computed": fit.computed}
            values["residual"] = fit.measured - fit.computed
            for name, columns in values.items():
                expected = np.interp(times, result.time, columns[:, index])
                atol = 2e-5 * np.nanmax(np.abs(expected))
                np.testing.assert_allclose(unpacked(trace[name]), expected, atol=atol)


def test_printed_traces_have_the_units_of_their_torques(page: Page) -> None:
    """A load that slides has a force, and its motor a torque."""
    kinds = "motor torque|torque on the load"
    axis = rf'="(\w+): ({kinds}), measured and computed".*?rotate\(-90\)">(?:{kinds}) \[([^]]*)\]'
    units = {(joint, kind): x for joint, kind, x in re.findall(axis, page.source, re.DOTALL)}
    loads = {"rail": "N", "shoulder": "N m", "telescope": "N", "wrist": "N m"}
    assert {joint: unit for (joint, kind), unit in units.items() if "load" in kind} == loads
    assert units["telescope", "motor torque"].endswith("N m")  # in a power of ten


def test_spectrum_of_a_sine_has_its_amplitude_at_its_frequency(tmp_path: Path) -> None:
    found, result = made_up(tmp_path, ("a", "b"), 4000)
    sine = 0.7 * np.sin(2 * np.pi * 2.0 * result.time)
    measured = np.where(np.isnan(result.load.measured), np.nan, sine[:, None])
    result = replace(result, load=replace(result.load, measured=measured))
    page = page_of(tmp_path, found, result)
    run = json.loads(page.scripts["traces-data"])["runs"][0]
    amplitude = 10 ** unpacked(run["load"][0]["spectra"]["measured"])
    peak = int(np.argmax(amplitude))
    assert run["frequencies"][peak] == pytest.approx(2.0, abs=0.15)
    assert amplitude[peak] == pytest.approx(0.7, rel=0.1)


def test_without_room_traces_are_thinned_with_their_peaks_and_said_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = replace(html_charts._TRACES, room_bytes=8_000)
    monkeypatch.setattr(html_charts, "_TRACES", small)
    found, result = made_up(tmp_path, ("a", "b", "c"), 4000)
    spike = result.load.measured.copy()
    spike[1234, 1] = 50.0
    result = replace(result, load=replace(result.load, measured=spike))
    page = page_of(tmp_path, found, [result])
    run = json.loads(page.scripts["traces-data"])["runs"][0]
    measured = unpacked(run["load"][1]["measured"])
    assert len(measured) <= 334
    assert np.max(measured) == pytest.approx(50.0, rel=1e-4)
    assert "Thinned to the smallest" in run["thinned"]
    time = run["start"] + run["step"] * int(np.argmax(measured))
    assert time == pytest.approx(result.time[1234], abs=2 * run["step"])


def test_more_motions_than_there_is_room_for_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So are errors that are not in their table."""
    few = replace(html_charts._TRACES, most=5)
    monkeypatch.setattr(html_charts, "_TRACES", few)
    monkeypatch.setattr(tables, "_MOST_ERRORS", 6)
    found, result = made_up(tmp_path, ("a", "b"), 600)
    page = page_of(tmp_path, found, [result] * 4)
    assert len(json.loads(page.scripts["traces-data"])["runs"]) == 2
    assert "no room for the traces of 2 more motions" in page.words
    assert "The 6 largest of 8 errors" in page.words


def test_what_a_validation_may_have_changes_its_page(tmp_path: Path) -> None:
    """The temperature of one motor, and a joint without a sample that counts."""
    found, result = arm_found(), arm_result()
    warmth = np.full((len(result.motions[0].time), found.robot.n), np.nan)
    warmth[:, 0] = np.linspace(25.0, 60.0, len(warmth))
    motion = replace(result.motions[0], motor_temperature=warmth)
    last = np.arange(4) == 3
    load = replace(
        result.load,
        relative_error=np.where(last, np.nan, result.load.relative_error),
        counted_share=np.where(last, 0.0, result.load.counted_share),
    )
    page = page_of(tmp_path, found, replace(result, motions=(motion,), load=load))
    first, *others = json.loads(page.scripts["traces-data"])["runs"][-1]["temperature"]
    assert others == [None] * (found.robot.n - 1)
    assert unpacked(first)[[0, -1]] == pytest.approx([25.0, 60.0], abs=1.5)
    assert np.all(np.diff(unpacked(first)) >= 0)
    assert "not compared" in page.words


def test_hostile_names_are_text(tmp_path: Path) -> None:
    found, result = made_up(tmp_path, HOSTILE)
    page = page_of(tmp_path, found, [result], {"<i>who</i>": "</script>\"'&"})
    for name in (*HOSTILE, "<i>who</i>", "</script>\"'&", "chain <i>"):
        assert name in page.text
    assert "b" not in page.tags
    assert page.tags.count("script") == 3
    assert json.loads(page.scripts["traces-data"])["joints"] == list(HOSTILE)
    assert "<" not in page.scripts["traces-data"]


NOTICES = {
    "inconsistent-inertia": ("note", "The inertial parameters of carriage"),
    "poorly-determined": ("note", "Load side: the data tell 1e-03 of the combination a - b."),
    "needless-term": ("note", "Viscous friction of wrist: not supported by the data (BIC -4)"),
    "residual": ("note", "wrist (load side)"),
    "standstill": ("note", ""),
    "saturation": ("doubtful", "It ends. It ends here."),
    "unseen-motion": ("wrong", "The model fails."),
}
"""{subject of a notice: severity, words of its messages}."""


def test_what_is_wrong_has_one_notice_per_code() -> None:
    """Bodies, terms, residuals and samples of the identification, and errors of a validation."""
    term = TermTest((ParameterName("viscous_friction", "wrist"),), 1.0, 0.1, 0.7, -4.0, 100.0)
    white = {"wrist": Whiteness(0.95, 0.1, 0.0), "rail": Whiteness(0.5, 1.0, 0.0)}
    checks = ModelChecks(900.0, ("the data tell 1e-03 of the combination a - b",), (term,), white)
    robot = arm_found().robot
    found = replace(
        arm_found(),
        robot=robot.with_values(np.append(-1.0, robot.parameters[1:]), robot.drives),
        checks=FrozenMapping({"load": checks}),
        excluded=FrozenMapping({"load": 10**6}),
        findings=FINDINGS,
    )
    result = replace(
        arm_result(),
        load=replace(arm_result().load, relative_error=np.array([0.01, 0.35, 0.01, 0.01])),
        warnings=(Finding("unseen-motion", "the model fails", "wrist", "wrong"),),
    )
    runs = runs_of(found, [result])
    notices = notices_of(found, runs)
    found_codes = {one.subject: (one.severity, " ".join(one.messages)) for one in notices}
    assert len(found_codes) == len(notices)
    for subject, (severity, words) in NOTICES.items():
        assert found_codes[subject][0] == severity, subject
        assert words in found_codes[subject][1]
    assert page_verdict(found, runs).words == "Do not use"
    right = notices_of(arm_found(), runs_of(arm_found(), [arm_result()]))
    assert {one.severity for one in right} == {"note"}


def test_a_motion_that_was_used_is_no_validation(tmp_path: Path) -> None:
    """Neither without any validation, nor with one of the same motion."""
    found = arm_found()
    page = page_of(tmp_path, found, [])
    assert "Own motion, not validated" in page.words
    assert "Not validated on an unseen motion" in page.words
    own = compared(found, found.motions[0])
    said = [one for one in notices_of(found, runs_of(found, [own])) if "validated" in one.subject]
    assert [one.severity for one in said] == ["doubtful", "note"]
    assert "is of a motion that was used for identification" in said[0].messages[0]
    assert "not validated" in page_of(tmp_path, found, own).words


FINDINGS = (
    Finding("saturation", "it ends", "wrist", "doubtful", remedy="record a slower motion"),
    Finding("saturation", "it ends here", "rail", "doubtful", remedy="record a slower motion"),
)


def test_findings_decide_the_verdict_and_their_remedy_is_text_to_copy(tmp_path: Path) -> None:
    """The lines of a remedy after its first one are a snippet, and the worst finding is first."""
    remedy = "in the drives file:\n[shoulder]\ngear_ratio = 100.0"
    ratio = Finding("gear-ratio", "the ratio is off", "shoulder", "wrong", remedy=remedy)
    note = Finding("holes", "samples are excluded", severity="note")
    found = replace(arm_found(), findings=(note, replace(note, remedy="fill"), *FINDINGS, ratio))
    first, *_ = notices_of(found, runs_of(found, [arm_result()]))
    assert f"{first.remedy}\n{first.snippet}" == remedy
    page = page_of(tmp_path, found, [arm_result()])
    assert "Do not use Unseen motion" in page.words
    assert "Because of gear-ratio (shoulder)." in page.words
    assert f"Cause and advice{CODES['gear-ratio'].cause}Advice:" in page.words
    places = [value for name, value in page.attributes if name == "id"]
    assert [places.count(f"about-{code}") for code in ("gear-ratio", "holes")] == [1, 1]
    classes = {value for name, value in page.attributes if name == "class"}
    assert {"verdict do-not-use", "notice wrong", "notice doubtful", "notice note"} <= classes


def errors_of(found: Identification, nominal: Robot, result: Validation) -> list[ErrorRow]:
    run = Run("validation", result, True)
    return before_and_after(nominal_values(found, nominal), run)


def test_wrong_nominal_values_predict_worse_and_absent_ones_are_said(tmp_path: Path) -> None:
    """The truth predicts as well as the estimate; 30 % too heavy bodies do not."""
    found, result = arm_found(), arm_result()
    truth = errors_of(found, arm(), result)
    worse = errors_of(found, arm().with_values(1.3 * arm().parameters, arm().drives), result)
    for row, heavy in zip(truth, worse, strict=True):
        assert row.before < 0.05
        if row.side == "load" and row.joint != "rail":
            assert heavy.before > 0.2
        assert row.relative_error == heavy.relative_error
        assert not row.reason
    absent = {(row.side, row.joint): row.reason for row in errors_of(found, found.known, result)}
    assert absent["load", "wrist"] == NO_BODIES
    springs = "no nominal viscous friction, coulomb friction, stiffness"
    assert springs in absent["actuator", "shoulder"]
    assert f"before: {NO_BODIES}" in page_of(tmp_path, found, result).words
    # the robot file alone predicts no friction, here most of the torque of the wrist's motor
    bodies = arm().with_values(arm().parameters, arm().without_nominal().drives)
    rows = {(row.side, row.joint): row for row in errors_of(found, bodies, result)}
    assert rows["load", "wrist"].before > 0.2
    assert rows["load", "wrist"].reason == "without viscous friction, coulomb friction"
    assert rows["load", "shoulder"].before < 0.01
    assert np.isnan(rows["actuator", "shoulder"].before)
    unkept = errors_of(found, arm(), replace(result, motions=()))
    assert {row.reason for row in unkept} == {"the motion of this validation is not kept"}


def line_of(figure: str, name: str) -> Array:
    (path,) = re.findall(rf'<path class="line {name}" d="([^"]*)"', figure)
    return np.array([[float(x) for x in one.split()] for one in re.split("[ML]", path)[1:]])


def test_samples_of_friction_and_spring_lie_on_the_identified_lines() -> None:
    panels = actuator_figures(arm_found(), arm())
    assert [panel.note for panel in panels] == ["stiff", *["series elastic"] * 2, "stiff"]
    drawn = {panel.joint: [str(figure.svg) for figure in panel.figures] for panel in panels}
    (_,), (_, spring) = drawn["rail"], drawn["shoulder"]
    line = line_of(spring, "identified")
    for name in ("sample up", "sample down"):
        points = points_of(spring, name)
        assert len(points) > 50
        off = points[:, 1] - np.interp(points[:, 0], line[:, 0], line[:, 1])
        assert np.max(np.abs(off)) < 4.0  # of 246 high
    for friction, *_ in drawn.values():
        points, line = points_of(friction, "sample"), line_of(friction, "identified")
        middle = np.mean(line[:, 0])
        fast = points[np.abs(points[:, 0] - middle) > 60]
        off = fast[:, 1] - np.interp(fast[:, 0], line[:, 0], line[:, 1])
        assert np.sqrt(np.mean(off**2)) < 8.0
        assert line_of(friction, "nominal").shape == line.shape  # the truth has values
    for panel in actuator_figures(arm_found(), arm_found().known):
        assert all("line nominal" not in figure.svg for figure in panel.figures)


def test_samples_of_a_spring_with_hysteresis_lie_between_its_lines(tmp_path: Path) -> None:
    """Those of both ways, each half of the loop's width from its middle."""
    values = {"hysteresis_force": 3.0, "hysteresis_deflection": 0.01}
    drive = with_terms(ELASTIC, {"spring": ("linear", "dahl")}, values)
    truth = two_joints(tmp_path, STIFF, drive)
    log = noisy_log(exact_motion(truth, {"two": free_stretch(0.15)}), 1e-4, 1e-6)
    found = identify(truth.without_nominal(), log, torque_joints=["one"], cutoff_hz=10.0)
    (figure,) = (x.figures[-1] for x in actuator_figures(found, truth) if x.joint == "two")
    svg = str(figure.svg)
    line = line_of(svg, "identified")
    points = np.vstack([points_of(svg, f"sample {way}") for way in ("up", "down")])
    up, down = line[: len(line) // 2], line[len(line) // 2 :][::-1]
    middle, half = 0.5 * (up[:, 1] + down[:, 1]), 0.5 * np.max(np.abs(down[:, 1] - up[:, 1]))
    off = points[:, 1] - np.interp(points[:, 0], up[:, 0], middle)
    assert half > 3.0
    assert np.max(np.abs(off)) < 1.4 * half
    assert np.median(np.abs(off)) > 0.7 * half


def test_comparison_is_a_page_with_its_differences(tmp_path: Path) -> None:
    """The names that a user gives to both runs are text."""
    load, changed = arm_found().load, arm_found().load.values.copy()
    changed[0] += 10 * np.sqrt(2) * load.standard_errors[0]
    other = replace(arm_found(), load=replace(load, values=changed), motions=())
    write_comparison(arm_found(), other, tmp_path / "page.html", names=("<b>cold</b>", "it's warm"))
    page = Page((tmp_path / "page.html").read_text(encoding="utf-8"))
    assert "1 of 28 parameters differ" in page.words
    assert f"{load.names[0]} (+10.0 standard errors)" in page.words
    assert "<b>cold</b>" in page.words
    assert "b" not in page.tags
    with pytest.raises(SeaidError, match=r"'a.pdf' must end in .html"):
        write_comparison(arm_found(), other, "a.pdf")


def test_known_values_are_a_drives_file_and_options_are_facts(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text(known_drives(arm_found()))
    known = read_drives(path)
    assert known == {x: drive.without_nominal() for x, drive in arm_found().known.drives.items()}
    options = {"known_std": {"stiffness": 0.1}, "joints": ["a", "b"]}
    assert facts_of({"options": options}) == {"Known std": "stiffness 0.1", "Joints": "a, b"}


def test_pages_of_little_are_whole_pages_too(tmp_path: Path) -> None:
    found, result = made_up(tmp_path, ("only",))
    page = page_of(tmp_path, found, [result])
    run = json.loads(page.scripts["traces-data"])["runs"][0]
    assert run["actuator"] == [None]
    assert "median error of the torques" in page.words
    found, _ = made_up(tmp_path, ("a", "b"))
    page = page_of(tmp_path, found, [])
    assert "traces-data" not in page.scripts
    assert "logs read in pieces are not kept in memory" in page.words
    found, result = made_up(tmp_path, ("a", "b"))
    nothing = replace(result, load=result.actuator)
    page = page_of(tmp_path, found, [nothing])
    assert "there is no torque to compare" in page.words or "No motion was predicted" in page.words


OTHER = prediction(("other",), 200)
LIST = "validations= must be a Validation or a list of Validations, found "


@pytest.mark.parametrize(
    ("name", "results", "facts", "words"),
    [
        ("page.html", "report", None, f"{LIST}the text"),
        ("page.html", [1], None, f"{LIST}a list with 1"),
        ("page.html", None, None, "must be a Validation or a list of Validations, found None"),
        (
            "page.html",
            [OTHER],
            None,
            "validations=: the joints other, but the identified robot has",
        ),
        ("page.html", [], {"a": [1]}, "found a dict with a list, which must be a name"),
        ("page.html", [], ["a"], "facts= must be a mapping, found"),
        ("report.pdf", [], None, "report.pdf' must end in .html"),
    ],
)
def test_what_makes_no_page_is_refused_before_it_is_written(
    tmp_path: Path, name: str, results: Any, facts: Any, words: str
) -> None:
    """Results, facts and endings; no file is made."""
    with pytest.raises(SeaidError) as refused:
        write_report(arm_found(), tmp_path / name, results, facts=facts)
    assert words in str(refused.value)
    assert not list(tmp_path.iterdir())


def test_unix_times_are_drawn_from_their_first_sample() -> None:
    time = np.linspace(0.0, 20.0, 200)
    assert axis_time(time + 1.75e9) == pytest.approx(time, abs=1e-6)
    assert np.array_equal(axis_time(time + 30.0), time + 30.0)
    figure = traces_figure(time + 1.75e9, {"measured": time}, Axis("torque", "N m"), "t", "")
    svg = str(figure.svg)
    ticks = re.findall(r'text-anchor="middle"[^>]*>([^<]*)</text>', svg)
    assert "·10" not in svg
    assert len(set(ticks)) == len(ticks)
