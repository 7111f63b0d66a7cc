"""Machine, versions, date, code and command, as they belong beside any number."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from statistics import median

from trocar.services.runtime.realtime.machine import processor_name
from trocar.studies.accuracy.study import Cost, Draw

PACKAGES = "numpy", "scipy", "numba"


@dataclass(frozen=True, slots=True)
class Facts:
    """What a table was made with."""

    command: str
    code: str
    seed: int
    size: str
    date: str
    machine: str
    system: str
    packages: str
    floors: dict[str, Cost]
    """Of the fixed arithmetic beside each study."""
    drift_percent: float = 0.0
    """Half the range of what it took over the run, of its median: how much slower or faster the machine itself was."""

    @classmethod
    def collect(cls, command: str, code: str, draw: Draw, floors: dict[str, Cost]) -> Facts:
        """Ask this machine."""
        return cls(
            command=command,
            code=code,
            seed=draw.seed,
            size=draw.size.value,
            date=f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
            machine=f"{processor_name()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}",
            system=f"{platform.system()} {platform.release()}, Python {platform.python_version()}",
            packages=", ".join(f"{name} {found}" for name, found in _versions(PACKAGES)),
            floors=floors,
            drift_percent=_drift_percent([cost.median_us for cost in floors.values()]),
        )

    def lines(self) -> list[str]:
        """Return them as lines for a reader."""
        floor = "; ".join(
            f"{name} {cost.median_us:.0f} us (99 % {cost.p99_us:.0f}, noise {cost.noise_us:.1f})"
            for name, cost in self.floors.items()
        )
        return [
            f"`{self.command}`, seed {self.seed}, code {self.code}, {self.date}",
            f"{self.machine}, {self.system}, {self.packages}",
            *([f"fixed arithmetic: {floor}"] if floor else []),
            *([self._drift()] if floor and self.drift_percent else []),
        ]

    def _drift(self) -> str:
        return (
            f"fixed arithmetic drifted by up to {self.drift_percent:.1f} % over the whole run: costs of two runs may "
            "differ by as much beyond their noise"
        )

    def as_data(self) -> dict[str, object]:
        """Return them for a program."""
        return asdict(self)


def _drift_percent(medians_us: Sequence[float]) -> float:
    if len(medians_us) < 2:
        return 0.0
    return 50.0 * (max(medians_us) - min(medians_us)) / median(medians_us)


def _versions(packages: Sequence[str]) -> list[tuple[str, str]]:
    found = []
    for name in packages:
        try:
            found.append((name, version(name)))
        except PackageNotFoundError:
            continue
    return found
