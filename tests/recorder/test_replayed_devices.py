"""The device frames of a replay: each at its time, at a rate, from a second on, once or again and again."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trocar.services.gateway import replaying
from trocar.services.gateway.replaying import Replay
from trocar.services.recordings.inputs import read_inputs
from trocar.services.runtime.config.rig import ReplaySettings
from trocar.services.runtime.loop.loop import LoopMeter


class _Rig:
    """A process whose haptics answers at once, on a clock that stands but for what is slept; it ends after `most`."""

    def __init__(self, most: int) -> None:
        self.now_ns, self.most = 1_000_000_000, most
        self.said: list[tuple[int, int]] = []
        self.bus = self
        self.health = SimpleNamespace(gauges={}, do_a_piece=lambda: False, send_if_due=lambda: None)

    def stop(self) -> bool:
        return len(self.said) >= self.most

    def publish(self, _topic: str, body: Any, **_rest: object) -> None:
        self.said.append((body.tick, self.now_ns))

    def wait(self, *_: object) -> bool:
        return True

    def latest(self, _topic: str) -> Any:
        return SimpleNamespace(body=SimpleNamespace(tick=self.said[-1][0]))

    def flush(self) -> None:
        """Nothing waits."""

    def drain(self, _topic: str) -> list[object]:
        return []

    def sleep_until(self, due_ns: int) -> None:
        self.now_ns = max(self.now_ns, due_ns)


def replayed(recorded: Path, monkeypatch: pytest.MonkeyPatch, most: int, **asked: Any) -> list[tuple[int, int]]:
    """Return the ticks that were published, each with its time in ns."""
    rig = _Rig(most)
    monkeypatch.setattr(replaying, "sleep_until", rig.sleep_until)
    monkeypatch.setattr(replaying, "time", SimpleNamespace(monotonic_ns=lambda: rig.now_ns))
    settings = ReplaySettings(file=recorded, take_over=True, **asked)
    Replay(rig, settings, LoopMeter(1000.0)).run()  # type: ignore[arg-type]
    return rig.said


def test_a_rate_stretches_the_time_and_no_tick_is_left_out(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = [intake.tick for intake in read_inputs(recorded).intakes]
    for rate in (0.25, 1.0, 4.0):
        said = replayed(recorded, monkeypatch, 10_000, rate=rate)
        assert [tick for tick, _ in said] == ticks
        took_ns = np.diff([now_ns for _, now_ns in said])
        np.testing.assert_allclose(took_ns, np.diff(ticks) * 1e6 / rate, atol=2.0)
    assert len({now_ns for _, now_ns in replayed(recorded, monkeypatch, 10_000, rate=0.0)}) == 1, "as fast as it goes"


def test_what_is_before_the_second_is_run_and_not_waited_for(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """States follow from all that was before: so a replay as devices seeks by running it as fast as it goes."""
    said = replayed(recorded, monkeypatch, 10_000, from_s=0.4)
    first = said[0][0]
    before, after = ([now for tick, now in said if (tick <= first + 400) is is_before] for is_before in (True, False))
    assert len(set(before)) == 1
    assert after[-1] - before[0] == pytest.approx(1e6 * (said[-1][0] - first - 400), rel=0.01)


def test_it_goes_round_until_it_is_asked_to_end(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = [intake.tick for intake in read_inputs(recorded).intakes if intake.tick <= 200]
    said = replayed(recorded, monkeypatch, 2 * len(ticks) + 50, loop=True, until_s=(200 - ticks[0]) * 1e-3)
    assert [tick for tick, _ in said] == [*ticks, *ticks, *ticks[:50]]
    rounds = [said[k * len(ticks) : (k + 1) * len(ticks)] for k in (0, 1)]
    paced = [np.diff([now_ns for _, now_ns in each]) for each in rounds]
    np.testing.assert_allclose(paced[0], paced[1], atol=2.0)
    assert len(replayed(recorded, monkeypatch, 10_000, until_s=(200 - ticks[0]) * 1e-3)) == len(ticks), "once"
