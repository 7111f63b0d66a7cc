"""Where a driver runs without its device: its settings, its clock, and what the stand-in of its device feels.

Every driver has a file of its name in ``tests/gateway/benches`` with a function ``bench`` that says so; the contract
suite asks for it.
"""

from __future__ import annotations

import csv
import importlib
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from trocar.services.gateway.devices.clock import Clock
from trocar.services.runtime.config.rig import DriverSettings

TICK_S = 1e-3
_TICK_NS = 1_000_000


class SteppedClock:
    """Time that passes only while somebody sleeps, in whole milliseconds: exact, and as quick as what happens in it.

    Parameters
    ----------
    on_tick
        Called with the time in seconds after each millisecond: what else goes on meanwhile.
    """

    def __init__(self, on_tick: Callable[[float], None] = lambda _now_s: None) -> None:
        self._now_ns = 5_000 * _TICK_NS
        self._on_tick = on_tick

    def monotonic_ns(self) -> int:
        """Return the present time."""
        return self._now_ns

    def sleep(self, seconds: float, /) -> None:
        """Let `seconds`, at least a millisecond, pass."""
        for _ in range(max(1, round(seconds / TICK_S))):
            self._now_ns += _TICK_NS
            self._on_tick(self._now_ns * 1e-9)


class BenchUnavailable(Exception):  # noqa: N818 - nothing is wrong with the driver
    """What a bench needs is not on this host; the message says what."""


@dataclass(frozen=True, slots=True)
class Bench:
    """One driver on the bench.

    Attributes
    ----------
    settings
        The driver as a rig file would name it.
    output
        Returns for the driver, when it has been made, the magnitude of the force (N) or torque (N m) that its device
        applies to the hand now, as the stand-in of the device measures it. A device that only measures applies 0.
    clock
        The time of driver and stand-in: real only where a process or a thread of its own stands in for the device.
    """

    settings: DriverSettings
    output: Callable[[Any], float]
    clock: Clock = field(default_factory=SteppedClock)


def no_output(_device: object) -> float:
    """Return what a device applies that only measures."""
    return 0.0


def write_recording(folder: Path, **columns: tuple[float, ...]) -> Path:
    """Write `columns` as a recording into `folder` and return the file."""
    path = folder / "recording.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(columns)
        rows.writerows(zip(*columns.values(), strict=True))
    return path


def open_bench(name: str, folder: Path) -> AbstractContextManager[Bench]:
    """Return the bench of a driver, to be entered; files that it needs go into `folder`.

    Raises
    ------
    BenchUnavailable
        when it is entered, if this host lacks what it needs.
    """
    bench = importlib.import_module(f"tests.gateway.benches.{name}").bench
    return cast(AbstractContextManager[Bench], bench(folder))
