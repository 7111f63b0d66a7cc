"""A clone stays small: no change but a release adds or alters more than 100 kB of binary files."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.package.binary_changes import MOST_BYTES, binary_changes

RULE = "rule.py"


def test_no_more_has_come_than_may_outside_a_release() -> None:
    found = binary_changes()
    if found is None:
        pytest.skip("there is no history of git here")
    assert found.total <= MOST_BYTES, found


def git(folder: Path, *arguments: str) -> str:
    somebody = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "protocol.file.allow=always")
    environment = {**os.environ, "GIT_CONFIG_GLOBAL": os.devnull}
    command = ["git", "-C", str(folder), *somebody, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return a repository whose history holds much, and whose last commit brought the rule."""
    folder = tmp_path / "project"
    folder.mkdir()
    git(folder, "init", "-q", "-b", "main")
    set_version(folder, "0.1.0")
    (folder / "old.bin").write_bytes(os.urandom(3 * MOST_BYTES))
    commit(folder)
    (folder / "old.bin").write_bytes(os.urandom(2 * MOST_BYTES))
    (folder / RULE).write_text("")
    commit(folder)
    return folder


def set_version(folder: Path, version: str) -> None:
    (folder / "pyproject.toml").write_text(f'[project]\nname = "a"\nversion = "{version}"\n')


def commit(folder: Path) -> None:
    git(folder, "add", "-A")
    git(folder, "commit", "-q", "-m", "a")


def total(folder: Path) -> int:
    found = binary_changes(folder, RULE)
    assert found is not None
    return found.total


def add(folder: Path, name: str, size: int = 60_000) -> None:
    (folder / name).write_bytes(b"\0" + os.urandom(size - 1))


def test_what_was_there_before_the_rule_is_not_counted(project: Path) -> None:
    assert total(project) == 0


def test_texts_are_not_counted(project: Path) -> None:
    (project / "long.svg").write_text("<svg/>\n" * 100_000 + "ü")
    assert total(project) == 0
    commit(project)
    assert total(project) == 0


@pytest.mark.parametrize("is_committed", [False, True])
def test_a_new_file_is_counted_in_the_work_tree_and_in_a_commit(project: Path, is_committed: bool) -> None:
    add(project, "new name.bin")
    if is_committed:
        commit(project)
    found = binary_changes(project, RULE)
    assert found is not None
    assert found.sizes == [("new name.bin", 60_000)]
    assert "new name.bin 60 kB" in str(found)


def test_one_that_is_no_text_for_want_of_a_nul_is_binary(project: Path) -> None:
    (project / "a.xz").write_bytes(bytes(range(1, 256)) * 10)
    assert total(project) == 2550


def test_a_file_that_is_altered_twice_counts_twice_even_if_it_is_removed_then(project: Path) -> None:
    for _ in range(2):
        add(project, "old.bin")
        commit(project)
    (project / "old.bin").unlink()
    commit(project)
    assert total(project) == 120_000


def test_what_a_merge_brings_is_counted_once(project: Path) -> None:
    git(project, "checkout", "-q", "-b", "side")
    add(project, "side.bin")
    commit(project)
    git(project, "checkout", "-q", "main")
    (project / "text").write_text("a")
    commit(project)
    git(project, "merge", "-q", "--no-edit", "side")
    assert total(project) == 60_000


def test_ignored_files_and_links_are_not_counted(project: Path) -> None:
    (project / ".gitignore").write_text("*.out\n")
    add(project, "a.out")
    (project / "link.bin").symlink_to("old.bin")
    assert total(project) == 0
    commit(project)
    assert total(project) == 0


def test_a_release_is_free_and_counting_begins_after_it(project: Path) -> None:
    add(project, "sample.bin", 5 * MOST_BYTES)
    set_version(project, "0.2.0")
    assert total(project) == 0, "in preparation"
    commit(project)
    assert total(project) == 0
    add(project, "sample.bin")
    assert total(project) == 60_000
    commit(project)
    assert total(project) == 60_000


def test_another_change_of_the_projects_file_is_no_release(project: Path) -> None:
    add(project, "a.bin")
    with (project / "pyproject.toml").open("a") as file:
        file.write('[tool.a]\nversion = "7"\n')
    commit(project)
    assert total(project) == 60_000


def test_a_tag_is_a_release_and_others_are_none(project: Path) -> None:
    add(project, "a.bin")
    commit(project)
    git(project, "tag", "nightly")
    assert total(project) == 60_000
    git(project, "tag", "-a", "-m", "a", "v0.2.0")
    assert total(project) == 0


def test_a_shallow_clone_counts_what_it_sees(project: Path, tmp_path: Path) -> None:
    add(project, "first.bin")
    commit(project)
    add(project, "second.bin")
    commit(project)
    for depth, wanted in ((1, 0), (2, 60_000), (3, 120_000)):
        clone = tmp_path / f"clone{depth}"
        git(tmp_path, "clone", "-q", "--depth", str(depth), project.as_uri(), str(clone))
        assert total(clone) == wanted
        add(clone, "third.bin")
        assert total(clone) == wanted + 60_000


def test_without_history_nothing_is_counted(project: Path, tmp_path: Path) -> None:
    """In an archive, also in one that lies in somebody else's repository, and in a repository without a commit."""
    git(project, "archive", "-o", str(tmp_path / "a.tar"), "HEAD")
    for place in (tmp_path / "unpacked", project / "vendored"):
        place.mkdir()
        subprocess.run(["tar", "-xf", tmp_path / "a.tar", "-C", place], check=True)
        assert binary_changes(place, RULE) is None
    git(tmp_path / "unpacked", "init", "-q")
    assert binary_changes(tmp_path / "unpacked", RULE) is None
