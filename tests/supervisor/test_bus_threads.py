"""The bus' threads of this process, idle and flooded."""

from __future__ import annotations

import time

import zmq

from services.supervisor.bus_threads import BusThreads


def test_an_idle_bus_has_heard_everything_a_flooded_one_mostly_not() -> None:
    context = zmq.Context()
    context.linger = 0
    try:
        sender, receiver = context.socket(zmq.PUB), context.socket(zmq.SUB)
        receiver.conflate = True
        receiver.setsockopt(zmq.SUBSCRIBE, b"")
        port = sender.bind_to_random_port("tcp://127.0.0.1")
        receiver.connect(f"tcp://127.0.0.1:{port}")
        time.sleep(0.1)
        threads = BusThreads()
        idle = [threads.are_idle() for _ in range(50) if time.sleep(2e-3) is None]
        flooded = []
        for _ in range(200):
            for _ in range(200):
                sender.send(bytes(2000))
            flooded.append(threads.are_idle())
        threads.close()
    finally:
        context.destroy(linger=0)
    assert sum(idle) > 40
    assert sum(flooded) < 100
