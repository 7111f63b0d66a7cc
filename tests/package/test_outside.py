"""What a project has outside is sound: workflows, forms and bots by their schemas, and what they run is there."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.package.conftest import ROOT

GITHUB = ROOT / ".github"
WORKFLOWS = sorted((GITHUB / "workflows").glob("*.yml"))
FORMS = sorted(path for path in (GITHUB / "ISSUE_TEMPLATE").glob("*.yml") if path.stem != "config")
SCHEMAS = [
    ("vendor.github-workflows", WORKFLOWS),
    ("custom.github-workflows-require-timeout", WORKFLOWS),
    ("vendor.github-issue-forms", FORMS),
    ("vendor.github-issue-config", [GITHUB / "ISSUE_TEMPLATE" / "config.yml"]),
    ("vendor.renovate", [GITHUB / "renovate.json"]),
    ("vendor.citation-file-format", [ROOT / "CITATION.cff"]),
    ("vendor.compose-spec", [ROOT / "docker-compose.yml"]),
]
#: A file of the repository that a line of shell runs or names.
_OURS = re.compile(r"(?:^|\s)((?:\./|deploy/|\.ci/)[\w./-]+)")
_VERB = re.compile(r"\./dev (\w+)")


def _tool(*words: str | Path) -> subprocess.CompletedProcess[str]:
    command = [str(Path(sys.executable).with_name(str(words[0]))), *map(str, words[1:])]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def _lint(folder: Path) -> subprocess.CompletedProcess[str]:
    return _tool("zizmor", "--offline", "--no-progress", "--strict-collection", folder)


def _steps() -> Iterator[tuple[str, dict[str, Any]]]:
    for path in WORKFLOWS:
        for name, job in yaml.safe_load(path.read_text())["jobs"].items():
            for step in job.get("steps", []):
                yield f"{path.stem}/{name}", step


def test_the_linter_of_workflows_finds_nothing() -> None:
    done = _lint(GITHUB)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("sound", "faulty"),
    [
        (r"@[0-9a-f]{40} # v[\d.]+", "@main"),
        ("pull_request:", "pull_request_target:"),
        (r"env --unset=CI \.ci/run", "echo ${{ github.event.pull_request.title }}"),
        (r"\njobs:\n", "\njob:\n"),
    ],
)
def test_the_linter_of_workflows_finds_a_fault(tmp_path: Path, sound: str, faulty: str) -> None:
    copy = tmp_path / ".github"
    shutil.copytree(GITHUB, copy)
    checks = copy / "workflows" / "checks.yml"
    text, count = re.subn(sound, faulty, checks.read_text())
    assert count
    checks.write_text(text)
    assert _lint(copy).returncode != 0


@pytest.mark.parametrize(("schema", "paths"), SCHEMAS, ids=[name for name, _ in SCHEMAS])
def test_a_file_is_what_its_reader_expects(schema: str, paths: list[Path]) -> None:
    assert paths
    done = _tool("check-jsonschema", "--builtin-schema", schema, *paths)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_file_that_its_reader_would_refuse_is_found(tmp_path: Path) -> None:
    form = tmp_path / "fault.yml"
    form.write_text(FORMS[0].read_text().replace("type: textarea", "type: textbox"))
    assert _tool("check-jsonschema", "--builtin-schema", "vendor.github-issue-forms", form).returncode != 0


def test_workflows_run_scripts_and_verbs_that_are_there() -> None:
    dev = (ROOT / "dev").read_text()
    lines = [(where, step["run"]) for where, step in _steps() if "run" in step]
    named = [(where, name) for where, line in lines for name in _OURS.findall(line)]
    assert len(named) > 5
    assert not [each for each in named if not (ROOT / each[1]).is_file()]
    assert not [
        line for _, line in lines for verb in _VERB.findall(line) if not re.search(rf"\b{verb}\b.*\)$", dev, re.M)
    ]


def test_every_step_is_short() -> None:
    """What is longer is a script, which can be tried without a push."""
    assert not [where for where, step in _steps() if step.get("run", "").strip().count("\n") > 2]


def test_tests_and_wheels_are_those_of_the_pythons_in_the_classifiers() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    said = [each.rpartition(" ")[2] for each in project["classifiers"] if re.search(r":: 3\.\d+$", each)]
    for name, job in (("checks", "tests"), ("wheels", "wheel")):
        text = (GITHUB / "workflows" / f"{name}.yml").read_text()
        assert yaml.safe_load(text)["jobs"][job]["strategy"]["matrix"]["python"] == said


def test_hooks_of_a_commit_run_tools_of_the_project() -> None:
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    assert [each["repo"] for each in hooks] == ["local"]
    tools = {hook["entry"].split()[0] for each in hooks for hook in each["hooks"]}
    assert not [name for name in tools if not Path(sys.executable).with_name(name).exists()]
