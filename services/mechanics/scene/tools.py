"""Inputs of the hands to a step, and its results for each tool."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from trocar.services.mechanics.arrays import FloatArray

N_TOOLS = 2


@dataclass(slots=True)
class GraspHold:
    """The jaws of one tool holding one point of the catheter or of the duct wall.

    The simulation stores the point's place in the jaws: it is fixed when a ``hold_id`` first appears, and moves only
    when the hold slips. A hold that is no longer listed is released.

    Attributes:
        hold_id: int. Never reused; a new grasp takes a new number.
        target_kind: int. `pairs.DUCT_TRIANGLE` or `pairs.CATHETER_SEGMENT`.
        target: int. Triangle or segment at the moment of the grasp.
        target_weights: (3,) float64. Barycentric in the triangle; (1 - s, s, 0) on the segment.
        limit_n: float. Largest force the hold carries before it slips: grip friction times the squeeze.
        jaw_angle_rad: float. Opening at which the grasp closed; there a catheter stops the jaws.
    """

    hold_id: int
    tool: int
    target_kind: int
    target: int
    target_weights: FloatArray
    limit_n: float
    jaw_angle_rad: float


@dataclass(slots=True)
class ToolInputs:
    """State of both instruments at the end of the tick: the measured HIP, never the proxy.

    Attributes:
        present: (2,) bool. An absent tool has no contact and no force; one with a NaN or an infinity counts as absent.
        position_m: (2, 3) float64. Junction point J of shaft and jaws.
        roll_rad: (2,) float64. Rotation of the jaws about the shaft.
        jaw_angle_rad: (2,) float64. Opening commanded by the handle; jaws stop earlier if something is between them.
        holds: list of GraspHold, or None. With None the simulation detects grasps itself.
    """

    present: npt.NDArray[np.bool_] = field(default_factory=lambda: np.ones(N_TOOLS, np.bool_))
    position_m: FloatArray = field(default_factory=lambda: np.zeros((N_TOOLS, 3)))
    roll_rad: FloatArray = field(default_factory=lambda: np.zeros(N_TOOLS))
    jaw_angle_rad: FloatArray = field(default_factory=lambda: np.zeros(N_TOOLS))
    holds: list[GraspHold] | None = None


@dataclass(slots=True)
class ToolResults:
    """Forces on each instrument, written in place by every step.

    Attributes:
        force_n: (2, 3) float64. Force of the virtual world on the tool, reduced to J.
        port_moment_nm: (2, 3) float64. Moment of the same forces about the port, which the trocar and the hand share.
        grasp_torque_nm: (2,) float64. Torque that opens the jaws; positive pushes the handle open.
        stiffness_n_m: (2, 3, 3) float64. Stiffness at J for a steady motion over 5 ms, coupling included; zero out of
            contact.
        grasp_stiffness_nm_rad: (2,) float64. Decrease of `grasp_torque_nm` per radian by which the hand opens the jaws,
            coupling included.
        proxy_position_m: (2, 3) float64. Position of J in the simulation, at the other end of the coupling spring.
        proxy_jaw_angle_rad: (2,) float64. Opening of the jaws in the simulation.
    """

    force_n: FloatArray = field(default_factory=lambda: np.zeros((N_TOOLS, 3)))
    port_moment_nm: FloatArray = field(default_factory=lambda: np.zeros((N_TOOLS, 3)))
    grasp_torque_nm: FloatArray = field(default_factory=lambda: np.zeros(N_TOOLS))
    stiffness_n_m: FloatArray = field(default_factory=lambda: np.zeros((N_TOOLS, 3, 3)))
    grasp_stiffness_nm_rad: FloatArray = field(default_factory=lambda: np.zeros(N_TOOLS))
    proxy_position_m: FloatArray = field(default_factory=lambda: np.zeros((N_TOOLS, 3)))
    proxy_jaw_angle_rad: FloatArray = field(default_factory=lambda: np.zeros(N_TOOLS))
