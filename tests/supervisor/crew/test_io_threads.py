"""The bus' threads of this process, idle and flooded."""

from __future__ import annotations

import time

import zmq

from tests.patience import PATIENCE_S
from trocar.services.supervisor.crew.runqueue_waits import OwnIoThreads


def test_an_idle_bus_has_heard_everything_a_flooded_one_has_not() -> None:
    context = zmq.Context()
    context.linger = 0
    try:
        sender, receiver = context.socket(zmq.PUB), context.socket(zmq.SUB)
        receiver.conflate = True
        receiver.setsockopt(zmq.SUBSCRIBE, b"")
        port = sender.bind_to_random_port("tcp://127.0.0.1")
        receiver.connect(f"tcp://127.0.0.1:{port}")
        until = time.monotonic() + PATIENCE_S
        while not receiver.poll(10):  # they have met
            assert time.monotonic() < until
            sender.send(b"")
        threads = OwnIoThreads()
        while not all(threads.are_idle() for _ in range(10) if time.sleep(2e-3) is None):
            assert time.monotonic() < until, "nothing is sent, and they are never idle"
        is_idle = True
        while is_idle:
            assert time.monotonic() < until, "they carry more than they can, and are always idle"
            for _ in range(200):
                sender.send(bytes(2000))
            is_idle = threads.are_idle()
        while not threads.are_idle():
            assert time.monotonic() < until, "all has been carried, and they are not idle"
        threads.close()
    finally:
        context.destroy(linger=0)
