"""A drive that runs is slow at no place of its heap: what a tick takes and gives back stays with the process.

Where a heap is trimmed, a buffer of a packer's size costs a millisecond a call at some places, for as long as the
process lives: huge locked pages are mapped and populated anew each time. So the process that runs is moved through
128 places, and in each tick takes and gives back such a buffer.
"""

from __future__ import annotations

import platform
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.patience import PATIENCE_S
from trocar.services.gateway import drivers
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.servo import servo_arrays
from trocar.services.gateway.simulated import drives
from trocar.services.runtime.config.rig import DriverSettings, Mount

_PLACES, _TICKS = 128, 5
_PYTHON = sys.executable
#: Where the system offers huge pages on request, glibc grows its heap by one and trims that at 8 places of 128; the two
#: thresholds, which are those that a heap ends up with or begins with, make it trim on any system.
_TRIMMING = "glibc.malloc.hugetlb=1:glibc.malloc.mmap_threshold=33554432:glibc.malloc.trim_threshold=131072"
#: Stands between the drive's loop and its sleep.
_RUN = """
import ctypes, resource, sys, time, types
from trocar.services.gateway.simulated import drive_process
from trocar.services.runtime.realtime import realtime
{prepare}
libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
libc.free.argtypes = [ctypes.c_void_p]
turn, faults, slow = 0, [], 0

def sleep(seconds):
    global turn, faults, slow
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    libc.free(libc.malloc(1 << 18))  # what a packer's buffer takes and gives back
    faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
    turn += 1
    if turn % {ticks} == 0:
        slow += min(faults[1:]) > 0
        faults = []
        libc.malloc(16384 - 16)  # kept: moves the heap's top
    if turn == {places} * {ticks}:
        with open("{result}", "w") as file:
            file.write(str(slow))
    time.sleep(seconds)

drive_process.time = types.SimpleNamespace(sleep=sleep, monotonic_ns=time.monotonic_ns)
drive_process.main(int(sys.argv[1]), int(sys.argv[2]))
"""


def _slow_places(folder: Path, prepare: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """Return at how many places of its heap a drive that runs meets new pages in every tick."""
    result, code = folder / "slow", folder / "run.py"
    code.write_text(_RUN.format(prepare=prepare, places=_PLACES, ticks=_TICKS, result=result))
    starter = folder / "python"
    starter.write_text(f'#!/bin/sh\nexec {_PYTHON} {code} "$3" "$4" # after -m and the module\n')
    starter.chmod(0o700)
    monkeypatch.setattr(drives.sys, "executable", str(starter))
    settings = {"recording": "none", "core": 0, "priority": 5}
    chosen = DriverSettings(driver="grasp_simulated", device="grasp_odrive", settings=settings)
    handle = drivers.load_grasp(chosen, Place("left", Mount()))
    read = np.zeros(servo_arrays.HANDLE_SIZE)
    try:
        handle.open()
        deadline_s = time.monotonic() + PATIENCE_S
        while not (result.exists() and result.read_text()):
            assert time.monotonic() < deadline_s
            assert "CAN: " not in handle.fault  # silent for longer than a drive may be it is beside other work
            handle.read(time.monotonic_ns(), read)
            handle.write(0.0)
            time.sleep(2e-3)
    finally:
        handle.close()
    return int(result.read_text())


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the heap of another C library is not known")
def test_a_drive_that_runs_meets_no_new_page_wherever_its_heap_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GLIBC_TUNABLES", _TRIMMING)
    trimmed, kept = tmp_path / "trimmed", tmp_path / "kept"
    trimmed.mkdir()
    kept.mkdir()
    trim = "realtime.keep_heap = lambda: realtime.Fact('heap', '', '', True)"
    if _slow_places(trimmed, trim, monkeypatch) == 0:
        pytest.skip(f"glibc {platform.libc_ver()[1]} meets no new page here even where its heap is trimmed")
    assert _slow_places(kept, "", monkeypatch) == 0
