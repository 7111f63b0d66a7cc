"""A place is trusted where nobody but this user and root can change what lies there, or put something in its place."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from trocar.services.cli.validation import validate
from trocar.services.files import cache_directory
from trocar.services.files.trusted_path import fault_of_place
from trocar.services.gateway.motions.scene_hands import find_scene_hands
from trocar.services.runtime.loop.nan_guard import NanGuard

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


@pytest.mark.parametrize("what", ["a file", "a folder that others may write to"])
def test_a_cache_that_cannot_be_used_gives_way_to_a_fresh_folder_with_one_line(
    place: Path, what: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cache, why = (place / "file", "it is no folder") if what == "a file" else (place, "others may write to ")
    if what == "a file":
        cache.touch()
    else:
        cache.chmod(0o777)
    monkeypatch.setenv("TROCAR_CACHE_DIR", str(cache))
    used = cache_directory.cache_directory()
    assert used != cache
    assert used.parent.stat().st_mode & 0o777 == 0o700
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{cache} is not used: {why}")
    assert line.endswith(f"; for this run {used} is")
    assert cache_directory.cache_directory() == used
    assert capsys.readouterr().err == "", "it is said once"


def test_in_a_trusted_cache_a_folder_that_others_can_change_is_removed_with_one_line(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("sound", "shared", "dumps"):
        (place / name / "inner").mkdir(parents=True)
    (place / "shared").chmod(0o777)
    (place / "dumps").chmod(0o777)
    monkeypatch.setenv("TROCAR_CACHE_DIR", str(place))
    assert cache_directory.cache_directory() == place
    assert sorted(path.name for path in place.iterdir()) == ["dumps", "sound"], "people's dumps are read by nobody"
    why = f"is not used: others may write to {place / 'shared'} (mode 0777); it is made anew"
    assert capsys.readouterr().err == f"{place / 'shared'} {why}\n"


def test_folders_that_a_process_makes_in_the_cache_are_for_this_user_whatever_the_umask(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = place / "above" / "cache"
    monkeypatch.setenv("TROCAR_CACHE_DIR", str(cache))
    before = os.umask(0)
    try:
        validate("stub", None, ())
        find_scene_hands("insertion")
        NanGuard("physics", {"q": np.array([np.nan])}, cache / "dumps").watch()
    finally:
        os.umask(before)
    made = [cache.parent, *(path for path in cache.parent.rglob("*") if path.is_dir())]
    assert {path.name for path in made} >= {"cache", "scenes", "dumps"}
    assert {oct(path.stat().st_mode & 0o777) for path in made} == {"0o700"}


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_what_belongs_to_another_is_not_trusted(place: Path) -> None:
    os.chown(place.parent, NOBODY, NOBODY)
    assert fault_of_place(place) == f"{place.parent} belongs to user {NOBODY}"
    os.chown(place.parent, 0, 0)
    (place / "link").symlink_to(place)
    os.lchown(place / "link", NOBODY, NOBODY)
    assert fault_of_place(place / "link") == f"{place / 'link'} belongs to user {NOBODY}"
