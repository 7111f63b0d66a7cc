"""The wheel holds all that a machine without clone, npm or compiler needs."""

from __future__ import annotations

import subprocess
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

from tests.package.conftest import ROOT


@pytest.fixture(scope="module")
def names(wheel: Path) -> set[str]:
    return set(zipfile.ZipFile(wheel).namelist())


def _tracked(folder: str) -> set[str]:
    listed = ("git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard", folder)
    said = subprocess.run(listed, check=True, capture_output=True, text=True).stdout
    return {name for name in said.splitlines() if (ROOT / name).exists()}


@pytest.mark.parametrize("package", ["protocol", "services", "studies", "review", "trocar"])
def test_it_holds_every_module(names: set[str], package: str) -> None:
    below = "" if package == "trocar" else "trocar/"
    assert not {f"{below}{name}" for name in _tracked(package) if name.endswith((".py", "py.typed"))} - names


def test_it_holds_every_rig_scene_and_device(names: set[str]) -> None:
    assert not {f"trocar/{name}" for name in _tracked("configs")} - names


def test_it_holds_the_built_page_and_none_of_its_sources(names: set[str]) -> None:
    web = {name.removeprefix("trocar/services/visualization/web/") for name in names if "/web/" in name}
    assert {"dist/index.html", "dist/app.js", "dist/style.css"} <= web
    assert not [name for name in web if name.startswith(("src/", "node_modules/", "test/"))]


def test_nothing_comes_to_lie_beside_the_packages(names: set[str]) -> None:
    assert {name.split("/")[0].split("-")[0] for name in names} == {"trocar"}


def test_it_says_its_licence_and_holds_the_text(wheel: Path, names: set[str]) -> None:
    (metadata,) = (name for name in names if name.endswith(".dist-info/METADATA"))
    said = Parser().parsestr(zipfile.ZipFile(wheel).read(metadata).decode())
    assert said["License-Expression"] == "Apache-2.0"
    assert f"{Path(metadata).parent}/licenses/LICENSE" in names


def test_version_changelog_and_citation_agree() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f"\n## {version}" in (ROOT / "CHANGELOG.md").read_text()
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
