"""Capsule against capsule: segments of tools against segments of the catheter, and the catheter against itself.

Each pair of segments within reach remembers its normal. When the axes have passed through each other the new
normal points against the old one: the old one stands and the distance counts negative, so that nothing slips
through. Around a free end the normal may turn all the way.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.pairs import CATHETER_SEGMENT
from services.mechanics.collision.primitives import closest_of_segments, put, vector
from services.mechanics.collision.writer import Rows, write_pair
from services.mechanics.compiled import Struct, fill, flags, floats, ints, kernel, struct_reader, struct_type
from services.mechanics.compiled.vectors import Vector, along, cross, dot, scaled, subtract, unit

Tools = tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]
"""(segments (n_tools, 3, 2, 3), radii (n_tools, 3), present (n_tools,))."""

# Contacts per tool segment: the deepest in each of so many equal stretches of it.
STRETCHES = 6
_TOUCHING_M = 1e-9
NONE = -1


Memory = Struct
MEMORY = struct_type(
    arrays=(
        "active",  # (m, n) int8, one where the pair was within reach at the last tick
        "normal",  # (m, n, 3) towards the first body, of active pairs
        "best",  # (STRETCHES,) int32 second segment of the deepest contact in each stretch, or NONE
        "found",  # (STRETCHES, 6) its s, t, distance and normal
    ),
    counts=("n_second",),
)
memory_at = struct_reader(MEMORY)


class CapsuleMemory:
    """Memory of m first segments against n second ones."""

    def __init__(self, m: int, n: int) -> None:
        self._storage = np.zeros(1, MEMORY)
        self.address: int = self._storage.ctypes.data
        self._active = np.zeros((m, n), np.int8)
        self._alive: dict[str, np.ndarray] = {
            "normal": np.zeros((m, n, 3)),
            "best": np.zeros(STRETCHES, np.int32),
            "found": np.zeros((STRETCHES, 6)),
        }
        fill(self._storage[0], active=self._active, n_second=n, **self._alive)

    def reset(self) -> None:
        """Drop the past of every pair."""
        self._active.fill(0)


@kernel
def segment_ends(tools: Tools, tool: int, segment: int) -> tuple[Vector, Vector]:
    """Return start and end of a segment of a tool."""
    e = tools[0]
    return (
        (e[tool, segment, 0, 0], e[tool, segment, 0, 1], e[tool, segment, 0, 2]),
        (e[tool, segment, 1, 0], e[tool, segment, 1, 1], e[tool, segment, 1, 2]),
    )


@kernel
def row_of(array: FloatArray, i: int) -> Vector:
    """Return row i of an (n, 3) array."""
    return (array[i, 0], array[i, 1], array[i, 2])


@kernel
def meet(
    memory: Memory, pair: int, first: tuple[Vector, Vector], second: tuple[Vector, Vector], reach: float
) -> tuple[float, float, float, Vector]:
    """Return (s, t, signed distance of the axes, normal towards the first) and remember the normal.

    The distance is infinite out of reach.
    """
    active, normals = flags(memory.active), floats(memory.normal)
    s, t, d2 = closest_of_segments(first[0], first[1], second[0], second[1])
    if not d2 < reach * reach:
        active[pair] = 0
        return (s, t, math.inf, (0.0, 0.0, 0.0))
    distance, was_active, old = math.sqrt(d2), active[pair] == 1, vector(normals, pair)
    u, v = subtract(first[1], first[0]), subtract(second[1], second[0])
    if distance > _TOUCHING_M:
        away = subtract(along(first[0], u, s), along(second[0], v, t))
        normal = scaled(away, 1.0 / distance)
    else:
        normal = old if was_active else unit(cross(u, v))
    if was_active and 0.0 < s < 1.0 and dot(normal, old) < 0.0:
        normal, distance = scaled(normal, -1.0), -distance
    active[pair] = 1
    put(normals, pair, normal)
    return (s, t, distance, normal)


@kernel
def detect_capsules(
    memory: Memory, tools: Tools, particles: FloatArray, sizes: tuple[float, float, float], rows: Rows
) -> None:
    """Append pairs of tool segments with catheter segments; ``sizes`` holds (-, catheter radius, margin)."""
    n_segments = tools[0].shape[1]
    for tool in range(tools[0].shape[0]):
        for segment in range(n_segments):
            i = tool * n_segments + segment
            if tools[2][tool]:
                thickness = tools[1][tool, segment] + sizes[1]
                ends = segment_ends(tools, tool, segment)
                _find_deepest(memory, i, ends, particles, thickness + sizes[2])
                _write_deepest(memory, (tool, segment), (thickness, sizes[2]), rows)
            else:
                for j in range(memory.n_second):
                    flags(memory.active)[i * memory.n_second + j] = 0


@kernel
def _find_deepest(memory: Memory, i: int, ends: tuple[Vector, Vector], particles: FloatArray, reach: float) -> None:
    """Find the deepest contact of first segment i in each of its stretches."""
    best, found = ints(memory.best), floats(memory.found)
    for stretch in range(STRETCHES):
        best[stretch] = NONE
    for j in range(memory.n_second):
        second = (row_of(particles, j), row_of(particles, j + 1))
        s, t, distance, normal = meet(memory, i * memory.n_second + j, ends, second, reach)
        if distance == math.inf:
            continue
        stretch = min(int(s * STRETCHES), STRETCHES - 1)
        if best[stretch] == NONE or distance < found[6 * stretch + 2]:
            best[stretch] = j
            put(found, 2 * stretch, (s, t, distance))
            put(found, 2 * stretch + 1, normal)


@kernel
def _write_deepest(memory: Memory, who: tuple[int, int], sizes: tuple[float, float], rows: Rows) -> None:
    for stretch in range(STRETCHES):
        s, t, distance = vector(floats(memory.found), 2 * stretch)
        target = ints(memory.best)[stretch]
        if target != NONE and distance - sizes[0] < sizes[1]:
            pair = (who[0], who[1], -1, CATHETER_SEGMENT, target, s, (1.0 - t, t, 0.0))
            write_pair(rows, pair, distance - sizes[0], vector(floats(memory.found), 2 * stretch + 1))
