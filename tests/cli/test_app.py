from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Trocar

ROOT = Path(__file__).parents[2]


def test_the_command_itself_imports_nothing_heavy() -> None:
    """`trocar --help` answers before numpy would have been imported."""
    script = (
        "import sys, trocar.services.cli.app; print(*sorted({'numpy', 'zmq', 'numba', 'uvicorn'} & set(sys.modules)))"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)
    assert ran.stdout.strip() == ""


def test_every_verb_is_listed(trocar: Trocar) -> None:
    ran = trocar("--help")
    assert ran.code == 0
    for verb in ("up", "down", "top", "doctor", "sniff", "arm", "config", "fem", "effects"):
        assert f" {verb} " in ran.out


def test_unknown_option_is_a_usage_error(trocar: Trocar) -> None:
    ran = trocar("up", "--sceen", "default")
    assert ran.code == 2
    assert "Traceback" not in ran.err


def test_a_package_that_is_not_installed_is_a_sentence(trocar: Trocar, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "trocar.services.cli.sniff", raising=False)
    monkeypatch.setitem(sys.modules, "zmq", None)
    ran = trocar("sniff")
    assert ran.code == 1
    assert ran.sentence().startswith("the package zmq is not installed")
