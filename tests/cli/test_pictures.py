"""A recording is shown in its own time: halted, stepped, ahead and back, at another rate."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.made_samples import SUCCESS
from tests.review.test_assess import recorded, word
from tests.training.streams import GOOD, messages
from trocar.services.cli import pictures
from trocar.services.cli.pictures import PicturePlayer
from trocar.services.recordings.reader import read_messages


class _Bus:
    def __init__(self) -> None:
        self.newest: dict[str, int] = {}

    def publish(self, topic: str, body: Any, **_rest: object) -> None:
        self.newest[topic] = body.tick


def test_frames_come_in_their_time_and_as_a_person_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(pictures, "time", SimpleNamespace(monotonic_ns=lambda: round(1e9 * now_s[0])))
    times = [(time_ns, body.tick) for _, time_ns, body in read_messages(SUCCESS, ["gateway.state"])]
    states = [(time_ns, body.tick) for _, time_ns, body in read_messages(SUCCESS, ["physics.state"])]

    def tick_at(place_s: float) -> int:
        return max(tick for time_ns, tick in times if (time_ns - times[0][0]) * 1e-9 <= place_s)

    bus = _Bus()
    player = PicturePlayer(SUCCESS, bus, 2.0, 1.75, loop=False)  # type: ignore[arg-type]

    def after(seconds: float) -> int:
        now_s[0] += seconds
        assert not player.publish_due_frames()
        return bus.newest["gateway.state"]

    assert after(0.5) == tick_at(1.0)
    player.obey("")
    assert after(3.0) == tick_at(1.0)
    player.obey("")
    player.obey("x0.5")
    assert after(1.0) == tick_at(1.5)
    player.obey("+0.2")
    assert after(0.0) == tick_at(1.7)
    player.obey("-1.4")
    assert after(0.0) == pytest.approx(tick_at(0.3), abs=1)
    shown = sum((time_ns - times[0][0]) * 1e-9 <= player.place_s for time_ns, _ in states)
    player.obey("s")
    assert after(1.0) >= bus.newest["physics.state"] == states[shown][1]
    player.obey("s")
    after(1.0)
    assert bus.newest["physics.state"] == states[shown + 1][1]
    player.obey("b")
    after(1.0)
    assert bus.newest["physics.state"] == states[shown][1]
    before = player.status()
    for nonsense in ("no command", "@nan", "@-1", "+", "x-2", "@inf"):
        player.obey(nonsense)
    assert player.status() == before
    player.obey("@1.5")
    assert after(0.0) == tick_at(1.5)
    player.obey("")
    now_s[0] += 20.0
    assert player.publish_due_frames(), "the end that was asked for"


def test_at_its_end_it_stays_or_begins_again(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(pictures, "time", SimpleNamespace(monotonic_ns=lambda: round(1e9 * now_s[0])))
    bus = _Bus()
    player = PicturePlayer(SUCCESS, bus, 1.0, None, loop=True)  # type: ignore[arg-type]
    length_s = player.status().length_s
    player.obey(f"@{length_s - 0.5}")
    now_s[0] += 1.0
    assert not player.publish_due_frames()
    assert player.status().place_s == 0.0, "again"
    player.obey("l")
    now_s[0] += 2.0 * length_s
    assert not player.publish_due_frames(), "one may go back"
    last = bus.newest["gateway.state"]
    assert player.status().place_s == length_s
    player.obey("@0")
    player.publish_due_frames()
    assert bus.newest["gateway.state"] < last


def test_the_attempt_is_told_as_it_was_then(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(pictures, "time", SimpleNamespace(monotonic_ns=lambda: round(1e9 * now_s[0])))
    stream = chain(word("running", 0), messages(GOOD, 2.0, 0), word("done", 1900, outcome="success", time_s=2.0))
    path = recorded(tmp_path / "a.mcap", stream)
    player = PicturePlayer(path, _Bus(), 1.0, None, loop=False)  # type: ignore[arg-type]
    told = []
    for place in ("@0.5", "@1.95", "@0.9"):
        player.obey(place)
        attempt = player.status().attempt
        told.append(attempt and attempt.state)
    assert told == ["running", "done", "running"]
