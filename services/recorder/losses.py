"""Frames missing in a recording: how many of which topic, when, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import trocar.protocol.bodies as bodies

#: Reason of a loss if the bus gives no other.
QUEUES = "the recorder was not run for longer than the queues hold"
DISK = "the disk is too slow"
#: Period of reports of continuing losses, with their sum: as long as for other events of which only numbers change.
_SAY_EVERY_NS = 10_000_000_000


@dataclass(frozen=True, slots=True)
class Loss:
    """Missing frames, lost between two times of the monotonic clock."""

    topic: str
    frames: int
    why: str
    from_ns: int
    until_ns: int


class Losses:
    """Compares counts, which only grow, with those already reported."""

    def __init__(self, now_ns: int) -> None:
        self.total: Counter[tuple[str, str]] = Counter()
        self._looked_ns = now_ns
        self._unsaid: dict[tuple[str, str], Loss] = {}
        self._said_ns: dict[tuple[str, str], int] = {}

    def find_new(self, counts: Mapping[tuple[str, str], int], now_ns: int) -> list[Loss]:
        """Return the losses since the last call, given counts of frames by topic and reason."""
        since_ns, self._looked_ns = self._looked_ns, now_ns
        new = Counter(counts) - self.total
        self.total += new
        return [Loss(topic, frames, why, since_ns, now_ns) for (topic, why), frames in new.items()]

    def due_reports(self, new: Iterable[Loss], now_ns: int) -> list[Loss]:
        """Return the losses to report now: new ones at once, continuing ones every ten seconds, summed.

        A line each second would fill the rig's history.
        """
        for loss in new:
            key = loss.topic, loss.why
            kept = self._unsaid.get(key, replace(loss, frames=0))
            self._unsaid[key] = replace(loss, frames=kept.frames + loss.frames, from_ns=kept.from_ns)
        due = [key for key in self._unsaid if now_ns - self._said_ns.get(key, -_SAY_EVERY_NS) >= _SAY_EVERY_NS]
        self._said_ns |= dict.fromkeys(due, now_ns)
        return [self._unsaid.pop(key) for key in due]

    def sentence(self) -> str:
        """Return a sentence on all losses, empty for none."""
        if not self.total:
            return ""
        parts = ", ".join(f"{frames} of {topic} ({why})" for (topic, why), frames in self.total.most_common())
        return f"lost {self.total.total()} frames: {parts}"


def counts(reports: Iterable[bodies.TopicReport], too_slow: Mapping[str, int]) -> dict[tuple[str, str], int]:
    """Return counts of frames lost by topic and reason: in transit and refused, by the bus, and for the disk."""
    found = {(topic, DISK): frames for topic, frames in too_slow.items()}
    for report in reports:
        refused = sum(report.refused.values())
        found[report.topic, QUEUES] = max(
            0, report.dropped - refused
        )  # refused frames are missing in the sequence, too
        found |= {(report.topic, f"refused: {reason}"): frames for reason, frames in report.refused.items()}
    return {key: frames for key, frames in found.items() if frames}
