"""Events about publishers that flood a topic, from readers' counts of the excess; repeated while it continues."""

from __future__ import annotations

from collections.abc import Mapping

import trocar.protocol.bodies as bodies
from trocar.protocol import TOPICS
from trocar.services.runtime.process.health import FLOOD
from trocar.services.supervisor.crew.member import SAY_AGAIN_S


class Floods:
    """Compares each reader's count of the excess of each topic with the last one."""

    def __init__(self) -> None:
        self._counted: dict[tuple[str, str], tuple[int, float]] = {}
        self._said_s: dict[str, float] = {}

    def messages_from(self, health: bodies.Health, now_s: float) -> list[str]:
        """Return messages about a reader's report."""
        gauges = health.gauges.items()
        found = {name.removeprefix(FLOOD): frames for name, frames in gauges if name.startswith(FLOOD)}
        return self.messages(health.process, health.pid, found, now_s)

    def messages(self, reader: str, pid: int, floods: Mapping[str, float], now_s: float) -> list[str]:
        """Return messages about a process' counts of frames beyond the rate of each topic."""
        sentences = []
        for topic, frames in floods.items():
            if topic not in TOPICS:
                continue
            before_pid, before = self._counted.get((reader, topic), (pid, 0.0))
            self._counted[reader, topic] = pid, frames
            new = frames - (before if pid == before_pid else 0.0)
            if new <= 0 or now_s - self._said_s.get(topic, float("-inf")) < SAY_AGAIN_S:
                continue
            self._said_s[topic] = now_s
            row = TOPICS[topic]
            text = f"{row.publisher}: floods {topic}: {new:.0f} frames beyond three times {row.rate_hz:g} Hz"
            sentences.append(f"{text}, as {reader} counts them")
        return sentences
