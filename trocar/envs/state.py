"""Observation of mode ``state`` for an insertion."""

from __future__ import annotations

import io
from collections.abc import Iterable
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from trocar.protocol.bodies import GatewayState, PhysicsState, ToolContacts
from trocar.protocol.bodies.physics import REACTION_COLUMNS, REACTION_FORCE, REACTION_PROXY_OPENING
from trocar.protocol.topics import TICK_S
from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.training.site import Site

N_POINTS = 6
SPACING_M = 8e-3
_CATHETER = 1
_RIM = 1.2
"""Radius of a sphere about the middle of the mouth that contains its rim, in radii."""


class Field(NamedTuple):
    """A part of the observation: shape, unit, largest absolute value, and description.

    Values beyond that are clipped.
    """

    name: str
    shape: tuple[int, ...]
    unit: str
    most: float
    what: str


FIELDS = (
    Field("junction", (N_TOOLS, 3), "m", 0.2, "J of each tool from the mouth at rest"),
    Field("roll", (N_TOOLS,), "rad", 3.15, "of each tool about its shaft"),
    Field("handle", (N_TOOLS,), "rad", 3.15, "opening of each handle"),
    Field("jaws", (N_TOOLS,), "rad", 3.15, "opening at which each tool's jaws are"),
    Field("force", (N_TOOLS, 3), "N", 20.0, "on each tool at J"),
    Field("holds_catheter", (N_TOOLS,), "1", 1.0, "1 where a tool holds the catheter"),
    Field("holds_duct", (N_TOOLS,), "1", 1.0, "1 where a tool holds the duct"),
    Field("catheter", (N_POINTS, 3), "m", 0.3, "points of the catheter from the mouth at rest, tip first, 8 mm apart"),
    Field("mouth", (3,), "m", 0.1, "how far the mouth's middle has moved"),
    Field("inserted", (1,), "m", 0.3, "length of catheter in the lumen"),
    Field("time", (1,), "s", 1000.0, "since the beginning"),
)
"""Axes are those of the scene."""


def most_of(fields: tuple[Field, ...]) -> Float32Array:
    """Return the largest absolute value of each number of the concatenated fields."""
    return np.concatenate([np.full(int(np.prod(f.shape)), f.most, np.float32) for f in fields])


MOST = most_of(FIELDS)
SIZE = len(MOST)


def places(fields: tuple[Field, ...] = FIELDS) -> dict[str, slice]:
    """Return the slice of each field in the observation."""
    ends = np.cumsum([0, *(int(np.prod(each.shape)) for each in fields)]).tolist()
    return {each.name: slice(a, b) for each, a, b in zip(fields, ends[:-1], ends[1:], strict=True)}


class View(Protocol):
    """Reads an observation from the frames of a moment, live or recorded."""

    def read(self, devices: GatewayState, contacts: ToolContacts, solved: PhysicsState) -> Float32Array:
        """Return the observation as float32."""


class StateView:
    """Reads the observation of an insertion.

    Args:
        site: Site. Site of the mouth.
        duct_file: bytes. The duct's attachment of a recording.
    """

    def __init__(self, site: Site, duct_file: bytes) -> None:
        self._mouth_m = np.array(site.mouth_m)
        with np.load(io.BytesIO(duct_file), allow_pickle=False) as duct:
            near = np.linalg.norm(duct["vertices_m"] - self._mouth_m, axis=1) < _RIM * site.mouth_radius_m
            self._mouth_modes: FloatArray = duct["modes"][near].mean(axis=0, dtype=np.float64)

    def read(self, devices: GatewayState, contacts: ToolContacts, solved: PhysicsState) -> Float32Array:
        """Return the observation (`SIZE`,) as float32."""
        hands = np.zeros((N_TOOLS, 5))
        for row, each in zip(hands, devices.instruments, strict=False):
            row[:] = *each.position_m, each.roll_rad, each.handle_angle_rad
            row[:3] -= self._mouth_m
        tools = np.zeros((N_TOOLS, REACTION_COLUMNS))
        told = solved.tools.view()[:N_TOOLS]
        tools[: len(told)] = told
        held = np.zeros((2, N_TOOLS))
        for hold in contacts.holds:
            held[0 if hold.target_kind == _CATHETER else 1, hold.tool] = 1.0
        q = solved.duct.q.view()
        parts = (
            hands[:, :3], hands[:, 3], hands[:, 4], tools[:, REACTION_PROXY_OPENING],
            tools[:, REACTION_FORCE : REACTION_FORCE + 3], held, points_m(solved) - self._mouth_m,
            self._mouth_modes[:, : len(q)] @ q, (solved.catheter.inserted_length_m, solved.tick * TICK_S),
        )  # fmt: skip
        return joined(parts, MOST)


def joined(parts: Iterable[ArrayLike], most: Float32Array) -> Float32Array:
    """Return the concatenated parts of an observation, clipped to the largest absolute values."""
    read = np.concatenate([np.ravel(part) for part in parts]).astype(np.float32)
    return np.maximum(np.minimum(read, most, out=read), -most, out=read)


def points_m(solved: PhysicsState, count: int = N_POINTS, spacing_m: float = SPACING_M) -> FloatArray:
    """Return points (count, 3) of the catheter, tip first, repeating the end of a shorter one."""
    particles = solved.catheter.position_m.view()[::-1]
    segment_m = float(np.linalg.norm(particles[0] - particles[1]))
    step = max(1, round(spacing_m / segment_m)) if segment_m > 0.0 else 1
    points: FloatArray = particles[_every(step, count, len(particles))]
    return points


@cache
def _every(step: int, count: int, n: int) -> IntArray:
    """Return ``count`` indices of n in steps of ``step``, repeating the last one."""
    return np.minimum(step * np.arange(count, dtype=np.int32), n - 1)
