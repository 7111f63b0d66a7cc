"""The stand-in of ``libHD.so``, compiled from ``tests/gateway/hdapi/hdapi_standin`` by the system's compiler."""

from __future__ import annotations

import atexit
import ctypes
import functools
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.gateway.devices.bench import BenchUnavailable, SteppedClock
from trocar.services.gateway.devices.clock import REAL_TIME, Clock
from trocar.services.mechanics.arrays import FloatArray, LongArray

SOURCES = Path(__file__).resolve().with_name("hdapi_standin")
#: The devices that it has, by the names of the vendor's set-up; the first is the default one.
NAMES = ("Default Device", "Left", "Right")
_LOOK = 15


class StandInClock(SteppedClock):
    """Time that the stand-in shares: a millisecond that passes is a tick of its scheduler."""

    def __init__(self, c: ctypes.CDLL) -> None:
        self._c = c
        self.gettime_address = ctypes.cast(c.standin_gettime, ctypes.c_void_p).value
        super().__init__(lambda _now_s: c.standin_tick(ctypes.c_int64(self.monotonic_ns())))
        c.standin_tick(ctypes.c_int64(self.monotonic_ns()))


@dataclass(frozen=True, slots=True)
class Look:
    """What an arm of the stand-in does; force, position and velocity as HDAPI has its axes, in SI units."""

    force_n: FloatArray
    position_m: FloatArray
    velocity_m_s: FloatArray
    frames: int
    motors_on: bool
    calibrations: int
    scheduled: bool
    openings: int
    dropped: int


class HdapiStandIn:
    """A loaded stand-in. What it can be told is in ``scheduler.c``; `c` calls it.

    Attributes
    ----------
    clock : Clock
        Stepped, or real where its scheduler has a thread of its own.
    """

    def __init__(self, path: Path, threaded: bool) -> None:
        self.path = path
        self.c: Any = ctypes.CDLL(str(path))
        self.c.standin_durations.restype = ctypes.c_long
        self.c.standin_reset(int(threaded))
        self.clock: Clock = REAL_TIME if threaded else StandInClock(self.c)

    @classmethod
    @contextmanager
    def compiled(cls, folder: Path, threaded: bool = False) -> Iterator[HdapiStandIn]:
        """Put a stand-in of its own, which shares nothing with others, into `folder` and load it.

        Raises
        ------
        BenchUnavailable
            if there is no compiler.
        """
        yield cls(Path(shutil.copy(_compile(), folder / "libHD.so")), threaded)

    def look(self, arm: int) -> Look:
        """Return what an arm does."""
        out = np.zeros(_LOOK)
        self.c.standin_look(arm, ctypes.c_void_p(out.ctypes.data))
        frames, motors, calibrations, scheduled, openings, dropped = out[9:].astype(int).tolist()
        return Look(out[:3], out[3:6], out[6:9], frames, bool(motors), calibrations, bool(scheduled), openings, dropped)

    def force_n(self, arm: int) -> float:
        """Return the magnitude of the force on the hand."""
        return float(np.linalg.norm(self.look(arm).force_n))

    def put(self, hook: str, arm: int, point_m: FloatArray) -> None:
        """Call a hook that takes a point: ``place``, ``hand``."""
        point = np.array(point_m, np.float64)
        getattr(self.c, f"standin_{hook}")(arm, ctypes.c_void_p(point.ctypes.data))

    def durations_ns(self) -> LongArray:
        """Return how long the callbacks since the last call took."""
        out = np.zeros(1 << 16, np.int64)
        n = self.c.standin_durations(ctypes.c_void_p(out.ctypes.data), ctypes.c_long(len(out)))
        return out[:n]


@functools.cache
def _compile() -> Path:
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if compiler is None:
        raise BenchUnavailable("there is no C compiler (cc, gcc or clang) for the stand-in of libHD.so")
    sources = sorted(SOURCES.glob("*.c"))
    folder = tempfile.mkdtemp(prefix="trocar-hdapi-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    out = Path(folder) / "libHD.so"
    flags = ["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-pthread"]
    subprocess.run([compiler, *flags, *map(str, sources), "-o", str(out), "-lm"], check=True)
    return out
