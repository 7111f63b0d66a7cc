"""``trocar foxglove``: a running rig in Foxglove, Lichtblick and other viewers of their protocol, to look at.

It observes the bus as the recorder does: a frame of each topic at a time, with the channels, schemas and pictures of
recordings, so a layout for recordings shows the rig. Nobody can send anything to the rig through it.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

from trocar.protocol import TOPICS, Frame
from trocar.protocol.topics import HEARTBEAT_S, observed_by, read_by
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.reduction.build import ignore_progress
from trocar.services.recorder.picture import PictureRecorder
from trocar.services.recordings.channels import channel_name
from trocar.services.recordings.scene_update import SCHEMAS, SceneDrawing, descriptor
from trocar.services.recordings.schema import PACKAGE, file_descriptor
from trocar.services.recordings.transcode import to_protobuf
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import LOOPBACK, Rig
from trocar.services.runtime.errors import BusError, ConfigError, MissingPackageError, UserError
from trocar.services.runtime.web import web_certificate
from trocar.services.scenes import load_duct, load_scene

#: How long a turn waits for a frame: longer than the period of sampled topics.
_PATIENCE_NS = 4_000_000
#: Above this rate a topic is sampled, as no viewer draws more pictures a second. The loops' topics have 1 kHz, others
#: up to 60 Hz.
_FAST_HZ = 100.0
#: How long the rig may be silent at first: ten heartbeats, as one that only begins to run is silent for some seconds.
SILENT_S = 10 * HEARTBEAT_S
#: Messages that wait for a slow viewer; the oldest are dropped for it, and for nobody else.
_BACKLOG = 256


class Observed:
    """The bus: of fast topics a frame now and then, for which nobody waits, of all others the newest."""

    def __init__(self, rig: Rig) -> None:
        recorded = {*observed_by("recorder"), *read_by("recorder")}
        self._fast = [name for name in TOPICS if name in recorded and TOPICS[name].rate_hz > _FAST_HZ]
        self._slow = [name for name in TOPICS if name in recorded and name not in self._fast]
        self._bus = ZmqBus(rig.transport, reads=self._slow, samples=self._fast)

    def look_for_rig(self) -> None:
        """Raise BusError if no rig is heard for some seconds."""
        until_s = time.monotonic() + SILENT_S
        while not any(self.frames()):
            if time.monotonic() > until_s:
                raise BusError("nothing was heard: is a rig running on this transport?")

    def frames(self) -> Iterator[Frame]:
        """Yield what is new, waiting some milliseconds for it."""
        yield from self._bus.sample(self._fast, time.monotonic_ns() + _PATIENCE_NS).values()
        for name in self._slow:
            frame = self._bus.latest(name)
            if frame is not None:
                yield frame

    def close(self) -> None:
        """Hear nothing any more."""
        self._bus.close()


class LiveChannels:
    """Channels of a server, made when something is first said on them."""

    def __init__(self, make: Callable[[str, str, bytes], Any], to_wall_ns: int) -> None:
        self._make, self._to_wall_ns = make, to_wall_ns
        self._channels: dict[str, Any] = {}
        self._sequences: dict[str, tuple[int, int]] = {}

    def send(self, frame: Frame) -> None:
        """Send a frame of the bus, unless it was sent before."""
        number = frame.incarnation, frame.sequence
        if self._sequences.get(frame.topic) == number:
            return
        self._sequences[frame.topic] = number
        body = TOPICS[frame.topic].body
        name, schema = f"{PACKAGE}.{body.__name__}", lambda: file_descriptor(body).SerializeToString()
        channel = self._channel(channel_name(frame.topic), name, schema)
        channel.log(to_protobuf(frame), log_time=self._wall(frame.sent_ns))

    def draw(self, topic: str, sent_ns: int, data: bytes) -> None:
        """Send a drawing of a topic of `scene_update`."""
        name = SCHEMAS[topic].DESCRIPTOR.full_name
        self._channel(topic, name, lambda: descriptor(topic)).log(data, log_time=self._wall(sent_ns))

    def _channel(self, topic: str, name: str, schema: Callable[[], bytes]) -> Any:
        if topic not in self._channels:
            self._channels[topic] = self._make(topic, name, schema())
        return self._channels[topic]

    def _wall(self, sent_ns: int) -> int:
        return sent_ns + self._to_wall_ns


def run_foxglove(
    rig_name: str, scene: str | None, host: str, port: int, rate_hz: float, insecure: bool, overrides: tuple[str, ...]
) -> None:
    """Serve a running rig until Ctrl-C.

    Raises ConfigError if it would be served in clear to others, the port is taken, or there is no such scene;
    BusError if no rig is heard; MissingPackageError without Foxglove's package.
    """
    rig_overrides, scene_overrides = config.split_overrides(overrides)
    rig = config.load_rig(rig_name, rig_overrides)
    if scene is not None:
        load_scene(scene, scene_overrides)
    encrypted = _encryption(rig, host, insecure)
    _need_package()
    signal.signal(signal.SIGTERM, _end)
    to_wall_ns = time.time_ns() - time.monotonic_ns()
    bus = Observed(rig)
    try:
        bus.look_for_rig()
        server, make = _serve(rig.name, host, port, encrypted)
        try:
            print(f"the rig '{rig.name}' is at {_address(host, server)}: open it in Foxglove", flush=True)
            picture = PictureRecorder(to_wall_ns)
            _draw_once_built(picture, scene or rig.scene, scene_overrides)
            _follow(bus, LiveChannels(make, to_wall_ns), picture, rate_hz)
        finally:
            server.stop()
    except KeyboardInterrupt:
        return
    finally:
        bus.close()


def _end(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _encryption(rig: Rig, host: str, insecure: bool) -> dict[str, Any]:
    """Return certificate and key of a server, nothing where it is in clear.

    Raises ConfigError if it would be in clear to others, and that is not accepted.
    """
    certificate = web_certificate.load_for(rig)
    if certificate is not None:
        return {"tls_cert": certificate.file.read_bytes(), "tls_key": certificate.key_file.read_bytes()}
    if host not in LOOPBACK and not insecure:
        raise ConfigError(
            f"--host {host} would show the rig to a network in clear: name the directory of `trocar keys` as "
            "`supervisor.web.keys`, or accept that by --insecure"
        )
    return {}


def _need_package() -> None:
    try:
        import foxglove  # noqa: F401 - whether it is there
    except ModuleNotFoundError as error:
        raise MissingPackageError("trocar foxglove", error.name) from None


def _serve(
    rig_name: str, host: str, port: int, encrypted: dict[str, Any]
) -> tuple[Any, Callable[[str, str, bytes], Any]]:
    """Return a server, and what makes a channel of it by topic, name of the schema and descriptors."""
    import foxglove

    foxglove.set_log_level("ERROR")
    context = foxglove.Context()
    try:
        server = foxglove.start_server(
            name=f"Trocar: {rig_name}", host=host, port=port, capabilities=[], context=context,
            message_backlog_size=_BACKLOG, **encrypted,
        )  # fmt: skip
    except (RuntimeError, OSError, ValueError) as error:
        raise ConfigError(f"--port {port}: cannot serve at {host}: {error}") from None

    def make(topic: str, name: str, descriptors: bytes) -> Any:
        schema = foxglove.Schema(name=name, encoding="protobuf", data=descriptors)
        return foxglove.Channel(topic, schema=schema, message_encoding="protobuf", context=context)

    return server, make


def _address(host: str, server: Any) -> str:
    return f"ws://{f'[{host}]' if ':' in host else host}:{server.port}"


def _draw_once_built(picture: PictureRecorder, name: str, overrides: tuple[str, ...]) -> None:
    """Let the scene be drawn as soon as its duct is built, which may take a minute; frames are sent meanwhile."""

    def build() -> None:
        try:
            scene = load_scene(name, overrides)
            picture.drawing = SceneDrawing(scene, load_duct(scene, cache_directory(), ignore_progress))
        except UserError as error:
            print(f"the scene is not drawn: {error}", flush=True)

    threading.Thread(target=build, daemon=True).start()


def _follow(bus: Observed, channels: LiveChannels, picture: PictureRecorder, rate_hz: float) -> None:
    due_s = time.monotonic()
    while True:
        for frame in bus.frames():
            channels.send(frame)
            picture.see(frame)
        for drawn in picture.draw(time.monotonic_ns()):
            channels.draw(*drawn)
        due_s = max(due_s + 1.0 / rate_hz, time.monotonic())
        time.sleep(max(0.0, due_s - time.monotonic()))
