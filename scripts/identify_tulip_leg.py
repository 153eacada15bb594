"""Identify the TULip leg end to end, in simulation: the paper's experiment, section by section.

A leg with known truth is simulated under an exciting motion, with encoders, torque noise, unknown
encoder offsets and a known test mass on the foot. The identification uses its log and the known
parameters only (geometry, ratios, radii, rotor inertias, test mass). The result is validated on
another motion. Both motions are shipped in `models/`, so that everybody gets the same log;
`--plan-anew` searches for them again. `python scripts/identify_tulip_leg.py --help` lists all
options.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import seaid
from seaid._files import result_folder, write_json
from seaid._progress import track
from seaid.excitation.criteria import pivoted_base
from seaid.report import warning_lines
from seaid.report.text import drive_table, load_table, validation_table

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.torque_figures import save_actuator_figure, save_load_figure

MODELS = Path(__file__).resolve().parents[1] / "models"
PLAN, VALIDATION_PLAN = "tulip_plan.json", "tulip_validation_plan.json"
PROJECT = seaid.load_project(MODELS / "tulip_leg_project.toml")
(TEST_MASS,) = PROJECT.payloads[""]
CAD = "tulip_leg_cad"
"""The leg as a drawing has it: what the report compares the result with."""

LIMITS = seaid.Limits(velocity=2.5, acceleration=10.0)
DURATION_S = 10.0
EVERY_SAMPLE_HZ, CHATTER_HZ = 450.0, 50.0
"""Cutoffs of the raw curves of the figures. The measured one is not filtered; the computed one
needs accelerations, which the steps of the encoders would hide above 50 Hz."""

TABLE_1 = ("viscous_friction", "coulomb_friction", "stiffness")
ENCODER_OFFSET_STD_RAD = PROJECT.options.encoder_offset_std


def load_leg(payloads: tuple[seaid.Payload, ...], name: str = "tulip_leg") -> seaid.Robot:
    """Return the true leg, or that of other files of `models/`."""
    return seaid.load_robot(
        MODELS / f"{name}.urdf", drives=MODELS / f"{name}.toml", payloads=payloads
    )


def sensors(seed: int) -> seaid.Noise:
    """Return the sensors of the leg; a seed gives the same encoder offsets in every run."""
    rng = np.random.default_rng(seed)
    return seaid.Noise(
        motor_resolution_rad=2 * np.pi / 2000,
        joint_resolution_rad=2 * np.pi / 2**14,
        motor_offset_rad=tuple(rng.uniform(-np.pi, np.pi, 5)),
        joint_offset_rad=tuple(rng.normal(0.0, ENCODER_OFFSET_STD_RAD, 5)),
        torque_std_Nm=(0.005, 0.005, 0.005, 0.006, 0.006),
    )


def experiment(
    payloads: tuple[seaid.Payload, ...],
    trajectory: seaid.Trajectory,
    noise: seaid.Noise,
    seed: int,
) -> seaid.Log:
    """Simulate one run of the true leg."""
    return seaid.simulate(load_leg(payloads), trajectory, noise=noise, seed=seed)


def shipped_plan() -> seaid.Trajectory:
    """Return the shipped motion for identification."""
    return seaid.load_trajectory(MODELS / PLAN)


def plan_anew(folder: Path, seed: int) -> None:
    """Search for the motions for identification and validation, and write them to a folder.

    The end of a search depends on rounding, and so on the processor.
    """
    known = load_leg((TEST_MASS,)).without_nominal()
    plan = seaid.design_excitation(known, DURATION_S, limits=LIMITS, seed=seed, progress=True)
    other = seaid.design_excitation(
        known, DURATION_S, basis="polynomial", limits=LIMITS, seed=seed, starts=1, progress=True
    )
    command = f"python scripts/identify_tulip_leg.py --plan-anew --seed {seed}"
    for name, found in ((PLAN, plan), (VALIDATION_PLAN, other)):
        found.trajectory.save(folder / name)
        content = json.loads((folder / name).read_text(encoding="utf-8"))
        write_json(folder / name, {"made_by": command} | content)


def condition_number(robot: seaid.Robot, motion: seaid.Trajectory) -> float:
    """Return (16) of the base columns over a motion."""
    columns = list(pivoted_base(robot).columns)
    states = motion.sample(np.linspace(0.0, motion.duration, 2000))
    rows = seaid.regressor.rigid_body_regressor(robot, *states)[:, :, columns]
    return float(np.linalg.cond(rows.reshape(-1, len(columns))))


def main(output: Path, seed: int, anew: bool) -> None:
    """Plan if requested, simulate, identify, validate, write."""
    begin = time.perf_counter()
    result_folder(output)
    truth = load_leg((TEST_MASS,))
    known = truth.without_nominal()

    if anew:
        plan_anew(output, seed)
    plans = output if anew else MODELS
    plan, other = (seaid.load_trajectory(plans / name) for name in (PLAN, VALIDATION_PLAN))
    runs = [
        ((TEST_MASS,), plan, sensors(seed), seed),
        ((TEST_MASS,), other, sensors(seed), seed + 1),
        ((), plan, sensors(seed), seed + 2),
    ]
    with ProcessPoolExecutor(2) as executor:
        futures = [executor.submit(experiment, *run) for run in runs]
        log, other_log, free_log = (
            future.result() for future in track(futures, "simulating three runs", True)
        )

    in_turn = partial(seaid.identify, method="two-step")  # the paper's
    found = in_turn(
        known, log, feasible=True, encoder_offset_std=ENCODER_OFFSET_STD_RAD, progress=True
    )
    by_polynomial = in_turn(known, other_log, encoder_offset_std=ENCODER_OFFSET_STD_RAD)
    elastic = in_turn(known, log, torque_joints=known.elastic_joints)
    free = in_turn(load_leg(()).without_nominal(), free_log)
    result = seaid.validate(found, other_log)

    condition = condition_number(known, plan)
    print(f"Plans: {plans / PLAN} and {VALIDATION_PLAN}")
    print(f"Excitation: B-spline, condition number {condition:.0f}; validation: (18)")
    print("Friction: viscous and Coulomb, the two terms of the paper (named in the drives file)")
    print(drive_table("Table 1: drives, with the test mass of 2 kg on the foot", found, truth))
    print_table_1(by_polynomial, truth, "polynomial (18)")
    print(f"Condition number of the polynomial: {condition_number(known, other):.0f}")
    print(drive_table("The same with a free foot: the ankle's spring is not loaded", free, truth))
    print_verdict(free)
    print(load_table("Base parameters from all five torques, with the test mass", found, truth))
    print(
        f"From the torques at joints 3-5 alone {len(elastic.load.values)} base parameters are "
        f"identifiable, from all five {len(found.load.values)}."
    )
    print(validation_table(result))
    print_verdict(found)
    facts: dict[str, str | int | float] = {
        "Seed of everything random": seed,
        "Excitation": f"B-spline of {DURATION_S:g} s, condition {condition:.3g}",
        "Validation": f"polynomial of {DURATION_S:g} s, (18)",
        "Offsets of joint encoders known to": f"{ENCODER_OFFSET_STD_RAD:g} rad",
        "Robot and logs": "simulated",
    }
    plan.save_set_points(output / "excitation.csv")
    seaid.write_log(log, output / "identification_log.csv")
    seaid.write_log(other_log, output / "validation_log.csv")
    seaid.write_parameters(found, output / "parameters.json", result)
    raw, chatter = (
        seaid.validate(replace(found, cutoff_hz=cutoff_hz), other_log)
        for cutoff_hz in (EVERY_SAMPLE_HZ, CHATTER_HZ)
    )
    save_actuator_figure(result, output / "actuator_side.png", raw=(raw, chatter))
    save_load_figure(result, output / "load_side.png", raw=(raw, chatter))
    seaid.write_report(
        found, output / "report.html", [result], facts=facts, nominal=load_leg((TEST_MASS,), CAD)
    )
    written = seaid.write_urdf(found, output / "tulip_leg_identified.urdf")
    print("tulip_leg_identified.urdf has the physically consistent bodies nearest to the estimate:")
    for note in written.notes:
        print(f"note: {note}")
    print(f"{time.perf_counter() - begin:.0f} s. Results: {output}/")


def print_table_1(found: seaid.Identification, truth: seaid.Robot, motion: str) -> None:
    """Print the drive parameters of Table 1 as another motion determines them."""
    for joint in truth.elastic_joints:
        for name in TABLE_1:
            value, error = found.drives[joint].value(name), found.drives[joint].standard_error(name)
            true = truth.drives[joint].values[name]
            print(
                f"{motion}, {joint}: {name} = {value:.4g} +- {error:.4g}, "
                f"{100 * (value / true - 1):.2g} % off, error of {100 * error / true:.2g} %"
            )


def print_verdict(found: seaid.Identification) -> None:
    """Print the verdict on an identification, and its warnings."""
    print("\n".join([found.verdict.sentence, *warning_lines(found.warnings)]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out/tulip_leg"), help="result folder")
    parser.add_argument("--seed", type=int, default=0, help="of everything random")
    parser.add_argument(
        "--plan-anew",
        action="store_true",
        help="search for the motions instead of using those of models/, and save them",
    )
    arguments = parser.parse_args()
    warnings.formatwarning = lambda message, *_: f"note: {message}\n"
    try:
        main(arguments.output, arguments.seed, arguments.plan_anew)
    except seaid.SeaidError as error:
        sys.exit(f"error: {error}")
