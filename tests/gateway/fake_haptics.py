"""A haptics process for tests: answers every device frame, with a force along z on each arm once it is active.

``python -m tests.gateway.fake_haptics RIG FORCE_N [PERIOD_S]``; with a period hands leave the contact and come back.
"""

from __future__ import annotations

import math
import sys
import time

from trocar.protocol.bodies import ContactModel, LocalModel
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config import config
from trocar.services.runtime.realtime import realtime

TTL_S, RAMP_S = 0.02, 0.3


def main(rig_file: str, force_n: float, period_s: float = math.inf) -> None:
    rig = config.load_rig(rig_file)
    settings = rig.process("haptics")
    realtime.set_up(settings.core, settings.priority)
    bus = ZmqBus(rig.transport, publishes=["haptics.contact_model"], reads=["gateway.state"])
    active_s: dict[str, float] = {}
    while True:
        if not bus.wait("gateway.state", time.monotonic_ns() + 100_000_000):
            continue
        frame = bus.latest("gateway.state")
        if frame is None:
            continue
        models = []
        for each in frame.body.instruments:
            active_s[each.name] = active_s.get(each.name, 0.0) + 1e-3 if each.state == "active" else 0.0
            share = min(1.0, active_s[each.name] / RAMP_S) * math.cos(math.pi * active_s[each.name] / period_s) ** 2
            force, torque = share * force_n, share * 0.05
            models.append(LocalModel(force_n=(0.0, 0.0, force), in_contact=force > 0.0, grasp_torque_nm=torque))
        body = ContactModel.of(frame.body.tick, TTL_S, models)
        bus.publish("haptics.contact_model", body, origin_ns=frame.origin_ns)


if __name__ == "__main__":
    main(sys.argv[1], *map(float, sys.argv[2:]))
