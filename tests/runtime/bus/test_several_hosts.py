"""The bus of a rig on several hosts: what is near goes without TCP, what is far is heard however long the way is."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.ports import base_port
from tests.runtime.bus.between import Between
from trocar.protocol import bodies
from trocar.services.runtime.bus.clocks import ClockOffset
from trocar.services.runtime.bus.endpoints import endpoint
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport

STATE, MODEL = "gateway.state", "haptics.contact_model"
PORT = base_port(24_000)
NOWHERE = "192.0.2.7"  # of RFC 5737: nobody has it
Eventually = Callable[[Callable[[], bool]], None]


def _bus(stack: ExitStack, transport: Transport, **topics: list[str]) -> ZmqBus:
    bus = ZmqBus(transport, **topics)
    stack.callback(bus.close)
    return bus


def _say(bus: ZmqBus, tick: int) -> None:
    bus.publish(STATE, bodies.GatewayState(tick=tick))
    bus.flush()


def test_processes_at_one_address_speak_without_tcp_and_others_hear_them_by_it(
    stack: ExitStack, tmp_path: Path, eventually: Eventually
) -> None:
    """Between two loops of the bench each frame went through four more threads and was encrypted: 1 ms for 0.4."""
    bench = Transport(
        kind="tcp", base_port=PORT, host=NOWHERE, bind_host="127.0.0.1", insecure=True, directory=tmp_path / "bench"
    )
    elsewhere = Transport(kind="tcp", base_port=PORT, directory=tmp_path / "elsewhere")
    gateway = _bus(stack, bench, publishes=[STATE])
    haptics = _bus(stack, bench, publishes=[MODEL], reads=[STATE])
    observer = _bus(stack, elsewhere, reads=[STATE])
    heard: set[str] = set()

    def both() -> bool:
        _say(gateway, 1)
        heard.update(name for name, bus in (("near", haptics), ("far", observer)) if bus.latest(STATE) is not None)
        return len(heard) == 2

    eventually(both)
    assert haptics.is_near(STATE)
    assert gateway.has_reader(STATE)


@pytest.mark.parametrize("way_s", [0.0, 0.05])
def test_what_is_sampled_far_away_is_heard_however_long_the_way_is(
    stack: ExitStack, way_s: float, eventually: Eventually
) -> None:
    """Each turn subscribed, waited for 10 ms and took its word back: a gateway 5 ms away was called silent."""
    tcp = Transport(kind="tcp", base_port=PORT)
    between = Between(int(endpoint(tcp, STATE).rpartition(":")[2]))
    between.delay_s = way_s
    stack.callback(between.close)
    sender = _bus(stack, tcp, publishes=[STATE])
    reader = _bus(stack, Transport(kind="tcp", base_port=PORT + between.shift), samples=[STATE])
    reader._in[STATE].clock = ClockOffset()  # of another host, and not known
    ticks: list[int] = []

    def sampled() -> bool:
        _say(sender, len(ticks))
        frame = reader.sample([STATE], time.monotonic_ns() + 10_000_000).get(STATE)
        ticks.append(frame.body.tick if frame is not None else -1)
        return len({tick for tick in ticks if tick >= 0}) > 5

    eventually(sampled)
