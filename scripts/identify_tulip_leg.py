"""Identify the TULip leg end to end, in simulation: the paper's experiment, section by section.

A leg with known truth is simulated under an exciting motion, with encoders, torque noise, unknown
encoder zeros and a known test mass on the foot; its log is identified with nothing but what is
known beforehand (geometry, ratios, radii, rotor inertias, test mass); the result is validated on
another motion. `python scripts/identify_tulip_leg.py --help` for the options.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

import seaid
from seaid.files import result_folder
from seaid.progress import track
from seaid.report.figures import save_actuator_figure, save_load_figure
from seaid.report.text import drive_table, load_table, validation_table

MODELS = Path(__file__).resolve().parents[1] / "models"
TEST_MASS = seaid.Payload("foot", 2.0, (0.15, 0.0, 0.0))
LIMITS = seaid.Limits(velocity=2.5, acceleration=10.0)
DURATION_S = 10.0
JOINT_ZERO_STD_RAD = 0.002


def load_leg(payloads: tuple[seaid.Payload, ...]) -> seaid.Robot:
    """Return the true leg."""
    return seaid.load_robot(
        MODELS / "tulip_leg.urdf", drivetrains=MODELS / "tulip_leg.toml", payloads=payloads
    )


def sensors(seed: int) -> seaid.Noise:
    """Return the leg's sensors; the encoder zeros stay what they are from one run to the next."""
    rng = np.random.default_rng(seed)
    return seaid.Noise(
        motor_resolution_rad=2 * np.pi / 2000,
        joint_resolution_rad=2 * np.pi / 2**14,
        motor_zero_rad=tuple(rng.uniform(-np.pi, np.pi, 5)),
        joint_zero_rad=tuple(rng.normal(0.0, JOINT_ZERO_STD_RAD, 5)),
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


def main(output: Path, seed: int) -> None:
    """Plan, simulate, identify, validate, write."""
    begin = time.perf_counter()
    result_folder(output)
    truth = load_leg((TEST_MASS,))
    known = truth.without_nominal()

    plan = seaid.design_excitation(known, DURATION_S, limits=LIMITS, seed=seed, progress=True)
    other = seaid.design_excitation(
        known, DURATION_S, basis="polynomial", limits=LIMITS, seed=seed, starts=1, progress=True
    )
    runs = [
        ((TEST_MASS,), plan.trajectory, sensors(seed), seed),
        ((TEST_MASS,), other.trajectory, sensors(seed), seed + 1),
        ((), plan.trajectory, sensors(seed), seed + 2),
    ]
    with ProcessPoolExecutor(2) as executor:
        futures = [executor.submit(experiment, *run) for run in runs]
        log, other_log, free_log = (
            future.result() for future in track(futures, "simulating three runs", True)
        )

    found = seaid.identify(
        known, log, feasible=True, joint_zero_std=JOINT_ZERO_STD_RAD, progress=True
    )
    elastic = seaid.identify(known, log, rows=known.elastic_joints)
    free = seaid.identify(load_leg(()).without_nominal(), free_log)
    result = seaid.validate(found, other_log)

    print(f"Excitation: B-spline, condition number {plan.condition_number:.0f}; validation: (18)")
    print(drive_table("Table 1: drives, with the test mass of 2 kg on the foot", found, truth))
    print(drive_table("The same with a free foot: the ankle's spring is not loaded", free, truth))
    print_flags(free)
    print(load_table("Base parameters from all five torques, with the test mass", found, truth))
    print(
        f"From the torques at joints 3-5 alone {len(elastic.load.values)} base parameters are "
        f"identifiable, from all five {len(found.load.values)}."
    )
    print(validation_table(result))
    print_flags(found)
    write(output, plan, log, other_log, found, result, seed)
    written = seaid.write_urdf(found, output / "tulip_leg_identified.urdf")
    print("tulip_leg_identified.urdf has the possible bodies nearest to the estimate:")
    for note in written.notes:
        print(f"note: {note}")
    print(f"{time.perf_counter() - begin:.0f} s. Results: {output}/")


def print_flags(found: seaid.Identification) -> None:
    """Print what must not be trusted."""
    for flag in found.flags:
        print(f"! {flag}")


def write(
    output: Path,
    plan: seaid.Excitation,
    log: seaid.Log,
    other_log: seaid.Log,
    found: seaid.Identification,
    result: seaid.Validation,
    seed: int,
) -> None:
    """Write the files of the experiment."""
    plan.trajectory.save_set_points(output / "excitation.csv")
    seaid.write_log(log, output / "identification_log.csv")
    seaid.write_log(other_log, output / "validation_log.csv")
    found.save(output / "parameters.json", result)
    save_actuator_figure(result, output / "actuator_side.png")
    save_load_figure(result, output / "load_side.png")
    facts: dict[str, str | int | float] = {
        "Seed of everything random": seed,
        "Excitation": f"B-spline of {DURATION_S:g} s, condition {plan.condition_number:.3g}",
        "Validation": f"polynomial of {DURATION_S:g} s, (18)",
        "Zeros of joint encoders known to": f"{JOINT_ZERO_STD_RAD:g} rad",
        "Robot and logs": "simulated",
    }
    seaid.write_report(found, [result], output / "report.html", facts=facts)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out/tulip_leg"), help="result folder")
    parser.add_argument("--seed", type=int, default=0, help="of everything random")
    arguments = parser.parse_args()
    warnings.formatwarning = lambda message, *_: f"note: {message}\n"
    try:
        main(arguments.output, arguments.seed)
    except seaid.SeaidError as error:
        sys.exit(f"error: {error}")
