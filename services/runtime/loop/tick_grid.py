"""Moments of the rig: what gateway, haptics and physics say of the same tick, on a fixed grid of ticks.

In simulated time no tick is lost, and each loop sends what it says at a tick of the grid once more, on a slow topic of
which no frame is lost. So whoever judges or records moments gets the same ones in every run, however late everybody is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import msgspec

from trocar.protocol import Frame

#: Moments kept whose frames have not all come: of five seconds, ten times the silence after which a process is
#: replaced.
_KEPT = 128
_STATE_OF = {
    "gateway.moment": "gateway.state",
    "haptics.moment": "haptics.contacts",
    "physics.moment": "physics.state",
}
STATES = tuple(_STATE_OF.values())
MOMENTS = tuple(_STATE_OF)
"""The topics of moments, in the order in which those of a tick are made."""


def as_state(frame: Frame) -> Frame:
    """Return a frame of a moment as one of the state topic whose body it has; others as they are."""
    state = _STATE_OF.get(frame.topic)
    return frame if state is None else msgspec.structs.replace(frame, topic=state)


class Moments:
    """Joins the frames of moments that have the same tick."""

    def __init__(self) -> None:
        self._open: dict[int, dict[str, Frame]] = {}

    def take_frames(self, frames: Iterable[Frame]) -> Iterator[dict[str, Frame]]:
        """Take new frames; yield the moments of which all frames have come, by the names of the state topics."""
        for frame in frames:
            state = as_state(frame)
            moment = self._open.setdefault(state.body.tick, {})
            moment[state.topic] = state
            if len(moment) == len(_STATE_OF):
                del self._open[state.body.tick]
                yield {name: moment[name] for name in _STATE_OF.values()}
        while len(self._open) > _KEPT:
            del self._open[next(iter(self._open))]
