"""docs/how-to/recipes.md: a scene, a device file and an observer of the bus, followed to the letter."""

from __future__ import annotations

import pytest

from tests.recipes.tree_copy import TreeCopy

pytestmark = pytest.mark.timeout(600)  # a changed copy of the tree compiles anew

#: Physics as the observer sees it, until nobody asks any more.
PHYSICS = """
import time
from trocar.services.runtime.config import config
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from tests.protocol.samples import physics_state
bus = ZmqBus(config.load_rig("rig.yaml").transport, publishes=["physics.state"])
for tick in range(1_000_000):
    bus.publish("physics.state", physics_state(tick), origin_ns=time.monotonic_ns())
    time.sleep(1e-3)
"""


def test_a_scene_is_a_file(tree: TreeCopy) -> None:
    tree.follow("Adding a scene")
    assert "soft-curve" in tree.run("bash", "-c", "trocar config show --scene nowhere 2>&1 || true")


def test_a_scenario_is_a_file(tree: TreeCopy) -> None:
    tree.follow("Adding a scenario")
    assert "On to the second marker: 18 mm within 240 s (scene insertion)" in tree.command("trocar scenarios")
    refused = tree.run(
        "bash", "-c", "sed -i s/depth_m/deep_m/ configs/scenarios/deep.yaml; trocar scenarios 2>&1 || true"
    )
    assert "deep.yaml: goal.deep_m: unknown key 'deep_m'" in refused


def test_a_device_file_is_what_a_rig_names(tree: TreeCopy) -> None:
    tree.follow("Adding a device file")
    told = tree.python(
        "from trocar.services.gateway.instruments.instrument import build_instruments\n"
        "from trocar.services.runtime.config import config\n"
        "print([each.arm.limits.max_force_n for each in build_instruments(config.load_rig('my-rig.yaml').gateway)])"
    )
    assert told.split() == ["[37.5,", "8.5]"]


def test_an_observer_is_a_program_beside_the_rig(tree: TreeCopy) -> None:
    tree.follow("Observing the bus")
    (tree.root / "rig.yaml").write_text("{name: r, transport: {directory: bus}}\n")
    with tree.start("-c", PHYSICS):
        # However long the publisher takes to be there.
        watch = "until python docs/examples/watch_tip.py rig.yaml > seen.txt; do :; done; cat seen.txt"
        seen = tree.run("bash", "-c", watch)
    assert [line.split()[0] for line in seen.splitlines()] == ["tick"] * 5
    assert "tip at [" in seen
