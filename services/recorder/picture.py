"""The picture in a recording: scene, tools and log, ten times a second, for Foxglove and Rerun."""

from __future__ import annotations

from collections.abc import Iterator

from trocar.protocol import Frame
from trocar.services.recordings.scene_update import LOG, SCENE, TRANSFORMS, SceneDrawing, log, transforms

#: Ten a second look continuous; each costs a few milliseconds, so that all take some per cent of a core.
_PERIOD_NS = 100_000_000
#: Topic, sending time on the bus' clock, content with times of the wall clock.
Drawn = tuple[str, int, bytes]


class PictureRecorder:
    """Draws the newest frames when due; without a `drawing` only tools and log."""

    def __init__(self, to_wall_ns: int) -> None:
        self.drawing: SceneDrawing | None = None
        self._to_wall_ns = to_wall_ns
        self._newest: dict[str, Frame] = {}
        self._due_ns = 0
        self._drawn: tuple[int, int] = (0, 0)
        self._said = ("", "")

    def see(self, frame: Frame) -> None:
        """Store a frame of the bus."""
        self._newest[frame.topic] = frame

    def draw(self, now_ns: int) -> Iterator[Drawn]:
        """Yield new drawings, if they are due."""
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + _PERIOD_NS
        gateway, physics = self._newest.get("gateway.state"), self._newest.get("physics.state")
        if physics is not None and self.drawing is not None and self._is_new(physics):
            tools = None if gateway is None else gateway.body
            yield SCENE, physics.sent_ns, self.drawing.scene_update(physics.body, tools, self._wall(physics))
        if gateway is not None and gateway.body.instruments:
            yield TRANSFORMS, gateway.sent_ns, transforms(gateway.body, self._wall(gateway))
        supervisor = self._newest.pop("supervisor.state", None)
        if supervisor is not None and (supervisor.body.state, supervisor.body.reason) != self._said:
            self._said = supervisor.body.state, supervisor.body.reason
            yield LOG, supervisor.sent_ns, log(supervisor.body, self._wall(supervisor))

    def _is_new(self, frame: Frame) -> bool:
        drawn, self._drawn = self._drawn, (frame.incarnation, frame.sequence)
        return drawn != self._drawn

    def _wall(self, frame: Frame) -> int:
        return frame.sent_ns + self._to_wall_ns
