"""Cases of simulated robots: the gauntlet, the TULip leg, other plants, and terms of drives.

Logs that several cases share are simulated once per process: such cases are one batch.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import seaid
from scripts.gauntlet_mistakes import Case as Experiment
from scripts.gauntlet_mistakes import Mistake, Setup, mistakes
from scripts.gauntlet_robots import load, subjects, true_drives, wiggle
from scripts.golden_measured import first_project
from scripts.golden_records import (
    Build,
    Case,
    Records,
    exported,
    folder_of_files,
    number,
    of_build,
    of_estimate,
    of_findings,
    of_identification,
    of_validation,
    text,
)

MODELS = Path(__file__).resolve().parents[1] / "models"


def _identified(setup: Setup) -> tuple[seaid.Identification, list[seaid.Log]]:
    """Load, read and identify what a user hands over."""
    robot = load(setup.urdf, setup.drives, setup.payloads, gravity=setup.gravity)
    logs = []
    with tempfile.TemporaryDirectory() as folder:
        pairs = zip(setup.logs, setup.descriptions, strict=True)
        for place, (columns, description) in enumerate(pairs, 1):
            path = Path(folder) / f"log_{place}.npz"
            np.savez(path, **columns)  # type: ignore[arg-type]
            logs.append(seaid.read_log(path, robot, description=description or None))
    return seaid.identify(robot, logs, **setup.options), logs


def _of_mistake(name: str, mistake: Mistake) -> Records:
    experiment = Experiment(subjects()[name])
    right = experiment.setup(mistake.truth, mistake.logs)
    setup = mistake.change(experiment, right)
    if setup is None:
        return {"this robot": text("cannot have this mistake")}
    return of_identification(_identified(setup)[0], has_load=False)


def _of_right(name: str, seed: int, truth: str, logs: int) -> Records:
    setup = Experiment(subjects()[name], seed).setup(truth, logs, terms=True)
    found, read = _identified(setup)
    return of_identification(found) | of_validation(found, read[0])


RIGHT = (
    *((0, "plain", 1), (1, "plain", 2), (2, "bare", 1)),
    *((0, "cubic20", 1), (0, "dead20", 1), (0, "stribeck100", 1)),
)
"""Right set-ups: seed, true robot, and number of logs."""

MILD_ROBOTS = ("leg", "scara")
"""Robots that have the mild forms of the mistakes too."""

_QUICK = (
    "stiff, right, plain, 1 log, seed 0",
    "stiff, torques in mN m (severe)",
    "stiff, torque constant off by 20 %, or 5 % (severe)",
)


def gauntlet_cases() -> list[Case]:
    """Return the right set-ups and the mistakes of the gauntlet."""
    cases = []
    for name, subject in subjects().items():
        for seed, truth, logs in RIGHT:
            if subject.elastic or not truth.startswith(("cubic", "dead")):
                title = f"{name}, right, {truth}, {logs} log{'s' * (logs > 1)}, seed {seed}"
                records = partial(_of_right, name, seed, truth, logs)
                is_quick = title in _QUICK
                cases.append(Case(title, "right set-ups", records, is_quick, f"{name} right"))
        for mistake in mistakes():
            if mistake.form == "severe" or name in MILD_ROBOTS:
                batch = f"{name} {mistake.truth if mistake.form == 'severe' else 'mild'}"
                cases.append(
                    Case(
                        f"{name}, {mistake.title}",
                        "mistakes",
                        partial(_of_mistake, name, mistake),
                        quick=f"{name}, {mistake.title}" in _QUICK,
                        batch=batch,
                    )
                )
    return cases


@cache
def _leg_log(mass: bool, plan: str, seed: int) -> seaid.Log:
    """Return a log of `make tulip`."""
    from scripts import identify_tulip_leg as script

    payloads = (script.TEST_MASS,) if mass else ()
    trajectory = seaid.load_trajectory(MODELS / plan)
    return script.experiment(payloads, trajectory, script.sensors(0), seed)


def _leg(mass: bool = True) -> seaid.Robot:
    """Return the known leg: without nominal values of the drives."""
    from scripts import identify_tulip_leg as script

    return script.load_leg((script.TEST_MASS,) if mass else ()).without_nominal()


_PLANS = ("tulip_plan.json", "tulip_validation_plan.json")
_OFFSET_STD: dict[str, Any] = {"encoder_offset_std": 0.002}


def _log() -> seaid.Log:
    return _leg_log(True, _PLANS[0], 0)


@cache
def _tulip() -> seaid.Identification:
    return seaid.identify(_leg(), _log(), feasible=True, **_OFFSET_STD)


def _tulip_records() -> Records:
    return of_identification(_tulip()) | of_validation(_tulip(), _leg_log(True, _PLANS[1], 1))


def _free_foot() -> seaid.Identification:
    return seaid.identify(_leg(False), _leg_log(False, _PLANS[0], 2))


def _leg_with(**options: Any) -> Records:
    return of_identification(seaid.identify(_leg(), _log(), **options))


def _springs_torques() -> seaid.Identification:
    return seaid.identify(_leg(), _log(), torque_joints=_leg().elastic_joints)


def _two_conditions(specific: tuple[str, ...]) -> Records:
    """Identify the leg with its bare foot and with the test mass together."""
    found = seaid.identify_conditions(
        {"bare": (_leg(False), _leg_log(False, _PLANS[0], 2)), "loaded": (_leg(), _log())},
        condition_specific=specific,
        **_OFFSET_STD,
    )
    records: Records = {}
    for name, identification in found.identifications.items():
        parts = of_identification(identification, has_load=name == "loaded")
        records |= {f"{name}: {key}": record for key, record in parts.items()}
    for name, test in found.differences.items():
        records[f"{name} differs"] = text(test.bic > 0)
    return records


def _checked() -> Records:
    found = seaid.check(_leg(), _log())
    records = of_findings(found.warnings)
    for joint, check in found.joints.items():
        records[f"{joint} gear_ratio"] = ["value", check.gear_ratio, check.gear_ratio_error]
        records[f"{joint} delay_s"] = ["value", check.delay_s, check.delay_error_s]
    return records


def _terms() -> Records:
    found = seaid.compare_terms(_leg(), _log(), terms={"friction": ["stribeck", "quadratic"]})
    records = {f"recommended for {x}": text(terms) for x, terms in found.recommended.items()}
    for one in found.comparisons:
        name = f"{one.joint} {one.term}, step {one.step}"
        records[f"{name}, supported"] = text(one.is_supported)
        records |= {f"{name}, {x}": number(value) for x, value in one.values.items()}
        if one.comparison is not None:
            records[f"{name}, explained"] = number(one.comparison.explained)
    return records


_METHODS: dict[str, dict[str, Any]] = {
    "simultaneous": {"method": "simultaneous", **_OFFSET_STD},
    "ols": {"estimator": "ols"},
    "huber": {"estimator": "huber"},
    "tukey": {"estimator": "tukey"},
    "iv": {"estimator": "iv"},
    "known constants": {"known_std": {"torque": 0.02, "payload": 0.01, "gear_ratio": 0.001}},
    "cutoff of 4 Hz": {"cutoff_hz": 4.0},
}


def leg_cases() -> list[Case]:
    """Return the cases of the logs of `make tulip`, with all that shares them."""
    tulip = partial(Case, group="TULip", batch="leg")
    methods = partial(Case, group="methods", batch="leg")
    conditions = partial(Case, group="conditions", batch="leg")
    return [
        tulip(name="make tulip", records=_tulip_records),
        tulip(
            name="torques of the springs", records=partial(of_build, _springs_torques), quick=True
        ),
        tulip(name="free foot", records=partial(of_build, _free_foot)),
        *(
            methods(name=x, records=partial(_leg_with, **y), quick=x == "ols")
            for x, y in _METHODS.items()
        ),
        methods(name="refined", records=partial(of_build, _refined)),
        methods(name="check", records=_checked),
        methods(name="terms", records=_terms),
        conditions(name="shared friction", records=partial(_two_conditions, ("spring_offset",))),
        conditions(
            name="friction of each",
            records=partial(_two_conditions, ("spring_offset", "viscous_friction")),
        ),
        *(
            Case(f"init, leg, {x}", "init", partial(_first_leg, x), batch="leg")
            for x in ("standard", "with units", "numbered")
        ),
        Case("TULip leg, files", "exports", partial(exported, _tulip), batch="leg"),
    ]


def _refined() -> seaid.Identification:
    return seaid.refine(_tulip(), _log(), **_OFFSET_STD)


_COLUMNS: dict[str, Callable[[str, int], dict[str, str]]] = {
    "with units": lambda joint, k: {
        "motor_position": f"{joint}_motor_rad",
        "joint_position": f"{joint}_enc_deg",
        "motor_torque": f"{joint}_torque_mNm",
    },
    "numbered": lambda joint, k: {
        "motor_position": f"theta[{k}]",
        "joint_position": f"q[{k}]",
        "motor_torque": f"tau[{k}]",
    },
}


def _first_leg(header: str) -> Records:
    """Write a first project for logs of the leg with the names of another program."""
    log, urdf = _log(), MODELS / "tulip_leg.urdf"
    with folder_of_files() as folder:
        if header == "standard":
            for place, plan in enumerate(_PLANS):
                seaid.write_log(_leg_log(True, plan, place), folder / f"log_{place}.csv")
            files = [folder / "log_0.csv", folder / "log_1.csv"]
            return first_project(urdf, files)
        columns: dict[str, Any] = {"time": log.time}
        scales = {"joint_position": 180 / np.pi, "motor_torque": 1e3}
        for k, joint in enumerate(log.joint_names):
            for field, name in _COLUMNS[header](joint, k).items():
                scale = scales.get(field, 1.0) if header == "with units" else 1.0
                columns[name] = scale * getattr(log, field)[:, k]
        table = np.column_stack(list(columns.values()))
        np.savetxt(folder / "log.csv", table, "%.12g", ",", header=",".join(columns), comments="")
        return first_project(urdf, [folder / "log.csv"], "tulip_leg.toml")


@cache
def stiff_arm() -> seaid.Identification:
    """Return a stiff arm as identified."""
    setup = Experiment(subjects()["stiff"]).setup()
    robot = lasting_robot(setup, "stiff")
    with folder_of_files() as folder:
        np.savez(folder / "log.npz", **setup.logs[0])  # type: ignore[arg-type]
        log = seaid.read_log(folder / "log.npz", robot)
    return seaid.identify(robot, log, feasible=True)


def _philips(drives: str) -> Records:
    from scripts import identify_philips_arm as script

    truth = script.load_arm(drives, (-9.81, 0.0, 0.0))
    logs = [
        seaid.simulate(truth, wiggle(truth, 0.6, seed), noise=script.sensors(truth), seed=seed)
        for seed in range(2)
    ]
    found = seaid.identify(truth.without_nominal(), logs[0])
    return of_identification(found) | of_validation(found, logs[1])


BIPED_S = 8.0
"""Duration of the motions of the biped."""


def _biped(stands: bool) -> Records:
    from scripts import identify_biped as script

    with folder_of_files() as folder:
        urdf, drives = script.write_biped(folder)
        if stands:
            robot = seaid.load_robot(urdf, drives, base="floating", contacts=script.FEET)
            plan = script.standing_plan(robot, BIPED_S, 1)
        else:
            robot, plan = seaid.load_robot(urdf, drives), script.hanging_plan(BIPED_S, 0)
        log = script.simulate(robot, script.plant(urdf, robot, not stands), plan, int(stands))
        return of_identification(seaid.identify(robot.without_nominal(), log))


def _motor_side(name: str, feasible: bool = False) -> Records:
    from scripts.benchmarks.motor_side import JOINTS, robot_of, simulated

    joint = JOINTS[name]
    with folder_of_files() as folder:
        return of_identification(seaid.identify(robot_of(joint, folder), simulated(joint)))


def _frequency(name: str, periodic: bool = True) -> Records:
    from scripts.benchmarks.frequency import COULOMB, DRIVES, STEP_RAD, TORQUE_STD
    from tests.linear_plant import multisine_torque

    plant, size = DRIVES[name]
    top_hz = 2.0 * plant.modes[0]
    torque = multisine_torque(size, period_s=5.0, periods=2, top_hz=top_hz, seed=0, left_out=4)
    log = plant.log(torque, coulomb=COULOMB * size, torque_std=TORQUE_STD * size, seed=0)
    log = replace(log, motor_position=np.round(log.motor_position / STEP_RAD) * STEP_RAD)
    with folder_of_files() as folder:
        robot = plant.robot(folder, nominal=False)
        drive = replace(robot.drives["arm"], friction=("viscous", "coulomb"))
        robot = robot.with_drives({"arm": drive})
        found = seaid.frequency_response(robot, log, period_s=5.0 if periodic else None)
    records = of_findings(found.warnings)
    for joint, estimate in found.drives.items():
        records |= of_estimate(joint, estimate)
    for place in np.linspace(0, len(found.frequency_hz) - 1, 8).astype(int):
        hz, response = found.frequency_hz[place], found.response[place, 0, 0]
        records[f"response at {hz:.4g} Hz"] = number(abs(response))
        records[f"coherence at {hz:.4g} Hz"] = number(found.coherence[place, 0])
    return records


def _calibrated(law: str) -> Records:
    """Calibrate a spring of dead weights, or by a slow ramp with friction."""
    rng = np.random.default_rng(0)
    if law == "linear":
        load = np.linspace(-14.7, 14.7, 18)
        reading = load / 159.8 + 0.01 + 0.077 / 159.8 * rng.normal(size=len(load))
    else:
        up = np.linspace(-15.0, 15.0, 300)
        load = np.concatenate([up, up[-2::-1]])
        direction = np.repeat([1.0, -1.0], [300, 299])
        d = np.linspace(-0.16, 0.16, 20_001)
        reading = np.interp(load - 0.3 * direction, 150.0 * d + 2000.0 * d**3, d) + 0.02
        reading = reading + 5e-4 * rng.normal(size=len(load))
    statics = seaid.identification.Statics(load, reading)
    found = seaid.identification.calibrate_statics(statics, law=law)  # type: ignore[arg-type]
    estimate = found.estimate
    rows = zip(estimate.names, estimate.values, estimate.standard_errors, strict=True)
    records = {name: ["value", float(x), float(s)] for name, x, s in rows}
    parts = {x: number(getattr(found, x)) for x in ("linearity", "hysteresis")}
    parts["rms"] = number(estimate.residual_std)
    return records | parts | of_findings(found.warnings)


def plant_cases() -> list[Case]:
    """Return the cases of the biped, the Philips arm, and of plants of one joint."""
    frequency = ("ANYdrive-like", "CENTAURO-like", "TULip-like")
    motor_side = ("TULip-like knee", "ANYdrive-like", "CENTAURO-like")
    return [
        Case("biped, standing", "biped", partial(_biped, True)),
        Case("biped, hanging", "biped", partial(_biped, False)),
        Case("Philips arm, elastic", "Philips", partial(_philips, "philips_arm_elastic.toml")),
        Case("Philips arm, stiff", "Philips", partial(_philips, "philips_arm.toml")),
        *(Case(f"motor side, {x}", "motor side", partial(_motor_side, x)) for x in motor_side),
        *(
            Case(f"frequency, {x}", "frequency", partial(_frequency, x), x == "ANYdrive-like")
            for x in frequency
        ),
        Case("frequency, not periodic", "frequency", partial(_frequency, frequency[0], False)),
        Case("dead weights", "calibration", partial(_calibrated, "linear"), True),
        Case("slow ramp", "calibration", partial(_calibrated, "cubic"), True),
    ]


_STORE = tempfile.TemporaryDirectory()
"""A folder of this process: exported files need the URDF from which a robot was loaded."""


def lasting_robot(
    setup: Setup | None = None,
    name: str = "leg",
    changed: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> seaid.Robot:
    """Return the robot of a set-up, or the true one, with other drives {joint: keys}."""
    subject = subjects()[name]
    path = Path(_STORE.name) / f"{name}{'' if setup is None else '_nominal'}.urdf"
    path.write_text(subject.urdf if setup is None else setup.urdf, "utf-8")
    given = (subject if setup is None else setup).drives or {}
    drives = {joint: {**table, **changed.get(joint, {})} for joint, table in given.items()}
    link, mass, place = subject.payload.split(":")
    x, y, z = map(float, place.split(","))
    payload = seaid.Payload(link, float(mass), (x, y, z))
    return seaid.load_robot(path, drives, payloads=[payload])


@cache
def _simulated_leg(joint: str, *changed: tuple[str, Any]) -> seaid.Log:
    """Return a log of the leg with another drive at a joint."""
    truth = lasting_robot(changed={joint: dict(changed)})
    noise = seaid.Noise(
        motor_resolution_rad=2 * np.pi / 2000,
        joint_resolution_rad=2 * np.pi / 2**14,
        torque_std_Nm=0.005,
    )
    return seaid.simulate(truth, wiggle(truth, 0.8, 0), noise=noise, seed=1)


_QUADRATIC = (
    ("friction", ("viscous", "coulomb", "quadratic")),
    ("quadratic_friction_Nms2_per_rad2", 3e-7),
)
_CUBIC = ("spring", ("linear", "cubic"))


def _quadratic(declared: bool) -> seaid.Identification:
    """Identify quadratic friction of a hip, with a drive that has it or not."""
    log = _simulated_leg("hip_pitch", *_QUADRATIC)
    robot = lasting_robot(changed={"hip_pitch": dict(_QUADRATIC[:1])} if declared else {})
    return seaid.identify(robot.without_nominal(), log)


def _quadratic_free_foot() -> seaid.Identification:
    """Identify the leg with a free foot, without the quadratic friction that its hip has."""
    from scripts import identify_tulip_leg as script

    drives = {joint: dict(table) for joint, table in subjects()["leg"].drives.items()}
    drives["hip_pitch"] |= dict(_QUADRATIC)
    truth = seaid.load_robot(MODELS / "tulip_leg.urdf", drives)
    plan = seaid.load_trajectory(MODELS / _PLANS[0])
    log = seaid.simulate(truth, plan, noise=script.sensors(0), seed=0)
    return seaid.identify(_leg(False), log, **_OFFSET_STD)


@cache
def _cubic() -> seaid.Identification:
    """Identify a cubic spring whose coefficient has no nominal value."""
    key, joint = "cubic_stiffness_N_per_m3", "knee_pitch"
    value = true_drives(subjects()["leg"], "cubic20")[joint][key]
    log = _simulated_leg(joint, _CUBIC, (key, value))
    return seaid.identify(lasting_robot(changed={"knee_pitch": dict([_CUBIC])}), log, feasible=True)


def _printed(build: Build) -> Records:
    """Return the nominal values in the table of drives that is printed."""
    found = build()
    lines = str(seaid.report.short_text(found, found.nominal or found.known)).splitlines()
    rows = [re.split(r"\s{2,}", line.strip()) for line in lines]
    heads = [row for row in rows if "nominal" in row and "parameter" in row]
    if not heads:
        return {"nominal values": text("none")}
    size, place = len(heads[0]), heads[0].index("nominal")
    records: Records = {}
    joint = ""
    for row in rows[rows.index(heads[0]) + 1 :]:
        joint = row[0] if row[0] in found.known.joint_names else joint
        if len(row) >= size - 1 and joint:
            name = row[1] if row[0] == joint else row[0]
            records[f"nominal {name} of {joint}"] = text(row[place - size])
    return records


def _coulomb() -> seaid.Identification:
    """Identify Coulomb friction by drives that have it: it has no width."""
    return seaid.identify(lasting_robot().without_nominal(), _simulated_leg("hip_pitch"))


def term_cases() -> list[Case]:
    """Return the cases of drives with other terms than the robot's."""
    quadratic, cubic, coulomb = (
        partial(Case, group="terms", batch=f"terms {x}") for x in ("quadratic", "cubic", "coulomb")
    )
    return [
        quadratic(name="quadratic friction", records=partial(of_build, partial(_quadratic, True))),
        quadratic(
            name="quadratic friction, missing",
            records=partial(of_build, partial(_quadratic, False)),
        ),
        quadratic(
            name="quadratic friction, missing, free foot",
            records=partial(of_build, _quadratic_free_foot),
        ),
        cubic(name="cubic spring", records=partial(of_build, _cubic)),
        cubic(name="cubic spring, table", records=partial(_printed, _cubic)),
        cubic(name="cubic spring, files", records=partial(exported, _cubic)),
        coulomb(name="Coulomb friction", records=partial(of_build, _coulomb)),
    ]
