"""The running rig in Foxglove: what a viewer of the protocol gets from a server of its own, and who may look."""

from __future__ import annotations

import asyncio
import base64
import json
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest
import websockets
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from tests.cli.conftest import Trocar
from tests.patience import PATIENCE_S
from tests.protocol import samples
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config import config

pytest.importorskip("foxglove", reason="the foxglove extra is not installed")
_PROTOCOL = "foxglove.sdk.v1"


@contextmanager
def gateway_speaks(rig_file: Path) -> Iterator[None]:
    """Publish the sample of a device frame a thousand times a second, its tick counted up."""
    bus, ending = ZmqBus(config.load_rig(rig_file).transport, publishes=["gateway.state"]), threading.Event()
    body = samples.frame("gateway.state").body

    def speak() -> None:
        tick = 0
        while not ending.wait(1e-3):
            tick += 1
            bus.publish("gateway.state", msgspec.structs.replace(body, tick=tick))
            bus.flush()

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()
        bus.close()


@contextmanager
def served(rig_file: Path) -> Iterator[str]:
    """Serve the rig; yield the address that is told."""
    code = "from trocar.services.cli.app import main; main()"
    arguments = ["foxglove", "--rig", str(rig_file), "--port", "0"]
    with subprocess.Popen([sys.executable, "-c", code, *arguments], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield next(word.rstrip(":") for word in process.stdout.readline().split() if word.startswith("ws://"))
        finally:
            process.send_signal(signal.SIGTERM)
            assert process.wait(PATIENCE_S) == 0


async def _look(address: str, count: int) -> tuple[dict[str, Any], dict[str, Any], list[tuple[int, Any]]]:
    """Return what the server says of itself, the channel of devices, and so many messages of it, each with its time."""
    async with websockets.connect(address, subprotocols=[websockets.Subprotocol(_PROTOCOL)]) as viewer:
        about, channel, messages = dict[str, Any](), dict[str, Any](), list[tuple[int, Any]]()
        kind: Any = None
        while len(messages) < count:
            said = await asyncio.wait_for(viewer.recv(), PATIENCE_S)
            if isinstance(said, bytes):
                _, _, time_ns = struct.unpack_from("<BIQ", said)
                messages.append((time_ns, kind.FromString(said[13:])))
                continue
            told = json.loads(said)
            about = told if told["op"] == "serverInfo" else about
            for each in told.get("channels", ()):
                if each["topic"] == "/gateway/state":
                    channel, kind = each, _message_class(each)
                    wanted = {"id": 1, "channelId": each["id"]}
                    await viewer.send(json.dumps({"op": "subscribe", "subscriptions": [wanted]}))
        return about, channel, messages


def _message_class(channel: dict[str, Any]) -> Any:
    """Return the class of the messages of a channel, by nothing but what it tells of them."""
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)  # type: ignore[no-untyped-call]
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))  # type: ignore[no-untyped-call]


def test_a_viewer_gets_new_frames_at_its_own_rate_and_can_send_nothing(rig_file: Path) -> None:
    with gateway_speaks(rig_file), served(rig_file) as address:
        began_s = time.monotonic()
        about, channel, messages = asyncio.run(_look(address, 20))
        took_s = time.monotonic() - began_s
    assert about["capabilities"] == []
    assert (channel["encoding"], channel["schemaName"]) == ("protobuf", "trocar.GatewayState")
    ticks = [message.tick for _, message in messages]
    assert ticks == sorted(set(ticks)), "each frame once"
    assert took_s > 19 / 31.0, "30 a second, not a thousand"
    body = samples.frame("gateway.state").body
    assert messages[0][1].instruments[0].name == body.instruments[0].name
    assert abs(messages[-1][0] * 1e-9 - time.time()) < PATIENCE_S


def test_without_a_rig_it_says_so(trocar: Trocar, rig_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.services.cli.foxglove.SILENT_S", 0.1)
    ran = trocar("foxglove", "--rig", rig_file)
    assert (ran.code, ran.sentence()) == (3, "nothing was heard: is a rig running on this transport?")


def test_it_shows_nothing_to_a_network_in_clear_unless_told(trocar: Trocar, rig_file: Path) -> None:
    ran = trocar("foxglove", "--rig", rig_file, "--host", "0.0.0.0")
    assert ran.code == 2
    wanted = "--host 0.0.0.0 would show the rig to a network in clear: name the directory of `trocar keys`"
    assert ran.sentence().startswith(wanted)


def test_without_its_package_it_says_so_before_it_looks_for_a_rig(
    trocar: Trocar, rig_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    ran = trocar("foxglove", "--rig", rig_file)
    assert ran.sentence().startswith("trocar foxglove needs the package 'foxglove': ")
    assert "foxglove-sdk" in ran.sentence()


async def _send(address: str, data: bytes | str) -> str:
    """Send something to a server that wants none of it; return what it says to that."""
    async with websockets.connect(address, subprotocols=[websockets.Subprotocol(_PROTOCOL)]) as viewer:
        await viewer.send(data)
        while True:
            said = await asyncio.wait_for(viewer.recv(), PATIENCE_S)
            if not isinstance(said, bytes) and json.loads(said)["op"] == "status":
                return str(json.loads(said)["message"])


async def _look_at_once(address: str, viewers: int) -> list[Any]:
    return await asyncio.gather(*(_look(address, 5) for _ in range(viewers)))


def test_strange_silent_and_many_viewers_take_nothing_from_a_good_one(rig_file: Path) -> None:
    advertised = {"op": "advertise", "channels": [{"id": 1, "topic": "/x", "encoding": "json", "schemaName": "y"}]}
    wanted = {"op": "setParameters", "parameters": [{"name": "a", "value": 1}]}
    with gateway_speaks(rig_file), served(rig_file) as address, ExitStack() as kept:
        place = "127.0.0.1", int(address.rpartition(":")[2])
        for rubbish in (b"", b"GET / HTTP/1.0\r\n\r\n", b"\xff" * 4096):
            for _ in range(10):
                kept.enter_context(socket.create_connection(place)).sendall(rubbish)
        assert "does not support" in asyncio.run(_send(address, json.dumps(advertised)))
        assert "does not support" in asyncio.run(_send(address, json.dumps(wanted)))
        for strange in ("no JSON", "{", "x" * 1_000_000, b"\x01" * 100):
            assert asyncio.run(_send(address, strange))
        looked = asyncio.run(_look_at_once(address, 20))
    assert all(len(messages) == 5 for _, _, messages in looked)
