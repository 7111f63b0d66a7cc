"""Who looks on where there is no page: ``python -m services.supervisor.onlooker LINK``, by the supervisor only.

It keeps the machine's floor and the flights of missed ticks, as the page's process does beside its serving.
"""

from __future__ import annotations

import asyncio
import socket
import sys
from contextlib import closing

import protocol.bodies as bodies
from services.runtime.bus import Bus
from services.runtime.process import listen_as
from services.runtime.rig import Rig
from services.supervisor.around import Around
from services.supervisor.notes import Link, Notes, Opening

_PERIOD_S = 0.2
_OPENING_S = 10.0


def main(link_descriptor: int) -> int:
    """Look until the supervisor goes; return the exit code."""
    link = Link(socket.socket(fileno=link_descriptor))
    opening = link.wait(Opening, _OPENING_S)
    if opening is None:
        return 1
    rig = Rig.model_validate_json(opening.rig)
    with closing(Around(rig)) as around, closing(listen_as("supervisor", rig)) as bus:
        asyncio.run(_look(around, bus, link))
    return 0


async def _look(around: Around, bus: Bus, link: Link) -> None:
    said: Notes | None = None
    heard: dict[str, bodies.Health] = {}
    while True:
        try:
            while (new := link.receive(Notes)) is not None:
                said = new
        except ConnectionError:
            return
        if said is not None:
            for member in said.members:
                frame = bus.latest(f"{member.name}.health")
                if frame is not None:
                    heard[member.name] = frame.body
            await around.turn(said, heard)
        await asyncio.sleep(_PERIOD_S)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
