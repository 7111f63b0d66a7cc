"""Grasps of the tools' jaws: tools follow the hands, and contacts of jaws are detected only while they close."""

from __future__ import annotations

from trocar.protocol.arrays import Array
from trocar.protocol.bodies import PhysicsState
from trocar.services.haptics.deformed_scene import DeformedScene
from trocar.services.haptics.jaw_touches import JawTouches
from trocar.services.haptics.tool_tracker import ToolTracker
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.grasp import Grasp, JawState
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import GraspHold
from trocar.services.mechanics.snapshot import Snapshot


class Grasping:
    """The grasps of a scene's tools, moved by a rig's devices or by an agent.

    Args:
        scene, duct: The same as in physics.
        reactions: (2, REACTION_COLUMNS), instruments: (2, INSTRUMENT_COLUMNS). Live tables of solved forces and of the
            hands' states.
    """

    def __init__(self, scene: SceneModel, duct: ReducedDuct, reactions: FloatArray, instruments: FloatArray) -> None:
        self.scene = DeformedScene(scene, duct)
        self.tools = ToolTracker(scene, reactions, instruments)
        self.touches = JawTouches(scene, duct, self.tools.radius_m)
        jaws = [(tool, each.jaws) for tool, each in enumerate(scene.forceps)]
        self.grasps = [Grasp(tool, each, duct.mesh, scene.catheter) for tool, each in jaws if each is not None]
        self.closing: list[int] = []
        self._jaws: list[tuple[Grasp, JawState]] = []
        self._snapshot = Snapshot(self.grasps, (scene, duct))

    def update_shapes(self, state: PhysicsState) -> None:
        """Store the positions of wall and catheter, against which closing jaws are tested."""
        self.scene.take_duct(state.duct)
        self.scene.take_catheter(state.catheter)

    def follow_hands(self, n_tools: int, withdrawn: int = 0) -> Array:
        """Move the tools to the first hands and return their table for physics; `closing` are tools that may grasp.

        Tools in the bit mask `withdrawn` let go of what they hold.
        """
        hands = self.tools.take_hands(n_tools)
        grasps = [each for each in self.grasps if each.tool < n_tools and not withdrawn >> each.tool & 1]
        self._jaws = [(each, self.tools.jaws(each.tool)) for each in grasps]
        if withdrawn:
            for grasp in self.grasps:
                if grasp not in grasps:
                    grasp.let_go()
        self.closing = [grasp.tool for grasp, jaws in self._jaws if grasp.may_close(jaws)]
        return hands

    def update(self) -> list[GraspHold]:
        """Return the holds of the tools, a live list until the next call."""
        self.touches.find(self.closing, self.tools.segments_m, self.scene)
        return [hold for grasp, jaws in self._jaws for hold in grasp.update(self.touches.pairs, jaws)]

    def begin_again(self) -> None:
        """Release all holds and reset the scene, which restarts."""
        self._snapshot.restore()
        self.scene.forget()
        self.touches.forget()
