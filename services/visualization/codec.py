"""The view protocol: a JSON hello for each layout, then one small binary frame for each picture.

A frame is little-endian: ``sequence, sent_ns, origin_ns, tick`` as u64, then float32: points (n, 3), centreline
(m, 3), poses (k, 7), jaws (k,), forces (k, 3), inserted length (1,), stones (s, 3). n, m, k and s are in the hello.
The client computes normals, the tube of the catheter and the tools' shapes; a frame of a 500-node duct is about 7 kB.
"""

from __future__ import annotations

import base64
import json
import struct
from typing import Any

import numpy as np

from trocar.services.mechanics.scene.instruments import DrawnPart
from trocar.services.mechanics.scene.wall_bar import WallBar
from trocar.services.visualization.picture import Picture, PictureLayout, ToolShape

PROTOCOL = "trocar-view/1"
#: Of a hello that was kept before stones were drawn.
_NO_STONES: dict[str, tuple[float, ...]] = {"radii_m": ()}
_HEAD = struct.Struct("<4Q")


def encode_hello(layout: PictureLayout) -> str:
    """Return the hello of `layout`; arrays are base64 of little-endian bytes."""
    return json.dumps(
        {
            "type": "hello",
            "protocol": PROTOCOL,
            "units": "m, rad, N, ns",
            "epoch": layout.epoch,
            "scene": layout.scene,
            "duct": {
                "n_points": len(layout.rest_m),
                "rest_f32": _base64(layout.rest_m, "<f4"),
                "triangles_i32": _base64(layout.triangles, "<i4"),
                "thickness_m": layout.thickness_m,
                "mouth": layout.mouth,
                "clamped": layout.clamped,
                "neck": layout.neck,
            },
            "catheter": {"n_points": layout.n_particles, "radius_m": layout.catheter_radius_m},
            "wire": {"n_segments": layout.n_wire_segments, "radius_m": layout.wire_radius_m},
            "bars": [
                {
                    "nodes": bar.nodes,
                    "weights": bar.weights,
                    "along": bar.along,
                    "outward": bar.outward,
                    "size_m": bar.size_m,
                }
                for bar in layout.bars
            ],
            "stones": {"radii_m": layout.stone_radii_m},
            "tools": [
                {
                    "name": tool.name,
                    "port_m": tool.port_m,
                    "shaft_radius_m": tool.shaft_radius_m,
                    "parts": [{"material": part.material, "profile_m": part.profile} for part in tool.parts],
                    "jaw_length_m": tool.jaw_length_m,
                    "jaw_radius_m": tool.jaw_radius_m,
                }
                for tool in layout.tools
            ],
        }
    )


def decode_hello(text: str) -> PictureLayout:
    """Return the layout in a hello. Raises ValueError for another protocol."""
    hello = json.loads(text)
    if hello.get("protocol") != PROTOCOL:
        raise ValueError(f"view protocol {hello.get('protocol')!r}, this is {PROTOCOL!r}")
    duct, catheter = hello["duct"], hello["catheter"]
    return PictureLayout(
        epoch=hello["epoch"],
        scene=hello["scene"],
        rest_m=_rows(duct["rest_f32"], "<f4"),
        triangles=_rows(duct["triangles_i32"], "<i4"),
        thickness_m=duct["thickness_m"],
        mouth=tuple(duct["mouth"]),
        clamped=tuple(duct["clamped"]),
        neck=duct.get("neck", False),
        n_particles=catheter["n_points"],
        catheter_radius_m=catheter["radius_m"],
        tools=tuple(map(_tool, hello["tools"])),
        n_wire_segments=hello["wire"]["n_segments"],
        wire_radius_m=hello["wire"]["radius_m"],
        bars=tuple(WallBar(**{key: tuple(value) for key, value in bar.items()}) for bar in hello.get("bars", ())),
        stone_radii_m=tuple(hello.get("stones", _NO_STONES)["radii_m"]),
    )


def _tool(said: dict[str, Any]) -> ToolShape:
    parts = tuple(DrawnPart(part["material"], tuple(map(tuple, part["profile_m"]))) for part in said["parts"])
    return ToolShape(**{**said, "port_m": tuple(said["port_m"]), "parts": parts})


def encode(picture: Picture, sent_ns: int) -> bytes:
    """Return the frame of `picture`, sent at `sent_ns` of the monotonic clock."""
    head = _HEAD.pack(picture.sequence, sent_ns, picture.origin_ns, picture.tick)
    arrays = (picture.points_m, picture.centreline_m, picture.poses, picture.jaw_rad, picture.force_n)
    inserted = struct.pack("<f", picture.inserted_length_m)
    stones = np.ascontiguousarray(picture.stones_m, "<f4").tobytes()
    return b"".join((head, *(np.ascontiguousarray(a, "<f4").tobytes() for a in arrays), inserted, stones))


def decode(data: bytes, layout: PictureLayout) -> tuple[Picture, int]:
    """Return the picture in a frame of `layout`, and its time of sending.

    Raises ValueError if the frame's length does not fit the layout.
    """
    sequence, sent_ns, origin_ns, tick = _HEAD.unpack_from(data)
    values = np.frombuffer(data, "<f4", offset=_HEAD.size)
    k = len(layout.tools)
    shapes = (
        (len(layout.rest_m), 3),
        (layout.n_particles, 3),
        (k, 7),
        (k,),
        (k, 3),
        (1,),
        (len(layout.stone_radii_m), 3),
    )
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    if ends[-1] != len(values):
        raise ValueError(f"view frame holds {len(values)} numbers, its layout says {ends[-1]}")
    parts = [part.reshape(shape) for part, shape in zip(np.split(values, ends[:-1]), shapes, strict=True)]
    points, centreline, poses, jaw, force, inserted, stones = parts
    picture = Picture(
        layout.epoch, sequence, tick, origin_ns, points, centreline, poses, jaw, force, float(inserted[0]), stones
    )
    return picture, sent_ns


def _base64(array: np.ndarray[Any, Any], dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype).tobytes()).decode()


def _rows(text: str, dtype: str) -> Any:
    return np.frombuffer(base64.b64decode(text), dtype).reshape(-1, 3)
