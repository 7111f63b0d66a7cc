"""Both instruments as massless proxies, tied to the hands by virtual couplings."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from services.mechanics.collision.kernel import kernel
from services.mechanics.forceps.kinematics import N_COORDINATES, N_SEGMENTS, tool_frame, tool_segments
from services.mechanics.scene import ForcepsScene
from services.mechanics.tools import N_TOOLS, ToolInputs

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


class ToolBody:
    r"""Proxies x = (J, opening) of the tools, and the compliance with which a contact force moves them.

    The proxy has no mass: what the contacts push, the coupling gives to the hand,
    :math:`F = K d + B \dot d` with d = proxy - hand. Backward Euler over the tick gives
    :math:`d^+ = (F + (B / \Delta t)\, d) / (K + B / \Delta t)`: stable for every tick, and passive seen from
    the world, because the rate of d is taken at the end of the step.

    Attributes
    ----------
    proxy : (2, 4) float64
        J in m and the opening in rad, at the end of the last step.
    free : (2, 4) float64
        Where the proxies would be at the end of this step without contact forces.
    motion : (2, 4) float64
        From the start of the step to ``free``.
    held : (2, 2) bool
        Whether the jaws of each tool hold wall (`DUCT_TRIANGLE`) or catheter (`CATHETER_SEGMENT`).
    jaw_stop_rad : (2,) float64
        Opening below which something held keeps the jaws; -inf where nothing does.
    frame : (2, 3, 3) float64
        Rows b, h, d of each tool.
    segments : (2, 3, 2, 3) float64
        Start and end of shaft, jaw A and jaw B.
    radius_m : (2, 3) float64
    compliance : (2, 4) float64
        Motion of the proxy at the end of the step per force (m/N) and per torque (rad/(N m)).
    """

    def __init__(self, forceps: tuple[ForcepsScene, ...]) -> None:
        if len(forceps) != N_TOOLS:
            raise ValueError(f"a scene has {N_TOOLS} forceps, not {len(forceps)}")
        self.forceps = forceps
        self.port_m = np.array([f.port_position_m for f in forceps])
        self.radius_m = np.array([[f.shaft_radius_m, f.jaw_radius_m, f.jaw_radius_m] for f in forceps])
        self.jaw_length_m = np.array([f.jaw_length_m for f in forceps])
        self.stiffness = np.array([[f.coupling_stiffness_n_m] * 3 + [f.jaw_stiffness_nm_rad] for f in forceps])
        self.damping = np.array([[f.coupling_damping_n_s_m] * 3 + [f.jaw_damping_nm_s_rad] for f in forceps])
        self.present = np.zeros(N_TOOLS, np.bool_)
        self.hand = np.zeros((N_TOOLS, N_COORDINATES))
        self.stretch = np.zeros((N_TOOLS, N_COORDINATES))
        self.proxy = np.zeros((N_TOOLS, N_COORDINATES))
        self.free = np.zeros((N_TOOLS, N_COORDINATES))
        self.motion = np.zeros((N_TOOLS, N_COORDINATES))
        self.held = np.zeros((N_TOOLS, 2), np.bool_)
        self.jaw_stop_rad = np.full(N_TOOLS, -np.inf)
        self.compliance = np.zeros((N_TOOLS, N_COORDINATES))
        self.roll_rad = np.zeros(N_TOOLS)
        self.frame = np.zeros((N_TOOLS, 3, 3))
        self.length_m = np.zeros(N_TOOLS)
        self.segments = np.zeros((N_TOOLS, N_SEGMENTS, 2, 3))

    def predict(self, inputs: ToolInputs, dt_s: float) -> None:
        """Move the hands and find where the proxies go without contact; poses stay those of the start.

        A tool that appears starts with its proxy at the hand. Jaws that hold something do not close further.
        """
        for tool in range(N_TOOLS):
            if inputs.present[tool] and not self.present[tool]:
                self.stretch[tool] = 0.0
                self.proxy[tool, :3] = inputs.position_m[tool]
                self.proxy[tool, 3] = inputs.jaw_angle_rad[tool]
        self.present[:] = inputs.present
        self.roll_rad[:] = inputs.roll_rad
        self.hand[:, :3] = inputs.position_m
        self.hand[:, 3] = inputs.jaw_angle_rad
        predict_proxies(self.hand, self.stretch, self.stiffness, self.damping, dt_s, self.free, self.compliance)
        for tool in range(N_TOOLS):
            if self.free[tool, 3] < self.jaw_stop_rad[tool]:
                self.free[tool, 3] = self.jaw_stop_rad[tool]
                self.compliance[tool, 3] = 0.0
        np.subtract(self.free, self.proxy, out=self.motion)
        self.update_pose()

    def correct(self, force: FloatArray) -> None:
        """Apply the generalised contact forces (2, 4) of the step, in N and N m."""
        np.multiply(self.compliance, force, out=self.proxy)
        self.proxy += self.free
        np.subtract(self.proxy, self.hand, out=self.stretch)

    def jaw_stop_torque_nm(self) -> FloatArray:
        """Return the opening torque (2,) with which something held keeps the jaws from closing."""
        squeeze = np.where(np.isfinite(self.jaw_stop_rad), self.jaw_stop_rad - self.hand[:, 3], 0.0)
        torque: FloatArray = self.stiffness[:, 3] * np.maximum(squeeze, 0.0)
        return torque

    def update_pose(self) -> None:
        """Recompute frames and segments from the proxies."""
        update_poses(
            self.proxy, self.port_m, self.roll_rad, self.jaw_length_m, self.frame, self.length_m, self.segments
        )


@kernel
def predict_proxies(
    hand: FloatArray,
    stretch: FloatArray,
    stiffness: FloatArray,
    damping: FloatArray,
    dt_s: float,
    free: FloatArray,
    compliance: FloatArray,
) -> None:
    """Write the free end positions and the compliances (2, 4) of the couplings."""
    for tool in range(hand.shape[0]):
        for axis in range(hand.shape[1]):
            rate = damping[tool, axis] / dt_s
            compliance[tool, axis] = 1.0 / (stiffness[tool, axis] + rate)
            free[tool, axis] = hand[tool, axis] + compliance[tool, axis] * rate * stretch[tool, axis]


@kernel
def update_poses(
    proxy: FloatArray,
    port: FloatArray,
    roll: FloatArray,
    jaw_length: FloatArray,
    frame: FloatArray,
    length: FloatArray,
    segments: FloatArray,
) -> None:
    """Write frames (2, 3, 3), shaft lengths (2,) and segments (2, 3, 2, 3) of both tools."""
    for tool in range(proxy.shape[0]):
        junction = proxy[tool, :3]
        length[tool] = tool_frame(junction, port[tool], roll[tool], frame[tool])
        tool_segments(junction, port[tool], frame[tool], proxy[tool, 3], jaw_length[tool], segments[tool])
