"""The scene for viewers: Foxglove's SceneUpdate, FrameTransforms and Log, of duct, catheter and tools.

Points are rounded to 2^-17 m (8 um), with which they take a third of the space.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from trocar.protocol.bodies import GatewayState, InstrumentState, PhysicsState, SupervisorState, ToolReaction
from trocar.services.mechanics.arrays import Float32Array, FloatArray
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.recordings import encoded
from trocar.services.scenes.drawn_surface import DrawnSurface

WORLD = "world"
SCENE, TRANSFORMS, LOG = "/scene", "/tf", "/log"
#: Message type of each topic of the picture.
SCHEMAS: dict[str, type[Message]] = {SCENE: SceneUpdate, TRANSFORMS: FrameTransforms, LOG: Log}
#: A grid of 7.6 um: finer than any picture, and numbers with zeros at their end, so that files compress.
_ROUNDED = 2.0**17
_DUCT = Color(r=0.83, g=0.55, b=0.5, a=0.55)
_CATHETER = Color(r=0.85, g=0.65, b=0.23, a=1.0)
_STEEL = Color(r=0.7, g=0.72, b=0.75, a=1.0)
# Field numbers by foxglove.SceneUpdate, SceneEntity, LinePrimitive and TriangleListPrimitive:
_ENTITY, _LINES, _TRIANGLES, _LINE_POINTS, _TRIANGLE_POINTS = 2, 11, 12, 5, 2


def descriptor(topic: str) -> bytes:
    """Return the serialised descriptors of a picture topic's messages."""
    data: bytes = build_file_descriptor_set(SCHEMAS[topic]).SerializeToString()
    return data


@dataclass(frozen=True, slots=True)
class _Line:
    points_m: FloatArray
    thickness_m: float


class SceneDrawing:
    """Makes messages from the newest states."""

    def __init__(self, scene: SceneModel, duct: ReducedDuct) -> None:
        self._scene = scene
        self._surface = DrawnSurface(duct)
        indices = duct.mesh.triangles.astype("<u4").ravel().tolist()
        self._triangles: bytes = TriangleListPrimitive(color=_DUCT, indices=indices).SerializeToString()

    def warm_up(self) -> None:
        """Compile the kernels of drawing."""
        self._surface.warm_up()

    def scene_update(self, physics: PhysicsState, gateway: GatewayState | None, time_ns: int) -> bytes:
        """Return the SceneUpdate of a state of physics, with the tools if the devices are known."""
        entities = [self._duct(physics, time_ns)]
        catheter_m = physics.catheter.position_m.view()
        if len(catheter_m):
            line = _Line(catheter_m, 2.0 * physics.catheter.radius_m)
            entities.append(_entity("catheter", time_ns) + _line(line, LinePrimitive.LINE_STRIP, _CATHETER))
        for number, (tool, felt) in enumerate(self._tools(physics, gateway)):
            lines = self._tool(number, tool, felt)
            drawn = (_line(each, LinePrimitive.LINE_LIST, _STEEL) for each in lines)
            entities.append(_entity(f"tool {tool.name}", time_ns) + encoded.joined(drawn))
        return encoded.joined(encoded.field(_ENTITY, entity) for entity in entities)

    def _duct(self, physics: PhysicsState, time_ns: int) -> bytes:
        self._surface.update(physics.duct)
        points = encoded.rows(_rounded(self._surface.points_m), encoded.POINT, _TRIANGLE_POINTS)
        return _entity("duct", time_ns) + encoded.field(_TRIANGLES, self._triangles + points)

    def _tools(
        self, physics: PhysicsState, gateway: GatewayState | None
    ) -> Iterator[tuple[InstrumentState, ToolReaction]]:
        instruments = gateway.instruments if gateway is not None else ()
        reactions = physics.reactions()
        for tool, felt in zip_longest(instruments[: len(self._scene.forceps)], reactions):
            if tool is not None:
                yield tool, felt or ToolReaction()

    def _tool(self, number: int, tool: InstrumentState, felt: ToolReaction) -> Iterator[_Line]:
        """Yield shaft and jaws at the proxy's pose."""
        kind = self._scene.forceps[number]
        is_held = felt.contacts > 0 or felt.holds > 0
        junction = np.array(felt.proxy_position_m if is_held else tool.position_m)
        yield _Line(np.array([tool.port_m, junction]), 2.0 * kind.shaft_radius_m)
        if kind.jaws is None:
            return
        jaws = kind.jaws
        asked = min(max(jaws.jaw_ratio * tool.handle_angle_rad, 0.0), jaws.jaw_max_angle_rad)
        half = 0.5 * (felt.proxy_jaw_angle_rad if is_held and felt.proxy_jaw_angle_rad >= 0.0 else asked)
        along, across = _axes(tool.orientation_wxyz)
        for side in (np.sin(half), -np.sin(half)):
            end = junction + jaws.jaw_length_m * (np.cos(half) * along + side * across)
            yield _Line(np.array([junction, end]), 2.0 * jaws.jaw_radius_m)


def transforms(gateway: GatewayState, time_ns: int) -> bytes:
    """Return the poses of the tools: +x along the shaft, +y where jaw A opens."""
    message = FrameTransforms()
    for tool in gateway.instruments:
        w, x, y, z = tool.orientation_wxyz
        frame = FrameTransform(parent_frame_id=WORLD, child_frame_id=tool.name)
        frame.timestamp.FromNanoseconds(time_ns)
        frame.translation.x, frame.translation.y, frame.translation.z = tool.position_m
        frame.rotation.w, frame.rotation.x, frame.rotation.y, frame.rotation.z = w, x, y, z
        message.transforms.append(frame)
    data: bytes = message.SerializeToString()
    return data


def log(state: SupervisorState, time_ns: int) -> bytes:
    """Return the supervisor's state of the rig as a line of a log."""
    level = {"degraded": Log.WARNING, "safe_stop": Log.ERROR}.get(state.state, Log.INFO)
    message = Log(level=level, name="supervisor", message=": ".join(filter(None, (state.state, state.reason))))
    message.timestamp.FromNanoseconds(time_ns)
    data: bytes = message.SerializeToString()
    return data


def _axes(wxyz: tuple[float, float, float, float]) -> tuple[FloatArray, FloatArray]:
    """Return the first two columns of the rotation of a unit quaternion."""
    w, x, y, z = wxyz
    along = np.array([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)])
    across = np.array([2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)])
    return along, across


def _entity(name: str, time_ns: int) -> bytes:
    entity = SceneEntity(id=name, frame_id=WORLD)
    entity.timestamp.FromNanoseconds(time_ns)
    data: bytes = entity.SerializeToString()
    return data


def _line(line: _Line, kind: Any, colour: Color) -> bytes:
    head: bytes = LinePrimitive(type=kind, thickness=line.thickness_m, color=colour).SerializeToString()
    return encoded.field(_LINES, head + encoded.rows(_rounded(line.points_m), encoded.POINT, _LINE_POINTS))


def _rounded(points_m: FloatArray | Float32Array) -> FloatArray:
    points: FloatArray = np.rint(np.asarray(points_m, np.float64) * _ROUNDED) / _ROUNDED
    return points
