"""The observers without a page: ``python -m services.supervisor.observers LINK``, started by the supervisor only.

It runs where the packages of the page are missing, so that incidents are kept all the same.
"""

from __future__ import annotations

import socket
import sys
import time
from contextlib import closing

import protocol.bodies as bodies
from services.runtime.process import listen_as
from services.runtime.rig import Rig
from services.supervisor.observers.registry import Observers
from services.supervisor.page_link import Heartbeat, Link, PageSetup, RigStatus

_PERIOD_S = 0.2


def main(link_descriptor: int) -> int:
    """Observe until the supervisor goes; return the exit code."""
    link = Link(socket.socket(fileno=link_descriptor))
    setup = link.wait(PageSetup)
    if setup is None:
        return 1
    rig = Rig.model_validate_json(setup.rig)
    heard: dict[str, bodies.Health] = {}
    status: RigStatus | None = None
    with closing(Observers(rig)) as observers, closing(listen_as("supervisor", rig)) as bus:
        while True:
            try:
                status = link.newest(RigStatus) or status
            except ConnectionError:
                return 0
            if status is not None:
                for process in status.state.processes:
                    frame = bus.latest(f"{process.name}.health")
                    if frame is not None:
                        heard[process.name] = frame.body
                observers.sample(status, heard)
                link.send(Heartbeat(observers.said()))
            time.sleep(_PERIOD_S)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
