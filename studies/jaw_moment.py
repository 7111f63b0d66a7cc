"""The moment on a tool's jaws of all that touches them, by virtual work: what the torque at its handle should be."""

from __future__ import annotations

import numpy as np

from services.mechanics.bodies.forceps.kinematics import N_CELLS
from services.mechanics.collision.pairs import JAW_A, JAW_B
from services.mechanics.contact.identity import tool_segment_of
from services.mechanics.simulation import Simulation


class JawMoment:
    """Where a tool's jaws are as a step begins; make it before the step and ask it after.

    A jaw turns by half the opening; the middle of a layer that is squeezed comes after it by so much less as the layer
    swells. `thinning_m_rad` is how much, in cells along the jaw. What holds by friction is not among it.
    """

    def __init__(self, simulation: Simulation, tool: int) -> None:
        self._simulation, self._tool = simulation, tool
        self._proxy, self._frame = simulation.tools.proxy[tool].copy(), simulation.tools.frame[tool].copy()
        jaws = simulation.scene.forceps[tool].jaws
        if jaws is None:
            raise ValueError(f"tool {tool} has no jaws")
        self._length_m, self._radius_m = jaws.jaw_length_m, jaws.jaw_radius_m

    def after_step_nm(self) -> float:
        """Return the moment in N m against which the jaws are held, positive if they are pushed open."""
        simulation, total = self._simulation, 0.0
        rows, held = simulation.contacts, set(simulation.holds.rows)
        for row, force in enumerate(simulation.contact_force_n):
            side = {JAW_A: 0.5, JAW_B: -0.5}.get(tool_segment_of(int(rows.identity[row])), 0.0)
            if side == 0.0 or rows.tool[row] != self._tool or row in held:
                continue
            arm_m = rows.point_m[row] - self._proxy[:3]
            total += side * float(self._frame[1] @ np.cross(arm_m, force))
            if row not in simulation.squeeze.rows and rows.pad_m[row] > 0.0:
                total += self._by_swelling_nm(row, side, arm_m, force)
        return total

    def _by_swelling_nm(self, row: int, side: float, arm_m: np.ndarray, force: np.ndarray) -> float:
        normal, angle = self._simulation.contacts.frame[row, 0], 0.5 * self._proxy[3]
        jaw = np.cos(angle) * self._frame[2] + 2.0 * side * np.sin(angle) * self._frame[0]
        at_m = min(max((arm_m + self._radius_m * normal) @ jaw, 0.0), self._length_m)
        cells_m = self._length_m * (np.arange(N_CELLS) + 0.5) / N_CELLS
        swells = np.interp(at_m, cells_m, self._simulation.tools.thinning_m_rad[self._tool])
        return float(swells / abs(normal @ self._frame[0]) * (normal @ force))
