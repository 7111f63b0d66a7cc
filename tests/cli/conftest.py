"""Running the command in this process: exit code, output, errors.

What `trocar up` starts beside itself before anything is checked, the check and the fork server, imports for two seconds
of processor each: the check is made in this process, and there is no server. `test_stumbles_validation` and
`test_errors` start the command as a user does.
"""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from trocar.services.cli import check_options, validation
from trocar.services.cli.app import main
from trocar.services.mechanics.scene import SceneModel
from trocar.services.runtime.errors import UserError
from trocar.services.scenes import check_duct
from trocar.services.supervisor.crew import fork_link


@dataclass(frozen=True)
class Ran:
    code: int
    out: str
    err: str

    def sentence(self) -> str:
        """Return the one line that a person is told; fails if it is more, or a traceback."""
        lines = self.err.strip().splitlines()
        assert len(lines) == 1, self.err
        assert lines[0].startswith("trocar: ")
        assert "Traceback" not in self.err
        assert "\x1b" not in self.err + self.out  # nobody is looking: no colours
        return lines[0].removeprefix("trocar: ")


Trocar = Callable[..., Ran]


class _NoServer:
    """In the place of a fork server."""

    def close(self) -> None:
        """Nothing is there to be closed."""


def _check(options: str) -> None:
    rig, scene, overrides = json.loads(options)
    try:
        check_options.checked_rig(rig, scene, overrides)
    except UserError as error:
        raise validation.RefusedError(str(error), error.exit_code) from None


_sound: set[str] = set()


def _check_duct(scene: SceneModel, directory: Path) -> None:
    """Check a duct as a rig does, but one that is sound only once: an option is named by comparison with it."""
    if repr(scene) not in _sound:
        check_duct(scene, directory)
        _sound.add(repr(scene))


@pytest.fixture
def trocar(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Iterator[Trocar]:
    for name in ("TROCAR_RIG", "TROCAR_SCENE", "TROCAR_SET", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(validation, "_check", _check)
    monkeypatch.setattr(check_options, "check_duct", _check_duct)
    monkeypatch.setattr(fork_link, "ForkServer", _NoServer)
    kept = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}

    def run(*arguments: object) -> Ran:
        monkeypatch.setattr(sys, "argv", ["trocar", *map(str, arguments)])
        capsys.readouterr()
        try:
            main()
            code = 0
        except SystemExit as ended:
            code = int(ended.code or 0)
        captured = capsys.readouterr()
        return Ran(code, captured.out, captured.err)

    yield run
    for number, handler in kept.items():
        signal.signal(number, handler)


@pytest.fixture
def rig_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a rig that nobody else uses."""
    folder = tmp_path_factory.mktemp("cli")
    file = folder / "rig.yaml"
    file.write_text(f"name: test\ntransport: {{directory: {folder}}}\nsupervisor: {{web: {{port: 0}}}}\n")
    return file
