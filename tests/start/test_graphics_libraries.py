"""Where the system lacks what VTK draws by, there is a sentence: VTK itself ends Python by a signal."""

import ctypes.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from trocar.services.start.off_screen import draw_off_screen

_DRAW = """
from trocar.services.runtime.errors import UserError
from trocar.services.visualization.render import Renderer
try:
    Renderer(off_screen=True).plotter.screenshot(return_img=True)
except UserError as error:
    print(error)
"""


def _path_of(library: str) -> Path | None:
    """Return the file of a library of this system, without opening it."""
    for line in subprocess.run(["ldconfig", "-p"], capture_output=True, text=True, check=True).stdout.splitlines():
        if line.split()[:1] == [library]:
            return Path(line.rpartition("=> ")[2]).resolve()
    return None


def _drawn_without(library: str, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """Draw in a process that finds an empty file in the library's place."""
    path = _path_of(library)
    if path is None:
        pytest.skip(f"{library} is not installed here")
    unshare = [shutil.which("unshare") or "unshare", "--user", "--map-root-user", "--mount"]
    if subprocess.run([*unshare, "true"], capture_output=True, check=False).returncode:
        pytest.skip("this kernel lets nobody make a mount namespace (unshare --user --mount)")
    script = f'mount --bind /dev/null "{path}" && exec "$@"'
    return subprocess.run(
        [*unshare, "sh", "-c", script, "sh", sys.executable, "-c", _DRAW],
        capture_output=True, text=True, env={**os.environ, **environment}, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("library", "package", "off_screen"),
    [("libEGL.so.1", "libegl1", True), ("libX11.so.6", "libx11-6", False), ("libEGL_mesa.so.0", "libegl-mesa0", True)],
)
def test_a_picture_without_a_library_is_refused_in_a_sentence(library: str, package: str, off_screen: bool) -> None:
    environment: dict[str, str] = {}
    if off_screen:
        draw_off_screen(environment)
    if ctypes.util.find_library("OSMesa"):
        pytest.skip("this system has OSMesa, by which VTK draws in the end")
    done = _drawn_without(library, environment)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("drawing a picture needs ")
    assert f"apt install {package}" in done.stdout
