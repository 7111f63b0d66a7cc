"""Rigs across hosts: only who has the rig's keys hears it, and nobody else is heard."""

from __future__ import annotations

import errno
import socket
import stat
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
import zmq
from pydantic import ValidationError

from tests.health_reports import report_of
from tests.patience import PATIENCE_S
from tests.ports import base_port
from tests.runtime.bus.between import Between
from trocar import protocol
from trocar.protocol import Frame, bodies
from trocar.services.runtime.bus import keys
from trocar.services.runtime.bus.endpoints import endpoint
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.errors import ConfigError
from trocar.services.runtime.process.health import HealthReporter

STATE = "gateway.state"
PORT = base_port(23_800)
SILENCE_S = 0.5


@pytest.fixture
def rig_keys(tmp_path: Path) -> Path:
    keys.make(tmp_path / "keys")
    return tmp_path / "keys"


def _bus(stack: ExitStack, directory: Path | None, **topics: list[str]) -> ZmqBus:
    bus = ZmqBus(Transport(kind="tcp", base_port=PORT, keys=directory), **topics)
    stack.callback(bus.close)
    return bus


def _hears(sender: ZmqBus, reader: ZmqBus, seconds: float) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        sender.publish(STATE, bodies.GatewayState(tick=1))
        if reader.latest(STATE) is not None:
            return True
        time.sleep(0.01)
    return False


def test_who_has_the_keys_hears(stack: ExitStack, rig_keys: Path) -> None:
    sender = _bus(stack, rig_keys, publishes=[STATE])
    assert _hears(sender, _bus(stack, rig_keys, reads=[STATE]), PATIENCE_S)
    assert sender.has_reader(STATE)


@pytest.mark.parametrize("stranger", ["no keys", "other keys"])
def test_a_stranger_hears_nothing_and_the_others_go_on(
    stack: ExitStack, rig_keys: Path, tmp_path: Path, stranger: str
) -> None:
    sender = _bus(stack, rig_keys, publishes=[STATE])
    theirs = keys.make(tmp_path / "other").parent if stranger == "other keys" else None
    assert not _hears(sender, _bus(stack, theirs, reads=[STATE]), SILENCE_S)
    assert _hears(sender, _bus(stack, rig_keys, reads=[STATE]), PATIENCE_S)


def test_who_knows_only_the_public_key_is_refused(stack: ExitStack, rig_keys: Path) -> None:
    """CurveZMQ alone would let in whoever knows the publisher; the doorkeeper asks for the rig's own key."""
    sender = _bus(stack, rig_keys, publishes=[STATE])
    context = zmq.Context()
    stack.callback(context.destroy, linger=0)
    spy = stack.enter_context(context.socket(zmq.SUB))
    public, secret = zmq.curve_keypair()
    spy.setsockopt(zmq.CURVE_SERVERKEY, keys.load(rig_keys).public)
    spy.setsockopt(zmq.CURVE_PUBLICKEY, public)
    spy.setsockopt(zmq.CURVE_SECRETKEY, secret)
    spy.setsockopt(zmq.SUBSCRIBE, b"")
    spy.connect(endpoint(Transport(kind="tcp", base_port=PORT), STATE))
    reporter, end = HealthReporter("gateway", sender), time.monotonic() + PATIENCE_S
    while not report_of(reporter).gauges["refused_readers"] > 0:
        assert time.monotonic() < end, "it is not refused"
        sender.publish(STATE, bodies.GatewayState(tick=1))
        assert not spy.poll(10)


def test_keys_are_private_and_made_once(rig_keys: Path) -> None:
    file = rig_keys / "rig.key_secret"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    with pytest.raises(ConfigError, match="is there already"):
        keys.make(rig_keys)
    file.chmod(0o644)
    with pytest.raises(ConfigError, match="can be read by others"):
        keys.load(rig_keys)


def test_a_secret_is_never_open_to_others_nor_half_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was closed once written; and what a full disk had left of it kept whoever tried again from making any."""
    seen: list[int] = []

    def run_out_of_disk(folder: Path, name: str) -> None:
        file = folder / f"{name}.key_secret"
        file.write_text("half")
        seen.append(stat.S_IMODE(file.stat().st_mode))
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("zmq.auth.create_certificates", run_out_of_disk)
        with pytest.raises(ConfigError, match="keys cannot be written: No space left on device"):
            keys.make(tmp_path)
    assert seen == [0o600]
    keys.load(keys.make(tmp_path).parent)


@pytest.mark.parametrize(("text", "says"), [(None, "No such file"), ("nonsense", "holds no")])
def test_keys_that_are_none_are_one_sentence(tmp_path: Path, text: str | None, says: str) -> None:
    if text is not None:
        (tmp_path / "rig.key_secret").write_text(text)
        (tmp_path / "rig.key_secret").chmod(0o600)
    with pytest.raises(ConfigError, match=says):
        keys.load(tmp_path)


def test_beyond_loopback_a_rig_file_names_keys_or_says_insecure(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="leaves this host unprotected"):
        Transport(kind="tcp", host="10.0.0.2")
    assert Transport(kind="tcp", host="10.0.0.2", keys=tmp_path).keys == tmp_path
    with pytest.raises(ValidationError, match="belong to this user"):
        Transport(keys=tmp_path)


@pytest.mark.parametrize("theirs", ["other keys", "old keys", "no keys"])
def test_who_comes_with_wrong_keys_is_counted(stack: ExitStack, tmp_path: Path, theirs: str) -> None:
    """They fail before anybody asks who they are: keys left on one host looked like silence."""
    old = keys.make(tmp_path / "rig").parent
    kept = keys.load(old)
    (old / "rig.key_secret").unlink()
    keys.make(old)
    assert keys.load(old) != kept
    sender = _bus(stack, old, publishes=[STATE])
    wrong = {"old keys": kept, "other keys": keys.load(keys.make(tmp_path / "other").parent), "no keys": None}[theirs]
    context = zmq.Context()
    stack.callback(context.destroy, linger=0)
    stranger = stack.enter_context(context.socket(zmq.SUB))
    if wrong is not None:
        wrong.guard_reader(stranger)
    stranger.setsockopt(zmq.SUBSCRIBE, b"")
    stranger.connect(endpoint(Transport(kind="tcp", base_port=PORT), STATE))
    _until(lambda: _refused(sender) > 0, sender)
    assert not stranger.poll(10)
    assert _hears(sender, _bus(stack, old, reads=[STATE]), PATIENCE_S)


def test_who_publishes_without_the_secret_is_not_heard(stack: ExitStack, rig_keys: Path) -> None:
    context = zmq.Context()
    stack.callback(context.destroy, linger=0)
    impostor = stack.enter_context(context.socket(zmq.PUB))
    public, secret = zmq.curve_keypair()
    keys.Keys(public, secret).guard_publisher(impostor)
    impostor.bind(endpoint(Transport(kind="tcp", base_port=PORT), STATE))
    reader = _bus(stack, rig_keys, reads=[STATE])
    end = time.monotonic() + SILENCE_S
    while time.monotonic() < end:
        impostor.send(
            protocol.encode(Frame(1, STATE, 1, 5, 0, time.monotonic_ns(), 0, True, bodies.GatewayState(tick=1)))
        )
        assert reader.latest(STATE) is None
        time.sleep(0.01)


def test_bytes_that_are_repeated_on_the_way_are_refused_and_counted(stack: ExitStack, rig_keys: Path) -> None:
    """Of a frame sent twice by whoever sits between, the second is none; the reader connects anew and goes on."""
    sender = _bus(stack, rig_keys, publishes=[STATE])
    between = Between(int(endpoint(Transport(kind="tcp", base_port=PORT), STATE).rpartition(":")[2]))
    stack.callback(between.close)
    reader = ZmqBus(Transport(kind="tcp", base_port=PORT + between.shift, keys=rig_keys), reads=[STATE])
    stack.callback(reader.close)
    assert _hears(sender, reader, PATIENCE_S)
    assert _refused(reader) == 0
    between.repeats = True
    _until(lambda: _refused(reader) > 0, sender)
    between.repeats = False
    assert _hears(sender, reader, PATIENCE_S)


def test_bytes_of_one_connection_are_refused_in_a_new_one_and_counted(stack: ExitStack, rig_keys: Path) -> None:
    """Who has recorded a connection and plays it to a reader, or as one to the publisher, has no keys of the new."""
    sender = _bus(stack, rig_keys, publishes=[STATE])
    port = int(endpoint(Transport(kind="tcp", base_port=PORT), STATE).rpartition(":")[2])
    between = Between(port)
    stack.callback(between.close)
    reader = ZmqBus(Transport(kind="tcp", base_port=PORT + between.shift, keys=rig_keys), reads=[STATE])
    stack.callback(reader.close)
    assert _hears(sender, reader, PATIENCE_S)
    said = dict(between.said)
    assert _refused(reader) == _refused(sender) == 0
    between.plays = True
    between.part()
    _until(lambda: _refused(reader) > 0, sender)
    reader.latest(STATE)  # what came before
    received = reader.reports()[0].received
    with socket.create_connection(("127.0.0.1", port)) as played:
        played.sendall(said["reader"])
        _until(lambda: _refused(sender) > 0, sender)
    assert reader.latest(STATE) is None
    assert reader.reports()[0].received == received
    between.plays = False
    between.part()
    _until(lambda: _refused(reader) > 0 and reader.latest(STATE) is not None, sender)  # each report looks after readers


def test_frames_that_were_recorded_are_refused_in_a_new_connection_also_from_who_has_the_keys(
    stack: ExitStack, rig_keys: Path
) -> None:
    first = _bus(stack, rig_keys, publishes=[STATE])
    context = zmq.Context()
    stack.callback(context.destroy, linger=0)
    recorder = context.socket(zmq.SUB)
    keys.load(rig_keys).guard_reader(recorder)
    recorder.setsockopt(zmq.SUBSCRIBE, b"")
    place = endpoint(Transport(kind="tcp", base_port=PORT), STATE)
    recorder.connect(place)
    reader = _bus(stack, rig_keys, reads=[STATE])
    assert _hears(first, reader, PATIENCE_S)
    _until(lambda: bool(recorder.poll(0)), first)
    recorded = recorder.recv()
    recorder.close()
    assert _hears(first, reader, PATIENCE_S)  # something newer
    first.close()

    def play(reason: str) -> None:
        with zmq.Context() as own, own.socket(zmq.PUB) as player:  # its port is free once its context has ended
            player.linger = 0
            keys.load(rig_keys).guard_publisher(player)
            player.bind(place)
            time.sleep(SILENCE_S)
            reader.latest(STATE)  # what was on its way
            end = time.monotonic() + PATIENCE_S
            while not reader.reports()[0].refused.get(reason):
                assert time.monotonic() < end, reader.reports()[0].refused
                player.send(recorded)
                assert reader.latest(STATE) is None
                time.sleep(0.01)

    play("out_of_order")
    second = _bus(stack, rig_keys, publishes=[STATE])
    assert _hears(second, reader, PATIENCE_S)
    second.close()
    play("old_incarnation")
    assert not reader.is_fresh(STATE)
    assert _hears(_bus(stack, rig_keys, publishes=[STATE]), reader, PATIENCE_S)


def _refused(bus: ZmqBus) -> float:
    return report_of(HealthReporter("gateway", bus)).gauges["refused_readers"]


def _until(condition: Callable[[], bool], sender: ZmqBus) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        sender.publish(STATE, bodies.GatewayState(tick=1))
        time.sleep(0.01)
