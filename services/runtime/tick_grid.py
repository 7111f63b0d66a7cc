"""Frames of a fast topic on a fixed grid of the rig's ticks: the same ones however late the reader is.

In simulated time no tick is lost, so that whoever judges or records frames of the grid gets the same ones in every run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from trocar.protocol import Frame

EVERY_TICKS = 40
"""Ticks between two points of the grid: 25 frames a second."""
#: Frames of each other topic that are kept until their physics comes, of a second.
_KEPT_TICKS = 1000


class GridFilter:
    """Lets through the first frame of a topic at or after each point of the grid."""

    def __init__(self) -> None:
        self._due = self._last = -1

    def chosen(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """Yield those of the frames that are on the grid. A smaller tick means that the gateway has restarted."""
        for frame in frames:
            tick = frame.body.tick
            if tick < self._last:
                self._due = tick
            self._last = tick
            if tick >= self._due:
                self._due = tick - tick % EVERY_TICKS + EVERY_TICKS
                yield frame


class GridMoments:
    """Joins the frames of several topics that have the same tick of the grid.

    Args:
        topics: The topics in the order in which the frames of a tick are made; the last one decides on the grid.
    """

    def __init__(self, topics: Iterable[str]) -> None:
        *others, self._last = topics
        self._filter = GridFilter()
        self._kept: dict[str, dict[int, Frame]] = {name: {} for name in others}
        self._open: list[Frame] = []

    def take(self, frames: Mapping[str, list[Frame]]) -> Iterator[dict[str, Frame]]:
        """Take all new frames of each topic; yield each tick of the grid of which all frames have come."""
        for name, kept in self._kept.items():
            for frame in frames.get(name, ()):
                _keep(kept, frame)
        for frame in self._filter.chosen(frames.get(self._last, ())):
            self._open = [each for each in self._open if each.body.tick < frame.body.tick] + [frame]
        while self._open:
            tick = self._open[0].body.tick
            found = {name: kept[tick] for name, kept in self._kept.items() if tick in kept}
            missing = self._kept.keys() - found.keys()
            if any(max(self._kept[name], default=-1) < tick for name in missing):
                return  # it is still on its way
            state = self._open.pop(0)
            if not missing:
                yield {**found, self._last: state}


def _keep(kept: dict[int, Frame], frame: Frame) -> None:
    """Keep the newest frames by tick; those from before a restart of the gateway are forgotten."""
    tick = frame.body.tick
    if kept and tick < next(reversed(kept)):
        kept.clear()
    kept[tick] = frame
    while len(kept) > _KEPT_TICKS:
        del kept[next(iter(kept))]
