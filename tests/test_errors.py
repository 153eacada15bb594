"""The errors are of one family, and name what exists."""

import pytest

from seaid import errors
from seaid.errors import SeaidError, SeaidWarning, unknown_name

KINDS = ("RobotError", "LogError", "ExcitationError", "SymbolicError", "IdentificationError")


@pytest.mark.parametrize("name", KINDS)
def test_every_error_is_a_seaid_error(name: str) -> None:
    assert issubclass(getattr(errors, name), SeaidError)


def test_seaid_error_is_no_builtin_kind_that_code_might_swallow() -> None:
    assert SeaidError.__bases__ == (Exception,)
    assert SeaidWarning.__bases__ == (UserWarning,)


def test_unknown_name_offers_the_nearest_and_lists_all() -> None:
    text = unknown_name("joint", "kne_pitch", ["hip_pitch", "knee_pitch"])
    assert text == (
        "no joint is named 'kne_pitch'; did you mean 'knee_pitch'? allowed: hip_pitch, knee_pitch"
    )


def test_unknown_name_offers_nothing_where_nothing_is_near() -> None:
    assert unknown_name("key", "xyz", ["mass"]) == "no key is named 'xyz'; allowed: mass"


def test_unknown_name_says_none_where_nothing_exists() -> None:
    assert unknown_name("joint", "a", iter(())) == "no joint is named 'a'; allowed: none"
