"""The stand-in of ``libdhd.so``, compiled from ``tests/gateway/devices/dhd_standin`` by the system's compiler."""

from __future__ import annotations

import atexit
import ctypes
import functools
import math
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import c_double, c_int
from pathlib import Path
from typing import Any

import numpy as np

from tests.gateway.devices.bench import BenchUnavailable
from trocar.services.mechanics.arrays import FloatArray

SOURCE = Path(__file__).resolve().with_name("dhd_standin") / "dhd.c"
GRIP = 6
_MOST = 1 << 16


class DhdStandIn:
    """A loaded stand-in; `c` calls its hooks."""

    def __init__(self, path: Path, devices: int) -> None:
        self.path = path
        self.c: Any = ctypes.CDLL(str(path))
        self.c.standin_force.restype = c_double
        self.c.standin_place.argtypes = (c_int, c_double, c_double, c_double)
        self.c.standin_turn.argtypes = self.c.standin_open.argtypes = (c_int, c_double)
        self.c.standin_reset(devices)

    @classmethod
    @contextmanager
    def compiled(cls, folder: Path, devices: int = 1) -> Iterator[DhdStandIn]:
        """Put a stand-in of its own, which shares nothing with others, into `folder` and load it.

        Raises
        ------
        BenchUnavailable
            if there is no compiler.
        """
        yield cls(Path(shutil.copy(_compile(), folder / "libdhd.so")), devices)

    def force(self, device: int = 0) -> FloatArray:
        """Return the force on the hand."""
        return np.array([self.c.standin_force(device, axis) for axis in range(3)])

    def force_n(self, device: int = 0) -> float:
        return float(math.hypot(*self.force(device).tolist()))

    def grip_n(self, device: int = 0) -> float:
        return float(self.c.standin_force(device, GRIP))

    def log(self) -> FloatArray:
        """Return the forces on the hand with each that the first device was given."""
        return self._log()[:, :3]

    def grip_log(self) -> FloatArray:
        """Return the forces of its gripper, likewise, each as a vector along one axis."""
        return self._log()[:, 3:] * [1.0, 0.0, 0.0]

    def _log(self) -> FloatArray:
        out = np.zeros((_MOST, 4))
        return out[: self.c.standin_log(ctypes.c_void_p(out.ctypes.data), _MOST)]


@functools.cache
def _compile() -> Path:
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if compiler is None:
        raise BenchUnavailable("there is no C compiler (cc, gcc or clang) for the stand-in of libdhd.so")
    folder = tempfile.mkdtemp(prefix="trocar-dhd-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    out = Path(folder) / "libdhd.so"
    flags = ["-std=gnu11", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-pthread"]
    subprocess.run([compiler, *flags, str(SOURCE), "-o", str(out), "-lm"], check=True)
    return out
