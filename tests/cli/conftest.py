"""Running the command in this process: exit code, output, errors."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from services.cli.app import main


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


@pytest.fixture
def trocar(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Iterator[Trocar]:
    for name in ("TROCAR_RIG", "TROCAR_SCENE", "TROCAR_SET", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
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
