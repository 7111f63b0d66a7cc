"""How far hands are ahead of their tools, and how much time has not happened: what a world that stands still shows."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.scene.tools import N_TOOLS, ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.stability.criteria import Figures


class HandLead:
    """Keeps by how much a hand is further from its tool than the coupling between them explains.

    Between hand and tool there is a spring with a damper, F = K d + B d', with the force F that the tool bears and the
    tool's offset d from the hand. A tool that bears a force is away from its hand for that reason, by millimetres. What
    else there is of an offset is motion that the simulation owes to the hand.

    Args:
        simulation: Simulation
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation, tools = simulation, simulation.tools
        self._softness_m_n = 1.0 / tools.stiffness[:, :1]
        self._damping_s = tools.damping[:, :1] * self._softness_m_n
        self._offset_m = np.zeros((N_TOOLS, 3))
        self._known = np.zeros(N_TOOLS, np.bool_)
        self._worst_m = self._elapsed_s = 0.0

    def look(self, hands: ToolInputs, dt_s: float) -> None:
        """Enter the step that was just taken with these inputs."""
        simulation, tools = self._simulation, self._simulation.tools
        self._elapsed_s += dt_s
        offset_m = tools.proxy[:, :3] - hands.position_m
        rate_m_s = (offset_m - self._offset_m) / dt_s
        owed_m = offset_m + self._damping_s * rate_m_s - self._softness_m_n * simulation.tool_results.force_n
        is_there = tools.present & hands.present
        if (counts := is_there & self._known).any():
            self._worst_m = max(self._worst_m, float(np.linalg.norm(owed_m[counts], axis=1).max()))
        self._offset_m, self._known = offset_m, is_there

    def figures(self) -> Figures:
        """Return the largest lead in m, and the share of the time that has not happened."""
        return {"hand_lead": self._worst_m, "withheld": withheld_s(self._simulation) / max(self._elapsed_s, 1e-9)}


def withheld_s(simulation: Simulation) -> float:
    """Return the time (s) that steps have left out so far; 0 where a simulation never leaves any out."""
    return float(getattr(simulation, "withheld_s", 0.0))
