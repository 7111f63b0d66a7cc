"""A run of faults goes on where the last one stopped while the code is the same, and begins anew where it is not."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
SEED = 3


@pytest.fixture
def bench_faults(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(sys, "path", [str(BENCHMARKS), *sys.path])
    return importlib.import_module("bench_faults")


def _git(root: Path, *words: str) -> str:
    who = ("-c", "user.name=nobody", "-c", "user.email=nobody@example.org")
    done = subprocess.run(["git", *who, *words], cwd=root, capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.fixture
def root(tmp_path: Path, bench_faults: Any) -> Path:
    for place in bench_faults.CODE:
        path = tmp_path / (place if "." in place else f"{place}/a.py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("1\n")
    _git(tmp_path, "init", "--quiet")
    _git(tmp_path, "add", ".")
    _git(tmp_path, "commit", "--quiet", "-m", "struck")
    return tmp_path


def _outcomes(bench_faults: Any, root: Path, *commits: str) -> Path:
    rates = dict.fromkeys(bench_faults.LOOPS, 1000.0)
    outcomes = [
        bench_faults.Outcome("physics", "SIGKILL", 2.0, 3.0, "running", 10.0, rates, 0.03, 0.0, commit)
        for commit in commits
    ]
    file = root / "outcomes.json"
    file.write_text(json.dumps({"seed": SEED, "outcomes": [asdict(each) for each in outcomes]}))
    return file


def test_it_goes_on_after_a_commit_of_something_else(bench_faults: Any, root: Path) -> None:
    first = _git(root, "rev-parse", "--short", "HEAD")
    (root / "README.md").write_text("told\n")
    _git(root, "add", ".")
    _git(root, "commit", "--quiet", "-m", "docs")
    file = _outcomes(bench_faults, root, first, _git(root, "rev-parse", "--short", "HEAD"))
    assert len(bench_faults.kept(file, SEED, root)) == 2
    assert bench_faults.kept(file, SEED + 1, root) == [], "another seed strikes others"


@pytest.mark.parametrize("committed", [True, False])
def test_it_begins_anew_where_any_was_of_other_code(
    bench_faults: Any, root: Path, committed: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    first = _git(root, "rev-parse", "--short", "HEAD")
    (root / "services" / "a.py").write_text("2\n")
    if committed:
        _git(root, "commit", "--quiet", "-a", "-m", "other code")
    file = _outcomes(bench_faults, root, first, _git(root, "rev-parse", "--short", "HEAD"))
    assert bench_faults.kept(file, SEED, root) == []
    assert f"2 outcomes are forgotten: {first}" in capsys.readouterr().err


@pytest.mark.parametrize("commit", ["", "unknown", "0123456"])
def test_code_that_nobody_knows_is_other_code(bench_faults: Any, root: Path, commit: str) -> None:
    assert bench_faults.kept(_outcomes(bench_faults, root, commit), SEED, root) == []


def test_kept_outcomes_of_other_code_are_told_apart(bench_faults: Any, root: Path) -> None:
    first = _git(root, "rev-parse", "--short", "HEAD")
    (root / "services" / "a.py").write_text("2\n")
    _git(root, "commit", "--quiet", "-a", "-m", "other code")
    now = _git(root, "rev-parse", "--short", "HEAD")
    file = _outcomes(bench_faults, root, first, first, now)
    outcomes = bench_faults.kept(file, SEED, root, is_any_code=True)
    assert bench_faults.struck_rigs(outcomes) == f"2 at {first}, 1 at {now}"
    assert bench_faults.kept(file, SEED + 1, root, is_any_code=True) == [], "another seed strikes others"

    slow = replace(outcomes[0], rates_hz=dict.fromkeys(bench_faults.LOOPS, 900.0))
    failed = {row.name: row.value for row in bench_faults._rows([slow, *outcomes[1:]])}
    assert failed["faults after which something failed, of 3"] == 1.0
    assert (failed[f"of them at {first}, of 2"], failed[f"of them at {now}, of 1"]) == (1.0, 0.0)
    of_one = bench_faults._rows(outcomes[:2])
    assert not any(row.name.startswith("of them at") for row in of_one), "one commit has one count"
