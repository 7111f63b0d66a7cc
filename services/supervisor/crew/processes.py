"""The table of the rig's processes: how each is started, and how a hang of it is detected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

#: One thread each, because a pool of BLAS or numba threads would cost a 1 kHz loop its deadlines.
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "PYTHONUNBUFFERED": "1",
    "GLIBC_TUNABLES": "glibc.malloc.hugetlb=1",  # huge pages where offered: a tick begins with cold caches, see docs
    "LP_NUM_THREADS": "1",  # llvmpipe: with its default, software rendering takes 1.3 % of a 1 kHz loop's ticks
}


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """One process.

    Args:
        name, module: Name on the bus, and module run by ``python -m``.
        critical: Whether the rig is safe-stopped when it cannot be kept alive. The rig file may only lower this.
        starts_after: Processes that must have reported ready first.
        stream: A 1 kHz topic that it publishes, whose silence is noticed much sooner than the heartbeat's.
    """

    name: str
    module: str
    critical: bool = True
    starts_after: tuple[str, ...] = ()
    stream: str | None = None
    environment: Mapping[str, str] = field(default_factory=lambda: ENVIRONMENT)


#: Visualization and training need the modal basis that haptics builds, and would only wait for it. The gateway ticks
#: from its first second: on two cores it would take a quarter of the time while physics and haptics compile.
TABLE = (
    ProcessSpec("gateway", "trocar.services.gateway", starts_after=("haptics",), stream="gateway.state"),
    ProcessSpec("physics", "trocar.services.physics", stream="physics.state"),
    ProcessSpec("haptics", "trocar.services.haptics", stream="haptics.contact_model"),
    ProcessSpec("visualization", "trocar.services.visualization", critical=False, starts_after=("haptics",)),
    ProcessSpec("recorder", "trocar.services.recorder", critical=False),
    ProcessSpec("training", "trocar.services.training", critical=False, starts_after=("haptics",)),
)
