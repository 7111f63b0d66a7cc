"""What both hands do, as a table with one row a step: every disturbance of the suite is an edit of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray
from trocar.services.mechanics.scene import ToolScene
from trocar.services.mechanics.scene.minimum_jerk import minimum_jerk
from trocar.services.mechanics.scene.tools import N_TOOLS, GraspHold, ToolInputs


@dataclass(frozen=True, slots=True)
class HandMotions:
    """Both hands in T steps.

    Attributes:
        present: (T, 2) bool
        position_m: (T, 2, 3) float64
        jaw_angle_rad, roll_rad: (T, 2) float64
        holds: tuple of GraspHold, or None. What the caller says that the jaws hold, in every step; None leaves grasping
            to the simulation.
    """

    present: BoolArray
    position_m: FloatArray
    jaw_angle_rad: FloatArray
    roll_rad: FloatArray
    holds: tuple[GraspHold, ...] | None = None

    def __len__(self) -> int:
        return len(self.present)

    def write(self, step: int, out: ToolInputs) -> None:
        """Write the row of a step; after the last one nobody is there."""
        row = min(step, len(self) - 1)
        out.present[:] = self.present[row] if step < len(self) else False
        out.position_m[:] = self.position_m[row]
        out.jaw_angle_rad[:] = self.jaw_angle_rad[row]
        out.roll_rad[:] = self.roll_rad[row]
        out.holds = None if self.holds is None else [replace(hold) for hold in self.holds if step < len(self)]

    def then(self, steps: int) -> HandMotions:
        """Stay where the last row is for so many more steps."""
        index = np.append(np.arange(len(self)), np.full(steps, len(self) - 1))
        return self.sampled(index)

    def sampled(self, index: IntArray) -> HandMotions:
        """Let step k have the row ``index[k]``: losses, stalls and jitter of whatever brings the hands' motion."""
        return HandMotions(
            present=self.present[index],
            position_m=self.position_m[index],
            jaw_angle_rad=self.jaw_angle_rad[index],
            roll_rad=self.roll_rad[index],
            holds=self.holds,
        )

    def moved(self, tool: int, offset_m: FloatArray, start: int) -> HandMotions:
        """Add offsets (k, 3) to a tool's positions from step ``start`` on; the last one stays."""
        position = self.position_m.copy()
        end = min(start + len(offset_m), len(self))
        position[start:end, tool] += offset_m[: end - start]
        position[end:, tool] += offset_m[-1]
        return replace(self, position_m=position)

    def with_jaws(self, tool: int, angle_rad: FloatArray, start: int) -> HandMotions:
        """Open and close a tool's jaws from step ``start`` on."""
        jaw = self.jaw_angle_rad.copy()
        end = min(start + len(angle_rad), len(self))
        jaw[start:end, tool] = angle_rad[: end - start]
        return replace(self, jaw_angle_rad=jaw)

    def rolled(self, tool: int, angle_rad: FloatArray, start: int) -> HandMotions:
        """Add to a tool's roll (k,) from step ``start`` on; the last one stays."""
        roll = self.roll_rad.copy()
        end = min(start + len(angle_rad), len(self))
        roll[start:end, tool] += angle_rad[: end - start]
        roll[end:, tool] += angle_rad[-1]
        return replace(self, roll_rad=roll)

    def without(self, tool: int, absent: BoolArray) -> HandMotions:
        """Let a tool be away in the steps (T,) in which ``absent`` says so."""
        present = self.present.copy()
        present[:, tool] &= ~absent
        return replace(self, present=present)

    def top_speed_m_s(self, dt_s: float) -> float:
        """Fastest motion of a tool from a step in which it is there to the next."""
        with np.errstate(invalid="ignore", over="ignore"):
            distance = np.linalg.norm(np.diff(self.position_m, axis=0), axis=2)
        there = self.present[1:] & self.present[:-1] & np.isfinite(distance)
        return float(distance[there].max(initial=0.0)) / dt_s


def still(junction_m: FloatArray, jaw_angle_rad: tuple[float, float], steps: int) -> HandMotions:
    """Both tools at ``junction_m`` (2, 3), open by ``jaw_angle_rad`` (2,), rolled as in the insertion."""
    position = np.tile(junction_m, (steps, 1, 1))
    jaw = np.tile(np.asarray(jaw_angle_rad, dtype=np.float64), (steps, 1))
    return HandMotions(np.ones((steps, N_TOOLS), np.bool_), position, jaw, np.full((steps, N_TOOLS), 0.5 * np.pi))


def junction(forceps: ToolScene, grip_point_m: tuple[float, float, float], grip_offset_m: float) -> FloatArray:
    """Return J (3,) for jaws whose middle, ``grip_offset_m`` beyond J, is at a point."""
    arm = np.subtract(grip_point_m, forceps.port_position_m)
    at: FloatArray = np.asarray(grip_point_m) - grip_offset_m * arm / np.linalg.norm(arm)
    return at


def least_jerk(distance_m: float, direction: FloatArray, speed_m_s: float, dt_s: float = 1e-3) -> FloatArray:
    """Offsets (k, 3) of a motion of least jerk with this top speed, at least one step long."""
    steps = max(round(1.875 * distance_m / speed_m_s / dt_s), 1)
    return np.outer(eased(distance_m, np.arange(1, steps + 1) / steps), direction)


def eased(distance: float, part: FloatArray) -> FloatArray:
    """Return how far along a way of least jerk one is at parts (k,) of its time."""
    way: FloatArray = distance * part**3 * (10.0 + part * (6.0 * part - 15.0))
    return way


def wander(
    random: np.random.Generator, steps: int, reach: FloatArray, lasting_s: tuple[float, float] = (0.05, 1.0)
) -> FloatArray:
    """Motions of least jerk between random places, each of a duration in ``lasting_s``, with rests; (steps, 3)."""
    times, places = [0.0], [np.zeros(3)]
    while times[-1] < 1e-3 * steps:
        times += [times[-1] + random.uniform(*lasting_s), times[-1] + lasting_s[1] * random.uniform(1.0, 1.3)]
        places += [random.uniform(-1.0, 1.0, 3) * reach] * 2
    out, value, rate = np.empty((steps, 3)), np.empty(3), np.empty(3)
    table = np.array(places)
    for step in range(steps):
        minimum_jerk(np.array(times), table, 1e-3 * step, value, rate)
        out[step] = value
    return out
