"""The short form of scripts and benchmarks, `--quick`: a part of the work, in a second or two.

The tests run every script in its short form, whose figures mean nothing. Sizes are asked for where
they are used; at the top of a module only if no other script imports it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from itertools import islice
from typing import Any, TypeVar

import seaid

OPTION = "--quick"
PLAN_S = 2.0
"""Duration of the motions of the short form."""
T = TypeVar("T")


def is_quick() -> bool:
    """Return whether the command line asks for the short form."""
    return OPTION in sys.argv[1:]


def add_quick(parser: argparse.ArgumentParser) -> None:
    """Add the option to a parser."""
    parser.add_argument(OPTION, action="store_true", help="a part of the work, as in the tests")


def words() -> list[str]:
    """Return the arguments of a script without a parser, without the option."""
    return [word for word in sys.argv[1:] if word != OPTION]


def sized(full: T, short: T) -> T:
    """Return the first value, or the second one in the short form."""
    return short if is_quick() else full


def few(items: Iterable[T], count: int = 1) -> list[T]:
    """Return all items, or only the first ones in the short form."""
    return list(islice(items, count) if is_quick() else items)


def plan(robot: seaid.Robot, duration_s: float, **request: Any) -> seaid.Excitation:
    """Return the plan of `design_excitation`; in the short form a short one, of one iteration."""
    if is_quick():
        duration_s, request = PLAN_S, {**request, "starts": 1, "iterations": 1}
    return seaid.design_excitation(robot, duration_s, **request)


def leg_plan() -> seaid.Trajectory:
    """Return the shipped motion of the TULip leg, in the short form a short one."""
    from scripts.identify_tulip_leg import LIMITS, TEST_MASS, load_leg, shipped_plan

    if not is_quick():
        return shipped_plan()
    known = load_leg((TEST_MASS,)).without_nominal()
    return plan(known, PLAN_S, limits=LIMITS, seed=2).trajectory
