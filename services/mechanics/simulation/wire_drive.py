"""A guide wire that slides and turns in its catheter, and the tool that pushes and twists it from behind."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.bodies.guide_wire import frame_of
from services.mechanics.rod.guide_wire import Place, resist
from services.mechanics.scene import SceneModel
from services.mechanics.world import World

# Of the wire that is out, and of a radian: the most that it moves by in a step.
_FARTHEST = 0.05


@dataclass(frozen=True, slots=True)
class WireMotion:
    """How the wire moves, and the books of it.

    Attributes:
        place: Place. How far it is out of the tip, and its roll against the catheter.
        speed_m_s: float. At which it slides out.
        push_n, torque_nm: float. Of the drive on it, outwards, and about its axis.
        twisted_rad: float. Roll of its proximal end against the catheter's.
        work_j: float. What its motion, at a given shape, has put into the rod.
        input_j: float. What its drive has put in by twisting it.
        friction_j: float. What friction between wire and catheter has taken.
        numerical_j: float. What the implicit step of its sliding has taken.
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
    """The wire's slide and roll, one step after the other; it is held while its tool is there.

    Inside the catheter it is stiff along its axis: what its proximal end moves by, its tip does. Its torsion is a
    spring between its proximal end and its tip. In either direction it slips where more acts on it than friction holds,
    and else stays exactly where it is.

    Attributes:
        motion: WireMotion
    """

    def __init__(self, scene: SceneModel, world: World, tool: int) -> None:
        assert scene.catheter.guide_wire is not None
        assert world.catheter.wire is not None
        self._tools, self._catheter, self._tool = world.tools, world.catheter, tool
        self._scene, self.wire = scene.catheter.guide_wire, world.catheter.wire
        self._along = np.array(scene.catheter.direction) / float(np.linalg.norm(scene.catheter.direction))
        model, length_m = self.wire.model, scene.catheter.length_m
        self._mass_kg = model.density * (length_m + self._scene.out_m)
        bending = 1.0 / (model.bent[-1] - model.bent[-2]) * (model.arc[-1] - model.arc[-2])
        self._torsion_nm_rad = bending / (1.0 + model.poisson) / length_m
        self._force = self._catheter.external_force_n
        self.motion = WireMotion(self.wire.place)
        self._origin_m, self._rolled_rad, self._is_held = 0.0, 0.0, False

    def note_start(self) -> None:
        """Note what a step begins with."""
        self._noted = self.motion, self._origin_m, self._rolled_rad, self._is_held

    def put_back_start(self) -> None:
        """Begin with that again."""
        self.motion, self._origin_m, self._rolled_rad, self._is_held = self._noted
        self.wire.lay(self.motion.place)

    def let_go(self) -> None:
        """Take up the wire where it is laid, at rest and untwisted, and hold it anew: what a heal comes back to."""
        place = self.wire.place
        still = {"speed_m_s": 0.0, "push_n": 0.0, "torque_nm": 0.0, "twisted_rad": place[1]}
        self.motion, self._is_held = replace(self.motion, place=place, **still), False

    def move(self, dt_s: float) -> None:
        """Slide and roll over a step, and push the catheter's particles as the wire is pushed.

        The rod's step is taken with the lengths that it has in the middle of it; `settle` gives it those of its end. A
        slide that begins or ends is a jump of velocities: implicit Euler takes that.
        """
        self._take_hold()
        before, state = self.motion, self._catheter.state
        answer = resist(
            self.wire.model.address, state.position_m, frame_of(state), self._catheter.contact_force_n, before.place
        )
        out_m, push_n, speed_m_s, rubs_n = self._slide(answer[:3], dt_s)
        roll_rad, torque_nm, twisted_rad, rubs_nm = self._turn(answer[3:])
        moved_m, turned_rad = out_m - before.place[0], roll_rad - before.place[1]
        change_m_s = speed_m_s - before.speed_m_s
        self.motion = replace(
            before,
            place=(out_m, roll_rad),
            speed_m_s=speed_m_s,
            push_n=push_n,
            torque_nm=torque_nm,
            twisted_rad=twisted_rad,
            input_j=before.input_j + before.torque_nm * (twisted_rad - before.twisted_rad),
            friction_j=before.friction_j + rubs_n * abs(moved_m) + rubs_nm * abs(turned_rad),
            numerical_j=before.numerical_j + 0.5 * self._mass_kg * change_m_s * change_m_s,
        )
        self._force[0] += push_n * self._along
        self.wire.grow(moved_m / dt_s)
        if (before.speed_m_s == 0.0) != (speed_m_s == 0.0):
            state.slow_velocity_m_s = None
        if self.motion.place != before.place:
            self._lay((0.5 * (before.place[0] + out_m), roll_rad))
        if change_m_s != 0.0:
            self._carry(change_m_s)

    def settle(self) -> None:
        """Let the rod be as at the end of the step."""
        if self.wire.place != self.motion.place:
            self._lay(self.motion.place)

    def give(self, tool_force: FloatArray) -> None:
        """Add to the generalised forces of the tools (2, 4) what the wire does to its drive."""
        tool_force[self._tool, :3] -= self.motion.push_n * self._along
        self._tools.correct(tool_force)
        self._tools.update_pose()

    def felt_stiffness(self, out: FloatArray) -> None:
        """Write the stiffness (2, 3, 3) that its hand meets along the axis: the coupling's, while the wire stays."""
        if self._is_held and self.motion.speed_m_s == 0.0:
            out[self._tool] = self._tools.stiffness[self._tool, 0] * np.outer(self._along, self._along)

    @property
    def stored_j(self) -> float:
        """What the wire stores beside the rod: in its slide, its torsion, and against the catheter's rest shape."""
        motion = self.motion
        against_j = self.wire.stored_j(self._catheter.state, motion.place)[1]
        spring_j = 0.5 * motion.torque_nm * motion.torque_nm / self._torsion_nm_rad
        return float(against_j + spring_j + 0.5 * self._mass_kg * motion.speed_m_s * motion.speed_m_s)

    def _take_hold(self) -> None:
        tool, was_held = self._tool, self._is_held
        self._is_held = bool(self._tools.present[tool] and not self._tools.waiting[tool])
        if self._is_held and not was_held:
            self._origin_m = self._hub_m() - self.motion.place[0]
            self._rolled_rad = self._roll_rad() - self.motion.twisted_rad

    def _hub_m(self) -> float:
        """Return where the tool is along the axis without the wire, from the catheter's proximal end."""
        return float((self._tools.free[self._tool, :3] - self._catheter.state.position_m[0]) @ self._along)

    def _roll_rad(self) -> float:
        """Return the roll of the tool less that of the catheter's first director, about the axis, to within turns."""
        first, b = frame_of(self._catheter.state)[1][0], self._tools.frame[self._tool, 0]
        angle = math.atan2(float(np.cross(first, b) @ self._along), float(first @ b))
        near = self.motion.twisted_rad + self._rolled_rad
        return float(near + math.remainder(angle - near, 2.0 * math.pi))

    def _slide(self, pushes_n: tuple[float, ...], dt_s: float) -> tuple[float, float, float, float]:
        """Return where the wire ends, the push and the speed there, and the friction that it slides against."""
        outwards, holds, inwards = pushes_n
        at_m, compliance = self.motion.place[0], float(self._tools.compliance[self._tool, 0])
        wanted_m = self._hub_m() - self._origin_m
        inertia, spring = self._mass_kg / (dt_s * dt_s), 1.0 / compliance if self._is_held else 0.0
        asked_n = inertia * dt_s * self.motion.speed_m_s + spring * (wanted_m - at_m)
        if asked_n > outwards:
            moved_m, rubs_n = (asked_n - outwards) / (inertia + spring), outwards - holds
        elif asked_n < inwards:
            moved_m, rubs_n = (asked_n - inwards) / (inertia + spring), holds - inwards
        else:
            moved_m, rubs_n = 0.0, 0.0
        most_m = _FARTHEST * at_m
        free_m = at_m + min(max(moved_m, -most_m), most_m)
        out_m = min(max(free_m, self._scene.least_out_m), self._scene.reach_m)
        speed_m_s = (out_m - at_m) / dt_s if out_m == free_m else 0.0
        return out_m, spring * (wanted_m - out_m), speed_m_s, rubs_n

    def _turn(self, torques_nm: tuple[float, ...]) -> tuple[float, float, float, float]:
        """Return the wire's roll, torque and twist at its proximal end, and the friction that it turns against."""
        asks, slope, rubs = torques_nm
        roll_rad, twisted_rad = self.motion.place[1], self.motion.twisted_rad
        if self._is_held:
            twisted_rad = self._roll_rad() - self._rolled_rad
        else:  # nobody holds its end
            twisted_rad = roll_rad
        excess = self._torsion_nm_rad * (twisted_rad - roll_rad) - asks
        if abs(excess) <= rubs:
            return roll_rad, self._torsion_nm_rad * (twisted_rad - roll_rad), twisted_rad, 0.0
        turned = (excess - math.copysign(rubs, excess)) / (self._torsion_nm_rad + max(slope, 0.0))
        roll_rad += min(max(turned, -_FARTHEST), _FARTHEST)
        return roll_rad, self._torsion_nm_rad * (twisted_rad - roll_rad), twisted_rad, rubs

    def _lay(self, place: Place) -> None:
        """Lay the rod anew, and enter what that puts into it."""
        state = self._catheter.state
        before_j = self.wire.stored_j(state, self.wire.place)[0]
        self.wire.lay(place)
        self.motion = replace(self.motion, work_j=self.motion.work_j + self.wire.stored_j(state, place)[0] - before_j)

    def _carry(self, change_m_s: float) -> None:
        """Let the wire beyond the tip move with what slides out: all of it is as much longer."""
        state, tip = self._catheter.state, self.wire.model.tip
        change = change_m_s / self.motion.place[0] * (state.position_m[tip + 1 :] - state.position_m[tip])
        state.velocity_m_s[tip + 1 :] += change
        if state.slow_velocity_m_s is not None:
            state.slow_velocity_m_s[tip + 1 :] += change


def build_wire_drive(scene: SceneModel, world: World) -> WireDrive | None:
    """Return the drive of a scene's guide wire, None where there is none."""
    driving = [tool for tool, each in enumerate(scene.forceps) if each.drives_wire]
    return WireDrive(scene, world, driving[0]) if scene.catheter.guide_wire is not None else None
