"""A catheter inserted into a duct by two scripted hands, written to VTU every 50 ms for ParaView.

python docs/examples/insertion_to_vtu.py [folder]
"""

import sys
from pathlib import Path

from trocar.services.mechanics.scenarios import insertion
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.meshes import write_vtu

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "insertion")
folder.mkdir(parents=True, exist_ok=True)
scenario, hands = insertion(), ToolInputs()
duct = build_scene_duct(scenario.scene)
simulation = Simulation(scenario.scene, duct)
for tick in range(round(1000 * scenario.duration_s)):
    scenario.write_inputs(1e-3 * tick, hands)
    simulation.step(hands)
    if tick % 50 == 0:
        n = simulation.duct.n_loads
        loads = simulation.duct.load_nodes[:n], simulation.duct.load_force_n[:n]
        u = duct.displacements(simulation.duct.state.q, *loads)
        moved = TriangleMesh(duct.mesh.vertices_m + u, duct.mesh.triangles)
        write_vtu(folder / f"duct-{tick:04d}.vtu", moved, {"displacement_m": u})

print(f"{1e3 * simulation.inserted_length_m:.1f} mm in, {len(list(folder.glob('*.vtu')))} files in {folder}")
