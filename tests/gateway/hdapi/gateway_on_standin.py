"""A gateway process on the stand-in of OpenHaptics, whose hooks are called by lines on its standard input.

``python -m tests.gateway.hdapi.gateway_on_standin LIBRARY --rig FILE``; a line is a hook and its numbers: ``pull 1``.
"""

from __future__ import annotations

import ctypes
import sys
from threading import Thread

from trocar.services.gateway import __main__ as gateway
from trocar.services.runtime.process.process import main


def obey(library: str) -> None:
    c = ctypes.CDLL(library)  # the same that the driver has loaded, and it stays loaded
    for line in sys.stdin:
        hook, *numbers = line.split()
        getattr(c, f"standin_{hook}")(*map(int, numbers))


if __name__ == "__main__":
    Thread(target=obey, args=(sys.argv.pop(1),), daemon=True).start()
    sys.exit(main("gateway", gateway.run, prepare=gateway.prepare))
