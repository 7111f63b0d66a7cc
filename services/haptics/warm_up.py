"""Compiles all kernels of haptics before the loop starts, on tools that lie across the duct at rest."""

from __future__ import annotations

import numpy as np

from trocar.services.haptics.deformed_scene import nodes_exist
from trocar.services.haptics.grasping import Grasping
from trocar.services.haptics.instruments import InstrumentTable
from trocar.services.haptics.local_model import LocalModels
from trocar.services.haptics.reactions import Reactions
from trocar.services.mechanics.bodies.catheter import CatheterBody
from trocar.services.mechanics.bodies.forceps.grasp import deepest_touches, rest_distance_m
from trocar.services.mechanics.collision.pairs import DUCT_TRIANGLE
from trocar.services.mechanics.effects import build_effects, by_stage
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_catheter import scene_rod
from trocar.services.start.kernel_progress import told
from trocar.services.start.start_progress import Say, ignore

#: Kernels that it compiled in a first start of the default scene, those for physics among them.
_KERNELS = 140


def warm_up(scene: SceneModel, duct: ReducedDuct, say: Say = ignore) -> None:
    """Detect the contacts of jaws placed in the wall; then compile some kernels for physics.

    Physics compiles the contact solve meanwhile, on the other core, and then finds these kernels in the cache.
    """
    with told(say, _KERNELS) as kernels:
        kernels.begin("collision detection")
        instruments, reactions = InstrumentTable(len(scene.forceps)), Reactions()
        grasping = Grasping(scene, duct, reactions.rows, instruments.rows)
        deformed, tools, touches = grasping.scene, grasping.tools, grasping.touches
        LocalModels(scene.forceps, reactions.rows, instruments.rows).table(N_TOOLS, touching=True)
        tools.take_hands(N_TOOLS)
        tools.segments_m[:] = duct.mesh.vertices_m[0]
        tools.segments_m[:, :, 1] += 0.01
        nodes_exist(deformed.loads[0], 0)
        deformed.has_catheter = True
        for _ in range(2):
            touches.find((0,), tools.segments_m, deformed)
            tools.segments_m[:, :, 1] += 1e-5
        deepest_touches(touches.pairs, 0, DUCT_TRIANGLE)
        rest_distance_m(touches.pairs, duct.mesh, 0, 0)
        grasping.begin_again()
        kernels.begin("the catheter")
        _step_catheter(scene)
        if kernels.count:
            kernels.begin("a share for physics")
            compile_for_physics(scene, duct)


def _step_catheter(scene: SceneModel) -> None:
    """Take a step of a touched catheter, and the step after it."""
    catheter = CatheterBody(scene.catheter, scene_rod(scene, by_stage(build_effects(scene).values())["modify_rod"]))
    nodes, weights, forces = np.zeros((1, 4), np.int32), np.zeros((1, 4)), np.zeros((1, 3))
    weights[:, 0] = 1.0
    catheter.predict(1e-3)
    catheter.compliance(nodes, weights)
    catheter.correct(nodes, weights, forces)
    catheter.predict(1e-3)


def compile_for_physics(scene: SceneModel, duct: ReducedDuct) -> None:
    """Call kernels that only physics needs, and needs last, so that both processes do not compile the same ones."""
    simulation = Simulation(scene, duct)
    simulation.write_report()
    simulation.catheter.predict(1e-3)
    simulation.compile_rare_kernels()
    _ = simulation.inserted_length_m
    simulation.solver.pricing.compile_kernels()
