"""Composes pictures from the newest frames of the bus."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

import trocar.protocol.bodies as bodies
from trocar.protocol import Frame
from trocar.protocol.topics import observed_by
from trocar.services.mechanics.bodies.sections import segment_radii
from trocar.services.mechanics.effects import build_effects
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scene import ForcepsScene, SceneModel, ToolScene
from trocar.services.runtime.bus.bus import Bus
from trocar.services.scenes.drawn_surface import DrawnSurface
from trocar.services.visualization import tool_pose
from trocar.services.visualization.picture import Picture, PictureLayout, ToolShape

#: Longer than the period of sampled topics, far shorter than a picture's.
PATIENCE_NS = 4_000_000
#: Topics of a picture, which needs one in sixteen frames of a 1 kHz topic.
TOPICS = observed_by("visualization")
_USUAL = ForcepsScene()


class Composer:
    """Keeps the newest frame of each topic and composes pictures.

    Attributes:
        layout: PictureLayout. Layout of the next picture; a new object with a higher epoch at each change of duct,
            catheter or tools.
        refused: int. Number of frames whose duct does not fit this basis.
    """

    def __init__(
        self, bus: Bus, scene: SceneModel, scene_name: str, duct: ReducedDuct, topics: Iterable[str] = TOPICS
    ) -> None:
        self._topics = tuple(topics)
        self._bus = bus
        self._scene = scene
        self._surface = DrawnSurface(duct)
        self._newest: dict[str, Frame] = {}
        self._sequence = 0
        self._origin_ns = 0
        self.refused = 0
        effects = build_effects(scene).values()
        self._stones_m = np.concatenate([np.zeros((0, 3)), *(effect.sphere_places_m() for effect in effects)])
        self.layout = PictureLayout(
            epoch=1,
            scene=scene_name,
            rest_m=self._surface.points_m,
            triangles=duct.mesh.triangles,
            thickness_m=scene.duct.thickness_m,
            mouth=_nodes(duct, "mouth"),
            clamped=_nodes(duct, "clamped"),
            neck=scene.duct.incision is not None,
            n_particles=0,
            catheter_radius_m=0.5 * scene.catheter.outer_diameter_m,
            tools=(),
            n_wire_segments=scene.catheter.n_rod_segments - scene.catheter.n_segments,
            wire_radius_m=float(segment_radii(scene.catheter)[-1]),
            bars=tuple(bar for effect in effects for bar in effect.bars(duct.mesh)),
            stone_radii_m=tuple(radius_m for effect in effects for radius_m in effect.sphere_radii_m()),
        )

    def compose(self) -> Picture:
        """Update `layout` and return the present picture."""
        for topic, frame in self._bus.sample(self._topics, time.monotonic_ns() + PATIENCE_NS).items():
            self._newest[topic] = frame
            if topic == "physics.state" and not self._surface.update(frame.body.duct):
                self.refused += 1
        physics: bodies.PhysicsState | None = self._body("physics.state")
        catheter = None if physics is None else physics.catheter
        gateway: bodies.GatewayState | None = self._body("gateway.state")
        self._lay_out(catheter, gateway)
        self._sequence += 1
        picture = Picture(self.layout.epoch, self._sequence, origin_ns=self._new_origin())
        picture.points_m = self._surface.points_m
        if physics is not None and physics.stones_m.shape == self._stones_m.shape:
            self._stones_m = physics.stones_m.view()
        picture.stones_m = self._stones_m.astype(np.float32)
        if catheter is not None:
            picture.centreline_m = catheter.position_m.view().astype(np.float32)
            picture.inserted_length_m = catheter.inserted_length_m
        if gateway is not None:
            picture.tick = gateway.tick
            reactions = () if physics is None else physics.reactions(len(gateway.instruments))
            self._pose_tools(picture, gateway.instruments, reactions)
        return picture

    def devices(self) -> bodies.GatewayState | None:
        """Return the gateway's last state, None before the first."""
        gateway: bodies.GatewayState | None = self._body("gateway.state")
        return gateway

    def _body(self, topic: str) -> Any:
        frame = self._newest.get(topic)
        return None if frame is None else frame.body

    def _new_origin(self) -> int:
        """Return the device sample that this picture is the first to show, 0 if it shows no new one.

        The deformed duct is the last link of the chain, so its sample counts if physics runs.
        """
        frame = self._newest.get("physics.state") or self._newest.get("gateway.state")
        origin_ns = frame.origin_ns if frame is not None else 0
        if origin_ns == self._origin_ns:
            return 0
        self._origin_ns = origin_ns
        return origin_ns

    def _lay_out(self, catheter: bodies.Catheter | None, gateway: bodies.GatewayState | None) -> None:
        """Make a new layout if new frames do not fit the present one."""
        old = self.layout
        particles, radius_m, tools = old.n_particles, old.catheter_radius_m, old.tools
        if catheter is not None:
            particles, radius_m = catheter.position_m.shape[0], catheter.radius_m
        if gateway is not None:
            tools = tuple(self._shape(i, instrument) for i, instrument in enumerate(gateway.instruments))
        if (particles, radius_m, tools) != (old.n_particles, old.catheter_radius_m, old.tools):
            self.layout = replace(
                old, epoch=old.epoch + 1, n_particles=particles, catheter_radius_m=radius_m, tools=tools
            )

    def _shape(self, index: int, instrument: bodies.InstrumentState) -> ToolShape:
        """Return the shape of an instrument, that of the scene's tool of the same index."""
        tool = self._tool(index)
        jaws = (tool.jaws.jaw_length_m, tool.jaws.jaw_radius_m) if tool.jaws else (0.0, 0.0)
        return ToolShape(instrument.name, instrument.port_m, tool.shaft_radius_m, tool.drawn(), *jaws)

    def _pose_tools(
        self,
        picture: Picture,
        instruments: tuple[bodies.InstrumentState, ...],
        reactions: tuple[bodies.ToolReaction, ...],
    ) -> None:
        k = len(instruments)
        picture.poses = np.zeros((k, 7), np.float32)
        picture.jaw_rad = np.zeros(k, np.float32)
        picture.force_n = np.zeros((k, 3), np.float32)
        for i, instrument in enumerate(instruments):
            reaction = reactions[i] if i < len(reactions) else None
            at = tool_pose.junction(instrument, reaction)
            picture.poses[i, :3] = at
            picture.poses[i, 3:] = tool_pose.orientation(at, instrument.port_m, instrument.roll_rad)
            picture.jaw_rad[i] = self._jaw(i, instrument, reaction)
            if reaction is not None:
                picture.force_n[i] = reaction.force_n

    def _tool(self, index: int) -> ToolScene:
        tools = self._scene.forceps
        return tools[min(index, len(tools) - 1)] if tools else _USUAL

    def _jaw(self, index: int, instrument: bodies.InstrumentState, reaction: bodies.ToolReaction | None) -> float:
        """Return the opening of the jaws, where a held body stops them or as commanded."""
        jaws = self._tool(index).jaws
        if jaws is None:
            return 0.0
        if reaction is not None and reaction.proxy_jaw_angle_rad >= 0.0:
            return reaction.proxy_jaw_angle_rad
        return min(max(jaws.jaw_ratio * instrument.handle_angle_rad, 0.0), jaws.jaw_max_angle_rad)


def _nodes(duct: ReducedDuct, vertex_set: str) -> tuple[int, ...]:
    return tuple(int(node) for node in duct.mesh.vertex_sets.get(vertex_set, ()))
