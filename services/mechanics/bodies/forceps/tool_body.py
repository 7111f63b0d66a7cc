"""Both instruments as massless proxies, tied to the hands by virtual couplings."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, BoolArray, FloatArray
from trocar.services.mechanics.bodies.forceps.kinematics import (
    N_CELLS,
    N_COORDINATES,
    N_SEGMENTS,
    tool_frame,
    tool_segments,
)
from trocar.services.mechanics.bodies.forceps.sweep import FASTEST_HAND_M_S, LONGEST_SHAFT_M, sweep
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.scene import ForcepsScene, ToolScene
from trocar.services.mechanics.scene.tools import N_TOOLS, ToolInputs

# How long a tool with invalid input stays where it was: the lifetime of a local force model at the hand.
LONGEST_UNSOUND_S = 20e-3
# Openings and rolls beyond this are impossible for a hand.
MOST_TURNED_RAD = 1e3
# Stiffness of the opening of a tool without jaws, which nothing loads: any number but zero.
NO_JAWS_NM_RAD = 1.0
# Flags of a tool in a step: it lags behind its hand; it has vanished since the last step.
LAGGING, VANISHED = 1, 2


class ToolArrays(Struct):
    """The arrays of a `ToolBody` as its kernels read and write them."""

    port: Annotated[FloatArray, N_TOOLS, 3]
    jaw_length: Annotated[FloatArray, N_TOOLS]
    is_sphere: Annotated[BoolArray, N_TOOLS]  # whether the shaft's segment is only the point J
    jaw_radius: Annotated[FloatArray, N_TOOLS]
    stiffness: Annotated[FloatArray, N_TOOLS, N_COORDINATES]  # of the couplings
    damping: Annotated[FloatArray, N_TOOLS, N_COORDINATES]
    present: Annotated[BoolArray, N_TOOLS]
    disengaged: Annotated[BoolArray, N_TOOLS]
    unsound_s: Annotated[FloatArray, N_TOOLS]  # how long the input of each tool has been invalid
    roll: Annotated[FloatArray, N_TOOLS]  # at the end of the step
    rolled: Annotated[FloatArray, N_TOOLS]  # over the step
    start: Annotated[FloatArray, N_TOOLS, N_COORDINATES]  # the hand at the start of the step
    hand: Annotated[FloatArray, N_TOOLS, N_COORDINATES]
    stretch: Annotated[FloatArray, N_TOOLS, N_COORDINATES]
    proxy: Annotated[FloatArray, N_TOOLS, N_COORDINATES]
    free: Annotated[FloatArray, N_TOOLS, N_COORDINATES]
    motion: Annotated[FloatArray, N_TOOLS, N_COORDINATES]
    compliance: Annotated[FloatArray, N_TOOLS, N_COORDINATES]
    jaw_stop: Annotated[FloatArray, N_TOOLS]
    stop_arm: Annotated[FloatArray, N_TOOLS]
    frame: Annotated[FloatArray, N_TOOLS, 3, 3]
    length: Annotated[FloatArray, N_TOOLS]
    segments: Annotated[FloatArray, N_TOOLS, N_SEGMENTS, 2, 3]
    radius: Annotated[FloatArray, N_TOOLS, N_SEGMENTS]
    held: Annotated[BoolArray, N_TOOLS, 2]  # whether the jaws hold something of each target kind
    rest_offset: Annotated[FloatArray, N_TOOLS, 2]  # overlap with a held body that causes no force, m
    indentation: Annotated[FloatArray, N_TOOLS, N_CELLS]  # decrease of half the squeezed layer's thickness, m
    indentation_slope: Annotated[FloatArray, N_TOOLS, N_CELLS]  # its derivative by the opening, m/rad
    layers: Annotated[FloatArray, N_TOOLS, N_CELLS]  # of wall between the jaws, where it is squeezed
    wall_thickness: float = 0.0  # of the wall that the tools touch, m
    refused: int = 0


tools_at = reader(ToolArrays)


class ToolPoses(Struct):
    """Copies of the poses of both tools, see `ToolArrays`."""

    frame: Annotated[FloatArray, N_TOOLS, 3, 3]
    length: Annotated[FloatArray, N_TOOLS]
    segments: Annotated[FloatArray, N_TOOLS, N_SEGMENTS, 2, 3]


class ToolBody:
    r"""Proxies x = (J, opening) of the tools, and the compliance with which a contact force moves them.

    The proxy has no mass, so the coupling transmits the contact force to the hand,
    :math:`F = K d + B \dot d` with d = proxy - hand. Backward Euler over the tick gives
    :math:`d^+ = (F + (B / \Delta t)\, d) / (K + B / \Delta t)`: stable for every tick, and passive seen from
    the world, because the rate of d is taken at the end of the step.

    Attributes:
        arrays: ToolArrays. All of the following, for kernels.
        proxy: (2, 4) float64. J in m and the opening in rad, at the end of the last step.
        free: (2, 4) float64. Where the proxies would be at the end of this step without contact forces.
        motion: (2, 4) float64. From the start of the step to ``free``.
        rolled_rad: (2,) float64. Roll over the step; it follows the hand, as nothing resists it.
        held: (2, 2) bool. Whether the jaws of each tool hold wall (`DUCT_TRIANGLE`) or catheter (`CATHETER_SEGMENT`).
        rest_offset_m: (2, 2) float64. Depth of the held wall or catheter in the jaws up to which they do not push it,
            see `contact.engagement`.
        indentation_m: (2, N_CELLS) float64. Loss of a squeezed wall's half thickness, by cells along the jaws.
        indentation_slope_m_rad: (2, N_CELLS) float64. Change of that per radian of opening in this step, negative.
        jaw_stop_rad: (2,) float64. Opening below which a held catheter resists the jaws; -inf without one.
        stop_arm_m: (2,) float64. Distance of that catheter from the hinge, along the shaft.
        frame: (2, 3, 3) float64. Rows b, h, d of each tool.
        segments: (2, 3, 2, 3) float64. Start and end of shaft, jaw A and jaw B. Of a tool that touches with a sphere,
            the shaft's is J twice.
        radius_m: (2, 3) float64. 0 where a tool has no such segment.
        compliance: (2, 4) float64. Motion of the proxy at the end of the step per force (m/N) and per torque (rad/(N
            m)).
        present: (2,) bool. Tools that are present; the others have no contact.
        disengaged: (2,) bool. Tools that have appeared and have no contact until they overlap nothing; see
            `contact.engagement`.
    """

    def __init__(self, forceps: tuple[ToolScene, ...]) -> None:
        if len(forceps) > N_TOOLS:
            raise ValueError(f"a scene has at most {N_TOOLS} tools, not {len(forceps)}")
        self._missing = N_TOOLS - len(forceps)
        self._is_named = np.arange(N_TOOLS) < len(forceps)  # others are absent, whatever an input says
        self.forceps = forceps = (*forceps, *(ForcepsScene(),) * self._missing)
        jaws = [f.jaws for f in forceps]
        self.arrays = a = ToolArrays.zeros(jaw_stop=np.full(N_TOOLS, -np.inf))
        self.address = a.address
        a.radius[:] = [[f.body_radius_m] + [f.jaws.jaw_radius_m if f.jaws else 0.0] * 2 for f in forceps]
        self.radius_m, self.held, self.rest_offset_m = a.radius, a.held, a.rest_offset
        self.indentation_m, self.indentation_slope_m_rad = a.indentation, a.indentation_slope
        self._flags = 0
        a.port[:] = [f.port_position_m for f in forceps]
        a.is_sphere[:] = [not f.touches_along_shaft for f in forceps]
        a.jaw_length[:] = [j.jaw_length_m if j else 0.0 for j in jaws]
        a.jaw_radius[:] = [j.jaw_radius_m if j else 0.0 for j in jaws]
        a.stiffness[:, :3] = [[f.coupling_stiffness_n_m] for f in forceps]
        a.damping[:, :3] = [[f.coupling_damping_n_s_m] for f in forceps]
        a.stiffness[:, 3] = [j.jaw_stiffness_nm_rad if j else NO_JAWS_NM_RAD for j in jaws]
        a.damping[:, 3] = [j.jaw_damping_nm_s_rad if j else 0.0 for j in jaws]
        self.port_m, self.present, self.disengaged = a.port, a.present, a.disengaged
        self.roll_rad, self.rolled_rad = a.roll, a.rolled
        self.stiffness, self.damping, self.compliance = a.stiffness, a.damping, a.compliance
        self.hand, self.stretch, self.proxy, self.free, self.motion = a.hand, a.stretch, a.proxy, a.free, a.motion
        self.jaw_stop_rad, self.stop_arm_m = a.jaw_stop, a.stop_arm
        self.frame, self.length_m, self.segments = a.frame, a.length, a.segments

    @property
    def refused(self) -> int:
        """Number of impossible inputs since the start: a NaN, J in the port itself or half a metre from it."""
        return self.arrays.refused

    @property
    def is_lagging(self) -> bool:
        """Whether a tool has not reached the commanded pose because that is too far for one step."""
        return bool(self._flags & LAGGING)

    @property
    def have_vanished(self) -> bool:
        """Whether a tool that was present in the last step is absent now."""
        return bool(self._flags & VANISHED)

    def appear(self, inputs: ToolInputs) -> None:
        """Put the proxies of tools that appear at their hands: that is no motion, of which a part could be taken back.

        `predict` does so too; a caller that saves the state before it calls this first.
        """
        if inputs.present.tobytes() != self.present.tobytes():  # in a tenth of a kernel's call
            self._pass_inputs(put_appearing, inputs)

    def predict(self, inputs: ToolInputs, dt_s: float) -> None:
        """Move the hands and compute the proxies' motion without contact; poses remain those of the start.

        A hand further away than one step allows is followed at `FASTEST_HAND_M_S`. A tool that appears starts with its
        proxy at the hand. A tool with invalid input stays where it was, and is absent once that has lasted for
        `LONGEST_UNSOUND_S`.
        """
        self._flags = self._pass_inputs(predict_proxies, inputs, dt_s)

    def _pass_inputs(self, to: Callable[..., int], inputs: ToolInputs, *more: float) -> int:
        """Call a kernel with these inputs, in which tools that the scene does not name are absent."""
        present = inputs.present & self._is_named if self._missing else inputs.present
        return to(self.address, present, inputs.position_m, inputs.jaw_angle_rad, inputs.roll_rad, *more)

    def correct(self, force: FloatArray) -> None:
        """Apply the generalised contact forces (2, 4) of the step, in N and N m."""
        correct_proxies(self.address, force)

    def state_arrays(self) -> tuple[FloatArray, ...]:
        """Return the live arrays of the state."""
        return self.proxy, self.hand, self.stretch, self.roll_rad

    def step_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays that a step changes, from `predict` on, and that holds write into."""
        return self.arrays.own_memory()

    def corrected_arrays(self) -> tuple[FloatArray, ...]:
        """Return the live arrays that `correct` and `update_pose` change."""
        return self.proxy, self.stretch, self.frame, self.length_m, self.segments

    def halt(self) -> None:
        """Restart the virtual couplings unstretched and at rest at the proxies' positions."""
        self.hand[:] = self.proxy
        self.stretch[:] = 0.0
        self.update_pose()

    def update_pose(self) -> None:
        """Recompute frames and segments from the proxies."""
        update_poses(self.address)


@kernel
def put_appearing(
    address: Address[ToolArrays], present: BoolArray, position: FloatArray, opening: FloatArray, roll: FloatArray
) -> int:
    """Put the proxies of tools that appear at their hands, unstretched and disengaged; return how many there are.

    Arguments are those of `predict_proxies`.
    """
    tools, count = tools_at(address), 0
    for tool in range(present.shape[0]):
        appears = present[tool] and not tools.present[tool]
        if not (appears and _is_sound(position[tool], tools.port[tool], opening[tool], roll[tool])):
            continue
        for axis in range(3):
            tools.hand[tool, axis] = position[tool, axis]
        tools.hand[tool, 3], tools.roll[tool], tools.stretch[tool] = opening[tool], roll[tool], 0.0
        for axis in range(tools.hand.shape[1]):
            tools.proxy[tool, axis] = tools.hand[tool, axis]
        tools.present[tool] = tools.disengaged[tool] = True
        count += 1
    return count


@kernel
def predict_proxies(
    address: Address[ToolArrays],
    present: BoolArray,
    position: FloatArray,
    opening: FloatArray,
    roll: FloatArray,
    dt_s: float,
) -> int:
    """Follow the hands' positions (2, 3), openings (2,) and rolls (2,); see `ToolBody.predict`.

    Return the union of the flags `LAGGING` and `VANISHED` of both tools.
    """
    tools = tools_at(address)
    flags = 0
    put_appearing(address, present, position, opening, roll)
    for tool in range(present.shape[0]):
        is_there, roll_before = present[tool], tools.roll[tool]
        if _is_sound(position[tool], tools.port[tool], opening[tool], roll[tool]):
            if _move_hand(tools, tool, (position[tool], opening[tool], roll[tool]), is_there, dt_s):
                flags |= LAGGING
            tools.unsound_s[tool] = 0.0
        elif is_there:
            tools.refused += 1
            tools.unsound_s[tool] += dt_s
            is_there = tools.present[tool] and tools.unsound_s[tool] < LONGEST_UNSOUND_S
        tools.rolled[tool] = tools.roll[tool] - roll_before if is_there else 0.0
        if tools.present[tool] and not is_there:
            flags |= VANISHED
        tools.present[tool] = is_there
        for axis in range(tools.hand.shape[1]):
            rate = tools.damping[tool, axis] / dt_s
            tools.compliance[tool, axis] = 1.0 / (tools.stiffness[tool, axis] + rate)
            spring_back = tools.compliance[tool, axis] * rate * tools.stretch[tool, axis]
            tools.free[tool, axis] = tools.hand[tool, axis] + spring_back
        for axis in range(tools.hand.shape[1]):
            tools.motion[tool, axis] = tools.free[tool, axis] - tools.proxy[tool, axis]
    _update_poses(tools, True)
    return flags


@inlined_kernel
def _move_hand(
    tools: ToolArrays, tool: int, target: tuple[FloatArray, float, float], is_there: bool, dt_s: float
) -> bool:
    """Move the hand to the commanded pose, or as far towards it as a tool in contact may move in a step.

    Return whether the hand of a present tool lags behind.
    """
    hand, reach = tools.hand[tool], math.inf
    if is_there and tools.present[tool]:
        reach = FASTEST_HAND_M_S * dt_s
    pose, sizes = (tools.start[tool], tools.roll[tool]), (tools.jaw_length[tool], reach)
    for axis in range(hand.shape[0]):
        tools.start[tool, axis] = hand[axis]
    tools.roll[tool] = sweep(tools.port[tool], pose, target, sizes, hand)
    is_lagging = tools.roll[tool] != target[2] or hand[3] != target[1]
    for axis in range(3):
        is_lagging = is_lagging or hand[axis] != target[0][axis]
    return bool(is_there and is_lagging)


@inlined_kernel
def _is_sound(junction: FloatArray, port: FloatArray, opening: float, roll: float) -> bool:
    """Return whether these numbers are a possible pose: finite, with some shaft inside the port but not too much."""
    length_2 = 0.0
    for axis in range(3):
        length_2 += (junction[axis] - port[axis]) ** 2
    is_reached = 0.0 < length_2 < LONGEST_SHAFT_M * LONGEST_SHAFT_M
    return bool(is_reached and abs(opening) < MOST_TURNED_RAD and abs(roll) < MOST_TURNED_RAD)


@kernel
def correct_proxies(address: Address[ToolArrays], force: FloatArray) -> None:
    """Add the motion by the contact forces (2, 4) to the free end positions."""
    tools = tools_at(address)
    for tool in range(force.shape[0]):
        for axis in range(force.shape[1]):
            proxy = tools.free[tool, axis] + tools.compliance[tool, axis] * force[tool, axis]
            tools.proxy[tool, axis] = proxy
            tools.stretch[tool, axis] = proxy - tools.hand[tool, axis]


@kernel
def move_to_proxies(tools: ToolArrays, start: ToolPoses) -> None:
    """Store the poses of both tools, and compute those of their proxies."""
    _copy_poses(tools, start)
    _update_poses(tools, False)


@kernel
def _copy_poses(source: ToolArrays | ToolPoses, target: ToolArrays | ToolPoses) -> None:
    for tool in range(N_TOOLS):
        target.length[tool] = source.length[tool]
        for i in range(3):
            for j in range(3):
                target.frame[tool, i, j] = source.frame[tool, i, j]
        for segment in range(N_SEGMENTS):
            for end in range(2):
                for i in range(3):
                    target.segments[tool, segment, end, i] = source.segments[tool, segment, end, i]


@kernel
def move_back(tools: ToolArrays, start: ToolPoses) -> None:
    """Restore the stored poses."""
    _copy_poses(start, tools)


@kernel
def update_poses(address: Address[ToolArrays]) -> None:
    """Write frames (2, 3, 3), shaft lengths (2,) and segments (2, 3, 2, 3) of both tools."""
    _update_poses(tools_at(address), False)


@kernel
def _update_poses(tools: ToolArrays, is_start: bool) -> None:
    for tool in range(tools.proxy.shape[0]):
        junction, port, frame = tools.proxy[tool, :3], tools.port[tool], tools.frame[tool]
        roll = tools.roll[tool] - (tools.rolled[tool] if is_start else 0.0)
        tools.length[tool] = tool_frame(junction, port, roll, frame)
        start = junction if tools.is_sphere[tool] else port
        tool_segments(junction, start, frame, tools.proxy[tool, 3], tools.jaw_length[tool], tools.segments[tool])
