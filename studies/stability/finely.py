"""What a run does in a tick if that is taken in many parts: whether a force that changes at once would do so anyway.

A catheter that snaps off a jaw turns the force on it by newtons in a millisecond, and no step however short makes that
less. So a force that changes by more than its criterion is no fault as far as the same tick shows it that begins with
the same state and is taken in sixteenths. When it happens, a step of a tick only knows to a tick: so what counts is
how far the force is from all that it is in those sixteenths, until a tick later. A step of force that comes of
collision detection, of a solve that has not ended or of too long a step is not confirmed: finer steps lack it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.scene.tools import N_TOOLS, ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.snapshot import Snapshot
from trocar.studies.stability.hands import HandMotions

PARTS = 16

Explained = dict[tuple[int, int], FloatArray]
"""By step and tool: forces (k, 3) that finer steps lead through, in N."""


def contact_forces_n(simulation: Simulation) -> FloatArray:
    """Return the force of the contacts, and of a guide wire, on each tool (2, 3), from the contact rows."""
    rows, n, forces = simulation.contacts, simulation.contacts.n_contacts, np.zeros((N_TOOLS, 3))
    if n:
        by_tool = rows.tool[:n] != NO_TOOL
        each = np.einsum("kac,ka->kc", rows.lever[:n, :, :3], simulation.contact_force_n)
        np.add.at(forces, rows.tool[:n][by_tool], each[by_tool])
    if simulation.wire_drive is not None:
        simulation.wire_drive.load(forces)
    return forces


class FineTicks:
    """Takes a run again, and single ticks of it in parts.

    Args:
        simulation: Simulation. At its start.
        hands: HandMotions
        dt_s: float. Length of a tick.
        before_step: callable (simulation, step), optional. What else happens to the simulation.
    """

    def __init__(
        self,
        simulation: Simulation,
        hands: HandMotions,
        dt_s: float,
        before_step: Callable[[Simulation, int], None] | None = None,
    ) -> None:
        self._simulation, self._hands, self._dt_s, self._before_step = simulation, hands, dt_s, before_step

    def forces_n(self, ticks: Collection[int]) -> dict[int, FloatArray]:
        """Return, by tick, the forces (k, 2, 3) in its parts and in those of the next one.

        All others are taken as the run has taken them; in its parts hands go straight on.
        """
        simulation, found = self._simulation, {}
        kept = simulation.scene, simulation.duct.reduced
        for tick in range(max(ticks) + 1):
            if tick in ticks:
                snapshot = Snapshot(simulation, kept)
                parts = [self._take(tick, PARTS), self._take(tick + 1, PARTS)]
                found[tick] = np.concatenate(parts)
                snapshot.restore()
            self._take(tick, 1)
        return found

    def _take(self, tick: int, parts: int) -> FloatArray:
        """Take a tick in parts and return the forces (parts, 2, 3)."""
        tools, found = ToolInputs(), []
        if self._before_step is not None and tick > 0:
            self._before_step(self._simulation, tick)
        for part in range(1, parts + 1):
            _write_between(self._hands, tick, part / parts, tools)
            self._simulation.step(tools, self._dt_s / parts)
            found.append(contact_forces_n(self._simulation))
        return np.array(found)


def nearest_on(path_n: FloatArray, force_n: FloatArray) -> FloatArray:
    """Return the force (3,) nearest to ``force_n`` on the way through those of ``path_n`` (k, 3)."""
    start, way = path_n[:-1], np.diff(path_n, axis=0)
    length_2 = np.maximum((way**2).sum(axis=1), 1e-30)
    share = np.clip(((force_n - start) * way).sum(axis=1) / length_2, 0.0, 1.0)
    places = start + share[:, None] * way
    nearest: FloatArray = places[np.argmin(((places - force_n) ** 2).sum(axis=1))]
    return nearest


def _write_between(hands: HandMotions, step: int, share: float, out: ToolInputs) -> None:
    """Write where hands are on their way to the row of a step."""
    hands.write(step, out)
    if share < 1.0:
        before = ToolInputs()
        hands.write(step - 1, before)
        for name in ("position_m", "jaw_angle_rad", "roll_rad"):
            start, end = getattr(before, name), getattr(out, name)
            end[:] = start + share * (end - start)
