"""Nothing is depended on whose licence nobody has looked at."""

from __future__ import annotations

import pytest

from tests.package.licences import ALLOWED, BY_HAND, inventory, is_allowed, pinned


def test_every_licence_is_one_that_is_allowed_or_was_looked_at() -> None:
    known = inventory()
    assert len(known) > 80
    assert not {name: text for name, text in known.items() if name not in BY_HAND and not is_allowed(text)}


def test_what_was_looked_at_by_hand_is_not_what_a_rig_runs() -> None:
    assert not BY_HAND.keys() & pinned("run")
    assert BY_HAND.keys() <= pinned("dev"), "a package that nobody needs any more"


@pytest.mark.parametrize("text", ["", "GPL-3.0-only", "AGPL-3.0", "MIT AND GPL-2.0-only", "Proprietary"])
def test_another_licence_is_refused(text: str) -> None:
    assert text not in ALLOWED
    assert not is_allowed(text)


def test_one_of_two_alternatives_is_enough() -> None:
    assert is_allowed("GPL-2.0-only OR (MIT AND BSD-3-Clause)")
