"""The live door beside a rig, with two viewers: ``python benchmarks/door_viewers.py DIRECTORY``.

It serves the rig as `trocar foxglove` does. One viewer reads every channel; one subscribes to all and never reads.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys

from report import end_in_good_order
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

PROTOCOL = Subprotocol("foxglove.sdk.v1")


def subscribe(viewer: ClientConnection) -> None:
    """Subscribe to every channel that is told within a second."""
    while True:
        try:
            said = viewer.recv(timeout=1.0)
        except TimeoutError:
            return
        if isinstance(said, bytes):
            return
        channels = [each["id"] for each in json.loads(said).get("channels", ())]
        wanted = [{"id": each, "channelId": each} for each in channels]
        if wanted:
            viewer.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


def main(directory: str) -> None:
    """Serve and look until killed; then the door is ended, too."""
    end_in_good_order()
    options = ["foxglove", "--port", "0", "--set", f"transport.directory={directory}"]
    command = [sys.executable, "-c", "from trocar.services.cli.app import main; main()", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as door:
        try:
            assert door.stdout is not None
            address = next(word.rstrip(":") for word in door.stdout.readline().split() if word.startswith("ws://"))
            with connect(address, subprotocols=[PROTOCOL]) as deaf, connect(address, subprotocols=[PROTOCOL]) as reads:
                for viewer in (deaf, reads):
                    subscribe(viewer)
                for _ in reads:
                    pass
        finally:
            door.terminate()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", help="the rig's: transport.directory")
    main(**vars(parser.parse_args()))
