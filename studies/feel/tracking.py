"""What physics solved and arms applied in a running rig, beside the mechanics alone and the full finite elements.

Of an insertion: every tick against the same poses stepped in process. Of the pinch in it, before anything else touches
the duct: the wall against the full model's static answer to the same loads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from scipy.sparse import csc_array

from trocar.protocol.bodies import GatewayState, PhysicsState
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.kinematics import jaw_angle_from_handle
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.loop.loop import LoopMeter, TickClock
from trocar.studies.accuracy.pinches import full_model

TRACKED_DEPTH_M = 19.5e-3
WITHIN = 0.05
TOOLS = ("catheter", "wall")
#: From a pose to the force that the arm applies: a tick through haptics and physics, and the next one's.
LATE = 2
_CATHETER_ON_DUCT = 2  # of `ContactForces.kind`
#: Before the touch, so many ticks of a hand at rest are looked at.
_REST_TICKS = 200


class Apart(msgspec.Struct, frozen=True):
    """Forces of one tool beside the mechanics alone, as shares of its largest: ticks `within` `WITHIN`, `worst`."""

    tool: str
    what: str
    within: float
    worst: float


class Pinched(msgspec.Struct, frozen=True):
    """A pinch at rest.

    Attributes:
        force_n: On the forceps, as solved.
        wall: By how much more work the full finite elements' wall takes up under the same loads, relative.
        applied: How far the arm's force is from the solved one, relative. All are means over the time of rest, since an
            encoder that counts to and fro moves the tool along the wall by more than is felt there.
    """

    force_n: float
    wall: float
    applied: float


class Running(msgspec.Struct, frozen=True):
    """An insertion through running processes.

    Attributes:
        lost: Ticks of the rig's clock that nobody told of, or that were not simulated one by one.
        made_with: Command, code, date, machine, as lines.
    """

    ticks: int
    lost: int
    apart: tuple[Apart, ...]
    pinch: Pinched
    made_with: tuple[str, ...] = ()


@dataclass(frozen=True)
class Tracked:
    """How far apart forces are, as shares of the largest of each tool; (tools, ticks).

    Attributes:
        solved: (tools, ticks). What physics found, against the mechanics alone.
        applied: (tools, ticks). What the arms applied two ticks later.
        lost: int
    """

    solved: FloatArray
    applied: FloatArray
    lost: int

    def apart(self) -> tuple[Apart, ...]:
        """Return it in few numbers."""
        kinds = (("solved by physics", self.solved), ("applied by the arm", self.applied))
        return tuple(
            Apart(tool, what, float(np.mean(apart[k] < WITHIN)), float(apart[k].max()))
            for k, tool in enumerate(TOOLS)
            for what, apart in kinds
        )


def is_inserted(solved: Sequence[PhysicsState]) -> bool:
    """Return whether the catheter is in as far as hands slide it, 20 mm."""
    return bool(solved) and solved[-1].catheter.inserted_length_m >= TRACKED_DEPTH_M


def find_running(
    said: Sequence[GatewayState], states: Sequence[PhysicsState], scene: SceneModel, cache: Path
) -> Running:
    """Return what the rig did in an insertion into the scene's duct, of all that gateway and physics said."""
    wall = scene, build_scene_duct(scene, cache)
    tracked = compare(said, states, wall)
    return Running(tracked.solved.shape[1], tracked.lost, tracked.apart(), find_pinch(said, states, wall))


def compare(
    said: Sequence[GatewayState], states: Sequence[PhysicsState], wall: tuple[SceneModel, ReducedDuct]
) -> Tracked:
    """Step the mechanics alone through the poses that physics was told of, and compare forces."""
    devices = {body.tick: body for body in said}
    by_tick = {body.tick: body for body in states if body.tick in devices}  # a tick that stands is told again
    solved = list(by_tick.values())
    alone = _alone(devices, solved, wall)
    found = np.array([[tool.force_n for tool in body.reactions()] for body in solved])
    largest = np.linalg.norm(alone, axis=2).max(axis=0)
    later = [(k, devices.get(body.tick + LATE)) for k, body in enumerate(solved)]
    answered = [k for k, device in later if device is not None]
    applied = np.array([[tool.applied_force_n for tool in device.instruments] for _, device in later if device])
    ticks = np.diff([body.tick for body in solved])
    return Tracked(
        (np.linalg.norm(found - alone, axis=2) / largest).T,
        (np.linalg.norm(applied - alone[answered], axis=2) / largest).T,
        int(np.sum(ticks - 1)),
    )


def find_pinch(
    said: Sequence[GatewayState], states: Sequence[PhysicsState], wall: tuple[SceneModel, ReducedDuct]
) -> Pinched:
    """Compare the steadying hand's pinch with the full model, when the catheter has not yet touched the duct.

    The wall is linear: the force that a given indentation takes goes as the loads' work on what they displace. What the
    wall hangs by its own weight is taken off.
    Raises UserError: who looked on came too late to see the duct untouched.
    """
    scene, duct = wall
    touches = (k for k, body in enumerate(states) if (body.contacts.kind.view() == _CATHETER_ON_DUCT).any())
    end = next(touches, len(states))
    at_rest = states[end - 1]
    free = next((body for body in states if not body.duct.load_node.view().size), None)
    if free is None:
        raise UserError("the duct was touched before anybody looked: the insertion has to be run again")
    rest = [body for body in states[:end] if at_rest.tick - _REST_TICKS < body.tick]
    moved = duct.basis.Phi @ np.mean([body.duct.q.view() - free.duct.q.view() for body in rest], axis=0)
    loads_n = np.zeros_like(moved)
    for body in rest:
        np.add.at(loads_n, body.duct.load_node.view(), body.duct.load_force_n.view() / len(rest))
    nodes = np.arange(len(moved), dtype=np.int32)
    duct.residual.apply(nodes, loads_n, nodes, moved)
    model = full_model(scene.duct)
    full = nodal_translations(model, factorise(csc_array(model.K_free)).solve(free_load(model, loads_n)))
    ticks = range(rest[0].tick, at_rest.tick + 1)
    force = np.mean([body.reactions()[1].force_n for body in rest], axis=0)
    applied = np.mean([body.instruments[1].applied_force_n for body in said if body.tick - LATE in ticks], axis=0)
    norm = float(np.linalg.norm(force))
    work = float(np.sum(loads_n * full) / np.sum(loads_n * moved)) - 1.0
    return Pinched(norm, work, float(np.linalg.norm(applied - force)) / norm)


def _alone(
    devices: dict[int, GatewayState], solved: Sequence[PhysicsState], wall: tuple[SceneModel, ReducedDuct]
) -> FloatArray:
    """Return forces (ticks, tools, 3) in N of the same steps without processes between."""
    scene, duct = wall
    simulation = Simulation(scene, duct)
    tools, clock, forces = ToolInputs(), TickClock(LoopMeter(1000.0)), np.empty((len(solved), 2, 3))
    for k, body in enumerate(solved):
        for i, (device, forceps) in enumerate(zip(devices[body.tick].instruments, scene.forceps, strict=True)):
            tools.position_m[i], tools.roll_rad[i] = device.position_m, device.roll_rad
            if forceps.jaws is not None:
                ratio, most = forceps.jaws.jaw_ratio, forceps.jaws.jaw_max_angle_rad
                tools.jaw_angle_rad[i] = jaw_angle_from_handle(device.handle_angle_rad, ratio, most)
        for _ in range(clock.steps(body.tick)):
            simulation.step(tools)
        forces[k] = simulation.tool_results.force_n
    return forces
