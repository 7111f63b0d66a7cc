"""``trocar down``: end a rig of this host, whether its supervisor lives or not."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.bus.endpoints import lock_holders
from trocar.services.runtime.bus.stop_line import stop_path
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig, Transport
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.measures.flight import remove_rings
from trocar.services.supervisor import frozen_configuration
from trocar.services.supervisor.crew.crew import END_S
from trocar.services.supervisor.page.command_socket import control_path
from trocar.services.supervisor.page.page_place import page_file

_SUPERVISOR_S = (
    3 * END_S
)  # it ends the loops at once, then the gateway, then its helpers, which take `END_S` at most each


def run_down(rig_name: str, overrides: tuple[str, ...], as_json: bool) -> None:
    """End every process that publishes for the rig: the supervisor first, which ends the others in order."""
    rig = config.load_rig(rig_name, overrides)
    found = lock_holders(rig.transport)
    ended = end_all(rig, found)
    if as_json:
        print(json.dumps({"ended": ended}))
    elif ended:
        print(f"ended {', '.join(ended)}", file=sys.stderr)
    else:
        print("no rig is running", file=sys.stderr)


def end_all(rig: Rig, found: dict[str, int]) -> list[str]:
    """End the processes in `found`; return their names. Raises UserError naming one that cannot be ended."""
    supervisor = {name: pid for name, pid in found.items() if name == "supervisor"}
    _end(supervisor, _SUPERVISOR_S)
    left = lock_holders(rig.transport)
    _end({name: pid for name, pid in left.items() if name != "gateway"}, END_S)
    _end({name: pid for name, pid in left.items() if name == "gateway"}, END_S)
    _remove_files(rig.transport)
    return list(found)


def _remove_files(transport: Transport) -> None:
    """Remove what a supervisor that is killed, or attached, leaves; raise UserError if the rig is still alive."""
    deadline = time.monotonic() + END_S
    while (alive := lock_holders(transport)) and time.monotonic() < deadline:
        time.sleep(0.02)  # the kernel has not ended who was killed
    if alive:
        who = ", ".join(f"{name} (process {pid})" for name, pid in alive.items())
        raise UserError(f"still alive: {who}; the files of the rig are kept")
    with endpoints.all_claimed(transport) as directory:
        endpoints.remove_sockets(directory)
        remove_rings(directory)
        for path in (control_path(transport), stop_path(transport), page_file(transport)):
            path.unlink(missing_ok=True)
        frozen_configuration.remove(transport)


def _end(processes: dict[str, int], patience_s: float) -> None:
    """Ask all to end, wait, kill who remains. A stopped process cannot hear it: it is continued."""
    for name, pid in processes.items():
        _signal(name, pid, signal.SIGTERM)
        _signal(name, pid, signal.SIGCONT)
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline and any(_alive(processes.values())):
        time.sleep(0.02)
    for name, pid in processes.items():
        if any(_alive([pid])):
            _signal(name, pid, signal.SIGKILL)


def _alive(pids: Iterable[int]) -> Iterable[bool]:
    for pid in pids:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            yield False
        else:
            yield state != "Z"


def _signal(name: str, pid: int, number: signal.Signals) -> None:
    with suppress(ProcessLookupError):
        try:
            os.kill(pid, number)
        except PermissionError:
            raise UserError(f"{name} (process {pid}) belongs to another user and cannot be ended") from None
