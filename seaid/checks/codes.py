"""The codes of findings, by which they are made: `DELAY.finding(...)`.

What each stands for, what usually causes it, and what to do, is in `codes.toml`. A `Symptom` says
that something is off, and not why; a `Cause` spoils the fit of its joint. `CODES` has them in the
order of the page `docs/warnings.md`, whose table is made from both files
(`python -m scripts.warnings_page`). Each code is given in one place.
"""

from __future__ import annotations

from collections.abc import Mapping

from seaid._arrays import FrozenMapping
from seaid.checks.check import Cause, Code, Symptom

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
