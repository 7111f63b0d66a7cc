"""A duct between the jaws of a forceps: how hard does it push back as they close?

python docs/examples/pinched_duct.py
"""

import numpy as np

from trocar.services.mechanics.scene import DuctScene, ForcepsScene, SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct

forceps = ForcepsScene(port_position_m=(30e-3, 0, 150e-3), jaw_max_angle_rad=1.3)
scene = SceneModel(duct=DuctScene(n_around=20, n_along=20, n_modes=40, membrane="cst"), forceps=(forceps, forceps))
simulation, hands = Simulation(scene, build_scene_duct(scene)), ToolInputs()
hands.present[1] = False
hands.position_m[0], hands.roll_rad[0] = (30e-3, 0, 12e-3), np.pi / 2
for angle_rad in [*np.linspace(1.2, 0.4, 801), *[0.4] * 400]:  # closed in 0.8 s, then held until the wall is still
    hands.jaw_angle_rad[0] = angle_rad
    simulation.step(hands)

torque_nm = simulation.tool_results.grasp_torque_nm[0]
open_rad, n_nodes = simulation.tools.proxy[0, 3], simulation.duct.n_loads
print(f"jaws at {open_rad:.2f} rad feel {1e3 * torque_nm:.2f} mN m from {n_nodes} nodes")
