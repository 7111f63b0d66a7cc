"""Ctrl-C at any import of any verb: the exit code for that, and not a line of Python's."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patience import PATIENCE_S
from trocar.services.messages.exit_codes import ExitCode
from trocar.services.start import interrupts

#: As if a person had pressed it while the N-th module is looked for, counted from when we are asked.
_PRESSED = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell's job in the background ignores

class Press:
    left = int(os.environ["PRESS_AT"])
    counts = False

    def find_spec(self, name, path=None, target=None):
        Press.counts = Press.counts or name == "trocar.services.start.start_up"
        if Press.counts:
            Press.left -= 1
            if Press.left == 0:
                os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Press())
"""
_VERBS = [
    "up --seconds 1", "down", "diagnose top --once", "diagnose latency", "doctor", "diagnose sniff", "arm", "safe-stop",
    "keys made", "replay nothing.mcap", "repair nothing.mcap", "scenes", "tissues", "catheters", "scenarios",
    "attempt status", "anatomy nothing.nrrd", "config show", "config schema", "score nothing.mcap",
    "--help", "--version",
]  # fmt: skip


def _pressed(tmp: Path, arguments: list[str], at: int) -> tuple[int, str]:
    folder = tmp / "press"
    folder.mkdir(exist_ok=True)
    (folder / "sitecustomize.py").write_text(_PRESSED)
    environment = {
        **os.environ, "PRESS_AT": str(at), "TROCAR_SET": f"transport.directory={tmp / 'bus'} supervisor.web.port=0",
        "PYTHONPATH": os.pathsep.join(filter(None, (str(folder), os.environ.get("PYTHONPATH")))),
    }  # fmt: skip
    ran = subprocess.run(
        [sys.executable, *arguments], cwd=tmp, env=environment, capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip
    return ran.returncode, ran.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("pressed")
    (made / "bus").mkdir(mode=0o700)
    return made


@settings(max_examples=25)
@given(verb=st.sampled_from(_VERBS), at=st.integers(1, 600))
def test_ctrl_c_while_a_verb_imports_is_no_traceback(folder: Path, verb: str, at: int) -> None:
    """It was, for the first second of each."""
    code, said = _pressed(folder, ["-m", "trocar.services.cli.app", *verb.split()], at)
    assert "Traceback" not in said
    assert "KeyboardInterrupt" not in said
    if "trocar: " not in said:  # it had ended by then, for another reason
        assert code in (ExitCode.INTERRUPTED, ExitCode.SUCCESS, ExitCode.INTERRUPTED_START, ExitCode.FAILURE)


@pytest.mark.parametrize("at", [1, 2, 40, 200])
def test_the_first_second_of_up_ends_with_the_code_for_it(folder: Path, at: int) -> None:
    assert _pressed(folder, ["-m", "trocar.services.cli.app", "up", "--seconds", "1"], at) == (ExitCode.INTERRUPTED, "")


@pytest.mark.parametrize("at", [413, 450, 500])
def test_an_interruption_within_an_import_that_executes_a_text_has_the_code_for_it(folder: Path, at: int) -> None:
    """Python would end by the signal: scipy's imports call `exec`."""
    score = ["-m", "trocar.services.cli.app", "score", "nothing.mcap"]
    assert _pressed(folder, score, at) == (ExitCode.INTERRUPTED, "")


@pytest.mark.parametrize(
    "module", ["supervisor", "gateway", "visualization.render_worker", "supervisor.crew.fork_server"]
)
@pytest.mark.parametrize("at", [3, 40])
def test_the_processes_of_a_rig_end_as_quietly(folder: Path, module: str, at: int) -> None:
    assert _pressed(folder, ["-m", f"trocar.services.{module}", "0"], at) == (ExitCode.INTERRUPTED, "")


@pytest.mark.parametrize(
    ("arguments", "ours"),
    [
        (["python3", "/usr/local/bin/trocar", "up"], True),
        (["python3", "-m", "trocar.services.gateway"], True),
        (["python3", "-X", "importtime", "-m", "trocar.services.cli.app"], True),
        (["python3", "-m", "pytest", "-m", "trocar"], False),
        (["python3", "notebook.py", "trocar"], False),
        (["python3", "-c", "import trocar.services.start.entry"], False),
        (["python3"], False),
    ],
)
def test_only_a_command_of_ours_takes_the_signal(arguments: list[str], ours: bool) -> None:
    assert interrupts._is_ours(arguments) is ours


def test_a_job_in_the_background_goes_on_ignoring_it() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interrupts.Raised():
        assert signal.getsignal(signal.SIGINT) is before
