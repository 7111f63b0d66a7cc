"""``trocar sniff``: what is on the bus, read with plain msgpack, whether this version understands it or not."""

from __future__ import annotations

import json
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import zmq
from rich.console import Console
from rich.table import Table

from trocar.protocol.topics import TOPICS
from trocar.services.cli.raw_frames import unpack
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.bus import endpoints, keys
from trocar.services.runtime.bus.frame_batches import batch_endpoint, lengths_and_frames, split
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.errors import BusError, ConfigError

#: Printed per second unless every frame is asked for: a 1 kHz topic scrolls faster than anyone reads.
_PRINTED_HZ = 5.0


@dataclass(slots=True)
class TopicTally:
    """Counts of one topic. Its rate is the publisher's, from what it numbered and stamped, however many came here."""

    frames: int = 0
    octets: int = 0
    gaps: int = 0
    sent: int = 0
    span_s: float = 0.0
    periods_s: list[float] = field(default_factory=list)
    _last: tuple[int, int, float] | None = None  # incarnation, sequence, when it was sent

    def add(self, data: bytes) -> None:
        """Count one frame; periods are the sender's, for frames of a fast topic arrive many at a time."""
        self.frames, self.octets = self.frames + 1, self.octets + len(data)
        try:
            frame = unpack(data)
            now = int(frame["incarnation"]), int(frame["sequence"]), int(frame["sent_ns"]) * 1e-9
        except (ValueError, KeyError, TypeError):
            return
        last, self._last = self._last, now
        if last is None or last[0] != now[0] or now[1] <= last[1]:  # the first of its publisher
            return
        self.sent += now[1] - last[1]
        self.span_s += now[2] - last[2]
        self.gaps += now[1] - last[1] - 1
        self.periods_s.append(now[2] - last[2])

    def row(self, topic: str) -> dict[str, Any]:
        """Return the figures."""
        periods = sorted(self.periods_s)
        return {
            "topic": topic,
            "rate_hz": self.sent / self.span_s if self.span_s > 0.0 else None,
            "frames": self.frames,
            "gaps": self.gaps,
            "bytes_per_frame": self.octets / self.frames if self.frames else None,
            "period_ms_min": periods[0] * 1e3 if periods else None,
            "period_ms_max": periods[-1] * 1e3 if periods else None,
        }


def run_sniff(
    rig: str,
    topic: str | None,
    count: int | None,
    seconds: float | None,
    rates: bool,
    every: bool,
    as_json: bool,
    overrides: tuple[str, ...],
) -> None:
    """Print the frames of one topic, or the rates of all.

    Raises UserError for a topic that does not exist, or silence.
    """
    transport = config.load_rig(rig, overrides).transport
    if topic is not None and topic not in TOPICS:
        near = did_you_mean(topic, TOPICS)
        raise ConfigError(f"there is no topic {topic!r}; known: {', '.join(TOPICS)}{near}")
    topics = list(TOPICS) if topic is None else [topic]
    try:
        if topic is None or rates:
            _show_rates(transport, topics, seconds or 2.0, as_json)
        else:
            _show_frames(transport, topics, seconds or (10.0 if count else 1e9), count, every, as_json)
    except KeyboardInterrupt:
        return


def frames(transport: Transport, topics: Iterable[str], until_s: float) -> Iterator[tuple[str, bytes, float]]:
    """Yield ``(topic, bytes, time)`` of every frame until `until_s` of the monotonic clock; time goes on in silence."""
    context = zmq.Context()
    rig_keys = keys.load(transport.keys) if transport.keys else None
    try:
        poller, names = zmq.Poller(), {}
        for topic in topics:
            socket = context.socket(zmq.SUB)
            socket.setsockopt(zmq.SUBSCRIBE, b"")
            socket.setsockopt(zmq.RECONNECT_IVL, 10)
            if rig_keys:
                rig_keys.guard_reader(socket)
            socket.connect(endpoints.endpoint(transport, batch_endpoint(topic)))
            poller.register(socket, zmq.POLLIN)
            names[socket] = topic
        while (left_s := until_s - time.monotonic()) > 0:
            for socket, _event in poller.poll(round(min(left_s, 0.1) * 1e3)):
                for data in split(*lengths_and_frames(socket.recv_multipart())):
                    yield names[socket], data, time.monotonic()
    finally:
        context.destroy(linger=0)


def _show_rates(transport: Transport, topics: list[str], seconds: float, as_json: bool) -> None:
    tallies: defaultdict[str, TopicTally] = defaultdict(TopicTally)
    for topic, data, _now_s in frames(transport, topics, time.monotonic() + seconds):
        tallies[topic].add(data)
    if not tallies:
        raise BusError(f"nothing was heard for {seconds:g} s: is a rig running on this transport?")
    rows = [tallies[topic].row(topic) for topic in topics if topic in tallies]
    if as_json:
        print(json.dumps(rows, indent=1))
        return
    table = Table(box=None)
    for title in ("topic", "Hz", "declared", "bytes", "gaps", "period ms min..max"):
        table.add_column(title, justify="left" if title == "topic" else "right")
    for row in rows:
        period = "" if row["period_ms_min"] is None else f"{row['period_ms_min']:.2f}..{row['period_ms_max']:.2f}"
        declared = f"{TOPICS[row['topic']].rate_hz:g}"
        rate = "" if row["rate_hz"] is None else f"{row['rate_hz']:.1f}"
        table.add_row(row["topic"], rate, declared, f"{row['bytes_per_frame']:.0f}", str(row["gaps"]), period)
    Console(highlight=False).print(table)


def _show_frames(
    transport: Transport, topics: list[str], seconds: float, count: int | None, every: bool, as_json: bool
) -> None:
    until_s = time.monotonic() + seconds
    every = every or count is not None
    shown, due_s = 0, 0.0
    for _topic, data, now_s in frames(transport, topics, until_s):
        if not every and now_s < due_s:
            continue
        due_s = now_s + 1.0 / _PRINTED_HZ
        print(_text(data, as_json=as_json), flush=True)
        shown += 1
        if count is not None and shown >= count:
            return
    if shown == 0:
        raise BusError(f"nothing was heard on {topics[0]}: is a rig running on this transport?")


def _text(data: bytes, *, as_json: bool) -> str:
    try:
        frame = unpack(data)
    except ValueError as error:
        frame = {"error": str(error)}
    if as_json:
        return json.dumps(frame, default=lambda value: value.hex())
    body = frame.pop("body", None)
    envelope = "  ".join(f"{name}={value}" for name, value in frame.items())
    lines = [f"  {name}: {value}" for name, value in body.items()] if isinstance(body, dict) else [f"  {body}"]
    return "\n".join((envelope, *lines))
