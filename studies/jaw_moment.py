"""The moment on a tool's jaws of all that touches them, by virtual work: what the torque at its handle should be."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.bodies.forceps.kinematics import N_CELLS
from trocar.services.mechanics.collision.pairs import JAW_A, JAW_B
from trocar.services.mechanics.contact.identity import SEGMENT, part_of
from trocar.services.mechanics.simulation import Simulation


class JawMoment:
    """Moment of contact forces on a tool's jaws; make it before a step and ask it afterwards.

    A jaw turns by half the opening; the middle of a squeezed layer lags behind it by the growth of the layer's half
    thickness, `indentation_slope_m_rad`, in cells along the jaw and along its own normal, not along the row's. Forces
    that hold by friction are not included.
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
            side = {JAW_A: 0.5, JAW_B: -0.5}.get(part_of(int(rows.identity[row]), SEGMENT), 0.0)
            if side == 0.0 or rows.tool[row] != self._tool or row in held:
                continue
            arm_m = rows.point_m[row] - self._proxy[:3]
            total += side * float(self._frame[1] @ np.cross(arm_m, force))
            if row not in simulation.squeeze.rows and rows.rest_offset_m[row] > 0.0:
                total += self._by_swelling_nm(row, side, arm_m, force)
        return total

    def _by_swelling_nm(self, row: int, side: float, arm_m: np.ndarray, force: np.ndarray) -> float:
        angle, normal = 0.5 * self._proxy[3], self._simulation.contacts.frame[row, 0]
        jaw = np.cos(angle) * self._frame[2] + 2.0 * side * np.sin(angle) * self._frame[0]
        places = [(at_m, at_m * jaw - arm_m) for at_m in (*np.clip([arm_m @ jaw], 0.0, self._length_m), self._length_m)]
        at_m, way_m = min(places, key=lambda place: self._off_its_surface_m(*place))
        radial = way_m / np.linalg.norm(way_m)
        swells = self._along(self._simulation.tools.indentation_slope_m_rad, at_m)
        return float(swells / abs(radial @ self._frame[0]) * (normal @ force) * (normal @ radial))

    def _off_its_surface_m(self, at_m: float, way_m: np.ndarray) -> float:
        """Return how far the middle of a layer, ``way_m`` (3,) from a place along a jaw, is from where jaws hold it."""
        half_m = 0.5 * self._simulation.scene.duct.thickness_m
        facing = abs(way_m @ self._frame[0]) / np.linalg.norm(way_m)
        thinner_m = half_m - self._along(self._simulation.tools.indentation_m, at_m)
        held_m = 0.5 * self._radius_m + (0.5 * self._radius_m + thinner_m) / facing
        return abs(float(np.linalg.norm(way_m) - held_m))

    def _along(self, cells: np.ndarray, at_m: float) -> float:
        cells_m = self._length_m * (np.arange(N_CELLS) + 0.5) / N_CELLS
        return float(np.interp(at_m, cells_m, cells[self._tool]))
