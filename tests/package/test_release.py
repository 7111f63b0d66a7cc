"""A release is refused in a sentence where it must be, and writes its version everywhere."""

from __future__ import annotations

import datetime
import subprocess
import tarfile
import zipfile
from pathlib import Path

import pytest

from deploy.release import Plan, ReleaseError, check_metadata, entries, main, refuse, write_versions

_FILES = {
    "pyproject.toml": '[project]\nname = "trocar"\nversion = "0.1.0"\n[tool.x]\nversion = "7"\n',
    "CITATION.cff": "title: T\nversion: 0.1.0\nlicense: L\n",
    "CHANGELOG.md": "# Changelog\n\n## Unreleased\n\n- A thing.\n\n## 0.1.0\n\nThe first.\n",
}


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name, text in _FILES.items():
        (tmp_path / name).write_text(text)
    _git(tmp_path, "init", "--quiet", "--initial-branch", "main")
    _commit(tmp_path)
    return tmp_path


def _git(tree: Path, *words: str) -> None:
    who = ("-c", "user.name=Somebody", "-c", "user.email=somebody@example.org")
    subprocess.run(["git", "-C", str(tree), *who, *words], check=True, capture_output=True)


def _commit(tree: Path) -> None:
    _git(tree, "add", "--all")
    _git(tree, "commit", "--quiet", "--message", "A state")


def test_a_newer_version_of_a_clean_tree_is_accepted(tree: Path) -> None:
    refuse("0.2.0", tree)
    refuse("0.2.0rc1", tree)


@pytest.mark.parametrize(
    ("version", "said"),
    [
        ("two", "'two' is no version, such as 1.2.0"),
        ("0.2.0+ours", "'0.2.0+ours' is written 0.2.0 in a release"),
        ("v0.2.0", "'v0.2.0' is written 0.2.0 in a release"),
        ("0.1.0", "0.1.0 is not newer than 0.1.0, which pyproject.toml has"),
        ("0.1.0rc1", "0.1.0rc1 is not newer than 0.1.0, which pyproject.toml has"),
    ],
)
def test_a_version_that_cannot_be_is_refused(tree: Path, version: str, said: str) -> None:
    with pytest.raises(ReleaseError) as error:
        refuse(version, tree)
    assert str(error.value) == said


def test_a_tag_that_is_there_is_not_made_again(tree: Path) -> None:
    _git(tree, "tag", "v0.2.0")
    with pytest.raises(ReleaseError, match=r"^the tag v0\.2\.0 exists already$"):
        refuse("0.2.0", tree)


def test_another_branch_is_refused(tree: Path) -> None:
    _git(tree, "switch", "--quiet", "--create", "side")
    with pytest.raises(ReleaseError, match=r"^releases are made on main, and this is side$"):
        refuse("0.2.0", tree)


@pytest.mark.parametrize("name", ["CHANGELOG.md", "new.txt"])
def test_a_tree_with_changes_is_refused(tree: Path, name: str) -> None:
    with (tree / name).open("a") as file:
        file.write("more\n")
    with pytest.raises(ReleaseError, match=f"not committed, the first in {name}$"):
        refuse("0.2.0", tree)


@pytest.mark.parametrize("text", ["# Changelog\n\n## Unreleased\n\n## 0.1.0\n\n- Old.\n", "# Changelog\n\n## 0.1.0\n"])
def test_a_changelog_without_an_entry_is_refused(tree: Path, text: str) -> None:
    (tree / "CHANGELOG.md").write_text(text)
    _commit(tree)
    with pytest.raises(ReleaseError, match=r"^CHANGELOG\.md says nothing under"):
        refuse("0.2.0", tree)


def test_versions_are_written_where_they_stand_and_nowhere_else(tree: Path) -> None:
    plan = Plan("0.2.0", datetime.date(2026, 5, 4))
    write_versions(plan, tree)
    assert (tree / "pyproject.toml").read_text() == _FILES["pyproject.toml"].replace("0.1.0", "0.2.0")
    cited = _FILES["CITATION.cff"].replace("0.1.0", "0.2.0\ndate-released: 2026-05-04")
    assert (tree / "CITATION.cff").read_text() == cited
    changes = (tree / "CHANGELOG.md").read_text()
    assert "## 0.2.0\n\nReleased on 2026-05-04.\n\n- A thing.\n\n## 0.1.0" in changes
    assert not entries(tree)


def test_a_second_release_has_one_day_in_its_citation(tree: Path) -> None:
    write_versions(Plan("0.2.0", datetime.date(2026, 5, 4)), tree)
    (tree / "CHANGELOG.md").write_text(_FILES["CHANGELOG.md"])
    write_versions(Plan("0.3.0", datetime.date(2026, 6, 5)), tree)
    assert "version: 0.3.0\ndate-released: 2026-06-05\nlicense" in (tree / "CITATION.cff").read_text()


@pytest.mark.parametrize("of_wheel", ["0.2.0", "0.1.0"])
@pytest.mark.parametrize("of_sources", ["0.2.0", "0.1.0"])
def test_wheel_and_sources_must_have_the_version(tmp_path: Path, of_wheel: str, of_sources: str) -> None:
    wheel, sources, said = tmp_path / "a.whl", tmp_path / "a.tar.gz", tmp_path / "PKG-INFO"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr(f"trocar-{of_wheel}.dist-info/METADATA", f"Metadata-Version: 2.4\nVersion: {of_wheel}\n")
    said.write_text(f"Metadata-Version: 2.4\nVersion: {of_sources}\n")
    with tarfile.open(sources, "w:gz") as files:
        files.add(said, f"trocar-{of_sources}/PKG-INFO")
    if of_wheel == of_sources == "0.2.0":
        check_metadata(wheel, sources, "0.2.0")
        return
    with pytest.raises(ReleaseError, match=f"the wheel has version {of_wheel}, the sources {of_sources}, not 0.2.0"):
        check_metadata(wheel, sources, "0.2.0")


def test_the_command_says_why_it_refuses(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["two"]) == 1
    assert capsys.readouterr().err == "release: 'two' is no version, such as 1.2.0\n"
