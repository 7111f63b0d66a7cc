"""Compiles all kernels of a scene before the loop starts, so that the first contact does not cost a second."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trocar.protocol.bodies.haptics import tool_table
from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE, JAW_A, ContactPairs
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.contact.candidate_search import CandidateSearch, LayersOut
from trocar.services.mechanics.contact.spheres import Spheres
from trocar.services.mechanics.contact.state import ContactState
from trocar.services.mechanics.contact.system import ContactSystem
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.rod import RodState
from trocar.services.mechanics.rod.implicit import ImplicitIntegrator
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.duct_alone import DuctAlone
from trocar.services.mechanics.snapshot import Snapshot
from trocar.services.physics.inputs import ContactsReader
from trocar.services.physics.outputs import Outputs
from trocar.services.physics.stand_in import stand_in_duct, stand_in_scene
from trocar.services.start.kernel_progress import told
from trocar.services.start.start_progress import Say, ignore

#: Kernels that each part compiled or found in a first start of the default scene.
_KERNELS_OF_CONTACT, _KERNELS_OF_STEP = 150, 105

_STEPS = 20  # assumption: contacts, friction and a grasp have then been through every kernel
#: Steps with all contacts of tools placed deep in the wall; each may take half a second.
_STEPS_OF_ALL = 2


def warm_up_contact(scene: SceneModel, say: Say = ignore) -> None:
    """Compile the contact solve before the duct exists, which haptics builds meanwhile on the other core.

    This uses a temporary simulation without collision detection or a moving rod: haptics compiles those after the
    duct, and `warm_up` then finds them in the cache.
    """
    if scene.duct_alone:
        return
    with told(say, _KERNELS_OF_CONTACT) as kernels:
        kernels.begin("contact")
        answer_contacts(stand_in_scene(scene), stand_in_duct(scene))


def warm_up(scene: SceneModel, duct: ReducedDuct, say: Say = ignore) -> None:
    """Run a temporary simulation until nothing is left to compile."""
    if scene.duct_alone:
        alone = DuctAlone(replace(scene, sleeping=False), duct)
        alone.step()
        DuctAlone(scene, duct).step()
        return
    with told(say, _KERNELS_OF_STEP) as kernels:
        kernels.begin("a whole step")
        simulation = Simulation(scene, duct)
        tools = _touch_everything(simulation)
        for _ in range(_STEPS_OF_ALL):
            simulation.step(tools)
        tools.holds = [GraspHold(1, 0, DUCT_TRIANGLE, 0, np.array([0.5, 0.3, 0.2]), 1.0, 0.2)]
        simulation.step(tools)
        for level in range(len(scene.quality)):
            simulation.set_quality(level)
            simulation.step(tools)
        simulation.solver.pricing.compile_kernels()
        simulation.compile_rare_kernels()
        ContactsReader(simulation).compile_kernels()
        Outputs(simulation, "").state(0, tool_table(()))
        _ = simulation.inserted_length_m
        Snapshot(simulation, (scene, duct)).restore()  # as when the hands begin again


def answer_contacts(scene: SceneModel, duct: ReducedDuct) -> None:
    """Solve contacts of every kind in a scene without collision detection or a moving rod."""
    still = Simulation(scene, duct, _FixedContactSearch())
    still.catheter.integrator, still.catheter.plain_integrator = _RigidRod(still.catheter.properties), None
    _touch_everything(still)
    still.solver.pricing.compile_kernels()


def _touch_everything(simulation: Simulation) -> ToolInputs:
    """Take steps with a contact of each kind and a grasp; return the tools without the grasp.

    Its tools are inside the wall on purpose, which nobody is told.
    """
    simulation.inside_watch.tell = lambda _sentence: None
    tools = _tools(simulation)
    tools.holds = [GraspHold(0, 1, CATHETER_SEGMENT, 0, np.array([0.5, 0.5, 0.0]), 1.0, 0.2)]
    for _ in range(_STEPS):
        simulation.step(tools)
    tools.holds = []
    return tools


def _tools(simulation: Simulation) -> ToolInputs:
    """Return one tool in the wall and one at the catheter."""
    tools, mesh = ToolInputs(), simulation.duct.reduced.mesh
    tools.position_m[0] = mesh.vertices_m[mesh.n_vertices // 2]
    tools.position_m[1] = simulation.catheter.state.position_m[-2]
    tools.jaw_angle_rad[:] = 0.3
    return tools


def _write_touches(pairs: ContactPairs) -> None:
    """Write an artificial contact of a jaw with the wall, and one with the catheter."""
    for row, kind in enumerate((DUCT_TRIANGLE, CATHETER_SEGMENT)):
        pairs.tool[row], pairs.tool_segment[row], pairs.target_kind[row] = 0, JAW_A, kind
        pairs.target_weights[row] = (0.5, 0.5, 0.0)
        pairs.normal[row, 2] = 1.0
    pairs.count = 2


class _FixedContactSearch(CandidateSearch):
    """Returns artificial contacts of a jaw, and no candidates to price."""

    dropped, n_candidates, wall_moved_m = 0, 0, 0.0

    def __init__(self) -> None:
        pass

    def begin(self, system: ContactSystem) -> None:
        """Do nothing: no tool overlaps a body."""
        system.bodies.tools.disengaged[:] = False

    def restore_start(self) -> None:
        """Do nothing: there is no state."""

    def write_pairs(self, state: Address[ContactState], pairs: ContactPairs) -> None:
        """Write the jaw's contacts."""
        _write_touches(pairs)

    def set_spheres(self, spheres: Spheres) -> None:
        """Do nothing: spheres have no contact."""

    def set_strands(self, n_apart: int) -> None:
        """Do nothing: strands have no contact."""

    def set_catheter_row_gap(self, gap_m: float) -> None:
        """Do nothing: there are no candidates."""

    def price(self, system: ContactSystem, tolerance_m: float, pairs: ContactPairs) -> int:
        """Return that nothing ends too deep."""
        return 0

    def update_working_set(self, state: Address[ContactState]) -> None:
        """Do nothing: there is no state."""

    def count_layers(self, system: ContactSystem, tools: BoolArray, out: LayersOut, fewer: float) -> None:
        """Do nothing: nothing lies between the jaws."""

    def forget(self) -> None:
        """Do nothing: there is no state to clear."""

    def is_sound(self) -> bool:
        """Return True: nothing overlaps."""
        return True


class _RigidRod(ImplicitIntegrator):
    """A rod that does not move and hardly yields."""

    def predict(self, state: RodState, external_force_n: FloatArray, dt_s: float) -> None:
        """Stay."""

    def compliance(self, particles: IntArray, out: FloatArray) -> None:
        """Fill in the compliance of stiff springs, one a particle."""
        out[:] = 0.0
        np.fill_diagonal(out, 1e-6)

    def correct(self, state: RodState, contact_force_n: FloatArray) -> None:
        """Stay."""
