"""The recipes "Adding a topic" and "Changing a body", followed to the letter: a frame goes where the row says."""

from __future__ import annotations

import json

import pytest

from tests.recipes.tree_copy import TreeCopy

pytestmark = pytest.mark.timeout(600)  # a changed copy of the tree compiles anew

#: Physics sends; haptics reads, visualization and the supervisor observe, each with the sockets that its process opens.
RUN = """
import json, sys, threading, time
from trocar.protocol.arrays import pack
from trocar.protocol.bodies.physics import Temperature
from trocar.services.runtime.process.process import Options, load_process_config, open_process

def opened(name):
    return open_process(load_process_config(name, Options("rig.yaml", None, ())))

physics, haptics, visualization, supervisor = map(opened, ("physics", "haptics", "visualization", "supervisor"))
topic, body = "physics.temperature", Temperature(tick=7, node=pack([3], "<i4"), temperature_k=pack([311.0]))
def send():  # the only user of this bus until it is over
    while not over.is_set():
        physics.bus.publish(topic, body, origin_ns=time.monotonic_ns())
        time.sleep(1e-3)

over = threading.Event()
sender = threading.Thread(target=send)
sender.start()
found = {}
until_s = time.monotonic() + float(sys.argv[1])
while not supervisor.stop() and time.monotonic() < until_s and len(found) < int(sys.argv[2]):
    frame = haptics.bus.latest(topic)
    if frame is not None and haptics.bus.is_fresh(topic):
        found["haptics"] = frame.body == body
    for observer in (visualization, supervisor):
        for frame in observer.bus.sample([topic], time.monotonic_ns() + 50_000_000).values():
            found[observer.name] = frame.body == body
over.set()
sender.join()
from trocar.services.supervisor.page import dashboard
from trocar.services.supervisor.judge import figures
from tests.health_reports import report_of
windows = {name: figures.of(report_of(each.health)) for name, each in (("physics", physics), ("haptics", haptics))}
found["dashboard"] = [row.publisher for row in dashboard.topic_rows(windows) if row.topic == topic]
print(json.dumps(found))
"""

READ = """
import sys
from pathlib import Path
from trocar.services.recordings.reader import read_messages
messages = list(read_messages(next(Path("recordings").glob("*.mcap")), ["physics.temperature"]))
body = messages[0][2]
print(len(messages), body.tick, body.temperature_k.view().tolist())
"""


WAIT = """
import time
from trocar.services.runtime.config import config
from trocar.services.runtime.bus.zmq_bus import ZmqBus
bus = ZmqBus(config.load_rig("rig.yaml").transport, reads=["recorder.health"])
recorded, until_ns = 0, time.monotonic_ns() + 400_000_000_000
while recorded < 10 and bus.wait("recorder.health", until_ns):
    for frame in bus.drain("recorder.health"):
        recorded = frame.body.gauges.get("recorded_frames", 0)
assert recorded >= 10, recorded
"""


@pytest.fixture(scope="module")
def recipe(tree_of_module: TreeCopy) -> TreeCopy:
    rig = "{name: r, transport: {directory: bus}, recorder: {directory: recordings}}\n"
    (tree_of_module.root / "rig.yaml").write_text(rig)
    tree_of_module.follow("Adding a topic")
    return tree_of_module


def test_a_frame_goes_from_the_publisher_to_everybody_whom_the_row_names(recipe: TreeCopy) -> None:
    told = json.loads(recipe.python(RUN, "400", "3"))
    assert told == {"haptics": True, "visualization": True, "supervisor": True, "dashboard": ["physics"]}
    recipe.pytest("tests/runtime/bus/test_sockets_of_processes.py")


def test_it_is_recorded_sniffed_and_written_down(recipe: TreeCopy) -> None:
    with recipe.start("-m", "trocar.services.recorder", "--rig", "rig.yaml"), recipe.start("-c", RUN, "900", "99"):
        sniffed = recipe.command("trocar sniff physics.temperature --rig rig.yaml --count 3 --json")
        recipe.python(WAIT)
    assert json.loads(sniffed.splitlines()[0])["body"]["temperature_k"]["values"] == [311.0]
    count, tick, temperature_k = recipe.python(READ).split()
    assert int(count) > 0
    assert (tick, temperature_k) == ("7", "[311.0]")
    assert "| `physics.temperature` | haptics |" in (recipe.root / "docs" / "reference" / "wire.md").read_text()


def test_its_body_changes_and_old_bytes_are_still_understood(recipe: TreeCopy) -> None:
    """Last of all, as the topic's body is another from then on."""
    recipe.follow("Changing a body")
    lifted = recipe.python(
        "from pathlib import Path; from trocar import protocol;"
        "old = Path('tests/protocol/golden/physics.temperature.v1.msgpack').read_bytes();"
        "print(protocol.decode(old).body.rise_k.view() + 310.15)"
    )
    assert lifted.split() == ["[3.", "4.]"]
