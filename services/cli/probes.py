"""Probes that may crash or hang, each in a process of its own: a wrong GL library ends Python without an exception."""

from __future__ import annotations

import ctypes.util
import os
import signal
import subprocess
import sys
from collections.abc import Iterator

from trocar.services.cli.host_checks import CheckResult, Verdict, finding
from trocar.services.start.off_screen import draw_off_screen

_PACKAGES = {"OpenGL": "libopengl0", "GL": "libgl1", "EGL": "libegl1", "Xrender": "libxrender1"}
_RENDER_S = 40.0  # assumption: importing VTK from a slow disk, and a picture drawn in software, take less

_RENDER = """
import pyvista, numpy
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64), lighting="none")
plotter.render_window.SetMultiSamples(0)
plotter.add_mesh(pyvista.Sphere(), color="white", lighting=False)
picture = plotter.screenshot(return_img=True)
assert numpy.asarray(picture).max() > 0, "the picture is black"
print(plotter.render_window.GetClassName())
"""


def graphics() -> Iterator[CheckResult]:
    """Check display, GL libraries, and one picture drawn off screen."""
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    advice = "the web page needs none; --viewer native does"
    yield finding("display", bool(display), display or "none", advice)
    missing = [package for name, package in _PACKAGES.items() if ctypes.util.find_library(name) is None]
    found = f"missing: {', '.join(missing)}" if missing else "all there"
    yield finding("GL libraries", not missing, found, f"apt install {' '.join(missing)}")
    environment = {"LP_NUM_THREADS": "1"}
    draw_off_screen(environment)
    yield probe("off-screen picture", _RENDER, _RENDER_S, environment, "native window, snapshots and MJPEG need it")


def probe(name: str, script: str, patience_s: float, environment: dict[str, str], advice: str) -> CheckResult:
    """Return what a script said that was run for no longer than `patience_s`; a crash is a finding too."""
    command = [sys.executable, "-W", "ignore", "-c", script]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=patience_s, env={**os.environ, **environment}, check=False
        )
    except subprocess.TimeoutExpired:
        return CheckResult(name, Verdict.WARN, f"no answer within {patience_s:.0f} s", advice)
    if done.returncode == 0:
        return CheckResult(name, Verdict.OK, done.stdout.strip())
    if done.returncode < 0:
        return CheckResult(name, Verdict.WARN, f"crashes with {signal.Signals(-done.returncode).name}", advice)
    last = (done.stderr.strip().splitlines() or ["failed"])[-1]
    return CheckResult(name, Verdict.WARN, last[:200], advice)
