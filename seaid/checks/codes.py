"""The codes of findings: what each stands for, what usually causes it, and what to do.

`CODES` has them in the order of the page `docs/warnings.md`, whose table is made from them
(`python -m scripts.warnings_page`). A finding is made by its code, `DELAY.finding(...)`, and each
code is given in one place.
"""

from __future__ import annotations

from collections.abc import Mapping

from seaid._arrays import FrozenMapping
from seaid.checks.check import Cause, Code, Symptom

UNIT = Cause(
    "unit",
    "a channel in another unit than its column says",
    "Degrees, turns, encoder counts or grams where the header says SI; a scale in the description "
    "that is already in the file; a torque in per cent or per mille of the rating of a motor, or "
    "the duty cycle of a servo.",
    "Apply the `scale` or the unit of the remedy to the channel in the description of the log.",
)
TIME_UNIT = Cause(
    "time-unit",
    "the time in another unit than seconds",
    "Milliseconds or microseconds in a column `time_s`, or a counter instead of a clock.",
    "Set the unit of the time in the description, or the rate if the column is a counter.",
)
WRAPS = Cause(
    "wraps",
    "a position or a torque that jumps by the whole range of its sensor while it moves on",
    "An encoder that counts within one turn, in a log that nothing unwraps: one that has a "
    "description, or is read with `--repair`, is unwrapped. Or a signed integer of 16 bits that "
    "was read without its sign, so that -1 is 65535.",
    "Give the `wraps` of the remedy in the description of the log. It does not say in which turn a "
    "log begins: a joint that has the encoder of its motor only needs an `offset` too.",
)
SIGN = Cause(
    "sign",
    "a channel, or a whole joint, with the opposite sign",
    "An encoder mounted on the other side, a motor that turns against its joint, or a torque "
    "defined at the load.",
    "Change the sign of the channels that the remedy names; if both sides of a joint are "
    "reversed, correct the axis in the URDF.",
)
ENCODER_OFFSET = Cause(
    "encoder-offset",
    "a joint whose zero is not that of the robot file",
    "A servo that was calibrated in the middle of its range, or mounted one tooth off.",
    "Write the `offset` of the remedy into the description of the log, for position and command.",
)
SWAPPED_JOINTS = Cause(
    "swapped-joints",
    "the channels of joints, or of legs, exchanged",
    "Two cables exchanged, or columns in the order of the bus instead of the order of the joints.",
    "Exchange the two entries in the description.",
)
GEAR_RATIO = Cause(
    "gear-ratio",
    "a gear ratio that the two encoders contradict",
    "The ratio of another variant, the inverse ratio, or a belt stage that was forgotten.",
    "Write the ratio of the remedy into the drives file. It follows from the two encoders alone.",
)
VARYING_RATIO = Cause(
    "varying-ratio",
    "a transmission whose ratio depends on the angle of the joint",
    "A four-bar linkage, a lever or a spindle between motor and joint.",
    "Convert angle and torque of the motor to the joint by the geometry of the linkage before the "
    "log is read.",
)
COUPLED_JOINTS = Cause(
    "coupled-joints",
    "a motor that moves with another joint than its own",
    "A differential, a tendon or a parallel linkage that the drives file does not have; an encoder "
    "that measures the absolute angle of a link.",
    "Write the `transmission` of the remedy into the drives file, or give the angle against the "
    "link before.",
)
MISSING_DRIVES = Cause(
    "missing-drives",
    "motor channels in the log without drives for them",
    "A log with motor channels was identified without `--drives`.",
    "Give a drives file. The remedy has a table for each joint.",
)
PAYLOAD = Code(
    "payload",
    "a payload that is absent, or differs from the one given",
    "The test mass or the gripper is on the robot and not in the command, or the reverse; or its "
    "lever arm is wrong.",
    "Weigh it, measure its place, and give the `--payload` of the remedy.",
)
GRAVITY = Cause(
    "gravity",
    "another direction of gravity than the one given",
    "The robot hangs, lies or stands on a slope, and the URDF is upright.",
    "Give the `--gravity` of the remedy.",
)
NOMINAL_VALUES = Code(
    "nominal-values",
    "values of the robot file that the motion contradicts",
    "Masses in grams or pounds, or inertias of another unit in the URDF. The estimate does not "
    "use them.",
    "Nothing to do for the estimate; correct the URDF before simulation and before `feasible`.",
)
GEOMETRY = Cause(
    "geometry",
    "a length of the robot file that the motion contradicts",
    "A link length of another variant of the robot; of a floating base, soft feet, or points in "
    "place of balls.",
    "Measure the length; the remedy has the factor for the `origin` of the joint in the URDF, or "
    "the radius of the feet.",
)
DELAY = Cause(
    "delay",
    "a channel that is late or early",
    "Torque and position come from different buses or clocks, one of them is filtered by the "
    "firmware, or a torque is held over several samples of the log: over n samples it is (n - 1) "
    "/ 2 samples late. As a note the motion does not decide whether the motor gets held torques, "
    "which are not late.",
    "Give the `delay_s` of the remedy in the description, and log both channels on one clock next "
    "time.",
)
COMMAND_DELAY = Code(
    "command-delay",
    "a delay of commands that the log does not separate from the rotor inertia",
    "One gain set and slow motion, or a model that leaves more unexplained than the delay changes.",
    "Add a log with other gains to `identify_conditions`, or give the delay.",
)
CONTACT_FLAGS = Code(
    "contact-flags",
    "flags of contacts that the motion of the feet contradicts",
    "Exchanged columns or a delay of all flags (both proposed as TOML), a threshold; a foot that "
    "rests for much of the time in which it is said to be in the air; a foot that slips is a "
    "note, since its force is unknown anyway.",
    "Correct the flags, or exclude these times.",
)
BASE_FRAMES = Code(
    "base-frames",
    "orientation, angular velocity and gravity of a base that contradict each other",
    "xyzw for wxyz, the frame of the world for that of the base, degrees, an accelerometer with "
    "the opposite sign.",
    "Name order, frame and scale in `[base]` of the description.",
)
BASE_SENSOR = Code(
    "base-sensor",
    "an axis of an IMU that is missing",
    "A column of zeros.",
    "Log it, or give a pose.",
)
SOFT_FEET = Code(
    "soft-feet",
    "feet or legs that give way under their load",
    "Rubber feet, a soft floor, joints that give way behind their encoders: the heights of the "
    "standing feet follow the load.",
    "Hard ground, harder feet, or the radius of the feet under their mean load.",
)
BASE_BIAS = Code(
    "base-bias",
    "a bias of an accelerometer",
    "An IMU that was not calibrated; the bias was identified with the bodies and subtracted, and "
    "their standard errors contain its error.",
    "Calibrate it in several orientations, or let the base tilt more.",
)
SENSOR_ZERO = Code(
    "sensor-zero",
    "a zero of a force sensor that is off",
    "Force sensors that drift, or were not set to zero; the zeros were identified with the bodies "
    "and subtracted, and their standard errors contain those of the zeros. Axes that the log does "
    "not determine are named: a foot that always stands and does not tilt hides its zero in the "
    "mass.",
    "Set the sensors to zero with the feet in the air, or lift each foot for some seconds.",
)
NO_TORQUE = Code(
    "no-torque",
    "joints of a floating base without a torque in the log",
    "A channel that was not recorded, or whose name is not that of a torque; the equations of "
    "these joints are not used.",
    "Describe the torque of these joints; with measured wrenches the base alone determines all "
    "parameters of the bodies.",
)
TOTAL_MASS = Code(
    "total-mass",
    "a total mass that is negative, or far from that of the robot file",
    "Force sensors, or torques, with the opposite sign or in another unit (kgf); a force that is "
    "not in the log.",
    "The remedy has the sign for the description of the log; compare the force of the robot at "
    "rest with its weight.",
)
BASE_JUMPS = Code(
    "base-jumps",
    "jumps of the pose of a base",
    "A state estimator that corrects itself; the jumps were taken out.",
    "Log the IMU.",
)
ROTOR_INERTIA = Cause(
    "rotor-inertia",
    "a rotor inertia that the motion contradicts",
    "The data sheet has g cm², or the inertia of gear head and brake is missing.",
    "Write the value of the remedy into the drives file, or remove the key to have it identified.",
)
TORQUE_SCALE = Cause(
    "torque-scale",
    "a factor on the torques of a joint, such as a wrong torque constant",
    "A torque constant of another winding, current as rms instead of amplitude, or torque at the "
    "output of the gear.",
    "Apply the scale of the remedy. A weighed mass on the last link confirms it independently.",
)
GAIN_SCALE = Code(
    "gain-scale",
    "gains in units of the drive: not declared, or a scale that nothing determines",
    "Gains in counts, 1/256 or per degree that count as N m/rad: the torque of the controller is "
    "less than half or more than twice that which moves and holds the bodies of the robot file, "
    "or beyond its limit in most samples. Or `is_up_to_scale = true` with neither known bodies "
    "nor another payload.",
    "Write the gains in N m/rad, or `is_up_to_scale = true` with known bodies. Nothing known: use "
    "ratios, delays and replays only, or give bodies, a second payload or `gain_scale`.",
)
UNUSED_COMMAND = Code(
    "unused-command",
    "velocity commands for which the controller of a drive has no gain",
    "The drive controls velocity errors, and its table says that it damps the measured velocity "
    "only.",
    "Give `command_velocity_gain_Nms_per_rad`, as the remedy has it, or leave the column out if "
    "the drive does not get it.",
)
NO_MEASUREMENT = Cause(
    "no-measurement",
    "a torque without sign, or computed from the tracking error",
    "Servos report absolute currents, and drivers the output of their own position controller, as "
    '"torque".',
    "Use the position commands with the drive table of the remedy, or log the current with its "
    "sign.",
)
TORQUE_OFFSET = Symptom(
    "torque-offset",
    "a constant error of a torque",
    "The current sensor was not zeroed.",
    "Set the zero of the torque or current sensor while the motor is off.",
)
ENCODER_OFFSETS_DIFFER = Cause(
    "encoder-offsets-differ",
    "encoder offsets that differ between the logs",
    "Incremental encoders were homed anew between two logs.",
    "Give the `offset` of the remedy for the second log, or record all logs without switching off.",
)
WEAK_SPRING = Symptom(
    "weak-spring",
    "a spring that the motion hardly loads, or whose deflection is mostly noise",
    "The motion hardly loads this spring, or the encoders are too coarse for so stiff a spring; "
    "or the gear has play in place of a spring (`backlash`).",
    "Attach a known mass to the link behind it, or use better encoders; see [design of the "
    "experiment](experiment_design.md).",
)
BACKLASH = Cause(
    "backlash",
    "a gear or spring with backlash, which looks like a weak spring",
    "Worn teeth, loose keys, or a spring that does not touch at rest.",
    "Add the `dead_zone` of the remedy to the drives file: the stiffness is then that of the "
    "contact.",
)
NONLINEAR_SPRING = Cause(
    "nonlinear-spring",
    "a spring that is not linear",
    "A hardening spring, rubber, or a stop that is reached.",
    "Add the term of the remedy to the drives file.",
)
GEAR_COMPLIANCE = Code(
    "gear-compliance",
    "a stiffness that includes the gear between the encoders",
    "Both encoders see spring and gear in series.",
    "Give `gear_stiffness_Nm_per_rad`, or log the deflection as a third channel. The stiffness "
    "between the encoders is right for control from them.",
)
TRANSMISSION_ERROR = Cause(
    "transmission-error",
    "an error of the gear that is periodic in its angles",
    "Eccentric gears, harmonic drives, ripple of the motor, or a magnet of an encoder that is off "
    "its axis.",
    "Add the orders of the remedy to the drives file.",
)
REFERENCE_POSITION = Code(
    "reference-position",
    "a reference position of friction that the motion does not reach",
    "`coulomb_position` was added by hand without `reference_position_rad`, which is 0 then.",
    "Add the line of the remedy: the middle of the motion.",
)
LOOSE_ENCODER = Cause(
    "loose-encoder",
    "play or hysteresis between the encoders of a spring joint",
    "A coupling or set screw that slips, backlash between the encoders, or hysteresis of the "
    "spring. Coulomb friction then comes out negative.",
    "Tighten it and repeat. A fit cannot repair it.",
)
MISSING_TERM = Cause(
    "missing-term",
    "a term of friction that the data support and the drive lacks",
    "Stribeck friction, friction that grows with the load, friction that depends on the direction.",
    "Add the term of the remedy to the drives file and identify again.",
)
NEEDLESS_TERM = Code(
    "needless-term",
    "a term of a drive that is not distinguishable from zero",
    "A term in the drives file that this robot does not have, or that the motion does not excite.",
    "Remove it; the other standard errors decrease.",
)
DRIFT = Symptom(
    "drift",
    "a slow change of a sensor or of the friction",
    "Drives, amplifiers or a torque sensor that warm up. Noise of the joint encoders biases least "
    "squares and looks the same.",
    "Warm up and zero the torque or current sensor before the log, and move faster or longer. If "
    "the encoders are noisy, compare with `--estimator iv`.",
)
NO_FIT = Symptom(
    "no-fit",
    "a joint whose torque the model does not explain",
    "A sign, unit or offset of this joint that no hypothesis could name; a cable or a stop that "
    "pulls; contact. If half or more of the torque is unexplained and not all of it (doubtful): a "
    "spring, a gear ratio or a rotor inertia that the drives file lacks.",
    "Look at the joint's trace in the report. Exclude its torque with `--torque-joints` if the "
    "other joints are needed at once.",
)
UNSEEN_MOTION = Code(
    "unseen-motion",
    "a torque or a force that the model does not predict in another motion",
    "Another payload, mounting or encoder zero than in the own logs, exchanged columns of one "
    "log, or too short an own log.",
    "Check that payload, mounting, zeros of the sensors and columns of both logs are the same, and "
    "that nothing else touched the robot. If so, identify from both, and validate on a third.",
)
CONTACT_FORCES = Code(
    "contact-forces",
    "a foot whose predicted force is not that measured, or pulls at the ground",
    "Sign, unit, frame or zero of a force sensor; or a foot that is flagged as standing and "
    "hangs, and a hand that holds the robot.",
    "Force sensors have the force of the ground on the link, in the frame of the link. Check the "
    "flag of the foot.",
)
NOT_REPLAYED = Code(
    "not-replayed",
    "a joint without a usable model, which a replay moves as measured",
    "Its torque was not used, it stands still in all logs, or its rotor inertia was estimated as "
    "negative.",
    "The errors are those of the other joints. Repair what the warnings of this joint name.",
)
REPLAY_WORSE = Code(
    "replay-worse",
    "a joint that the identified model replays worse than the nominal one",
    "Gains, delay or torque limit of the controller are not those of the log, or it is of another "
    "robot. Torques in open loop drift apart: there it says less.",
    "Correct the controller in the drives file, identify again, and replay a log that was not "
    "used.",
)
POORLY_IDENTIFIED = Code(
    "poorly-identified",
    "a parameter with a large standard error",
    "The motion moves the parameter too little, or its effect is nearly that of another parameter.",
    "Use the value with its interval, or plan a motion with `seaid excite --criterion "
    "relative_error`.",
)
UNIDENTIFIABLE = Code(
    "unidentifiable",
    "a parameter that this motion cannot identify",
    "The parameter has no effect in this motion, for example a Stribeck velocity without slow "
    "motion, or the mass at a foot that is hardly lifted. It is a note, and a doubt for a dead "
    "zone whose spring is loaded in one direction only: its half width and its zero are then "
    "arbitrary, except for one end.",
    "Excite it, or remove its term; for a dead zone load the spring in both directions.",
)
NEGATIVE_PARAMETER = Symptom(
    "negative-parameter",
    "a parameter with the wrong sign",
    "A wrong sign, an offset or a delay; a rotor inertia is negative too where the bodies of the "
    "robot file, which count as known, contain those of the rotors or are too heavy. Small values "
    "are often not distinguishable from zero.",
    "Repair the warnings above it first, then do what the remedy says.",
)
INCONSISTENT_INERTIA = Symptom(
    "inconsistent-inertia",
    "base parameters that no physically consistent bodies have",
    "A payload, a length, an axis or an encoder offset that is not as in the files.",
    "Check these; `--feasible` gives the nearest consistent bodies and does not repair the cause.",
)
WEAK_INSTRUMENTS = Symptom(
    "weak-instruments",
    "instruments that are hardly correlated with their columns",
    "The simulated motion that serves as instrument differs much from the measured one.",
    "Use the ordinary estimate, or improve the model until the simulation follows the log.",
)
FEW_ROWS = Symptom(
    "few-rows",
    "too few independent rows for reliable intervals",
    "The log is too short for so many parameters.",
    "Record a longer motion, several motions, or remove terms.",
)
HOMOGENEOUS = Code(
    "homogeneous",
    "an equation without a known torque, which a zero solution fits",
    "A joint whose torque is not measured, or hardly more than noise, is among the equations.",
    "Exclude it with `--torque-joints`, or lower the cutoff as the remedy says.",
)
ESTIMATOR_DISAGREES = Symptom(
    "estimator-disagrees",
    "an estimate that another estimator contradicts",
    "Noisy encoders, or an effect that the model of one joint lacks.",
    "Halve the cutoff if the encoders are noisy; with position commands raise it if joints stick "
    "at their reversals; otherwise look at the residuals in the report for a missing term.",
)
BLOCKS_DISAGREE = Symptom(
    "blocks-disagree",
    "estimates from parts of the data that differ by more than their errors",
    "Something changed between or during the logs: offsets, payload, temperature.",
    "Look for what changed between or during the logs: encoder offsets, payload, temperature, a "
    "drifting sensor. Identify the logs one by one, and compare the results with `seaid compare`.",
)
CUTOFF_SENSITIVE = Symptom(
    "cutoff-sensitive",
    "an estimate that depends on the cutoff",
    "Noise of the encoders biases inertias and stiffness at a high cutoff; friction lacks its "
    "reversals at a low one, and with position commands the friction at rest biases the delay.",
    "Give the `--cutoff-hz` of the remedy, and compare others with `seaid.cutoff_sensitivity`.",
)
WORSE_THAN_START = Code(
    "worse-than-start",
    "a search that ended with a worse prediction than its start",
    "`refine` simulates the joints and so accumulates effects that the model lacks; with commands "
    "also a search that stops far from an optimum, where friction holds joints at their "
    "reversals.",
    "Use the result of `identify` and look for missing terms.",
)
MOTOR_SIDE = Code(
    "motor-side",
    "springs and loads from motor angle and torque alone",
    "The log has nothing behind the springs of these joints; k is that of gear, spring and link "
    "in series. It is a note, with the part of k that an elastic link may take away unseen. As a "
    "doubt it says that more than half of the torque on that spring is not explained, so that its "
    "intervals may be too short; that the spring has damping which its drive lacks; or that the "
    "stiffness falls with the frequency: something behind the spring is elastic too.",
    "Nothing for the note: it names the method. For the doubts load the spring more or log the "
    "joint position, give the spring `damping`, or take k as that of spring and link in series.",
)
HIDDEN_RESONANCE = Code(
    "hidden-resonance",
    "a spring that the motor torque hardly shows",
    "The antiresonance of the joint is above the motion's band, above the log's rate, or below "
    "the noise.",
    "Log faster, excite up to the frequency or with the amplitude of the remedy, or log the joint "
    "position.",
)
WRONG_MINIMUM = Code(
    "wrong-minimum",
    "springs of coupled joints whose errors follow the motor angles",
    "The search of `frequency_response` may have ended in a wrong minimum, or links or gears are "
    "elastic too.",
    "Give nominal stiffnesses in the drives file, or as many logs as joints move.",
)
NOTHING_TO_SIMULATE = Code(
    "nothing-to-simulate",
    "a log without springs, which `refine` cannot improve",
    "`refine` was called for a robot without springs.",
    "Use `identify`, with `--estimator iv` against noise of the encoders.",
)
CONTACT = Cause(
    "contact",
    "bursts of torque that the model cannot explain: contact, or hands",
    "Somebody touched the robot, or it met its stop, a cable or the table; or a joint is "
    "commanded beyond its limits.",
    "Exclude the time with the `exclude_s` of the remedy, command the joint within its limits, or "
    "exclude its torque.",
)
LOCKED_OUTPUT = Code(
    "locked-output",
    "a spring whose load is held from outside",
    "A test bench with a locked output. Motor, friction and spring are identified from (7) and "
    "the torque sensor; the torque on the load is not used.",
    "Nothing, if the output was locked; otherwise its encoder is dead.",
)
STANDSTILL = Cause(
    "standstill",
    "a joint that hardly moves, or samples at rest that were excluded",
    "A joint was locked, or the motion has long rests.",
    "Move the joint, or accept that its friction is not identified.",
)
SATURATION = Cause(
    "saturation",
    "a channel at its limit",
    "The command was logged in place of the measured current, and the amplifier limited it; or a "
    "controller of position commands has a torque limit that the drives file lacks.",
    "Move more slowly, or log the measured current; with commands write the `torque_limit_Nm` of "
    "the remedy.",
)
HOLES = Cause(
    "holes",
    "samples that are missing: excluded because of gaps in time, or lost while the time counts on",
    "Messages lost on the bus, or a logger that stopped. It is a doubt where a counter of samples, "
    "or a time made from it, hides the gaps: speeds are too large there.",
    "Nothing, if they are few. Record on the machine that runs the controller, with its clock.",
)
NOT_IN_FORMAT = Code(
    "not-in-format",
    "a part of the model that the written file cannot hold",
    "`seaid export --format` for a simulator that has no springs, offsets, delays or terms of "
    "friction.",
    "Make the change of the remedy, or use a format that [can hold it](how_to/simulators.md).",
)
UNUSED_CHANNEL = Code(
    "unused-channel",
    "a logged channel that nothing uses",
    "A channel of the log that the description names and that no equation needs.",
    "Nothing; remove it from the description to silence the note.",
)

CODES: Mapping[str, Code] = FrozenMapping(
    {code.name: code for code in list(globals().values()) if isinstance(code, Code)},
    "code of a finding",
)
"""{name of a code: the code}."""
