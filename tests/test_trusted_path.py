"""A place is trusted where nobody but this user and root can change what lies there, or put something in its place."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from services.trusted_path import fault_of_place

NOBODY = 65534


@pytest.fixture
def place(tmp_path: Path) -> Path:
    tmp_path.chmod(0o700)
    place = tmp_path / "a" / "b"
    place.mkdir(parents=True, mode=0o700)
    return place


def test_a_folder_of_ones_own_and_one_that_is_not_there_yet_are_trusted(place: Path) -> None:
    assert fault_of_place(place) == ""
    assert fault_of_place(place / "later" / "still") == ""


@pytest.mark.parametrize("above", [0, 1])
def test_a_folder_that_others_may_write_to_is_not_nor_what_lies_below(place: Path, above: int) -> None:
    shared = [place, *place.parents][above]
    shared.chmod(0o777)
    assert fault_of_place(place) == f"others may write to {shared} (mode 0777)"
    shared.chmod(0o1777)
    assert bool(fault_of_place(place)) == (above == 0), "in a sticky folder nobody replaces what is another's"


def test_a_link_leads_through_all_that_its_target_does(place: Path) -> None:
    middle = place / "shared"
    middle.mkdir()
    (middle / "link").symlink_to(place.parent)
    (place / "first").symlink_to("shared/link")
    assert fault_of_place(place / "first") == ""
    middle.chmod(0o777)
    assert str(middle) in fault_of_place(place / "first")


def test_a_ring_of_links_is_no_place(place: Path) -> None:
    (place / "one").symlink_to("two")
    (place / "two").symlink_to("one")
    assert "symbolic links" in fault_of_place(place / "one")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_what_belongs_to_another_is_not_trusted(place: Path) -> None:
    os.chown(place.parent, NOBODY, NOBODY)
    assert fault_of_place(place) == f"{place.parent} belongs to user {NOBODY}"
    os.chown(place.parent, 0, 0)
    (place / "link").symlink_to(place)
    os.lchown(place / "link", NOBODY, NOBODY)
    assert fault_of_place(place / "link") == f"{place / 'link'} belongs to user {NOBODY}"
