"""The shape that a duct under constant loads begins with: as near to equilibrium as what lies in it lets it.

Catheter and stones are placed in the duct at rest. Where the loads, as a pressure or the wall's own weight, would press
the wall through them, it begins at a share of their shape at which both are clear, and goes on from there in contact.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.contact.working_set import tolerated_overlap_m
from trocar.services.mechanics.world import World

#: Part of the least distance from the wall's middle surface by which the wall may move between two looks: what it
#: passes it is seen to touch.
STRIDE = 0.5
#: Of the share that is looked for, between two looks.
HALVINGS = 10


def begin_sound(world: World) -> None:
    """Take the wall back to the largest share of its shape at which nothing overlaps it deeper than tolerated.

    A scene in which something overlaps the wall at rest begins as it is.
    """
    duct, whole = world.duct, world.duct.state.q.copy()
    if not whole.any():
        return
    share = _sound_share(world, whole, tolerated_overlap_m(world.scene.duct.thickness_m))
    duct.state.q[:] = share * whole
    if share < 1.0:
        duct.state.qddot[:] = (1.0 - share) * duct.constant_modal_force
    world.search.forget()


def _sound_share(world: World, whole: FloatArray, tolerance_m: float) -> float:
    if _gap_m(world, 0.0 * whole) < -tolerance_m:
        return 1.0
    spheres = world.system.geometry.spheres
    thinnest_m = min(float(world.catheter.radii_m.min()), float(spheres.radius[: spheres.count].min(initial=math.inf)))
    thickness_m = 0.5 * world.scene.duct.thickness_m + thinnest_m
    looks = math.ceil(world.duct.furthest_m(whole) / (STRIDE * thickness_m))
    for look in range(1, looks + 1):
        if _gap_m(world, look / looks * whole) < -tolerance_m:
            return _largest(world, whole, ((look - 1) / looks, look / looks), tolerance_m)
    return 1.0


def _largest(world: World, whole: FloatArray, between: tuple[float, float], tolerance_m: float) -> float:
    low, high = between
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _gap_m(world, middle * whole) >= -tolerance_m else (low, middle)
    return low


def _gap_m(world: World, q: FloatArray) -> float:
    """Return the least gap (m) of catheter and stones to the wall with these coordinates, negative for an overlap."""
    world.duct.q_start[:] = q
    world.search.forget()
    world.search.begin(world.system)
    return world.search.least_gap_m
