"""Observation of mode ``state`` for the navigation of a catheter to a branch."""

from __future__ import annotations

import math

import numpy as np

from trocar.envs.state import Field, joined, most_of, points_m
from trocar.protocol.bodies import GatewayState, PhysicsState, ToolContacts
from trocar.protocol.bodies.physics import REACTION_FORCE
from trocar.protocol.topics import TICK_S
from trocar.services.mechanics.arrays import Float32Array, FloatArray
from trocar.services.meshes.tube_paths import TubePaths
from trocar.services.training.scenario import Goal
from trocar.services.training.site import Site

N_POINTS = 8
SPACING_M = 5e-3
AHEAD_M = (0.0, 5e-3, 10e-3, 20e-3, 40e-3)

FIELDS = (
    Field("pushed", (1,), "m", 0.3, "how far the drive has gone in"),
    Field("twist", (2,), "1", 1.0, "sine and cosine of its roll"),
    Field("handle", (1,), "rad", 3.15, "its handle"),
    Field("force", (1,), "N", 20.0, "on it along the catheter, against a push"),
    Field("catheter", (N_POINTS, 3), "m", 0.3, "points of the catheter from the mouth at rest, tip first, 5 mm apart"),
    Field("ahead", (len(AHEAD_M), 3), "m", 0.3, "from the tip to its place on the target's way, and to 5, 10, 20 and "
          "40 mm farther on"),
    Field("to_go", (1,), "m", 0.3, "way to the goal; less than nothing beyond it"),
    Field("astray", (1,), "m", 0.3, "how far the tip has come on another branch"),
    Field("inserted", (1,), "m", 0.3, "length of catheter in the lumen"),
    Field("time", (1,), "s", 1000.0, "since the beginning"),
)  # fmt: skip
"""Axes are those of the scene."""

MOST = most_of(FIELDS)


class NavigationView:
    """Reads the observation of a navigation.

    Args:
        site: Site. Site of the mouth, and paths from it.
        goal: Goal. Branch and depth.
        tool: int. Index of the drive.
        behind_m: float. Distance of its port behind its start.
    """

    def __init__(self, site: Site, goal: Goal, tool: int, behind_m: float) -> None:
        self._mouth_m, self._goal, self._tool, self._behind_m = np.array(site.mouth_m), goal, tool, behind_m
        self._ways = TubePaths({name: np.array(way) for name, way in site.ways.items()})

    def read(self, devices: GatewayState, _contacts: ToolContacts, solved: PhysicsState) -> Float32Array:
        """Return the observation (len(MOST),) as float32."""
        drive = devices.instruments[self._tool]
        shaft = np.subtract(drive.position_m, drive.port_m)
        length_m = float(np.linalg.norm(shaft))
        told = solved.tools.view()
        force_n = told[self._tool, REACTION_FORCE : REACTION_FORCE + 3] if self._tool < len(told) else np.zeros(3)
        catheter_m = points_m(solved, N_POINTS, SPACING_M)
        tip_m, inserted_m = catheter_m[0], solved.catheter.inserted_length_m
        come_m = self._ways.progress_m(tip_m, self._goal.branch) if inserted_m > 0.0 else 0.0
        astray_m = self._ways.place(tip_m)[1] - come_m if inserted_m > 0.0 else 0.0
        parts = (
            length_m - self._behind_m, math.sin(drive.roll_rad), math.cos(drive.roll_rad), drive.handle_angle_rad,
            -float(force_n @ shaft) / length_m, catheter_m - self._mouth_m, self._ahead_m(come_m) - tip_m,
            self._goal.depth_m - come_m, astray_m, inserted_m, solved.tick * TICK_S,
        )  # fmt: skip
        return joined(parts, MOST)

    def _ahead_m(self, come_m: float) -> FloatArray:
        """Return points (k, 3) of the path to the target, ahead of the tip."""
        way_m, arc_m = self._ways.path_m[self._goal.branch], self._ways.arc_m[self._goal.branch]
        at_m = come_m + np.array(AHEAD_M)
        return np.stack([np.interp(at_m, arc_m, axis) for axis in way_m.T], axis=1)
