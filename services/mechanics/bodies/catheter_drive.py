"""A drive that holds the catheter's proximal end: it pushes through a hold, twists the material and steers the tip."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from trocar.services.mechanics.bodies.catheter import CatheterBody
from trocar.services.mechanics.bodies.forceps import ToolBody
from trocar.services.mechanics.bodies.sections import joint_curvature
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT
from trocar.services.mechanics.compiled.vectors import cross, dot, row
from trocar.services.mechanics.rod.material_frame import initial_frame, roll
from trocar.services.mechanics.rod.twist import TwistModel, energy_at, frame_task
from trocar.services.mechanics.scene import CatheterScene, SceneModel
from trocar.services.mechanics.scene.tools import GraspHold

# Below any opening: the held catheter never opens the jaws.
_NO_JAWS_RAD = -1e9
# Number of its first hold, beyond those of any grasp.
_FIRST_HOLD = 1 << 32
# Smaller changes of handle or roll are ignored.
_UNTURNED_RAD = 1e-9


class CatheterDrive:
    """The tool of a scene that drives its catheter.

    Args:
        lost: set of int. Holds that slipped out, kept by the hold registry and only read here.

    Attributes:
        work_j: float. Energy put into the catheter by twisting and steering, which change its rest state.
        apart_j: float. Energy put by them into the bending of catheter and wire against each other.
    """

    def __init__(
        self, scene: CatheterScene, bodies: tuple[CatheterBody, ToolBody], tool: int, lost: Collection[int]
    ) -> None:
        catheter, self._tools = bodies
        self._state, self._tool = catheter.state, tool
        self._twist: TwistModel | None = catheter.integrator.twist
        self._hold_id, self._is_held, self._offset_rad, self._steered_rad = _FIRST_HOLD, False, 0.0, 0.0
        self._lost = lost
        self.work_j = self.apart_j = 0.0
        if self._twist is not None:
            state = self._state
            state.frame = state.frame or initial_frame(state.position_m, walls=self._twist.walls)
            self._wire = catheter.wire
            self._own_rest = self._twist.rest_rotation if self._wire is None else self._wire.catheter_rest
            self._rest = self._own_rest.copy()
            curvature = joint_curvature(scene, "steering_1_m_rad")
            self._steering = np.zeros_like(self._rest)
            if curvature is not None:
                at = self._twist.first
                self._steering[at : at + len(curvature)] = catheter.properties.segment_length_m * curvature

    def save_start(self) -> None:
        """Save the state at the start of a step."""
        rest = None if self._twist is None else self._own_rest.copy()
        self._saved = self._hold_id, self._is_held, self._offset_rad, self._steered_rad, self.work_j, self.apart_j, rest

    def restore_start(self) -> None:
        """Restore it."""
        self._hold_id, self._is_held, self._offset_rad, self._steered_rad, self.work_j, self.apart_j, rest = self._saved
        if self._twist is not None and rest is not None:
            self._own_rest[:] = rest

    def turn(self) -> None:
        """Turn the catheter's first director with the tool's roll, and steer its sections by the handle's angle."""
        if self._twist is None or not self._is_held:
            return
        turned_rad, handle_rad = self._turned_rad() - self._offset_rad, float(self._tools.proxy[self._tool, 3])
        turned_rad -= 2.0 * math.pi * round(turned_rad / (2.0 * math.pi))
        if abs(turned_rad) < _UNTURNED_RAD and abs(handle_rad - self._steered_rad) < _UNTURNED_RAD:
            return
        assert self._state.frame is not None
        before_j, apart_j = self._stored_j(self._twist)
        roll(self._state.frame, 0, -turned_rad)
        self._steered_rad = handle_rad
        np.multiply(self._steering, handle_rad, out=self._own_rest)
        self._own_rest += self._rest
        if self._wire is not None:
            self._wire.set_place(self._wire.place)
        now_j, now_apart_j = self._stored_j(self._twist)
        self.work_j += now_j - before_j
        self.apart_j += now_apart_j - apart_j

    def holds(self) -> list[GraspHold]:
        """Return the drive's hold of the first particle while the tool is present; a lost hold is replaced."""
        tool, was_held = self._tool, self._is_held
        self._is_held = bool(self._tools.present[tool] and not self._tools.disengaged[tool])
        if not self._is_held:
            return []
        if not was_held or self._hold_id in self._lost:
            self._hold_id += 1
            self._offset_rad = self._turned_rad() if self._twist is not None else 0.0
        weights = np.array([1.0, 0.0, 0.0])
        return [GraspHold(self._hold_id, tool, CATHETER_SEGMENT, 0, weights, math.inf, _NO_JAWS_RAD)]

    def _turned_rad(self) -> float:
        """Return the angle from the tool's axis b to the first director, about the tool's shaft."""
        assert self._state.frame is not None
        frame, first = self._tools.frame[self._tool], row(self._state.frame.m1, 0)
        b, along = row(frame, 0), row(frame, 2)
        return math.atan2(dot(cross(b, first), along), dot(b, first))

    def _stored_j(self, twist: TwistModel) -> tuple[float, float]:
        """Return the elastic energy of the rod, and that of catheter and wire bent against each other."""
        wire = self._wire
        own_j = float(energy_at(frame_task(twist, self._state), self._state.position_m))
        return own_j, 0.0 if wire is None else wire.stored_j(self._state, wire.place)[1]


def build_drive(
    scene: SceneModel, bodies: tuple[CatheterBody, ToolBody], lost: Collection[int]
) -> CatheterDrive | None:
    """Return the drive of a scene, None if no tool is one."""
    driving = [tool for tool, each in enumerate(scene.forceps) if each.drives_catheter]
    return CatheterDrive(scene.catheter, bodies, driving[0], lost) if driving else None
