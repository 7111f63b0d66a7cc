"""An empty environment in an empty folder: the wheel, a rig for ten seconds, a script. Needs the package index."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.with_us import with_us


@pytest.mark.long
@pytest.mark.rig
@pytest.mark.timeout(1500)
def test_installed_it_runs_a_rig_and_a_script(wheel: Path, tmp_path: Path) -> None:
    tools, downloads, empty = tmp_path / "venv" / "bin", tmp_path / "downloads", tmp_path / "empty"
    empty.mkdir()
    environment = {**os.environ, "TROCAR_CACHE_DIR": str(tmp_path / "cache"), "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    environment.pop("PYTHONPATH", None)

    def run(*command: str | Path) -> str:
        done = subprocess.run(
            with_us([str(part) for part in command]),
            cwd=empty,
            env=environment,
            capture_output=True,
            text=True,
            timeout=900,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    run(sys.executable, "-m", "venv", tools.parent)
    run(tools / "pip", "download", "--quiet", "--dest", downloads, wheel)
    begin_s = time.monotonic()
    run(tools / "pip", "install", "--quiet", "--no-index", "--find-links", downloads, wheel)
    said = run(tools / "trocar", "up", "--seconds", "10")
    assert "is running: open http://" in said
    assert "N at most" in run(tools / "python", "-m", "trocar.examples.poke")
    took_s = time.monotonic() - begin_s
    assert not [path for path in empty.iterdir() if path.name != "out"], "it writes into the user's folder"
    print(f"from the files to the last line of the script: {took_s:.0f} s")
