"""Readers of everything beside a rig: ``python benchmarks/rig_observers.py DIRECTORY reads|stops``.

One that ``reads`` takes every frame of every topic, twenty times a second; one that ``stops`` subscribes to all of them
and never takes one.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from trocar.protocol import TOPICS
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport


def main(directory: str, what: str) -> None:
    """Read until killed."""
    bus = ZmqBus(Transport(directory=Path(directory)), reads_every=TOPICS)
    while True:
        time.sleep(0.05)
        if what == "reads":
            for name in TOPICS:
                bus.drain(name)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", help="the rig's: transport.directory")
    parser.add_argument("what", choices=("reads", "stops"))
    main(**vars(parser.parse_args()))
