"""Taking a solved motion back to its largest sound share.

Where a part of a step ends too deep, everything moves by a share of its solved motion: positions and rates lie on the
straight lines from the start to the end. A wall, a rod and couplings that are linear store energy that is convex in
both, so what is stored at a share is at most what the same share of the work has put in. Share zero is the start of the
part, at rest: it is always sound.

A share is sound if each piece is no deeper there than two tolerances of the price, or than it was at the start: what
ended at a tolerance, and has no row yet, may move on. What began deeper keeps the depth it began with as its limit, so
that it does not creep by rounding from part to part.
"""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled.memory import SavedArrays
from trocar.services.mechanics.contact.price import MARGIN, ROUNDING_M
from trocar.services.mechanics.simulation.step_start import StepStart
from trocar.services.mechanics.world import World

#: Shares that are tried, after the whole. The next is where nothing would be too deep if all deepened evenly, less a
#: part for that they do not.
LOOKS, CAUTION = 4, 0.9


class MotionShare:
    """Finds the largest sound share of the motion of a part of a step, and takes the motion back to it.

    Attributes:
        looks: int. How often the last call of `find` has measured depths.
    """

    def __init__(self, world: World, start: StepStart) -> None:
        self._world = world
        duct, catheter, tools = world.duct, world.catheter, world.tools
        self._places = (
            *(duct.state.q, duct.contact_impulse, catheter.state.position_m, catheter.contact_force_n),
            *(tools.proxy, tools.hand, tools.stretch, tools.roll_rad),
        )
        self._rates = duct.state.qdot, catheter.state.velocity_m_s
        linear = *self._places, *self._rates
        self._from = {id(array): start.saved(array) for array in linear}
        self._loads_from = [start.saved(array) for array in duct.load_arrays()]
        self._ends = SavedArrays([*linear, *duct.load_arrays()])
        self._to = {id(array): self._ends.saved(array) for array in linear}
        self._loads_to = [self._ends.saved(array) for array in duct.load_arrays()]
        self.looks, self._limit_m = 0, np.zeros(0)

    def find(self, tolerance_m: float, most: float, quantum: float) -> float:
        """Return a share of the motion that is sound, at most ``most``, or 0; bodies are left at some share.

        It is a whole number of ``quantum``, and was looked at itself: jaws that close on a wall may be much deeper on
        the way than where they end, because the wall gives way later.
        """
        self._ends.save()
        self.looks = 0
        begun_m, share = self._depths_m(0.0).copy(), most
        sound_m = self._limits_m(begun_m, MARGIN * tolerance_m) + ROUNDING_M
        for _ in range(LOOKS + 1):
            share = quantum * math.floor(share / quantum)
            if share == 0.0:
                break
            depth_m = self._depths_m(share)
            deep = ~(depth_m <= sound_m)  # also what is no number
            if not deep.any():
                return share
            share *= CAUTION * float(((sound_m - begun_m)[deep] / (depth_m - begun_m)[deep]).min())
        return 0.0

    def take(self, share: float) -> None:
        """Let everything have this share of its motion, above zero, and of the change of its rates."""
        self._put(self._places, share)
        self._put(self._rates, share)
        self._put_loads(share)
        self._world.tools.rolled_rad *= share
        self._world.duct.write_acceleration()
        self._world.catheter.take_back(share)
        self._world.search.restore_start()

    def _limits_m(self, begun_m: FloatArray, least_m: float) -> FloatArray:
        """Return the depth at which each piece is still sound, from those at the start of the part."""
        if self._limit_m.shape != begun_m.shape:
            self._limit_m = np.zeros_like(begun_m)
        is_deeper = begun_m > self._limit_m + ROUNDING_M  # than a share may be: it has become so by itself
        self._limit_m[:] = np.maximum(np.where(is_deeper, begun_m, np.minimum(self._limit_m, begun_m)), least_m)
        return self._limit_m

    def _depths_m(self, share: float) -> FloatArray:
        self.looks += 1
        self._put(self._places, share)
        self._put_loads(share)
        return self._world.search.depths_m(self._world.system, share)

    def _put(self, arrays: tuple[FloatArray, ...], share: float) -> None:
        for live in arrays:
            start = self._from[id(live)]
            np.subtract(self._to[id(live)], start, out=live)
            live *= share
            live += start

    def _put_loads(self, share: float) -> None:
        """Write loads of contacts that are the same share of the way from all loads at the start to those at the end.

        Those that last through the step, whatever the contacts, act beside them.
        """
        (nodes_0, force_0, count_0), (nodes_1, force_1, count_1) = self._loads_from, self._loads_to
        nodes, force, count = self._world.duct.load_arrays()
        lasting_nodes, lasting_n = self._world.duct.lasting_loads
        n_0, n_1 = int(count_0[0]), int(count_1[1])
        if share == 1.0:
            n_0, lasting_nodes, lasting_n = 0, lasting_nodes[:0], lasting_n[:0]
        every = np.concatenate([nodes_1[:n_1], nodes_0[:n_0], lasting_nodes])
        left = 1.0 - share
        loads = np.concatenate([share * force_1[:n_1], left * force_0[:n_0], -left * lasting_n])
        unique, place = np.unique(every, return_inverse=True)
        k = min(len(unique), len(nodes))
        summed = np.zeros((len(unique), 3))
        np.add.at(summed, place, loads)
        nodes[:k], force[:k], count[:] = unique[:k], summed[:k], k
