"""Every benchmark says what it measures and which options it takes, without measuring anything."""

from __future__ import annotations

import ast
import runpy
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
COMMANDS = sorted(path for path in BENCHMARKS.glob("*.py") if '__name__ == "__main__"' in path.read_text("utf-8"))

#: The others hand what they do not know to `trocar up`.
WITHOUT_RIG = [path for path in COMMANDS if "parse_known_args" not in path.read_text("utf-8")]


@pytest.fixture(autouse=True)
def beside(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a script is run by its path: its neighbours are found."""
    monkeypatch.setattr(sys, "path", [str(BENCHMARKS), *sys.path])


def test_there_are_benchmarks() -> None:
    assert len(COMMANDS) > 20


@pytest.mark.parametrize("path", COMMANDS, ids=lambda path: path.stem)
def test_help_is_the_text_of_the_module(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [str(path), "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(path), run_name="__main__")
    assert ended.value.code == 0
    document = ast.get_docstring(ast.parse(path.read_text("utf-8")))
    assert document is not None
    said = " ".join(capsys.readouterr().out.split())
    assert " ".join(document.split("\n\n")[0].split()) in said


@pytest.mark.parametrize("path", WITHOUT_RIG, ids=lambda path: path.stem)
def test_an_option_that_it_does_not_know_is_refused(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", [str(path), "--no-such-option"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(path), run_name="__main__")
    assert ended.value.code == 2


def test_a_benchmark_that_is_ended_ends_what_it_has_started() -> None:
    script = (
        "import sys, time; from report import end_in_good_order; end_in_good_order()\n"
        "try:\n    print('begun', flush=True); time.sleep(60)\nfinally:\n    print('ended')"
    )
    process = subprocess.Popen([sys.executable, "-c", script], cwd=BENCHMARKS, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    time.sleep(0.05)
    process.terminate()
    assert process.communicate(timeout=PATIENCE_S)[0] == "ended\n"
    assert process.returncode == 143
