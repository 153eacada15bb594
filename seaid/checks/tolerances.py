"""The numbers on which checks decide, each with its unit, its meaning and where it comes from.

No number is to be chosen on the log of one robot: it follows from statistics, from physics, or from
a study over simulated robots that its line names. A line that says "by hand" names the commit that
chose the number without a study. A check has no threshold of its own elsewhere: other modules have
the sizes of searches, units, and what rounding leaves.
"""

LEAST = 1e-300
"""Least divisor, near the least double: a quotient by what is zero is large, or zero by zero."""

SIGNIFICANT = 5.0
"""Standard errors beyond which a difference is no chance: among 50 parameters whose covariance
rests on some 100 correlated instants, right set-ups have at most 4.5
(`scripts/benchmarks/sensitivity.py`)."""

NEGLIGIBLE = 0.003
"""Error of a torque over its size below which what a model lacks does not matter. The low pass
leaves 0.22 % of a torque at reversals, at most, in nine logs without noise of the simulated leg and
arm of the tests; an error of 1 mrad between the encoders is 0.6 to 1.3 % of the torques of that
leg. No study over more robots chose it: it is by hand (1b587056)."""

NOTHING = 0.9
"""Error of excluded blocks, over that of a constant torque, from which a model is of no use. If it
is below one half in the own logs, it fits these only; where both are between, it lacks much."""

POOR = 0.1
"""Relative error, or part of a size, from which it matters: of a parameter, of the torque of a
joint, or of what a correlation lacks to one, where a low pass causes half. At speeds below this
part of the largest one friction may have another shape than that of its drive. What other blocks
know of a direction of the parameters below it is predicted with ten times the variance of the
noise. Mistakes are often round: a factor may be off a usual one by twice this part."""

SURE = 3.0
"""Standard errors from which a value is not zero, or is beyond a limit: of twenty parameters that
are zero, one is two standard errors below it in four of ten logs. Of windows of a residual, a
multiple of the median; of a noise, the multiple below which a third or more of a signal is
noise."""

BURST, WINDOW_S, RARE, SLIGHT = 6.0, 0.25, 0.2, 0.05
"""A contact is where the residual of a window [s] exceeds so many times that of the median window
(rms), unless it does so in more than a part of the windows, or is a slight part of the torque. A
slight share of some hundred samples shows. Commands that are equal for longer than a window are a
rest, and not a message that was lost. Turns with another joint are multiples of a slight part, as
those of pulleys are. A part of a radian that no error of a gear reaches: it would be 3 degrees.
Part of a squared residual that additional parameters must explain to be supported: less is real at
times and never useful. In right models of a simulated 7-joint arm the smoothing of Coulomb friction
by the low pass explains 2 to 4 % (`scripts/benchmarks/term_selection.py`). The part of RARE is by
hand (86c431a7)."""

CORRELATED_ROWS, CORRELATED_ERRORS = 4.0, 1.5
"""Rows of a regression per independent one: eight are in a period of the cutoff, which is two
independent ones. A window has at least one. Standard errors of the instants of an experiment, which
are farther apart, over those for white noise."""

FEW = 0.01
"""Share of the samples, or of a correlation below one, that no mistake of a set-up is needed for:
ends of a motion, single lost messages, feet that slip. A small part of a weight or a torque."""

MOST = 0.5
"""Share from which something holds for most of a log, or explains it: of a squared residual, also
of one model over another; error of a motor equation below which it holds. Correlation from which
two channels follow each other."""

TWICE = 2.0
"""Ratio of two sizes that errors of nominal bodies or of a mounting do not explain: masses by CAD
are nearer, and the controllers of a measured Go2 gave 1.1 to 1.7 of the torque of its bodies, which
is one robot: the round number is by hand (c604ab9c). Of variances, the ratio from which parts of
the data disagree, or a drift is more than a note. Stated standard errors of a parameter above which
its change matters: below, it is within the interval."""

MANY_TIMES = 5.0
"""Multiple of a limit from which a unit, and not the size of a motion, explains it: torques beyond
a limit that saturates them were 1.5 times beyond on average, in the one case that was looked at. By
hand (870266c2), between that and the 57 of a degree."""

FAR = 20.0
"""Ratio of two ranges, or of a torque, from which another unit, and neither a soft controller nor
nominal values, explains it: a degree is 1/57 rad. Of likelihoods, with and without a drift, twice
the logarithm from which it has a finding: encoders that move slowly have slow errors too."""

LATE_S = 0.05
"""Delay of a command [s] that no bus has. By hand (870266c2)."""

LEAST_DELAY_S = 0.0015
"""Delay [s] below which neither filters nor friction that a model lacks can be excluded. By hand
(80f58934)."""

FEWEST_INSTANTS = 30
"""Fewest instants of an experiment at which a joint moves: three for each of seven base parameters
that a body adds and of three columns of friction."""

HARDLY = 0.02
"""Motion of a joint over that of its motor, behind the gear, up to which it counts as locked: it
shows no gear ratio, and what holds it yields too. Part by which equations without a torque may
reduce the parameters towards zero. Both by hand (74c0cb4c, 14a59449)."""

LONGEST_M = 20.0
"""Distance [m] between two joints that no robot has, which is that of 2 cm in mm."""

STRONGEST_M_PER_S2 = 30.0
"""Gravity [m/s^2] that no planet has: that of Jupiter is 25."""

EVENTS = 8
"""Least number of events that chance does not make: a signed torque is below zero after half of
its returns to it, so that none of eight is has a probability of 1/256."""

SLOWEST_HZ, FASTEST_HZ = 8.0, 3e4
"""Sampling rates of logs of motion lie between; in their middle, of the logarithm, are 500 Hz. By
hand (86c431a7); the higher one is what that middle, a usual rate, requires (f346394a)."""

LEAST_SWING = 0.03
"""Motion [rad or m] of every joint below which a robot hardly moves. By hand (86c431a7)."""

LARGEST_DEFLECTION_RAD = 0.5
"""Motion of a motor at the joint that may be the deflection of a spring. By hand (74c0cb4c)."""

LEAST_OFFSET = 2e-3
"""Difference [rad or m] of the encoder offsets of a joint without a spring that matters, and
distance [m] between two joints below which another length is none."""

FEWEST_INDEPENDENT = 1.5
"""Independent rows per parameter, by their autocorrelation, below which standard errors are
unreliable."""

FEWEST_BY_BLOCKS = 7.0
"""Independent rows per parameter, by what blocks contradict, below which standard errors are
unreliable: of logs of a leg and two arms with fewer, which last a second or two, 95 % intervals
hold in 80 to 90 %, with more in 94 %. Right set-ups of eight seconds have at least 7.8
(`scripts/benchmarks/short_logs.py`). Up to twice as many do not determine the torques of other
motions where these have large errors."""

MOST_READ = 7
"""Findings above a note of a result, and candidates that one equation may accept: more would not be
read."""

MOST_ALIKE = 3
"""Joints with warnings of one code that are listed one by one, and half of those that the verdict
names: fifteen that lack the same are read as one."""

CONTRADICTED = 10.0
"""Standard deviations of chi-square above its mean from which data and assumptions contradict."""

CONFIDENCE = 0.975
"""Confidence with which a larger model must predict excluded blocks better."""

STRONG = 6.0
"""Least decrease of the information criterion, "strong" by Kass and Raftery (1995). `compare_terms`
is asked, a check is not: above zero 3 of 120 right set-ups have a finding, all of them below 4
(`scripts/benchmarks/term_selection.py --findings`)."""

BODY, CENTRE_M = 0.3, 0.03
"""Standard deviations of a body in a robot file: of its mass and of the distance of its centre,
relative, and least one of that centre [m]. Masses in public files are wrong by tens of per cent,
those of small distal bodies by factors. Right logs of the four robots of the gauntlet (seeds 1 and
2, 72 files with such errors) have one finding above a note. A payload is placed to BODY *
CENTRE_M."""

MATTERS = SEVERE = 0.25
"""Part of the squared residual of a joint that makes what its drive or its gear lacks doubtful: the
residual falls by an eighth. A spring that is not linear always is, since its stiffness has no
single value. Part of a torque left unexplained below which no sign, unit of an angle, clock or
place is wrong: at the robots of the gauntlet (seeds 1 and 2) such mistakes leave 0.43 at least,
right set-ups 0.10 at most. Bodies that leave more explain nothing. Part of a distance, or of the
length of gravity, that remains after a change to first order, or its inverse, beyond which effects
are not linear."""

LARGEST_RATIO = {False: 1e3, True: 1e5}
"""{whether a joint slides: ratio [rad/rad or rad/m] above which a slope between two encoders is a
unit, such as counts}. Strain wave gears have up to 320, planetary gears in series some hundred, and
a screw of 1 mm behind a gear of ten 6e4 rad/m."""

FEWEST_COUNTS = 256
"""Counts per turn of the coarsest encoder. A slope by degrees, 360 per turn, is a third from the
nearest power of two, and is no count."""

LEAST_RANGE_K = 2.0
"""Least range of a motor's temperature: friction changes by about 1 % per kelvin, and sensors have
steps of up to 1 K. Whether the change is significant is seen from its standard error."""
