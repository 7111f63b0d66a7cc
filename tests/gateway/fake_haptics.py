"""A haptics process for tests: answers every device frame, with a force along z once the first arm is active.

``python -m tests.gateway.fake_haptics RIG FORCE_N``
"""

from __future__ import annotations

import sys
import time

from protocol.bodies import ContactModel, LocalModel
from services.runtime import config, realtime
from services.runtime.zmq_bus import ZmqBus

TTL_S, RAMP_S = 0.02, 0.3


def main(rig_file: str, force_n: float) -> None:
    rig = config.load_rig(rig_file)
    settings = rig.process("haptics")
    realtime.set_up(settings.core, settings.priority)
    bus = ZmqBus(rig.transport, publishes=["haptics.contact_model"], reads=["gateway.state"])
    active_s = 0.0
    while True:
        if not bus.wait("gateway.state", time.monotonic_ns() + 100_000_000):
            continue
        frame = bus.latest("gateway.state")
        if frame is None:
            continue
        active_s = active_s + 1e-3 if frame.body.instruments[0].state == "active" else 0.0
        force = force_n * min(1.0, active_s / RAMP_S)
        model = LocalModel(force_n=(0.0, 0.0, force), in_contact=force > 0.0, grasp_torque_nm=0.05 * force / force_n)
        body = ContactModel.of(frame.body.tick, TTL_S, (model,) * len(frame.body.instruments))
        bus.publish("haptics.contact_model", body, origin_ns=frame.origin_ns)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
