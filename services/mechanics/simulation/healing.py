"""States that no hand can have brought about are found at the end of a step, and the last sound one is taken up again.

What is sound is judged by what bodies can do at all, not by what is likely: numbers that are finite, a catheter that is
neither torn nor shot, no particle of it beyond the middle of the wall, and none in the lumen that did not come by an
opening. A state that is taken up again is at rest, so that nothing is gained by it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from services.mechanics.arrays import AnyArray, FloatArray
from services.mechanics.collision.pairs import NO_TOOL
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact import laws
from services.mechanics.contact.rows import NO_STONE, ContactRows, rows_at
from services.mechanics.world import World

# A bent catheter that is let go reaches 6 m/s at its tip; a duct pulled 20 mm aside comes back at 11 m/s.
FASTEST_M_S = 30.0
# A polymer yields at a few per cent; the strongest pull of both grips stretches a catheter by two.
MOST_STRETCH = 0.25
# Copies are made so many steps apart, and two are kept: the newer one may already be on its way to what is not sound.
APART = 16


class Copies:
    """Copies of live arrays, which must be changed in place and never replaced: the last two and the first."""

    def __init__(self, arrays: Sequence[AnyArray]) -> None:
        self._arrays = list(arrays)
        self._kept = [[array.copy() for array in self._arrays] for _ in range(2)]
        self._newest = 0

    def keep(self) -> None:
        """Copy what is there over the older copy."""
        self._newest = 1 - self._newest
        for array, copy in zip(self._arrays, self._kept[self._newest], strict=True):
            np.copyto(copy, array)

    def restore(self) -> None:
        """Put the older copy back, and forget the newer one."""
        older = self._kept[1 - self._newest]
        for array, copy, newer in zip(self._arrays, older, self._kept[self._newest], strict=True):
            np.copyto(array, copy)
            np.copyto(newer, copy)


class Healer:
    """Watches a world, and heals it.

    Attributes
    ----------
    healed : int
        How often, since the start.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._copies: Copies | None = None
        self._steps = 0
        self._deepest_m = 0.5 * world.scene.duct.thickness_m
        self.healed = 0

    def watch(self) -> bool:
        """Return whether the state at the end of a step is sound, and keep a copy now and then.

        A scene that a caller has begun in a state that is not sound is left to come out of it, while its numbers are.
        """
        world = self._world
        rod, duct = world.catheter.state, world.duct.state
        bounds = (world.catheter.properties.segment_length_m * (1.0 + MOST_STRETCH), FASTEST_M_S)
        tools = world.tools
        is_sound = (
            depth_in_wall_m(world.system.rows.address) < self._deepest_m
            and are_sound((rod.position_m, rod.velocity_m_s), (duct.q, duct.qdot), (tools.proxy, tools.hand), bounds)
            and world.search.is_sound()
        )
        if is_sound:
            if self._steps % APART == 0:
                self._keep()
            self._steps += 1
        return is_sound or self._copies is None

    def heal(self) -> None:
        """Go back to the last sound state, at rest; whoever holds something lets go."""
        self.healed += 1
        world = self._world
        if self._copies is not None:
            self._copies.restore()
        self._steps = 1
        world.duct.halt()
        world.catheter.halt()
        world.tools.update_pose()
        world.holds.lose()
        world.system.forget()
        world.seal.forget()

    def _keep(self) -> None:
        if self._copies is None:
            self._copies = Copies(self._arrays())
        else:
            self._copies.keep()

    def _arrays(self) -> list[AnyArray]:
        world = self._world
        arrays = [*world.duct.state_arrays(), *world.catheter.state_arrays(), *world.tools.state_arrays()]
        arrays += world.search.state_arrays()
        for effect in world.effects:
            arrays += effect.state_arrays()
        return arrays


@kernel
def depth_in_wall_m(rows_address: Address[ContactRows]) -> float:
    """Return how deep particles of the catheter were in the wall when the step began."""
    rows, deepest = rows_at(rows_address), 0.0
    for row in range(rows.n_contacts):
        weight = rows.duct_weight[row, 0] + rows.duct_weight[row, 1] + rows.duct_weight[row, 2]
        is_wall = weight > 0.0 and rows.tool[row] == NO_TOOL and rows.stone[row] == NO_STONE
        if is_wall and laws.HAS_GAP[rows.law[row]]:
            deepest = max(deepest, -rows.gap_m[row])
    return deepest


@kernel
def are_sound(
    rod: tuple[FloatArray, FloatArray],
    duct: tuple[FloatArray, FloatArray],
    tools: tuple[FloatArray, FloatArray],
    bounds: tuple[float, float],
) -> bool:
    """Return whether all numbers are finite and the catheter is neither longer nor faster than ``bounds``."""
    (position, velocity), (q, qdot) = rod, duct
    total = 0.0
    for i in range(position.shape[0]):
        length_2, speed_2 = 0.0, 0.0
        for axis in range(3):
            speed_2 += velocity[i, axis] ** 2
            total += 0.0 * position[i, axis]
            if i > 0:
                length_2 += (position[i, axis] - position[i - 1, axis]) ** 2
        # Written so that what is no number is not sound either.
        if not (length_2 <= bounds[0] ** 2 and speed_2 <= bounds[1] ** 2):
            return False
    for mode in range(q.shape[0]):
        total += 0.0 * (q[mode] + qdot[mode])
    for tool in range(tools[0].shape[0]):
        for axis in range(tools[0].shape[1]):
            total += 0.0 * (tools[0][tool, axis] + tools[1][tool, axis])
    return bool(total == 0.0)
