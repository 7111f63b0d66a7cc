"""A recorder that is held up loses nothing for half a minute; what it does lose is told everywhere."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from tests.memory_bus import MemoryBus, MemoryHub
from tests.recorder.made_up import MS, state
from trocar import protocol
from trocar.protocol import bodies
from trocar.services.recorder.__main__ import Recording, append_received
from trocar.services.recorder.losses import DISK, QUEUES, Loss, Losses, counts
from trocar.services.runtime.bus import bus as bus_module
from trocar.services.runtime.bus.bus import Inbox, Outbox
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.process.health import HealthReporter

STATE = "gateway.state"


def sealed(n: int) -> list[bytes]:
    outbox = Outbox(protocol.topic(STATE), 1)
    body = bodies.GatewayState(tick=1)
    return [outbox.seal(body, 0, True) for _ in range(n)]


def test_half_a_minute_at_once_is_no_flood_for_who_wants_every_frame() -> None:
    frames = sealed(round(1000 * bus_module.BACKLOG_S))
    keeper, actor = Inbox(protocol.topic(STATE), every=True), Inbox(protocol.topic(STATE))
    assert len(keeper.accept_all(frames)) == len(frames)
    assert len(actor.accept_all(frames)) < 200, "who acts on it is protected as before"
    assert 0 < keeper.accept_all(frames).__len__() + keeper.refused["flood"] <= len(frames)


@dataclass
class BatchOf:
    """A batch of one frame, which is the name of its topic."""

    topic: str

    def frames(self) -> list[str]:
        return [self.topic]


def test_who_catches_up_is_heard_meanwhile() -> None:
    """Half a minute of backlog takes seconds: with its heartbeat silent for so long it would be ended as hung."""
    told: list[str] = []

    class Backlog:
        left = 3

        def batch(self, topic: str) -> BatchOf | None:
            self.left -= 1
            return BatchOf(topic) if self.left >= 0 else None

    class Kept:
        def append_frames(self, frames: list[str]) -> None:
            told.extend(frames)

    assert not append_received(Backlog(), [STATE], Kept(), lambda: told.append("beat"))  # type: ignore[arg-type]
    assert told == [STATE, "beat"] * 3


def test_a_publisher_that_floods_without_end_leaves_time_for_the_others_and_the_file() -> None:
    taken: list[str] = []

    class Endless:
        def batch(self, topic: str) -> BatchOf | None:
            return BatchOf(topic) if topic == STATE or topic not in taken else None

    class Kept:
        def append_frames(self, frames: list[str]) -> None:
            taken.extend(frames)

    assert append_received(Endless(), [STATE, "physics.state"], Kept(), lambda: None)  # type: ignore[arg-type]
    assert taken.count("physics.state") == 1


def test_frames_of_seconds_wait_in_the_queues_of_one_who_does_not_read(
    tmp_path: Path, eventually: Callable[[Callable[[], bool]], None]
) -> None:
    """Twenty seconds of batches: queues of one second, as they were, would have lost nineteen."""
    transport = Transport(directory=tmp_path / "bus")
    sender = ZmqBus(transport, publishes=[STATE])
    keeper, other = ZmqBus(transport, reads_every=[STATE]), ZmqBus(transport, reads_every=[STATE])
    frames: list[Any] = []
    try:
        eventually(lambda: sender.has_reader(STATE) and sender._batches[STATE].readers == 2)
        for tick, data in enumerate(sealed(20_001)):
            sender._batches[STATE].add(data, tick * MS)
            if tick % 1000 == 0:  # two seconds of them are on their way to both, and one of the two has them
                eventually(lambda: frames.extend(other.drain(STATE)) or len(frames) > tick - 20)  # noqa: B023
        frames.clear()
        eventually(lambda: frames.extend(keeper.drain(STATE)) or len(frames) > 19_900)
        report = keeper.reports()[0]
        assert (report.dropped, report.refused) == (0, {})
    finally:
        for each in (sender, keeper, other):
            each.close()


def test_losses_are_told_once_each_with_their_time() -> None:
    losses = Losses(0)
    assert losses.find_new({(STATE, DISK): 3}, 10) == [Loss(STATE, 3, DISK, 0, 10)]
    assert losses.find_new({(STATE, DISK): 3}, 20) == []
    assert losses.find_new({(STATE, DISK): 5, (STATE, QUEUES): 1}, 30) == [
        Loss(STATE, 2, DISK, 20, 30), Loss(STATE, 1, QUEUES, 20, 30),
    ]  # fmt: skip
    assert losses.sentence() == f"lost 6 frames: 5 of {STATE} ({DISK}), 1 of {STATE} ({QUEUES})"
    assert Losses(0).sentence() == ""


def test_what_goes_on_being_lost_is_said_at_once_and_then_every_ten_seconds_together() -> None:
    losses, said = Losses(0), []
    for second in range(25):
        lost = {(STATE, DISK): min(second + 1, 12)} | ({(STATE, QUEUES): 4} if second >= 3 else {})
        now_ns = second * 1_000_000_000
        said += [(second, each.frames, each.why) for each in losses.due_reports(losses.find_new(lost, now_ns), now_ns)]
    assert said == [(0, 1, DISK), (3, 4, QUEUES), (10, 10, DISK), (20, 1, DISK)]


def test_what_was_refused_is_not_counted_again_as_missing() -> None:
    report = bodies.TopicReport(topic=STATE, received=90, dropped=10, refused={"flood": 7})
    assert counts([report], {}) == {(STATE, QUEUES): 3, (STATE, "refused: flood"): 7}


class Stub:
    """What a recording uses of its process."""

    def __init__(self, directory: Path) -> None:
        self.rig = config.load_rig("stub", [f"recorder.directory={directory}"])
        self.scene_name = "default"
        self.log = logging.getLogger("trocar.test_losses")
        self.hub = MemoryHub()
        self.bus = MemoryBus(self.hub, publishes=["recorder.health"], reads_every=[STATE])
        self.health = HealthReporter("recorder", self.bus)


def test_file_dashboard_and_last_words_say_what_is_missing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    stub: Any = Stub(tmp_path)
    recording = Recording(stub)
    outbox = Outbox(protocol.topic(STATE), 1)
    for tick in range(300):
        data = outbox.seal(state(tick).body, 0, True)
        if not 100 <= tick < 130:
            stub.hub.send(STATE, data)
    while append_received(stub.bus, [STATE], recording, lambda: None):
        pass
    now_ns = recording._due_ns
    recording.write_due(now_ns)
    recording.write_due(now_ns + 2_000_000_000)
    assert (stub.health.gauges["lost_frames"], stub.health.gauges["recorded_frames"]) == (30, 270)
    assert (stub.health.state, stub.health.detail) == ("degraded", f"lost 30 frames: 30 of {STATE} ({QUEUES})")
    with caplog.at_level(logging.INFO):
        recording.close()
    last = caplog.records[-1]
    assert f"270 frames in {recording._writer.path}, lost 30 frames: 30 of {STATE}" in last.getMessage()
    assert last.levelno == logging.WARNING, "so that `trocar up` shows it"
    with recording._writer.path.open("rb") as file:
        (told,) = [each.metadata for each in make_reader(file).iter_metadata() if each.name == "trocar.lost"]
    assert (told["topic"], told["frames"], told["why"]) == (STATE, "30", QUEUES)
    assert int(told["from_ns"]) < int(told["until_ns"])
