"""A guide wire that slides and turns in its catheter, and the tool that pushes and twists it from behind."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.catheter import CatheterBody
from trocar.services.mechanics.bodies.forceps import ToolBody
from trocar.services.mechanics.bodies.guide_wire import frame_of
from trocar.services.mechanics.rod.guide_wire import Place, insertion_forces
from trocar.services.mechanics.scene import CatheterScene, SceneModel

# Largest slide in a step as a fraction of the protruding length, and largest turn in rad.
_FARTHEST = 0.05


@dataclass(frozen=True, slots=True)
class WireMotion:
    """Motion of the wire, and its energy balance.

    Attributes:
        place: Place. Length of wire beyond the catheter's tip, and its roll relative to the catheter.
        speed_m_s: float. Sliding speed, positive outwards.
        push_n, torque_nm: float. Force of the drive on the wire, outwards, and torque about its axis.
        twisted_rad: float. Roll of the wire's proximal end relative to the catheter's.
        work_j: float. Energy that its motion, at a given shape, has put into the rod.
        input_j: float. Energy that the drive has put in by twisting it.
        friction_j: float. Energy dissipated by friction between wire and catheter.
        numerical_j: float. Energy lost to the integration: slide and roll are implicit, and forces explicit.
    """

    place: Place
    speed_m_s: float = 0.0
    push_n: float = 0.0
    torque_nm: float = 0.0
    twisted_rad: float = 0.0
    work_j: float = 0.0
    input_j: float = 0.0
    friction_j: float = 0.0
    numerical_j: float = 0.0


class WireDrive:
    """Slides and rolls the wire step by step; its tool holds it while present, otherwise its valve does.

    The valve at the catheter's proximal end fixes the end of a wire that nobody moves. Inside the catheter the wire is
    rigid along its axis: its tip moves as its proximal end does. Its torsion is a spring between proximal end and tip.
    In either direction it slips where the load exceeds friction, and otherwise sticks without creep.

    Attributes:
        motion: WireMotion
    """

    def __init__(self, scene: CatheterScene, bodies: tuple[CatheterBody, ToolBody], tool: int) -> None:
        self._catheter, self._tools = bodies
        assert scene.guide_wire is not None
        assert self._catheter.wire is not None
        self._tool, self._scene, self.wire = tool, scene.guide_wire, self._catheter.wire
        self._along = np.array(scene.direction) / float(np.linalg.norm(scene.direction))
        model, length_m = self.wire.model, scene.length_m
        self._mass_kg = model.density * (length_m + self._scene.out_m)
        bending = 1.0 / model.flexibility[-1]
        self._torsion_nm_rad = bending / (1.0 + model.poisson) / length_m
        self.motion = WireMotion(self.wire.place)
        self._origin_m, self._rolled_rad, self._is_held, self._ahead_m = 0.0, 0.0, False, 0.0

    def save_start(self) -> None:
        """Save the state at the start of a step."""
        self._saved = self.motion, self._origin_m, self._rolled_rad, self._is_held, self._ahead_m

    def restore_start(self) -> None:
        """Restore it."""
        self.motion, self._origin_m, self._rolled_rad, self._is_held, self._ahead_m = self._saved
        self.wire.set_place(self.motion.place)

    def let_go(self) -> None:
        """Reset the wire to rest, untwisted, at its present place, and release it, after a recovery."""
        place = self.wire.place
        still = {"speed_m_s": 0.0, "push_n": 0.0, "torque_nm": 0.0, "twisted_rad": place[1]}
        self.motion, self._is_held = replace(self.motion, place=place, **still), False

    def move(self, dt_s: float) -> None:
        """Slide and roll over a step, and load the catheter with the reaction to the push.

        The rod's step uses the lengths in its middle; `settle` sets those of its end. A slide that begins or ends makes
        velocities jump, so that step is taken by implicit Euler.
        """
        self._update_hold()
        before, state, loads = self.motion, self._catheter.state, self._catheter.contact_force_n
        answer = insertion_forces(self.wire.model.address, state.position_m, frame_of(state), loads, before.place)
        self.motion = motion = self._turn(self._slide(answer[:3], dt_s), answer[3:])
        self._catheter.external_force_n[0] += motion.push_n * self._along
        self.wire.grow((motion.place[0] - before.place[0]) / dt_s)
        if (before.speed_m_s == 0.0) != (motion.speed_m_s == 0.0):
            state.slow_velocity_m_s = None
        if motion.place != before.place:
            self._lay((0.5 * (before.place[0] + motion.place[0]), motion.place[1]))
        if motion.speed_m_s != before.speed_m_s:
            self._move_protruding_part(motion.speed_m_s - before.speed_m_s)

    def settle(self) -> None:
        """Set the rod's lengths to those of the end of the step."""
        if self.wire.place != self.motion.place:
            self._lay(self.motion.place)

    def load(self, tool_force: FloatArray) -> None:
        """Add the wire's reaction on its drive to the forces of the tools: (2, 3), or generalised ones (2, 4)."""
        tool_force[self._tool, :3] -= self.motion.push_n * self._along

    def give(self, tool_force: FloatArray) -> None:
        """Add the reaction to the generalised forces of the tools (2, 4), and move the tools under all forces."""
        self.load(tool_force)
        self._tools.correct(tool_force)
        self._tools.update_pose()
        motion, before_m = self.motion, self._ahead_m
        self._ahead_m = self._hub_m(self._tools.proxy) - self._origin_m - motion.place[0]
        late_j = motion.push_n * (self._ahead_m - before_m)
        self.motion = replace(motion, numerical_j=motion.numerical_j + late_j)

    def felt_stiffness(self, out: FloatArray) -> None:
        """Write the stiffness (2, 3, 3) felt by its hand along the axis: the coupling's, while the wire sticks."""
        if self._is_held and self.motion.speed_m_s == 0.0:
            out[self._tool] = self._tools.stiffness[self._tool, 0] * np.outer(self._along, self._along)

    @property
    def stored_j(self) -> float:
        """Energy of the wire beside the rod's: of its slide, its torsion, and against the catheter's rest shape."""
        motion = self.motion
        against_j = self.wire.stored_j(self._catheter.state, motion.place)[1]
        spring_j = 0.5 * motion.torque_nm * motion.torque_nm / self._torsion_nm_rad
        return float(against_j + spring_j + 0.5 * self._mass_kg * motion.speed_m_s * motion.speed_m_s)

    def _update_hold(self) -> None:
        was_held, self._is_held = self._is_held, bool(self._tools.present[self._tool])
        if self._is_held and not was_held:
            self._origin_m, self._ahead_m = self._hub_m(self._tools.free) - self.motion.place[0], 0.0
            self._rolled_rad = self._roll_rad() - self.motion.twisted_rad

    def _hub_m(self, tools: FloatArray) -> float:
        """Return the position of the tool, of coordinates (2, 4), along the axis from the catheter's proximal end."""
        return float((tools[self._tool, :3] - self._catheter.state.position_m[0]) @ self._along)

    def _roll_rad(self) -> float:
        """Return the tool's roll relative to the catheter's first director, about the axis, unwrapped."""
        first, b = frame_of(self._catheter.state)[1][0], self._tools.frame[self._tool, 0]
        angle = math.atan2(float(np.cross(first, b) @ self._along), float(first @ b))
        near = self.motion.twisted_rad + self._rolled_rad
        return float(near + math.remainder(angle - near, 2.0 * math.pi))

    def _slide(self, pushes_n: tuple[float, ...], dt_s: float) -> WireMotion:
        """Return the motion after sliding under the load in excess of friction."""
        before, (outwards, holds, inwards) = self.motion, pushes_n
        if not self._is_held:
            stopped_j = 0.5 * self._mass_kg * before.speed_m_s * before.speed_m_s
            return replace(before, speed_m_s=0.0, push_n=0.0, friction_j=before.friction_j + stopped_j)
        at_m, wanted_m = before.place[0], self._hub_m(self._tools.free) - self._origin_m
        spring = 1.0 / float(self._tools.compliance[self._tool, 0])
        inertia = self._mass_kg / (dt_s * dt_s)
        drive_n = inertia * dt_s * before.speed_m_s + spring * (wanted_m - at_m)
        against_n = _within(drive_n, inwards, outwards)
        free_m = at_m + _within((drive_n - against_n) / (inertia + spring), -_FARTHEST * at_m, _FARTHEST * at_m)
        out_m = _within(free_m, self._scene.least_out_m, self._scene.reach_m)
        speed_m_s = (out_m - at_m) / dt_s if out_m == free_m else 0.0
        push_n, rubbed_j = spring * (wanted_m - out_m), abs((against_n - holds) * (out_m - at_m))
        moving_j = 0.5 * self._mass_kg * (speed_m_s**2 - before.speed_m_s**2)
        return replace(
            before,
            place=(out_m, before.place[1]),
            speed_m_s=speed_m_s,
            push_n=push_n,
            friction_j=before.friction_j + rubbed_j,
            numerical_j=before.numerical_j + push_n * (out_m - at_m) - moving_j - rubbed_j,
        )

    def _turn(self, motion: WireMotion, torques_nm: tuple[float, ...]) -> WireMotion:
        """Return the motion after turning under the torque in excess of friction."""
        (shape_nm, slope_nm_rad, friction_nm), (out_m, roll_rad) = torques_nm, motion.place
        stiffness = self._torsion_nm_rad
        end_rad = self._roll_rad() - self._rolled_rad if self._is_held else motion.twisted_rad
        ahead_rad = end_rad - roll_rad
        excess = stiffness * ahead_rad - shape_nm
        turned = (excess - _within(excess, -friction_nm, friction_nm)) / (stiffness + max(slope_nm_rad, 0.0))
        turned = _within(turned, -_FARTHEST, _FARTHEST)
        left_rad = ahead_rad - turned
        torque_nm, twisted_rad, rubbed_j = stiffness * left_rad, roll_rad + turned + left_rad, friction_nm * abs(turned)
        springs_j = 0.5 * (torque_nm - motion.torque_nm) ** 2 / stiffness
        return replace(
            motion,
            place=(out_m, roll_rad + turned),
            torque_nm=torque_nm,
            twisted_rad=twisted_rad,
            input_j=motion.input_j + torque_nm * (twisted_rad - motion.twisted_rad),
            friction_j=motion.friction_j + rubbed_j,
            numerical_j=motion.numerical_j + torque_nm * turned - rubbed_j + springs_j,
        )

    def _lay(self, place: Place) -> None:
        """Recompute the rod for a place of the wire, and book the change of stored energy."""
        state = self._catheter.state
        before_j, apart_j = self.wire.stored_j(state, self.wire.place)
        self.wire.set_place(place)
        now_j, now_apart_j = self.wire.stored_j(state, place)
        motion, put_j, held_j = self.motion, now_j - before_j, now_apart_j - apart_j
        self.motion = replace(motion, work_j=motion.work_j + put_j, numerical_j=motion.numerical_j - put_j - held_j)

    def _move_protruding_part(self, change_m_s: float) -> None:
        """Add the stretch by a change of sliding speed to the velocities of the wire beyond the tip."""
        state, tip = self._catheter.state, self.wire.model.tip
        change = change_m_s / self.motion.place[0] * (state.position_m[tip + 1 :] - state.position_m[tip])
        state.velocity_m_s[tip + 1 :] += change
        if state.slow_velocity_m_s is not None:
            state.slow_velocity_m_s[tip + 1 :] += change


def _within(value: float, least: float, most: float) -> float:
    return min(max(value, least), most)


def build_wire_drive(scene: SceneModel, bodies: tuple[CatheterBody, ToolBody]) -> WireDrive | None:
    """Return the drive of a scene's guide wire, None where there is none."""
    driving = [tool for tool, each in enumerate(scene.forceps) if each.drives_wire]
    return WireDrive(scene.catheter, bodies, driving[0]) if scene.catheter.guide_wire is not None else None
