"""A recording of haptics and physics in memory, whose ticks are late and lost by chance, as on a busy host.

At its start, and later, the rig's time stands for a while, and hands go on; the scene begins again once.
"""

from __future__ import annotations

import time
from pathlib import Path

import msgspec
import numpy as np
import yaml

from tests.memory_bus import MemoryBus
from tests.physics.conftest import PORTS, SMALL, Rig
from trocar.protocol import Frame, topic
from trocar.protocol.bodies import GatewayState, InstrumentState
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings.provenance import machine, mechanics_digest
from trocar.services.runtime.bus import bus
from trocar.services.runtime.config import config

LADDER = "quality=[{name: full}, {name: steps of 2 ms, ticks_per_step: 2}]"
RECORDED = ("gateway.state", "haptics.journal", "physics.journal", "physics.state", "haptics.contacts")
SEEN_EVERY = 20  # states and contacts that are kept
STANDS = dict.fromkeys((0, 240, 620), 7)  # frames of a tick at which time stands
BEGINS = 621


def record(path: Path, rig: Rig, ticks: int, seed: int = 0) -> Path:
    """Let jaws close on the wall while ticks get lost, and record it."""
    chance = np.random.default_rng(seed)
    metadata = {"mechanics": mechanics_digest(), "machine": machine(), "scene": "small"}
    writer = RecordingWriter(path, metadata)
    writer.attach("scene.yaml", "application/yaml", yaml.safe_dump(config.read_scene(SMALL, [LADDER])).encode())
    listener = MemoryBus(rig.hub, reads_every=RECORDED)
    out = bus.Outbox(topic("gateway.state"), 1)
    is_fresh = rig.haptics_process.bus.is_fresh
    for tick in (each for each in range(ticks) for _ in range(STANDS.get(each, 1))):
        state = _hands(tick, chance)
        rig.hub.send("gateway.state", out.seal(state, time.monotonic_ns(), True))
        if chance.random() < 0.05:
            continue  # haptics misses it
        frame = rig.haptics_process.bus.latest("gateway.state")
        assert frame is not None
        rig.haptics_process.bus.is_fresh = lambda *names: chance.random() > 0.02 and is_fresh(*names)
        rig.haptics.answer(frame)
        rig.haptics.do_side_work()
        if chance.random() < 0.05:
            continue  # physics has the next one
        contacts = rig.physics_process.bus.latest("haptics.contacts")
        if contacts is None:
            continue
        if tick % 300 == 150:
            rig.physics.obey(tick // 300 % 2)
        rig.physics.advance(contacts, rig.clock.steps(contacts.body.tick))
        rig.physics.do_side_work()
    rig.haptics._journal.send()
    rig.physics._journal.send()
    for name in RECORDED:
        while True:
            frames = listener.drain(name)
            for each in frames:
                if name not in RECORDED[-2:] or each.body.tick % SEEN_EVERY == 0:
                    writer.write(each)
            if not frames:
                break
    writer.close()
    return path


def _hands(tick: int, chance: np.random.Generator) -> GatewayState:
    """Return two tools: one presses on the duct and closes its jaws, the other trembles far away."""
    depth = 0.011 - 0.006 * min(1.0, tick / 400)
    hips = (0.02, 1e-4 * float(chance.standard_normal()), depth), (0.02, -0.05, 0.08 + 1e-3 * float(chance.random()))
    handle = max(0.0, 0.6 - tick / 800)
    instruments = tuple(
        InstrumentState(name=str(i), position_m=hip, port_m=PORTS[i], handle_angle_rad=handle)
        for i, hip in enumerate(hips)
    )
    return GatewayState(tick=tick, instruments=instruments, begins=int(tick >= BEGINS))


def changed(frame: Frame, by_m: float) -> Frame:
    """Return a device frame with the first tool moved along x."""
    first, *others = frame.body.instruments
    x, y, z = first.position_m
    moved = msgspec.structs.replace(first, position_m=(x + by_m, y, z))
    return msgspec.structs.replace(frame, body=msgspec.structs.replace(frame.body, instruments=(moved, *others)))
