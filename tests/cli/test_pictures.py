"""A recording is shown in its own time: halted, stepped, ahead and back, at another rate."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from services.cli import pictures
from services.cli.pictures import Player
from services.recordings.reader import read_messages

SAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "recordings" / "insertion-success.mcap"


class _Bus:
    def __init__(self) -> None:
        self.newest: dict[str, int] = {}

    def publish(self, topic: str, body: Any, **_rest: object) -> None:
        self.newest[topic] = body.tick


def test_frames_come_in_their_time_and_as_a_person_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(pictures, "time", SimpleNamespace(monotonic_ns=lambda: round(1e9 * now_s[0])))
    times = [(time_ns, body.tick) for _, time_ns, body in read_messages(SAMPLE, ["gateway.state"])]
    states = [(time_ns, body.tick) for _, time_ns, body in read_messages(SAMPLE, ["physics.state"])]

    def tick_at(place_s: float) -> int:
        return max(tick for time_ns, tick in times if (time_ns - times[0][0]) * 1e-9 <= place_s)

    bus = _Bus()
    player = Player(SAMPLE, bus, 2.0, 5.0, loop=False)  # type: ignore[arg-type]

    def after(seconds: float) -> int:
        now_s[0] += seconds
        assert not player.turn()
        return bus.newest["gateway.state"]

    assert after(0.5) == tick_at(1.0)
    player.obey("")
    assert after(3.0) == tick_at(1.0)
    player.obey("")
    player.obey("x0.5")
    assert after(1.0) == tick_at(1.5)
    player.obey("+2")
    assert after(0.0) == tick_at(3.5)
    player.obey("-3")
    assert after(0.0) == pytest.approx(tick_at(0.5), abs=1)
    shown = sum((time_ns - times[0][0]) * 1e-9 <= player.place_s for time_ns, _ in states)
    player.obey("s")
    assert after(1.0) >= bus.newest["physics.state"] == states[shown][1]
    player.obey("s")
    after(1.0)
    assert bus.newest["physics.state"] == states[shown + 1][1]
    player.obey("no command")
    player.obey("")
    now_s[0] += 20.0
    assert player.turn(), "the end that was asked for"
