"""Forces of the ground by a fit, and what its rows contradict in the feet."""

from typing import Any

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

import seaid
from scripts.benchmarks.legged import noisy
from scripts.legged_plant import GO2, plan, plant, simulate
from seaid.checks.engine import observed
from seaid.legged.contacts import FEET_CHECKS, LeggedFit
from tests.legged.test_base import STANDING, base_of, go2, with_base
from tests.legged.test_feet import walked
from tests.plants import kept


@pytest.mark.parametrize(("change_m", "is_named"), [(0.02, True), (0.18, True), (0.21, False)])
def test_a_ball_that_reaches_the_joint_above_it_is_no_foot(
    change_m: float, is_named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The calves are 213 mm long, and their feet are balls of 22 mm."""
    column = [("radius", change_m, 0.001, 0.9)]
    monkeypatch.setattr(LeggedFit, "significant_columns", lambda *_: column)
    nothing = np.zeros(0)
    rows: Any = None  # those of the column, which is given
    legged = LeggedFit(go2(), [], rows, rows, {}, nothing, nothing, nothing, 15.0)
    found = [x for x in observed(FEET_CHECKS[:1], legged) if x.severity != "note"]
    assert [finding.code for finding in found] == ["geometry"] * is_named


@pytest.mark.slow  # two identifications of a walk of 8 s
def test_feet_that_push_while_flagged_in_the_air_are_named() -> None:
    """A threshold of the force of a foot that is too high goes into the bodies."""
    text, log = "pushes at the ground while it is flagged as in the air", walked().between(0, 8)
    contacts = {foot: np.array(x) for foot, x in base_of(log).contacts.items()}
    late = {foot: binary_erosion(x[:, 0] > 0.5, iterations=12) for foot, x in contacts.items()}
    shorter = with_base(log, contacts=late)
    robot = go2().without_nominal()
    own, other = (seaid.identify(robot, one, cutoff_hz=15.0) for one in (log, shorter))
    assert not any(text in str(one) for one in own.warnings)
    finding = next(one for one in other.warnings if text in str(one))
    assert finding.severity == "doubtful"
    assert "lower the threshold" in finding.remedy
    assert max(finding.evidence.values()) > 2.0


@kept
def on_soft_feet(soft: bool, lifted: bool) -> seaid.Log:
    """Ten seconds of a walk, or of a sway, on feet that sink in by 4 mm or by 0.2 mm."""
    targets = plan(go2(), GO2, 10.0, 71, lifted=lifted)
    model = plant(go2(), 0.001, soft=soft)
    return noisy(simulate(go2(), model, 10.0, targets=targets), 71)


@pytest.mark.slow  # fits of a whole quadruped
@pytest.mark.parametrize("lifted", [True, False])
def test_feet_that_sink_in_under_their_load_are_named(lifted: bool) -> None:
    """Of four feet that stand also without the orientation of the base."""
    found = seaid.identify(go2(), on_soft_feet(True, lifted))
    (finding,) = (one for one in found.warnings if one.code == "soft-feet")
    assert finding.severity == "doubtful"
    # MuJoCo's own contacts give way by 4 mm under a quarter of the weight of a Go2
    assert finding.evidence["compliance [m/N]"] == pytest.approx(9.4e-5, rel=0.06)
    assert finding.evidence["mean load [N]"] == pytest.approx(41.0, rel=0.06)
    hard = seaid.identify(go2(), on_soft_feet(False, lifted))
    assert "soft-feet" not in {one.code for one in hard.warnings}
    assert not any("could not be made" in one.message for one in hard.findings)
    for soft in () if lifted else (True, False):
        blind = seaid.identify(STANDING, with_base(on_soft_feet(soft, False), orientation=None))
        assert ("soft-feet" in {one.code for one in blind.warnings}) == soft
