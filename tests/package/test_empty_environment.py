"""An empty environment in an empty folder: the wheel, a rig for ten seconds, a script. Needs the package index."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import time
from pathlib import Path

import pytest
import zstandard

from tests.with_us import with_us

#: Modules and packages of somebody else, under names that a package of ours once had.
_STRANGERS = ("services.py", "protocol/__init__.py", "review.py", "studies/__init__.py", "configs/__init__.py")


@pytest.mark.long
@pytest.mark.rig
@pytest.mark.timeout(1500)
def test_installed_it_runs_a_rig_and_a_script_and_compiles_nothing(wheel_with_kernels: Path, tmp_path: Path) -> None:
    tools, downloads, folder = tmp_path / "venv" / "bin", tmp_path / "downloads", tmp_path / "folder"
    for name in _STRANGERS:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("raise ImportError('this is a stranger')\n")
    cache = tmp_path / "cache"
    environment = {**os.environ, "TROCAR_CACHE_DIR": str(cache), "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    for name in ("PYTHONPATH", "NUMBA_CACHE_DIR", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"):
        environment.pop(name, None)

    def run(*command: str | Path) -> str:
        done = subprocess.run(
            with_us([str(part) for part in command]),
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=900,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    run(sys.executable, "-m", "venv", tools.parent)
    run(tools / "pip", "download", "--quiet", "--dest", downloads, wheel_with_kernels)
    begin_s = time.monotonic()
    run(tools / "pip", "install", "--quiet", "--no-index", "--find-links", downloads, wheel_with_kernels)
    installed_s = time.monotonic()
    said = run(tools / "trocar", "up", "--seconds", "10")
    assert "is running: open http://" in said
    ran_s = time.monotonic()
    assert "N at most" in run(tools / "python", "-m", "trocar.examples.poke")
    ended_s = time.monotonic()
    left = {path.name for path in folder.iterdir()}
    assert left - {name.split("/")[0] for name in _STRANGERS} <= {"out"}, "it writes into the user's folder"
    assert _compiled(cache / "kernels", tools.parent) == set()
    took = installed_s - begin_s, ran_s - installed_s, ended_s - ran_s
    print("installed in {:.0f} s, a rig of ten seconds took {:.1f} s, the script {:.1f} s".format(*took))


def _compiled(kernels: Path, environment: Path) -> set[str]:
    """Return the files of kernels that did not come with the wheel."""
    (archive,) = environment.glob("lib/python*/site-packages/trocar/kernels/*.tar.zst")
    with (
        archive.open("rb") as packed,
        zstandard.ZstdDecompressor().stream_reader(packed) as plain,
        tarfile.open(fileobj=plain, mode="r|") as shipped,
    ):
        names = {member.name for member in shipped}
    return {str(path.relative_to(kernels)) for path in kernels.rglob("*.nbc")} - names
