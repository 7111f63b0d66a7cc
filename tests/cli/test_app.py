from __future__ import annotations

import logging
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Trocar
from trocar.services.runtime import log

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
    for verb in ("up", "down", "diagnose", "doctor", "arm", "config", "fem", "effects"):
        assert f" {verb} " in ran.out


def test_unknown_option_is_a_usage_error(trocar: Trocar) -> None:
    ran = trocar("up", "--sceen", "default")
    assert ran.code == 2
    assert ran.sentence().startswith("no such option: --sceen")
    assert ran.sentence().endswith("; see `trocar up --help`")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("score",), "missing argument 'file'"),
        (("up", "--seconds", "soon"), "invalid value for '--seconds': input should be a valid number"),
        (
            ("up", "--viewer", "eye"),
            "invalid value for '--viewer': 'eye' is not one of 'auto', 'native'",
        ),
        (("config", "show", "rig"), "got unexpected extra argument(s) (rig)"),
        (("config", "shwo"), "no such command 'shwo'; did you mean 'show'"),
        (("up", "--rig"), "option '--rig' requires an argument"),
    ],
)
def test_wrong_words_are_one_sentence_without_a_box(trocar: Trocar, words: tuple[str, ...], says: str) -> None:
    ran = trocar(*words)
    assert ran.code == 2
    assert ran.sentence().lower().startswith(says.lower())


@pytest.mark.parametrize("words", [(), ("config",), ("attempts",)])
def test_no_words_are_answered_with_help_alone(trocar: Trocar, words: tuple[str, ...]) -> None:
    ran = trocar(*words)
    assert (ran.code, ran.err) == (2, "")
    assert "Usage: trocar" in ran.out


@pytest.mark.parametrize("how", ["option", "variable"])
def test_the_level_of_the_log_is_handed_on_and_a_wrong_one_refused(
    trocar: Trocar, rig_file: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    monkeypatch.delenv(log.LEVEL_VARIABLE, raising=False)
    assert log.asked_level() is None
    monkeypatch.setenv(log.LEVEL_VARIABLE, "debug" if how == "option" else "loud")  # undone, whatever a verb sets
    ran = trocar(*(("--log-level", "loud") if how == "option" else ()), "up", "--rig", rig_file)
    where = "--log-level" if how == "option" else "TROCAR_LOG_LEVEL"
    assert ran.code == 2
    assert ran.sentence() == f"{where}: there is no level 'loud'; known: debug, info, warning, error"
    assert trocar("--log-level", "warning", "scenes").code == 0
    assert log.asked_level() == logging.WARNING


def test_a_former_verb_works_and_says_its_new_name(trocar: Trocar, tmp_path: Path) -> None:
    ran = trocar("latency", tmp_path / "no.npz")
    assert ran.code == trocar("diagnose", "latency", tmp_path / "no.npz").code
    assert "this verb is now `trocar diagnose latency`" in ran.err


def test_a_package_that_is_not_installed_is_a_sentence(trocar: Trocar, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "trocar.services.cli.diagnose.sniff", raising=False)
    monkeypatch.setitem(sys.modules, "zmq", None)
    ran = trocar("diagnose", "sniff")
    assert ran.code == 4
    assert ran.sentence().startswith("this needs the package 'zmq': ")
